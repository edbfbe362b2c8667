"""What methods with a covariance share: their own sigma says what is known."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from levelhead.conventions import FloatArray
from levelhead.estimators.base import Result, SensorData, Status
from levelhead.estimators.params import FilterParams
from levelhead.estimators.streaming import KernelStream, Trace, assemble
from levelhead.estimators.trust import Flags, mostly_backwards
from levelhead.events import Event

KNOWN_GYRO_STD: Final = math.radians(0.01)
"""A gyro bias with a smaller sigma is known, rad/s; the same as in the header `settled.hpp`."""
KNOWN_ACCEL_STD: Final = 0.02
"""The same for the accelerometer, m/s^2."""
CHANCE: Final = 1.05
"""A ratio up to this is chance: over the hundred epochs of a short log it spreads by 5 %, over a thousand by 1.6 %."""
SURPRISING: Final = 1.5
"""A larger ratio is told to the user: chance, and parameters that are a little off, stay below it."""
LEARNT: Final = 0.5
"""What is known has at most this part of its initial sigma left: a prior alone is no knowledge of this drive."""


def _known(sigma: FloatArray, limit: float, prior: float) -> Flags:
    x, y, z = (bool(s < limit and s < LEARNT * prior) for s in sigma)
    return x, y, z


def _widened(std: FloatArray, ratio: float, prior: float) -> FloatArray:
    """Widen what the drive has taught; what was known before it does not suffer."""
    wide: FloatArray = np.minimum(std * ratio, np.maximum(std, prior))
    return wide


def finish_filtered(
    data: SensorData,
    trace: Trace,
    stream: KernelStream,
    *,
    method: str,
    params: FilterParams,
    warnings: tuple[Event, ...] = (),
    innovation_ratio: float = 1.0,
) -> Result:
    """Turn a run of a filter with a covariance into a `Result`: what is known in the end is what its sigma says.

    Where the GNSS fixes surprised the filter more than its noise parameters explain (`innovation_ratio`, RMS over
    predicted sigma), every sigma is as many times larger: something is at work that the parameters do not know.
    """
    if innovation_ratio > CHANCE:
        trace = replace(
            trace,
            gyro_bias_std=_widened(trace.gyro_bias_std, innovation_ratio, params.initial_gyro_bias_std),
            accel_bias_std=_widened(trace.accel_bias_std, innovation_ratio, params.initial_accel_bias_std),
            attitude_std=trace.attitude_std * innovation_ratio,
            velocity_std=trace.velocity_std * innovation_ratio,
            position_std=trace.position_std * innovation_ratio,
        )
    if innovation_ratio > SURPRISING:
        detail = f"{innovation_ratio:.1f} times; every sigma is as many times larger."
        warnings += (Event(code="W_INNOVATIONS", count=1, detail=detail),)
    known_gyro = _known(trace.gyro_bias_std[-1], KNOWN_GYRO_STD, params.initial_gyro_bias_std)
    known_accel = _known(trace.accel_bias_std[-1], KNOWN_ACCEL_STD, params.initial_accel_bias_std)
    vertical = stream.vertical_axis
    if Status.ACCEL_SETTLED not in Status(int(trace.status[-1])):
        # A small sigma without a turn rests on second-order effects of rolling ground; only the vertical is plain.
        x, y, z = (k and axis == vertical for axis, k in enumerate(known_accel))
        known_accel = (x, y, z)
    backwards = mostly_backwards(trace.status)
    if backwards:
        known_gyro = known_accel = (False, False, False)
    events = trace.events + warnings + backwards
    return assemble(data, trace, stream, method, params, (known_gyro, known_accel), events)
