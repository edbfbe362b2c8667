"""What the driving cannot teach is reported as unknown, however small the control rate gets."""

from __future__ import annotations

import json

import numpy as np
import pytest

import levelhead as lh

METHODS = ("observer", "two-stage")


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("seed", range(5))
def test_a_straight_line_never_teaches_the_accelerometer(method: str, seed: int) -> None:
    log, _ = lh.simulate("straight", seed=seed, duration=1800.0)
    result = lh.estimate(log, method)
    assert result.known_gyro[:2] == (True, True)
    assert result.known_accel == (False, False, False)
    assert not (result.status & lh.Status.ACCEL_SETTLED).any()
    assert result.status[-1] & lh.Status.ACCEL_UNOBSERVABLE
    assert result.settled_at_s["accel"] is None
    assert result.summary()["accel_bias_m_s2"] == [None, None, None]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("seed", range(5))
def test_a_circle_never_separates_the_two(method: str, seed: int) -> None:
    # On a circle the control rate goes to zero while a combination of both biases stays: "settled" would be a lie.
    log, _ = lh.simulate("circle", seed=seed, duration=1800.0)
    result = lh.estimate(log, method)
    assert not (result.status & (lh.Status.ACCEL_SETTLED | lh.Status.GYRO_SETTLED)).any()
    assert result.known_accel == (False, False, False)
    assert result.known_gyro[:2] == (False, False)
    summary = result.summary()
    gyro = summary["gyro_bias_deg_s"]
    assert isinstance(gyro, list)
    assert gyro[:2] == [None, None]


def test_a_circle_is_called_unseparated() -> None:
    # The default biases of the simulation happen to lie across what a circle of 10 deg/s cannot see; these do not.
    sensors = lh.SensorModel(gyro_bias=(-0.0014, -0.0023, 0.0009), accel_bias=(0.11, 0.2, 0.0))
    log, truth = lh.simulate("circle", seed=1, duration=900.0, sensors=sensors)
    result = lh.estimate(log)
    assert result.status[-1] & lh.Status.UNSEPARATED
    # And rightly so: the estimates stand still, away from the truth by several sigma of the noise (0.004 m/s^2).
    error = np.abs(result.accel_bias[-1] - truth.accel_bias[-1])[:2].max()
    assert error > 0.02
    assert np.abs(result.accel_bias[-1] - result.accel_bias[-30000])[:2].max() < 0.5 * error


def test_standing_still_teaches_the_level_gyros_only() -> None:
    log, _ = lh.simulate("field", seed=1, duration=300.0, standstill_s=300.0)
    result = lh.estimate(log)
    assert result.known_gyro == (True, True, False)
    assert result.known_accel == (False, False, False)
    assert np.isnan(result.heading).all()
    assert result.status[-1] & lh.Status.ALIGNING


def test_the_vertical_accelerometer_is_never_claimed() -> None:
    log, _ = lh.simulate("field", seed=1, duration=900.0)
    result = lh.estimate(log)
    assert np.isnan(result.accel_bias[:, 2]).all()
    assert result.known_accel == (True, True, False)
    summary = result.summary()
    accel = summary["accel_bias_m_s2"]
    assert isinstance(accel, list)
    assert accel[2] is None
    json.dumps(summary, allow_nan=False)  # JSON has no NaN
