"""The one-sigma corridor along a path: strokes of growing width with round ends, which never fold in a turn."""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np

from levelhead.conventions import FloatArray

LEAST_WIDTH: Final = 1.0
"""A corridor of two sigma's width below this, px, is not to be seen under the path."""
STEPS: Final = 40
"""At most about this many widths from nothing to the widest."""


def corridor(x: FloatArray, y: FloatArray, sigma: FloatArray) -> str:
    """Draw the corridor of one stretch.

    Parameters
    ----------
    x, y : ndarray, shape (p,)
        Vertices, px.
    sigma : ndarray, shape (p,)
        Half its width, px; where it is NaN, or the whole width below a pixel, nothing is drawn.

    Returns
    -------
    str
        Paths of SVG with a width of their own; empty where there is nothing to see. Overlapping is for the group round
        them to hide, by one opacity for all.
    """
    seen = np.nan_to_num(2.0 * sigma, nan=0.0) >= LEAST_WIDTH
    if not seen.any():
        return ""
    step = max(0.5, float(2.0 * sigma[seen].max()) / STEPS)
    level = np.where(seen, np.floor(2.0 * np.nan_to_num(sigma) / step), -1.0)
    starts = np.flatnonzero(np.diff(level, prepend=np.nan) != 0.0)
    ends = np.append(starts[1:], x.size)
    # Each stroke goes on to the first vertex of the next one, so that no gap is left between them.
    return "".join(
        _stroke(x[a : b + 1], y[a : b + 1], float(2.0 * sigma[a:b].mean()))
        for a, b in zip(starts.tolist(), ends.tolist(), strict=True)
        if level[a] >= 0.0
    )


def _stroke(x: FloatArray, y: FloatArray, width: float) -> str:
    # Of a vehicle at rest all vertices are one: "L" to the same place draws the round end alone, a disc.
    places = [f"{a:.1f} {b:.1f}" for a, b in zip(x.tolist(), y.tolist(), strict=True)]
    kept = [places[0], *(place for before, place in pairwise(places) if place != before)]
    line = "L".join(kept if len(kept) > 1 else [*kept, *kept])
    return f'<path stroke-width="{width:.1f}" d="M{line}"/>'
