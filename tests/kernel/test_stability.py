"""Stability: the paper's Lyapunov function, fast turns, an upside-down IMU, single precision over a day."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from levelhead.conventions import GRAVITY, FloatArray
from levelhead.estimators.observer import Observer, ObserverParams
from levelhead.estimators.streaming import run
from levelhead.logs.log import Log
from levelhead.sim import SensorModel, simulate

from .conftest import Kit

Complex = np.ndarray[tuple[int, ...], np.dtype[np.complex128]]


def exponential(matrix: Complex) -> Complex:
    """Return exp of a stack of small matrices: Taylor's series on matrix/2^k, then squared k times."""
    squarings = 10
    scaled = matrix / 2.0**squarings
    term = total = np.broadcast_to(np.eye(matrix.shape[-1], dtype=np.complex128), matrix.shape)
    for n in range(1, 14):
        term = term @ scaled / n
        total = total + term
    for _ in range(squarings):
        total = total @ total
    return total


def linear_model(tau: FloatArray, tau_gyro: FloatArray, omega_accel: FloatArray, yaw_rate: FloatArray) -> Complex:
    """Return Tereshkov (2015), Eqs. (10)-(12), for [u, b_g, b_a] with each horizontal vector as x + iy."""
    a = np.zeros((*tau.shape, 3, 3), dtype=np.complex128)
    a[..., 0, 0] = -1j * yaw_rate - 1.0 / tau
    a[..., 0, 1] = 1.0 / tau
    a[..., 0, 2] = yaw_rate / (GRAVITY * tau)
    a[..., 1, 0] = -1.0 / tau_gyro
    a[..., 2, 0] = -GRAVITY * yaw_rate / omega_accel
    return a


def test_v_never_rises_on_the_linear_model() -> None:
    # Eq. (13) is a Lyapunov function of Eqs. (10)-(12) for ANY yaw rate history; each state gets its own constants,
    # yaw rate and time step, and the exact step. 10^6 states as faults.md demands, its bound of 1e-12 for rounding.
    rng = np.random.default_rng(1)
    matrices, states = 2000, 500
    tau = rng.uniform(0.5, 20.0, matrices)
    tau_gyro = rng.uniform(1.0, 400.0, matrices)
    omega_accel = np.radians(rng.uniform(1.0, 400.0, matrices))
    step = exponential(
        linear_model(tau, tau_gyro, omega_accel, rng.uniform(-5.0, 5.0, matrices))
        * rng.uniform(1e-3, 1.0, matrices)[:, None, None]
    )
    weights = np.stack([tau / 2.0, tau_gyro / 2.0, omega_accel / (2.0 * GRAVITY**2)], axis=-1)
    # Directions uniform in the metric of V, so that no component hides behind another's size.
    direction = rng.standard_normal((matrices, 3, states)) + 1j * rng.standard_normal((matrices, 3, states))
    x = direction / np.sqrt(weights)[:, :, None]
    v_before = (weights[:, :, None] * np.abs(x) ** 2).sum(axis=1)
    v_after = (weights[:, :, None] * np.abs(step @ x) ** 2).sum(axis=1)
    assert ((v_after - v_before) / v_before).max() <= 1e-12


def noiseless(gnss_rate: float) -> SensorModel:
    """Return sensors with biases and nothing else wrong."""
    return SensorModel(
        gnss_rate=gnss_rate,
        gyro_noise=0.0,
        accel_noise=0.0,
        vibration=0.0,
        velocity_noise=0.0,
        position_noise=0.0,
        gyro_bias_walk=0.0,
        accel_bias_walk=0.0,
    )


