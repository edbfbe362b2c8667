"""`outage_test`: GNSS taken out of a log in windows, the position at their end compared with what was taken out.

A recorded log has no true position, but its GNSS is one where the estimator did not see it: how far the position drifts
without GNSS, and whether its sigma says so, is measured on the user's own drive.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Final

import numpy as np

from levelhead.analysis.drift import Agreement, Drift, Window, agreement_of, drift_of, errors_of
from levelhead.analysis.estimation import estimate
from levelhead.analysis.injection import constants_of
from levelhead.analysis.metrics import json_number, rms
from levelhead.conventions import FloatArray
from levelhead.errors import LogError, UsageError
from levelhead.estimators.base import Result
from levelhead.estimators.params import MethodParams, Triple
from levelhead.estimators.streaming import Progress
from levelhead.logs.derive import MAX_STEP_S
from levelhead.logs.log import Log
from levelhead.sim import outages

Runner = Callable[[Log, str, MethodParams], Result]
"""Runs a method over a log, as `estimate` does."""

METHODS_TRIED: Final = ("phasor", "smoother")
"""What estimates positions: forwards as it would live, and with what came after the outage."""
SHORTEST_S: Final = MAX_STEP_S
"""Shorter outages are bridged where velocities are derived from positions, s; they would be none."""
FIRST_S: Final = 120.0
"""No outage before this, s after the log's start, or a quarter of a shorter drive: the biases are learnt first."""
AIDED_LENGTHS: Final = 3.0
"""At least so many times its own length lies between an outage and the next."""
MAX_WINDOWS: Final = 30
"""On a long drive they are spread out: a log that is a quarter holes is another log."""
MAX_GAP_S: Final = 2.0
"""GNSS is there where its epochs are no further apart than this, s, or three intervals of a slow receiver."""


@dataclass(frozen=True, kw_only=True)
class OutageRun:
    """One method through all windows; ``refused`` says why there are no figures, and is empty where there are."""

    name: str
    drifts: tuple[Drift, ...] = ()
    agreement: Agreement | None = None
    refused: str = ""

    def figures(self, name: str) -> tuple[float, float, float]:
        """Return RMS, median and largest over the windows of a field or property of `Drift`; NaN without any."""
        values = np.array([getattr(drift, name) for drift in self.drifts], dtype=np.float64)
        finite = values[np.isfinite(values)]
        if finite.size == 0:
            return math.nan, math.nan, math.nan
        return float(rms(finite)), float(np.median(finite)), float(finite.max())

    def as_dict(self) -> dict[str, object]:
        """Return the run as `validation.json` shows it."""
        over = {}
        for key, name in (
            ("horizontal_m", "horizontal_m"),
            ("vertical_m", "vertical_m"),
            ("horizontal_in_sigma", "in_sigma"),
            ("vertical_in_sigma", "vertical_in_sigma"),
            ("percent_of_distance", "percent"),
        ):
            values = [json_number(value) for value in self.figures(name)]
            over[key] = dict(zip(("rms", "median", "largest"), values, strict=True))
        return {
            "run": self.name,
            "refused": self.refused or None,
            "drift": None if self.refused else over,
            "agreement": None if self.agreement is None else self.agreement.as_dict(),
            "windows": [drift.as_dict() for drift in self.drifts],
        }


@dataclass(frozen=True, kw_only=True)
class OutageTest:
    """Every method through the same windows; ``reason`` says why there are none, and is empty where there are."""

    length_s: float
    runs: tuple[OutageRun, ...] = ()
    reason: str = ""

    @property
    def windows(self) -> int:
        """How many outages were made."""
        return max((len(run.drifts) for run in self.runs), default=0)

    def as_dict(self) -> dict[str, object]:
        """Return the ``outages`` part of `validation.json`."""
        return {
            "length_s": self.length_s,
            "count": self.windows,
            "reason": self.reason or None,
            "runs": [run.as_dict() for run in self.runs],
        }


def outage_windows(log: Log, length: float) -> tuple[Window, ...]:
    """Choose where GNSS is taken out: spread over the drive, where it is there for one length before and after.

    The first lies after `FIRST_S`; one that does not fit is moved on until it does.

    Parameters
    ----------
    log : Log
        The drive, with GNSS positions.
    length : float
        Of each window, s.
    """
    series = [_times(log, rows) for rows in (log.velocity_ned, log.position_llh) if rows is not None]
    fixes = series[-1]  # what the estimate is compared with: there must be one at the window's end
    begin = float(log.time[0])
    first = begin + math.ceil(min(FIRST_S, 0.25 * log.duration))  # whole seconds read well
    last = float(log.time[-1]) - 2.0 * length
    step = max((1.0 + AIDED_LENGTHS) * length, math.ceil((last - first) / (MAX_WINDOWS - 1)))
    windows = []
    start = first
    while start <= last:
        end = start + length
        there = all(_covered(times, start - length, end + length) for times in series)
        if there and ((fixes >= max(start, end - MAX_GAP_S)) & (fixes < end)).any():
            windows.append(Window(start_s=start, end_s=end))
            start += step
        else:
            start += 1.0
    return tuple(windows)


