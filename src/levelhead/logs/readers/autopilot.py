"""What the readers of autopilots' logs share: scattered records, two sensors on one clock, parameters that change."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import FloatArray
from levelhead.events import Event

Bytes = NDArray[np.uint8]
Records = NDArray[Any]

MAX_BRIDGED: Final = 3.0
"""Readings are interpolated between samples that lie at most this many of the usual intervals apart."""
MIN_RATE_HZ: Final = 20.0
"""Streams below this rate were logged for a look at the sensor, not for navigation."""
VERTICAL_STD: Final = 0.05
MIN_VERTICAL_STD_M_S: Final = 0.5
"""What a vehicle's unknown vertical velocity is taken for: zero, give or take this share of its speed, or this."""


def gather(data: Bytes, starts: Sequence[int], dtype: np.dtype[Any]) -> Records:
    """Return the records that begin at these bytes of a file, shape (n,), of a structured type."""
    if len(starts) == 0:
        return np.empty(0, dtype=dtype)
    windows = np.lib.stride_tricks.sliding_window_view(data, dtype.itemsize)
    return np.ascontiguousarray(windows[np.asarray(starts, dtype=np.intp)]).view(dtype)[:, 0]


def columns(records: Records, names: Sequence[str]) -> FloatArray:
    """Return fields side by side, shape (n, k): several fields of one number each, or one field of several."""
    return np.column_stack([records[name].astype(np.float64) for name in names])


def onto(time: FloatArray, of: FloatArray, values: FloatArray) -> FloatArray:
    """Interpolate readings (k, 3) with the stamps `of` (k,) to the stamps `time` (n,), s.

    NaN where the readings end, or have a gap (see `MAX_BRIDGED`).
    """
    finite = np.isfinite(values).all(axis=1) & np.isfinite(of)
    of, first = np.unique(of[finite], return_index=True)
    values = values[finite][first]
    if of.size < 2:
        return np.full((time.size, 3), np.nan)
    after = np.clip(np.searchsorted(of, time), 1, of.size - 1)
    steps = np.diff(of)
    outside = (time < of[0]) | (time > of[-1]) | (steps[after - 1] > MAX_BRIDGED * np.median(steps))
    result = np.column_stack([np.interp(time, of, column) for column in values.T])
    result[outside] = np.nan
    return result


def without_vertical(
    velocity: FloatArray, std: FloatArray, unknown: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray, tuple[Event, ...]]:
    """Return velocity and sigma (m, 3), m/s, NED, and an event, where the receiver tells no vertical velocity.

    It is then zero with a wide sigma (`VERTICAL_STD`): a vehicle drives along the ground.
    """
    unknown = unknown & np.isfinite(velocity[:, :2]).all(axis=1)
    if not unknown.any():
        return velocity, std, ()
    velocity, std = velocity.copy(), std.copy()
    velocity[unknown, 2] = 0.0
    speed = np.hypot(velocity[unknown, 0], velocity[unknown, 1])
    std[unknown, 2] = np.maximum(MIN_VERTICAL_STD_M_S, VERTICAL_STD * speed)
    return velocity, std, (Event(code="I_VELOCITY_2D", count=int(unknown.sum())),)


class Parameters:
    """The autopilot's parameters as the log tells them, each with the places in the file where it changed."""

    def __init__(self) -> None:
        self._history: dict[str, list[tuple[int, float]]] = {}

    def add(self, name: str, value: float, position: int) -> None:
        """Note a value from this byte of the file on."""
        history = self._history.setdefault(name, [])
        if not history or history[-1][1] != value:
            history.append((position, value))

    def lasting(self, pattern: re.Pattern[str], end: int) -> Mapping[str, float]:
        """Return those whose whole name matches: of each the value that holds for most of the file's bytes."""
        return {name: _lasting(history, end) for name, history in self._history.items() if pattern.fullmatch(name)}

    def changed(self, pattern: re.Pattern[str]) -> tuple[str, ...]:
        """Return the names of those that had more than one value."""
        return tuple(n for n, history in self._history.items() if len(history) > 1 and pattern.fullmatch(n))


def _lasting(history: Sequence[tuple[int, float]], end: int) -> float:
    # What was read first held from the start: logs begin with all parameters.
    bounds = [0, *(position for position, _ in history[1:]), end]
    spans: dict[float, int] = {}
    for (_, value), begin, until in zip(history, bounds[:-1], bounds[1:], strict=True):
        spans[value] = spans.get(value, 0) + until - begin
    return max(spans, key=lambda value: spans[value])
