"""`SensorModel`: what is wrong with the simulated IMU, GNSS receiver and wheels, and the readings that follow.

Every imperfection draws from a random generator of its own, derived from the seed: switching one off leaves all
others as they were.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from levelhead.conventions import GRAVITY, FloatArray
from levelhead.errors import UsageError

Triple = tuple[float, float, float]

_BAND_SINUSOIDS = 12
_JITTER_LIMIT = 0.45

_NOT_NEGATIVE: Final[dict[str, str]] = {
    "gyro_noise": "rad/s/sqrt(Hz)",
    "accel_noise": "m/s^2/sqrt(Hz)",
    "vibration": "m/s^2",
    "band_vibration": "m/s^2",
    "gyro_bias_walk": "rad/s/sqrt(s)",
    "accel_bias_walk": "m/s^2/sqrt(s)",
    "gyro_step": "rad/s",
    "accel_step": "m/s^2",
    "imu_time_jitter": "s",
    "velocity_noise": "m/s",
    "position_noise": "m",
    "gnss_time_jitter": "s",
    "wheel_speed_noise": "m/s",
}
_FINITE: Final[dict[str, str]] = {
    "wheel_speed_scale": "(a relative error)",
    "mounting_roll": "rad",
    "mounting_pitch": "rad",
    "mounting_yaw": "rad",
    "gnss_latency": "s",
}
_POSITIVE: Final[dict[str, str]] = {
    "imu_rate": "Hz",
    "gnss_rate": "Hz",
    "gyro_range": "rad/s",
    "accel_range": "m/s^2",
}
_TRIPLES: Final[dict[str, str]] = {"gyro_bias": "rad/s", "accel_bias": "m/s^2", "lever_arm": "m", "imu_from_axle": "m"}


class Stream(enum.IntEnum):
    """The random streams of a simulation; the numbers go into the seed and must stay."""

    PATH = 0
    GYRO_NOISE = 1
    ACCEL_NOISE = 2
    VIBRATION = 3
    BAND_VIBRATION = 4
    GYRO_WALK = 5
    ACCEL_WALK = 6
    VELOCITY_NOISE = 7
    POSITION_NOISE = 8
    IMU_JITTER = 9
    GNSS_JITTER = 10
    WHEEL_NOISE = 11


def generator(seed: int, stream: Stream, start: float = 0.0) -> np.random.Generator:
    """Return the random generator of one stream; `start` (s) tells the chunks of a long run apart."""
    return np.random.default_rng(np.random.SeedSequence([seed, int(stream), round(start * 1e6)]))


@dataclass(frozen=True, kw_only=True)
class SensorModel:
    """An IMU and a GNSS receiver; the defaults are a low-cost MEMS IMU and a receiver with good velocities.

    Noise densities are one-sided: white noise of density d sampled at the rate f has the sigma d sqrt(f / 2).
    Readings are instantaneous samples, in the order: mounting, bias, noise and vibration, saturation, quantisation.

    Parameters
    ----------
    imu_rate, gnss_rate : float
        Samples and epochs per second, Hz.
    gyro_noise : float
        Noise density of the gyros, rad/s/sqrt(Hz).
    accel_noise : float
        Noise density of the accelerometers, m/s^2/sqrt(Hz).
    vibration : float
        White vibration, m/s^2 RMS per axis. It is seen by the accelerometers only, as noise.
    band_vibration : float
        Vibration of an engine, m/s^2 RMS per axis: 12 sinusoids with random frequencies and phases in the band.
    vibration_band : (float, float)
        The band of `band_vibration`, Hz.
    gyro_bias, accel_bias : (float, float, float)
        Biases at time 0, rad/s and m/s^2, IMU axes.
    gyro_bias_walk, accel_bias_walk : float
        Random walk of the biases, rad/s/sqrt(s) and m/s^2/sqrt(s); it steps once a second, linearly in between.
    gyro_step, accel_step : float
        Quantisation step, rad/s and m/s^2; 0 switches it off.
    gyro_range, accel_range : float
        Readings saturate at plus and minus this, rad/s and m/s^2; infinite switches it off.
    mounting_roll, mounting_pitch, mounting_yaw : float
        Attitude of the IMU relative to the vehicle (3-2-1 Euler angles), rad.
    imu_time_jitter, gnss_time_jitter : float
        One sigma of the error of each time stamp, s; cut off at 0.45 of the interval to keep the stamps in order.
    velocity_noise : float
        White noise of the GNSS velocity, m/s per axis.
    position_noise : float
        White noise of the GNSS position, m per axis.
    gnss_latency : float
        The GNSS stamps are late by this, s: what was true at t bears the stamp t + latency.
    lever_arm : (float, float, float)
        From the IMU to the antenna, m, along the vehicle's axes (forward, right, down).
    imu_from_axle : (float, float, float)
        From the point that does not slip sideways (the middle of the rear axle) to the IMU, m, along the vehicle's
        axes. The IMU then feels the centripetal and Euler accelerations of its place.
    wheel_speed : bool
        Whether the log has the speed of the wheels: forward, at the axle that does not steer, at the IMU's samples.
    wheel_speed_noise : float
        White noise of that speed, m/s.
    wheel_speed_scale : float
        Its relative error: 0.01 where the wheels tell 1 % too much.

    Raises
    ------
    UsageError
        When a value is out of range.
    """

    imu_rate: float = 100.0
    gnss_rate: float = 10.0
    gyro_noise: float = math.radians(0.01)
    accel_noise: float = 150e-6 * GRAVITY
    vibration: float = 0.1
    band_vibration: float = 0.0
    vibration_band: tuple[float, float] = (12.0, 40.0)
    gyro_bias: Triple = (math.radians(0.08), math.radians(0.13), math.radians(0.05))
    accel_bias: Triple = (0.11, 0.2, 0.0)
    gyro_bias_walk: float = 2e-6
    accel_bias_walk: float = 2e-4
    gyro_step: float = 0.0
    accel_step: float = 0.0
    gyro_range: float = math.inf
    accel_range: float = math.inf
    mounting_roll: float = 0.0
    mounting_pitch: float = 0.0
    mounting_yaw: float = 0.0
    imu_time_jitter: float = 0.0
    gnss_time_jitter: float = 0.0
    velocity_noise: float = 0.03
    position_noise: float = 0.02
    gnss_latency: float = 0.0
    lever_arm: Triple = (0.0, 0.0, 0.0)
    imu_from_axle: Triple = (0.0, 0.0, 0.0)
    wheel_speed: bool = False
    wheel_speed_noise: float = 0.0
    wheel_speed_scale: float = 0.0

    def __post_init__(self) -> None:
        for name, unit in _NOT_NEGATIVE.items():
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise UsageError(f"SensorModel.{name} is {value} {unit}; give a finite number that is not negative.")
        for name, unit in _FINITE.items():
            value = getattr(self, name)
            if not math.isfinite(value):
                raise UsageError(f"SensorModel.{name} is {value} {unit}; give a finite number.")
        for name, unit in _POSITIVE.items():
            value = getattr(self, name)
            if not value > 0.0 or (name.endswith("_rate") and not math.isfinite(value)):
                raise UsageError(f"SensorModel.{name} is {value} {unit}; give a number above 0.")
        for name, unit in _TRIPLES.items():
            triple = getattr(self, name)
            if len(triple) != 3 or not all(math.isfinite(v) for v in triple):
                raise UsageError(f"SensorModel.{name} is {triple}; give three finite numbers in {unit}.")
        low, high = self.vibration_band
        if not (0.0 < low <= high < math.inf):
            raise UsageError(f"SensorModel.vibration_band is {self.vibration_band} Hz; give (low, high) above 0.")

    @classmethod
    def perfect(cls, *, imu_rate: float = 100.0, gnss_rate: float = 10.0) -> SensorModel:
        """Return sensors without any error; `dataclasses.replace` adds the one to be looked at."""
        return cls(
            imu_rate=imu_rate,
            gnss_rate=gnss_rate,
            gyro_noise=0.0,
            accel_noise=0.0,
            vibration=0.0,
            gyro_bias=(0.0, 0.0, 0.0),
            accel_bias=(0.0, 0.0, 0.0),
            gyro_bias_walk=0.0,
            accel_bias_walk=0.0,
            velocity_noise=0.0,
            position_noise=0.0,
        )

    @property
    def dcm_imu_to_vehicle(self) -> FloatArray:
        """The mounting as a direction cosine matrix, shape (3, 3)."""
        s_r, s_p, s_y = (math.sin(a) for a in (self.mounting_roll, self.mounting_pitch, self.mounting_yaw))
        c_r, c_p, c_y = (math.cos(a) for a in (self.mounting_roll, self.mounting_pitch, self.mounting_yaw))
        roll = np.array([[1.0, 0.0, 0.0], [0.0, c_r, -s_r], [0.0, s_r, c_r]])
        pitch = np.array([[c_p, 0.0, s_p], [0.0, 1.0, 0.0], [-s_p, 0.0, c_p]])
        yaw = np.array([[c_y, -s_y, 0.0], [s_y, c_y, 0.0], [0.0, 0.0, 1.0]])
        return np.asarray(yaw @ pitch @ roll, dtype=np.float64)

    def biases(self, time: FloatArray, seed: int) -> tuple[FloatArray, FloatArray]:
        """Return gyro and accelerometer bias at the given times, each of shape (n, 3)."""
        gyro = np.array(self.gyro_bias) + _walk(time, self.gyro_bias_walk, generator(seed, Stream.GYRO_WALK))
        accel = np.array(self.accel_bias) + _walk(time, self.accel_bias_walk, generator(seed, Stream.ACCEL_WALK))
        return gyro, accel

    def read_gyro(self, angular_rate: FloatArray, bias: FloatArray, *, seed: int, start: float) -> FloatArray:
        """Return gyro readings, shape (n, 3), from true rates and biases in IMU axes, rad/s."""
        noise = self.gyro_noise * math.sqrt(0.5 * self.imu_rate)
        reading = angular_rate + bias + noise * generator(seed, Stream.GYRO_NOISE, start).standard_normal(bias.shape)
        return _digitise(reading, self.gyro_range, self.gyro_step)

    def read_accel(
        self, time: FloatArray, specific_force: FloatArray, bias: FloatArray, *, seed: int, start: float
    ) -> FloatArray:
        """Return accelerometer readings, shape (n, 3), from true forces and biases in IMU axes, m/s^2."""
        noise = self.accel_noise * math.sqrt(0.5 * self.imu_rate)
        reading = specific_force + bias
        reading += noise * generator(seed, Stream.ACCEL_NOISE, start).standard_normal(bias.shape)
        reading += self.vibration * generator(seed, Stream.VIBRATION, start).standard_normal(bias.shape)
        if self.band_vibration > 0.0:
            reading += self._band_vibration(time, generator(seed, Stream.BAND_VIBRATION))
        return _digitise(reading, self.accel_range, self.accel_step)

    def read_wheels(self, forward_speed: FloatArray, *, seed: int, start: float) -> FloatArray | None:
        """Return wheel speeds, shape (n,), from true forward speeds at the axle, m/s; None where there are none."""
        if not self.wheel_speed:
            return None
        noise = generator(seed, Stream.WHEEL_NOISE, start).standard_normal(forward_speed.size)
        reading: FloatArray = forward_speed * (1.0 + self.wheel_speed_scale) + self.wheel_speed_noise * noise
        return reading

    def _band_vibration(self, time: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Return the vibration of an engine, shape (n, 3); phases count from time 0, so chunks fit together."""
        omega = 2.0 * math.pi * rng.uniform(*self.vibration_band, (3, _BAND_SINUSOIDS))
        phase = rng.uniform(0.0, 2.0 * math.pi, (3, _BAND_SINUSOIDS))
        total = np.zeros((time.size, 3))
        for axis in range(3):
            for w, p in zip(omega[axis], phase[axis], strict=True):
                total[:, axis] += np.sin(w * time + p)
        return total * (self.band_vibration * math.sqrt(2.0 / _BAND_SINUSOIDS))


def jitter(count: int, sigma: float, rate: float, rng: np.random.Generator) -> FloatArray:
    """Return errors of the time stamps, s, shape (n,), small enough to leave them in order."""
    limit = _JITTER_LIMIT / rate
    return np.clip(sigma * rng.standard_normal(count), -limit, limit)


def _walk(time: FloatArray, intensity: float, rng: np.random.Generator) -> FloatArray:
    """Return a random walk at the given times, shape (n, 3): a function of absolute time, 0 at time 0."""
    knots = max(math.ceil(float(time[-1])), 1)
    steps = intensity * rng.standard_normal((knots, 3))
    walk = np.concatenate((np.zeros((1, 3)), np.cumsum(steps, axis=0)))
    seconds = np.arange(knots + 1)
    return np.stack([np.interp(time, seconds, walk[:, axis]) for axis in range(3)], axis=1)


def _digitise(reading: FloatArray, limit: float, step: float) -> FloatArray:
    """Saturate, then quantise."""
    if math.isfinite(limit):
        reading = np.clip(reading, -limit, limit)
    if step > 0.0:
        reading = np.rint(reading / step) * step
    return reading
