"""The unit of time stamps that nobody declares: found by the interval between samples, or not at all."""

from __future__ import annotations

from typing import Final

import numpy as np

from levelhead.conventions import UNIT_FACTORS, FloatArray
from levelhead.errors import LogError

IMU_INTERVALS_S: Final = (1.0 / 4000.0, 1.0 / 5.0)
"""Between IMU samples of any rate that a log may have, s; less than a factor of 1000 apart, so that one unit fits."""
GNSS_INTERVALS_S: Final = (1.0 / 100.0, 9.9)
"""The same between GNSS epochs."""
_UNITS: Final = ("s", "ms", "us", "ns")
_UNIX_S: Final = (1.6e9, 2.0e9)
"""Stamps within are seconds since 1970 (2020 to 2033)."""


def unit_of_stamps(where: str, stamps: FloatArray, intervals: tuple[float, float]) -> str:
    """Return "s", "ms", "us" or "ns".

    Parameters
    ----------
    where : str
        The file and the column, for errors.
    stamps : ndarray, shape (n,)
        As they stand in the file, in the order of the rows.
    intervals : pair of float
        The shortest and the longest interval that is plausible, s.

    Raises
    ------
    LogError
        When no unit fits, or the intervals say one thing in the middle and another on average.
    """
    steps = np.diff(stamps[np.isfinite(stamps)])
    steps = steps[steps > 0.0]
    advance = "pass a mapping (mapping=) whose units say what the time counts"
    if steps.size < 2:
        raise LogError(f"{where}: the time stamps do not advance; {advance}.")
    median, mean = float(np.median(steps)), float(steps.sum()) / (stamps.size - 1)
    fitting = [_fitting(interval, intervals) for interval in (median, mean)]
    if fitting[0] is None or fitting[0] != fitting[1]:
        raise LogError(
            f"{where}: the stamps advance by {median:g} (median) or {mean:g} (mean) from row to row, which tells no "
            f"unit at a plausible rate; {advance}."
        )
    return fitting[0]


def _fitting(interval: float, limits: tuple[float, float]) -> str | None:
    for unit in _UNITS:
        if limits[0] <= interval * UNIT_FACTORS["s"][unit] <= limits[1]:
            return unit
    return None


def are_unix(time: FloatArray) -> bool:
    """Whether stamps in seconds can be counted from 1970."""
    return time.size > 0 and _UNIX_S[0] < float(time[0]) < _UNIX_S[1]
