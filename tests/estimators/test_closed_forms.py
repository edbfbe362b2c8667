"""The papers' closed forms: what the estimators must read in steady motion without noise."""

from __future__ import annotations

import math

import numpy as np
import pytest

import levelhead as lh
from levelhead.conventions import GRAVITY

GYRO = np.radians([0.08, -0.13, 0.05])
ACCEL = np.array([0.11, -0.2, 0.0])


def steady(yaw_rate: float, duration: float = 600.0) -> lh.Log:
    """Level driving at 3 m/s and a constant yaw rate, constant biases, nothing else."""
    t = np.arange(0.0, duration, 0.01)
    heading = yaw_rate * t
    n = t.size
    gyro = np.tile([0.0, 0.0, yaw_rate], (n, 1)) + GYRO
    accel = np.tile([0.0, 3.0 * yaw_rate, -GRAVITY], (n, 1)) + ACCEL
    velocity = 3.0 * np.column_stack([np.cos(heading), np.sin(heading), np.zeros(n)])
    return lh.Log(time=t, gyro=gyro, accel=accel, gnss_time=t[::10], velocity_ned=velocity[::10])


@pytest.mark.parametrize("feedback", [True, False])
def test_eq_12_on_a_straight_the_control_rate_is_the_gyro_bias(feedback: bool) -> None:
    result = lh.estimate(steady(0.0), "two-stage", params=lh.TwoStageParams(feedback=feedback))
    # exp(-600/40) of the start is left: 3e-7 of 0.13 deg/s.
    np.testing.assert_allclose(result.gyro_bias[-1], GYRO, atol=np.radians(1e-5), rtol=0.0)


def test_on_a_straight_the_accelerometer_bias_turns_into_tilt() -> None:
    result = lh.estimate(steady(0.0), "observer")
    # Level reads f = -g + b: the platform settles where C f is vertical, roll = -b_y/g and pitch = b_x/g.
    # Until the vertical gyro bias is known, 0.05 deg/s reads as a turn and moves 0.0005 m/s^2, or 0.003 deg.
    assert math.degrees(result.roll[-1]) == pytest.approx(math.degrees(-ACCEL[1] / GRAVITY), abs=5e-3)
    assert math.degrees(result.pitch[-1]) == pytest.approx(math.degrees(ACCEL[0] / GRAVITY), abs=5e-3)


@pytest.mark.parametrize("feedback", [True, False])
@pytest.mark.parametrize("yaw_rate_deg_s", [-15.0, 10.0, 20.0])
def test_eq_14_in_a_turn_the_control_rate_gives_the_accelerometer_bias(feedback: bool, yaw_rate_deg_s: float) -> None:
    # The second stage presumes a known gyro bias; black box or feedback, the same answer.
    start = lh.Initial(gyro_bias=(float(GYRO[0]), float(GYRO[1]), float(GYRO[2])))
    log = steady(math.radians(yaw_rate_deg_s))
    result = lh.estimate(log, "two-stage", params=lh.TwoStageParams(feedback=feedback), initial=start)
    # The control rate acts one interval T = 0.1 s late: w_z T of its phase in a turn, which is 1 % of 0.2 m/s^2 with
    # feedback. A platform that runs open carries the gyro bias too, (g/w_z) b_g: twice g |b_g| T = 0.0026 m/s^2.
    np.testing.assert_allclose(result.accel_bias[-1, :2], ACCEL[:2], atol=2e-3 if feedback else 5.2e-3, rtol=0.0)


def test_eqs_11_and_12_learn_at_the_rates_of_the_constants() -> None:
    # On a straight the observer's gyro bias obeys tau s^2 + s + 1/tau_g = 0: critical at tau_g = 4 tau, two equal poles
    # at p = -1/(2 tau). Start-up levels the mean of one second, so it begins half a second of gyro bias off:
    # u_0 = 0.5 b/tau, and b(t) = (b_0 + (b_0/(2 tau) - u_0/tau_g) t) exp(-t/(2 tau)) is left.
    params = lh.ObserverParams(tau=4.0, tau_gyro=16.0)
    result = lh.estimate(steady(0.0, 60.0), params=params)
    start = int(np.flatnonzero(result.status & lh.Status.INITIALIZING)[-1]) + 1
    t = result.time[start:] - result.time[start]
    expected = GYRO[0] * (1.0 - (1.0 + (1.0 / 8.0 - 0.5 / 4.0 / 16.0) * t) * np.exp(-t / 8.0))
    # The sampled loop lags by an interval or two of 0.1 s times the steepest slope, 0.05/s of the bias.
    np.testing.assert_allclose(result.gyro_bias[start:, 0], expected, atol=GYRO[0] * 0.01, rtol=0.0)


def test_ringing_constants_are_called_out() -> None:
    result = lh.estimate(steady(0.0, 60.0), params=lh.ObserverParams(tau_gyro=12.0))
    assert "W_TAU_RATIO" in {event.code for event in result.events}
    assert "W_TAU_RATIO" not in {event.code for event in lh.estimate(steady(0.0, 60.0), "observer").events}
