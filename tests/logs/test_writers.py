"""Written and read again, a log is the same log, to the bit."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from levelhead.errors import OutputError, UsageError
from levelhead.logs.log import Log
from levelhead.logs.readers import read
from levelhead.logs.writers import write, write_table

ARRAYS = ("time", "gyro", "accel", "gnss_time", "velocity_ned", "velocity_std", "position_std", "wheel_speed")
SUFFIXES = pytest.mark.parametrize("suffix", [".csv", ".parquet"])

finite = st.floats(allow_nan=False, allow_infinity=False, width=64)


@st.composite
def logs(draw: st.DrawFn) -> Log:
    """Any finite readings; stamps that advance by any representable step; GNSS within the IMU's span."""
    stamps = draw(st.lists(st.floats(-1e5, 1e5), min_size=2, max_size=8, unique=True).map(sorted))
    time = np.array(stamps)
    gnss_time = np.unique(draw(arrays(np.float64, st.integers(1, 4), elements=st.floats(time[0], time[-1]))))
    n, m = time.size, gnss_time.size
    with_velocity, with_position = draw(st.sampled_from([(True, True), (True, False), (False, True)]))
    angle = st.floats(-1.5, 1.5)
    speeds = arrays(np.float64, n, elements=st.one_of(finite, st.just(np.nan)))
    # Of a column without a single value nothing is left in a file.
    wheel_speed = draw(st.none() | speeds.filter(lambda speed: bool(np.isfinite(speed).any())))
    return Log(
        time=time,
        wheel_speed=wheel_speed,
        gyro=draw(arrays(np.float64, (n, 3), elements=finite)),
        accel=draw(arrays(np.float64, (n, 3), elements=finite)),
        gnss_time=gnss_time,
        velocity_ned=draw(arrays(np.float64, (m, 3), elements=finite)) if with_velocity else None,
        velocity_std=draw(arrays(np.float64, m, elements=st.floats(0.0, 1e3))) if with_velocity else None,
        position_llh=draw(arrays(np.float64, (m, 3), elements=angle)) if with_position else None,
    )


def assert_same(log: Log, back: Log) -> None:
    for name in ARRAYS:
        here, there = getattr(log, name), getattr(back, name)
        if here is None:
            assert there is None, name
        else:
            np.testing.assert_array_equal(there, here, err_msg=name)
    if log.position_llh is None:
        assert back.position_llh is None
    else:
        assert back.position_llh is not None
        # Radians to degrees and back are two roundings.
        np.testing.assert_array_max_ulp(back.position_llh[:, :2], log.position_llh[:, :2], maxulp=2)
        np.testing.assert_array_equal(back.position_llh[:, 2], log.position_llh[:, 2])


@SUFFIXES
def test_a_drive_survives_the_round_trip(drive: Log, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"drive{suffix}"
    write(drive, path)
    back = read(path)
    assert_same(drive, back)
    assert back.meta["source"] == path.name
    assert back.meta["completeness"] == "complete"
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@SUFFIXES
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(log=logs())
def test_any_log_survives_the_round_trip(log: Log, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"any{suffix}"
    write(log, path)
    assert_same(log, read(path))


def test_the_csv_is_plain_text_with_empty_cells_where_there_is_no_fix(tmp_path: Path) -> None:
    log = Log(
        time=np.array([0.0, 0.1]),
        gyro=np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]]),
        accel=np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]),
        gnss_time=np.array([0.05, 0.1]),
        velocity_ned=np.array([[7.0, 8.0, 9.0], [-7.0, -8.0, -9.0]]),
    )
    write(log, tmp_path / "a.csv")
    assert (tmp_path / "a.csv").read_text().splitlines() == [
        "time,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z,vel_n,vel_e,vel_d",
        "0,0.1,0.2,0.3,1,2,3,,,",
        "0.05,,,,,,,7,8,9",
        "0.1,0.4,0.5,0.6,4,5,6,-7,-8,-9",
    ]


