"""What the driving cannot teach is reported as unknown, however small the control rate gets."""

from __future__ import annotations

import json

import numpy as np
import pytest

import levelhead as lh
from levelhead.conventions import GRAVITY

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
    result = lh.estimate(log, "observer")
    assert result.status[-1] & lh.Status.UNSEPARATED
    # And rightly so: the estimates stand still, away from the truth by several sigma of the noise (0.004 m/s^2).
    error = np.abs(result.accel_bias[-1] - truth.accel_bias[-1])[:2].max()
    assert error > 0.02
    assert np.abs(result.accel_bias[-1] - result.accel_bias[-30000])[:2].max() < 0.5 * error


def test_standing_still_teaches_the_level_gyros_only() -> None:
    log, _ = lh.simulate("field", seed=1, duration=300.0, standstill_s=300.0)
    result = lh.estimate(log, "observer")
    assert result.known_gyro == (True, True, False)
    assert result.known_accel == (False, False, False)
    assert np.isnan(result.heading).all()
    assert result.status[-1] & lh.Status.ALIGNING


def test_the_vertical_accelerometer_is_never_claimed() -> None:
    log, _ = lh.simulate("field", seed=1, duration=900.0)
    result = lh.estimate(log, "observer")
    assert np.isnan(result.accel_bias[:, 2]).all()
    assert result.known_accel == (True, True, False)
    summary = result.summary()
    accel = summary["accel_bias_m_s2"]
    assert isinstance(accel, list)
    assert accel[2] is None
    json.dumps(summary, allow_nan=False)  # JSON has no NaN


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("amplitude_deg_s", "period", "duration"), [(10.0, 1.0, 900.0), (10.0, 4.0, 900.0), (3.0, 2.0, 3600.0)]
)
def test_weaving_quicker_than_tau_is_no_turn(
    method: str, amplitude_deg_s: float, period: float, duration: float
) -> None:
    # A nervous driver on a straight road: the control rate lags by tau and hardly sees the accelerometer bias.
    t = np.arange(0.0, duration, 0.01)
    omega = 2.0 * np.pi / period
    rate = np.radians(amplitude_deg_s) * np.sin(omega * t)
    heading = np.radians(amplitude_deg_s) / omega * (1.0 - np.cos(omega * t))
    n = t.size
    gyro = np.column_stack([np.zeros(n), np.zeros(n), rate]) + np.radians([0.08, -0.13, 0.05])
    accel = np.column_stack([np.zeros(n), 3.0 * rate, np.full(n, -GRAVITY)]) + np.array([0.11, -0.2, 0.0])
    velocity = 3.0 * np.column_stack([np.cos(heading), np.sin(heading), np.zeros(n)])
    log = lh.Log(time=t, gyro=gyro, accel=accel, gnss_time=t[::10], velocity_ned=velocity[::10])
    result = lh.estimate(log, method)
    wrong = np.abs(result.accel_bias[-1, :2] - [0.11, -0.2]) > 0.04
    assert wrong.any()
    assert not (np.array(result.known_accel[:2]) & wrong).any()


@pytest.mark.parametrize("method", METHODS)
def test_a_log_that_begins_in_reverse_claims_nothing(method: str) -> None:
    log, _ = lh.simulate("reverse", seed=3, start=100.0, duration=900.0)
    result = lh.estimate(log, method)
    assert "W_MOSTLY_REVERSE" in {event.code for event in result.events}
    assert result.known_gyro == (False, False, False)
    assert result.known_accel == (False, False, False)
    assert result.settled_at_s == {"gyro": None, "accel": None}
    forwards, _ = lh.simulate("reverse", seed=3, duration=900.0)
    assert "W_MOSTLY_REVERSE" not in {event.code for event in lh.estimate(forwards, method).events}
