"""GPS time and UTC, both as seconds since 1970 by the calendar: they differ by the leap seconds since 1980."""

from __future__ import annotations

import bisect
from typing import Final

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import FloatArray
from levelhead.errors import LogError

GPS_EPOCH_S: Final = 315964800.0
"""1980-01-06 in seconds since 1970, calendar count (both without leap seconds)."""
WEEK_S: Final = 604800.0
GPST: Final = "GPST"
UTC: Final = "UTC"
JST: Final = "JST"
TIME_SCALES: Final = (GPST, UTC, JST)
_JST_AHEAD_S: Final = 9 * 3600.0

_LEAPS_S: Final = (
    362793600.0, 394329600.0, 425865600.0, 489024000.0, 567993600.0, 631152000.0, 662688000.0, 709948800.0,
    741484800.0, 773020800.0, 820454400.0, 867715200.0, 915148800.0, 1136073600.0, 1230768000.0, 1341100800.0,
    1435708800.0, 1483228800.0,
)  # fmt: skip
"""Instants (UTC) from which GPS time is one more second ahead: IERS Bulletin C; none was announced after 2017."""
_LEAPS_GPST_S: Final = tuple(leap + count for count, leap in enumerate(_LEAPS_S, 1))


def between(scale: str, other: str, time: float) -> float:
    """Return what turns a stamp in one time scale into the other, s.

    Parameters
    ----------
    scale, other : {"GPST", "UTC", "JST"}
        From and to.
    time : float
        A stamp in `scale`, seconds since 1970. A log is converted by the one shift of its beginning, so that no leap
        second falls into it.

    Raises
    ------
    LogError
        On another time scale.
    """
    for name in (scale, other):
        if name not in TIME_SCALES:
            raise LogError(f"The time scale {name!r} is not known; use GPST, UTC or JST.")
    utc = time - {UTC: 0.0, JST: _JST_AHEAD_S, GPST: bisect.bisect_right(_LEAPS_GPST_S, time)}[scale]
    ahead = {UTC: 0.0, JST: _JST_AHEAD_S, GPST: bisect.bisect_right(_LEAPS_S, utc)}[other]
    return float(utc + ahead - time)


def gps_instant(week: FloatArray, second: FloatArray) -> FloatArray:
    """Return instants in GPST, seconds since 1970, of GPS weeks since 1980 and seconds of the week."""
    return GPS_EPOCH_S + WEEK_S * week + second


def continued(part: FloatArray, start: FloatArray, known: NDArray[np.bool_], period: float) -> FloatArray:
    """Return stamps that run on, of stamps that begin anew with each day or week.

    Parameters
    ----------
    part : (n,) float64
        Seconds of the day or week, in the order of the file.
    start : (n,) float64
        When the day or week began, where `known`; the other stamps follow their neighbours, and without any known the
        first day or week begins at zero.
    period : float
        Its length, s.
    """
    running = np.unwrap(part, period=period) if part.size else part
    if not known.any():
        return running
    row = np.maximum.accumulate(np.where(known, np.arange(part.size), -1))
    row[row < 0] = int(np.argmax(known))
    return running + (start + part - running)[row]
