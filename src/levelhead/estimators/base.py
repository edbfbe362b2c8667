"""What every estimator takes and gives: `SensorData` in, `Result` out, with `Status` flags per sample."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

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
    STATIONARY = 512
    """The filter has found the vehicle at rest: velocity and angular rate are taken as zero."""
    COURSE = 1024
    """The heading was steered by the course (or by the axle that does not slide) within the last interval."""


class HeadingSource(enum.IntEnum):
    """Where the heading of a sample comes from."""

    NONE = 0
    """Not known yet."""
    COURSE = 1
    """The direction of travel corrects the gyros."""
    REVERSE = 2
    """The same, driving backwards."""
    STATIONARY = 3
    """The vehicle stands: the heading is held."""
    INERTIAL = 4
    """The gyros carry it on: too slow for a course, or no GNSS."""


def heading_source(status: StatusArray) -> NDArray[np.uint8]:
    """Return the `HeadingSource` (n,) that status flags (n,) tell of."""

    def has(flag: Status) -> NDArray[np.bool_]:
        found: NDArray[np.bool_] = (status & np.uint32(flag)) != 0
        return found

    source = np.full(status.shape, HeadingSource.INERTIAL, dtype=np.uint8)
    source[has(Status.STATIONARY)] = HeadingSource.STATIONARY
    source[has(Status.COURSE)] = HeadingSource.COURSE
    source[has(Status.COURSE) & has(Status.REVERSE)] = HeadingSource.REVERSE
    source[has(Status.INITIALIZING | Status.ALIGNING)] = HeadingSource.NONE
    return source


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

    @property
    def position_std(self) -> FloatArray | None:
        """Its one sigma (m,) or (m, 3), m, or None."""
        ...

    @property
    def wheel_speed(self) -> FloatArray | None:
        """Speed that the wheels tell at the IMU's stamps (n,), m/s, NaN where none, or None."""
        ...


def _list(row: FloatArray, scale: float = 1.0) -> list[float | None]:
    """Turn a row into JSON: numbers, and None for NaN."""
    return [float(v) if np.isfinite(v) else None for v in row * scale]


@dataclass(frozen=True, kw_only=True, eq=False)
class ReferencePoint:
    """What is known about a point of the vehicle away from the IMU, at every IMU sample.

    Attributes
    ----------
    point : (3,)
        From the IMU to the point, body axes, m.
    position_llh : ndarray, shape (n, 3), or None
        Latitude (rad), longitude (rad), height (m) of the point; None without positions.
    position_std : ndarray, shape (n, 3), or None
        One sigma along North, East, Down, m, with what follows from the sigma of tilt and heading.
    velocity_ned, velocity_std : ndarray, shape (n, 3)
        Velocity of the point and one sigma, m/s.
    cross_track, height : ndarray, shape (n,)
        What the slope moves the point by, seen from the antenna, m: to the right of the heading, and up, over where a
        level vehicle would have it.
    """

    point: tuple[float, float, float]
    position_llh: FloatArray | None
    position_std: FloatArray | None
    velocity_ned: FloatArray
    velocity_std: FloatArray
    cross_track: FloatArray
    height: FloatArray


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
    velocity_std : ndarray, shape (n, 3)
        One sigma along North, East, Down, m/s; NaN where the method gives none.
    position_llh : ndarray, shape (n, 3), or None
        Position of the IMU (rad, rad, m) where the method estimates it, else the antenna's from GNSS, interpolated to
        the IMU's stamps; None without positions.
    position_std : ndarray, shape (n, 3), or None
        One sigma along North, East, Down, m; None where the method does not estimate positions.
    reference : ReferencePoint or None
        The point of the vehicle that was asked for.
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
    velocity_std: FloatArray
    position_llh: FloatArray | None
    position_std: FloatArray | None
    status: StatusArray
    method: str
    params: Mapping[str, object]
    known_gyro: tuple[bool, bool, bool]
    known_accel: tuple[bool, bool, bool]
    settled_at_s: Mapping[str, float | None]
    log_info: Mapping[str, object] = field(default_factory=dict)
    events: tuple[Event, ...] = ()
    runtime_s: Mapping[str, float] = field(default_factory=dict)
    reference: ReferencePoint | None = None

    @property
    def heading_source(self) -> NDArray[np.uint8]:
        """Where the heading comes from at each sample (n,): values of `HeadingSource`."""
        return heading_source(self.status)

    def summary(self) -> dict[str, object]:
        """Return the content of `summary.json`: the biases at the end of the log and how far to trust them."""
        from levelhead.estimators.navigation import navigation_summary  # it is made of this module's classes

        deg = 180.0 / np.pi
        known = {"gyro": list(self.known_gyro), "accel": list(self.known_accel)}

        # What the log's preflight found stands beside the log, not in it.
        log = dict(self.log_info)
        latency, mounting, preflight = (log.pop(name, None) for name in ("latency_s", "mounting_deg", "preflight"))
        angles: Mapping[str, object] = mounting if isinstance(mounting, Mapping) else {}

        def masked(row: FloatArray, flags: tuple[bool, bool, bool], scale: float = 1.0) -> list[float | None]:
            return [v if k else None for v, k in zip(_list(row, scale), flags, strict=True)]

        return {
            "levelhead": __version__,
            "log": log,
            "method": self.method,
            "params": dict(self.params),
            "gyro_bias_deg_s": masked(self.gyro_bias[-1], self.known_gyro, deg),
            "gyro_bias_std_deg_s": masked(self.gyro_bias_std[-1], self.known_gyro, deg),
            "accel_bias_m_s2": masked(self.accel_bias[-1], self.known_accel),
            "accel_bias_std_m_s2": masked(self.accel_bias_std[-1], self.known_accel),
            "known": known,
            "settled_at_s": dict(self.settled_at_s),
            "mounting": {f"{name}_deg": angles.get(name) for name in ("yaw", "roll", "pitch")},
            "latency_s": latency,
            "preflight": preflight,
            "navigation": navigation_summary(self),
            "events": [event.as_dict() for event in self.events],
            "runtime_s": dict(self.runtime_s),
        }
