"""A foreign CSV with its mapping: units, axes, clock, and lines that were cut."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from levelhead.errors import LogError
from levelhead.logs.log import Log
from levelhead.logs.readers import read

Writer = Callable[[str, str], Path]

# A MEMS board: accelerations in g, rates in deg/s, host clock in ms; axes back, right, up.
BOARD = """
[imu]
header = false
columns = { time = 7, accel_x = 1, accel_y = 2, accel_z = 3, gyro_x = 4, gyro_y = 5, gyro_z = 6 }
units = { time = "ms", accel = "g", gyro = "deg/s" }
axes = ["-x", "y", "-z"]
"""
LINES = "0.5,0.25,1.0,10,20,30,1000\n0.5,0.25,1.0,10,20,30,1010\n0.5,0.25,1.0,10,20,30,1020\n"
GNSS = "time,vel_n,vel_e,vel_d\n1.00,7,8,9\n1.01,7,8,9\n"


@pytest.fixture
def read_board(put: Writer) -> Callable[..., Log]:
    def read_board(lines: str, extra: str = "", gnss: str = GNSS) -> Log:
        return read(put("imu.csv", lines), gnss=put("gnss.csv", gnss), mapping=put("m.toml", BOARD + extra))

    return read_board


def test_units_and_axes(read_board: Callable[..., Log]) -> None:
    log = read_board(LINES)
    np.testing.assert_allclose(log.time, [0.0, 0.01, 0.02], atol=1e-15)  # rounding of 1.01 - 1.0
    np.testing.assert_allclose(log.accel[0], np.array([-0.5, 0.25, -1.0]) * 9.80665, rtol=1e-15)
    np.testing.assert_allclose(log.gyro[0], np.radians([-10.0, 20.0, -30.0]), rtol=1e-15)
    assert log.meta["epoch"] == 1.0
    assert log.meta["format"] == "mapped-csv"
    np.testing.assert_allclose(log.gnss_time, [0.0, 0.01], atol=1e-15)


def test_the_offset_is_added_to_the_stamps_of_the_imu(read_board: Callable[..., Log]) -> None:
    log = read_board(LINES, "time_offset_s = -0.125", GNSS.replace("1.00", "0.885"))
    assert log.meta["epoch"] == 0.875
    # An earlier IMU puts the same GNSS epoch later in the log.
    assert log.gnss_time[0] == pytest.approx(0.01, abs=1e-15)


def test_time_zero_puts_the_clock_into_the_calendar(read_board: Callable[..., Log]) -> None:
    log = read_board(LINES, 'time_zero = "1970-01-12T13:46:40"', GNSS.replace("1.0", "1000001.0"))
    assert log.meta["epoch"] == 1000001.0
    np.testing.assert_allclose(log.gnss_time, [0.0, 0.01], atol=1e-9)  # a double near 1e6 resolves 1.2e-10


def test_a_mounted_imu_is_turned_into_the_vehicle(read_board: Callable[..., Log]) -> None:
    # The vehicle brakes at 0.5 g; the IMU points 30 degrees to the right of it: it feels the braking from ahead and
    # from its right (the vehicle's rear lies behind it and to its right).
    forward, right = -0.5 * np.cos(np.pi / 6), 0.5 * np.sin(np.pi / 6)
    lines = "".join(f"{-float(forward)!r},{float(right)!r},1.0,0,0,0,{1000 + 10 * k}\n" for k in range(3))
    log = read_board(lines, "mounting_deg = { yaw = 30.0 }")
    np.testing.assert_allclose(log.accel[0], np.array([-0.5, 0.0, -1.0]) * 9.80665, atol=1e-14)  # rounding
    # The log keeps how it was turned: an export of the biases goes back to the file's axes with it.
    turned = np.array(log.meta["dcm_file_to_body"]) @ [-forward, right, 1.0]
    np.testing.assert_allclose(log.accel[0], 9.80665 * turned, atol=1e-14)


@pytest.mark.parametrize(
    "first", ["0.25,1.0,10,20,30,990\n", "30,990\n", "-,0.25,1.0,10,20,30,990\n", ",0.25,1,1,2,3,990\n"]
)
def test_a_cut_first_line_is_left_out_and_the_log_marked(read_board: Callable[..., Log], first: str) -> None:
    log = read_board(first + LINES)
    assert log.time.size == 3
    assert log.meta["completeness"] == "truncated"
    assert log.events[0].code == "W_TRUNCATED"


@pytest.mark.parametrize(
    "last", ["0.5,0.25,1.0,10\n", "0.5,0.25,1.0,10,20,30", "0.5,0.25,1.0,10,20,30,", "0", "0.5,0.25,1,1,2,3,10"]
)
def test_a_cut_last_line_is_left_out_and_the_log_marked(read_board: Callable[..., Log], last: str) -> None:
    log = read_board(LINES + last)
    assert log.time.size == 3
    assert log.meta["completeness"] == "truncated"


def test_both_ends_may_be_cut_and_lines_are_still_counted_rightly(read_board: Callable[..., Log]) -> None:
    log = read_board("1.0,10,20,30,990\n" + LINES + "0.5,0.2")
    assert log.time.size == 3
    assert log.events[0].count == 2
    with pytest.raises(LogError, match=r"imu\.csv, line 3: gyro_x is empty"):
        read_board("1.0,10,20,30,990\n" + LINES.replace(",10,20,30,1010", ",,20,30,1010") + "0.5,0.2")


@pytest.mark.parametrize(
    ("lines", "sentence"),
    [
        (LINES.replace(",1010", ""), "imu.csv, line 2: the line has 6 columns where 7 are expected; repair or remove"),
        (LINES.replace("30,1010", "3o,1010"), "imu.csv, line 2: the column number 6 holds the text '3o'"),
        (LINES.replace(",", ";"), "imu.csv: the mapping asks for column 7, but the lines have 1 columns; check"),
        ("# nothing\n", "imu.csv: the file holds no line of data; check the export."),
    ],
)
def test_a_mistake_is_named_with_its_line(read_board: Callable[..., Log], lines: str, sentence: str) -> None:
    with pytest.raises(LogError, match=re.escape(sentence)):
        read_board(lines)


def test_another_delimiter(put: Writer) -> None:
    mapping = put("m.toml", BOARD.replace("header", 'delimiter = ";"\nheader'))
    log = read(put("imu.csv", LINES.replace(",", ";")), gnss=put("gnss.csv", GNSS), mapping=mapping)
    assert log.time.size == 3


HEADED = """
[imu]
columns = { time = "t", gyro_x = "gx", gyro_y = "gy", gyro_z = "gz", accel_x = "ax", accel_y = "ay", accel_z = "az" }
"""
UP = """
[gnss]
columns = { time = "t", vel_n = "north", vel_e = "east", vel_u = "up" }
units = { vel = "km/h" }
time_offset_s = -0.5
"""


def test_imu_and_gnss_may_share_a_file_and_up_is_not_down(put: Writer) -> None:
    text = "note,t,gx,gy,gz,ax,ay,az,north,east,up\nstart,100,1,2,3,4,5,6,,,\n,101,1,2,3,4,5,6,36,72,3.6\n"
    log = read(put("a.csv", text), mapping=put("m.toml", HEADED + UP))
    np.testing.assert_array_equal(log.time, [0.0, 1.0])
    np.testing.assert_array_equal(log.gnss_time, [0.5])
    assert log.velocity_ned is not None
    np.testing.assert_allclose(log.velocity_ned, [[10.0, 20.0, -1.0]], rtol=1e-15)


def test_quoted_text_with_commas_is_one_cell(put: Writer) -> None:
    imu = "t,gx,gy,gz,ax,ay,az\n0,1,2,3,4,5,6\n1,1,2,3,4,5,6\n"
    gnss = 't,"north",east,up,sentence\n1,36,72,3.6,"$GPGGA,1,2"\n'
    log = read(put("a.csv", imu), gnss=put("g.csv", gnss), mapping=put("m.toml", HEADED + UP))
    np.testing.assert_array_equal(log.gnss_time, [0.5])


ECEF = (Path(__file__).parents[3] / "examples" / "mappings" / "ecef-csv.toml").read_text(encoding="utf-8")
FIXES = (
    "tow,x,y,z,vx,vy,vz\n"
    "0.0,0.0,0.0,0.0,0.1,0.2,0.3\n"
    # On the equator at 90 degrees east, 100 m up: the Earth's y axis points up, its z axis north, its x axis west.
    "0.5,0.0,6378237.0,0.0,1.0,2.0,3.0\n"
    "1.0,,,,,,\n"
)


def test_positions_and_velocities_along_the_axes_of_the_earth(put: Writer) -> None:
    imu = put("imu.csv", "time,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z\n0,0,0,0,0,0,-9.8\n1,0,0,0,0,0,-9.8\n")
    log = read(imu, gnss=put("rover.csv", FIXES), mapping=put("m.toml", ECEF))
    np.testing.assert_array_equal(log.gnss_time, [0.5])
    assert log.velocity_ned is not None
    assert log.position_llh is not None
    np.testing.assert_allclose(log.velocity_ned, [[3.0, -1.0, -2.0]], atol=1e-15)  # rounding
    np.testing.assert_allclose(log.position_llh, [[0.0, np.pi / 2.0, 100.0]], atol=1e-8)  # of 6e6 m
    # Zeros are no position: that row is counted. The empty row is a row without a fix, as everywhere.
    assert [(event.code, event.count) for event in log.events] == [("W_DROPPED", 1)]
    assert (log.meta["datum"], log.meta["height"]) == ("ITRF2020", "ellipsoidal")


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (
            FIXES.replace("6378237.0", "6378.237"),
            "rover.csv, line 3: ecef_x, ecef_y, ecef_z lie 6378 m from the",
        ),
        (FIXES.replace(",6378237.0", ","), "rover.csv, line 3: part of ecef_x, ecef_y, ecef_z is empty (1 such"),
    ],
)
def test_what_is_no_place_on_earth_is_refused(put: Writer, wrong: str, sentence: str) -> None:
    imu = put("imu.csv", "time,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z\n0,0,0,0,0,0,-9.8\n1,0,0,0,0,0,-9.8\n")
    with pytest.raises(LogError, match=re.escape(sentence)):
        read(imu, gnss=put("rover.csv", wrong), mapping=put("m.toml", ECEF))


def test_a_column_that_the_mapping_names_wrongly_is_named(put: Writer) -> None:
    text = "t,gx,gy,gz,ax,ay,AZ\n0,1,2,3,4,5,6\n"
    with pytest.raises(
        LogError, match=r"a\.csv: the column 'az' is missing from the header \(found: t, gx, gy, gz, ax"
    ):
        read(put("a.csv", text), mapping=put("m.toml", HEADED))
    with pytest.raises(
        LogError, match=r"the column 'north' is missing .* pass gnss= if the GNSS data is in another file"
    ):
        read(put("a.csv", text.replace("AZ", "az")), mapping=put("m.toml", HEADED + UP))
    with pytest.raises(LogError, match="the column 'az' appears twice in the header"):
        read(put("a.csv", text.replace("t,", "az,t,").replace("AZ", "az")), mapping=put("m.toml", HEADED))
