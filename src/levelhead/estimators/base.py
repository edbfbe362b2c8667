"""What every estimator takes and gives: `SensorData` in, `Result` out, with `Status` flags per sample."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from levelhead.conventions import FloatArray, StatusArray
from levelhead.events import Event
from levelhead.version import __version__


class Status(enum.IntFlag):
    """State of an estimator at one sample; the values are those of the C++ header `status.hpp`."""

    INITIALIZING = 1
    """The attitude is not known yet: the platform is still collecting its first seconds."""
    ALIGNING = 2
    """Roll and pitch are known, the heading is not: no trustworthy course has been seen yet."""
    COASTING = 4
    """No GNSS correction is at work: the attitude follows the gyros alone, the biases are held."""
    REVERSE = 8
    """The vehicle drives backwards; the course is turned round."""
    GYRO_SETTLED = 16
    """The driving so far has taught the gyro biases to within 5 % of the initial errors."""
    ACCEL_SETTLED = 32
    """The driving so far has taught the horizontal accelerometer biases."""
    ACCEL_UNOBSERVABLE = 64
    """Hardly any turning so far: the accelerometer biases cannot be told from tilt."""
    UNSEPARATED = 128
    """Turning at a constant rate so far: gyro and accelerometer biases cannot be told apart."""
    HEADING_SETTLED = 256
    """The course has steered the heading for three time constants: heading and vertical gyro bias are known."""


class SensorData(Protocol):
    """The arrays that an estimator reads; `levelhead.Log` has them."""

    @property
    def time(self) -> FloatArray:
        """Stamps of the IMU samples (n,), s."""
        ...

    @property
    def gyro(self) -> FloatArray:
        """Angular rate readings (n, 3), rad/s, body FRD."""
        ...

    @property
    def accel(self) -> FloatArray:
        """Specific force readings (n, 3), m/s^2, body FRD."""
        ...

    @property
    def gnss_time(self) -> FloatArray:
        """Stamps of the GNSS epochs (m,), s."""
        ...

    @property
    def velocity_ned(self) -> FloatArray | None:
        """GNSS velocity (m, 3), m/s, or None."""
        ...

    @property
    def velocity_std(self) -> FloatArray | None:
        """Its one sigma (m,) or (m, 3), m/s, or None."""
        ...

    @property
    def position_llh(self) -> FloatArray | None:
        """GNSS position (m, 3), rad, rad, m, or None."""
        ...


def _list(row: FloatArray, scale: float = 1.0) -> list[float | None]:
    """Turn a row into JSON: numbers, and None for NaN."""
    return [float(v) if np.isfinite(v) else None for v in row * scale]


@dataclass(frozen=True, kw_only=True, eq=False)
class Result:
    """Estimates at every IMU sample; body frame FRD, navigation frame NED, SI and radians.

    Attributes
    ----------
    time : ndarray, shape (n,)
        The IMU's time stamps, s.
    gyro_bias, accel_bias : ndarray, shape (n, 3)
        Bias estimates, rad/s and m/s^2, body frame; NaN where the method does not estimate an axis.
    gyro_bias_std, accel_bias_std : ndarray, shape (n, 3)
        One sigma; NaN where the method gives none.
    roll, pitch, heading : ndarray, shape (n,)
        Attitude of the body frame relative to NED, rad. Heading is NaN before the first course.
    attitude_std : ndarray, shape (n, 3)
        One sigma of roll, pitch, heading, rad; NaN where the method gives none.
    velocity_ned : ndarray, shape (n, 3)
        Velocity at the IMU's stamps, m/s; NaN before the first GNSS epoch.
    position_llh : ndarray, shape (n, 3), or None
        GNSS positions interpolated to the IMU's stamps (rad, rad, m), or None without positions.
    status : ndarray, shape (n,), uint32
        `Status` flags.
    """

    time: FloatArray
    gyro_bias: FloatArray
    accel_bias: FloatArray
    gyro_bias_std: FloatArray
    accel_bias_std: FloatArray
    roll: FloatArray
    pitch: FloatArray
    heading: FloatArray
    attitude_std: FloatArray
    velocity_ned: FloatArray
    position_llh: FloatArray | None
    status: StatusArray
    method: str
    params: Mapping[str, object]
    known_gyro: tuple[bool, bool, bool]
    known_accel: tuple[bool, bool, bool]
    settled_at_s: Mapping[str, float | None]
    log_info: Mapping[str, object] = field(default_factory=dict)
    events: tuple[Event, ...] = ()
    runtime_s: Mapping[str, float] = field(default_factory=dict)

    def summary(self) -> dict[str, object]:
        """Return the content of `summary.json`: the biases at the end of the log and how far to trust them."""
        deg = 180.0 / np.pi
        known = {"gyro": list(self.known_gyro), "accel": list(self.known_accel)}

        def masked(row: FloatArray, flags: tuple[bool, bool, bool], scale: float = 1.0) -> list[float | None]:
            return [v if k else None for v, k in zip(_list(row, scale), flags, strict=True)]

        return {
            "levelhead": __version__,
            "log": dict(self.log_info),
            "method": self.method,
            "params": dict(self.params),
            "gyro_bias_deg_s": masked(self.gyro_bias[-1], self.known_gyro, deg),
            "gyro_bias_std_deg_s": masked(self.gyro_bias_std[-1], self.known_gyro, deg),
            "accel_bias_m_s2": masked(self.accel_bias[-1], self.known_accel),
            "accel_bias_std_m_s2": masked(self.accel_bias_std[-1], self.known_accel),
            "known": known,
            "settled_at_s": dict(self.settled_at_s),
            "mounting": {"yaw_deg": None, "roll_deg": None, "pitch_deg": None},
            "latency_s": None,
            "events": [event.as_dict() for event in self.events],
            "runtime_s": dict(self.runtime_s),
        }
