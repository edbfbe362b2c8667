"""Estimators: one method, one file, one line in `METHODS`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from levelhead.estimators.base import Result
from levelhead.estimators.ekf import EkfParams, estimate_ekf
from levelhead.estimators.mahony import MahonyParams, estimate_mahony
from levelhead.estimators.observer import ObserverParams, estimate_observer
from levelhead.estimators.params import MethodParams
from levelhead.estimators.phasor import PhasorParams, estimate_phasor
from levelhead.estimators.smoother import estimate_smoother
from levelhead.estimators.two_stage import TwoStageParams, estimate_two_stage


@dataclass(frozen=True, kw_only=True)
class Method:
    """A method's parameters and the function that runs it over a whole log.

    A method with fixed gains takes the sensors' noise as ``run(..., noise=)``, for its uncertainty only. One that
    navigates takes a log with positions alone as it is; the others have velocities derived from them.
    """

    params: type[MethodParams]
    run: Callable[..., Result]
    takes_noise: bool = False
    navigates: bool = False


METHODS: dict[str, Method] = {
    "observer": Method(params=ObserverParams, run=estimate_observer, takes_noise=True),
    "two-stage": Method(params=TwoStageParams, run=estimate_two_stage, takes_noise=True),
    "phasor": Method(params=PhasorParams, run=estimate_phasor, navigates=True),
    "smoother": Method(params=PhasorParams, run=estimate_smoother, navigates=True),
    "ekf": Method(params=EkfParams, run=estimate_ekf),
    "mahony": Method(params=MahonyParams, run=estimate_mahony),
}
"""Every method of `levelhead.estimate`, by name."""
