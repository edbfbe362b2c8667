"""`compare`: every method on one log, side by side, and beside the truth where there is one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import Final

import numpy as np
from numpy.typing import NDArray

from levelhead.analysis.estimation import estimate
from levelhead.analysis.metrics import START_UP_S, attitude_difference, json_list, json_number, rms
from levelhead.conventions import FloatArray
from levelhead.errors import LogError, UsageError
from levelhead.estimators import METHODS
from levelhead.estimators.base import Result
from levelhead.estimators.params import MethodParams
from levelhead.estimators.streaming import Progress
from levelhead.logs.log import Log
from levelhead.sim import Truth
from levelhead.version import __version__

PREFERRED_REFERENCE: Final = "smoother"
"""What the others are measured against where it is among them: it has seen the whole log at every instant."""
SPEED_UNIT: Final = "observer"
"""Run times are given as multiples of this method's."""

Clock = Callable[[], float]
Rows = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class Errors:
    """RMS errors against the truth after `Comparison.after_s`, rad/s, m/s^2 and rad; NaN where not estimated.

    Attributes
    ----------
    gyro_bias, accel_bias : ndarray, shape (3,)
        Body x, y, z.
    attitude : ndarray, shape (3,)
        Roll, pitch, heading.
    """

    gyro_bias: FloatArray
    accel_bias: FloatArray
    attitude: FloatArray

    def as_dict(self) -> dict[str, object]:
        """Return the errors as `comparison.json` shows them."""
        return {
            "gyro_bias_deg_s": json_list(self.gyro_bias, 180.0 / np.pi),
            "accel_bias_m_s2": json_list(self.accel_bias),
            "attitude_deg": json_list(self.attitude, 180.0 / np.pi),
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class Entry:
    """One method's share of a comparison.

    Attributes
    ----------
    method : str
        Its name in the registry.
    runtime_s : float
        Time of the estimation, s.
    runtime_ratio : float or None
        The same in multiples of the observer's; None where the observer did not run.
    attitude_difference : ndarray, shape (3,)
        RMS of roll, pitch and heading less those of the reference, after `Comparison.after_s`, rad.
    attitude_in_sigma, gyro_in_sigma, accel_in_sigma : ndarray, shape (3,)
        RMS of the differences from the reference in units of both sigmas combined, after `Comparison.after_s`; NaN
        where a sigma is not given or a bias is not known in the end. Methods that read the same log share its noise:
        beyond 3 they contradict each other, a small value proves nothing.
    errors : Errors or None
        Against the truth, where there is one.
    result : Result or None
        The estimates; None where the method failed.
    failure : str
        Why it failed; empty where it did not.
    """

    method: str
    runtime_s: float = np.nan
    runtime_ratio: float | None = None
    attitude_difference: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    attitude_in_sigma: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    gyro_in_sigma: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    accel_in_sigma: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    errors: Errors | None = None
    result: Result | None = None
    failure: str = ""

    def as_dict(self) -> dict[str, object]:
        """Return the entry as `comparison.json` shows it; the biases are those of the method's own `summary.json`."""
        if self.result is None:
            return {"failed": self.failure}
        summary = self.result.summary()
        kept = ("gyro_bias_deg_s", "gyro_bias_std_deg_s", "accel_bias_m_s2", "accel_bias_std_m_s2", "known")
        return {
            "failed": None,
            **{key: summary[key] for key in (*kept, "settled_at_s", "params", "events")},
            "attitude_difference_deg": json_list(self.attitude_difference, 180.0 / np.pi),
            "attitude_difference_sigma": json_list(self.attitude_in_sigma),
            "gyro_difference_sigma": json_list(self.gyro_in_sigma),
            "accel_difference_sigma": json_list(self.accel_in_sigma),
            "error_rms": None if self.errors is None else self.errors.as_dict(),
            "runtime_s": json_number(self.runtime_s),
            "runtime_ratio": json_number(self.runtime_ratio),
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """Several methods on one log.

    Attributes
    ----------
    entries : tuple of Entry
        In the order in which they were asked for, failed ones included.
    reference : str
        The method that the others are measured against.
    after_s : float
        RMS values count from here on, s after the log's start.
    log_info : mapping
        As in `summary.json`.
    truth : Truth or None
        What the errors were measured against.
    """

    entries: tuple[Entry, ...]
    reference: str
    after_s: float
    log_info: Mapping[str, object]
    truth: Truth | None = None

    def __getitem__(self, method: str) -> Entry:
        """Return one method's entry."""
        return next(entry for entry in self.entries if entry.method == method)

    @property
    def results(self) -> dict[str, Result]:
        """The estimates of the methods that did not fail, by name."""
        return {entry.method: entry.result for entry in self.entries if entry.result is not None}

    def as_dict(self) -> dict[str, object]:
        """Return the content of `comparison.json`."""
        return {
            "levelhead": __version__,
            "log": dict(self.log_info),
            "reference": self.reference,
            "after_s": self.after_s,
            "methods": {entry.method: entry.as_dict() for entry in self.entries},
        }


def compare(
    log: Log,
    methods: Sequence[str] | None = None,
    *,
    params: Mapping[str, MethodParams] | None = None,
    truth: Truth | None = None,
    reference: str | None = None,
    lever_arm: tuple[float, float, float] | None = None,
    after: float = START_UP_S,
    progress: Progress | None = None,
    clock: Clock = perf_counter,
) -> Comparison:
    """Run several methods over one log.

    Parameters
    ----------
    log : Log
        The drive.
    methods : sequence of str, optional
        Names from `levelhead.estimators.METHODS`; all of them where absent.
    params : mapping, optional
        Constants by method; defaults for those that are not in it.
    truth : Truth, optional
        The truth of a simulated drive, at the log's samples.
    reference : str, optional
        The method that the others are measured against; the smoother, or else the first that did not fail.
    lever_arm : (3,), optional
        From the IMU to the GNSS antenna, body axes, m, for every method.
    after : float
        RMS values count from here on, s after the log's start; on a log that is shorter, over its second half.
    progress : callable, optional
        Called with the fraction done.
    clock : callable
        Seconds, for the run times.

    Returns
    -------
    Comparison
        A method that fails on this log is in it with the reason; the others go on.

    Raises
    ------
    UsageError
        For an unknown or repeated method, parameters of another method, or a truth of another log.
    LogError
        When every method failed; the sentence of the first.
    """
    names = chosen_methods(methods)
    if reference is not None and reference not in names:
        raise UsageError(f"The reference {reference!r} is not among the compared methods ({', '.join(names)}).")
    if truth is not None and truth.time.size != log.time.size:
        raise UsageError(
            f"The truth has {truth.time.size} samples and the log {log.time.size}; pass the truth of this very log."
        )
    foreign = set(params or {}) - set(names)
    if foreign:
        raise UsageError(f"There are parameters for {', '.join(sorted(foreign))}, which is not compared.")
    runs: dict[str, tuple[Result | None, float, str]] = {}
    for k, name in enumerate(names):
        runs[name] = _run(log, name, (params or {}).get(name), lever_arm, _part(progress, k, len(names)), clock)
    finished = [name for name in names if runs[name][0] is not None]
    if not finished:
        raise LogError(runs[names[0]][2])
    chosen = _reference(reference, finished)
    after_s = after if after < log.duration else 0.5 * log.duration
    base, unit = runs[chosen][0], runs[SPEED_UNIT][1] if SPEED_UNIT in finished else None
    return Comparison(
        entries=tuple(_entry(name, *runs[name], base, truth, after_s, unit) for name in names),
        reference=chosen,
        after_s=after_s,
        log_info=log.describe(),
        truth=truth,
    )


def chosen_methods(methods: Sequence[str] | None) -> tuple[str, ...]:
    """Return the names of the methods asked for, all where none is; a UsageError for an unknown or repeated one."""
    names = tuple(METHODS) if methods is None else tuple(methods)
    for name in names:
        if name not in METHODS:
            raise UsageError(f"There is no method {name!r}; choose from {', '.join(METHODS)}.")
    if not names or len(set(names)) < len(names):
        raise UsageError(f"The methods are {', '.join(names) or 'none'}; name at least one, and each once.")
    return names


def _part(progress: Progress | None, k: int, count: int) -> Progress | None:
    """Return the progress of the k-th of several equal parts."""
    if progress is None:
        return None
    return lambda fraction: progress((k + fraction) / count)


def _run(
    log: Log,
    method: str,
    params: MethodParams | None,
    lever_arm: tuple[float, float, float] | None,
    progress: Progress | None,
    clock: Clock,
) -> tuple[Result | None, float, str]:
    """Run one method: its result, its time, and the sentence of its failure."""
    begin = clock()
    try:
        result = estimate(log, method, params=params, lever_arm=lever_arm, progress=progress)
    except LogError as error:
        return None, clock() - begin, str(error)
    return result, clock() - begin, ""


def _reference(wanted: str | None, finished: Sequence[str]) -> str:
    for name in (wanted, PREFERRED_REFERENCE):
        if name is not None and name in finished:
            return name
    return finished[0]


def _entry(
    method: str,
    result: Result | None,
    runtime_s: float,
    failure: str,
    base: Result | None,
    truth: Truth | None,
    after_s: float,
    unit: float | None,
) -> Entry:
    if result is None or base is None:
        return Entry(method=method, failure=failure, runtime_s=runtime_s)
    late = result.time - result.time[0] >= after_s
    apart = attitude_difference(result, base)
    return Entry(
        method=method,
        runtime_s=runtime_s,
        runtime_ratio=runtime_s / unit if unit else None,
        attitude_difference=rms(apart[late]),
        attitude_in_sigma=_in_sigma(apart[late], result.attitude_std[late], base.attitude_std[late]),
        gyro_in_sigma=_bias_in_sigma(result, base, late, "gyro"),
        accel_in_sigma=_bias_in_sigma(result, base, late, "accel"),
        errors=None if truth is None else errors_of(result, truth, late),
        result=result,
    )


def _bias_in_sigma(result: Result, base: Result, late: Rows, sensor: str) -> FloatArray:
    """Return the RMS difference of the biases (3,) in combined sigmas, NaN where either does not know the axis."""
    bias, sigma = f"{sensor}_bias", f"{sensor}_bias_std"
    known = np.array(getattr(result, f"known_{sensor}")) & np.array(getattr(base, f"known_{sensor}"))
    apart = (getattr(result, bias) - getattr(base, bias))[late]
    out: FloatArray = np.where(
        known, _in_sigma(apart, getattr(result, sigma)[late], getattr(base, sigma)[late]), np.nan
    )
    return out


def _in_sigma(apart: FloatArray, one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the RMS over the rows of differences in units of both sigmas combined, skipping rows without a sigma."""
    combined = np.hypot(one, other)
    usable = np.isfinite(combined) & (combined > 0.0)
    return rms(np.where(usable, apart / np.where(usable, combined, 1.0), np.nan))


def errors_of(result: Result, truth: Truth, late: Rows) -> Errors:
    """Return the RMS errors of a result over the samples marked in `late` (n,)."""
    return Errors(
        gyro_bias=rms((result.gyro_bias - truth.gyro_bias)[late]),
        accel_bias=rms((result.accel_bias - truth.accel_bias)[late]),
        attitude=rms(attitude_difference(result, truth)[late]),
    )
