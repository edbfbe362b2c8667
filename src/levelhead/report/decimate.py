"""Fewer samples, the same picture: min-max decimation of curves, thinning of paths, compact numbers.

A plot of a thousand pixels cannot show 360 000 samples; it must still show every spike and every gap. All functions
choose among the real samples, so a value that the reader reads off a plot was in the data.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import FloatArray

IndexArray = NDArray[np.intp]

DEFAULT_BUCKETS: Final = 1000
"""Each bucket keeps its lowest and its highest sample: about 2000 points per curve, two per pixel of a wide plot."""


def minmax_indices(columns: FloatArray, buckets: int = DEFAULT_BUCKETS) -> IndexArray:
    """Choose the samples that preserve the picture of all columns when they are drawn on one time base.

    Parameters
    ----------
    columns : ndarray, shape (n,) or (n, k)
        The curves; a value that is not finite is a gap.
    buckets : int
        Number of groups of neighbouring samples. Of each group and column the lowest, the highest and the first
        missing value are kept.

    Returns
    -------
    ndarray, shape (p,), intp
        Increasing sample numbers; always with the first and the last sample, all of them where n is small.
    """
    table = columns.reshape(columns.shape[0], -1)
    n = table.shape[0]
    if n <= 2 * buckets:
        return np.arange(n)
    width = -(-n // buckets)
    full = n // width
    chosen = np.zeros(n, dtype=np.bool_)
    chosen[[0, -1]] = True
    for column in table.T:
        _mark_extremes(column[: full * width].reshape(full, width), chosen[: full * width])
        if full * width < n:
            _mark_extremes(column[None, full * width :], chosen[full * width :])
    return np.flatnonzero(chosen)


def _mark_extremes(rows: FloatArray, chosen: NDArray[np.bool_]) -> None:
    """Mark, in each row, the lowest, the highest and the first missing value."""
    start = np.arange(rows.shape[0]) * rows.shape[1]
    finite = np.isfinite(rows)
    if finite.all():
        # The common case, kept apart because it needs no copies.
        chosen[start + rows.argmin(axis=1)] = True
        chosen[start + rows.argmax(axis=1)] = True
        return
    some = finite.any(axis=1)
    chosen[(start + np.where(finite, rows, np.inf).argmin(axis=1))[some]] = True
    chosen[(start + np.where(finite, rows, -np.inf).argmax(axis=1))[some]] = True
    gap = ~finite
    chosen[(start + gap.argmax(axis=1))[gap.any(axis=1)]] = True


def path_indices(north: FloatArray, east: FloatArray, points: int = 2500) -> IndexArray:
    """Choose the samples that preserve the picture of a path: dense in turns, sparse on straights.

    Parameters
    ----------
    north, east : ndarray, shape (n,)
        The path, m, finite.
    points : int
        About how many samples to keep.

    Returns
    -------
    ndarray, shape (p,), intp
        Increasing sample numbers, at most ``points + 2``, with the first and the last one.
    """
    n = north.size
    if n <= points:
        return np.arange(n)
    travelled = _cumulative(np.hypot(np.diff(north), np.diff(east)))
    if travelled[-1] == 0.0:
        return np.array([0, n - 1])
    # First equal steps along the way, small against a pixel: standing still costs nothing, and the
    # noise of single samples does not count as turning below.
    steps = np.linspace(0.0, travelled[-1], 8 * points)
    fine = np.unique(np.append(np.searchsorted(travelled, steps[:-1]), [0, n - 1]))
    course = np.arctan2(np.diff(east[fine]), np.diff(north[fine]))
    turn = np.abs(np.angle(np.exp(1j * np.diff(course))))
    # Then half of the points by distance, half by turning.
    measure = travelled[fine] / travelled[-1]
    total_turn = turn.sum()
    if total_turn > 0.0:
        measure[1:-1] += np.cumsum(turn) / total_turn
        measure[-1] += 1.0
    kept = np.searchsorted(measure, np.linspace(0.0, measure[-1], points)[:-1])
    return np.unique(np.append(fine[kept], [0, n - 1]))


def _cumulative(steps: FloatArray) -> FloatArray:
    return np.concatenate(([0.0], np.cumsum(steps)))


def wrap_with_gaps(time: FloatArray, columns_deg: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Wrap continuous angles to [0, 360) and put a gap where a curve leaves one edge and enters at the other.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Seconds, increasing.
    columns_deg : ndarray, shape (n, k)
        Unwrapped angles, degrees; NaN is a gap.

    Returns
    -------
    time : ndarray, shape (p,)
        The time base with three rows added per crossing: at the edge, the gap, at the other edge.
    columns_deg : ndarray, shape (p, k)
        Wrapped angles; no two neighbouring values lie more than 180 deg apart.
    """
    sides, gaps = [time], []
    for column in columns_deg.T:
        delta = np.diff(column)
        turn = np.floor(column / 360.0)
        k = np.flatnonzero(np.diff(turn) != 0.0)
        k = k[np.isfinite(delta[k])]
        length = time[k + 1] - time[k]
        edge = 360.0 * np.maximum(turn[k], turn[k + 1])
        # Beyond half a turn between two samples nobody can say where the edge was crossed: just a gap.
        near = np.abs(delta[k]) < 180.0
        share = np.where(near, np.clip((edge - column[k]) / delta[k], 0.02, 0.98), 0.5)
        gaps.append(time[k] + share * length)
        sides += [(time[k] + (share - 0.01) * length)[near], (time[k] + (share + 0.01) * length)[near]]
    new_time = np.unique(np.concatenate(sides + gaps))
    wrapped = np.empty((new_time.size, columns_deg.shape[1]))
    for j, column in enumerate(columns_deg.T):
        wrapped[:, j] = np.mod(np.interp(new_time, time, column), 360.0)
        wrapped[np.searchsorted(new_time, gaps[j]), j] = np.nan
        far = np.flatnonzero(np.abs(np.diff(wrapped[:, j])) > 180.0)
        wrapped[far, j] = np.nan
    return new_time, wrapped


def encode(values: FloatArray, decimals: int) -> dict[str, object]:
    """Turn a column into short JSON: whole multiples of ``10**-decimals``, each as the step from the previous one.

    Parameters
    ----------
    values : ndarray, shape (n,)
        The column; what is not finite becomes null.
    decimals : int
        Digits kept after the decimal point.

    Returns
    -------
    dict
        ``{"decimals": decimals, "steps": [...]}``; the running sum of the steps, nulls left out, divided by
        ``10**decimals`` gives the values back.
    """
    finite = np.isfinite(values)
    whole = np.rint(values[finite] * 10.0**decimals).astype(np.int64)
    steps: list[int] = np.diff(whole, prepend=0).tolist()
    if finite.all():
        return {"decimals": decimals, "steps": steps}
    left = iter(steps)
    return {"decimals": decimals, "steps": [next(left) if there else None for there in finite.tolist()]}
