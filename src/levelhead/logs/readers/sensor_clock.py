"""The clock of a sensor that counts ticks of its own, set by the order in which samples and GNSS epochs were recorded.

Between two samples in a file an epoch was written: at that moment the sensor's clock stood between the two, GNSS time a
little behind the epoch's, by what the receiver takes to compute. Over many epochs that tells the length of a tick, and
how the clocks stand to each other but for a delay that stays: the recording does not tell it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import FloatArray

Ticks = NDArray[np.int64]

_BREAK: Final = 10_000
"""Steps of the clock beyond this many usual ones, and back by this share of them, begin a new stretch."""
_MIN_EPOCHS: Final = 5
_MIN_SPAN_S: Final = 5.0
"""With fewer epochs, or in less time, nothing is told of a tick."""
_BLOCK_S: Final = 300.0
_PUNCTUAL: Final = 90.0
"""Percentile of the epochs' lead that sets the clock: most epochs come later than the least delayed, few earlier."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Placed:
    """Samples on the GNSS epochs' clock.

    Attributes
    ----------
    time : (n,) float64
        Stamps, s; NaN where no GNSS epoch tells them.
    key : (n,) int64
        The sensor's own stamps, continued through its overflows and restarts: equal for samples of one instant.
    tick_s : float
        The length of a tick, s; NaN where it could not be found.
    """

    time: FloatArray
    key: Ticks
    tick_s: float


def place(tags: Ticks, at: Ticks, epoch_at: Ticks, epoch_time: FloatArray, *, nominal_s: float | None) -> Placed:
    """Find the instants of samples.

    Parameters
    ----------
    tags : (n,) int64
        The sensor's stamps as recorded, of 24 or 32 bits, in the order of the file.
    at : (n,) int64
        Where in the file each sample's message begins.
    epoch_at, epoch_time : (m,) int64, (m,) float64
        The same of the GNSS epochs, and their instants, s.
    nominal_s : float or None
        The length of a tick for recordings that are too short to tell it, s.
    """
    new = np.ones(tags.size, dtype=np.bool_)
    new[1:] = (tags[1:] != tags[:-1]) | (at[1:] != at[:-1])
    # Readings of one instant stand together: the work is done once for all of them.
    placed = _place(tags[new], at[new], epoch_at, epoch_time, nominal_s)
    run = np.cumsum(new) - 1
    return Placed(time=placed.time[run], key=placed.key[run], tick_s=placed.tick_s)


def _place(tags: Ticks, at: Ticks, epoch_at: Ticks, epoch_time: FloatArray, nominal_s: float | None) -> Placed:
    ticks, stretch = _unwrapped(tags)
    key = ticks + (stretch << 48)
    time = np.full(tags.size, np.nan)
    before, lead = _neighbours(at, epoch_at, ticks, stretch)
    instant, where, epoch_stretch = epoch_time[lead], ticks[before].astype(np.float64), stretch[before]
    tick_s = _tick(where, instant, epoch_stretch) or nominal_s
    if tick_s is None:
        return Placed(time=time, key=key, tick_s=np.nan)
    pause_s = tick_s * float(np.median(np.diff(ticks[np.concatenate(([True], np.diff(at) > 0))]))) if at.size > 1 else 0
    for number in np.unique(epoch_stretch):
        mine, theirs = stretch == number, epoch_stretch == number
        ahead = instant[theirs] - tick_s * where[theirs]
        offset = _offset(where[theirs] * tick_s, ahead, pause_s)
        local = tick_s * ticks[mine]
        time[mine] = local + np.interp(local, *offset)
    return Placed(time=time, key=key, tick_s=tick_s)


def _unwrapped(tags: Ticks) -> tuple[Ticks, Ticks]:
    """Return the stamps without overflows, and the number of the stretch without a restart that each lies in."""
    bits = 24 if tags.size and int(tags.max()) < 1 << 24 else 32
    half = 1 << (bits - 1)
    step = np.diff(tags, prepend=tags[:1])
    step = (step + half) % (1 << bits) - half
    usual = max(int(np.median(step[step > 0])), 1) if (step > 0).any() else 1
    broken = (step > _BREAK * usual) | (step < -100 * usual)
    return np.cumsum(step), np.cumsum(broken).astype(np.int64)


def _neighbours(at: Ticks, epoch_at: Ticks, ticks: Ticks, stretch: Ticks) -> tuple[Ticks, Ticks]:
    """Return, for the epochs between two samples of one stretch, the sample before and the epoch, by their numbers."""
    after = np.searchsorted(at, epoch_at)
    epoch = np.flatnonzero((after > 0) & (after < at.size))
    before = after[epoch] - 1
    step = ticks[before + 1] - ticks[before]
    usual = np.median(step) if step.size else 0
    # In a pause of the sensor an epoch says little of its clock.
    close = (stretch[before + 1] == stretch[before]) & (step <= 5 * max(usual, 1))
    return before[close], epoch[close]


def _tick(where: FloatArray, instant: FloatArray, stretch: Ticks) -> float | None:
    """Return the length of a tick from the longest stretch, s: the median over pairs of epochs half of it apart."""
    if where.size < _MIN_EPOCHS:
        return None
    longest = stretch == np.argmax(np.bincount(stretch))
    where, instant = where[longest], instant[longest]
    half = where.size // 2
    if half == 0 or instant[-1] - instant[0] < _MIN_SPAN_S:
        return None
    span, passed = where[half:] - where[:-half], instant[half:] - instant[:-half]
    told = (span > 0.0) & (passed > 0.0)
    return float(np.median(passed[told] / span[told])) if told.any() else None


def _offset(local: FloatArray, ahead: FloatArray, pause_s: float) -> tuple[FloatArray, FloatArray]:
    """Return what to add to the sensor's clock, at some instants of it, s.

    One number, unless the clocks drift apart by more than the pause between two messages, which is how well an epoch
    tells: then one for each `_BLOCK_S`.
    """
    whole = np.array([local.mean()]), np.array([np.percentile(ahead, _PUNCTUAL)])
    block = ((local - local.min()) // _BLOCK_S).astype(np.int64)
    numbers = [k for k in np.unique(block) if (block == k).sum() >= _MIN_EPOCHS]
    if len(numbers) < 2:
        return whole
    middle = np.array([local[block == k].mean() for k in numbers])
    each = np.array([np.percentile(ahead[block == k], _PUNCTUAL) for k in numbers])
    return (middle, each) if np.abs(each - whole[1]).max() > 1.5 * pause_s + 0.01 else whole
