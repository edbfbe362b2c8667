"""The simulated truth obeys mechanics: what perfect sensors read integrates to the attitude, velocity and position."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from levelhead.conventions import GRAVITY, FloatArray
from levelhead.earth import EARTH_RATE, normal_gravity, radii, shifted
from levelhead.sim import ORIGIN_LLH, SCENARIOS, SensorModel, simulate
from levelhead.sim.paths import SmoothSteps, Undulation
from levelhead.sim.sensors import Stream, generator
from levelhead.sim.signals import Signal, atan, sin_cos
from levelhead.sim.vehicle import AXLE, CRUISE_SPEED, Point, Vehicle, inertial

NAMES = tuple(name for name in SCENARIOS if name != "curvy")
ORIGIN = (math.radians(45.7), math.radians(10.0), 60.0)
CABIN: Point = (1.5, 0.4, -1.2)
"""A place for the IMU: ahead of the axle, to the right, above it."""
POINTS = pytest.mark.parametrize("point", [AXLE, CABIN], ids=["axle", "cabin"])


def build(name: str, end: float = 200.0, standstill_s: float = 0.0) -> Vehicle:
    """Return the vehicle of a scenario."""
    return SCENARIOS[name].build(generator(3, Stream.PATH), end, standstill_s)


def rotation(vector: FloatArray) -> FloatArray:
    """Return the rotation matrices of small rotation vectors, shape (n, 3, 3)."""
    x, y, z = vector.T
    o = np.zeros_like(x)
    skew = np.stack((o, -z, y, z, o, -x, -y, x, o), axis=1).reshape(-1, 3, 3)
    # The fourth power of a rotation of 1e-3 rad is lost in rounding.
    turned: FloatArray = np.eye(3) + skew + skew @ skew / 2.0 + skew @ skew @ skew / 6.0
    return turned


def simpson(start: FloatArray, middle: FloatArray, stop: FloatArray, step: float) -> FloatArray:
    """Integrate over each step."""
    return step / 6.0 * (start + 4.0 * middle + stop)


def test_a_signal_carries_the_exact_derivatives() -> None:
    t = np.linspace(0.1, 3.0, 50)
    x = Signal(t, np.ones_like(t), np.zeros_like(t))
    sine, cosine = sin_cos(x * x)
    zero = np.zeros_like(t)
    for signal, value, rate, second in (
        (sine, np.sin(t**2), 2 * t * np.cos(t**2), 2 * np.cos(t**2) - 4 * t**2 * np.sin(t**2)),
        (cosine, np.cos(t**2), -2 * t * np.sin(t**2), -2 * np.sin(t**2) - 4 * t**2 * np.cos(t**2)),
        (atan(3.0 * x), np.arctan(3 * t), 3 / (1 + 9 * t**2), -54 * t / (1 + 9 * t**2) ** 2),
        (atan(x * x), np.arctan(t**2), 2 * t / (1 + t**4), (2 - 6 * t**4) / (1 + t**4) ** 2),
        (1.0 - x, 1 - t, -np.ones_like(t), zero),
        ((x + 1.0) / (x * 2.0), (t + 1) / (2 * t), -0.5 / t**2, 1 / t**3),
        (x / 4.0 - x, -0.75 * t, np.full_like(t, -0.75), zero),
        ((x * x).derivative(), 2 * t, np.full_like(t, 2.0), None),
        (Signal(t, np.ones_like(t)) * x, t**2, 2 * t, None),
    ):
        # Both sides are closed forms: only rounding is left.
        np.testing.assert_allclose(signal.value, value, rtol=1e-13, atol=1e-13)
        np.testing.assert_allclose(signal.rate, rate, rtol=1e-13, atol=1e-13)
        if second is None:
            assert signal.second is None  # not known of all that it is made of
        else:
            assert signal.second is not None
            np.testing.assert_allclose(signal.second, second, rtol=1e-12, atol=1e-12)  # up to 40, where they cancel
    with pytest.raises(ValueError, match="second derivative"):
        Signal(t, t).derivative()


def test_smooth_steps_integrate_and_differentiate_themselves() -> None:
    steps = SmoothSteps(
        initial=1.0, starts=np.array([2.0, 5.0]), widths=np.array([2.0, 3.0]), levels=np.array([4.0, -2.0])
    )
    h = 1e-3
    x = np.arange(-1.0, 10.0, h)
    integral, level, slope = steps(x)
    _, middle, middle_slope = steps(x[:-1] + h / 2)
    # Simpson's rule is off by about h^3 times the jump of the second derivative (20) on the steps with a corner.
    np.testing.assert_allclose(np.diff(integral), simpson(level[:-1], middle, level[1:], h), atol=2e-9)
    # The slope itself has a corner of the same size: h^2 times it.
    np.testing.assert_allclose(np.diff(level), simpson(slope[:-1], middle_slope, slope[1:], h), atol=1e-5)
    assert steps(np.array([0.0, 4.5, 9.0]))[0][0] == 0.0
    # 2 s at 1, a ramp with the mean 2.5 over 2 s, half a second at 4: closed form.
    assert steps(np.array([4.5]))[0][0] == pytest.approx(9.0, abs=1e-12)
    assert steps(np.array([-1.0, 4.5, 9.0]))[1].tolist() == [1.0, 4.0, -2.0]


def test_the_undulation_is_the_sum_of_its_sinusoids() -> None:
    ground = Undulation.random(np.random.default_rng(4), rms=0.05)
    t = np.linspace(-1.0, 5000.0, 3001)
    angle = ground(Signal(t, np.full_like(t, 2.0), np.full_like(t, 0.3)))
    argument = np.outer(t, ground.wavenumber) + ground.phase
    # The Taylor remainder is (3.14 * 0.125)^13 / 13! of 0.05 rad, below 1e-16; the arguments of the sines reach 1.6e4
    # and are rounded to 2e-12.
    np.testing.assert_allclose(angle.value, ground.amplitude * np.sin(argument).sum(axis=1), atol=1e-12)
    rate = 2.0 * ground.amplitude * (np.cos(argument) @ ground.wavenumber)
    np.testing.assert_allclose(angle.rate, rate, atol=1e-11)
    curvature = -ground.amplitude * (np.sin(argument) @ ground.wavenumber**2)
    assert angle.second is not None
    # The remainder grows by (13 * 12) / 0.125^2 = 1e4 with two derivatives, and is still below rounding.
    np.testing.assert_allclose(angle.second, 4.0 * curvature + 0.3 * rate / 2.0, atol=1e-10)


@pytest.mark.parametrize("name", NAMES)
def test_body_rates_integrate_to_the_attitude(name: str) -> None:
    vehicle, h = build(name), 1e-3
    time = np.arange(60.0, 130.0, h)  # a headland turn, and a spell in reverse
    dcm = vehicle.motion(time).dcm_body_to_ned
    middle = vehicle.motion(time[:-1] + h / 2).angular_rate
    # The midpoint rule is off by h^3 (|w''| / 24 + |w x w'| / 12), w'' up to 1 rad/s^3 over rough ground: 5e-11 rad.
    np.testing.assert_allclose(dcm[:-1] @ rotation(middle * h), dcm[1:], atol=1e-10)


@pytest.mark.parametrize("name", NAMES)
@POINTS
def test_specific_force_and_gravity_integrate_to_the_velocity(name: str, point: Point) -> None:
    vehicle, h = build(name), 1e-3
    time = np.arange(60.0, 130.0, h)
    gravity = np.array([0.0, 0.0, GRAVITY])
    at, between = vehicle.motion(time, point), vehicle.motion(time[:-1] + h / 2, point)
    pull, pull_between = (
        np.einsum("nij,nj->ni", m.dcm_body_to_ned, inertial(m, None)[1]) + gravity for m in (at, between)
    )
    # Simpson's rule is off by h^3 / 50 of the jump of the jerk's rate where a turn begins (1.3 m/s^4): 3e-11 m/s.
    # Away from the axle the Euler acceleration has a corner there, of 0.43 rad/s^3 times 1.6 m: h^2 / 24 of it, 3e-8.
    gained = simpson(pull[:-1], pull_between, pull[1:], h)
    np.testing.assert_allclose(np.diff(at.velocity_ned, axis=0), gained, atol=1e-10 if point == AXLE else 4e-8)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("pace", [1.0, 10.0])
def test_velocity_integrates_to_the_position(name: str, pace: float) -> None:
    vehicle, h = replace(build(name), pace=pace), 1e-2
    time = np.arange(0.0, 150.0, h)
    llh = vehicle.position_llh(time, ORIGIN)
    np.testing.assert_allclose(llh[0], ORIGIN, rtol=1e-15)  # rounding
    velocity = vehicle.motion(time).velocity_ned
    middle = vehicle.motion(time[:-1] + h / 2).velocity_ned
    meridian, normal = radii(0.5 * (llh[1:, 0] + llh[:-1, 0]))
    height = 0.5 * (llh[1:, 2] + llh[:-1, 2])
    east = (normal + height) * np.cos(0.5 * (llh[1:, 0] + llh[:-1, 0]))
    scale = np.stack((meridian + height, east, -np.ones_like(height)), axis=1)
    lost = np.diff(llh, axis=0) * scale - simpson(velocity[:-1], middle, velocity[1:], h)
    # Euler-Maclaurin leaves h^4 / 720 of the jump of the third derivative (0.25 s, 1.3 to 5 m/s^4): 1e-5 m, and the
    # quintic between the nodes the same. At ten times the speed half the step leaves less.
    assert np.abs(np.cumsum(lost, axis=0)).max() < 3e-5


def test_a_circle_comes_back_to_its_start() -> None:
    vehicle = build("circle")
    llh = vehicle.position_llh(np.array([0.0, 18.0, 36.0]), ORIGIN)
    meridian, normal = radii(llh[:1, 0])
    scale = np.array([meridian[0] + 60.0, (normal[0] + 60.0) * math.cos(ORIGIN[0]), 1.0])
    away = np.linalg.norm((llh - ORIGIN) * scale, axis=1)
    radius = CRUISE_SPEED / math.radians(10.0)
    # North turns on the way round the globe: a circle in NED velocities misses its start by area * tan(latitude) / R,
    # 0.15 mm. The same effect across the circle is below 1e-4 m.
    miss = math.pi * radius**2 * math.tan(ORIGIN[0]) / float(normal[0])
    assert away[1] == pytest.approx(2.0 * radius, abs=1e-4)
    assert away[2] == pytest.approx(miss, abs=1e-6)  # the next term is smaller by the circle over the globe


def test_at_rest_on_level_ground_the_accelerometer_reads_minus_g() -> None:
    log, truth = simulate("circle", duration=5.0, standstill_s=10.0, sensors=SensorModel.perfect())
    # Rounding only.
    np.testing.assert_allclose(log.accel, np.tile([0.0, 0.0, -GRAVITY], (500, 1)), atol=1e-14)
    np.testing.assert_allclose(log.gyro, 0.0, atol=1e-15)
    np.testing.assert_allclose(truth.velocity_ned, 0.0, atol=1e-15)


def test_a_circle_reads_its_centripetal_force() -> None:
    log, _ = simulate("circle", duration=5.0, sensors=SensorModel.perfect())
    rate = math.radians(10.0)
    # Closed form, rounding only; turning right pushes to the right (y).
    np.testing.assert_allclose(log.gyro, np.tile([0.0, 0.0, rate], (500, 1)), atol=1e-14)
    np.testing.assert_allclose(log.accel, np.tile([0.0, CRUISE_SPEED * rate, -GRAVITY], (500, 1)), atol=1e-13)


def test_an_imu_ahead_of_the_axle_of_a_circling_vehicle_is_swung_round() -> None:
    x, y, z = CABIN
    log, truth = simulate("circle", duration=5.0, sensors=replace(SensorModel.perfect(), imu_from_axle=CABIN))
    rate = math.radians(10.0)
    # On a level circle the velocity is constant along the body axes: that of the axle and rate x arm. Its rate of
    # change is rate x velocity. Closed form, rounding only.
    forward, right = CRUISE_SPEED - rate * y, rate * x
    np.testing.assert_allclose(log.gyro, np.tile([0.0, 0.0, rate], (500, 1)), atol=1e-14)
    np.testing.assert_allclose(log.accel, np.tile([-rate * right, rate * forward, -GRAVITY], (500, 1)), atol=1e-13)
    ahead = np.exp(1j * truth.heading)
    ned = (forward + 1j * right) * ahead
    np.testing.assert_allclose(truth.velocity_ned, np.stack((ned.real, ned.imag, 0.0 * ahead.real), 1), atol=1e-13)
    # The axle, not the IMU, starts at the origin; 6 nm of rounding in the angles.
    north_east = (x + 1j * y) * ahead[0]
    meridian, normal = radii(np.array(ORIGIN[:1]))
    moved = truth.position_llh[0] - ORIGIN
    assert moved[0] * (meridian[0] + 60.0) == pytest.approx(north_east.real, abs=2e-8)
    assert moved[1] * (normal[0] + 60.0) * math.cos(ORIGIN[0]) == pytest.approx(north_east.imag, abs=2e-8)
    assert moved[2] == pytest.approx(-z, abs=1e-12)


def test_gravity_is_that_of_the_place_on_the_turning_earth_only() -> None:
    # What the docstrings promise for the default origin.
    assert normal_gravity(ORIGIN_LLH[0], ORIGIN_LLH[2]) == pytest.approx(GRAVITY, abs=1e-5)
    equator = (0.0, 0.5, 1000.0)
    for earth_rotation, gravity in ((True, normal_gravity(0.0, 1000.0)), (False, GRAVITY)):
        log, _ = simulate(
            "circle",
            duration=5.0,
            standstill_s=10.0,
            sensors=SensorModel.perfect(),
            earth_rotation=earth_rotation,
            origin_llh=equator,
        )
        np.testing.assert_allclose(log.accel, np.tile([0.0, 0.0, -gravity], (500, 1)), atol=1e-14)  # rounding


def test_at_rest_the_gyro_reads_the_earth_rate() -> None:
    log, truth = simulate("circle", duration=5.0, standstill_s=10.0, earth_rotation=True, sensors=SensorModel.perfect())
    north, down = EARTH_RATE * math.cos(ORIGIN[0]), -EARTH_RATE * math.sin(ORIGIN[0])
    heading = truth.heading[0]
    expected = (north * math.cos(heading), -north * math.sin(heading), down)
    np.testing.assert_allclose(log.gyro, np.tile(expected, (500, 1)), atol=1e-15)  # rounding


@POINTS
def test_on_the_turning_earth_the_readings_agree_with_earth_centred_mechanics(point: Point) -> None:
    """Differentiate Earth-centred coordinates numerically: an independent road to Coriolis and transport rate."""
    vehicle, h = build("circle"), 0.2
    time = np.arange(0.0, 60.0, h)
    motion = vehicle.motion(time, point)
    llh = shifted(vehicle.position_llh(time, ORIGIN), motion.dcm_body_to_ned @ np.array(point))
    rate, force = inertial(motion, llh)

    lat, lon, height = llh.T
    _, normal = radii(lat)
    flat = (normal + height) * np.cos(lat)
    ecef = np.stack(
        (flat * np.cos(lon), flat * np.sin(lon), (normal * (1 - 0.00669437999014) + height) * np.sin(lat)), 1
    )
    o = np.zeros_like(lat)
    north = np.stack((-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)), axis=1)
    east = np.stack((-np.sin(lon), np.cos(lon), o), axis=1)
    ned_to_ecef = np.stack(
        (north, east, -np.stack((np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)), 1)), 2
    )
    body_to_ecef = ned_to_ecef @ motion.dcm_body_to_ned

    def first(x: FloatArray) -> FloatArray:
        return (x[:-4] - 8 * x[1:-3] + 8 * x[3:-1] - x[4:]) / (12 * h)

    def second(x: FloatArray) -> FloatArray:
        return (-x[:-4] + 16 * x[1:-3] - 30 * x[2:-2] + 16 * x[3:-1] - x[4:]) / (12 * h * h)

    earth = np.array([0.0, 0.0, EARTH_RATE])
    pull = second(ecef) + 2.0 * np.cross(earth, first(ecef))
    pull_ned = np.einsum("nij,ni->nj", ned_to_ecef[2:-2], pull)
    pull_ned[:, 2] -= normal_gravity(lat, height)[2:-2]
    expected = np.einsum("nij,ni->nj", motion.dcm_body_to_ned[2:-2], pull_ned)
    # Rounding of 1e-9 m in coordinates of 6e6 m, over h^2, times 5: 2e-7 m/s^2, ten times below v^2/R (1.4e-6); the
    # Coriolis force is 4e-4.
    np.testing.assert_allclose(force[2:-2], expected, atol=7e-7)

    spin = np.swapaxes(body_to_ecef[2:-2], 1, 2) @ first(body_to_ecef)
    spinning = np.stack((spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]), axis=1)
    spinning += np.einsum("nij,i->nj", body_to_ecef[2:-2], earth)
    # The stencil is off by h^4 / 30 times the fifth power of the yaw rate, 9e-9 rad/s; the transport rate is 5e-7.
    np.testing.assert_allclose(rate[2:-2], spinning, atol=2e-8)
