"""The Kalman filter's arithmetic: against a NumPy filter from the textbook, in float, over hours, gaps and outages."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from levelhead.conventions import GRAVITY, FloatArray
from levelhead.estimators.base import Status
from levelhead.estimators.ekf import Ekf, EkfParams
from levelhead.estimators.params import Initial
from levelhead.estimators.streaming import run
from levelhead.kernel._kernel import EkfF32, EkfF64
from levelhead.kernel.reference import euler_of, heading_of, nearest_rotation, rotation, skew, wrapped
from levelhead.logs.log import Log
from levelhead.sim import SensorModel, Truth, simulate

from .conftest import irregular

LATITUDE = math.radians(50.0)
ORIGIN = (LATITUDE, 0.1, 100.0)
POSITION, VELOCITY, ATTITUDE, GYRO, ACCEL = (slice(i, i + 3) for i in range(0, 15, 3))
TRUE_NOISE = EkfParams(accel_noise=math.hypot(150e-6 * GRAVITY, 0.1 / math.sqrt(50.0)), velocity_std=0.03)


@dataclass
class Twin:
    """The same filter from the textbook: matrix exponential, Simpson's rule, all measurements of an epoch at once."""

    params: EkfParams
    velocity: FloatArray
    dcm: FloatArray
    gyro_bias: FloatArray
    accel_bias: FloatArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        self.frame()

    def frame(self) -> None:
        """Take the rates of the NED frame at this velocity."""
        lat, radius = LATITUDE, 6.371e6
        north, east, _ = self.velocity / radius
        earth = 7.292115e-5 * np.array([math.cos(lat), 0.0, -math.sin(lat)])
        transport = np.array([east, -north, -east * math.tan(lat)])
        self.turn, self.coriolis = earth + transport, 2.0 * earth + transport
        self.coriolis_force = -np.cross(self.coriolis, self.velocity)

    def step(self, dt: float, gyro: FloatArray, accel: FloatArray) -> None:
        """Strapdown and covariance over one sample."""
        k, self.rate, f = self.params, gyro - self.gyro_bias, accel - self.accel_bias
        half = rotation(-self.turn * dt / 2) @ self.dcm @ rotation(self.rate * dt / 2)
        after = rotation(-self.turn * dt / 2) @ half @ rotation(self.rate * dt / 2)
        force = (self.dcm + 4.0 * half + after) @ f / 6.0
        a = np.zeros((15, 15))
        a[POSITION, VELOCITY] = np.eye(3)
        a[VELOCITY, VELOCITY] = -skew(self.coriolis)
        a[VELOCITY, ATTITUDE] = -skew(force)
        a[VELOCITY, ACCEL] = a[ATTITUDE, GYRO] = -half
        a[ATTITUDE, ATTITUDE] = -skew(self.turn)
        transition = np.eye(15) + a * dt + a @ a * dt**2 / 2 + a @ a @ a * dt**3 / 6
        noise = [0.0, k.accel_noise / math.sqrt(2), k.gyro_noise / math.sqrt(2), k.gyro_bias_walk, k.accel_bias_walk]
        self.covariance = transition @ self.covariance @ transition.T + np.diag(np.repeat(np.square(noise), 3) * dt)
        self.velocity = self.velocity + (force + np.array([0.0, 0.0, k.gravity]) + self.coriolis_force) * dt
        self.dcm = nearest_rotation(after)

    def epoch(self, velocity: FloatArray, std: float) -> None:
        """Velocity of the antenna, three components at once, then the course."""
        arm = np.array(self.params.lever_arm)
        swing = self.dcm @ np.cross(self.rate, arm)
        h = np.zeros((3, 15))
        h[:, VELOCITY] = np.eye(3)
        h[:, ATTITUDE] = -skew(swing)
        h[:, GYRO] = self.dcm @ skew(arm)
        at_imu = velocity - swing
        self.update(h, self.velocity - at_imu, np.eye(3) * std**2)
        speed = float(np.hypot(at_imu[0], at_imu[1]))
        # d heading / d theta by differences: no formula to share with the header.
        heading, small = heading_of(self.dcm), 1e-6
        rows = [wrapped(heading_of(rotation(small * axis) @ self.dcm) - heading) / small for axis in np.eye(3)]
        h = np.zeros((1, 15))
        h[0, ATTITUDE] = rows
        off = wrapped(heading - math.atan2(at_imu[1], at_imu[0]))
        self.update(h, np.array([off]), np.array([[(std / speed) ** 2]]))
        self.frame()

    def update(self, h: FloatArray, z: FloatArray, noise: FloatArray) -> None:
        """One measurement z = h @ error + noise, fed back at once."""
        gain = self.covariance @ h.T @ np.linalg.inv(h @ self.covariance @ h.T + noise)
        error = gain @ z
        self.covariance = (np.eye(15) - gain @ h) @ self.covariance
        self.velocity = self.velocity - error[VELOCITY]
        self.dcm = rotation(-error[ATTITUDE]) @ self.dcm
        self.gyro_bias = self.gyro_bias - error[GYRO]
        self.accel_bias = self.accel_bias - error[ACCEL]


