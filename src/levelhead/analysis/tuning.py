"""Constants for the papers' estimators from this drive and these sensors: the covariance recursion, minimised.

The papers choose tau, tau_gyro and omega_accel by experience. The recursion that tells how sure the estimators are
(`levelhead.estimators.uncertainty`) depends on the drive only through its epochs, so it can be asked what other
constants would have given, without running the estimator again.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np

from levelhead.analysis.noise import density
from levelhead.conventions import FloatArray
from levelhead.errors import LogError, UsageError
from levelhead.estimators.observer import Observer, ObserverParams, predict_observer
from levelhead.estimators.params import NoiseParams, PlatformParams
from levelhead.estimators.streaming import run
from levelhead.estimators.trust import ACCEL_BAND, GYRO_BAND
from levelhead.estimators.two_stage import TwoStage, TwoStageParams, predict_two_stage
from levelhead.estimators.uncertainty import EpochRecorder, Epochs
from levelhead.logs.derive import velocity_from_position
from levelhead.logs.log import Log

TUNABLE: Final[dict[str, tuple[str, str, str]]] = {
    "observer": ("tau", "tau_gyro", "omega_accel"),
    "two-stage": ("tau", "tau_gyro_lowpass", "tau_accel_lowpass"),
}
"""The constants that are tuned, per method; tau_heading and the thresholds stay as they are."""

OUTAGE: Final = 10.0
"""A gyro bias error counts as the tilt that it makes in a GNSS outage of this length, s."""
SLOWEST_TAU: Final = 20.0
"""No tau longer than this is proposed, s: beyond it errors that no noise model knows would rule."""
LONGEST_BIAS: Final = 600.0
"""Nor a bias time constant longer than this, s."""
EPOCHS_USED: Final = 36_000
"""Epochs of a longer log that are left out: an hour at 10 Hz holds all kinds of turns that a drive has."""


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """What some constants give on this drive: sigmas (RMS over its second half), and when the biases have settled.

    Attributes
    ----------
    tilt, gyro, accel : float
        One sigma of roll and pitch (rad), of the horizontal gyro (rad/s) and accelerometer (m/s^2) biases.
    gyro_settled_s, accel_settled_s : float or None
        Time from the start after which two sigmas stay within 0.02 deg/s and 0.04 m/s^2, s; None: not on this drive.
    """

    tilt: float
    gyro: float
    accel: float
    gyro_settled_s: float | None
    accel_settled_s: float | None

    def cost(self, gravity: float) -> float:
        """Return the variance that is minimised, rad^2: all as tilt.

        Roll and pitch as they are, the accelerometer bias as the tilt it would be taken for, and the gyro bias as the
        tilt that it makes in an outage of `OUTAGE`.
        """
        return self.tilt**2 + (self.accel / gravity) ** 2 + (self.gyro * OUTAGE) ** 2


@dataclass(frozen=True, kw_only=True)
class Tuning:
    """A proposal: constants, what they give on this drive, and what those before gave.

    Attributes
    ----------
    method : str
        "observer" or "two-stage".
    params : ObserverParams or TwoStageParams
        The proposed constants.
    noise : NoiseParams
        What was taken as random.
    before, after : Prediction
        With the constants to start from, and with the proposed ones.
    """

    method: str
    params: ObserverParams | TwoStageParams
    noise: NoiseParams
    before: Prediction
    after: Prediction


def propose(
    log: Log,
    method: str = "observer",
    noise: NoiseParams | None = None,
    *,
    params: ObserverParams | TwoStageParams | None = None,
) -> Tuning:
    """Propose constants for a fixed-gain method that suit this drive's turns and its sensors' noise.

    Minimises `Prediction.cost` over the three constants of `TUNABLE` with the other parameters as given. The poles stay
    apart as in the papers: each bias is slower than four tau (in the drive's fastest turns for omega_accel), and tau is
    two GNSS intervals at least.

    Parameters
    ----------
    log : Log
        The drive.
    method : str
        "observer" or "two-stage".
    noise : NoiseParams, optional
        What is random in the sensors; measured in the log where absent (`measure_noise`).
    params : ObserverParams or TwoStageParams, optional
        Constants to start from and to compare with; the defaults where absent.

    Raises
    ------
    UsageError
        For a method without constants to tune, or parameters of another method.
    LogError
        When the log has no usable GNSS velocity, or never had the loop closed.
    """
    if method not in TUNABLE:
        raise UsageError(f"The method {method!r} has no gains to tune; choose one of {', '.join(TUNABLE)}.")
    start = params or (ObserverParams() if method == "observer" else TwoStageParams())
    if isinstance(start, ObserverParams) != (method == "observer"):
        raise UsageError(f"The method {method!r} cannot use {type(start).__name__}; pass its own parameters.")
    epochs = record(log, start)
    random = noise or _measured(log, epochs)
    epochs = Epochs(rows=np.ascontiguousarray(epochs.rows[:EPOCHS_USED]))
    names, tuned_with = _tunable(epochs, start, random)

    def candidate(point: FloatArray) -> ObserverParams | TwoStageParams:
        values = dict(zip(names, (float(v) for v in np.exp(point)), strict=True))
        return _limited(_changed(start, values), epochs)

    def cost(point: FloatArray) -> float:
        return _predict(epochs, candidate(point), tuned_with).cost(start.gravity)

    first = np.log([getattr(start, name) for name in names])
    best = candidate(simplex_minimum(cost, first))
    rounded = _changed(best, {name: float(f"{getattr(best, name):.3g}") for name in names})
    if not _predict(epochs, rounded, tuned_with).cost(start.gravity) < cost(first):
        rounded = start
    return Tuning(
        method=method,
        params=rounded,
        noise=random,
        before=_predict(epochs, start, random),
        after=_predict(epochs, rounded, random),
    )


def _tunable(
    epochs: Epochs, start: ObserverParams | TwoStageParams, noise: NoiseParams
) -> tuple[tuple[str, ...], NoiseParams]:
    """Return the constants that this drive can tell about, and the noise to tune them with.

    Without turns no constant teaches the accelerometer bias. It then fills nearly all of the tilt's variance, and a
    search would chase what remains of it: the accelerometer's constant stays, and the others are tuned as if the bias
    were known.
    """
    names = TUNABLE["two-stage" if isinstance(start, TwoStageParams) else "observer"]
    eager = _limited(_changed(start, {names[2]: 1e-3}), epochs)
    prior = noise.initial_accel_bias_std
    if _predict(epochs, eager, noise).accel > 0.5 * prior and _predict(epochs, start, noise).accel > 0.5 * prior:
        return names[:2], replace(noise, initial_accel_bias_std=1e-6)
    return names, noise


def _changed(params: ObserverParams | TwoStageParams, values: dict[str, float]) -> ObserverParams | TwoStageParams:
    """Return the parameters with some of their numbers changed."""
    return type(params).from_dict({**params.as_dict(), **values})


def record(log: Log, params: PlatformParams) -> Epochs:
    """Run the estimator that these parameters belong to and return the epochs that it closed."""
    data = log if log.velocity_ned is not None else velocity_from_position(log)
    stream = TwoStage(params) if isinstance(params, TwoStageParams) else Observer(_observer(params))
    recorder = EpochRecorder(run_recorded=stream.run_recorded)
    run(stream, data, recorder=recorder)
    if not (recorder.epochs["level"] > 0.0).any():
        raise LogError(
            "The log never let the attitude be corrected by GNSS, so there is nothing to tune or to measure."
        )
    return recorder.epochs


def _observer(params: PlatformParams) -> ObserverParams:
    """Return observer constants on the same platform."""
    if isinstance(params, ObserverParams):
        return params
    return ObserverParams(**{f.name: getattr(params, f.name) for f in fields(PlatformParams)})


def _limited(params: ObserverParams | TwoStageParams, epochs: Epochs) -> ObserverParams | TwoStageParams:
    """Return the nearest constants that keep the loop's poles apart."""
    length = float(np.median(epochs["length"][epochs["level"] > 0.0]))
    tau = float(np.clip(params.tau, 2.0 * length, SLOWEST_TAU))
    slow = 4.0 * tau

    def bias(value: float, fastest: float) -> float:
        return float(np.clip(value, fastest, max(fastest, LONGEST_BIAS)))

    if isinstance(params, TwoStageParams):
        return replace(
            params,
            tau=tau,
            tau_gyro_lowpass=bias(params.tau_gyro_lowpass, max(slow, 4.0 * params.tau_heading)),
            tau_accel_lowpass=bias(params.tau_accel_lowpass, slow),
        )
    # In a turn at w_z the accelerometer learns at the rate w_z^2 / (omega_a (1 + (w_z tau)^2)).
    rate = float(np.percentile(np.abs(epochs["turn"]) / np.maximum(epochs["length"], 1e-6), 95.0))
    square = rate**2 / (1.0 + (rate * tau) ** 2)
    return replace(
        params,
        tau=tau,
        tau_gyro=bias(params.tau_gyro, max(slow, 4.0 * params.tau_heading)),
        omega_accel=float(np.clip(params.omega_accel, max(square * slow, math.radians(5.0)), 10.0)),
    )


def _predict(epochs: Epochs, params: ObserverParams | TwoStageParams, noise: NoiseParams) -> Prediction:
    """Run the recursion and sum it up."""
    if isinstance(params, TwoStageParams):
        level = predict_two_stage(epochs, params, noise)
    else:
        level = predict_observer(epochs, params, noise)
    time = epochs["time"] - epochs["time"][0]
    late = time >= 0.5 * time[-1]
    # The mean over the interval that follows, while the control rate moves the tilt.
    length = epochs["length"]
    tilt = level.tilt**2 - length * level.tilt_control + (length * level.control) ** 2 / 3.0
    return Prediction(
        tilt=_rms(np.sqrt(np.maximum(tilt[late], 0.0))),
        gyro=_rms(level.gyro[late]),
        accel=_rms(level.accel[late]),
        gyro_settled_s=_settled(time, level.gyro, 0.5 * GYRO_BAND),
        accel_settled_s=_settled(time, level.accel, 0.5 * ACCEL_BAND),
    )


def _rms(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("inf")


def _settled(time: FloatArray, sigma: FloatArray, limit: float) -> float | None:
    """Return when a sigma fell below a limit for good."""
    above = np.flatnonzero(sigma >= limit)
    if above.size == 0:
        return 0.0
    return float(time[above[-1] + 1]) if above[-1] + 1 < time.size else None


def simplex_minimum(cost: Callable[[FloatArray], float], start: FloatArray, *, step: float = 0.7) -> FloatArray:
    """Return where a function is least: the simplex of Nelder and Mead (1965), which needs no derivatives.

    Parameters
    ----------
    cost : callable
        Of a point (k,).
    start : ndarray, shape (k,)
        Where to begin; the first simplex has edges of `step`, here a factor of two in each constant.
    """
    points = [start, *(start + step * axis for axis in np.eye(start.size))]
    ranked = sorted(((cost(p), i, p) for i, p in enumerate(points)), key=lambda item: item[:2])
    serial = len(points)
    for _ in range(60):
        worst_cost, _, worst = ranked[-1]
        centre = np.mean([p for _, _, p in ranked[:-1]], axis=0)
        if max(float(np.abs(p - ranked[0][2]).max()) for _, _, p in ranked) < 0.01:
            break  # one per cent of each constant
        tried = centre + (centre - worst)
        value = cost(tried)
        if value < ranked[0][0]:
            further = centre + 2.0 * (centre - worst)
            value, tried = min((value, 1, tried), (cost(further), 0, further), key=lambda item: item[:2])[::2]
        elif value >= ranked[-2][0]:
            inner = centre + (0.5 if value < worst_cost else -0.5) * (centre - worst)
            value, tried = cost(inner), inner
        serial += 1
        if value < worst_cost:
            ranked[-1] = (value, serial, tried)
        else:
            least = ranked[0][2]
            shrunk = [least + 0.5 * (p - least) for _, _, p in ranked[1:]]
            ranked[1:] = [(cost(p), serial + i, p) for i, p in enumerate(shrunk)]
            serial += len(shrunk)
        ranked.sort(key=lambda item: item[:2])
    return ranked[0][2]


def measure_noise(log: Log) -> NoiseParams:
    """Measure the noise of the sensors in a drive.

    Gyro and accelerometer: fourth differences of means over 0.1 s and less, which the vehicle's motion hardly reaches;
    the median over the drive of the quietest axis, since motion can only add. GNSS velocity: what two successive
    velocity increments miss of the accelerometers' differs by three epochs' noise only, in turns and at any speed. The
    random walks of the biases and their size before the drive do not show in a log of minutes or hours: they keep
    their defaults.

    Parameters
    ----------
    log : Log
        The drive, with its IMU as it was mounted and the vehicle's engine running.

    Raises
    ------
    LogError
        When the log has no usable GNSS velocity, or is too short to measure anything.
    """
    return _measured(log, record(log, ObserverParams()))


def velocity_noise(log: Log) -> float:
    """Return the GNSS velocity noise per horizontal axis that `measure_noise` finds, m/s; LogError as there."""
    return _velocity_noise(record(log, ObserverParams()))


def _measured(log: Log, epochs: Epochs) -> NoiseParams:
    return replace(
        NoiseParams(),
        gyro_noise=density(log.time, log.gyro),
        accel_noise=density(log.time, log.accel),
        velocity_std=_velocity_noise(epochs),
    )


def _velocity_noise(epochs: Epochs) -> float:
    """Return the GNSS velocity noise per horizontal axis, m/s, from successive increments."""
    closed = epochs["level"] > 0.0
    missed = epochs["length"][:, None] * np.column_stack([epochs["amiss_n"], epochs["amiss_e"]])
    # n_j - 2 n_(j-1) + n_(j-2): six times the variance. The median is not moved by slips and outliers.
    differences = np.diff(missed, axis=0)[closed[1:] & closed[:-1]]
    if differences.shape[0] < 30:
        raise LogError("The log is too short to measure the GNSS velocity noise: it needs 30 epochs in a row.")
    return float(1.4826 * np.median(np.abs(differences)) / math.sqrt(6.0))
