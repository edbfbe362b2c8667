"""`validate`: known biases added to a recorded log and found again, as in Tereshkov (2015), section 4.

A recorded log has no true biases. What can be checked is the difference: the estimates with a known bias added, less
those without, less what was added. Its other test is here too: `sensitivity` to a change of each constant.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np

from levelhead.analysis.estimation import DEFAULT_METHOD, constants_for, estimate
from levelhead.analysis.metrics import START_UP_S, attitude_difference, json_list, json_number, rms
from levelhead.conventions import AXES, FloatArray
from levelhead.errors import LogError, UsageError
from levelhead.estimators.base import Result
from levelhead.estimators.params import MethodParams, Triple
from levelhead.estimators.streaming import Progress
from levelhead.logs.derive import velocity_from_position
from levelhead.logs.log import Log
from levelhead.version import __version__

GYRO_SIZES_DEG_S: Final = (0.05, -0.05, 0.2, -0.2, 0.5)
ACCEL_SIZES: Final = (0.1, -0.1, 0.3, -0.3)
GYRO_Z_SIZES_DEG_S: Final = (0.2, -0.2)
"""The vertical axis has an estimator of its own, the course's, in every method: two sizes show it."""
MEASURED: Final = frozenset({"gravity", "latitude"})
"""Parameters that are facts about the place and not choices: changing them by 20 % would say nothing."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """Biases to add to the readings: rad/s and m/s^2, body axes."""

    gyro_bias: Triple = (0.0, 0.0, 0.0)
    accel_bias: Triple = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("gyro_bias", "accel_bias"):
            value = getattr(self, name)
            if len(value) != 3 or not np.all(np.isfinite(value)):
                raise UsageError(f"{name} of a case is {value}; pass three finite numbers.")


def constants_of(log: Log, method: str, params: MethodParams | None, lever_arm: Triple | None) -> MethodParams:
    """Return the constants that all runs of an analysis share: those that `estimate` would take for this log."""
    data = log if log.velocity_ned is not None else velocity_from_position(log)
    return constants_for(data, method, params=params, lever_arm=lever_arm)[0]


def _single(axis: int, size: float) -> Triple:
    x, y, z = (size if k == axis else 0.0 for k in range(3))
    return x, y, z


def default_cases() -> tuple[Case, ...]:
    """Return biases of several signs and sizes: on each axis by itself, then on all of them together."""
    cases = [Case(gyro_bias=_single(axis, math.radians(size))) for axis in range(2) for size in GYRO_SIZES_DEG_S]
    cases += [Case(gyro_bias=_single(2, math.radians(size))) for size in GYRO_Z_SIZES_DEG_S]
    cases += [Case(accel_bias=_single(axis, size)) for axis in range(2) for size in ACCEL_SIZES]
    gyro = math.radians(0.2)
    for g, a in ((1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)):
        cases.append(Case(gyro_bias=(g * gyro, -g * gyro, g * gyro), accel_bias=(a * 0.3, a * 0.3, 0.0)))
    return tuple(cases)


def with_biases(log: Log, case: Case) -> Log:
    """Return a log with known biases added to its readings; the meta data tell."""
    added = f"gyro {case.gyro_bias} rad/s, accel {case.accel_bias} m/s^2"
    return replace(
        log,
        gyro=log.gyro + np.array(case.gyro_bias),
        accel=log.accel + np.array(case.accel_bias),
        meta={**log.meta, "biases_added": added},
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Recovery:
    """What became of one case.

    Attributes
    ----------
    case : Case
        What was added.
    gyro_error, accel_error : ndarray, shape (3,)
        Estimate with it less estimate without it less what was added, at the end of the log, rad/s and m/s^2; NaN on
        an axis that the method does not know in both runs.
    gyro_std, accel_std : ndarray, shape (3,)
        Sigmas of both runs combined; NaN where the method gives none.
    lost : tuple of str
        Axes ("accel x") that the method knows without the added bias and no longer knows with it.
    """

    case: Case
    gyro_error: FloatArray
    accel_error: FloatArray
    gyro_std: FloatArray
    accel_std: FloatArray
    lost: tuple[str, ...] = ()

    @property
    def within_3_sigma(self) -> bool | None:
        """Whether every recovery error is within three combined sigma; None without a sigma to compare with."""
        error = np.concatenate((self.gyro_error, self.accel_error))
        sigma = np.concatenate((self.gyro_std, self.accel_std))
        given = np.isfinite(error) & np.isfinite(sigma)
        return bool((np.abs(error[given]) <= 3.0 * sigma[given]).all()) if given.any() else None

    def as_dict(self) -> dict[str, object]:
        """Return the case as `validation.json` shows it."""
        deg = 180.0 / np.pi
        return {
            "added_gyro_deg_s": json_list(np.array(self.case.gyro_bias), deg),
            "added_accel_m_s2": json_list(np.array(self.case.accel_bias)),
            "gyro_error_deg_s": json_list(self.gyro_error, deg),
            "accel_error_m_s2": json_list(self.accel_error),
            "gyro_std_deg_s": json_list(self.gyro_std, deg),
            "accel_std_m_s2": json_list(self.accel_std),
            "within_3_sigma": self.within_3_sigma,
            "no_longer_known": list(self.lost),
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class Validation:
    """Added biases found again, on one log by one method.

    Attributes
    ----------
    method : str
        Its name in the registry.
    params : mapping
        Its constants, SI and radians.
    log_info : mapping
        As in `summary.json`.
    base : Result
        The estimates without added biases.
    recoveries : tuple of Recovery
        One per case.
    """

    method: str
    params: Mapping[str, object]
    log_info: Mapping[str, object]
    base: Result
    recoveries: tuple[Recovery, ...]

    def errors(self, sensor: str) -> FloatArray:
        """Return the recovery errors of "gyro" (rad/s) or "accel" (m/s^2), shape (cases, 3)."""
        return np.array([getattr(recovery, f"{sensor}_error") for recovery in self.recoveries])

    def worst(self, sensor: str) -> float:
        """Return the largest absolute recovery error, rad/s or m/s^2; NaN where no axis is known."""
        return largest(self.errors(sensor))

    def rms(self, sensor: str) -> float:
        """Return the RMS recovery error over cases and known axes, rad/s or m/s^2; NaN where no axis is known."""
        return float(rms(self.errors(sensor).ravel()))

    def as_dict(self) -> dict[str, object]:
        """Return the content of `validation.json`, less the sensitivity."""
        deg = 180.0 / np.pi
        judged = [r.within_3_sigma for r in self.recoveries if r.within_3_sigma is not None]
        return {
            "levelhead": __version__,
            "log": dict(self.log_info),
            "method": self.method,
            "params": dict(self.params),
            "known": {"gyro": list(self.base.known_gyro), "accel": list(self.base.known_accel)},
            "worst": {
                "gyro_deg_s": json_number(self.worst("gyro"), deg),
                "accel_m_s2": json_number(self.worst("accel")),
            },
            "rms": {"gyro_deg_s": json_number(self.rms("gyro"), deg), "accel_m_s2": json_number(self.rms("accel"))},
            "cases_within_3_sigma": sum(judged) if judged else None,
            "cases": [recovery.as_dict() for recovery in self.recoveries],
        }


def validate(
    log: Log,
    method: str = DEFAULT_METHOD,
    *,
    cases: Sequence[Case] | None = None,
    params: MethodParams | None = None,
    lever_arm: Triple | None = None,
    progress: Progress | None = None,
) -> Validation:
    """Add known biases to a log and see how well they are found again (Tereshkov 2015, section 4).

    Parameters
    ----------
    log : Log
        The drive.
    method : str
        A name from `levelhead.estimators.METHODS`.
    cases : sequence of Case, optional
        What to add; `default_cases` where absent.
    params : MethodParams, optional
        The method's constants.
    lever_arm : (3,), optional
        From the IMU to the GNSS antenna, body axes, m.
    progress : callable, optional
        Called with the fraction done.

    Raises
    ------
    UsageError
        For an unknown method, parameters of another one, or no case at all.
    LogError
        When the method refuses the log.
    """
    chosen = default_cases() if cases is None else tuple(cases)
    if not chosen:
        raise UsageError("There is no case to validate with; pass at least one.")
    # The same constants for all runs: the noise that a filter finds in the log is not what is tried here.
    constants = constants_of(log, method, params, lever_arm)
    base = estimate(log, method, params=constants)
    recoveries = []
    for k, case in enumerate(chosen):
        if progress is not None:
            progress((k + 1) / (len(chosen) + 1))
        loaded = estimate(with_biases(log, case), method, params=constants)
        recoveries.append(_recovery(case, base, loaded))
    if progress is not None:
        progress(1.0)
    return Validation(
        method=method, params=base.params, log_info=base.log_info, base=base, recoveries=tuple(recoveries)
    )


def _recovery(case: Case, base: Result, loaded: Result) -> Recovery:
    found: dict[str, FloatArray] = {}
    for sensor, added in (("gyro", case.gyro_bias), ("accel", case.accel_bias)):
        known = np.array(getattr(base, f"known_{sensor}")) & np.array(getattr(loaded, f"known_{sensor}"))
        bias, sigma = f"{sensor}_bias", f"{sensor}_bias_std"
        error = getattr(loaded, bias)[-1] - getattr(base, bias)[-1] - np.array(added)
        found[f"{sensor}_error"] = np.where(known, error, np.nan)
        found[f"{sensor}_std"] = np.where(known, np.hypot(getattr(loaded, sigma)[-1], getattr(base, sigma)[-1]), np.nan)
    return Recovery(
        case=case,
        gyro_error=found["gyro_error"],
        accel_error=found["accel_error"],
        gyro_std=found["gyro_std"],
        accel_std=found["accel_std"],
        lost=_lost(base, loaded),
    )


def _lost(base: Result, other: Result) -> tuple[str, ...]:
    """Return the axes that are known in one result and not in the other, such as "accel x"."""
    return tuple(
        f"{sensor} {axis}"
        for sensor in ("gyro", "accel")
        for axis, before, after in zip(
            AXES, getattr(base, f"known_{sensor}"), getattr(other, f"known_{sensor}"), strict=True
        )
        if before and not after
    )


def largest(values: FloatArray) -> float:
    """Return the largest absolute value among those that are finite; NaN where none is."""
    finite = np.abs(values[np.isfinite(values)])
    return float(finite.max()) if finite.size else math.nan


@dataclass(frozen=True, kw_only=True, eq=False)
class Change:
    """What the change of one constant does.

    Attributes
    ----------
    name : str
        The constant.
    change : float
        As a fraction: 0.2 is 20 % more.
    gyro, accel : ndarray, shape (3,)
        Change of the final biases, rad/s and m/s^2; NaN on an axis that is not known in both runs.
    tilt : ndarray, shape (2,)
        RMS change of roll and pitch after the start-up, rad.
    lost : tuple of str
        Axes that are known without the change and no longer with it.
    refused : str
        Why the change is not possible; empty where it is.
    """

    name: str
    change: float
    gyro: FloatArray
    accel: FloatArray
    tilt: FloatArray
    lost: tuple[str, ...] = ()
    refused: str = ""

    def as_dict(self) -> dict[str, object]:
        """Return the change as `validation.json` shows it."""
        deg = 180.0 / np.pi
        return {
            "constant": self.name,
            "change": self.change,
            "gyro_deg_s": json_list(self.gyro, deg),
            "accel_m_s2": json_list(self.accel),
            "roll_pitch_rms_deg": json_list(self.tilt, deg),
            "no_longer_known": list(self.lost),
            "refused": self.refused or None,
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class Sensitivity:
    """How far a method's estimates depend on its constants, on one log."""

    method: str
    changes: tuple[Change, ...]

    def worst(self, sensor: str) -> float:
        """Return the largest change of a final bias, "gyro" (rad/s) or "accel" (m/s^2); NaN where none is known."""
        return largest(np.array([getattr(change, sensor) for change in self.changes] or [[np.nan]]))

    def as_dict(self) -> dict[str, object]:
        """Return the table as `validation.json` shows it."""
        return {
            "worst": {
                "gyro_deg_s": json_number(self.worst("gyro"), 180.0 / np.pi),
                "accel_m_s2": json_number(self.worst("accel")),
            },
            "changes": [change.as_dict() for change in self.changes],
        }


