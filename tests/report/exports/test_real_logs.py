"""Recorded logs with the calibration that was at work: the parameters that an export needs are there, and add up."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import levelhead as lh
from levelhead.conventions import FloatArray
from levelhead.logs.readers import READERS
from levelhead.report.exports.parameters import read_parameters

from .conftest import ACCEL_BIAS, GYRO_BIAS, MakeCase


def exported(make_case: MakeCase, log: lh.Log, target: str, path: Path, **meta: object) -> dict[str, float]:
    """Export known biases as if they had been estimated from this log."""
    log = replace(log, meta={**log.meta, **meta})
    result, _ = make_case()

    def rows(values: FloatArray) -> FloatArray:
        return np.tile(values[-1], (log.time.size, 1))

    result = replace(
        result,
        time=log.time,
        gyro_bias=rows(result.gyro_bias),
        gyro_bias_std=rows(result.gyro_bias_std),
        accel_bias=rows(result.accel_bias),
        accel_bias_std=rows(result.accel_bias_std),
    )
    lh.export_calibration(result, log, target, path)
    return read_parameters(path)


def test_px4(make_case: MakeCase, data_folder: Path, tmp_path: Path) -> None:
    if "px4-ulog" not in READERS:
        pytest.skip("no reader for PX4's ULog")
    log = lh.read(data_folder / "formats" / "px4_small.ulg")
    new = exported(make_case, log, "px4", tmp_path / "a.params", latency_s=0.12)
    old = log.meta["calibration"]
    assert isinstance(old, dict)
    # The first of three IMUs, told by its ID; the board is turned by yaw 180, and levelled by a few degrees.
    assert (old["SENS_BOARD_ROT"], old["CAL_GYRO0_ID"]) == (4.0, 2424842.0)
    level = Rotation.from_euler("xyz", [old[f"SENS_BOARD_{a}_OFF"] for a in "XYZ"], degrees=True)
    to_body = level.as_matrix() @ np.diag([-1.0, -1.0, 1.0])
    for i, axis in enumerate("XYZ"):
        gyro = old[f"CAL_GYRO0_{axis}OFF"] + (to_body.T @ GYRO_BIAS)[i]
        accel = old[f"CAL_ACC0_{axis}OFF"] + (to_body.T @ ACCEL_BIAS)[i] / old[f"CAL_ACC0_{axis}SCALE"]
        assert new[f"CAL_GYRO0_{axis}OFF"] == pytest.approx(gyro, abs=6e-10)  # nine decimals
        assert new[f"CAL_ACC0_{axis}OFF"] == pytest.approx(accel, abs=6e-10)
    assert new["EKF2_GPS_DELAY"] == 120.0


def test_ardupilot(make_case: MakeCase, data_folder: Path, tmp_path: Path) -> None:
    if "ardupilot-bin" not in READERS:
        pytest.skip("no reader for ArduPilot's logs")
    log = lh.read(data_folder / "formats" / "ardupilot_test.BIN")
    new = exported(make_case, log, "ardupilot", tmp_path / "a.param", latency_s=0.12)
    old = log.meta["calibration"]
    assert isinstance(old, dict)
    assert old["AHRS_ORIENTATION"] == 8.0  # roll 180
    for i, (axis, sign) in enumerate(zip("XYZ", (1.0, -1.0, -1.0), strict=True)):
        gyro = old[f"INS_GYROFFS_{axis}"] + sign * GYRO_BIAS[i]
        accel = old[f"INS_ACCOFFS_{axis}"] + sign * ACCEL_BIAS[i] / old[f"INS_ACCSCAL_{axis}"]
        assert new[f"INS_GYROFFS_{axis}"] == pytest.approx(gyro, abs=6e-10)
        assert new[f"INS_ACCOFFS_{axis}"] == pytest.approx(accel, abs=6e-10)
    assert new["GPS_DELAY_MS"] == 120.0
    assert "read only in part" in (tmp_path / "a.param").read_text()  # the recording ends within a message
