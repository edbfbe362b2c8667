"""`estimate`: one log, one method, one result."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TypeVar

from levelhead.analysis.noise import density
from levelhead.analysis.tuning import velocity_noise
from levelhead.errors import LogError, UsageError
from levelhead.estimators import METHODS, Method
from levelhead.estimators.base import Result
from levelhead.estimators.params import (
    NOISE_PRESETS,
    FilterParams,
    Initial,
    MethodParams,
    NoiseParams,
    PaperParams,
    Triple,
    lever,
)
from levelhead.estimators.phasor import PhasorParams
from levelhead.estimators.place import at_place
from levelhead.estimators.reference import with_reference
from levelhead.estimators.streaming import Progress
from levelhead.events import Event, merge_events
from levelhead.logs.derive import velocity_from_position
from levelhead.logs.log import Log

DEFAULT_METHOD = "smoother"

N = TypeVar("N", bound=NoiseParams)


def estimate(
    log: Log,
    method: str | None = None,
    *,
    params: MethodParams | None = None,
    initial: Initial | None = None,
    lever_arm: tuple[float, float, float] | None = None,
    rear_axle: tuple[float, float, float] | None = None,
    reference_point: tuple[float, float, float] | None = None,
    grade: str | None = None,
    progress: Progress | None = None,
    noise: NoiseParams | None = None,
) -> Result:
    """Estimate the sensor biases and the attitude over a whole log.

    Parameters
    ----------
    log : Log
        The drive. A log with positions only has its velocities derived from them first; the result says so.
    method : str, optional
        "smoother" (the phasor filter, there and back), "phasor" (the same filter, forwards only), "observer"
        (Tereshkov 2015), "two-stage" (Tereshkov 2013)...; the keys of `levelhead.estimators.METHODS`. Where absent,
        the first of these that takes `params`: the smoother without any.
    params : PhasorParams, ObserverParams..., optional
        The method's constants. Where absent, defaults; and a filter takes more sensor noise where the
        readings show more.
    initial : Initial, optional
        Biases to start from.
    lever_arm : (3,), optional
        From the IMU to the GNSS antenna, body axes, m; takes the place of the one in `params`.
    rear_axle : (3,), optional
        From the IMU to the axle that does not steer, body axes, m, for the phasor filter and smoother: it does not
        slide, with or without GNSS. Takes the place of the one in `params`.
    reference_point : (3,), optional
        From the IMU to the point of the vehicle that `Result.reference` shall tell of, body axes, m.
    grade : {"consumer", "industrial", "tactical"}, optional
        Of the sensors, instead of `params`: noises for the filters. "tactical" gives the papers' estimators longer time
        constants and the Earth's rotation, which MEMS sensors may neglect (Tereshkov 2013, section 4).
    progress : callable, optional
        Called with the fraction done.
    noise : NoiseParams, optional
        What is random in the sensors, from which "observer" and "two-stage" tell how sure they are; their estimates do
        not depend on it. The other methods have it in `params`.

    Returns
    -------
    Result
        Estimates at every IMU stamp.

    Raises
    ------
    UsageError
        For an unknown method or parameters of another method.
    LogError
        When the log has no usable GNSS velocity.
    """
    if method is None:
        method = next((m for m in (DEFAULT_METHOD, *METHODS) if METHODS[m].params is type(params)), DEFAULT_METHOD)
    chosen = _chosen(method)
    if reference_point is not None:
        reference_point = lever("reference_point", reference_point)
    navigates = chosen.navigates and getattr(params, "use_positions", True)
    data = log if log.velocity_ned is not None or navigates else velocity_from_position(log)
    constants, found = constants_for(data, method, params=params, lever_arm=lever_arm, rear_axle=rear_axle, grade=grade)
    if chosen.takes_noise:
        if noise is None:
            noise, found = noise_of(data, NoiseParams())
        result = chosen.run(data, constants, initial, progress, noise=noise)
    elif noise is not None:
        raise UsageError(
            f"The method {method!r} has its noise in params; pass {chosen.params.__name__} instead of noise."
        )
    else:
        result = chosen.run(data, constants, initial, progress)
    if reference_point is not None:
        result = with_reference(result, data, reference_point, constants.lever_arm)
    return replace(result, log_info=log.describe(), events=merge_events((*data.events, *result.events, *found)))


def _chosen(method: str) -> Method:
    if method not in METHODS:
        raise UsageError(f"There is no method {method!r}; choose one of {', '.join(METHODS)}.")
    return METHODS[method]


def constants_for(
    log: Log,
    method: str,
    *,
    params: MethodParams | None = None,
    lever_arm: Triple | None = None,
    rear_axle: Triple | None = None,
    grade: str | None = None,
) -> tuple[MethodParams, tuple[Event, ...]]:
    """Return the constants that `estimate` runs a method with, and the events of how they were found.

    Parameters
    ----------
    log : Log
        A log with velocities: its positions tell latitude and gravity, and where `params` is absent its readings tell
        whether a filter must reckon with more noise than by default.
    method, params, lever_arm, rear_axle, grade
        As for `estimate`.
    """
    kind = _chosen(method).params
    if grade is not None and params is not None:
        raise UsageError("Pass grade or params, not both: a grade stands for a set of constants.")
    constants = params if params is not None else kind() if grade is None else kind.preset(grade)
    if type(constants) is not kind:
        raise UsageError(
            f"The method {method!r} takes {kind.__name__}, not {type(constants).__name__}; pass that instead."
        )
    if lever_arm is not None:
        constants = replace(constants, lever_arm=lever_arm)
    if rear_axle is not None:
        if not isinstance(constants, PhasorParams):
            raise UsageError(f"The method {method!r} knows no rear axle; use 'smoother' or 'phasor'.")
        constants = replace(constants, rear_axle=rear_axle)
    turning = bool(log.meta.get("earth_rotation", True))  # a simulated Earth may stand still
    if not isinstance(constants, FilterParams):
        if grade == "tactical" and turning and isinstance(constants, PaperParams):
            constants = at_place(constants, log)
        return constants, ()
    if turning:
        constants = at_place(constants, log, follows=METHODS[method].navigates and constants.use_positions)
    else:
        constants = replace(constants, earth_rotation=False)
    return noise_of(log, constants) if params is None else (constants, ())


def noise_of(log: Log, params: N) -> tuple[N, tuple[Event, ...]]:
    """Return the parameters with the noise in this log's readings, and the event that says so.

    They can only raise it: slips, delays and gravity that is not quite known are part of every drive and
    do not show, and a filter that believes too much is worse than one that believes too little. Gyros noisier
    than the consumer grade get its drifting biases too. A log too short to tell (half a minute) changes nothing.
    """
    try:
        gyro, accel = density(log.time, log.gyro), density(log.time, log.accel)
    except LogError:
        return params, ()
    consumer = NOISE_PRESETS["consumer"]
    found = {"gyro_noise": gyro, "accel_noise": accel}
    if gyro > consumer["gyro_noise"]:
        found |= {name: consumer[name] for name in ("gyro_bias_walk", "accel_bias_walk")}
    if log.velocity_std is None and log.velocity_ned is not None:
        found["velocity_std"] = velocity_noise(log)
    raised = {name: value for name, value in found.items() if value > getattr(params, name)}
    if not raised:
        return params, ()
    detail = f"gyro {math.degrees(gyro):.2g} deg/s/sqrt(Hz), accelerometer {accel:.2g} m/s^2/sqrt(Hz)"
    detail += f", GNSS velocity {found['velocity_std']:.2g} m/s." if "velocity_std" in raised else "."
    return replace(params, **raised), (Event(code="I_NOISE_FOUND", count=1, detail=detail),)
