"""Samples in the order of their stamps: what is not a number is dropped, what is late is sorted in, all is counted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import Field, fields, replace
from typing import Any, ClassVar, Final, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import FloatArray
from levelhead.errors import LogError
from levelhead.events import Event

REORDER_S: Final = 1.0
"""A sample that comes up to this much too late is sorted in; one that comes later belongs to a clock that jumped, s."""
MAX_DROPPED: Final = 0.1
"""Share of samples behind their predecessors above which a log is refused rather than thinned out."""


class Stamped(Protocol):
    """A frozen dataclass of arrays with one row per stamp, or None."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    @property
    def time(self) -> FloatArray:
        """Stamps (n,), s."""
        ...


T = TypeVar("T", bound=Stamped)


def tidy(data: T, what: str, needed: Sequence[str]) -> tuple[T, tuple[Event, ...]]:
    """Return the data with strictly advancing stamps, and the events of what that took.

    Parameters
    ----------
    data : ImuData or GnssData
        As read.
    what : str
        "IMU" or "GNSS", for people.
    needed : sequence of str
        Fields without which a row says nothing: it is dropped where one of them is not finite.

    Raises
    ------
    LogError
        When so many samples step back by more than `REORDER_S` that dropping them would lose a part of the drive.
    """
    events: list[Event] = []
    time = data.time
    whole = np.isfinite(time)
    for name in needed:
        whole &= np.isfinite(getattr(data, name)).all(axis=1)
    if not whole.all():
        events.append(_event("E_NONFINITE", time[~whole], f"{what}: {int((~whole).sum())}."))
        data, time = _rows(data, whole), time[whole]
    if not (np.diff(time) <= 0.0).any():
        return data, tuple(events)
    latest = np.maximum.accumulate(time)
    late = time < latest - REORDER_S
    if late.any():
        first = int(np.flatnonzero(late)[0])
        if late.mean() > MAX_DROPPED:
            raise LogError(
                f"The {what} clock jumps back from {latest[first]:.3f} to {time[first]:.3f} s at sample {first + 1}; "
                f"{int(late.sum())} of {time.size} samples are behind others. Cut the log there and run its parts."
            )
        events.append(_event("W_TIME_BACK", time[late], f"{what}: {int(late.sum())}."))
        data, time = _rows(data, ~late), time[~late]
    back = np.diff(time) < 0.0
    if back.any():
        events.append(_event("I_REORDERED", time[1:][back], f"{what}: {int(back.sum())}."))
        order = np.argsort(time, kind="stable")
        data, time = _rows(data, order), time[order]
    repeated = np.concatenate(([False], np.diff(time) == 0.0))
    if repeated.any():
        events.append(_event("W_DUP_TIME", time[repeated], f"{what}: {int(repeated.sum())}."))
        data = _rows(data, ~repeated)
    return data, tuple(events)


def _rows(data: T, rows: NDArray[Any]) -> T:
    arrays = {f.name: getattr(data, f.name) for f in fields(data)}
    return replace(data, **{name: array[rows] for name, array in arrays.items() if isinstance(array, np.ndarray)})


def _event(code: str, times: FloatArray, detail: str) -> Event:
    known = times[np.isfinite(times)]
    first, last = (None, None) if known.size == 0 else (float(known.min()), float(known.max()))
    return Event(code=code, count=int(times.size), first_s=first, last_s=last, detail=detail)
