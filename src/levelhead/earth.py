"""The Earth: WGS-84's shape, rotation and normal gravity, for arrays of places."""

from __future__ import annotations

from typing import Final

import numpy as np

from levelhead.conventions import FloatArray

SEMI_MAJOR_AXIS: Final = 6378137.0
"""WGS-84 equatorial radius, m."""
ECCENTRICITY_SQUARED: Final = 6.69437999014e-3
"""WGS-84 first eccentricity squared."""
EARTH_RATE: Final = 7.292115e-5
"""Rotation of the Earth, rad/s (WGS-84)."""

_EQUATOR_GRAVITY: Final = 9.7803253359
_SOMIGLIANA: Final = 1.931852652e-3
_FREE_AIR: Final = 3.086e-6


def radii(latitude: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the radii of curvature of WGS-84, m: along the meridian, and across it."""
    w = 1.0 - ECCENTRICITY_SQUARED * np.sin(latitude) ** 2
    normal = SEMI_MAJOR_AXIS / np.sqrt(w)
    return normal * (1.0 - ECCENTRICITY_SQUARED) / w, normal


def normal_gravity(latitude: FloatArray | float, height: FloatArray | float) -> FloatArray:
    """Return gravity on the ellipsoid (Somigliana) less the free-air gradient, m/s^2, shape (n,).

    Latitude geodetic, rad; height above the ellipsoid, m. Real gravity differs by up to 1e-3 m/s^2.
    """
    sine2 = np.sin(latitude) ** 2
    surface = _EQUATOR_GRAVITY * (1.0 + _SOMIGLIANA * sine2) / np.sqrt(1.0 - ECCENTRICITY_SQUARED * sine2)
    gravity: FloatArray = np.asarray(surface - _FREE_AIR * height)
    return gravity


def turning_of_ned(position_llh: FloatArray, velocity_ned: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return Earth rate and transport rate, each of shape (n, 3), rad/s, NED.

    Parameters
    ----------
    position_llh : ndarray, shape (n, 3)
        Latitude, longitude (rad) and height (m).
    velocity_ned : ndarray, shape (n, 3)
        Relative to the Earth, m/s.
    """
    latitude, height = position_llh[:, 0], position_llh[:, 2]
    meridian, normal = radii(latitude)
    earth = EARTH_RATE * np.stack((np.cos(latitude), np.zeros_like(latitude), -np.sin(latitude)), axis=1)
    eastward = velocity_ned[:, 1] / (normal + height)
    northward = velocity_ned[:, 0] / (meridian + height)
    transport = np.stack((eastward, -northward, -eastward * np.tan(latitude)), axis=1)
    return earth, transport


def shifted(position_llh: FloatArray, step_ned: FloatArray) -> FloatArray:
    """Return the places a few metres from the given ones, shape (n, 3).

    The radii of curvature at the place turn metres into angles; the Earth curves away by less than 1e-5 m over 10 m.

    Parameters
    ----------
    position_llh : ndarray, shape (n, 3)
        Latitude, longitude (rad) and height (m).
    step_ned : ndarray, shape (n, 3)
        m, NED.
    """
    latitude, height = position_llh[:, 0], position_llh[:, 2]
    meridian, normal = radii(latitude)
    per_metre = (1.0 / (meridian + height), 1.0 / ((normal + height) * np.cos(latitude)), -np.ones_like(height))
    return position_llh + step_ned * np.stack(per_metre, axis=1)


def offset_ned(from_llh: FloatArray, to_llh: FloatArray) -> FloatArray:
    """Return how far places are from others, row by row, in the NED frame of the middle between them, (n, 3), m.

    The radii of the middle make the error third order in the distance: below 1e-6 of it for a kilometre.

    Parameters
    ----------
    from_llh, to_llh : ndarray, shape (n, 3)
        Latitude, longitude (rad) and height (m); the date line may lie between them.
    """
    middle, step = 0.5 * (from_llh + to_llh), to_llh - from_llh
    meridian, normal = radii(middle[:, 0])
    north = step[:, 0] * (meridian + middle[:, 2])
    east = shortest_turn(step[:, 1]) * (normal + middle[:, 2]) * np.cos(middle[:, 0])
    return np.column_stack((north, east, -step[:, 2]))


def shortest_turn(angle: FloatArray) -> FloatArray:
    """Return the angle (rad) without full turns: a step over the date line is a short one, not a tour of the world."""
    return angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi))


def steps_ned(position_llh: FloatArray) -> FloatArray:
    """Return the displacement from each position (m, 3) to the next, NED of their middle, (m - 1, 3), m."""
    return offset_ned(position_llh[:-1], position_llh[1:])
