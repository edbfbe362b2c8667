"""The unit of the GNSS velocity: against the steps between positions, or against the specific force."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from levelhead.conventions import FloatArray
from levelhead.logs.ecef import ned_from_ecef
from levelhead.preflight.frames import VELOCITY_FRAMES

VELOCITY_UNITS: Final = {
    "m/s": 1.0,
    "km/h": 1.0 / 3.6,
    "knots": 1852.0 / 3600.0,
    "mph": 0.44704,
    "ft/s": 0.3048,
    "cm/s": 0.01,
    "mm/s": 0.001,
}
ALIKE_POSITIONS: Final = 0.97
"""Correlation with the steps between positions from which on their ratio counts."""
ALIKE_FORCES: Final = 0.9
"""Correlation with the specific force from which on the ratio of accelerations counts."""
UNIT_NEAR: Final = 0.15
"""Accelerations tell a unit only where its factor is met within this (natural logarithm)..."""
SIDES_APART: Final = 0.5
"""...and turns to both sides give ratios that differ by less than this (natural logarithm)."""
MIN_STEPS: Final = 20
MIN_SPEED: Final = 1.0
"""Some step between positions must be faster than this, m/s."""
LONGEST_S: Final = 3.0


@dataclass(frozen=True, kw_only=True)
class Speeds:
    """How the velocities compare with what does not depend on their unit.

    Attributes
    ----------
    ratio : float
        m/s for 1 of the velocities' unit.
    turned : float or None
        Angle from the velocities to the steps between positions that no frame explains, rad; None where accelerations
        were compared.
    """

    ratio: float
    turned: float | None


def speeds_by_positions(
    time: FloatArray, steps_ned: FloatArray, velocity: FloatArray, position_llh: FloatArray
) -> Speeds | None:
    """Compare velocities with the steps between positions, as complex numbers North + i East.

    Parameters
    ----------
    time : ndarray, shape (m,)
        Stamps of the epochs, s.
    steps_ned : ndarray, shape (m - 1, 3)
        From each position to the next, m.
    velocity : ndarray, shape (m, 3)
        As declared.
    position_llh : ndarray, shape (m, 3)
        Latitude, longitude (rad), height (m).

    Returns
    -------
    Speeds or None
        None where the vehicle hardly moved, or the two have nothing in common.
    """
    duration = np.diff(time)
    mean = 0.5 * (velocity[1:] + velocity[:-1])
    moved = steps_ned / duration[:, None]
    whole = np.isfinite(mean).all(axis=1) & np.isfinite(moved).all(axis=1) & (duration < LONGEST_S)
    mean, moved = mean[whole], moved[whole]
    if whole.sum() < MIN_STEPS or np.hypot(moved[:, 0], moved[:, 1]).max() < MIN_SPEED:
        return None
    steps = moved[:, 0] + 1j * moved[:, 1]
    found = []
    for as_ned in (*(mean @ turn.T for turn in VELOCITY_FRAMES.values()), ned_from_ecef(mean, position_llh[1:][whole])):
        declared = as_ned[:, 0] + 1j * as_ned[:, 1]
        power = float((np.abs(declared) ** 2).sum())
        if power == 0.0:
            continue
        both = complex((declared.conj() * steps).sum())
        alike = abs(both) / math.sqrt(power * float((np.abs(steps) ** 2).sum()))
        found.append((alike, abs(both) / power, math.atan2(both.imag, both.real)))
    good = [each for each in found if each[0] > ALIKE_POSITIONS]
    if not good:
        return None
    return Speeds(ratio=max(good)[1], turned=min((each[2] for each in good), key=abs))


def speeds_by_forces(dcm_f_to_ned: FloatArray, force: FloatArray, change: FloatArray) -> Speeds | None:
    """Compare accelerations of the velocity with the specific force, horizontally and about their means in each window.

    A bias of the accelerometers turns with the vehicle, as the acceleration in a turn does: it counts for the one in
    turns to the right, against it in those to the left, so that only both together tell.

    Parameters
    ----------
    dcm_f_to_ned : ndarray, shape (w, 3, 3)
        Rotation of each window's frame F.
    force : ndarray, shape (w, e, 3)
        Specific force in F, m/s^2; NaN where there is none.
    change : ndarray, shape (w, e, 3)
        Change of the velocity in a second, NED, the velocities' unit.

    Returns
    -------
    Speeds or None
        None where the two have too little in common, turns go one way only, or no unit fits.
    """
    felt = np.einsum("wij,wej->wei", dcm_f_to_ned, force)[..., :2]
    known = np.isfinite(felt + change[..., :2]).all(axis=-1)
    count = np.maximum(known.sum(axis=1), 1)[:, None, None]
    pair = [np.where(known[..., None], values, 0.0) for values in (felt, change[..., :2])]
    x, y = (np.where(known[..., None], values - values.sum(axis=1, keepdims=True) / count, 0.0) for values in pair)
    xx, yy, xy = ((a * b).sum(axis=(1, 2)) for a, b in ((x, x), (y, y), (x, y)))
    # The acceleration's own turning: to the right where positive.
    right = (y[:, :-1, 0] * y[:, 1:, 1] - y[:, :-1, 1] * y[:, 1:, 0]).sum(axis=1) > 0.0
    ratios = []
    for side in (right, ~right):
        alike = float(xy[side].sum()) / math.sqrt(float(xx[side].sum() * yy[side].sum()) + 1e-12)
        if alike < ALIKE_FORCES:
            return None
        ratios.append(float(xy[side].sum() / yy[side].sum()))
    ratio = 0.5 * sum(ratios)
    near = min(abs(math.log(ratio / factor)) for factor in VELOCITY_UNITS.values())
    apart = abs(math.log(ratios[0] / ratios[1]))
    return Speeds(ratio=ratio, turned=None) if near < UNIT_NEAR and apart < SIDES_APART else None
