"""``method="two-stage"``: the closed-form estimator of Tereshkov (2013), Eqs. (12) and (14)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Self

from levelhead.errors import UsageError
from levelhead.estimators.base import Result, SensorData, Status
from levelhead.estimators.params import Initial, NoiseParams, PaperParams
from levelhead.estimators.streaming import Progress, events_of, finish, restored, run
from levelhead.estimators.uncertainty import EpochRecorder, Epochs, LevelSigma, at_samples, level_sigma
from levelhead.events import Event
from levelhead.kernel._kernel import TwoStageF64, two_stage_covariance


@dataclass(frozen=True, kw_only=True)
class TwoStageParams(PaperParams):
    """Constants of the 2013 two-stage estimator, with the paper's values as defaults.

    Attributes
    ----------
    tau_gyro_lowpass : float
        Low-pass of the gyro bias read on straights, s. Longer averages more noise and settles later.
    tau_accel_lowpass : float
        Low-pass of the accelerometer bias read in turns, s of turning.
    straight_rate : float
        Below this absolute yaw rate the vehicle counts as going straight, rad/s. Wider reads the gyro bias longer on
        paths that never run straight for long, and lets more of the accelerometer bias into it.
    turn_rate : float
        Above this absolute yaw rate it counts as turning, rad/s. Between the two nothing is read: without the split
        the estimate diverges.
    feedback : bool
        True: the estimates are subtracted from the platform's input. False: the paper's "black box", the platform
        runs on the raw readings and the low-passes read its whole control rate.
    """

    TACTICAL: ClassVar[Mapping[str, float]] = {
        "tau": 20.0,
        "tau_heading": 20.0,
        "tau_gyro_lowpass": 200.0,
        "tau_accel_lowpass": 200.0,
    }

    tau_gyro_lowpass: float = 40.0
    tau_accel_lowpass: float = 40.0
    straight_rate: float = math.radians(4.0)
    turn_rate: float = math.radians(8.0)
    feedback: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.straight_rate > self.turn_rate:
            raise UsageError(
                f"straight_rate ({self.straight_rate:.4g} rad/s) is above turn_rate ({self.turn_rate:.4g} rad/s); "
                "the thresholds must not overlap."
            )


class TwoStage(TwoStageF64):
    """The 2013 two-stage estimator as a stream; used like `levelhead.Observer`.

    Parameters
    ----------
    params : TwoStageParams, optional
        Time constants and thresholds.
    initial : Initial, optional
        Biases to start from.
    """

    def __init__(self, params: TwoStageParams | None = None, *, initial: Initial | None = None) -> None:
        k, start = params or TwoStageParams(), initial or Initial()
        TwoStageF64.__init__(self, **k.as_dict(), gyro_bias=start.gyro_bias, accel_bias=start.accel_bias)

    @property
    def status(self) -> Status:
        """What the estimator says about itself."""
        return Status(self.raw_status)

    @property
    def events(self) -> tuple[Event, ...]:
        """What happened to the data so far; times are the stream's own stamps."""
        return events_of(self)

    @classmethod
    def restore(cls, blob: bytes) -> Self:
        """Return an estimator that continues bit for bit from a `save`; a foreign or damaged blob raises UsageError."""
        return restored(cls.__new__(cls), TwoStageF64.__init__, blob)


def predict_two_stage(epochs: Epochs, params: TwoStageParams, noise: NoiseParams) -> LevelSigma:
    """Return how sure the estimator would be after each of these epochs with these constants."""
    constants = params.as_dict()
    for name in ("min_course_speed", "lever_arm", "latitude"):
        del constants[name]
    return level_sigma(two_stage_covariance, constants, epochs, noise)


def estimate_two_stage(
    data: SensorData,
    params: TwoStageParams,
    initial: Initial | None,
    progress: Progress | None = None,
    noise: NoiseParams | None = None,
) -> Result:
    """Run the two-stage estimator over a whole log (see `levelhead.estimate`)."""
    noise = noise or NoiseParams()
    stream = TwoStage(params, initial=initial)
    recorder = EpochRecorder(run_recorded=stream.run_recorded)
    trace = run(stream, data, progress, recorder=recorder)
    level = predict_two_stage(recorder.epochs, params, noise)
    sigma = at_samples(level, recorder.epochs, noise, data.time, trace.attitude[:, 1])
    return finish(data, trace, stream, method="two-stage", params=params, sigma=sigma)