def _times(log: Log, rows: FloatArray) -> FloatArray:
    return log.gnss_time[np.isfinite(rows).all(axis=1)]


def _covered(times: FloatArray, start: float, stop: float) -> bool:
    """Tell whether there is an epoch every `MAX_GAP_S` or three intervals from start to stop."""
    if times.size < 2:
        return False
    limit = max(MAX_GAP_S, 3.0 * float(np.median(np.diff(times))))
    inside = times[(times >= start) & (times <= stop)]
    return bool(np.diff(np.concatenate(([start], inside, [stop]))).max() <= limit)


def without_gnss(log: Log, windows: Sequence[Window]) -> Log:
    """Return the log without the GNSS epochs in the windows, velocities and positions; the meta data tell."""
    return outages.without_gnss(log, [(window.start_s, window.end_s - window.start_s) for window in windows])


def check_length(length: float) -> None:
    """Refuse a length (s) that no test is possible with: below `SHORTEST_S`, or not finite."""
    if not (math.isfinite(length) and length >= SHORTEST_S):
        raise UsageError(f"An outage of {length:g} s cannot be tested; give {SHORTEST_S:g} s or more.")


def outage_test(
    log: Log,
    length: float,
    *,
    methods: Sequence[str] = METHODS_TRIED,
    params: MethodParams | None = None,
    lever_arm: Triple | None = None,
    progress: Progress | None = None,
    run: Runner | None = None,
) -> OutageTest:
    """Take GNSS out of a log in windows and see how far the position is off at their end.

    Parameters
    ----------
    log : Log
        The drive.
    length : float
        Of each outage, s.
    methods : sequence of str
        Names from `levelhead.estimators.METHODS`; of the first, a variant with the axle that does not slide is tried
        too, where its parameters know one (``rear_axle``) and do not name it yet.
    params : MethodParams, optional
        The constants of the methods, which must be theirs.
    lever_arm : (3,), optional
        From the IMU to the GNSS antenna, body axes, m.
    progress : callable, optional
        Called with the fraction done.
    run : callable, optional
        What runs a method over a log; `levelhead.estimate` where absent.

    Returns
    -------
    OutageTest
        With a reason instead of figures where the log is too short or has no positions.

    Raises
    ------
    UsageError
        For a length below `SHORTEST_S`, an unknown method or parameters of another one.
    """
    check_length(length)
    if log.position_llh is None or not np.isfinite(log.position_llh).all(axis=1).any():
        reason = "The log has no GNSS positions, so that a drift could not be seen; record positions too."
        return OutageTest(length_s=length, reason=reason)
    windows = outage_windows(log, length)
    if not windows:
        reason = (
            f"No outage of {length:g} s fits into this log of {log.duration:.0f} s: after the first "
            f"{min(FIRST_S, 0.25 * log.duration):.0f} s, GNSS must be there without a gap for {length:g} s before and "
            "after it. Try a shorter outage or a longer drive."
        )
        return OutageTest(length_s=length, reason=reason)
    variants = _variants(log, methods, params, lever_arm)
    runs = []
    for k, (name, method, constants) in enumerate(variants):
        if progress is not None:
            progress(k / len(variants))
        runs.append(_run(log, windows, name, method, constants, run or _estimate))
    if progress is not None:
        progress(1.0)
    return OutageTest(length_s=length, runs=tuple(runs))


def _estimate(log: Log, method: str, params: MethodParams) -> Result:
    return estimate(log, method, params=params)


def _variants(
    log: Log, methods: Sequence[str], params: MethodParams | None, lever_arm: Triple | None
) -> list[tuple[str, str, MethodParams]]:
    """Return name, method and constants of every run."""
    found = [(method, method, constants_of(log, method, params, lever_arm)) for method in methods]
    first = found[0][2]
    knows_axle = any(field.name == "rear_axle" for field in fields(first))
    if knows_axle and getattr(first, "rear_axle", None) is None:
        axle = type(first).from_dict({**first.as_dict(), "rear_axle": (0.0, 0.0, 0.0)})
        found.append((f"{methods[0]}, rear axle", methods[0], axle))
    return found


def _run(
    log: Log, windows: Sequence[Window], name: str, method: str, constants: MethodParams, runner: Runner
) -> OutageRun:
    try:
        errors = errors_of(log, runner(without_gnss(log, windows), method, constants), constants)
        aided = errors_of(log, runner(log, method, constants), constants)
    except (LogError, UsageError) as error:
        return OutageRun(name=name, refused=str(error))
    if errors is None or aided is None:
        sentence = f"The method {method} does not estimate positions, so that nothing drifts; choose one that does."
        return OutageRun(name=name, refused=sentence)
    return OutageRun(
        name=name,
        drifts=tuple(drift_of(log, window, errors) for window in windows),
        agreement=agreement_of(aided, windows[0].start_s),
    )
