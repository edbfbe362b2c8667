"""What readers share of receivers: velocity by speed and course, a vertical velocity that nobody measured, sigmas."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import FloatArray
from levelhead.events import Event

VERTICAL_STD: Final = 0.05
MIN_VERTICAL_STD: Final = 0.5
"""What a vehicle's unknown vertical velocity is taken for: zero, give or take this share of its speed (a road of 5 %
changes the height by so much), or this, m/s."""


def velocity_of(speed: FloatArray, course: FloatArray) -> FloatArray:
    """Return velocities NED (m, 3), m/s, of speeds over ground and courses (rad, North by East); none of them down."""
    return np.column_stack((speed * np.cos(course), speed * np.sin(course), np.zeros(speed.size)))


def unmeasured_vertical_std(speed: FloatArray) -> FloatArray:
    """Return the sigma of a vertical velocity that was taken as zero because the receiver tells none, m/s."""
    wide: FloatArray = np.maximum(MIN_VERTICAL_STD, VERTICAL_STD * speed)
    return wide


def without_vertical(
    velocity: FloatArray, std: FloatArray, unknown: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray, tuple[Event, ...]]:
    """Return velocity and sigma (m, 3), m/s, NED, and an event, where the receiver tells no vertical velocity.

    It is then zero with a wide sigma: a vehicle drives along the ground.
    """
    unknown = unknown & np.isfinite(velocity[:, :2]).all(axis=1)
    if not unknown.any():
        return velocity, std, ()
    velocity, std = velocity.copy(), std.copy()
    velocity[unknown, 2] = 0.0
    std[unknown, 2] = unmeasured_vertical_std(np.hypot(velocity[unknown, 0], velocity[unknown, 1]))
    return velocity, std, (Event(code="I_VELOCITY_2D", count=int(unknown.sum())),)


def held_height(velocity: FloatArray, std: FloatArray, flat: NDArray[np.bool_]) -> FloatArray:
    """Return sigmas (m, 3) in which the vertical one of solutions that held the height, `flat`, is a wide one."""
    std = std.copy()
    wide = unmeasured_vertical_std(np.hypot(velocity[flat, 0], velocity[flat, 1]))
    std[flat, 2] = np.fmax(std[flat, 2], wide)
    return std


def known_std(std: FloatArray) -> FloatArray:
    """Return sigmas, NaN where they are not positive: formats write 0 or -1 where none is known."""
    return np.where((std > 0.0) & np.isfinite(std), std, np.nan)


def dropped(count: int, what: str) -> tuple[Event, ...]:
    """Return the event that so many records were left out, "12 GNSS epochs without a fix."; none of none."""
    return (Event(code="W_DROPPED", count=count, detail=f"{count} {what}."),) if count else ()
