"""The filters on recorded drives (not part of the repository): the figures demanded of them."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import levelhead as lh
from levelhead.conventions import FloatArray

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


@pytest.mark.parametrize("drive", ["0018", "0028", "0033"])
@pytest.mark.parametrize(("method", "limit"), [("phasor", 0.12), ("smoother", 0.10)])
def test_kitti_roll_pitch_and_added_biases(
    drives: ModuleType, data_folder: Path, drive: str, method: str, limit: float
) -> None:
    log, reference = drives.kitti_log(data_folder / "kitti" / f"2011_09_30_drive_{drive}.parquet")
    params = lh.PhasorParams(latitude=drives.KARLSRUHE)
    result = lh.estimate(drives.with_biases(log, drives.GYRO, drives.ACCEL), method, params=params)
    late = log.time > 120.0
    tilt: FloatArray = np.column_stack([result.roll - reference["true_roll"], result.pitch - reference["true_pitch"]])[
        late
    ]
    # Against the INS after two minutes, its mean offset removed (the boxes are not aligned to a tenth of a degree).
    assert np.degrees(np.sqrt(np.mean(np.nanvar(tilt, axis=0)))) < limit
    gyro, accel = (result.gyro_bias[-1] - drives.GYRO), (result.accel_bias[-1] - drives.ACCEL)[:2]
    assert np.degrees(np.abs(gyro)).max() < 0.004
    assert np.abs(accel).max() < 0.01
    assert (np.abs(gyro) < 3.0 * result.gyro_bias_std[-1]).all()
    assert (np.abs(accel) < 3.0 * result.accel_bias_std[-1, :2]).all()


def test_rtklib_drive_filters_agree_and_end_at_rest(drives: ModuleType, data_folder: Path) -> None:
    log: lh.Log = drives.rtklib_drive(data_folder)
    rest = drives.at_rest_after(log)
    phasor, ekf = lh.estimate(log, "phasor"), lh.estimate(log, "ekf")
    late = log.time > 120.0
    for angle in ("roll", "pitch"):
        apart = (getattr(phasor, angle) - getattr(ekf, angle))[late]
        assert np.degrees(np.sqrt(np.mean(apart**2))) < 0.03
    for result in (phasor, lh.estimate(log, "smoother")):
        assert np.degrees(np.abs(result.gyro_bias[-1] - rest)).max() < 0.02
        assert result.known_gyro == (True, True, True)
        # Consumer sensors on a rattling roof: the default noise would be a confident wrong answer.
        assert "I_NOISE_FOUND" in {event.code for event in result.events}
