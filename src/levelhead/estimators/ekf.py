"""``method="ekf"``: an error-state Kalman filter with 15 states, the textbook baseline to compare with."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Self

from levelhead.estimators.base import Result, SensorData, Status
from levelhead.estimators.finishing import finish_filtered
from levelhead.estimators.params import FilterParams, Initial
from levelhead.estimators.streaming import Progress, events_of, restored, run
from levelhead.events import Event
from levelhead.kernel._kernel import EkfF64


@dataclass(frozen=True, kw_only=True)
class EkfParams(FilterParams):
    """Noises of the sensors, as every Kalman-type method takes them; the filter adds nothing of its own."""

    def kernel_arguments(self) -> dict[str, Any]:
        """Return the constants under the names of the compiled class."""
        arguments = self.as_dict()
        if self.latitude is None or not self.earth_rotation:
            arguments["latitude"] = math.nan
        for name in ("use_positions", "earth_rotation"):
            del arguments[name]
        return arguments


class Ekf(EkfF64):
    """The error-state Kalman filter as a stream; used like `levelhead.Observer`.

    Its states are position, velocity, attitude and both biases (all three axes), all with a sigma. Like every filter
    that linearises at its own estimates it grows too sure where nothing is to be learnt: parked, on a level straight,
    on a circle. It therefore calls the level accelerometer biases settled only after turning.

    Parameters
    ----------
    params : EkfParams, optional
        Noises of the sensors. A stream has no log to take the latitude from: set it here.
    initial : Initial, optional
        Biases to start from.
    """

    def __init__(self, params: EkfParams | None = None, *, initial: Initial | None = None) -> None:
        k, start = params or EkfParams(), initial or Initial()
        EkfF64.__init__(self, **k.kernel_arguments(), gyro_bias=start.gyro_bias, accel_bias=start.accel_bias)

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
        """Return a filter that continues bit for bit from a `save`; a foreign or damaged blob raises UsageError."""
        return restored(cls.__new__(cls), EkfF64.__init__, blob)


def estimate_ekf(
    data: SensorData, params: EkfParams, initial: Initial | None, progress: Progress | None = None
) -> Result:
    """Run the Kalman filter over a whole log (see `levelhead.estimate`)."""
    stream = Ekf(params, initial=initial)
    trace = run(stream, data, progress, with_sigma=True, with_position=params.use_positions)
    return finish_filtered(data, trace, stream, method="ekf", params=params)
