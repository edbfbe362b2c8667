"""`Truth`: what really happened on a simulated drive, at the IMU and at any other point of the body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from levelhead.conventions import AXES, FloatArray
from levelhead.earth import shifted
from levelhead.errors import UsageError
from levelhead.sim.sensors import Triple
from levelhead.sim.vehicle import dcm_body_to_ned, to_ned


@dataclass(frozen=True, kw_only=True, eq=False)
class PointTruth:
    """Where a point of the body really was at each IMU sample.

    Attributes
    ----------
    position_llh : ndarray, shape (n, 3)
        Latitude, longitude (rad) and height (m), WGS-84.
    velocity_ned : ndarray, shape (n, 3)
        Relative to the Earth, m/s.
    """

    position_llh: FloatArray
    velocity_ned: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Truth:
    """What really happened at each IMU sample; body frame FRD, navigation frame NED, SI and radians.

    The body is the IMU: with a mounting rotation the attitude, rates, forces and biases are the IMU's, in its axes.

    Attributes
    ----------
    time : ndarray, shape (n,)
        When the samples were really taken, s; the log's stamps but for their jitter.
    gyro_bias, accel_bias : ndarray, shape (n, 3)
        Biases in the readings, rad/s and m/s^2.
    roll, pitch, heading : ndarray, shape (n,)
        Attitude relative to NED, rad; roll and heading within (-pi, pi].
    velocity_ned : ndarray, shape (n, 3)
        Velocity of the IMU, m/s.
    position_llh : ndarray, shape (n, 3)
        Latitude, longitude (rad) and height (m) of the IMU, WGS-84.
    angular_rate, specific_force : ndarray, shape (n, 3)
        What perfect sensors would read, rad/s and m/s^2, without vibration. With Earth rotation the angular rate is
        the inertial one.
    relative_rate : ndarray, shape (n, 3), optional
        Angular rate relative to NED, rad/s, body axes; absent where it is `angular_rate` itself, the Earth standing
        still.
    """

    time: FloatArray
    gyro_bias: FloatArray
    accel_bias: FloatArray
    roll: FloatArray
    pitch: FloatArray
    heading: FloatArray
    velocity_ned: FloatArray
    position_llh: FloatArray
    angular_rate: FloatArray
    specific_force: FloatArray
    relative_rate: FloatArray | None = None

    def at(self, point: Triple) -> PointTruth:
        """Return position and velocity of another point of the body.

        Parameters
        ----------
        point : (float, float, float)
            From the IMU, m, along the IMU's axes: where it is mounted askew these are not the vehicle's.

        Returns
        -------
        PointTruth
            Of the rigid body, but for the Earth's curvature between IMU and point: below 1e-5 m over 10 m, and a
            fraction of 2e-6 of the speed.
        """
        arm = np.asarray(point, dtype=np.float64)
        if arm.shape != (3,) or not np.isfinite(arm).all():
            raise UsageError(f"The point is {point}; give three finite numbers in m, from the IMU along its axes.")
        rate = self.angular_rate if self.relative_rate is None else self.relative_rate
        dcm = dcm_body_to_ned(self.roll, self.pitch, self.heading)
        return PointTruth(
            position_llh=shifted(self.position_llh, dcm @ arm),
            velocity_ned=self.velocity_ned + to_ned(dcm, np.cross(rate, arm)),
        )

    def columns(self) -> dict[str, FloatArray]:
        """Return everything as flat columns of shape (n,), named as in `result.parquet`, SI and radians."""
        table = {"time": self.time}
        for name in ("gyro_bias", "accel_bias"):
            table |= _split(name, AXES, getattr(self, name))
        table |= {"roll": self.roll, "pitch": self.pitch, "heading": self.heading}
        table |= _split("velocity", ("n", "e", "d"), self.velocity_ned)
        table |= dict(zip(("latitude", "longitude", "height"), self.position_llh.T, strict=True))
        for name in ("angular_rate", "specific_force"):
            table |= _split(name, AXES, getattr(self, name))
        if self.relative_rate is not None:
            table |= _split("relative_rate", AXES, self.relative_rate)
        return table


def _split(name: str, suffixes: tuple[str, ...], rows: FloatArray) -> dict[str, FloatArray]:
    return {f"{name}_{suffix}": column for suffix, column in zip(suffixes, rows.T, strict=True)}
