"""Positions and wheel speeds that cannot be: one mistake, one refusal in a Log, a CSV, a Parquet and a mapped CSV."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

from levelhead.conventions import FloatArray
from levelhead.errors import LogError, UsageError
from levelhead.logs.log import Log
from levelhead.logs.mapping import load_mapping
from levelhead.logs.readers import read

Writer = Callable[[str, str], Path]

IMU_NAMES = "time,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z"
NAMES = f"{IMU_NAMES},wheel_speed,vel_n,vel_e,vel_d,lat,lon,height,pos_std\n"
GOOD = (
    "0,1,2,3,4,5,6,2.5,,,,,,,\n0.5,1,2,3,4,5,6,-2.5,7,8,9,50,8,100,0.5\n0.7,,,,,,,,7,8,9,,,,\n1,1,2,3,4,5,6,,,,,,,,\n"
)
FIX = "7,8,9,50,8,100,0.5"
MAPPING = (
    "[imu]\ncolumns = { "
    + ", ".join(f'{name} = "{name}"' for name in (*IMU_NAMES.split(","), "wheel_speed"))
    + " }\n[gnss]\ncolumns = { "
    + ", ".join(f'{n} = "{n}"' for n in ("time", "vel_n", "vel_e", "vel_d", "lat", "lon", "height", "pos_std"))
    + " }\n"
)

ROWS = [
    ("7,8,9,90.5,8,100,0.5", "lat is beyond 90 degrees (1 such rows in all); give degrees as decimal numbers"),
    ("7,8,9,50,360.5,100,0.5", "lon is beyond 360 degrees (1 such rows in all)"),
    ("7,8,9,-5000.3,8,100,0.5", "lat is beyond 90 degrees"),
    ("7,8,9,,,100,", "the height has no lat and lon beside it (1 such rows in all); fill them in, or leave the height"),
    ("7,8,9,50,8,,", "height is empty where the other readings of the row are present"),
    ("7,8,9,50,8,100,0", "pos_std is not positive (1 such rows in all); leave it empty where it is not known"),
    ("7,8,9,50,8,100,-1", "pos_std is not positive"),
    ("7,8,9,50,8,100,inf", "pos_std is infinite"),
    ("7,8,9,,,,0.5", "pos_std has values, but lat, lon and height are empty on every row; fill in the positions"),
]
"""What stands in place of the good fix, and how the sentence goes on after the file and the line."""


def as_csv(put: Writer, text: str) -> Log:
    return read(put("a.csv", text))


def as_parquet(put: Writer, text: str) -> Log:
    path = put("b.csv", text)
    pq.write_table(pyarrow.csv.read_csv(path), path.with_name("a.parquet"))
    return read(path.with_name("a.parquet"))


def as_mapped(put: Writer, text: str) -> Log:
    # A mapped IMU table has IMU readings on every row.
    rows = [line for line in text.splitlines(keepends=True) if not line.startswith("0.7")]
    return read(put("a.csv", "".join(rows)), mapping=put("m.toml", MAPPING))


FORMATS = pytest.mark.parametrize("read_text", [as_csv, as_parquet, as_mapped])
Reading = Callable[[Writer, str], Log]


@FORMATS
def test_the_good_log_is_read(put: Writer, read_text: Reading) -> None:
    log = read_text(put, NAMES + GOOD)
    assert log.position_llh is not None
    assert log.position_std is not None
    assert log.wheel_speed is not None
    np.testing.assert_allclose(log.position_llh[0], [np.radians(50.0), np.radians(8.0), 100.0], rtol=1e-15)  # rounding
    assert log.position_std[0] == 0.5
    np.testing.assert_array_equal(log.wheel_speed[:2], [2.5, -2.5])


@FORMATS
@pytest.mark.parametrize(("fix", "sentence"), ROWS)
def test_a_file_with_an_impossible_fix_is_refused_by_its_line(
    put: Writer, read_text: Reading, fix: str, sentence: str
) -> None:
    with pytest.raises(LogError, match=rf"a\.(csv|parquet)(, (line 3|row 2))?: {re.escape(sentence)}"):
        read_text(put, NAMES + GOOD.replace(FIX, fix))


@pytest.mark.parametrize("read_text", [as_csv, as_parquet])
@pytest.mark.parametrize(
    ("names", "sentence"),
    [
        (
            "vel_n,vel_e,vel_d,height",
            "the column height stands without lat; a height alone is no position: add lat and",
        ),
        ("vel_n,vel_e,vel_d,pos_std", "the column pos_std stands without lat; add the positions that it is the deviat"),
    ],
)
def test_a_column_that_needs_positions_is_refused_without_them(
    put: Writer, read_text: Reading, names: str, sentence: str
) -> None:
    text = f"{IMU_NAMES},{names}\n0,1,2,3,4,5,6,7,8,9,100\n1,1,2,3,4,5,6,7,8,9,100\n"
    with pytest.raises(LogError, match=re.escape(sentence)):
        read_text(put, text)


def test_a_mapping_of_a_deviation_without_positions_is_refused(put: Writer) -> None:
    text = '[gnss]\ncolumns = { time = "t", vel_n = "n", vel_e = "e", vel_d = "d", pos_std = "s" }\n'
    with pytest.raises(UsageError, match="columns has pos_std without lat, lon and height; give the positions or leav"):
        load_mapping(put("m.toml", text))


@pytest.mark.parametrize(
    ("position", "sentence"),
    [
        ([50.0, 8.0, 100.0], "position_llh has a latitude beyond pi/2 rad (90 degrees) at row 3 (1 such rows in all);"),
        ([50.0, 8.0, 100.0], "pass radians, np.radians(degrees)."),
        ([0.7, 8.0, 100.0], "position_llh has a longitude beyond 2 pi rad (360 degrees) at row 3"),
        ([np.nan, np.nan, 100.0], "position_llh has a height without latitude and longitude at row 3"),
        ([0.7, np.nan, 100.0], "position_llh has part of a position at row 3"),
        ([0.7, -1.8, np.inf], "position_llh is infinite at row 3"),
    ],
)
def test_a_log_with_an_impossible_position_is_refused(drive: Log, position: list[float], sentence: str) -> None:
    assert drive.position_llh is not None
    llh = drive.position_llh.copy()
    llh[2] = position
    with pytest.raises(LogError, match=re.escape(sentence)):
        replace(drive, position_llh=llh)


@pytest.mark.parametrize("std", [0.0, -0.5, np.inf])
@pytest.mark.parametrize("shape", [(20,), (20, 3)])
def test_a_log_with_a_sigma_of_no_size_is_refused(drive: Log, std: float, shape: tuple[int, ...]) -> None:
    sigma: FloatArray = np.full(shape, 0.5)
    sigma[2] = std
    with pytest.raises(
        LogError, match=r"position_std is not positive and finite at row 3 \(1 such rows in all\); pass"
    ):
        replace(drive, position_std=sigma)
    sigma[2] = np.nan
    assert replace(drive, position_std=sigma).position_std is not None


def test_a_log_with_a_sigma_but_no_positions_is_refused(drive: Log) -> None:
    with pytest.raises(LogError, match="position_std is given without positions; pass position_llh too, or leave"):
        replace(drive, position_llh=None)


def test_the_poles_and_the_date_line_are_on_the_globe(put: Writer) -> None:
    for fix in ("7,8,9,90,180,0,1", "7,8,9,-90,-180,0,1", "7,8,9,0,360,0,1"):
        assert as_csv(put, NAMES + GOOD.replace(FIX, fix)).position_llh is not None


def test_a_place_beyond_the_globe_in_an_rtklib_solution_is_named_in_degrees(put: Writer) -> None:
    pos = "% GPST latitude(deg) longitude(deg) height(m) Q ns\n1970/01/01 00:00:00.500 95.0 8.0 100.0 1 21\n"
    with pytest.raises(
        LogError, match=r"b\.pos, line 2: the latitude is beyond 90 degrees \(1 such lines in all\); rep"
    ):
        read(put("a.csv", f"{IMU_NAMES}\n0,1,2,3,4,5,6\n1,1,2,3,4,5,6\n"), gnss=put("b.pos", pos))


@FORMATS
def test_a_wheel_speed_may_be_absent_or_empty_throughout(put: Writer, read_text: Reading) -> None:
    assert read_text(put, NAMES + GOOD.replace("6,2.5", "6,").replace("-2.5", "")).wheel_speed is None


@pytest.mark.parametrize("read_text", [as_csv, as_parquet])
def test_a_wheel_speed_without_an_imu_sample_is_refused(put: Writer, read_text: Reading) -> None:
    sentence = r"(line 4|row 3): wheel_speed stands on a row without IMU readings \(1 such rows in all\); give each"
    with pytest.raises(LogError, match=sentence):
        read_text(put, NAMES + GOOD.replace("0.7,,,,,,,,", "0.7,,,,,,,3,"))


@FORMATS
def test_an_infinite_wheel_speed_is_refused(put: Writer, read_text: Reading) -> None:
    with pytest.raises(LogError, match="wheel_speed is infinite"):
        read_text(put, NAMES + GOOD.replace("-2.5", "inf"))


def test_wheel_speeds_of_a_log_are_one_per_sample_and_finite_or_nan(drive: Log) -> None:
    speed = np.full(200, np.nan)
    speed[4] = -1.0
    log = replace(drive, wheel_speed=speed)
    assert log.wheel_speed is not None
    np.testing.assert_array_equal(log.wheel_speed, speed)
    with pytest.raises(LogError, match=r"wheel_speed has the shape \(20,\); pass an array of shape \(200\)"):
        replace(drive, wheel_speed=np.zeros(20))
    speed[5] = np.inf
    with pytest.raises(LogError, match="wheel_speed is infinite at row 6"):
        replace(drive, wheel_speed=speed)


def test_wheel_speed_belongs_to_the_imu_file_and_has_a_unit(put: Writer) -> None:
    imu = f"{IMU_NAMES},wheel_speed[km/h]\n0,1,2,3,4,5,6,36\n0.5,1,2,3,4,5,6,\n1,1,2,3,4,5,6,-18\n"
    gnss = "time,vel_n,vel_e,vel_d\n0.5,7,8,9\n"
    log = read(put("a.csv", imu), gnss=put("b.csv", gnss))
    assert log.wheel_speed is not None
    np.testing.assert_allclose(log.wheel_speed, [10.0, np.nan, -5.0], rtol=1e-15)  # one rounding
    lost = "time,vel_n,vel_e,vel_d,wheel_speed\n0.5,7,8,9,10\n"
    with pytest.raises(LogError, match=r"b\.csv: the column wheel_speed stands without gyro_x; .* into the IMU file"):
        read(put("a.csv", imu), gnss=put("b.csv", lost))


def test_a_mapping_gives_the_wheel_speed_its_column_and_unit(put: Writer) -> None:
    mapping = MAPPING.replace('wheel_speed = "wheel_speed"', 'wheel_speed = "odo"').replace(
        "[gnss]", 'units = { wheel_speed = "km/h" }\naxes = ["-x", "y", "-z"]\n[gnss]'
    )
    text = "".join(line for line in (NAMES + GOOD).splitlines(keepends=True) if not line.startswith("0.7"))
    log = read(put("a.csv", text.replace("wheel_speed", "odo")), mapping=put("m.toml", mapping))
    assert log.wheel_speed is not None
    # The axes of the IMU do not turn it: it is the vehicle's own. One rounding.
    np.testing.assert_allclose(log.wheel_speed[:2], [2.5 / 3.6, -2.5 / 3.6], rtol=1e-15)
