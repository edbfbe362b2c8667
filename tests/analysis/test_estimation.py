"""`estimate`: the front door of the library."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import levelhead as lh


@pytest.fixture(scope="module")
def log() -> lh.Log:
    """Five minutes of curves."""
    return lh.simulate("windrower", seed=8, duration=300.0)[0]


def test_an_unknown_method_lists_the_known_ones(log: lh.Log) -> None:
    with pytest.raises(lh.UsageError, match="'kalman'; choose one of observer, two-stage"):
        lh.estimate(log, "kalman")


def test_parameters_of_another_method_are_refused(log: lh.Log) -> None:
    with pytest.raises(lh.UsageError, match="takes ObserverParams, not TwoStageParams"):
        lh.estimate(log, "observer", params=lh.TwoStageParams())


@pytest.mark.parametrize("value", [0.0, -4.0, np.nan, np.inf, np.float32(-4.0), "4", True, None])
def test_constants_must_be_positive_numbers(value: Any) -> None:
    with pytest.raises(lh.UsageError, match=r"tau_gyro is .* it must be a positive number"):
        lh.ObserverParams(tau_gyro=value)
    with pytest.raises(lh.UsageError, match=r"turn_rate is .* it must be a positive number"):
        lh.TwoStageParams(turn_rate=value)


def test_thresholds_must_not_overlap() -> None:
    with pytest.raises(lh.UsageError, match="the thresholds must not overlap"):
        lh.TwoStageParams(straight_rate=0.2, turn_rate=0.1)


def test_gnss_from_another_day_is_refused(log: lh.Log) -> None:
    with pytest.raises(lh.LogError, match=r"Fewer than two GNSS velocities .* Check the time offset"):
        lh.estimate(replace(log, gnss_time=log.gnss_time + 86400.0))


def test_epochs_beyond_the_imu_are_left_out_and_counted(log: lh.Log) -> None:
    late = replace(log, time=log.time[2000:], gyro=log.gyro[2000:], accel=log.accel[2000:])
    result = lh.estimate(late)
    assert {e.code: e.count for e in result.events}["W_NO_EPOCHS"] == 200  # 20 s at 10 Hz
    assert np.isfinite(result.gyro_bias).all()


def test_positions_alone_will_do_and_the_result_says_so() -> None:
    # 2 cm positions at 10 Hz, differenced: 0.28 m/s of noise per epoch, ten times that of a Doppler velocity, but
    # correlated so that it averages out: the biases come within the bands that count as settled.
    log, truth = lh.simulate("windrower", seed=8, duration=900.0)
    result = lh.estimate(replace(log, velocity_ned=None, velocity_std=None), "observer")
    event = next(e for e in result.events if e.code == "I_VELOCITY_DERIVED")
    assert event.count == log.gnss_time.size - 1
    assert np.degrees(np.abs(result.gyro_bias - truth.gyro_bias)[-1, :2]).max() < 0.02
    assert np.abs(result.accel_bias - truth.accel_bias)[-1, :2].max() < 0.04


def test_the_lever_arm_is_taken_off() -> None:
    # faults.md: a lever arm of 3 m, given, costs less than 0.002 deg/s; not given, it costs more on this path.
    arm = (0.5, 0.0, -3.0)
    plain, _ = lh.simulate("windrower", seed=8, duration=900.0)
    far, _ = lh.simulate("windrower", seed=8, duration=900.0, sensors=lh.SensorModel(lever_arm=arm))
    late = plain.time > 600.0
    base = lh.estimate(plain).gyro_bias
    known = lh.estimate(far, lever_arm=arm)
    ignored = lh.estimate(far)

    def rms(gyro_bias: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
        return float(np.degrees(np.sqrt(np.mean((gyro_bias - base)[late, :2] ** 2))))

    assert rms(known.gyro_bias) < 0.002
    assert rms(ignored.gyro_bias) > 1.5 * rms(known.gyro_bias)
    assert known.params["lever_arm"] == arm


def test_progress_runs_to_the_end(log: lh.Log) -> None:
    seen: list[float] = []
    lh.estimate(log, progress=seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == 1.0


def test_the_log_is_left_alone(log: lh.Log) -> None:
    before = log.gyro.copy()
    result = lh.estimate(log)
    np.testing.assert_array_equal(log.gyro, before)
    assert not log.gyro.flags.writeable
    corrected = log.corrected(result)
    np.testing.assert_allclose(corrected.gyro, log.gyro - result.gyro_bias, rtol=0.0, atol=1e-15)


def test_infinite_velocities_are_left_out_and_counted(log: lh.Log) -> None:
    assert log.velocity_ned is not None
    velocity = log.velocity_ned.copy()
    velocity[[100, 200], 1] = np.inf
    velocity[300] = np.nan  # absent, not wrong
    result = lh.estimate(replace(log, velocity_ned=velocity), "observer")
    assert {e.code: e.count for e in result.events if e.code != "I_NOISE_FOUND"} == {"E_NONFINITE": 2}
    assert np.isfinite(result.gyro_bias).all()
