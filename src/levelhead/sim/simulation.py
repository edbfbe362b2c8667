"""`simulate`: a named drive as a `Log`, and the `Truth` behind it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from levelhead.conventions import FloatArray
from levelhead.earth import shifted
from levelhead.errors import UsageError
from levelhead.logs.log import Log
from levelhead.sim.scenarios import SCENARIOS, Scenario
from levelhead.sim.sensors import SensorModel, Stream, generator, jitter
from levelhead.sim.truth import Truth
from levelhead.sim.vehicle import CRUISE_SPEED, Motion, Vehicle, inertial, to_ned

ORIGIN_LLH: Final = (math.radians(45.7), math.radians(10.0), 60.0)
"""Where the drives start: the Po valley, where normal gravity is the standard value within 1e-5 m/s^2."""

SPEED_RANGE: Final = (0.1, 60.0)
"""Cruise speeds that can be asked for, m/s."""

_MOST_SAMPLES = 50_000_000


def simulate(
    scenario: str = "field",
    *,
    seed: int = 0,
    duration: float = 1800.0,
    sensors: SensorModel | None = None,
    start: float = 0.0,
    standstill_s: float = 0.0,
    earth_rotation: bool = False,
    origin_llh: tuple[float, float, float] = ORIGIN_LLH,
    speed: float = CRUISE_SPEED,
) -> tuple[Log, Truth]:
    """Simulate a named drive: the readings, and the truth behind them.

    The drive is a function of the seed and of absolute time: ``start`` cuts any part out of a long run, so that a day
    can be made in chunks that fit together (path, biases, engine vibration). White noise and jitter are drawn anew in
    every chunk.

    Parameters
    ----------
    scenario : str
        A key of `levelhead.sim.SCENARIOS`: field, windrower (alias curvy), hill, crab, reverse, circle,
        straight.
    seed : int
        Of everything random, not negative.
    duration : float
        Length of the log, s. Its stamps lie in ``start <= t < start + duration``.
    sensors : SensorModel, optional
        What the sensors do wrong.
    start : float
        First time stamp, s.
    standstill_s : float
        How long the vehicle stands before it sets off, s; 0 starts the run at cruise speed.
    earth_rotation : bool
        Whether the gyros feel the Earth turn and the accelerometers the Coriolis force and the normal gravity of the
        place. Without it gravity is `levelhead.conventions.GRAVITY` everywhere; at the default origin the two agree
        within 1e-5 m/s^2.
    origin_llh : (float, float, float)
        Latitude, longitude (rad) and height (m) at time 0, of the point that does not slip (`imu_from_axle` away
        from the IMU).
    speed : float
        Cruise speed, m/s, from 0.1 to 60. Heading, roll and pitch are the same at every time whatever it is, so a
        faster vehicle turns on larger radii; other speeds (in reverse, setting off) go in proportion.

    Returns
    -------
    log : Log
        Readings in IMU axes; velocity and position of the antenna; wheel speed where the sensors have one. A noise of
        0 leaves its ``_std`` column out.
    truth : Truth
        At the IMU samples.

    Raises
    ------
    UsageError
        When the scenario is unknown or a number is out of range.
    """
    sensors = SensorModel() if sensors is None else sensors
    drive = _checked(scenario, seed, duration, sensors, start, standstill_s, origin_llh, speed)
    end = start + duration
    vehicle = drive.build(generator(seed, Stream.PATH), end, standstill_s)
    vehicle = replace(vehicle, pace=speed / CRUISE_SPEED)

    time = _stamps(start, end, sensors.imu_rate)
    motion = vehicle.motion(time, sensors.imu_from_axle)
    position_llh = vehicle.position_llh(time, origin_llh)
    if any(sensors.imu_from_axle):
        position_llh = shifted(position_llh, motion.dcm_body_to_ned @ np.array(sensors.imu_from_axle))
    truth = _truth(motion, position_llh, time, sensors, seed, earth_rotation)
    gnss_stamps = _stamps(start, end, sensors.gnss_rate)
    velocity, position = _gnss(vehicle, gnss_stamps - sensors.gnss_latency, sensors, seed, start, origin_llh)

    imu_jitter = jitter(time.size, sensors.imu_time_jitter, sensors.imu_rate, generator(seed, Stream.IMU_JITTER, start))
    gnss_jitter = jitter(
        gnss_stamps.size, sensors.gnss_time_jitter, sensors.gnss_rate, generator(seed, Stream.GNSS_JITTER, start)
    )
    log = Log(
        time=time + imu_jitter,
        gyro=sensors.read_gyro(truth.angular_rate, truth.gyro_bias, seed=seed, start=start),
        accel=sensors.read_accel(time, truth.specific_force, truth.accel_bias, seed=seed, start=start),
        gnss_time=gnss_stamps + gnss_jitter,
        velocity_ned=velocity,
        velocity_std=_constant(sensors.velocity_noise, gnss_stamps.size),
        position_llh=position,
        position_std=_constant(sensors.position_noise, gnss_stamps.size),
        wheel_speed=sensors.read_wheels(motion.forward_speed, seed=seed, start=start),
        meta={
            "source": f"simulated:{scenario} seed {seed}",
            "format": "simulation",
            "completeness": "complete",
            "earth_rotation": earth_rotation,
        },
    )
    return log, truth


def _checked(
    scenario: str,
    seed: int,
    duration: float,
    sensors: SensorModel,
    start: float,
    standstill_s: float,
    origin_llh: tuple[float, float, float],
    speed: float,
) -> Scenario:
    """Return the scenario, or raise a sentence about the first argument that is out of range."""
    drive = SCENARIOS.get(scenario)
    if drive is None:
        raise UsageError(f"There is no scenario {scenario!r}; choose one of {', '.join(SCENARIOS)}.")
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise UsageError(f"The seed is {seed!r}; give a whole number that is not negative.")
    for name, value in (("start", start), ("standstill_s", standstill_s)):
        if not (math.isfinite(value) and value >= 0.0):
            raise UsageError(f"{name} is {value} s; give a finite number that is not negative.")
    samples = duration * sensors.imu_rate
    if not (math.isfinite(duration) and samples >= 2.0 and duration * sensors.gnss_rate >= 1.0):
        raise UsageError(
            f"duration is {duration} s; at {sensors.imu_rate:g} Hz of IMU and {sensors.gnss_rate:g} Hz of GNSS it must "
            "hold at least two samples and one epoch."
        )
    if samples > _MOST_SAMPLES:
        raise UsageError(
            f"duration is {duration} s, which makes {samples:.3g} IMU samples; simulate at most {_MOST_SAMPLES} at a "
            "time, and go on with start=."
        )
    slowest, fastest = SPEED_RANGE
    if not slowest <= speed <= fastest:
        raise UsageError(f"speed is {speed} m/s; give a number from {slowest} to {fastest:g}.")
    if len(origin_llh) != 3 or not (
        all(math.isfinite(v) for v in origin_llh) and abs(math.degrees(origin_llh[0])) < 89
    ):
        raise UsageError(
            f"origin_llh is {origin_llh}; give latitude and longitude in rad and height in m, below 89 deg of latitude."
        )
    return drive


def _stamps(start: float, end: float, rate: float) -> FloatArray:
    """Return the multiples of the interval in [start, end): the same numbers in a chunk as in the whole run."""
    first, stop = (math.ceil(t * rate - 1e-6) for t in (start, end))  # 1e-6: a start of 0.3 s is sample 3 at 10 Hz
    return np.arange(first, stop) / rate


def _truth(
    motion: Motion,
    position_llh: FloatArray,
    time: FloatArray,
    sensors: SensorModel,
    seed: int,
    earth_rotation: bool,
) -> Truth:
    """Return the truth at the given times, in IMU axes, from the motion and position of the IMU."""
    angular_rate, specific_force = inertial(motion, position_llh if earth_rotation else None)
    relative_rate = motion.angular_rate
    roll, pitch, heading = motion.roll, motion.pitch, motion.heading
    if sensors.mounting_roll or sensors.mounting_pitch or sensors.mounting_yaw:
        mounting = sensors.dcm_imu_to_vehicle
        # R^T v, row by row
        angular_rate, specific_force, relative_rate = (
            v @ mounting for v in (angular_rate, specific_force, relative_rate)
        )
        dcm = motion.dcm_body_to_ned @ mounting
        roll = np.arctan2(dcm[:, 2, 1], dcm[:, 2, 2])
        pitch = -np.arcsin(np.clip(dcm[:, 2, 0], -1.0, 1.0))
        heading = np.arctan2(dcm[:, 1, 0], dcm[:, 0, 0])
    gyro_bias, accel_bias = sensors.biases(time, seed)
    return Truth(
        time=time,
        gyro_bias=gyro_bias,
        accel_bias=accel_bias,
        roll=_wrapped(roll),
        pitch=pitch,
        heading=_wrapped(heading),
        velocity_ned=motion.velocity_ned,
        position_llh=position_llh,
        angular_rate=angular_rate,
        specific_force=specific_force,
        relative_rate=relative_rate if earth_rotation else None,
    )


def _gnss(
    vehicle: Vehicle,
    time: FloatArray,
    sensors: SensorModel,
    seed: int,
    start: float,
    origin_llh: tuple[float, float, float],
) -> tuple[FloatArray, FloatArray]:
    """Return the antenna's velocity (NED) and position (llh) at the given times, with noise."""
    motion = vehicle.motion(time, sensors.imu_from_axle)
    lever_arm = np.array(sensors.lever_arm)
    noise = sensors.velocity_noise * generator(seed, Stream.VELOCITY_NOISE, start).standard_normal((time.size, 3))
    velocity = motion.velocity_ned + noise
    velocity += to_ned(motion.dcm_body_to_ned, np.cross(motion.angular_rate, lever_arm))

    shift = sensors.position_noise * generator(seed, Stream.POSITION_NOISE, start).standard_normal((time.size, 3))
    from_axle = lever_arm + np.array(sensors.imu_from_axle)
    shift += to_ned(motion.dcm_body_to_ned, np.broadcast_to(from_axle, shift.shape))
    return velocity, shifted(vehicle.position_llh(time, origin_llh), shift)


def _constant(sigma: float, count: int) -> FloatArray | None:
    """Return a column of one sigma, or None where there is no noise to tell of."""
    return np.full(count, sigma) if sigma > 0.0 else None


def _wrapped(angle: FloatArray) -> FloatArray:
    """Return the angle within (-pi, pi]."""
    return np.pi - np.mod(np.pi - angle, 2.0 * np.pi)