def test_v_falls_in_the_kernel_too() -> None:
    # The compiled observer on a level, noise-free drive with GNSS at 50 Hz. V is made from the truth: what is left of
    # the biases, and u = theta/tau + k x b_a from the tilt error (Eq. 8). The sampled loop lags by one interval of 0.02
    # s, so V may rise by a share of T/tau = 0.5 % of itself within a step, and never above where it started.
    log, truth = simulate("circle", seed=1, duration=300.0, sensors=noiseless(50.0))
    params = ObserverParams()
    trace = run(Observer(params), log)
    start = 200  # after start-up levelling
    gyro = (truth.gyro_bias - trace.gyro_bias)[start:, 0] + 1j * (truth.gyro_bias - trace.gyro_bias)[start:, 1]
    accel = (truth.accel_bias - trace.accel_bias)[start:, 0] + 1j * (truth.accel_bias - trace.accel_bias)[start:, 1]
    roll, pitch = trace.attitude[start:, 0] - truth.roll[start:], trace.attitude[start:, 1] - truth.pitch[start:]
    u = (roll + 1j * pitch) / params.tau - 1j * accel / (GRAVITY * params.tau)
    v = (
        params.tau / 2.0 * np.abs(u) ** 2
        + params.tau_gyro / 2.0 * np.abs(gyro) ** 2
        + params.omega_accel / (2.0 * GRAVITY**2) * np.abs(accel) ** 2
    )
    later = v[::100]
    assert (later[1:] <= later[:-1] * (1.0 + 0.005)).all()
    assert later[-1] < 0.35 * later[0]  # a circle keeps one combination of the biases for ever


@pytest.mark.parametrize("gnss_rate", [2.0, 10.0])
@pytest.mark.parametrize("rate", [-5.0, 2.0, 5.0])
def test_fast_turns_stay_bounded_and_teach(rate: float, gnss_rate: float) -> None:
    # Spinning at 5 rad/s: an explicit step is unstable beyond 0.0106 s, and a bias update that sees w_p in the attitude
    # in which it acts, not the one in which it was measured, drives the accelerometer bias away. A circle cannot
    # separate the biases, so only their growth is judged: V of Eq. (13) bounds each by what there was at the start.
    t = np.arange(0.0, 300.0, 0.01)
    speed, g = 2.0, np.array([0.0, 0.0, GRAVITY])
    heading = rate * t
    gyro = np.tile([0.0, 0.0, rate], (t.size, 1)) + np.radians([0.08, 0.13, 0.05])
    accel = np.tile([0.0, speed * rate, 0.0] - g, (t.size, 1)) + np.array([0.11, 0.2, 0.0])
    velocity = speed * np.column_stack([np.cos(heading), np.sin(heading), np.zeros_like(t)])
    every = round(100.0 / gnss_rate)
    log = Log(time=t, gyro=gyro, accel=accel, gnss_time=t[::every], velocity_ned=velocity[::every])
    trace = run(Observer(), log)
    left = trace.accel_bias[-1, :2] - [0.11, 0.2]
    assert np.isfinite(trace.gyro_bias).all()
    assert np.degrees(np.abs(trace.gyro_bias)).max() < 1.0
    assert np.abs(trace.accel_bias[:, :2]).max() < 0.5
    assert np.linalg.norm(left) <= math.hypot(0.11, 0.2) * (1.0 + 1e-12)
    if abs(rate) / gnss_rate <= 0.5:  # turns small enough within an interval to learn from
        assert np.linalg.norm(left) < 0.5 * math.hypot(0.11, 0.2)


def upside_down(log: Log) -> Log:
    """Return what the same drive looks like to an IMU mounted upside-down: turned about its x axis by 180 deg."""
    flip = np.array([1.0, -1.0, -1.0])
    return replace(log, gyro=log.gyro * flip, accel=log.accel * flip)


def test_an_upside_down_imu_finds_itself() -> None:
    log, truth = simulate("windrower", seed=2, duration=400.0)
    upright, inverted = run(Observer(), log), run(Observer(), upside_down(log))
    flip = np.array([1.0, -1.0, -1.0])
    # faults.md: upside-down equals upright to 1e-6 after rotation.
    np.testing.assert_allclose(inverted.gyro_bias * flip, upright.gyro_bias, atol=1e-6, rtol=0.0)
    np.testing.assert_allclose((inverted.accel_bias * flip)[:, :2], upright.accel_bias[:, :2], atol=1e-6, rtol=0.0)
    roll = np.degrees((inverted.attitude[-1000:, 0] - truth.roll[-1000:]) % (2.0 * np.pi))
    assert np.abs(roll - 180.0).max() < 0.5  # ten sigma of the observer's own 0.05 deg


