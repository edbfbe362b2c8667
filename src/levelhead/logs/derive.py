"""What can be derived from a log's own data: velocities of a log that has positions only."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from levelhead.conventions import FloatArray
from levelhead.earth import shortest_turn, steps_ned
from levelhead.errors import LogError
from levelhead.events import Event
from levelhead.logs.log import Log

MAX_STEP_S: Final = 5.0
"""Positions further apart in time than this give no velocity: too much may have happened between them, s."""


def velocity_from_position(log: Log) -> Log:
    """Return the log with velocities from the differences of consecutive positions.

    The new GNSS epochs are the midpoints in time of consecutive positions, where a difference quotient is
    free of delay; the positions are averaged to them. Pairs further apart than `MAX_STEP_S` give no epoch.

    Parameters
    ----------
    log : Log
        A log with positions; velocities that it may have are replaced.

    Returns
    -------
    Log
        The same IMU data, `velocity_ned` (m/s), `velocity_std` = sqrt(2) `position_std` / step where the
        latter is known, and an event ``I_VELOCITY_DERIVED``.

    Raises
    ------
    LogError
        When the log has no positions, or no two of them close enough in time.
    """
    if log.position_llh is None:
        raise LogError("The log has no GNSS positions to derive velocities from; record velocities or positions.")
    has_position = np.isfinite(log.position_llh).all(axis=1)
    time = log.gnss_time[has_position]
    position = log.position_llh[has_position]
    step_s = np.diff(time)
    use = step_s <= MAX_STEP_S
    if not use.any():
        raise LogError(
            f"No velocity can be derived: the log has {time.size} GNSS positions, no two of them within "
            f"{MAX_STEP_S:g} s of each other. Record positions at 1 Hz or faster."
        )
    velocity_std: FloatArray | None = None
    position_std: FloatArray | None = None
    if log.position_std is not None:
        std = log.position_std[has_position]
        position_std = np.sqrt(0.5 * (std[1:] ** 2 + std[:-1] ** 2))[use]
        period = step_s[use] if std.ndim == 1 else step_s[use, np.newaxis]
        velocity_std = np.sqrt(2.0) * position_std / period
    middle = (0.5 * (time[1:] + time[:-1]))[use]
    event = Event(
        code="I_VELOCITY_DERIVED",
        count=int(use.sum()),
        first_s=float(middle[0]),
        last_s=float(middle[-1]),
        detail=f"{int(use.sum())} velocities from {time.size} positions.",
    )
    return replace(
        log,
        gnss_time=middle,
        velocity_ned=(steps_ned(position)[use] / step_s[use, np.newaxis]),
        velocity_std=velocity_std,
        position_llh=_midpoints(position)[use],
        position_std=position_std,
        events=(*log.events, event),
    )


def _midpoints(position_llh: FloatArray) -> FloatArray:
    """Return the mean of each position and the next; over the date line too."""
    step = np.diff(position_llh, axis=0)
    step[:, 1] = shortest_turn(step[:, 1])
    return position_llh[:-1] + 0.5 * step
