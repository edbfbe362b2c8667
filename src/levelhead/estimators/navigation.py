"""What a result tells of its navigation: outages, where the heading comes from, what the slope moves a point by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import FloatArray
from levelhead.estimators.base import HeadingSource, ReferencePoint, Result, Status


@dataclass(frozen=True, kw_only=True, eq=False)
class Outages:
    """Stretches without a GNSS correction: ``first`` and ``last`` time of each (k,), s."""

    first: FloatArray
    last: FloatArray

    @property
    def count(self) -> int:
        """How many there are."""
        return int(self.first.size)

    @property
    def longest_s(self) -> float:
        """Length of the longest, s; 0 without any."""
        return float((self.last - self.first).max(initial=0.0))

    @property
    def total_s(self) -> float:
        """Length of all of them together, s."""
        return float((self.last - self.first).sum())


def has(result: Result, flags: Status) -> NDArray[np.bool_]:
    """Return at which samples (n,) any of some flags is up."""
    found: NDArray[np.bool_] = (result.status & np.uint32(flags)) != 0
    return found


def outages(result: Result) -> Outages:
    """Find the stretches without a GNSS correction: runs of `Status.COASTING`, to the first sample after them.

    They begin where the method says that it coasts, which is a moment after the last epoch.
    """
    edges = np.flatnonzero(np.diff(has(result, Status.COASTING), prepend=False, append=False))
    last = np.minimum(edges[1::2], result.time.size - 1)
    return Outages(first=result.time[edges[0::2]], last=result.time[last])


def heading_shares(result: Result) -> dict[str, float]:
    """Return which share of the samples has its heading from where, 0 to 1, by `HeadingSource` in lower case."""
    source = result.heading_source
    return {kind.name.lower(): float(np.mean(source == kind)) for kind in HeadingSource}


def corrections(point: ReferencePoint) -> tuple[float, float, float, float]:
    """Return RMS and largest of the cross-track, then of the height correction, m; NaN where nothing is known."""
    found: list[float] = []
    for values in (point.cross_track, point.height):
        known = values[np.isfinite(values)]
        found += [float(np.sqrt(np.mean(known**2))), float(np.abs(known).max())] if known.size else [np.nan, np.nan]
    cross_rms, cross_max, height_rms, height_max = found
    return cross_rms, cross_max, height_rms, height_max


def navigation_summary(result: Result) -> dict[str, object] | None:
    """Return the ``navigation`` part of `summary.json`; None where the method does not estimate positions."""
    if result.position_std is None:
        return None
    found = outages(result)
    return {
        "position_std_m": _json(result.position_std[-1]),
        "velocity_std_m_s": _json(result.velocity_std[-1]),
        "outages": {"count": found.count, "longest_s": found.longest_s, "total_s": found.total_s},
        "heading_source": heading_shares(result),
        "reference_point": None if result.reference is None else _point_summary(result.reference),
    }


def _point_summary(point: ReferencePoint) -> dict[str, object]:
    cross_rms, cross_max, height_rms, _ = _json(np.array(corrections(point)))
    return {
        "point_m": list(point.point),
        "position_std_m": None if point.position_std is None else _json(point.position_std[-1]),
        "cross_track_rms_m": cross_rms,
        "cross_track_max_m": cross_max,
        "height_rms_m": height_rms,
    }


def _json(row: FloatArray) -> list[float | None]:
    return [float(v) if np.isfinite(v) else None for v in row]
