"""A vehicle on its path: attitude, velocity, angular rate, specific force and position at any array of times.

The body x axis is the direction of travel (its opposite in reverse), but for the slip angle of a vehicle that crabs.
That holds for the point that does not slip sideways, between the wheels that do not steer; here it is called the axle.
Any other point of the body swings round it. Rates and forces, those of such a point too, follow from the path
exactly; nothing is differentiated numerically.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from levelhead.conventions import GRAVITY, FloatArray
from levelhead.earth import normal_gravity, radii, turning_of_ned
from levelhead.sim.paths import Ground, Heading, SmoothSteps
from levelhead.sim.signals import Signal, sin_cos

CRUISE_SPEED: Final = 3.0
"""Speed of every scenario unless another is asked for, m/s: a tractor at work."""

Point = tuple[float, float, float]

AXLE: Final[Point] = (0.0, 0.0, 0.0)
"""The point that does not slip sideways; other points are given in m from it, vehicle axes (forward, right, down)."""

_POSITION_STEP_S: Final = 0.25


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """The motion of a point of the vehicle at n times, relative to the Earth; body frame FRD, navigation frame NED.

    Attributes
    ----------
    roll, pitch, heading : ndarray, shape (n,)
        Attitude of the vehicle, rad; the heading is continuous, not wrapped.
    dcm_body_to_ned : ndarray, shape (n, 3, 3)
        The same attitude.
    velocity_ned, acceleration_ned : ndarray, shape (n, 3)
        Of the point, m/s, and its rate of change in m/s^2.
    angular_rate : ndarray, shape (n, 3)
        Rate of the body relative to NED, rad/s, body axes.
    forward_speed : ndarray, shape (n,)
        Of the axle along the body x axis, m/s; negative in reverse. The wheels that do not steer roll at this speed.
    """

    roll: FloatArray
    pitch: FloatArray
    heading: FloatArray
    dcm_body_to_ned: FloatArray
    velocity_ned: FloatArray
    acceleration_ned: FloatArray
    angular_rate: FloatArray
    forward_speed: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Vehicle:
    """A drive: how fast, where to, over what ground.

    Parameters
    ----------
    speed : SmoothSteps
        Speed over time, m/s, negative in reverse. Its integral over the cruise speed is the path time.
    heading : callable
        Heading as a function of the path time (see `levelhead.sim.paths`).
    ground : callable
        Roll and pitch as a function of the path time and the heading.
    slip : callable, optional
        Angle in the vehicle's floor from the x axis to the velocity of the axle, rad, as a function of the path time;
        none where absent.
    pace : float
        Every speed is multiplied by this, with heading, ground and slip as they were at every time: the same turn
        rates on larger radii.
    """

    speed: SmoothSteps
    heading: Heading
    ground: Ground
    slip: Heading | None = None
    pace: float = 1.0

    def motion(self, time: FloatArray, point: Point = AXLE) -> Motion:
        """Return the motion of a point of the body at the given times (s), shape (n,).

        Force and velocity of the point agree exactly. On the round Earth its velocity and its position drift apart by
        the speed times the distance from the axle over the Earth's radius: 1e-6 m/s for 2 m at 3 m/s.
        """
        distance, speed, slope = self.speed(time)
        path_time = Signal(distance, speed, slope) / CRUISE_SPEED
        heading = self.heading(path_time)
        roll, pitch = self.ground(path_time, heading)
        trig = (*sin_cos(roll), *sin_cos(pitch), *sin_cos(heading))

        forward = Signal(speed, slope) * self.pace
        slip = None if self.slip is None else self.slip(path_time)
        velocity = _velocity_ahead(forward, *trig[2:])
        if slip is not None:
            velocity, forward = _velocity_aslant(forward, slip, *trig)
        velocity_ned = np.stack([v.value for v in velocity], axis=1)
        acceleration_ned = np.stack([v.rate for v in velocity], axis=1)

        dcm = dcm_body_to_ned(roll.value, pitch.value, heading.value)
        rates = _body_rates(roll, pitch, heading, *trig[:4])
        angular_rate = np.stack([r.value for r in rates], axis=1)
        if any(point):
            angular_acceleration = np.stack([r.rate for r in rates], axis=1)
            swing = np.cross(angular_rate, point)
            velocity_ned += to_ned(dcm, swing)
            # Euler and centripetal acceleration.
            acceleration_ned += to_ned(dcm, np.cross(angular_acceleration, point) + np.cross(angular_rate, swing))
        return Motion(
            roll=roll.value,
            pitch=pitch.value,
            heading=heading.value,
            dcm_body_to_ned=dcm,
            velocity_ned=velocity_ned,
            acceleration_ned=acceleration_ned,
            angular_rate=angular_rate,
            forward_speed=forward.value,
        )

    def position_llh(self, time: FloatArray, origin_llh: tuple[float, float, float]) -> FloatArray:
        """Return latitude, longitude (rad) and height (m) of the axle on WGS-84, shape (n, 3).

        The rates of the three are integrated from time 0, where the axle is at the origin, over nodes 0.25 s apart
        (Hermite quadrature and interpolation, off by 0.02 mm at most at 3 m/s), so that any part of a long run can be
        had. Where another point of the body is, `levelhead.earth.shifted` tells.
        """
        # The error goes with the speed and the fourth power of the step: half the step does up to sixteen times.
        step = _POSITION_STEP_S if self.pace <= 1.0 else 0.5 * _POSITION_STEP_S
        first = min(0, math.floor(float(time.min()) / step))
        last = math.ceil(float(time.max()) / step) + 1
        nodes = np.arange(first, last + 1, dtype=np.float64) * step
        motion = self.motion(nodes)
        north, east, down = (
            Signal(v, a) for v, a in zip(motion.velocity_ned.T, motion.acceleration_ned.T, strict=True)
        )
        zero = -first
        start_latitude, start_longitude, start_height = origin_llh

        height = _integral(-down, step, zero, start_height)
        meridian, _ = radii(np.full(1, start_latitude))
        # A first guess with the radius at the origin is enough to know how the radii change along the path.
        latitude = _integral(north / float(meridian[0] + start_height), step, zero, start_latitude)
        meridian, normal = radii(latitude.value)
        latitude = _integral(north / Signal(meridian + height.value, height.rate), step, zero, start_latitude)
        radius_east = Signal(normal + height.value, height.rate) * sin_cos(latitude)[1]
        longitude = _integral(east / radius_east, step, zero, start_longitude)

        rates = (north / Signal(meridian + height.value, height.rate), east / radius_east, -down)
        sums = (latitude.value, longitude.value, height.value)
        return np.stack([_interpolate(time, nodes, s, r) for s, r in zip(sums, rates, strict=True)], axis=1)


def _velocity_ahead(
    speed: Signal, sin_pitch: Signal, cos_pitch: Signal, sin_heading: Signal, cos_heading: Signal
) -> tuple[Signal, Signal, Signal]:
    """Return the velocity along North, East and Down of a vehicle that moves where it points."""
    level = speed * cos_pitch
    return level * cos_heading, level * sin_heading, -(speed * sin_pitch)


def _velocity_aslant(
    speed: Signal,
    slip: Signal,
    sin_roll: Signal,
    cos_roll: Signal,
    sin_pitch: Signal,
    cos_pitch: Signal,
    sin_heading: Signal,
    cos_heading: Signal,
) -> tuple[tuple[Signal, Signal, Signal], Signal]:
    """Return the velocity along North, East and Down of a vehicle that slips, and its part along the x axis."""
    sin_slip, cos_slip = sin_cos(slip)
    forward, right = speed * cos_slip, speed * sin_slip
    north, east, down = _velocity_ahead(forward, sin_pitch, cos_pitch, sin_heading, cos_heading)
    tilted = sin_roll * sin_pitch
    north = north + right * (tilted * cos_heading - cos_roll * sin_heading)
    east = east + right * (tilted * sin_heading + cos_roll * cos_heading)
    return (north, east, down + right * (sin_roll * cos_pitch)), forward


def _body_rates(
    roll: Signal,
    pitch: Signal,
    heading: Signal,
    sin_roll: Signal,
    cos_roll: Signal,
    sin_pitch: Signal,
    cos_pitch: Signal,
) -> tuple[Signal, Signal, Signal]:
    """Return the rate of the body relative to NED, along the body axes: the kinematics of the 3-2-1 Euler angles."""
    rolling, pitching, turning = roll.derivative(), pitch.derivative(), heading.derivative()
    return (
        rolling - turning * sin_pitch,
        pitching * cos_roll + turning * sin_roll * cos_pitch,
        turning * cos_roll * cos_pitch - pitching * sin_roll,
    )


def _integral(rate: Signal, step: float, zero: int, start: float) -> Signal:
    """Integrate over the position nodes (trapezoids with Euler-Maclaurin end corrections); `start` at node `zero`."""
    pieces = 0.5 * step * (rate.value[1:] + rate.value[:-1]) - step**2 / 12.0 * np.diff(rate.rate)
    total = np.concatenate(([0.0], np.cumsum(pieces)))
    return Signal(total - total[zero] + start, rate.value)


def _interpolate(time: FloatArray, nodes: FloatArray, sums: FloatArray, rate: Signal) -> FloatArray:
    """Interpolate between the nodes with the quintic that agrees in value, rate and acceleration at both ends."""
    step = float(nodes[1] - nodes[0])
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


def inertial(motion: Motion, position_llh: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    """Return what ideal gyros and accelerometers along the body axes measure.

    Parameters
    ----------
    motion : Motion
        Of the vehicle, relative to the Earth.
    position_llh : ndarray, shape (n, 3), or None
        Where it is on the rotating Earth: Earth rate, transport rate, Coriolis force and normal gravity there count.
        None stands for a flat Earth that stands still, with `levelhead.conventions.GRAVITY` everywhere. Gravity is
        along Down in both.

    Returns
    -------
    angular_rate, specific_force : ndarray, shape (n, 3)
        rad/s and m/s^2, body axes.
    """
    if position_llh is None:
        return motion.angular_rate, to_body(motion.dcm_body_to_ned, motion.acceleration_ned - [0.0, 0.0, GRAVITY])
    force = motion.acceleration_ned.copy()
    force[:, 2] -= normal_gravity(position_llh[:, 0], position_llh[:, 2])
    earth, transport = turning_of_ned(position_llh, motion.velocity_ned)
    force += np.cross(2.0 * earth + transport, motion.velocity_ned)
    rate = motion.angular_rate + to_body(motion.dcm_body_to_ned, earth + transport)
    return rate, to_body(motion.dcm_body_to_ned, force)


def dcm_body_to_ned(roll: FloatArray, pitch: FloatArray, heading: FloatArray) -> FloatArray:
    """Return body-to-NED matrices, shape (n, 3, 3), of 3-2-1 Euler angles in rad, each of shape (n,)."""
    (s_r, c_r), (s_p, c_p), (s_h, c_h) = ((np.sin(angle), np.cos(angle)) for angle in (roll, pitch, heading))
    dcm = np.empty((roll.size, 3, 3))
    dcm[:, 0, 0], dcm[:, 1, 0], dcm[:, 2, 0] = c_p * c_h, c_p * s_h, -s_p
    dcm[:, 0, 1], dcm[:, 1, 1], dcm[:, 2, 1] = s_r * s_p * c_h - c_r * s_h, s_r * s_p * s_h + c_r * c_h, s_r * c_p
    dcm[:, 0, 2], dcm[:, 1, 2], dcm[:, 2, 2] = c_r * s_p * c_h + s_r * s_h, c_r * s_p * s_h - s_r * c_h, c_r * c_p
    return dcm


def to_body(dcm_body_to_ned: FloatArray, vector_ned: FloatArray) -> FloatArray:
    """Turn NED vectors into body axes, shape (n, 3)."""
    turned: FloatArray = np.einsum("nij,ni->nj", dcm_body_to_ned, vector_ned)
    return turned


def to_ned(dcm_body_to_ned: FloatArray, vector: FloatArray) -> FloatArray:
    """Turn body vectors into NED axes, shape (n, 3)."""
    turned: FloatArray = np.einsum("nij,nj->ni", dcm_body_to_ned, vector)
    return turned
