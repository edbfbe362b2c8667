"""Recorded drives (not part of the repository): the figures demanded of them."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import levelhead as lh

BENCHMARK = Path(__file__).parent.parent.parent / "benchmarks" / "real_drives.py"


@pytest.fixture(scope="module")
def drives() -> ModuleType:
    """The benchmark's way of reading the drives: what it prints is what is tested."""
    spec = importlib.util.spec_from_file_location("real_drives", BENCHMARK)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_rtklib_drive_gyro_agrees_with_rest(drives: ModuleType, data_folder: Path) -> None:
    log: lh.Log = drives.rtklib_drive(data_folder)
    rest = drives.at_rest_after(log)
    for method in ("observer", "two-stage"):
        result = lh.estimate(log, method)
        assert np.degrees(np.abs(result.gyro_bias[-1] - rest)[:2]).max() < 0.03, method
        assert result.known_gyro == (True, True, True)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_rtklib_drive_gives_added_biases_back(drives: ModuleType, data_folder: Path, sign: float) -> None:
    log: lh.Log = drives.rtklib_drive(data_folder)
    gyro, accel = sign * np.radians([0.2, 0.2, 0.0]), sign * np.array([0.3, 0.3, 0.0])
    plain, loaded = lh.estimate(log, "observer"), lh.estimate(drives.with_biases(log, gyro, accel), "observer")
    recovered = (loaded.gyro_bias - plain.gyro_bias)[-1, :2], (loaded.accel_bias - plain.accel_bias)[-1, :2]
    np.testing.assert_allclose(np.degrees(recovered[0]), np.degrees(gyro[:2]), atol=0.003, rtol=0.0)
    np.testing.assert_allclose(recovered[1], accel[:2], atol=0.01, rtol=0.0)


def test_kitti_drives_run_through(drives: ModuleType, data_folder: Path) -> None:
    paths = sorted((data_folder / "kitti").glob("*.parquet"))
    assert len(paths) == 3
    for path in paths:
        log, _ = drives.kitti_log(path)
        result = lh.estimate(drives.with_biases(log, drives.GYRO, drives.ACCEL), "observer")
        error = np.degrees(result.gyro_bias[-1] - drives.GYRO)
        # No figure is demanded; a wrong frame or sign would leave at least the smallest added bias, 0.05 deg/s.
        assert np.abs(error).max() < 0.05, path.name
        for axis in range(2):
            if result.known_accel[axis]:  # what is called known must be right within the settled band
                assert abs(result.accel_bias[-1, axis] - drives.ACCEL[axis]) < 0.04, path.name


@pytest.mark.parametrize("drive", ["first_test", "town"])
def test_neu_drives_have_positions_only(drives: ModuleType, data_folder: Path, drive: str) -> None:
    folder = data_folder / "neu-freecode"
    mapping = drives.EXAMPLES / "neu-freecode.toml"
    log = lh.read(folder / f"{drive}_imu.csv", gnss=folder / f"{drive}_gps.csv", mapping=mapping)
    result = lh.estimate(log, "observer")
    assert "I_VELOCITY_DERIVED" in {event.code for event in result.events}
    # 1 Hz positions on a 0.2 m grid: rough, and called so.
    assert "W_UNSTEADY" in {event.code for event in result.events}
    assert not all(result.known_accel[:2])
    assert np.isfinite(result.roll[result.time > 60.0]).all()


def test_units_and_axes_of_the_mapping_matter(drives: ModuleType, data_folder: Path) -> None:
    # Guards the tests above: the same drive with its mounting yaw left in place misses the gyro at rest.
    log: lh.Log = drives.rtklib_drive(data_folder)
    c, s = np.cos(np.radians(-10.7)), np.sin(np.radians(-10.7))
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    wrong = replace(log, gyro=log.gyro @ turn.T, accel=log.accel @ turn.T)
    rest = turn @ drives.at_rest_after(log)
    assert np.degrees(np.abs(lh.estimate(wrong, "observer").gyro_bias[-1] - rest)[:2]).max() > 0.05
