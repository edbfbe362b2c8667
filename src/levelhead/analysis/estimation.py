"""`estimate`: one log, one method, one result."""

from __future__ import annotations

from dataclasses import replace

from levelhead.errors import UsageError
from levelhead.estimators import METHODS
from levelhead.estimators.base import Result
from levelhead.estimators.params import Initial, MethodParams, NoiseParams
from levelhead.estimators.streaming import Progress
from levelhead.events import merge_events
from levelhead.logs.derive import velocity_from_position
from levelhead.logs.log import Log

DEFAULT_METHOD = "observer"


def estimate(
    log: Log,
    method: str = DEFAULT_METHOD,
    *,
    params: MethodParams | None = None,
    initial: Initial | None = None,
    lever_arm: tuple[float, float, float] | None = None,
    progress: Progress | None = None,
    noise: NoiseParams | None = None,
) -> Result:
    """Estimate the sensor biases and the attitude over a whole log.

    Parameters
    ----------
    log : Log
        The drive. A log with positions only has its velocities derived from them first; the result says so.
    method : str
        "observer" (Tereshkov 2015) or "two-stage" (Tereshkov 2013).
    params : ObserverParams or TwoStageParams, optional
        The method's constants; defaults where absent.
    initial : Initial, optional
        Biases to start from.
    lever_arm : (3,), optional
        From the IMU to the GNSS antenna, body axes, m; takes the place of the one in `params`.
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
    if method not in METHODS:
        raise UsageError(f"There is no method {method!r}; choose one of {', '.join(METHODS)}.")
    chosen = METHODS[method]
    constants = chosen.params() if params is None else params
    if type(constants) is not chosen.params:
        raise UsageError(
            f"The method {method!r} takes {chosen.params.__name__}, not {type(constants).__name__}; pass that instead."
        )
    if lever_arm is not None:
        constants = replace(constants, lever_arm=lever_arm)
    if noise is not None and not chosen.takes_noise:
        raise UsageError(
            f"The method {method!r} has its noise in params; pass {chosen.params.__name__} instead of noise."
        )
    extra = {"noise": noise} if chosen.takes_noise else {}
    data = log if log.velocity_ned is not None else velocity_from_position(log)
    result = chosen.run(data, constants, initial, progress, **extra)
    return replace(result, log_info=log.describe(), events=merge_events((*data.events, *result.events)))
