"""The filters on recorded drives (not part of the repository): the figures demanded of them."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import levelhead as lh
from levelhead.analysis.estimation import constants_for
from levelhead.conventions import FloatArray
from levelhead.estimators.params import FilterParams

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
    late = log.time > 120.0
    # With the velocities alone, and with the positions besides: of fixes that the clocks make wrong the phasor filter
    # takes less, the Kalman filter all, which sets them further apart.
    for positions, limit in ((False, 0.03), (True, 0.04)):
        tilts = []
        for method in ("phasor", "ekf"):
            constants, _ = constants_for(log, method)
            assert isinstance(constants, FilterParams)
            result = lh.estimate(log, method, params=replace(constants, use_positions=positions))
            tilts.append(np.stack([result.roll, result.pitch]))
        apart = (tilts[0] - tilts[1])[:, late]
        assert np.degrees(np.sqrt(np.mean(apart**2, axis=1))).max() < limit
    for result in (lh.estimate(log, "phasor"), lh.estimate(log, "smoother")):
        assert np.degrees(np.abs(result.gyro_bias[-1] - rest)).max() < 0.02
        assert result.known_gyro == (True, True, True)
        # Consumer sensors on a rattling roof: the default noise would be a confident wrong answer.
        assert "I_NOISE_FOUND" in {event.code for event in result.events}
