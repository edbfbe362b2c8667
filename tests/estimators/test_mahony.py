"""The complementary filter: right where its assumptions hold, and wrong by as much as they are where they do not."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import levelhead as lh
from levelhead.conventions import GRAVITY, FloatArray
from levelhead.estimators.streaming import run
from levelhead.kernel._kernel import MahonyF32, MahonyF64

UNBIASED = lh.SensorModel(accel_bias=(0.0, 0.0, 0.0))
PLAIN = lh.MahonyParams(use_gnss_acceleration=False)


def tilt_rms(result: lh.Result, truth: lh.Truth, after: float = 300.0) -> FloatArray:
    """Roll and pitch errors (2,), deg RMS."""
    late = result.time - result.time[0] >= after
    error = np.degrees(np.column_stack([result.roll - truth.roll, result.pitch - truth.pitch]))[late]
    out: FloatArray = np.sqrt(np.mean(error**2, axis=0))
    return out


@pytest.mark.parametrize("scenario", ["field", "windrower"])
def test_turns_need_the_acceleration_from_gnss(scenario: str) -> None:
    # Without accelerometer biases, so that only the accelerations of the vehicle are left to disturb.
    log, truth = lh.simulate(scenario, seed=1, duration=900.0, sensors=UNBIASED)
    result, plain = lh.estimate(log, "mahony"), lh.estimate(log, "mahony", params=PLAIN)
    # Noise of 0.03 m/s in the velocity through a loop of 4 s: 0.03 / (4 sqrt(2) g), a few hundredths of a degree, and
    # the acceleration is that of the interval before, 0.1 s old on average.
    assert tilt_rms(result, truth).max() < 0.1
    # A turn at 3 m/s and 15 deg/s leans the apparent vertical by 4.6 deg, longer than tau.
    assert tilt_rms(plain, truth).max() > 0.7
    assert (tilt_rms(plain, truth) > 5.0 * tilt_rms(result, truth)).all()


def test_an_accelerometer_bias_stays_in_the_tilt() -> None:
    log, truth = lh.simulate("straight", seed=1, duration=600.0)
    result = lh.estimate(log, "mahony")
    late = log.time > 300.0
    # 0.2 m/s^2 to the right reads as a roll of -0.2 / g, 0.11 forward as a pitch of 0.11 / g; 0.02 deg is noise.
    roll, pitch = np.degrees([0.2 / GRAVITY, 0.11 / GRAVITY])
    assert float(np.mean(np.degrees(result.roll - truth.roll)[late])) == pytest.approx(-roll, abs=0.05)
    assert float(np.mean(np.degrees(result.pitch - truth.pitch)[late])) == pytest.approx(pitch, abs=0.05)
    # On a straight this does not disturb the gyro biases, of which the course teaches the vertical one: three sigma of
    # 0.004 deg/s.
    error = np.degrees(np.abs(result.gyro_bias - truth.gyro_bias)[-1])
    assert error.max() < 0.012
    assert result.known_gyro == (True, True, True)


def test_what_it_does_not_estimate_is_nan_and_what_turning_spoils_is_unknown() -> None:
    log, truth = lh.simulate("windrower", seed=1, duration=900.0)
    result = lh.estimate(log, "mahony")
    assert np.isnan(result.accel_bias).all()
    assert np.isnan(lh.Mahony().accel_bias).all()
    assert result.known_accel == (False, False, False)
    assert result.summary()["accel_bias_m_s2"] == [None, None, None]
    # Turning at w with an accelerometer bias b pulls the gyro biases by w b / g: 0.2 rad/s times 0.2 / g is 0.2 deg/s.
    spoilt = np.degrees(np.abs(result.gyro_bias - truth.gyro_bias)[log.time > 300.0, :2])
    assert spoilt.max() > 0.05
    assert result.known_gyro == (False, False, True)
    assert result.status[-1] & lh.Status.UNSEPARATED
    # Tilt is bounded all the same: 1.2 deg from the bias, and swings of the same size in the turns.
    assert tilt_rms(result, truth).max() < 2.0


def test_a_bias_known_from_elsewhere_may_be_given() -> None:
    log, truth = lh.simulate("windrower", seed=1, duration=600.0)
    result = lh.estimate(log, "mahony", initial=lh.Initial(accel_bias=(0.11, 0.2, 0.0)))
    assert tilt_rms(result, truth).max() < 0.1


def test_the_loop_has_the_poles_of_its_time_constants() -> None:
    # At rest with a gyro bias of 0.1 deg/s switched on after start-up: what is left of it follows
    # tau s^2 + s + 1/tau_gyro, in closed form.
    tau, tau_gyro, bias = 2.0, 20.0, math.radians(0.1)
    stream = lh.Mahony(lh.MahonyParams(tau=tau, tau_gyro=tau_gyro))
    root = math.sqrt(1.0 - 4.0 * tau / tau_gyro)
    fast, slow = -(1.0 + root) / (2.0 * tau), -(1.0 - root) / (2.0 * tau)
    for k in range(6001):
        t = 0.01 * k
        on = bias if t > 2.0 else 0.0
        stream.update_imu(t, (on, 0.0, 0.0), (0.0, 0.0, -GRAVITY))
        if k % 10 == 0:
            stream.update_gnss(t, (0.0, 0.0, 0.0))
        if t > 3.0 and k % 500 == 0:
            since = t - 2.005  # the trapezoid between the samples of 2.00 s and 2.01 s holds half of the step
            left = bias * (fast * math.exp(slow * since) - slow * math.exp(fast * since)) / (fast - slow)
            # The correction of a sample comes a sample late: 0.01 s of 2 s of what is left.
            assert bias - stream.gyro_bias[0] == pytest.approx(left, abs=0.005 * bias)


def test_a_stop_of_gnss_stops_the_corrections_but_not_those_of_the_plain_filter() -> None:
    for params, moves in ((lh.MahonyParams(), False), (PLAIN, True)):
        stream = lh.Mahony(params)
        for k in range(3000):
            t = 0.01 * k
            stream.update_imu(t, (0.001, 0.0, 0.0), (0.0, 0.0, -GRAVITY))
            if t < 10.0 and k % 10 == 0:
                stream.update_gnss(t, (0.0, 0.0, 0.0))
            if k == 1050:
                before = stream.gyro_bias[0]
        assert (stream.gyro_bias[0] != before) == moves


def test_nothing_is_learnt_across_a_gap() -> None:
    for params in (lh.MahonyParams(), PLAIN):
        stream = lh.Mahony(params)
        for k in range(1000):
            stream.update_imu(0.01 * k, (0.001, 0.0, 0.0), (0.0, 0.0, -GRAVITY))
            if k % 10 == 0:
                stream.update_gnss(0.01 * k, (0.0, 0.0, 0.0))
        before = stream.gyro_bias
        stream.update_imu(11.0, (0.001, 0.0, 0.0), (5.0, 0.0, -GRAVITY))
        np.testing.assert_array_equal(stream.gyro_bias, before)
        assert [event.code for event in stream.events] == ["W_GAP"]


def test_reverse_driving_is_recognised() -> None:
    log, truth = lh.simulate("reverse", seed=3, duration=600.0, sensors=UNBIASED)
    result = lh.estimate(log, "mahony")
    assert tilt_rms(result, truth).max() < 0.1
    assert {event.code for event in result.events} == {"S_REVERSE"}


def test_float_agrees_with_double() -> None:
    log, _ = lh.simulate("windrower", seed=1, duration=300.0)
    arguments: dict[str, Any] = lh.MahonyParams().as_dict()
    arguments |= {"gyro_bias": (0.0, 0.0, 0.0), "accel_bias": (0.0, 0.0, 0.0)}
    single, double = run(MahonyF32(**arguments), log), run(MahonyF64(**arguments), log)
    # As promised for the papers' estimators.
    assert np.degrees(np.abs(single.gyro_bias - double.gyro_bias)).max() < 1e-4
    difference = np.degrees((single.attitude - double.attitude + np.pi) % (2.0 * np.pi) - np.pi)
    assert np.nanmax(np.abs(difference)) < 0.005
