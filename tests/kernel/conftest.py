"""Drives and estimators for the kernel's tests."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from levelhead.conventions import FloatArray
from levelhead.estimators.observer import ObserverParams
from levelhead.estimators.streaming import Trace, run
from levelhead.estimators.two_stage import TwoStageParams
from levelhead.kernel._kernel import ObserverF32, ObserverF64, TwoStageF32, TwoStageF64
from levelhead.kernel.reference import Platform, Reference, ReferenceObserver, ReferenceTwoStage
from levelhead.logs.log import Log

Params = ObserverParams | TwoStageParams
Compiled = ObserverF64 | ObserverF32 | TwoStageF64 | TwoStageF32

VARIANTS: dict[str, Params] = {
    "observer": ObserverParams(),
    "observer, paper gain": ObserverParams(gain="paper"),
    "observer, lever arm": ObserverParams(lever_arm=(0.3, -0.2, -1.5)),
    "two-stage, feedback": TwoStageParams(),
    "two-stage, black box": TwoStageParams(feedback=False),
}


def compiled(params: Params, *, single: bool = False) -> Compiled:
    """Return a fresh compiled estimator in double or single precision."""
    zero = (0.0, 0.0, 0.0)
    if isinstance(params, ObserverParams):
        observer = ObserverF32 if single else ObserverF64
        return observer(**params.kernel_arguments(), gyro_bias=zero, accel_bias=zero)
    two_stage = TwoStageF32 if single else TwoStageF64
    return two_stage(**params.as_dict(), gyro_bias=zero, accel_bias=zero)


def reference(params: Params) -> Reference:
    """Return the NumPy twin of the same estimator."""
    platform = Platform(
        tau=params.tau,
        tau_heading=params.tau_heading,
        min_course_speed=params.min_course_speed,
        gravity=params.gravity,
        lever_arm=np.array(params.lever_arm),
    )
    zero = np.zeros(3)
    if isinstance(params, ObserverParams):
        return ReferenceObserver(
            platform=platform,
            tau_gyro=params.tau_gyro,
            omega_accel=params.omega_accel,
            paper_gain=params.gain == "paper",
            gyro_bias=zero,
            accel_bias=zero,
        )
    return ReferenceTwoStage(
        platform=platform,
        tau_gyro_lowpass=params.tau_gyro_lowpass,
        tau_accel_lowpass=params.tau_accel_lowpass,
        straight_rate=params.straight_rate,
        turn_rate=params.turn_rate,
        feedback=params.feedback,
        gyro_bias=zero,
        accel_bias=zero,
    )


@dataclass(frozen=True, kw_only=True)
class Kit:
    """The functions above, for tests."""

    variants: dict[str, Params]

    def compiled(self, params: Params, *, single: bool = False) -> Compiled:
        """Return a fresh compiled estimator."""
        return compiled(params, single=single)

    def reference(self, params: Params) -> Reference:
        """Return the NumPy twin."""
        return reference(params)

    def run(self, params: Params, log: Log, *, single: bool = False) -> Trace:
        """Run a compiled estimator over a log."""
        return run(compiled(params, single=single), log)


@pytest.fixture(scope="session")
def kit() -> Kit:
    """Estimators by name."""
    return Kit(variants=VARIANTS)


@pytest.fixture(params=list(VARIANTS))
def params(request: pytest.FixtureRequest) -> Params:
    """Each estimator variant in turn."""
    return VARIANTS[str(request.param)]


def irregular(log: Log, seed: int) -> Log:
    """Return the log with jittered IMU stamps, some samples lost, one gap, and GNSS stamps off the IMU's grid."""
    rng = np.random.default_rng(seed)
    keep = rng.random(log.time.size) > 0.05
    keep[(log.time > 40.0) & (log.time < 40.5)] = False
    keep[0] = keep[-1] = True
    time: FloatArray = log.time + rng.uniform(-0.3, 0.3, log.time.size) * np.median(np.diff(log.time))
    epochs = rng.random(log.gnss_time.size) > 0.1
    assert log.velocity_ned is not None
    return replace(
        log,
        time=time[keep],
        gyro=log.gyro[keep],
        accel=log.accel[keep],
        gnss_time=log.gnss_time[epochs] + 0.0037,
        velocity_ned=log.velocity_ned[epochs],
        velocity_std=None,
        position_llh=None,
        position_std=None,
    )
