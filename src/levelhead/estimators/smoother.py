"""``method="smoother"``: the phasor filter run over the whole log, then back, twice (docs/theory/phasor.md)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

from levelhead.conventions import FloatArray
from levelhead.estimators.base import Result, SensorData
from levelhead.estimators.finishing import finish_filtered
from levelhead.estimators.params import Initial, Triple
from levelhead.estimators.phasor import Phasor, PhasorParams
from levelhead.estimators.streaming import Progress, Trace, imu_arrays, run
from levelhead.kernel._kernel import SmootherF64

WIDER: Final = 5.0
"""The second pass starts from what the first has found, give or take this many sigmas of it: what the log has then told
twice is a 25th of what it tells."""


SURE_HEADING: Final = math.radians(30.0)
"""A heading that the first pass knows to better than this at the beginning is used by the second, rad."""


def estimate_smoother(
    data: SensorData, params: PhasorParams, initial: Initial | None, progress: Progress | None = None
) -> Result:
    """Smooth a whole log (see `levelhead.estimate`): every estimate rests on what came before it and after it.

    The error model is linear and holds for a level vehicle; large initial biases, seen through the tilt that they cause
    and the ground's, leave errors of second order in the first seconds. So the log is smoothed twice, the second time
    from the biases that the first has found for its beginning.
    """
    start, closer, half = initial or Initial(), params, 0.5
    first = SmootherF64(Phasor(params, initial=start))

    def filtered(smoother: SmootherF64, begin: float) -> Trace:
        report = None if progress is None else lambda part: progress(begin + half * part)
        return run(smoother, data, report, with_sigma=True, with_position=params.use_positions)

    trace = filtered(first, 0.0)
    found = first.smoothed_start()
    if found is not None:
        gyro_bias, accel_bias, gyro_sigma, accel_sigma, heading, heading_sigma = found
        level = [axis for axis in range(3) if axis != first.vertical_axis]
        gyro_std, accel_std = WIDER * float(gyro_sigma.max()), WIDER * float(accel_sigma[level].max())
        # A sensor of which the log tells little keeps its prior, or the log would tell that little twice.
        if gyro_std < params.initial_gyro_bias_std:
            closer = replace(closer, initial_gyro_bias_std=gyro_std)
            start = replace(start, gyro_bias=_triple(gyro_bias))
        if accel_std < params.initial_accel_bias_std:
            closer = replace(closer, initial_accel_bias_std=accel_std)
            start = replace(start, accel_bias=_triple(accel_bias))
        # Where the log begins without a course, the Earth's rotation had no direction in the first pass.
        if start.heading is None and WIDER * heading_sigma < SURE_HEADING:
            start = replace(start, heading=heading, heading_std=WIDER * heading_sigma)
    smoother, on_the_way = first, trace.status
    if closer is not params:
        del first, smoother, trace  # an hour of them is 150 MB
        smoother = SmootherF64(Phasor(closer, initial=start))
        trace = filtered(smoother, half)
    smoother.retrace(imu_arrays(data), trace.arrays())
    # When a bias became known is a matter of the first pass: the second knew before it began.
    trace = replace(trace, status=on_the_way)
    ratio = smoother.innovation_ratio
    return finish_filtered(data, trace, smoother, method="smoother", params=params, innovation_ratio=ratio)


def _triple(row: FloatArray) -> Triple:
    x, y, z = (float(value) for value in row)
    return x, y, z
