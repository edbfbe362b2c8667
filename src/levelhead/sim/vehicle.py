"""A vehicle on its path: attitude, velocity, angular rate, specific force and position at any array of times.

The body x axis is the direction of travel (its opposite in reverse): the reference point, where the IMU sits, does
not slip sideways. Rates and forces follow from the path exactly; nothing is differentiated numerically.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from levelhead.conventions import GRAVITY, FloatArray
from levelhead.sim.paths import Ground, Heading, SmoothSteps
from levelhead.sim.signals import Signal, sin_cos

CRUISE_SPEED: Final = 3.0
"""Speed of every scenario, m/s: a tractor at work."""

EARTH_RATE: Final = 7.292115e-5
"""Rotation of the Earth, rad/s (WGS-84)."""

_SEMI_MAJOR_AXIS: Final = 6378137.0
_ECCENTRICITY_SQUARED: Final = 6.69437999014e-3

_POSITION_STEP_S: Final = 0.25


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """The vehicle's motion at n times, relative to the Earth; body frame FRD, navigation frame NED.

    Attributes
    ----------
    roll, pitch, heading : ndarray, shape (n,)
        Attitude of the vehicle, rad; the heading is continuous, not wrapped.
    dcm_body_to_ned : ndarray, shape (n, 3, 3)
        The same attitude.
    velocity_ned, acceleration_ned : ndarray, shape (n, 3)
        m/s, and its rate of change in m/s^2.
    angular_rate : ndarray, shape (n, 3)
        Rate of the body relative to NED, rad/s, body axes.
    speed : ndarray, shape (n,)
        Along the body x axis, m/s; negative in reverse.
    """

    roll: FloatArray
    pitch: FloatArray
    heading: FloatArray
    dcm_body_to_ned: FloatArray
    velocity_ned: FloatArray
    acceleration_ned: FloatArray
    angular_rate: FloatArray
    speed: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Vehicle:
    """A drive: how fast, where to, over what ground.

    Parameters
    ----------
    speed : SmoothSteps
        Speed over time, m/s, negative in reverse. Its integral is the distance travelled.
    heading : callable
        Heading as a function of the path time (see `levelhead.sim.paths`).
    ground : callable
        Roll and pitch as a function of the path time and the heading.
    """

    speed: SmoothSteps
    heading: Heading
    ground: Ground

    def _attitude(self, time: FloatArray) -> tuple[Signal, Signal, Signal, Signal]:
        """Return speed, roll, pitch and heading at the given times."""
        distance, speed, slope = self.speed(time)
        path_time = Signal(distance, speed) / CRUISE_SPEED
        heading = self.heading(path_time)
        roll, pitch = self.ground(path_time, heading)
        return Signal(speed, slope), roll, pitch, heading

    def motion(self, time: FloatArray) -> Motion:
        """Return the motion at the given times (s), shape (n,)."""
        speed, roll, pitch, heading = self._attitude(time)
        (sin_roll, cos_roll), (sin_pitch, cos_pitch) = sin_cos(roll), sin_cos(pitch)
        sin_heading, cos_heading = sin_cos(heading)
        velocity = _velocity(speed, sin_pitch, cos_pitch, sin_heading, cos_heading)
        s_r, c_r, s_p, c_p = sin_roll.value, cos_roll.value, sin_pitch.value, cos_pitch.value
        s_h, c_h = sin_heading.value, cos_heading.value

        dcm = np.empty((time.size, 3, 3))
        dcm[:, 0, 0], dcm[:, 1, 0], dcm[:, 2, 0] = c_p * c_h, c_p * s_h, -s_p
        dcm[:, 0, 1], dcm[:, 1, 1], dcm[:, 2, 1] = s_r * s_p * c_h - c_r * s_h, s_r * s_p * s_h + c_r * c_h, s_r * c_p
        dcm[:, 0, 2], dcm[:, 1, 2], dcm[:, 2, 2] = c_r * s_p * c_h + s_r * s_h, c_r * s_p * s_h - s_r * c_h, c_r * c_p

        rate = np.empty((time.size, 3))  # the kinematics of the 3-2-1 Euler angles
        rate[:, 0] = roll.rate - heading.rate * s_p
        rate[:, 1] = pitch.rate * c_r + heading.rate * s_r * c_p
        rate[:, 2] = heading.rate * c_r * c_p - pitch.rate * s_r
        return Motion(
            roll=roll.value,
            pitch=pitch.value,
            heading=heading.value,
            dcm_body_to_ned=dcm,
            velocity_ned=np.stack([v.value for v in velocity], axis=1),
            acceleration_ned=np.stack([v.rate for v in velocity], axis=1),
            angular_rate=rate,
            speed=speed.value,
        )

    def position_llh(self, time: FloatArray, origin_llh: tuple[float, float, float]) -> FloatArray:
        """Return latitude, longitude (rad) and height (m) on WGS-84, shape (n, 3).

        The rates of the three are integrated from time 0, where the vehicle is at the origin, over nodes 0.25 s apart
        (Hermite quadrature and interpolation, off by 0.02 mm at most), so that any part of a long run can be had.
        """
        first = min(0, math.floor(float(time.min()) / _POSITION_STEP_S))
        last = math.ceil(float(time.max()) / _POSITION_STEP_S) + 1
        nodes = np.arange(first, last + 1, dtype=np.float64) * _POSITION_STEP_S
        speed, _, pitch, heading = self._attitude(nodes)
        north, east, down = _velocity(speed, *sin_cos(pitch), *sin_cos(heading))

        height = _integral(-down, -first, origin_llh[2])
        meridian, _ = radii(np.full(1, origin_llh[0]))
        # A first guess with the radius at the origin is enough to know how the radii change along the path.
        latitude = _integral(north / float(meridian[0] + origin_llh[2]), -first, origin_llh[0])
        meridian, normal = radii(latitude.value)
        latitude = _integral(north / Signal(meridian + height.value, height.rate), -first, origin_llh[0])
        radius_east = Signal(normal + height.value, height.rate) * sin_cos(latitude)[1]
        longitude = _integral(east / radius_east, -first, origin_llh[1])

        rates = (north / Signal(meridian + height.value, height.rate), east / radius_east, -down)
        sums = (latitude.value, longitude.value, height.value)
        return np.stack([_interpolate(time, nodes, s, r) for s, r in zip(sums, rates, strict=True)], axis=1)


def _velocity(
    speed: Signal, sin_pitch: Signal, cos_pitch: Signal, sin_heading: Signal, cos_heading: Signal
) -> tuple[Signal, Signal, Signal]:
    """Return the velocity along North, East and Down."""
    level = speed * cos_pitch
    return level * cos_heading, level * sin_heading, -(speed * sin_pitch)


def _integral(rate: Signal, zero: int, start: float) -> Signal:
    """Integrate over the position nodes (trapezoids with Euler-Maclaurin end corrections); `start` at node `zero`."""
    step = _POSITION_STEP_S
    pieces = 0.5 * step * (rate.value[1:] + rate.value[:-1]) - step**2 / 12.0 * np.diff(rate.rate)
    total = np.concatenate(([0.0], np.cumsum(pieces)))
    return Signal(total - total[zero] + start, rate.value)


def _interpolate(time: FloatArray, nodes: FloatArray, sums: FloatArray, rate: Signal) -> FloatArray:
    """Interpolate between the nodes with the quintic that agrees in value, rate and acceleration at both ends."""
    step = _POSITION_STEP_S
    k = np.clip(((time - nodes[0]) / step).astype(np.intp), 0, nodes.size - 2)
    x = (time - nodes[k]) / step
    v0, v1 = rate.value[k] * step, rate.value[k + 1] * step
    a0, a1 = rate.rate[k] * step**2, rate.rate[k + 1] * step**2
    gain = sums[k + 1] - sums[k]
    c3 = 10.0 * gain - 6.0 * v0 - 4.0 * v1 - 1.5 * a0 + 0.5 * a1
    c4 = -15.0 * gain + 8.0 * v0 + 7.0 * v1 + 1.5 * a0 - a1
    c5 = 6.0 * gain - 3.0 * (v0 + v1) - 0.5 * (a0 - a1)
    value: FloatArray = sums[k] + x * (v0 + x * (0.5 * a0 + x * (c3 + x * (c4 + x * c5))))
    return value


def radii(latitude: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the radii of curvature of WGS-84, m: along the meridian, and across it."""
    w = 1.0 - _ECCENTRICITY_SQUARED * np.sin(latitude) ** 2
    normal = _SEMI_MAJOR_AXIS / np.sqrt(w)
    return normal * (1.0 - _ECCENTRICITY_SQUARED) / w, normal