def test_a_numpy_filter_from_the_textbook_agrees() -> None:
    arm = (0.3, -0.2, -1.5)
    sensors = SensorModel(lever_arm=arm)
    log, _ = simulate("windrower", seed=4, duration=62.0, sensors=sensors, earth_rotation=True, origin_llh=ORIGIN)
    params = replace(TRUE_NOISE, latitude=LATITUDE, lever_arm=arm)
    assert log.velocity_ned is not None
    ours = Ekf(params)
    theirs: Twin | None = None
    for i in range(log.time.size):
        ours.update_imu(log.time[i], log.gyro[i], log.accel[i])
        if theirs is not None:
            dt = float(log.time[i] - log.time[i - 1])
            theirs.step(dt, (log.gyro[i] + log.gyro[i - 1]) / 2, (log.accel[i] + log.accel[i - 1]) / 2)
        if i % 10 == 0:
            fix = log.velocity_ned[i // 10]
            ours.update_gnss(log.time[i], fix, 0.03)
            if theirs is not None:
                theirs.epoch(fix, 0.03)
            elif i >= 200:  # start-up is over: the twin goes on from here
                state = (ours.velocity_ned, ours.dcm_body_to_ned, ours.gyro_bias, ours.accel_bias, ours.covariance)
                theirs = Twin(params, *(np.array(part) for part in state))
    assert theirs is not None
    # The same equations, integrated differently: the twins differ in how the velocity grows within a step, by 0.01 s
    # times what the attitude turns in it, which the velocity updates keep from adding up. A thousandth of sigma is
    # seven times what is left, and far below what any test of accuracy sees.
    sigma_gyro, sigma_accel, sigma_attitude = ours.sigma
    assert (np.abs(ours.gyro_bias - theirs.gyro_bias) / sigma_gyro).max() < 1e-3
    assert (np.abs(ours.accel_bias - theirs.accel_bias) / sigma_accel).max() < 1e-3
    turned = ours.dcm_body_to_ned @ theirs.dcm.T
    assert np.abs(turned - np.eye(3)).max() / sigma_attitude.min() < 1e-3
    np.testing.assert_allclose(ours.velocity_ned, theirs.velocity, atol=1e-5)
    scale = np.sqrt(np.diag(theirs.covariance))
    # Second-order terms of the transition that the header leaves out: 0.01 s squared out of ten seconds squared.
    difference = (ours.covariance - theirs.covariance) / np.outer(scale, scale)
    assert np.abs(difference[3:, 3:]).max() < 1e-5


@pytest.mark.parametrize("accel_std", [0.1, 0.01])
def test_start_up_knows_how_wrong_it_is(accel_std: float) -> None:
    # A second of driving with biases drawn from the prior, many times: right after levelling the errors of velocity,
    # tilt, heading and biases, weighed with the inverse of the filter's own covariance, must add up to their number.
    # Without the tie between tilt and accelerometer bias they would add up to hundreds; where that bias is known, the
    # ties to the gyro bias and to the velocity count. (From 0.3 m/s^2 on the squares of such tilts show as well.)
    rng = np.random.default_rng(1)
    params = replace(TRUE_NOISE, latitude=LATITUDE, initial_accel_bias_std=accel_std)
    total, together = [], []
    for seed in range(150):
        gyro = tuple(rng.normal(0.0, params.initial_gyro_bias_std, 3))
        accel = tuple(rng.normal(0.0, params.initial_accel_bias_std, 3))
        log, truth = simulate(
            "windrower",
            seed=seed,
            duration=1.01,
            sensors=SensorModel(gyro_bias=gyro, accel_bias=accel),
            earth_rotation=True,
            origin_llh=ORIGIN,
        )
        stream = Ekf(params)
        run(stream, log)
        assert not stream.status & (Status.INITIALIZING | Status.ALIGNING)
        error = errors(stream, truth)
        p = stream.covariance[3:, 3:]
        total.append(float(error @ np.linalg.solve(p, error)))
        # Tilt about North with velocity to the East, and crosswise: the noise of one fix is in both.
        for tilt, speed, sign in ((3, 1, 1.0), (4, 0, -1.0)):
            unforeseen = sign * (error[tilt] * error[speed] - p[tilt, speed])
            together.append(unforeseen / math.sqrt(p[tilt, tilt] * p[speed, speed]))
    # Twelve degrees of freedom, 150 runs: the mean is 12 with a sigma of sqrt(2 * 12 / 150) = 0.4; three of them.
    assert abs(np.mean(total) - 12.0) < 1.2
    # A correlation from 300 pairs has a sigma of 0.06; three of them. It is 0.5 where the accelerometers are known.
    assert abs(np.mean(together)) < 0.18


def test_the_first_course_turns_what_is_known() -> None:
    # From a standstill into any direction: the tilt errors, and their ties to the biases, were known in a frame whose
    # "North" was where the vehicle pointed. Meanwhile the vehicle speeds up unseen, which must not pass for tilt.
    rng = np.random.default_rng(2)
    params = replace(TRUE_NOISE, latitude=LATITUDE, initial_accel_bias_std=0.1, initial_gyro_bias_std=0.002)
    total = []
    for seed in range(100):
        gyro, accel = tuple(rng.normal(0.0, 0.002, 3)), tuple(rng.normal(0.0, 0.1, 3))
        log, truth = simulate(
            "field",
            seed=seed,
            duration=9.0,
            standstill_s=3.0,
            sensors=SensorModel(gyro_bias=gyro, accel_bias=accel),
            earth_rotation=True,
            origin_llh=ORIGIN,
        )
        stream = Ekf(params)
        run(stream, log)
        assert not stream.status & Status.ALIGNING
        error = errors(stream, truth)
        total.append(float(error @ np.linalg.solve(stream.covariance[3:, 3:], error)))
    # Twelve degrees of freedom, 100 runs: 12 with a sigma of 0.5; three of them.
    assert abs(np.mean(total) - 12.0) < 1.5


def test_the_sigma_of_roll_pitch_and_heading_of_a_slanted_imu() -> None:
    sensors = SensorModel(mounting_pitch=0.9, mounting_yaw=0.4)
    log, _ = simulate("windrower", seed=1, duration=8.0, sensors=sensors)
    stream = Ekf(TRUE_NOISE)
    run(stream, log)
    small, here = 1e-6, euler_of(stream.dcm_body_to_ned)
    rows = [(euler_of(rotation(small * axis) @ stream.dcm_body_to_ned) - here) / small for axis in np.eye(3)]
    expected = np.sqrt(np.diag(np.array(rows).T @ stream.covariance[ATTITUDE, ATTITUDE] @ np.array(rows)))
    # Differences over 1e-6 rad are good to 1e-6.
    np.testing.assert_allclose(stream.sigma[2], expected, rtol=1e-4)
    assert abs(expected[0] / expected[1] - 1.0) > 0.01  # or roll could pass for pitch


def test_without_north_the_earth_s_rate_stays_in_the_level_gyro_biases() -> None:
    log, _ = simulate("field", seed=1, duration=20.0, standstill_s=20.0, earth_rotation=True, origin_llh=ORIGIN)
    floor = 7.292115e-5 * math.cos(LATITUDE) / math.sqrt(2.0)
    for latitude, expected in ((LATITUDE, math.hypot(1e-7, floor)), (None, 1e-7)):
        stream = Ekf(replace(TRUE_NOISE, latitude=latitude, initial_gyro_bias_std=1e-7, gyro_bias_walk=1e-12))
        run(stream, log)
        np.testing.assert_allclose(stream.sigma[0], expected, rtol=1e-3)


def errors(stream: EkfF64, truth: Truth) -> FloatArray:
    """Velocity, attitude and bias errors (12,) at the end, as the filter's covariance has them."""
    true = dcm(truth.roll[-1], truth.pitch[-1], truth.heading[-1])
    small = stream.dcm_body_to_ned @ true.T
    angle = 0.5 * np.array([small[2, 1] - small[1, 2], small[0, 2] - small[2, 0], small[1, 0] - small[0, 1]])
    gyro, accel = stream.gyro_bias - truth.gyro_bias[-1], stream.accel_bias - truth.accel_bias[-1]
    return np.concatenate([stream.velocity_ned - truth.velocity_ned[-1], angle, gyro, accel])


def dcm(roll: float, pitch: float, heading: float) -> FloatArray:
    """Body-to-NED matrix of Euler angles."""
    x, y, z = np.eye(3)
    return rotation(z * heading) @ rotation(y * pitch) @ rotation(x * roll)


def arguments(params: EkfParams) -> dict[str, Any]:
    """Constants of the compiled class, zero initial biases."""
    return {**params.kernel_arguments(), "gyro_bias": (0.0, 0.0, 0.0), "accel_bias": (0.0, 0.0, 0.0)}


@pytest.mark.parametrize("kind", ["regular", "irregular"])
def test_float_agrees_with_double(kind: str) -> None:
    log, _ = simulate("windrower", seed=3, duration=300.0)
    if kind == "irregular":
        log = irregular(log, 5)
    params = arguments(EkfParams())
    single, double = run(EkfF32(**params), log, with_sigma=True), run(EkfF64(**params), log, with_sigma=True)
    late = log.time > 60.0
    # A float resolves the attitude to 1e-7 rad; sigma is 5e-4 rad. Some tens of roundings fit into a hundredth of
    # sigma, and sigma, which is a sum over thousands of steps, agrees to half a percent.
    for name in ("gyro_bias", "accel_bias"):
        sigma = getattr(double, f"{name}_std")[late]
        assert (np.abs(getattr(single, name) - getattr(double, name))[late] / sigma).max() < 0.01
        np.testing.assert_allclose(getattr(single, f"{name}_std")[late], sigma, rtol=5e-3)
    difference = (single.attitude - double.attitude + np.pi) % (2.0 * np.pi) - np.pi
    assert (np.abs(difference)[late] / double.attitude_std[late]).max() < 0.01


@pytest.mark.parametrize("single", [False, True])
def test_the_covariance_stays_one_for_an_hour(single: bool) -> None:
    log, _ = simulate("field", seed=2, duration=3600.0, sensors=SensorModel(imu_rate=50.0))
    stream = EkfF32(**arguments(EkfParams())) if single else EkfF64(**arguments(EkfParams()))
    run(stream, log)
    p = stream.covariance
    np.testing.assert_array_equal(p, p.T)
    scale = np.sqrt(np.diag(p))
    # As correlations its smallest eigenvalue is 0.46: no combination of states is known a thousand times better than
    # its parts, which is how a covariance looks before it breaks.
    assert np.linalg.eigvalsh(p / np.outer(scale, scale)).min() > 0.1


def test_bad_samples_are_dropped_and_leave_no_trace() -> None:
    log, _ = simulate("windrower", seed=1, duration=30.0)
    assert log.velocity_ned is not None
    clean, dirty = Ekf(), Ekf()
    for i in range(log.time.size):
        t, w, f = float(log.time[i]), log.gyro[i], log.accel[i]
        for stream in (clean, dirty):
            assert stream.update_imu(t, w, f)
        assert not dirty.update_imu(t, w, f)
        assert not dirty.update_imu(t + 0.001, (math.nan, 0.0, 0.0), f)
        if i % 10 == 0:
            for stream in (clean, dirty):
                assert stream.update_gnss(t, log.velocity_ned[i // 10], 0.03)
            assert not dirty.update_gnss(t, log.velocity_ned[i // 10], 0.03)
            assert not dirty.update_gnss(t + 0.001, (math.inf, 0.0, 0.0))
    np.testing.assert_array_equal(clean.covariance, dirty.covariance)
    np.testing.assert_array_equal(clean.gyro_bias, dirty.gyro_bias)


def test_an_infinite_sigma_says_nothing_and_a_zero_one_is_believed() -> None:
    log, _ = simulate("windrower", seed=1, duration=30.0)
    assert log.velocity_ned is not None
    stream = Ekf()
    for i in range(log.time.size):
        stream.update_imu(log.time[i], log.gyro[i], log.accel[i])
        if i % 10 == 0:
            v = log.velocity_ned[i // 10]
            if i == 2000:
                before = stream.gyro_bias
                stream.update_gnss(log.time[i], v + 5.0, math.inf)
                np.testing.assert_array_equal(stream.gyro_bias, before)
            elif i == 2500:
                stream.update_gnss(log.time[i], v, 0.0)
                np.testing.assert_allclose(stream.velocity_ned, v, atol=1e-9)
            else:
                stream.update_gnss(log.time[i], v, 0.03)
    assert np.isfinite(stream.covariance).all()
    assert (np.diag(stream.covariance) >= 0.0).all()


def without(log: Log, first: float, last: float, *, imu: bool) -> Log:
    """Cut the IMU's samples or the GNSS epochs out of a span of time."""
    if imu:
        keep = (log.time <= first) | (log.time >= last)
        return replace(log, time=log.time[keep], gyro=log.gyro[keep], accel=log.accel[keep])
    keep = (log.gnss_time <= first) | (log.gnss_time >= last)
    assert log.velocity_ned is not None
    return replace(
        log,
        gnss_time=log.gnss_time[keep],
        velocity_ned=log.velocity_ned[keep],
        velocity_std=None,
        position_llh=None,
        position_std=None,
    )


def test_an_outage_widens_sigma_and_the_error_stays_within() -> None:
    log, truth = simulate("windrower", seed=5, duration=400.0)
    trace = run(Ekf(TRUE_NOISE), without(log, 300.0, 360.0, imu=False), with_sigma=True)
    outage = (log.time > 300.5) & (log.time < 360.0)
    assert (trace.status[outage] & Status.COASTING).all()
    assert [event.code for event in trace.events] == ["S_COAST"]
    end = int(np.flatnonzero(outage)[-1])
    tilt = trace.attitude[end, :2] - [truth.roll[end], truth.pitch[end]]
    assert (trace.attitude_std[end, :2] > 2.0 * trace.attitude_std[29900, :2]).all()
    # Three sigma of the filter's own.
    assert (np.abs(tilt) < 3.0 * trace.attitude_std[end, :2]).all()
    # It takes the first epoch after the outage, and within 10 s is as sure as before.
    assert (trace.attitude_std[37100, :2] < 1.3 * trace.attitude_std[29900, :2]).all()


def test_a_gap_is_bridged_with_doubt_and_a_long_one_begins_anew() -> None:
    log, truth = simulate("windrower", seed=5, duration=400.0)
    for length, code in ((1.0, "W_GAP"), (5.0, "E_GAP_RESET")):
        cut = without(log, 300.0, 300.0 + length, imu=True)
        trace = run(Ekf(TRUE_NOISE), cut, with_sigma=True)
        assert [event.code for event in trace.events] == [code]
        after = int(np.searchsorted(cut.time, 300.0, side="right"))
        before = after - 1
        assert (trace.attitude_std[after] > 5.0 * trace.attitude_std[before]).all()
        # The biases were known and still are.
        assert (trace.gyro_bias_std[after] < 1.1 * trace.gyro_bias_std[before]).all()
        assert (trace.accel_bias_std[after] < 1.1 * trace.accel_bias_std[before]).all()
        late = cut.time > 302.0 + length
        roll = (trace.attitude[:, 0] - np.interp(cut.time, log.time, truth.roll))[late]
        # Four sigma over ten thousand samples of a correlated error.
        assert (np.abs(roll) < 4.0 * trace.attitude_std[late, 0]).all()


def test_start_up_waits_for_a_usable_interval_and_then_takes_any() -> None:
    # One epoch every 30 s cannot level; once levelled by quicker ones, it goes on.
    log, _ = simulate("windrower", seed=5, duration=200.0)
    sparse = without(without(log, 0.05, 29.95, imu=False), 30.05, 59.95, imu=False)
    first = run(Ekf(), sparse)
    assert (first.status[log.time < 59.0] & Status.INITIALIZING).all()
    assert not (first.status[log.time > 62.0] & Status.INITIALIZING).any()


def test_the_sigma_of_an_unknown_heading_is_half_a_turn() -> None:
    log, _ = simulate("field", seed=1, duration=20.0, standstill_s=20.0)
    stream = Ekf(initial=Initial(gyro_bias=(0.001, 0.0, 0.0)))
    run(stream, log)
    assert stream.status & Status.ALIGNING
    assert stream.sigma[2][2] == pytest.approx(math.pi)
    assert stream.sigma[2][:2].max() < math.radians(5.0)
