"""The little geodesy that logs need: steps between positions in the local NED frame (WGS-84)."""

from __future__ import annotations

import numpy as np

from levelhead.conventions import FloatArray
from levelhead.earth import radii


def shortest_turn(angle: FloatArray) -> FloatArray:
    """Return the angle (rad) without full turns: a step over the date line is a short one, not a tour of the world."""
    return angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi))


def steps_ned(position_llh: FloatArray) -> FloatArray:
    """Return the displacement from each position to the next, in the NED frame of their midpoint.

    Parameters
    ----------
    position_llh : ndarray, shape (m, 3)
        Latitude (rad), longitude (rad), height (m).

    Returns
    -------
    ndarray, shape (m - 1, 3)
        North, east and down displacement, m. The radii of the midpoint make the error third order in the
        step: below 1e-6 of it for steps of a kilometre.
    """
    middle = 0.5 * (position_llh[1:] + position_llh[:-1])
    step = np.diff(position_llh, axis=0)
    east_angle = shortest_turn(step[:, 1])
    meridian, transverse = radii(middle[:, 0])
    north = step[:, 0] * (meridian + middle[:, 2])
    east = east_angle * (transverse + middle[:, 2]) * np.cos(middle[:, 0])
    return np.column_stack((north, east, -step[:, 2]))
