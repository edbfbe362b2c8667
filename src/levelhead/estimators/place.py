"""Where on Earth a log was driven: latitude and local gravity for the methods that feel the Earth turn."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np

from levelhead.conventions import GRAVITY
from levelhead.earth import normal_gravity
from levelhead.estimators.base import SensorData
from levelhead.estimators.params import FilterParams, PaperParams

P = TypeVar("P", FilterParams, PaperParams)


def at_place(params: P, data: SensorData, *, follows: bool = False) -> P:
    """Return the parameters with the latitude of the log, and its gravity where they have the standard value.

    A method that `follows` the positions knows the gravity of each by itself.
    """
    if params.latitude is not None or data.position_llh is None:
        return params
    known = data.position_llh[np.isfinite(data.position_llh).all(axis=1)]
    if known.size == 0:
        return params
    latitude, _, height = np.median(known, axis=0)
    gravity = float(normal_gravity(latitude, height)) if params.gravity == GRAVITY and not follows else params.gravity
    return replace(params, latitude=float(latitude), gravity=gravity)
