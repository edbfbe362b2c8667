"""Earth-centred, Earth-fixed positions and velocities into latitude, longitude, height and north, east, down."""

from __future__ import annotations

from typing import Final

import numpy as np

from levelhead.conventions import FloatArray

GLOBE_M: Final = (6.3e6, 6.5e6)
"""How far from the Earth's centre a place can be; a receiver without a fix writes zeros, or NaN, m."""


def llh_from_ecef(position: FloatArray) -> FloatArray:
    """Return latitude (rad), longitude (rad) and height over the WGS84 ellipsoid (m).

    Parameters
    ----------
    position : ndarray, shape (n, 3)
        Earth-centred, Earth-fixed, m.

    Returns
    -------
    ndarray, shape (n, 3)
        NaN where the position is none, see `GLOBE_M`.
    """
    import pymap3d

    llh = np.full((len(position), 3), np.nan)
    with np.errstate(over="ignore"):
        distance = np.linalg.norm(position, axis=1)
    there = (distance > GLOBE_M[0]) & (distance < GLOBE_M[1])
    if there.any():
        llh[there] = np.column_stack(pymap3d.ecef2geodetic(*position[there].T, deg=False))
    return llh


def ned_from_ecef(velocity: FloatArray, position_llh: FloatArray) -> FloatArray:
    """Return velocities along north, east, down at their places.

    Parameters
    ----------
    velocity : ndarray, shape (n, 3)
        Along the axes of the Earth, m/s.
    position_llh : ndarray, shape (n, 3)
        Latitude and longitude, rad; the height does not matter.

    Returns
    -------
    ndarray, shape (n, 3)
        m/s, NaN where one of the two is.
    """
    import pymap3d

    if not len(velocity):
        return np.empty((0, 3))
    east, north, up = pymap3d.ecef2enuv(*velocity.T, position_llh[:, 0], position_llh[:, 1], deg=False)
    ned: FloatArray = np.column_stack((north, east, -up))
    return ned
