"""Where on Earth a log was driven: latitude and local gravity for the methods that feel the Earth turn."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TypeVar

import numpy as np

from levelhead.conventions import GRAVITY
from levelhead.estimators.base import SensorData
from levelhead.estimators.params import FilterParams

P = TypeVar("P", bound=FilterParams)


def normal_gravity(latitude: float, height: float) -> float:
    """Return gravity on the WGS-84 ellipsoid (Somigliana) less the free-air gradient, m/s^2.

    Parameters
    ----------
    latitude : float
        Geodetic, rad.
    height : float
        Above the ellipsoid, m. Real gravity differs by up to 1e-3 m/s^2.
    """
    sine2 = math.sin(latitude) ** 2
    surface = 9.7803253359 * (1.0 + 1.931852652e-3 * sine2) / math.sqrt(1.0 - 6.69437999014e-3 * sine2)
    return surface - 3.086e-6 * height


def at_place(params: P, data: SensorData, *, follows: bool = False) -> P:
    """Return the parameters with the latitude of the log, and its gravity where they have the standard value.

    A method that `follows` the positions knows the gravity of each by itself.
    """
    if params.latitude is not None or data.position_llh is None:
        return params
    known = data.position_llh[np.isfinite(data.position_llh).all(axis=1)]
    if known.size == 0:
        return params
    latitude, _, height = (float(v) for v in np.median(known, axis=0))
    gravity = normal_gravity(latitude, height) if params.gravity == GRAVITY and not follows else params.gravity
    return replace(params, latitude=latitude, gravity=gravity)
