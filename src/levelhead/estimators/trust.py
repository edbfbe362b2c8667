"""How far the end of a run can be trusted without a covariance: what was observable, and what still wandered."""

from __future__ import annotations

from typing import Final

import numpy as np

from levelhead.conventions import AXES, FloatArray, StatusArray
from levelhead.estimators.base import Status
from levelhead.events import Event

Flags = tuple[bool, bool, bool]

WATCHED: Final = 120.0
"""The end of the run that is watched: three of the papers' slow time constants, s."""
GYRO_BAND: Final = float(np.radians(0.02))
"""An estimate that moves within plus and minus this counts as steady, rad/s."""
ACCEL_BAND: Final = 0.04
"""The same for the accelerometer, m/s^2."""
LOST_BANDS: Final = 2.0
"""One that moves by more than this many bands is not known, whatever the driving could have taught."""


def first_settled(time: FloatArray, status: StatusArray, flag: Status) -> float | None:
    """Return the time since the start at which a flag was set for good, or None."""
    set_ = (status & int(flag)) != 0
    if not set_[-1]:
        return None
    unset = np.flatnonzero(~set_)
    return float(time[unset[-1] + 1] - time[0]) if unset.size else 0.0


def observable(last: Status, vertical: int) -> tuple[Flags, Flags]:
    """Return which gyro and accelerometer axes the driving has taught; `vertical` is the axis nearest to it."""
    gyro, accel = Status.GYRO_SETTLED in last, Status.ACCEL_SETTLED in last
    course = Status.HEADING_SETTLED in last
    gyro_flags = [course if axis == vertical else gyro for axis in range(3)]
    accel_flags = [accel and axis != vertical for axis in range(3)]
    return (gyro_flags[0], gyro_flags[1], gyro_flags[2]), (accel_flags[0], accel_flags[1], accel_flags[2])


def wander(time: FloatArray, estimate: FloatArray) -> FloatArray:
    """Return half of the peak-to-peak change (3,) of an estimate (n, 3) over the watched end of the run."""
    end = estimate[np.searchsorted(time, time[-1] - WATCHED) :]
    half: FloatArray = 0.5 * (end.max(axis=0) - end.min(axis=0))
    return half


def steady(known: Flags, moved: FloatArray, band: float) -> Flags:
    """Return the known axes without those that moved by more than `LOST_BANDS` bands."""
    x, y, z = (bool(k and m <= LOST_BANDS * band) for k, m in zip(known, moved, strict=True))
    return x, y, z


def wander_event(gyro: FloatArray, accel: FloatArray, known_gyro: Flags, known_accel: Flags) -> tuple[Event, ...]:
    """Return a warning where estimates that should be known still moved by more than a band."""
    moving = []
    for name, moved, known, band, scale, unit in (
        ("gyro", gyro, known_gyro, GYRO_BAND, np.degrees(1.0), "deg/s"),
        ("accel", accel, known_accel, ACCEL_BAND, 1.0, "m/s^2"),
    ):
        for i, axis in enumerate(AXES):
            if known[i] and moved[i] > band:
                moving.append(f"{name} {axis} by +-{moved[i] * scale:.2g} {unit}")
    if not moving:
        return ()
    return (Event(code="W_UNSTEADY", count=len(moving), detail=f"{', '.join(moving)}."),)


def mostly_backwards(status: StatusArray) -> tuple[Event, ...]:
    """Return a warning where the vehicle seems to have driven backwards for most of the time.

    Nobody does: the first course was taken in reverse, or the IMU faces backwards. Either way the accelerations were
    compared the wrong way round, and nothing that was learnt can be trusted.
    """
    heading_known = (status & int(Status.INITIALIZING | Status.ALIGNING)) == 0
    reverse = (status & int(Status.REVERSE)) != 0
    if int(reverse.sum()) <= 0.5 * max(1, int(heading_known.sum())):
        return ()
    return (Event(code="W_MOSTLY_REVERSE", count=1),)
