"""The canonical CSV: units, half rows, bad text and files that were cut."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from levelhead.errors import LogError
from levelhead.logs.log import Log
from levelhead.logs.readers import read
from levelhead.logs.writers import write

Writer = Callable[[str, str], Path]

HEADER = "time,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z,vel_n,vel_e,vel_d\n"
ROWS = "0,0.1,0.2,0.3,1,2,3,,,\n0.5,0.1,0.2,0.3,1,2,3,7,8,9\n1,0.1,0.2,0.3,1,2,3,,,\n"


def test_a_plain_log(put: Writer) -> None:
    log = read(put("a.csv", HEADER + ROWS))
    np.testing.assert_array_equal(log.time, [0.0, 0.5, 1.0])
    np.testing.assert_array_equal(log.gyro[1], [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(log.accel[1], [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(log.gnss_time, [0.5])
    assert log.velocity_ned is not None
    np.testing.assert_array_equal(log.velocity_ned, [[7.0, 8.0, 9.0]])
    assert log.position_llh is None
    assert log.events == ()


def test_units_in_the_header_are_turned_into_si(put: Writer) -> None:
    header = (
        "time[ms],gyro_x[deg/s],gyro_y [mrad/s],gyro_z[ deg/h ],accel_x[g],accel_y[mg],accel_z,"
        "vel_n[km/h],vel_e[knot],vel_d[mm/s],vel_std[cm/s],lat,lon[rad],height[cm],pos_std[mm]\n"
    )
    rows = "0,180,1,3600,1,1000,3,,,,,,,,\n500,0,0,0,0,0,0,3.6,1,1000,5,90,1,100,10\n"
    log = read(put("a.csv", header + rows))
    np.testing.assert_array_equal(log.time, [0.0, 0.5])
    # The factors are exact to a rounding; deg/h: 3600 deg/h = 1 deg/s.
    np.testing.assert_allclose(log.gyro[0], [np.pi, 1e-3, np.pi / 180.0], rtol=1e-15)
    np.testing.assert_allclose(log.accel[0], [9.80665, 9.80665, 3.0], rtol=1e-15)
    assert log.velocity_ned is not None
    assert log.velocity_std is not None
    assert log.position_llh is not None
    assert log.position_std is not None
    np.testing.assert_allclose(log.velocity_ned, [[1.0, 1852.0 / 3600.0, 1.0]], rtol=1e-15)
    np.testing.assert_allclose(log.velocity_std, [0.05], rtol=1e-15)
    np.testing.assert_allclose(log.position_llh, [[np.pi / 2.0, 1.0, 1.0]], rtol=1e-15)
    np.testing.assert_allclose(log.position_std, [0.01], rtol=1e-15)


def test_comments_blank_lines_a_byte_order_mark_crlf_and_other_columns_do_not_matter(put: Writer) -> None:
    text = "\ufeff# from the workshop\n\n" + HEADER.replace("vel_n", "temperature,vel_n")
    text += "0,0.1,0.2,0.3,1,2,3,warm,,,\n\n0.5,0.1,0.2,0.3,1,2,3,cold,7,8,9\n"
    log = read(put("a.csv", text.replace("\n", "\r\n")))
    np.testing.assert_array_equal(log.time, [0.0, 0.5])
    assert log.velocity_ned is not None
    np.testing.assert_array_equal(log.velocity_ned, [[7.0, 8.0, 9.0]])


def test_a_fix_may_have_a_row_of_its_own(put: Writer) -> None:
    log = read(put("a.csv", HEADER + "0,0.1,0.2,0.3,1,2,3,,,\n0.3,,,,,,,7,8,9\n0.5,0.1,0.2,0.3,1,2,3,,,\n"))
    np.testing.assert_array_equal(log.time, [0.0, 0.5])
    np.testing.assert_array_equal(log.gnss_time, [0.3])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (HEADER, "a.csv: the file has a header but no rows; record data or check the export."),
        (
            HEADER.replace("gyro_y", "gyro_Y") + ROWS,
            "a.csv: the column gyro_y is missing (found: time, gyro_x, gyro_Y,",
        ),
        (HEADER.replace("gyro_y", "gyro_Y") + ROWS, "Is gyro_Y meant as gyro_y?"),
        (HEADER.replace("time", "when") + ROWS, "the column time is missing"),
        (HEADER.replace("vel_e", "east") + ROWS, "the column vel_e is missing"),
        (HEADER.replace("vel_e", "vel_n[km/h]") + ROWS, "a.csv: the column vel_n appears twice in the header"),
        (HEADER.replace("gyro_x", "gyro_x[dps]") + ROWS, "the unit 'dps' of gyro_x is not known; use one of rad/s, mr"),
        (
            HEADER + ROWS.replace("0.5,0.1", "0.5,abc"),
            "a.csv, line 3: the column gyro_x holds the text 'abc' where a n",
        ),
        (HEADER + ROWS.replace("7,8,9", "7,8"), "a.csv, line 3: the line has 9 columns where 10 are expected"),
        (HEADER + ROWS.replace("7,8,9", "7,8,9,10"), "a.csv, line 3: the line has 11 columns where 10 are expected"),
        (HEADER + "\n" + ROWS.replace("0.5,0.1", "0.5,x"), "a.csv, line 4: the column gyro_x holds the text 'x'"),
        (
            HEADER + ROWS.replace("0.5,0.1", "0.5,"),
            "a.csv, line 3: gyro_x is empty where the other readings of the row",
        ),
        (HEADER + ROWS.replace("0.5,0.1", "0.5,nan"), "a.csv, line 3: gyro_x is empty where the other readings"),
        (HEADER + ROWS.replace("0.5,0.1", "0.5,inf"), "a.csv, line 3: gyro_x is infinite (1 such rows in all)"),
        (HEADER + ROWS.replace("7,8,9", "7,,9"), "a.csv, line 3: vel_e is empty where the other readings"),
        (HEADER + ROWS.replace("0.5,", ",", 1), "a.csv, line 3: the time stamp is absent (1 such rows in all)"),
        (HEADER + ROWS + "0.7,,,,,,,,,\n2,1,1,1,1,1,1,,,\n", "line 5: the row has neither IMU readings nor a GNSS fix"),
        (HEADER + ROWS.replace("7,8,9", ",,"), "a.csv: the GNSS columns are empty on every row"),
        (HEADER + "0,,,,,,,7,8,9\n1,,,,,,,7,8,9\n", "a.csv: every row of the IMU columns is empty"),
        ("time,lat,lon,height,gyro_x\n", "the columns gyro_y, gyro_z, accel_x, accel_y, accel_z are missing"),
        (HEADER.replace("vel_n,vel_e,vel_d", "lat,lon,height") + ROWS.replace("7,8,9", "4220.2,8,9"), "ddmm.mmmm"),
    ],
)
def test_a_mistake_is_named_with_its_line(put: Writer, text: str, sentence: str) -> None:
    with pytest.raises(LogError, match=re.escape(sentence)):
        read(put("a.csv", text))


@pytest.mark.parametrize(
    "end", ["2,0.1", "2,0.1,0.2,0.3,1,2,3,7,8,-", "2,0.1,0.2,0.3,1,2,3,7,8,", "2,0.1,0.2,0.3,1,2,3,,", "-"]
)
def test_a_cut_last_line_is_left_out_and_the_log_marked(put: Writer, end: str) -> None:
    log = read(put("a.csv", HEADER + ROWS + end))
    np.testing.assert_array_equal(log.time, [0.0, 0.5, 1.0])
    assert log.meta["completeness"] == "truncated"
    (event,) = log.events
    assert (event.code, event.count) == ("W_TRUNCATED", 1)
    assert event.text.endswith("a.csv: 1.")


@pytest.mark.parametrize("end", ["2,0.1,0.2", "2,0.1,0.2,0.3,1,2,3,7,8,9", ""])
def test_a_power_cut_that_left_zeros_behind_is_a_cut_too(put: Writer, end: str) -> None:
    log = read(put("a.csv", HEADER + ROWS + end + "\0\0\0\0"))
    np.testing.assert_array_equal(log.time, [0.0, 0.5, 1.0])
    assert log.meta["completeness"] == "truncated"


def test_a_missing_last_line_end_is_no_cut(put: Writer) -> None:
    log = read(put("a.csv", HEADER + ROWS + "2,0.1,0.2,0.3,1,2,3,7,8,9"))
    assert log.time[-1] == 2.0
    assert log.meta["completeness"] == "complete"


def test_nonsense_in_the_last_line_is_an_error_not_a_cut(put: Writer) -> None:
    with pytest.raises(LogError, match=r"a\.csv, line 5: the column accel_x holds the text 'oops'"):
        read(put("a.csv", HEADER + ROWS + "2,0.1,0.2,0.3,oops,2,3,,,\n"))


def test_a_log_cut_at_any_byte_gives_its_beginning_or_a_sentence(drive: Log, tmp_path: Path) -> None:
    whole = tmp_path / "whole.csv"
    write(replace(drive.slice(0.0, 0.6), position_llh=None, position_std=None), whole)
    original, content = read(whole), whole.read_bytes()
    cut = tmp_path / "cut.csv"
    seen = 0
    for length in range(1, len(content)):
        cut.write_bytes(content[:length])
        try:
            log = read(cut)
        except LogError:
            continue
        seen += 1
        # The last value of a row may have lost digits, which nobody can see: all but the last row are compared.
        keep = log.time.size - 1
        np.testing.assert_array_equal(log.time, original.time[: keep + 1])
        np.testing.assert_array_equal(log.gyro[:keep], original.gyro[:keep])
        np.testing.assert_array_equal(log.accel[:keep], original.accel[:keep])
        rows = len(content[:length].splitlines()) - 1
        used = np.union1d(log.time, log.gnss_time).size
        # No loss is silent: every row is in the log, or the log is marked.
        assert used == rows - (log.meta["completeness"] == "truncated")
        if content[:length].endswith(b"\n"):
            assert log.meta["completeness"] == "complete"
    # A log has two samples at least: every prefix that holds two rows is one.
    two_rows = sum(len(line) for line in content.splitlines(keepends=True)[:3])
    assert seen == len(content) - two_rows
