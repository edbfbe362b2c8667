"""The mapping file: every mistake in it is a sentence, and what it says of axes and mounting is so."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from levelhead.errors import UsageError
from levelhead.logs.mapping import ImuMapping, load_mapping, rotation_321

Writer = Callable[[str, str], Path]

COLUMNS = (
    'columns = { time = "t", gyro_x = "gx", gyro_y = "gy", gyro_z = "gz", accel_x = "ax", accel_y = "ay", '
    'accel_z = "az" }\n'
)
ECEF = 'columns = { time = "t", ecef_x = "x", ecef_y = "y", ecef_z = "z" }'
NUMBERS = "columns = { time = 7, accel_x = 1, accel_y = 2, accel_z = 3, gyro_x = 4, gyro_y = 5, gyro_z = 6 }\n"


def imu_of(put: Writer, text: str) -> ImuMapping:
    mapping = load_mapping(put("m.toml", "[imu]\n" + COLUMNS + text))
    assert mapping.imu is not None
    return mapping.imu


def test_what_is_left_out_has_a_plain_default(put: Writer) -> None:
    imu = imu_of(put, "")
    assert imu.table.header is True
    assert imu.table.delimiter == ","
    assert imu.table.time_offset_s == 0.0
    assert imu.time_zero_s is None
    assert set(imu.table.factors.values()) == {1.0}
    np.testing.assert_array_equal(imu.dcm_file_to_body, np.eye(3))


def test_units_are_those_of_the_group_unless_the_column_has_its_own(put: Writer) -> None:
    factors = imu_of(put, 'units = { time = "ms", gyro = "deg/s", accel = "g", accel_z = "mg" }').table.factors
    assert factors["time"] == 1e-3
    assert factors["gyro_x"] == np.pi / 180.0
    assert factors["accel_x"] == 9.80665
    assert factors["accel_z"] == 9.80665e-3


def test_axes_pick_and_turn_the_columns(put: Writer) -> None:
    # Back, right, up: what the file calls x is backwards.
    dcm = imu_of(put, 'axes = ["-x", "y", "-z"]').dcm_file_to_body
    np.testing.assert_array_equal(dcm @ [1.0, 2.0, 3.0], [-1.0, 2.0, -3.0])
    # Right, forward, up (a common board): forward is the file's y.
    dcm = imu_of(put, 'axes = ["+y", "x", "-z"]').dcm_file_to_body
    np.testing.assert_array_equal(dcm @ [1.0, 2.0, 3.0], [2.0, 1.0, -3.0])


def test_a_positive_mounting_yaw_is_an_imu_that_points_to_the_right(put: Writer) -> None:
    dcm = imu_of(put, "mounting_deg = { yaw = 30.0 }").dcm_file_to_body
    # The IMU's own forward axis, seen in the vehicle: 30 degrees from forward towards the right. Rounding only.
    np.testing.assert_allclose(dcm @ [1.0, 0.0, 0.0], [np.cos(np.pi / 6), 0.5, 0.0], atol=1e-15)


def test_a_positive_mounting_pitch_is_an_imu_with_its_nose_up(put: Writer) -> None:
    dcm = imu_of(put, "mounting_deg = { pitch = 30.0 }").dcm_file_to_body
    np.testing.assert_allclose(dcm @ [1.0, 0.0, 0.0], [np.cos(np.pi / 6), 0.0, -0.5], atol=1e-15)


def test_a_positive_mounting_roll_is_an_imu_with_its_right_side_down(put: Writer) -> None:
    dcm = imu_of(put, "mounting_deg = { roll = 30.0 }").dcm_file_to_body
    np.testing.assert_allclose(dcm @ [0.0, 1.0, 0.0], [0.0, np.cos(np.pi / 6), 0.5], atol=1e-15)


def test_the_axes_come_before_the_mounting_and_yaw_pitch_roll_multiply_in_that_order(put: Writer) -> None:
    imu = imu_of(put, 'axes = ["-x", "y", "-z"]\nmounting_deg = { yaw = 10, pitch = 20.0, roll = 30.0 }')
    yaw, pitch, roll = (
        rotation_321(roll=0.0, pitch=0.0, yaw=np.radians(10.0)),
        rotation_321(roll=0.0, pitch=np.radians(20.0), yaw=0.0),
        rotation_321(roll=np.radians(30.0), pitch=0.0, yaw=0.0),
    )
    expected = yaw @ pitch @ roll @ np.diag([-1.0, 1.0, -1.0])
    np.testing.assert_allclose(imu.dcm_file_to_body, expected, atol=1e-15)  # rounding


@pytest.mark.parametrize("value", ['"2025-07-08T19:30:00.090"', "2025-07-08T19:30:00.090"])
def test_time_zero_is_text_or_a_toml_instant(put: Writer, value: str) -> None:
    # 1752003000 s from 1970: 2025-07-08 19:30:00 (20277 days of 86400 s and 70200 s).
    assert imu_of(put, f"time_zero = {value}").time_zero_s == 20277 * 86400 + 70200 + 0.09


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[imu\n", "The mapping m.toml is not TOML"),
        ("", "m.toml is empty; it needs a section [imu]"),
        ("[IMU]\n" + COLUMNS, "m.toml: the key 'IMU' is not known; the keys are imu, gnss."),
        ("imu = 3", "The mapping m.toml has imu = 3; write a section [imu]."),
        ("[imu]\n" + COLUMNS + "axis = []", "m.toml, [imu]: the key 'axis' is not known; the keys are header"),
        ("[imu]\nheader = true", "columns is missing; write columns = { time = ..., ... }"),
        ('[imu]\ncolumns = { time = "t" }', "columns lacks gyro_x, gyro_y, gyro_z, accel_x, accel_y, accel_z."),
        ('[imu]\ncolumns = { tim = "t" }', "[imu], columns: the key 'tim' is not known; the keys are time, gyro_x"),
        ("[imu]\n" + NUMBERS, "the column time is 7; write a name of the header line, or header = false."),
        ("[imu]\nheader = false\n" + COLUMNS, "the column time is 't'; without a header write a number from 1 on."),
        ("[imu]\nheader = false\n" + NUMBERS.replace("7", "0"), "the column time is 0; without a header"),
        ("[imu]\nheader = false\n" + NUMBERS.replace("7", "true"), "the column time is True; without a header"),
        ("[imu]\n" + COLUMNS.replace('"gy"', '"gx"'), "the column 'gx' of the file is used twice"),
        ("[imu]\nheader = 1\n" + COLUMNS, "header is 1; write true or false."),
        ('[imu]\ndelimiter = ";;"\n' + COLUMNS, "delimiter is ';;'; write one character"),
        ('[imu]\nunits = "g"\n' + COLUMNS, "units is 'g'; write units = {"),
        ('[imu]\nunits = { gyros = "deg/s" }\n' + COLUMNS, "[imu], units: the key 'gyros' is not known"),
        (
            '[imu]\nunits = { gyro = "dps" }\n' + COLUMNS,
            "the unit 'dps' of gyro_x is not known; use one of rad/s, mrad",
        ),
        ("[imu]\nunits = { gyro = 1 }\n" + COLUMNS, "the unit 1 of gyro_x is not known"),
        ('[imu]\naxes = ["x", "y"]\n' + COLUMNS, "axes is ['x', 'y']; write three axes such as"),
        ('[imu]\naxes = "xyz"\n' + COLUMNS, "axes is 'xyz'; write three axes such as"),
        ('[imu]\naxes = ["x", "y", "up"]\n' + COLUMNS, "axes has 'up'; write x, y or z with an optional sign"),
        ('[imu]\naxes = ["x", "y", "--z"]\n' + COLUMNS, "axes has '--z'; write x, y or z"),
        ('[imu]\naxes = ["x", "y", 3]\n' + COLUMNS, "axes has 3; write x, y or z"),
        ('[imu]\naxes = ["x", "-x", "z"]\n' + COLUMNS, "uses an axis twice; use each of x, y and z once."),
        ('[imu]\naxes = ["-x", "y", "z"]\n' + COLUMNS, "a mirror image: no sensor can be turned so."),
        ('[imu]\naxes = ["y", "x", "z"]\n' + COLUMNS, "a mirror image: no sensor can be turned so."),
        ("[imu]\nmounting_deg = 5.0\n" + COLUMNS, "mounting_deg is 5.0; write mounting_deg = { yaw = 0.0, ... }."),
        ("[imu]\nmounting_deg = { heading = 1 }\n" + COLUMNS, "mounting_deg: the key 'heading' is not known"),
        ('[imu]\nmounting_deg = { yaw = "5" }\n' + COLUMNS, "mounting_deg.yaw is '5'; write a number."),
        ("[imu]\ntime_offset_s = nan\n" + COLUMNS, "time_offset_s is nan; write a number."),
        ("[imu]\ntime_offset_s = true\n" + COLUMNS, "time_offset_s is True; write a number."),
        ('[imu]\ntime_zero = "noon"\n' + COLUMNS, "time_zero is 'noon'; write an instant without time zone"),
        ("[imu]\ntime_zero = 2025-07-08T19:30:00Z\n" + COLUMNS, "write an instant without time zone"),
        ("[imu]\ntime_zero = 2025-07-08\n" + COLUMNS, "write an instant without time zone"),
        ('[gnss]\ncolumns = { lat = "a", lon = "b", height = "c" }', "[gnss]: columns lacks time."),
        (
            '[gnss]\ncolumns = { time = "t", lat = "a", lon = "b" }',
            "columns must have vel_n, vel_e and vel_d (or vel_u)",
        ),
        (
            '[gnss]\ncolumns = { time = "t", vel_n = "n", lat = "a", lon = "b", height = "c" }',
            "columns must have vel_n, vel_e and vel_d",
        ),
        (
            '[gnss]\ncolumns = { time = "t", vel_n = "n", vel_e = "e", vel_d = "d", vel_u = "u" }',
            "columns has both vel_d and vel_u; give one of them.",
        ),
        (
            '[gnss]\ncolumns = { time = "t", vel_n = "n", vel_e = "e", vel_d = "d", lat = "a" }',
            "columns has some of lat, lon and height; give all three or none.",
        ),
        ('[gnss]\naxes = ["x", "y", "z"]\ncolumns = { time = "t" }', "[gnss]: the key 'axes' is not known"),
        ("[imu]\nvariable = 3\n" + COLUMNS, "variable is 3; write a variable of a MATLAB file"),
        ('[imu]\nvariable = "a b"\n' + COLUMNS, "variable is 'a b'; write a variable of a MATLAB file"),
        ('[imu]\nvariable = "IMU"\nheader = false\n' + NUMBERS, "variable is for a MATLAB file, header for a CSV"),
        ('[imu]\nvariable = "IMU"\n' + NUMBERS.replace("7", "0"), "column time is 0; write a number from 1 on, or a"),
        ('[gnss]\ncolumns = { time = "t", ecef_x = "x", ecef_y = "y" }', "some of ecef_x, ecef_y, ecef_z; give all"),
        ("[gnss]\n" + ECEF.replace(" }", ', lat = "a", lon = "b", height = "c" }'), "columns has positions as ecef_x"),
        (
            "[gnss]\n" + ECEF.replace(" }", ', vel_n = "n", vel_ecef_x = "a", vel_ecef_y = "b", vel_ecef_z = "c" }'),
            "columns has velocities as vel_ecef_x, ... and as vel_n, ...; give one of them.",
        ),
        (
            '[gnss]\ncolumns = { time = "t", vel_ecef_x = "a", vel_ecef_y = "b", vel_ecef_z = "c" }',
            "vel_ecef_x, vel_ecef_y and vel_ecef_z need a position.",
        ),
    ],
)
def test_a_mistake_is_named(put: Writer, text: str, sentence: str) -> None:
    with pytest.raises(UsageError, match=re.escape(sentence)):
        load_mapping(put("m.toml", text))


def test_a_mapping_that_is_absent_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"absent\.toml cannot be read: No such file or directory\."):
        load_mapping(tmp_path / "absent.toml")