def sensitivity(
    log: Log,
    method: str = DEFAULT_METHOD,
    *,
    change: float = 0.2,
    params: MethodParams | None = None,
    lever_arm: Triple | None = None,
    progress: Progress | None = None,
) -> Sensitivity:
    """Change each constant of a method up and down, one at a time, and see how far the estimates move.

    Tereshkov (2015), section 4, reports less than 0.001 deg/s and 0.01 m/s^2 for 20 %. The constants are the numbers
    among the method's parameters but for gravity and latitude, which are facts about the place.

    Parameters
    ----------
    log, method, params, lever_arm, progress
        As in `validate`.
    change : float
        As a fraction, between 0 and 1.

    Raises
    ------
    UsageError
        For an unknown method, parameters of another one, or a change out of range.
    LogError
        When the method refuses the log.
    """
    if not 0.0 < change < 1.0:
        raise UsageError(f"The change is {change}; give a fraction between 0 and 1, such as 0.2.")
    constants = constants_of(log, method, params, lever_arm)
    base = estimate(log, method, params=constants)
    names = [field.name for field in fields(constants) if _is_choice(field.name, getattr(constants, field.name))]
    tries = [(name, sign * change) for name in names for sign in (1.0, -1.0)]
    changes = []
    for k, (name, part) in enumerate(tries):
        if progress is not None:
            progress(k / len(tries))
        changes.append(_changed(log, method, constants, name, part, base))
    if progress is not None:
        progress(1.0)
    return Sensitivity(method=method, changes=tuple(changes))


def _is_choice(name: str, value: object) -> bool:
    return isinstance(value, float) and name not in MEASURED


def _changed(log: Log, method: str, constants: MethodParams, name: str, part: float, base: Result) -> Change:
    nothing = np.full(3, np.nan)
    try:
        moved = replace(constants, **{name: getattr(constants, name) * (1.0 + part)})
        result = estimate(log, method, params=moved)
    except (UsageError, LogError) as error:
        return Change(name=name, change=part, gyro=nothing, accel=nothing, tilt=nothing[:2], refused=str(error))
    late = result.time - result.time[0] >= min(START_UP_S, 0.5 * log.duration)
    return Change(
        name=name,
        change=part,
        gyro=_moved(result, base, "gyro"),
        accel=_moved(result, base, "accel"),
        tilt=rms(attitude_difference(result, base)[late, :2]),
        lost=_lost(base, result),
    )


def _moved(result: Result, base: Result, sensor: str) -> FloatArray:
    known = np.array(getattr(result, f"known_{sensor}")) & np.array(getattr(base, f"known_{sensor}"))
    difference = getattr(result, f"{sensor}_bias")[-1] - getattr(base, f"{sensor}_bias")[-1]
    out: FloatArray = np.where(known, difference, np.nan)
    return out
