"""Parameter files as QGroundControl, Mission Planner and MAVProxy write them, and what is none."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from levelhead.errors import UsageError
from levelhead.report.exports.parameters import MAX_BYTES, read_parameters

QGC = """# Onboard parameters for Vehicle 1
#
# Vehicle-Id Component-Id Name Value Type
1\t1\tCAL_ACC0_ID\t1310988\t6
1\t1\tCAL_ACC0_XOFF\t-0.123456789\t9
1\t1\tCAL_GYRO0_ROT\t-1\t6
1\t140\tCAL_ACC0_ID\t7\t6
"""
MISSION_PLANNER = "#NOTE: a\r\nINS_ACCOFFS_X,0.25\r\nINS_GYR_CAL,1 # startup\r\n\r\nAHRS_ORIENTATION,0\r\n"
MAVPROXY = "INS_ACCOFFS_X    0.250000\nINS_ACCOFFS_Y    1e-05\n"


def test_the_three_kinds_are_read(tmp_path: Path) -> None:
    def read(text: str) -> dict[str, float]:
        (tmp_path / "a").write_bytes(text.encode())
        return read_parameters(tmp_path / "a")

    assert read(QGC) == {"CAL_ACC0_ID": 1310988.0, "CAL_ACC0_XOFF": -0.123456789, "CAL_GYRO0_ROT": -1.0}
    assert read(MISSION_PLANNER) == {"INS_ACCOFFS_X": 0.25, "INS_GYR_CAL": 1.0, "AHRS_ORIENTATION": 0.0}
    assert read(MAVPROXY) == {"INS_ACCOFFS_X": 0.25, "INS_ACCOFFS_Y": 1e-5}
    assert read("\ufeffA,1\n") == {"A": 1.0}


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "holds no parameters"),
        ("# nothing\n", "holds no parameters"),
        ("A,1\nB,x\n", "line 2: 'B,x' is no parameter"),
        ("A,nan\n", "line 1: 'A,nan' is no parameter"),
        ("A,inf\n", "is no parameter"),
        ("A\n", "is no parameter"),
        ("not a parameter file at all\n", "is no parameter"),
        ("time,gyro_x\n0,1\n", "is no parameter"),
        ("A,1\nA,2\n", "line 2: A has two values"),
        ("A" * 17 + ",1\n", "is no parameter"),
        ("\x00\x01\x02", "is no parameter"),
    ],
)
def test_what_is_none_is_refused(tmp_path: Path, text: str, sentence: str) -> None:
    (tmp_path / "a.param").write_bytes(text.encode())
    with pytest.raises(UsageError, match=sentence):
        read_parameters(tmp_path / "a.param")


def test_a_file_that_is_not_there_or_too_long_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="does not exist"):
        read_parameters(tmp_path / "absent.params")
    with pytest.raises(UsageError, match="does not exist"):
        read_parameters(tmp_path)
    with (tmp_path / "long.params").open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    with pytest.raises(UsageError, match="no autopilot has so many"):
        read_parameters(tmp_path / "long.params")


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    content=st.binary(max_size=200)
    | st.text(alphabet="AB_1,.-e\t\n #\u00e9", max_size=80).map(str.encode)
    | st.builds(lambda cut, byte: QGC.encode()[:cut] + byte, st.integers(0, len(QGC)), st.binary(max_size=3))
)
def test_any_bytes_are_parameters_or_a_sentence(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a").write_bytes(content)
    try:
        values = read_parameters(tmp_path / "a")
    except UsageError:
        return
    assert values
    assert all(math.isfinite(value) for value in values.values())
