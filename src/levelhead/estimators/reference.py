"""A point of the vehicle away from the IMU: where it is and how it moves, and what the slope does to it.

A roof antenna 3 m up moves 26 cm sideways with 5 deg of roll; what a farmer steers is on the ground (Tereshkov 2015,
section 1). From the IMU's position and velocity follow p + C r and v + C (w x r).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from levelhead.conventions import FloatArray
from levelhead.earth import shifted
from levelhead.errors import UsageError
from levelhead.estimators.base import ReferencePoint, Result, SensorData
from levelhead.estimators.params import Triple, lever

Vector = Triple | FloatArray
"""Three components: numbers, or rows (3, n)."""


def levelled(roll: FloatArray, pitch: FloatArray, body: Vector) -> FloatArray:
    """Turn a body vector by roll and pitch: its components ahead, to the right and down (3, n), in the level frame."""
    sin_roll, cos_roll, sin_pitch, cos_pitch = np.sin(roll), np.cos(roll), np.sin(pitch), np.cos(pitch)
    x, y, z = body
    right, down = y * cos_roll - z * sin_roll, y * sin_roll + z * cos_roll
    turned: FloatArray = np.stack([x * cos_pitch + down * sin_pitch, right, down * cos_pitch - x * sin_pitch])
    return turned


def in_ned(roll: FloatArray, pitch: FloatArray, heading: FloatArray, body: Vector) -> FloatArray:
    """Turn a body vector into the navigation frame: North, East, Down (n, 3)."""
    level, sine, cosine = levelled(roll, pitch, body), np.sin(heading), np.cos(heading)
    ned: FloatArray = np.stack(
        [level[0] * cosine - level[1] * sine, level[0] * sine + level[1] * cosine, level[2]], axis=1
    )
    return ned


def _spread(own: FloatArray, arm_ned: FloatArray, tilt: FloatArray, heading: FloatArray) -> FloatArray:
    """Return one sigma (n, 3) of a place or velocity at the end of an arm, whose tilt and heading are not sure."""
    north, east, down = arm_ned.T
    level = (down * tilt) ** 2
    variance = own**2 + np.stack(
        [level + (east * heading) ** 2, level + (north * heading) ** 2, (north**2 + east**2) * tilt**2], axis=1
    )
    sigma: FloatArray = np.sqrt(variance)
    return sigma


def with_reference(result: Result, data: SensorData, point: Triple, lever_arm: Triple) -> Result:
    """Return the result with what is known about a point of the vehicle.

    Parameters
    ----------
    result : Result
        Of a method that estimates positions or velocities.
    data : SensorData
        The log that it was estimated from; its gyros tell how the point swings.
    point : (3,)
        From the IMU to the point, body axes, m.
    lever_arm : (3,)
        From the IMU to the antenna, body axes, m: `cross_track` and `height` of the result are what the slope does
        between antenna and point.

    Raises
    ------
    UsageError
        When the point is not three lengths within 50 m, or the method does not estimate a position.
    """
    arm = lever("reference_point", point)
    if result.position_llh is not None and result.position_std is None:
        raise UsageError(
            f"The method {result.method!r} estimates no position, so none of a reference point; use 'smoother' or "
            "'phasor'."
        )
    tilt, heading = result.attitude_std[:, 1], result.attitude_std[:, 2]
    place = in_ned(result.roll, result.pitch, result.heading, arm)
    rate = data.gyro - result.gyro_bias
    swing = np.cross(rate, np.array(arm))
    moving = in_ned(result.roll, result.pitch, result.heading, swing.T)
    # What the gyro bias leaves unsure of the swing is the same in all directions, within the arm's length.
    drift = np.linalg.norm(arm) * np.nanmax(result.gyro_bias_std, axis=1)
    own = np.sqrt(result.velocity_std**2 + drift[:, None] ** 2)
    position = position_std = None
    if result.position_llh is not None and result.position_std is not None:
        position = shifted(result.position_llh, place)
        position_std = _spread(result.position_std, place, tilt, heading)
    from_antenna = np.array(arm) - np.array(lever_arm)
    _, right, down = levelled(result.roll, result.pitch, from_antenna)
    found = ReferencePoint(
        point=arm,
        position_llh=position,
        position_std=position_std,
        velocity_ned=result.velocity_ned + moving,
        velocity_std=_spread(own, moving, tilt, heading),
        cross_track=right - from_antenna[1],
        height=from_antenna[2] - down,
    )
    return replace(result, reference=found)