def test_of_three_deviations_the_horizontal_ones_are_written(drive: Log, tmp_path: Path) -> None:
    write(replace(drive, velocity_std=np.tile([3.0, 1.0, 50.0], (20, 1))), tmp_path / "a.parquet")
    back = read(tmp_path / "a.parquet")
    assert back.velocity_std is not None
    np.testing.assert_allclose(back.velocity_std, np.sqrt(5.0), rtol=1e-15)  # one rounding


def test_parquet_keeps_the_units_and_the_epoch(drive: Log, tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    write(replace(drive, meta={"epoch": 1752003261.871}), path)
    assert pq.read_schema(path).field("gyro_x").metadata == {b"unit": b"rad/s"}
    assert pq.read_schema(path).field("lat").metadata == {b"unit": b"deg"}
    assert read(path).meta["epoch"] == 1752003261.871


def test_parquet_keeps_that_a_simulated_earth_stands_still(drive: Log, tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    write(replace(drive, meta={"earth_rotation": False}), path)
    assert read(path).meta["earth_rotation"] is False
    write(replace(drive, meta={}), path)
    assert "earth_rotation" not in read(path).meta


def test_absent_velocities_among_positions_stay_absent(drive: Log, tmp_path: Path) -> None:
    assert drive.velocity_ned is not None
    velocity = drive.velocity_ned.copy()
    velocity[3] = np.nan
    log = replace(drive, velocity_ned=velocity)
    for suffix in (".csv", ".parquet"):
        write(log, tmp_path / f"a{suffix}")
        assert_same(log, read(tmp_path / f"a{suffix}"))


@pytest.mark.parametrize("name", ["a.txt", "a", "a.csv.gz"])
def test_other_suffixes_are_refused(drive: Log, tmp_path: Path, name: str) -> None:
    with pytest.raises(UsageError, match=r"a log is written as \.csv, \.parquet or \.mcap"):
        write(drive, tmp_path / name)


@SUFFIXES
def test_a_folder_that_is_absent_is_an_output_error(drive: Log, tmp_path: Path, suffix: str) -> None:
    with pytest.raises(OutputError, match="could not be written: No such file or directory"):
        write(drive, tmp_path / "absent" / f"a{suffix}")


ON_A_FULL_DISK = """
import resource, sys
import levelhead as lh
log = lh.read(sys.argv[1])
# No file may grow beyond 4 kB, as on a full disk: the system refuses the write, and Python ignores the signal.
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
try:
    lh.write(log, sys.argv[1])
except lh.OutputError as error:
    print(error)
"""


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mcap"])
def test_a_disk_that_fills_up_leaves_the_old_log(drive: Log, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    write(drive, path)
    before = path.read_bytes()
    assert len(before) > 4096
    # In a process of its own: the limit would also hold for whatever file the tests' own output goes to.
    command = [sys.executable, "-c", ON_A_FULL_DISK, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert re.search("could not be written: .*File too large", done.stdout), done.stderr
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_a_table_has_its_units_and_types(tmp_path: Path) -> None:
    path = tmp_path / "result.parquet"
    write_table(
        {"time": np.array([0.0, 1.0]), "bias": np.array([np.nan, 2.0]), "status": np.array([1, 2], dtype=np.uint32)},
        {"time": "s", "bias": "rad/s"},
        path,
    )
    table = pq.read_table(path)
    assert table.schema.field("bias").metadata == {b"unit": b"rad/s"}
    assert table.schema.field("status").metadata is None
    assert str(table.schema.field("status").type) == "uint32"
    np.testing.assert_array_equal(table.column("bias").to_numpy(), [np.nan, 2.0])


def test_a_table_of_unequal_columns_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="one-dimensional and of one length"):
        write_table({"a": np.zeros(2), "b": np.zeros(3)}, {}, tmp_path / "a.parquet")
    with pytest.raises(UsageError, match="one-dimensional and of one length"):
        write_table({"a": np.zeros((2, 2))}, {}, tmp_path / "a.parquet")
    assert list(tmp_path.iterdir()) == []
