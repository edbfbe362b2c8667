"""`estimate`: one log, one method, one result."""

from __future__ import annotations

from dataclasses import replace

from levelhead.errors import UsageError
from levelhead.estimators import METHODS
from levelhead.estimators.base import Result
from levelhead.estimators.params import Initial, MethodParams
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
) -> Result:
    """Estimate the sensor biases and the attitude over a whole log.

    Parameters
    ----------
    log : Log
        The drive. A log with positions only has its velocities derived from them first; the result says so.
    method : str
        "observer" (Tereshkov 2015), "two-stage" (Tereshkov 2013), or a baseline to compare them with: "ekf" (Kalman
        filter with 15 states), "mahony" (complementary filter).
    params : ObserverParams, TwoStageParams, EkfParams or MahonyParams, optional
        The method's constants; defaults where absent.
    initial : Initial, optional
        Biases to start from.
    lever_arm : (3,), optional
        From the IMU to the GNSS antenna, body axes, m; takes the place of the one in `params`.
    progress : callable, optional
        Called with the fraction done.

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
    data = log if log.velocity_ned is not None else velocity_from_position(log)
    result = chosen.run(data, constants, initial, progress)
    return replace(result, log_info=log.describe(), events=merge_events((*data.events, *result.events)))
