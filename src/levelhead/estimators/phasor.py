"""``method="phasor"``: the forward filter whose horizontal half is four complex numbers (docs/theory/phasor.md)."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, Self

from levelhead.estimators.base import Result, SensorData, Status
from levelhead.estimators.finishing import finish_filtered
from levelhead.estimators.params import FilterParams, Initial, Triple, lever
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
    wheel_std : float
        One sigma of a wheel speed, m/s; the tyre's radius is learnt besides.
    rear_axle : (3,), optional
        From the IMU to the axle that does not steer, body axes, m. Given, the filter counts on that axle not sliding
        sideways (within `sideslip_std`), with GNSS and without: the non-holonomic constraint.
    find_standstill : bool
        Whether the filter looks for standstill by itself and then takes velocity and rotation as zero.
    """

    sideslip_std: float = math.radians(0.5)
    axle_std: float = 0.5
    wheel_std: float = 0.1
    rear_axle: Triple | None = None
    find_standstill: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rear_axle is not None:
            object.__setattr__(self, "rear_axle", lever("rear_axle", self.rear_axle))

    def kernel_arguments(self) -> dict[str, Any]:
        """Return the constants under the names of the compiled class: variances per second from one-sided densities."""
        arguments = self.as_dict()
        for name in ("gyro_noise", "accel_noise"):
            arguments[name] = 0.5 * arguments[name] ** 2
        for name in ("gyro_bias_walk", "accel_bias_walk"):
            arguments[name] = arguments[name] ** 2
        arguments["gravity_std"] = GRAVITY_STD if self.latitude is None else 0.0
        del arguments["use_positions"]
        return arguments


def initial_arguments(initial: Initial | None) -> dict[str, Any]:
    """Return what is known before the drive under the names of the compiled class."""
    return asdict(initial or Initial())


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
        PhasorF64.__init__(self, **(params or PhasorParams()).kernel_arguments(), **initial_arguments(initial))

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
    trace = run(stream, data, progress, with_sigma=True, with_position=params.use_positions)
    return finish_filtered(
        data, trace, stream, method="phasor", params=params, innovation_ratio=stream.innovation_ratio
    )
