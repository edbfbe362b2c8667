"""The noise of the inertial sensors, found from the log: the values under which the filter is least surprised."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from levelhead.conventions import FloatArray
from levelhead.errors import LogError
from levelhead.estimators.base import SensorData
from levelhead.estimators.params import NoiseParams
from levelhead.estimators.phasor import PhasorParams
from levelhead.estimators.streaming import run
from levelhead.kernel._kernel import SmootherF64

WINDOW: Final = 900.0
"""The noise is looked for in this much of a log, its liveliest part, s."""
GYRO_LIMITS: Final = (math.radians(5e-4), math.radians(0.3))
"""Noise densities that are tried, rad/s/sqrt(Hz): from a tactical unit to a phone on a rattling bracket."""
ACCEL_LIMITS: Final = (5e-4, 0.5)
"""The same for the accelerometers, m/s^2/sqrt(Hz)."""
STEPS: Final = (4.0, 2.0, math.sqrt(2.0))
"""Factors by which the search moves, one after the other; the likelihood is flat within the last one."""


class _Part:
    """The samples and epochs of a log within a span of time."""

    def __init__(self, data: SensorData, begin: float, end: float) -> None:
        imu = slice(*np.searchsorted(data.time, [begin, end]))
        gnss = slice(*np.searchsorted(data.gnss_time, [begin, end]))
        self.time, self.gyro, self.accel = data.time[imu], data.gyro[imu], data.accel[imu]
        self.gnss_time = data.gnss_time[gnss]
        self.velocity_ned = None if data.velocity_ned is None else data.velocity_ned[gnss]
        self.velocity_std = None if data.velocity_std is None else data.velocity_std[gnss]
        self.position_llh: FloatArray | None = None


def liveliest(data: SensorData) -> SensorData:
    """Return the part of `WINDOW` seconds in which the GNSS velocity changes most."""
    if data.velocity_ned is None or data.time[-1] - data.time[0] <= WINDOW:
        return data
    finite = np.isfinite(data.velocity_ned).all(axis=1)
    time = data.gnss_time[finite][1:]
    change = np.abs(np.diff(data.velocity_ned[finite, :2], axis=0)).sum(axis=1)
    total = np.concatenate([[0.0], np.cumsum(change)])
    begins = np.arange(data.time[0], data.time[-1] - WINDOW, 0.1 * WINDOW)
    within = total[np.searchsorted(time, begins + WINDOW)] - total[np.searchsorted(time, begins)]
    begin = float(begins[int(np.argmax(within))])
    return _Part(data, begin, begin + WINDOW)


def log_likelihood(data: SensorData, params: PhasorParams) -> float:
    """Return the mean log-likelihood of the velocity innovations; minus infinity where there is none."""
    zero = (0.0, 0.0, 0.0)
    smoother = SmootherF64(**params.kernel_arguments(), gyro_bias=zero, accel_bias=zero)
    try:
        run(smoother, data, with_sigma=False)
    except LogError:
        return -math.inf
    value = smoother.log_likelihood
    return value if math.isfinite(value) else -math.inf


def fit_noise(data: SensorData, params: NoiseParams | None = None) -> tuple[float, float]:
    """Return the noise densities of gyro and accelerometer that explain the log best.

    A pattern search over the two, from those of `params`. The velocity noise is what the log says (or `params`), the
    bias walks are those of `params`: a log of minutes cannot tell them.

    Parameters
    ----------
    data : SensorData
        The log.
    params : NoiseParams or FilterParams, optional
        Where to start, and everything else.

    Returns
    -------
    gyro_noise, accel_noise : float
        One-sided densities, rad/s/sqrt(Hz) and m/s^2/sqrt(Hz), the vibration included.
    """
    start = params or PhasorParams()
    names = (
        "min_course_speed",
        "gravity",
        "lever_arm",
        "gyro_bias_walk",
        "accel_bias_walk",
        "velocity_std",
        "latitude",
    )
    base = PhasorParams(**{name: getattr(start, name) for name in names if hasattr(start, name)})
    part = liveliest(data)
    seen: dict[tuple[float, float], float] = {}

    def value(point: tuple[float, float]) -> float:
        key = (round(math.log(point[0]), 6), round(math.log(point[1]), 6))
        if key not in seen:
            seen[key] = log_likelihood(part, replace(base, gyro_noise=point[0], accel_noise=point[1]))
        return seen[key]

    best = (start.gyro_noise, start.accel_noise)
    for step in STEPS:
        while True:
            gyro, accel = best
            moves = [(gyro * step, accel), (gyro / step, accel), (gyro, accel * step), (gyro, accel / step)]
            inside = [m for m in moves if _within(m[0], GYRO_LIMITS) and _within(m[1], ACCEL_LIMITS)]
            better = max(inside, key=value)
            if value(better) <= value(best):
                break
            best = better
    return best


def _within(value: float, limits: tuple[float, float]) -> bool:
    return limits[0] <= value <= limits[1]
