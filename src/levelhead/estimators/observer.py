"""``method="observer"``: the bias observer of Tereshkov (2015), Eqs. (10)-(12)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Self

from levelhead.errors import UsageError
from levelhead.estimators.base import Result, SensorData, Status
from levelhead.estimators.params import Initial, NoiseParams, PaperParams
from levelhead.estimators.streaming import Progress, events_of, finish, restored, run
from levelhead.estimators.uncertainty import EpochRecorder, Epochs, LevelSigma, at_samples, level_sigma
from levelhead.events import Event
from levelhead.kernel._kernel import ObserverF64, observer_covariance


@dataclass(frozen=True, kw_only=True)
class ObserverParams(PaperParams):
    """Constants of the 2015 observer: three time constants with the papers' values as defaults.

    Attributes
    ----------
    tau_gyro : float
        Gyro bias time constant tau_g, s. Longer averages more noise and settles later; from ``4 tau`` up the loop does
        not ring (its straight-line poles solve ``tau s^2 + s + 1/tau_gyro``).
    omega_accel : float
        Accelerometer bias rate constant omega_a, rad/s. Larger averages more noise and needs more turning to settle.
    gain : {"general", "paper"}
        "paper" is Eq. (12) to the letter. "general" (default) drops Assumption B: the vertical angular rate takes the
        place of the body's w_z, which is the same on level ground and also holds on slopes and upside-down.
    """

    TACTICAL: ClassVar[Mapping[str, float]] = {"tau": 20.0, "tau_heading": 20.0, "tau_gyro": 200.0}

    tau_gyro: float = 40.0
    omega_accel: float = math.radians(45.0)
    gain: Literal["general", "paper"] = "general"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.gain not in ("general", "paper"):
            raise UsageError(f"gain is {self.gain!r}; choose 'general' or 'paper'.")

    def kernel_arguments(self) -> dict[str, Any]:
        """Return the constants under the names of the compiled class."""
        arguments = self.as_dict()
        arguments["paper_gain"] = arguments.pop("gain") == "paper"
        return arguments

    def warnings(self) -> tuple[Event, ...]:
        """Return what is questionable about these constants."""
        if self.tau_gyro < 4.0 * max(self.tau, self.tau_heading):
            return (Event(code="W_TAU_RATIO", count=1, detail="Raise tau_gyro or lower tau."),)
        return ()


class Observer(ObserverF64):
    """The 2015 observer as a stream: feed samples and epochs as they come.

    ``update_imu(t, gyro, accel)`` takes a stamp (s) and body-frame readings (rad/s, m/s^2), ``update_gnss(t,
    velocity_ned, velocity_std=None)`` a stamp on the same clock and a velocity (m/s). Each returns False where it
    dropped its input. Feeding a log sample by sample gives the same bits as `levelhead.estimate`.

    Parameters
    ----------
    params : ObserverParams, optional
        The three time constants and the platform's settings.
    initial : Initial, optional
        Biases to start from.
    """

    def __init__(self, params: ObserverParams | None = None, *, initial: Initial | None = None) -> None:
        k, start = params or ObserverParams(), initial or Initial()
        ObserverF64.__init__(self, **k.kernel_arguments(), gyro_bias=start.gyro_bias, accel_bias=start.accel_bias)

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
        """Return an observer that continues bit for bit from a `save`; a foreign or damaged blob raises UsageError."""
        return restored(cls.__new__(cls), ObserverF64.__init__, blob)


def predict_observer(epochs: Epochs, params: ObserverParams, noise: NoiseParams) -> LevelSigma:
    """Return how sure the observer would be after each of these epochs with these constants."""
    constants = params.as_dict()
    for name in ("min_course_speed", "lever_arm", "latitude", "gain"):
        del constants[name]
    return level_sigma(observer_covariance, constants, epochs, noise)


def estimate_observer(
    data: SensorData,
    params: ObserverParams,
    initial: Initial | None,
    progress: Progress | None = None,
    noise: NoiseParams | None = None,
) -> Result:
    """Run the observer over a whole log (see `levelhead.estimate`)."""
    noise = noise or NoiseParams()
    stream = Observer(params, initial=initial)
    recorder = EpochRecorder(run_recorded=stream.run_recorded)
    trace = run(stream, data, progress, recorder=recorder)
    level = predict_observer(recorder.epochs, params, noise)
    sigma = at_samples(level, recorder.epochs, noise, data.time, trace.attitude[:, 1])
    return finish(data, trace, stream, method="observer", params=params, warnings=params.warnings(), sigma=sigma)
