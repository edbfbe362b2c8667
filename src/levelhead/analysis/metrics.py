"""Measures that the analyses share: root mean squares that skip what is absent, angles, settling, lists for JSON."""

from __future__ import annotations

from typing import Final, Protocol

import numpy as np

from levelhead.conventions import FloatArray

START_UP_S: Final = 120.0
"""Differences count from here on, s after the log's start: every method has levelled and found the course."""


class Attitude(Protocol):
    """Anything with an attitude over time: a `Result` or a `Truth`."""

    @property
    def roll(self) -> FloatArray:
        """Roll (n,), rad."""
        ...

    @property
    def pitch(self) -> FloatArray:
        """Pitch (n,), rad."""
        ...

    @property
    def heading(self) -> FloatArray:
        """Heading (n,), rad."""
        ...


def rms(values: FloatArray) -> FloatArray:
    """Return the root mean square over the rows (n, ...), skipping what is not finite; NaN where nothing is."""
    finite = np.isfinite(values)
    count = finite.sum(axis=0)
    total = np.square(np.where(finite, values, 0.0)).sum(axis=0)
    out: FloatArray = np.sqrt(np.where(count > 0, total / np.maximum(count, 1), np.nan))
    return out


def wrapped(angle: FloatArray) -> FloatArray:
    """Return angles within [-pi, pi), rad."""
    return np.mod(angle + np.pi, 2.0 * np.pi) - np.pi


def attitude_difference(one: Attitude, other: Attitude) -> FloatArray:
    """Return roll, pitch and heading of one less the other, shape (n, 3), rad, wrapped; both on the same stamps."""
    columns = [getattr(one, name) - getattr(other, name) for name in ("roll", "pitch", "heading")]
    return wrapped(np.column_stack(columns))


def settling_time(time: FloatArray, error: FloatArray, band: float) -> float | None:
    """Return how long after the start an error (n, k) came within a band for good, s; None if it never did."""
    outside = np.flatnonzero(~(np.abs(error) <= band).all(axis=1))  # NaN is outside
    if outside.size == 0:
        return 0.0
    last = int(outside[-1])
    return None if last + 1 >= time.size else float(time[last + 1] - time[0])


def json_list(row: FloatArray, scale: float = 1.0) -> list[float | None]:
    """Turn a row into JSON: numbers, and None for what is not finite."""
    return [float(v) if np.isfinite(v) else None for v in row * scale]


def json_number(value: float | None, scale: float = 1.0) -> float | None:
    """Turn a number into JSON: None for what is not finite."""
    return None if value is None or not np.isfinite(value) else float(value) * scale
