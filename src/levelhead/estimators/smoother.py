"""``method="smoother"``: the phasor filter run over the whole log, then back (docs/theory/phasor.md)."""

from __future__ import annotations

from levelhead.estimators.base import Result, SensorData
from levelhead.estimators.finishing import finish_filtered
from levelhead.estimators.params import Initial
from levelhead.estimators.phasor import PhasorParams
from levelhead.estimators.streaming import Progress, run
from levelhead.kernel._kernel import SmootherF64


def estimate_smoother(
    data: SensorData, params: PhasorParams, initial: Initial | None, progress: Progress | None = None
) -> Result:
    """Smooth a whole log (see `levelhead.estimate`): every estimate rests on what came before it and after it."""
    start = initial or Initial()
    smoother = SmootherF64(**params.kernel_arguments(), gyro_bias=start.gyro_bias, accel_bias=start.accel_bias)
    trace = run(smoother, data, progress, with_sigma=True)
    smoother.retrace(
        data.time,
        data.gyro,
        data.accel,
        trace.gyro_bias,
        trace.accel_bias,
        trace.attitude,
        trace.velocity_ned,
        trace.gyro_bias_std,
        trace.accel_bias_std,
        trace.attitude_std,
    )
    return finish_filtered(data, trace, smoother, method="smoother", params=params)
