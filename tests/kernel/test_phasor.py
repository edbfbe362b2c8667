"""The phasor filter and smoother at their edges: start-up, standstill, restarts, odd epochs; how honest sigma is."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import levelhead as lh
from levelhead.conventions import FloatArray
from levelhead.estimators.phasor import Phasor, PhasorParams
from levelhead.logs.log import Log
from levelhead.sim import SensorModel, Truth, simulate

QUICK = SensorModel(imu_rate=50.0, gnss_rate=5.0)
# What the simulated accelerometers' noise adds up to at 50 Hz: their density and the white vibration.
ACCEL_NOISE = math.sqrt(QUICK.accel_noise**2 + 2.0 * QUICK.vibration**2 / QUICK.imu_rate)
PARAMS = PhasorParams(accel_noise=ACCEL_NOISE)


def errors(result: lh.Result, truth: Truth) -> FloatArray:
    """Roll, pitch, heading, gyro bias x y z, accelerometer bias x y."""
    heading = (result.heading - truth.heading + np.pi) % (2.0 * np.pi) - np.pi
    attitude = [result.roll - truth.roll, result.pitch - truth.pitch, heading]
    return np.column_stack(
        [*attitude, result.gyro_bias - truth.gyro_bias, (result.accel_bias - truth.accel_bias)[:, :2]]
    )


def sigmas(result: lh.Result) -> FloatArray:
    return np.column_stack([result.attitude_std, result.gyro_bias_std, result.accel_bias_std[:, :2]])


@pytest.mark.parametrize("scenario", ["field", "windrower"])
def test_the_smoother_is_as_good_as_it_says_from_the_first_second(scenario: str) -> None:
    rng, ratios = np.random.default_rng(0), []
    for seed in range(8):
        (gx, gy, gz), (ax, ay, az) = rng.normal(0.0, math.radians(0.15), 3), rng.normal(0.0, 0.2, 3)
        sensors = replace(QUICK, gyro_bias=(gx, gy, gz), accel_bias=(ax, ay, az))
        log, truth = simulate(scenario, seed=seed, duration=200.0, sensors=sensors)
        result = lh.estimate(log, "smoother", params=PARAMS)
        ratios.append((errors(result, truth) / sigmas(result))[log.time < 30.0] ** 2)
    mean = np.mean(ratios, axis=(0, 1))
    # Errors stay the same for most of the 30 s, so this is a mean of hardly more than eight squares; 99.9 % of such
    # means are below 3.3. A bias that is wrong by a twentieth of its start shows as a hundred.
    assert mean.max() < 3.3
    # The heading's sigma has room for the sideslip, which these drives do not have.
    assert mean.min() > 0.05


def test_an_epoch_that_falls_on_a_tick_still_knows_the_yaw_rate() -> None:
    # At 1 Hz the covariance has just moved by itself when the fix comes. In this circle the axle's 0.5 m of uncertainty
    # counts for 0.5 * 0.17 / 3 = 1.7 deg of course, three times the sideslip.
    sigma = {}
    for rate in (0.99, 1.0):
        log, _ = simulate("circle", seed=1, duration=60.0, sensors=replace(QUICK, gnss_rate=rate))
        sigma[rate] = lh.estimate(log, "phasor", params=PARAMS).attitude_std[-1, 2]
    assert sigma[1.0] == pytest.approx(sigma[0.99], rel=0.05)  # one in a hundred epochs more


def test_a_long_stand_teaches_nothing_about_the_vertical_gyro_and_costs_nothing() -> None:
    sensors = SensorModel(imu_rate=10.0, gnss_rate=1.0, gyro_bias=(0.0, 0.0, math.radians(0.45)))
    log, truth = simulate("straight", seed=1, duration=1840.0, standstill_s=1800.0, sensors=sensors)
    # Not told to look for standstill: then a heading that is not known must not seem to teach how it drifts.
    blind = replace(PARAMS, find_standstill=False)
    result = lh.estimate(log, "phasor", params=blind)
    first = int(np.flatnonzero(np.isfinite(result.heading))[0])
    prior = PARAMS.initial_gyro_bias_std
    assert result.gyro_bias_std[first - 1, 2] == pytest.approx(prior, rel=1e-3)
    assert result.gyro_bias_std[first, 2] > 0.99 * prior
    smooth = lh.estimate(log, "smoother", params=blind)
    off = errors(smooth, truth)[:, 2]
    sigma = smooth.attitude_std[:, 2]
    assert np.isfinite(off).all()
    # Half an hour before the first course the heading hangs on the gyro bias that the drive has taught.
    assert np.abs(off / sigma).max() < 4.0
    assert sigma[0] > sigma[first]


def test_what_is_not_known_has_no_small_sigma() -> None:
    log, _ = simulate("windrower", seed=1, duration=30.0, standstill_s=10.0, sensors=QUICK)
    result = lh.estimate(log, "phasor", params=PARAMS)
    for angle, sigma in zip((result.roll, result.pitch, result.heading), result.attitude_std.T, strict=True):
        unknown = np.isnan(angle)
        assert unknown.any()
        assert sigma[unknown].min() >= math.pi
        assert sigma[~unknown].max() < 0.5


def without(log: Log, start: float, stop: float) -> Log:
    """Return the log without the IMU samples and epochs of a span."""
    imu, gnss = ((t < start) | (t >= stop) for t in (log.time, log.gnss_time))
    assert log.velocity_ned is not None
    return replace(
        log,
        time=log.time[imu],
        gyro=log.gyro[imu],
        accel=log.accel[imu],
        gnss_time=log.gnss_time[gnss],
        velocity_ned=log.velocity_ned[gnss],
        velocity_std=None,
        position_llh=None,
        position_std=None,
    )


def test_a_piece_without_a_course_has_no_heading_and_takes_none_from_the_others() -> None:
    log, truth = simulate("windrower", seed=1, duration=90.0, sensors=QUICK)
    parts = without(log, 50.0, 55.0)
    assert parts.velocity_ned is not None
    blind = parts.velocity_ned.copy()
    blind[parts.gnss_time > 50.0] *= 0.01  # too slow for a course from here on
    result = lh.estimate(replace(parts, velocity_ned=blind), "smoother", params=PARAMS)
    before = parts.time < 50.0
    assert np.isfinite(result.heading[before]).all()
    assert np.isnan(result.heading[~before]).all()
    assert result.attitude_std[~before, 2].min() >= math.pi
    kept = (log.time < 50.0) | (log.time >= 55.0)
    assert np.degrees(np.abs(result.roll - truth.roll[kept])[before]).max() < 0.3


def feed(stream: Phasor, log: Log, shift: float = 0.0) -> None:
    assert log.velocity_ned is not None
    j = 0
    for i in range(log.time.size):
        stream.update_imu(log.time[i] + shift, log.gyro[i], log.accel[i])
        while j < log.gnss_time.size and log.gnss_time[j] <= log.time[i]:
            stream.update_gnss(log.gnss_time[j] + shift, log.velocity_ned[j], 0.03)
            j += 1


def test_biases_age_while_nobody_looks() -> None:
    log, _ = simulate("windrower", seed=1, duration=60.0, sensors=QUICK)
    stream = Phasor(PARAMS)
    feed(stream, log)
    before = stream.sigma
    stream.update_imu(36000.0 + float(log.time[-1]), log.gyro[0], log.accel[0])
    after = stream.sigma
    for walk, then, now in zip((PARAMS.gyro_bias_walk, PARAMS.accel_bias_walk), before[:2], after[:2], strict=True):
        # Ten hours of random walk on top; the shares of the heading change a little with the new attitude.
        np.testing.assert_allclose(now**2 - then**2, walk**2 * 36000.0, rtol=0.02)


@pytest.mark.parametrize("claimed", [0.0, 1e30, math.inf, math.nan, -1.0])
def test_no_claim_of_a_receiver_breaks_the_filter(claimed: float) -> None:
    log, _ = simulate("windrower", seed=1, duration=20.0, sensors=QUICK)
    std = np.full(log.gnss_time.size, 0.03)
    std[40:60:2] = claimed
    result = lh.estimate(replace(log, velocity_std=std), "phasor", params=PARAMS)
    assert np.isfinite(result.gyro_bias).all()
    assert np.isfinite(result.attitude_std).all()
    assert np.isfinite(result.roll[-1])


def test_levelling_in_a_turn_sees_the_biases_turn() -> None:
    # 40 deg/s for one second, an accelerometer bias of 0.4 m/s^2 and a receiver that is good to 5 mm/s: levelled on the
    # turning bias's mean, the tilt is 0.4/9.8 rad in a direction half the turn behind. Sigma has to know: without
    # it the filter is off by 0.35 rad * 0.4 m/s^2 = 0.14 m/s^2 of bias against tilt, thirty sigma.
    time = np.arange(0.0, 6.0, 0.01)
    rate, speed = math.radians(40.0), 5.0
    heading = rate * time
    gnss_time = np.arange(0.0, 5.9, 0.2)
    course = rate * gnss_time
    rng = np.random.default_rng(1)
    ratios = []
    for _ in range(6):
        bias = rng.normal(0.0, 0.3, 2)
        force = np.column_stack(
            [np.full_like(time, bias[0]), np.full_like(time, speed * rate + bias[1]), 0.0 * time - 9.80665]
        )
        gyro = np.column_stack([0.0 * time, 0.0 * time, np.full_like(time, rate)])
        velocity = speed * np.column_stack([np.cos(course), np.sin(course), 0.0 * course])
        velocity += rng.normal(0.0, 0.005, velocity.shape)
        log = Log(
            time=time,
            gyro=gyro + rng.normal(0.0, math.radians(0.01) * math.sqrt(50.0), gyro.shape),
            accel=force + rng.normal(0.0, 0.003 * math.sqrt(50.0), force.shape),
            gnss_time=gnss_time,
            velocity_ned=velocity,
            velocity_std=np.full(gnss_time.size, 0.005),
        )
        params = PhasorParams(
            accel_noise=0.003, axle_std=0.001, sideslip_std=1e-3, initial_gyro_bias_std=math.radians(0.05)
        )
        result = lh.estimate(log, "phasor", params=params)
        late = (time > 1.1) & (time < 5.0)
        off = np.column_stack(
            [result.roll, result.pitch, result.accel_bias[:, 0] - bias[0], result.accel_bias[:, 1] - bias[1]]
        )
        sigma = np.column_stack([result.attitude_std[:, :2], result.accel_bias_std[:, :2]])
        ratios.append((off / sigma)[late] ** 2)
        assert heading[-1] > 3.0
    # Six drives, two axes: a mean of a dozen independent squares or so is below 2.7 in 99.9 % of cases.
    assert np.mean(ratios, axis=(0, 1)).max() < 2.7
