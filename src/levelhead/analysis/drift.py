"""How far an estimated position is from GNSS: at the end of an outage that was made, and where GNSS is seen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from levelhead.analysis.metrics import json_number, rms
from levelhead.conventions import FloatArray
from levelhead.earth import offset_ned, shortest_turn, steps_ned
from levelhead.estimators.base import Result
from levelhead.estimators.params import MethodParams
from levelhead.estimators.reference import in_ned
from levelhead.logs.log import Log


@dataclass(frozen=True, kw_only=True)
class Window:
    """GNSS epochs with ``start_s <= time < end_s`` are taken out."""

    start_s: float
    end_s: float


@dataclass(frozen=True, kw_only=True)
class Drift:
    """How far the position was off at the last fix that was taken out of one window.

    Attributes
    ----------
    window : Window
        What was taken out.
    compared_s : float
        Time of that fix, s.
    horizontal_m, vertical_m : float
        Distance of the estimated antenna from the fix, m; NaN where no position was estimated.
    horizontal_std_m, vertical_std_m : float
        What the method claims, one sigma of that distance with the fix's own, m.
    largest_m : float
        Largest horizontal distance within the window, m: of a smoother it lies in the middle.
    distance_m : float
        Driven since the window's start, m.
    """

    window: Window
    compared_s: float
    horizontal_m: float
    vertical_m: float
    horizontal_std_m: float
    vertical_std_m: float
    largest_m: float
    distance_m: float

    @property
    def in_sigma(self) -> float:
        """Horizontal drift over the claimed sigma; NaN without one."""
        return self.horizontal_m / self.horizontal_std_m if self.horizontal_std_m > 0.0 else math.nan

    @property
    def vertical_in_sigma(self) -> float:
        """Vertical drift over the claimed sigma; NaN without one."""
        return self.vertical_m / self.vertical_std_m if self.vertical_std_m > 0.0 else math.nan

    @property
    def percent(self) -> float:
        """Horizontal drift in per cent of the distance driven; NaN for a vehicle that stood."""
        return 100.0 * self.horizontal_m / self.distance_m if self.distance_m >= 1.0 else math.nan

    def as_dict(self) -> dict[str, object]:
        """Return the window as `validation.json` shows it."""
        return {
            "start_s": self.window.start_s,
            "end_s": self.window.end_s,
            "compared_at_s": self.compared_s,
            "horizontal_m": json_number(self.horizontal_m),
            "horizontal_std_m": json_number(self.horizontal_std_m),
            "horizontal_in_sigma": json_number(self.in_sigma),
            "vertical_m": json_number(self.vertical_m),
            "vertical_std_m": json_number(self.vertical_std_m),
            "vertical_in_sigma": json_number(self.vertical_in_sigma),
            "largest_horizontal_m": json_number(self.largest_m),
            "distance_m": json_number(self.distance_m),
            "percent_of_distance": json_number(self.percent),
        }


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """Estimated antenna less GNSS on the complete log: RMS in m, and in units of both sigmas combined."""

    epochs: int
    horizontal_m: float
    vertical_m: float
    horizontal_in_sigma: float
    vertical_in_sigma: float

    def as_dict(self) -> dict[str, object]:
        """Return the comparison as `validation.json` shows it."""
        numbers = {field.name: json_number(getattr(self, field.name)) for field in fields(self)}
        return {**numbers, "epochs": self.epochs}


@dataclass(frozen=True, kw_only=True, eq=False)
class Errors:
    """Estimated antenna less GNSS at each fix (k, 3), NED, m, and one sigma of both together."""

    time: FloatArray
    ned: FloatArray
    std: FloatArray


def errors_of(log: Log, result: Result, constants: MethodParams) -> Errors | None:
    """Compare a result with the GNSS positions of a log, in it or not; None where it has no estimated positions.

    The antenna's place is that of the IMU and the lever arm, turned by the estimated attitude.
    """
    llh, sigma = log.position_llh, result.position_std
    if llh is None or sigma is None or result.position_llh is None:
        return None
    there = np.isfinite(llh).all(axis=1) & (log.gnss_time >= log.time[0]) & (log.gnss_time <= log.time[-1])
    time, fix = log.gnss_time[there], llh[there]
    euler = np.column_stack((result.roll, result.pitch, result.heading))
    imu = _between(result.time, result.position_llh, time, angles=(0, 1))
    roll, pitch, heading = _between(result.time, euler, time, angles=(0, 1, 2)).T
    arm = in_ned(roll, pitch, heading, constants.lever_arm)
    ned = offset_ned(fix, imu) + arm
    own = _fix_std(log, constants)[there]
    # Where the clocks differ, the antenna has moved on meanwhile.
    late = getattr(constants, "timing_std", 0.0) * _between(result.time, result.velocity_ned, time)
    own = np.hypot(own, late)
    return Errors(time=time, ned=ned, std=np.hypot(_between(result.time, sigma, time), own))


def _between(time: FloatArray, rows: FloatArray, at: FloatArray, *, angles: Sequence[int] = ()) -> FloatArray:
    """Interpolate rows (n, 3) between the two samples round each time, some columns the short way round; NaN stays."""
    after = np.clip(np.searchsorted(time, at), 1, time.size - 1)
    share = ((at - time[after - 1]) / (time[after] - time[after - 1]))[:, None]
    step = rows[after] - rows[after - 1]
    for column in angles:
        step[:, column] = shortest_turn(step[:, column])
    out: FloatArray = rows[after - 1] + share * step
    return out


def _fix_std(log: Log, constants: MethodParams) -> FloatArray:
    """Return one sigma of every fix (m, 3), m: the log's, else the method's constant, else nothing."""
    if log.position_std is None:
        std = np.asarray(getattr(constants, "position_std", 0.0), dtype=np.float64)
    else:
        std = log.position_std if log.position_std.ndim == 2 else log.position_std[:, None]
    return np.nan_to_num(np.broadcast_to(std, (log.gnss_time.size, 3)), nan=0.0)


def drift_of(log: Log, window: Window, errors: Errors) -> Drift:
    """Return how far the position is off at the last fix of a window, which must have one."""
    inside = np.flatnonzero((errors.time >= window.start_s) & (errors.time < window.end_s))
    last = inside[-1]
    horizontal = np.hypot(errors.ned[inside, 0], errors.ned[inside, 1])
    known = horizontal[np.isfinite(horizontal)]
    return Drift(
        window=window,
        compared_s=float(errors.time[last]),
        horizontal_m=float(horizontal[-1]),
        vertical_m=float(abs(errors.ned[last, 2])),
        horizontal_std_m=float(np.hypot(errors.std[last, 0], errors.std[last, 1])),
        vertical_std_m=float(errors.std[last, 2]),
        largest_m=float(known.max()) if known.size else math.nan,
        distance_m=_driven(log, window.start_s, float(errors.time[last])),
    )


def _driven(log: Log, start: float, stop: float) -> float:
    """Return the distance between two times from the GNSS speed, or the steps of a log without velocities, m."""
    within = (log.gnss_time >= start) & (log.gnss_time <= stop)
    if log.velocity_ned is not None:
        there = within & np.isfinite(log.velocity_ned).all(axis=1)
        time, speed = log.gnss_time[there], np.hypot(log.velocity_ned[there, 0], log.velocity_ned[there, 1])
        at = np.array([start, *time, stop])  # the speed at the edges is that of the nearest epoch
        speed_at = np.interp(at, time, speed) if time.size else np.full(at.size, np.nan)
        return float(np.sum(0.5 * (speed_at[1:] + speed_at[:-1]) * np.diff(at)))
    if log.position_llh is None:
        return math.nan
    steps = steps_ned(log.position_llh[within & np.isfinite(log.position_llh).all(axis=1)])
    return float(np.hypot(steps[:, 0], steps[:, 1]).sum())


def agreement_of(errors: Errors, start: float) -> Agreement:
    """Return the RMS difference from a time on, s; the sigma knows the clocks' difference (`timing_std`), too."""
    late = (errors.time >= start) & np.isfinite(errors.ned).all(axis=1)
    ned = errors.ned[late]
    ratio = rms(np.divide(ned, errors.std[late], out=np.full(ned.shape, np.nan), where=errors.std[late] > 0.0))
    return Agreement(
        epochs=int(late.sum()),
        horizontal_m=float(np.hypot(*rms(ned)[:2])),
        vertical_m=float(rms(ned)[2]),
        horizontal_in_sigma=float(rms(ratio[:2])),
        vertical_in_sigma=float(ratio[2]),
    )
