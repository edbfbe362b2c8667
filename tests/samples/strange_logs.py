"""Drives told in other words: other axes, units, frames and clocks, for what must find them again."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Final

import numpy as np

from levelhead.conventions import GRAVITY, FloatArray
from levelhead.logs.log import Log
from levelhead.logs.pieces import FACTS, Fact
from levelhead.preflight import Finding, Preflight

SIGNED_AXES: Final = [
    np.eye(3)[list(order)] * np.array(signs)[:, None]
    for order in itertools.permutations(range(3))
    for signs in itertools.product((1.0, -1.0), repeat=3)
]
"""All 48: which axis of the body each axis of a file is, with its sign."""
FLU: Final = np.diag([1.0, -1.0, -1.0])
RFU: Final = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
BACK_RIGHT_UP: Final = np.diag([-1.0, 1.0, -1.0])


def unsaid(log: Log, *facts: Fact) -> Log:
    """Return a log of which neither format nor file says the facts (none: it says nothing at all)."""
    return replace(log, meta={**log.meta, "undeclared": facts or FACTS})


def assumed(log: Log, *facts: Fact) -> Log:
    """Return a log of which only the canonical rules say the facts (none: all of them)."""
    return replace(log, meta={**log.meta, "assumed": facts or FACTS})


def in_axes(log: Log, axes: FloatArray, *, gyro_sign: float = 1.0, force_sign: float = 1.0) -> Log:
    """Return a log whose readings are along other axes, ``file = axes @ body``, or of the other sign."""
    return replace(log, gyro=gyro_sign * log.gyro @ axes.T, accel=force_sign * log.accel @ axes.T)


def in_degrees(log: Log) -> Log:
    """Return a log with its gyros in deg/s."""
    return replace(log, gyro=np.degrees(log.gyro))


def in_g(log: Log) -> Log:
    """Return a log with its accelerometers in g."""
    return replace(log, accel=log.accel / GRAVITY)


def in_frame(log: Log, frame: str) -> Log:
    """Return a log with its velocities in ENU, NEU or ECEF."""
    assert log.velocity_ned is not None
    north, east, down = log.velocity_ned.T
    if frame == "ENU":
        return replace(log, velocity_ned=np.column_stack((east, north, -down)))
    if frame == "NEU":
        return replace(log, velocity_ned=np.column_stack((north, east, -down)))
    assert frame == "ECEF"
    assert log.position_llh is not None
    latitude, longitude, _ = log.position_llh.T
    # Rows: North, East and Down at the place, in Earth-fixed axes.
    zero = np.zeros_like(latitude)
    to_north = np.column_stack(
        (-np.sin(latitude) * np.cos(longitude), -np.sin(latitude) * np.sin(longitude), np.cos(latitude))
    )
    to_east = np.column_stack((-np.sin(longitude), np.cos(longitude), zero))
    to_down = -np.column_stack(
        (np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude))
    )
    velocity = north[:, None] * to_north + east[:, None] * to_east + down[:, None] * to_down
    return replace(log, velocity_ned=velocity)


def without_positions(log: Log) -> Log:
    """Return a log with velocities alone."""
    return replace(log, position_llh=None, position_std=None)


def without_velocities(log: Log) -> Log:
    """Return a log with positions alone."""
    return replace(log, velocity_ned=None, velocity_std=None)


def late(log: Log, seconds: float, *, drift: float = 0.0) -> Log:
    """Return a log whose GNSS stamps are late at its middle, and by `drift` s/s more from there on."""
    middle = 0.5 * (log.time[0] + log.time[-1])
    return replace(log, gnss_time=log.gnss_time + seconds + drift * (log.gnss_time - middle))


def finding(found: Preflight, name: str) -> Finding:
    """Return the one finding of a name."""
    (one,) = (f for f in found.findings if f.name == name)
    return one


def velocities(log: Log) -> FloatArray:
    """Return the velocities of a log that has some."""
    assert log.velocity_ned is not None
    return log.velocity_ned
