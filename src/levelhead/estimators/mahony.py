"""``method="mahony"``: the passive complementary filter with gyro bias, the simple baseline to compare with."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from levelhead.conventions import FloatArray
from levelhead.estimators.base import Result, SensorData, Status
from levelhead.estimators.params import Initial, PlatformParams
from levelhead.estimators.streaming import Progress, events_of, finish, restored, run
from levelhead.events import Event
from levelhead.kernel._kernel import MahonyF64


@dataclass(frozen=True, kw_only=True)
class MahonyParams(PlatformParams):
    """Constants of the explicit complementary filter of Mahony, Hamel and Pflimlin (2008), its gains as time constants.

    Attributes
    ----------
    tau_gyro : float
        Gyro bias time constant, s: the paper's gains are ``kP = 1 / tau`` and ``kI = 1 / (tau tau_gyro)``. On straights
        the loop then has the poles of the 2015 observer with the same constants.
    use_gnss_acceleration : bool
        True: the acceleration from GNSS is taken out of the specific force, what is left is gravity. False: the filter
        as it is used without GNSS; it takes every turn for a tilt.
    """

    tau_gyro: float = 40.0
    use_gnss_acceleration: bool = True


class Mahony(MahonyF64):
    """The complementary filter as a stream; used like `levelhead.Observer`.

    It estimates no accelerometer bias: such a bias stays in roll and pitch (0.1 m/s^2 is 0.6 deg), and in turns it
    leaks into the gyro biases.

    Parameters
    ----------
    params : MahonyParams, optional
        Time constants.
    initial : Initial, optional
        Gyro biases to start from; accelerometer biases that are known from elsewhere and stay as they are.
    """

    def __init__(self, params: MahonyParams | None = None, *, initial: Initial | None = None) -> None:
        k, start = params or MahonyParams(), initial or Initial()
        MahonyF64.__init__(self, **k.as_dict(), gyro_bias=start.gyro_bias, accel_bias=start.accel_bias)

    @property
    def accel_bias(self) -> FloatArray:
        """Not estimated: NaN (3,)."""
        return np.full(3, np.nan)

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
        return restored(cls.__new__(cls), MahonyF64.__init__, blob)


def estimate_mahony(
    data: SensorData, params: MahonyParams, initial: Initial | None, progress: Progress | None = None
) -> Result:
    """Run the complementary filter over a whole log (see `levelhead.estimate`)."""
    stream = Mahony(params, initial=initial)
    trace = run(stream, data, progress)
    trace = replace(trace, accel_bias=np.full_like(trace.accel_bias, np.nan))
    return finish(data, trace, stream, method="mahony", params=params)