def rolled(log: Log, roll: float, pitch: float) -> tuple[Log, FloatArray]:
    """Return what an IMU rolled and pitched in its mounting reads, and its axes in the vehicle's as rows."""
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    turn = np.array([[cp, 0.0, -sp], [sp * sr, cr, cp * sr], [sp * cr, -sr, cp * cr]])
    return replace(log, gyro=log.gyro @ turn.T, accel=log.accel @ turn.T), turn


@pytest.mark.parametrize("roll_deg", [0.0, 40.0, 90.0, 135.0, 180.0, 250.0, 315.0])
@pytest.mark.parametrize("pitch_deg", [-15.0, 15.0])
def test_an_imu_mounted_on_its_side_levels_like_an_upright_one(roll_deg: float, pitch_deg: float) -> None:
    # Roll and pitch of the mounting are just another body frame, as the papers say; yaw is not (x must point forward).
    log, _ = simulate("windrower", seed=2, duration=200.0)
    tilted_log, turn = rolled(log, math.radians(roll_deg), math.radians(pitch_deg))
    upright, tilted = Observer(), Observer()
    run(upright, log)
    trace = run(tilted, tilted_log)
    down = tilted.dcm_body_to_ned[2] @ turn
    # Pitched by 15 deg, the mounting's x axis swings sideways with the vehicle's roll: the heading, steered by the
    # course, is off by sin 15 deg of a 3 deg roll, and that times the centripetal acceleration is a tilt of 0.1 deg at
    # most.
    assert math.degrees(np.linalg.norm(down - upright.dcm_body_to_ned[2])) < 0.15
    gyro_bias = trace.gyro_bias[-1] @ turn
    np.testing.assert_allclose(np.degrees(gyro_bias[:2]), np.degrees(upright.gyro_bias[:2]), atol=0.02, rtol=0.0)


def a_day(hours: int) -> Log:
    """Return hours of field work: one simulated hour driven again and again, its velocities turned to join up."""
    log, truth = simulate("field", seed=1, duration=3600.0)
    assert log.velocity_ned is not None
    n, period = log.time.size, 3600.0
    # Each repetition starts at the heading and speed where the last one ended, so that no acceleration is invented.
    turn = truth.heading[-1] - truth.heading[0]
    velocity, times, gnss_times = [], [], []
    for k in range(hours):
        c, s = math.cos(k * turn), math.sin(k * turn)
        velocity.append(log.velocity_ned @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))
        times.append(log.time + k * period)
        gnss_times.append(log.gnss_time + k * period)
    assert n == times[0].size
    return Log(
        time=np.concatenate(times),
        gyro=np.tile(log.gyro, (hours, 1)),
        accel=np.tile(log.accel, (hours, 1)),
        gnss_time=np.concatenate(gnss_times),
        velocity_ned=np.concatenate(velocity),
    )


@pytest.mark.parametrize("variant", ["observer", "two-stage, feedback"])
def test_float_agrees_with_double_over_a_day(kit: Kit, variant: str) -> None:
    log = a_day(24)
    double, single = kit.run(kit.variants[variant], log), kit.run(kit.variants[variant], log, single=True)
    # faults.md: 24 h, 1e-4 deg/s, 1e-4 m/s^2, 0.005 deg. Time itself is never float32.
    assert np.degrees(np.abs(double.gyro_bias - single.gyro_bias)).max() < 1e-4
    assert np.abs(double.accel_bias - single.accel_bias)[:, :2].max() < 1e-4
    angle = (double.attitude - single.attitude + np.pi) % (2.0 * np.pi) - np.pi
    assert np.degrees(np.nanmax(np.abs(angle))) < 0.005