def inertial(motion: Motion, position_llh: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    """Return what ideal gyros and accelerometers along the body axes measure.

    Parameters
    ----------
    motion : Motion
        Of the vehicle, relative to the Earth.
    position_llh : ndarray, shape (n, 3), or None
        Where it is on the rotating Earth (Earth rate, transport rate and Coriolis force then count), or None for a
        flat Earth that stands still. Gravity is `levelhead.conventions.GRAVITY` along Down in both.

    Returns
    -------
    angular_rate, specific_force : ndarray, shape (n, 3)
        rad/s and m/s^2, body axes.
    """
    force = motion.acceleration_ned - np.array([0.0, 0.0, GRAVITY])
    rate = motion.angular_rate
    if position_llh is not None:
        latitude, height, velocity = position_llh[:, 0], position_llh[:, 2], motion.velocity_ned
        meridian, normal = radii(latitude)
        earth = EARTH_RATE * np.stack((np.cos(latitude), np.zeros_like(latitude), -np.sin(latitude)), axis=1)
        eastward = velocity[:, 1] / (normal + height)
        northward = velocity[:, 0] / (meridian + height)
        transport = np.stack((eastward, -northward, -eastward * np.tan(latitude)), axis=1)
        force = force + np.cross(2.0 * earth + transport, velocity)
        rate = rate + to_body(motion.dcm_body_to_ned, earth + transport)
    return rate, to_body(motion.dcm_body_to_ned, force)


def to_body(dcm_body_to_ned: FloatArray, vector_ned: FloatArray) -> FloatArray:
    """Turn NED vectors into body axes, shape (n, 3)."""
    turned: FloatArray = np.einsum("nij,ni->nj", dcm_body_to_ned, vector_ned)
    return turned


def to_ned(dcm_body_to_ned: FloatArray, vector: FloatArray) -> FloatArray:
    """Turn body vectors into NED axes, shape (n, 3)."""
    turned: FloatArray = np.einsum("nij,nj->ni", dcm_body_to_ned, vector)
    return turned
