"""``method="phasor"``: the forward filter whose horizontal half is four complex numbers (docs/theory/phasor.md)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Self

from levelhead.estimators.base import Result, SensorData, Status
from levelhead.estimators.finishing import finish_filtered
from levelhead.estimators.params import FilterParams, Initial
from levelhead.estimators.streaming import Progress, events_of, restored, run
from levelhead.events import Event
from levelhead.kernel._kernel import PhasorF64

GRAVITY_STD = 0.02
"""How far gravity can be from the parameter where the latitude is not known, m/s^2."""


@dataclass(frozen=True, kw_only=True)
class PhasorParams(FilterParams):
    """Physical constants of the phasor filter and smoother; there is nothing else to tune.

    Attributes
    ----------
    sideslip_std : float
        One sigma between the course and the heading, rad: how far the vehicle moves other than where it points, for
        seconds at a time.
    axle_std : float
        One sigma of the distance, along the vehicle, from the IMU to the axle that does not steer, m: in a turn the IMU
        swings sideways by it.
    """

    sideslip_std: float = math.radians(0.5)
    axle_std: float = 0.5

    def kernel_arguments(self) -> dict[str, Any]:
        """Return the constants under the names of the compiled class: variances per second from one-sided densities."""
        arguments = self.as_dict()
        for name in ("gyro_noise", "accel_noise"):
            arguments[name] = 0.5 * arguments[name] ** 2
        for name in ("gyro_bias_walk", "accel_bias_walk"):
            arguments[name] = arguments[name] ** 2
        arguments["gravity_std"] = GRAVITY_STD if self.latitude is None else 0.0
        return arguments


class Phasor(PhasorF64):
    """The phasor filter as a stream; used like `levelhead.Observer`, with a sigma for everything.

    Parameters
    ----------
    params : PhasorParams, optional
        Sensor noises, GNSS noise, latitude.
    initial : Initial, optional
        Biases to start from.
    """

    def __init__(self, params: PhasorParams | None = None, *, initial: Initial | None = None) -> None:
        k, start = params or PhasorParams(), initial or Initial()
        PhasorF64.__init__(self, **k.kernel_arguments(), gyro_bias=start.gyro_bias, accel_bias=start.accel_bias)

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
        return restored(cls.__new__(cls), PhasorF64.__init__, blob)


def estimate_phasor(
    data: SensorData, params: PhasorParams, initial: Initial | None, progress: Progress | None = None
) -> Result:
    """Run the phasor filter over a whole log (see `levelhead.estimate`)."""
    stream = Phasor(params, initial=initial)
    trace = run(stream, data, progress, with_sigma=True)
    return finish_filtered(
        data, trace, stream, method="phasor", params=params, innovation_ratio=stream.innovation_ratio
    )
