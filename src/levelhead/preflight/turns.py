"""Yaw rate against course: the gyros' unit and sign, and roughly how far apart the clocks are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from levelhead.conventions import FloatArray
from levelhead.preflight.windows import Increments, Motion

REACH_S: Final = 1.5
"""Clock offsets that are tried go so far to both sides, s."""
COARSE_S: Final = 0.1
FINE_S: Final = 0.02
MAX_CHANGES: Final = 4000
"""Course changes that are used at most, those with the most turning."""
LAGS_S: Final = (2.0, 8.0, 30.0)
"""Course changes are taken over about the first of these times that lets the turns stand out of the noise, s."""
MIN_SCALE_SIGMAS: Final = 5.0
"""Sigmas that the scale of the gyros must be away from zero to tell anything."""
MIN_EXPLAINED: Final = 0.5
"""Share of the course changes that the gyros must explain to tell anything."""
MIN_SPEED: Final = 0.5
"""Below this speed a course is not taken, m/s."""
MAX_COURSE_STD: Final = np.radians(15.0)
MIN_CHANGES: Final = 10
HUBER: Final = 2.5
"""Residuals beyond so many sigmas count less (Huber)."""


@dataclass(frozen=True, kw_only=True)
class Turns:
    """What yaw rate and course say of each other.

    Attributes
    ----------
    scale : float
        Course change over the integrated reading about the axis that points up: +1 would be rad/s about an axis that
        points down; -pi/180 is deg/s about one that points up.
    scale_std : float
        One sigma of it.
    offset_s : float
        How much later than the IMU's the GNSS stamps are, s.
    bias : float
        Reading about that axis without a turn, the gyro's unit.
    explained : float
        Share of the course changes that the gyro explains, 0 to 1.
    """

    scale: float
    scale_std: float
    offset_s: float
    bias: float
    explained: float

    @property
    def decided(self) -> bool:
        """Whether the gyros and the course turn together."""
        return abs(self.scale) > MIN_SCALE_SIGMAS * self.scale_std and self.explained > MIN_EXPLAINED


def compare_turns(increments: Increments, motion: Motion, up: FloatArray) -> Turns | None:
    """Fit course changes by the integrated reading about the sensor's up axis, at the clock offset that fits best.

    Parameters
    ----------
    increments : Increments
        Of the readings, in their own axes and units.
    motion : Motion
        The epochs.
    up : ndarray, shape (3,)
        Unit vector that points up, sensor axes.

    Returns
    -------
    Turns or None
        None where yaw rate and course do not turn together: too slow, too few epochs, or hardly any turn.
    """
    for lag in LAGS_S:
        turns = _compared(increments, motion, up, lag)
        if turns is not None and turns.decided:
            return turns
    return None


def _compared(increments: Increments, motion: Motion, up: FloatArray, lag_s: float) -> Turns | None:
    """Compare over changes that take about `lag_s` s."""
    start, stop, change, sigma, overlap = _course_changes(motion, lag_s)
    inside = (start > increments.time[0] + REACH_S) & (stop < increments.time[-1] - REACH_S)
    if inside.sum() < MIN_CHANGES:
        return None
    # The liveliest ones tell most; those without a turn tell the bias, so some of all are kept.
    stride = max(1, round(2.0 * inside.sum() / MAX_CHANGES))
    lively = (
        np.abs(change)
        >= np.partition(np.abs(change[inside]), -min(MAX_CHANGES // 2, int(inside.sum())))[
            -min(MAX_CHANGES // 2, int(inside.sum()))
        ]
    )
    inside &= lively | (np.arange(change.size) % stride == 0)
    start, stop, change, sigma = start[inside], stop[inside], change[inside], sigma[inside]
    about_up = increments.angle @ up

    def fit(offset: float) -> tuple[float, float, float, float, float]:
        turn = np.interp(stop - offset, increments.time, about_up) - np.interp(
            start - offset, increments.time, about_up
        )
        return _fit(turn, stop - start, change, sigma, overlap)

    offset = 0.0
    for reach, step in ((REACH_S, COARSE_S), (COARSE_S, FINE_S)):
        lags = offset + np.arange(-round(reach / step), round(reach / step) + 1) * step
        costs = np.array([fit(lag)[0] for lag in lags])
        best = int(np.argmin(costs))
        offset = float(lags[best])
        if 0 < best < lags.size - 1:
            low, cost, high = costs[best - 1 : best + 2]
            offset += 0.5 * step * float((low - high) / max(low - 2.0 * cost + high, 1e-12))
    _, slope, slope_std, drift, explained = fit(offset)
    bias = -drift / slope if slope else 0.0
    return Turns(scale=slope, scale_std=slope_std, offset_s=offset, bias=bias, explained=explained)


def _course_changes(motion: Motion, lag_s: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, int]:
    """Return start, stop, change of course (rad), its sigma, and how many changes overlap at each instant."""
    v, speed = motion.velocity, motion.speed
    interval = float(np.median(np.diff(motion.time)))
    lag = max(1, round(lag_s / interval))
    across = motion.sigma[:, :2].mean(axis=1) / np.maximum(speed, 1e-3)
    moving = (speed > MIN_SPEED) & (across < MAX_COURSE_STD)
    a, b = slice(None, -lag), slice(lag, None)
    steady = moving[a] & moving[b] & (motion.time[b] - motion.time[a] < 1.5 * lag * interval)
    cross = v[a, 0] * v[b, 1] - v[a, 1] * v[b, 0]
    dot = v[a, 0] * v[b, 0] + v[a, 1] * v[b, 1]
    change = np.arctan2(cross, dot)
    sigma = np.hypot(across[a], across[b])
    return motion.time[a][steady], motion.time[b][steady], change[steady], sigma[steady], lag


def _fit(
    turn: FloatArray, duration: FloatArray, change: FloatArray, sigma: FloatArray, overlap: int
) -> tuple[float, float, float, float, float]:
    """Fit ``change = slope turn + drift duration`` robustly: cost, slope, its sigma, drift, explained share."""
    design = np.column_stack((turn, duration)) / sigma[:, None]
    target = change / sigma
    weight = np.ones_like(target)
    for _ in range(4):
        normal = design.T @ (weight[:, None] * design)
        solution = np.linalg.lstsq(normal, design.T @ (weight * target), rcond=None)[0]
        residual = np.abs(target - design @ solution)
        spread = 1.4826 * float(np.median(residual)) + 1e-12
        weight = np.minimum(1.0, HUBER * spread / np.maximum(residual, 1e-12))
    # Changes that overlap are not independent: as many count as fit side by side.
    slope_std = float(np.sqrt(np.linalg.pinv(normal)[0, 0])) * spread * np.sqrt(overlap)
    explained = 1.0 - float((weight * residual**2).sum() / max(float((weight * target**2).sum()), 1e-12))
    return float(residual.sum()), float(solution[0]), slope_std, float(solution[1]), explained
