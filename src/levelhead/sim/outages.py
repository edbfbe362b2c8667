"""GNSS outages: spans of any log, simulated or real, from which the GNSS epochs are taken away."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from levelhead.conventions import FloatArray
from levelhead.errors import UsageError
from levelhead.logs.log import Log


class Outage(NamedTuple):
    """A span without GNSS: ``start <= t < stop``, s on the log's clock. A plain ``(start, length)`` does as well."""

    start: float
    length: float

    @property
    def stop(self) -> float:
        """When GNSS comes back, s."""
        return self.start + self.length


def outage_windows(
    start: float, stop: float, length: float, *, count: int | None = None, every: float | None = None
) -> tuple[Outage, ...]:
    """Return outages of one length between two times; give either how many, or how far apart.

    Parameters
    ----------
    start, stop : float
        GNSS stays as it is before and after these, s on the log's clock.
    length : float
        Of each outage, s.
    count : int, optional
        How many: spread evenly, with the same time of GNSS before the first, between them, and after the last.
    every : float, optional
        From the start of one to the start of the next, s; the first begins at `start`, the last ends by `stop`.

    Raises
    ------
    UsageError
        When they do not fit, or would touch each other.
    """
    if not (math.isfinite(start) and math.isfinite(stop) and math.isfinite(length) and 0.0 < length <= stop - start):
        raise UsageError(f"No outage of {length} s fits between {start} and {stop} s; give a shorter one, above 0.")
    if (count is None) == (every is None):
        raise UsageError("Give either count, the number of outages, or every, the time from one start to the next.")
    if count is not None:
        between = (stop - start - count * length) / (count + 1)
        if count < 1 or between <= 0.0:
            raise UsageError(
                f"{count} outages of {length:g} s do not fit into {stop - start:g} s with GNSS between them; give a "
                f"whole number from 1 to {math.ceil((stop - start) / length) - 1}."
            )
        return tuple(Outage(start + between + k * (between + length), length) for k in range(count))
    if every is None or not every > length:
        raise UsageError(f"An outage of {length:g} s every {every} s leaves no GNSS between them; give a longer time.")
    # An outage that ends on `stop` is kept, whatever the rounding.
    return tuple(
        Outage(start + k * every, length) for k in range(math.floor((stop - start - length) / every + 1e-9) + 1)
    )


def without_gnss(log: Log, windows: Iterable[tuple[float, float]]) -> Log:
    """Return the log without the GNSS epochs inside the windows; the IMU and the wheels go on.

    Parameters
    ----------
    log : Log
        Simulated or real.
    windows : iterable of (start, length)
        `Outage` or plain pairs, s on the log's clock; an epoch goes where ``start <= t < start + length``. They may
        overlap.

    Returns
    -------
    Log
        ``meta["gnss_outages"]`` has the windows, after those that the log had.

    Raises
    ------
    UsageError
        When a window is empty or lies outside the log.
    """
    spans = tuple(Outage(*window) for window in windows)
    if not spans:
        return log
    keep = np.ones(log.gnss_time.size, dtype=np.bool_)
    for span in spans:
        if not (math.isfinite(span.start) and math.isfinite(span.length) and span.length > 0.0):
            raise UsageError(
                f"An outage from {span.start} s of {span.length} s is none; give a start and a length > 0."
            )
        if span.start > log.time[-1] or span.stop <= log.time[0]:
            raise UsageError(
                f"The outage from {span.start:g} to {span.stop:g} s is not in the log, which runs from "
                f"{log.time[0]:g} to {log.time[-1]:g} s; give a start within it."
            )
        keep &= ~((log.gnss_time >= span.start) & (log.gnss_time < span.stop))

    def kept(values: FloatArray | None) -> FloatArray | None:
        return None if values is None else values[keep]

    earlier = log.meta.get("gnss_outages", ())
    return replace(
        log,
        gnss_time=log.gnss_time[keep],
        velocity_ned=kept(log.velocity_ned),
        velocity_std=kept(log.velocity_std),
        position_llh=kept(log.position_llh),
        position_std=kept(log.position_std),
        meta={**log.meta, "gnss_outages": (*(earlier if isinstance(earlier, tuple) else ()), *spans)},
    )
