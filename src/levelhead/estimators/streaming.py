"""What the streaming classes and the batch run share: one path through the kernel, and how its state is shown."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Final, Protocol, TypeVar

import numpy as np

from levelhead.conventions import FloatArray, StatusArray
from levelhead.errors import LogError, UsageError
from levelhead.estimators.base import Result, SensorData, Status
from levelhead.estimators.params import MethodParams
from levelhead.estimators.trust import (
    ACCEL_BAND,
    GYRO_BAND,
    Flags,
    certain,
    first_settled,
    mostly_backwards,
    observable,
    steady,
    wander,
    wander_event,
    widened,
)
from levelhead.estimators.uncertainty import EpochRecorder, Sigma
from levelhead.events import Event

Progress = Callable[[float], None]

CHUNK: Final = 50_000
"""Samples fed to the kernel between two reports of progress."""


class KernelStream(Protocol):
    """The part of a compiled stream that the functions below use."""

    @property
    def raw_events(self) -> list[tuple[str, int, float, float]]:
        """Counters of the kernel: code, count, first and last stamp."""
        ...

    @property
    def vertical_axis(self) -> int:
        """Index of the body axis nearest to the vertical."""
        ...

    def run(
        self,
        time: FloatArray,
        gyro: FloatArray,
        accel: FloatArray,
        gnss_time: FloatArray,
        velocity_ned: FloatArray,
        velocity_std: FloatArray,
        gyro_bias: FloatArray,
        accel_bias: FloatArray,
        attitude: FloatArray,
        velocity: FloatArray,
        status: StatusArray,
        gyro_bias_std: FloatArray,
        accel_bias_std: FloatArray,
        attitude_std: FloatArray,
        /,
    ) -> int:
        """Feed samples and epochs; fill the arrays after them, the last three only where they have rows."""
        ...


@dataclass(frozen=True, kw_only=True)
class Trace:
    """What a run of the kernel leaves behind, one row per IMU sample."""

    gyro_bias: FloatArray
    accel_bias: FloatArray
    attitude: FloatArray
    velocity_ned: FloatArray
    status: StatusArray
    gyro_bias_std: FloatArray
    accel_bias_std: FloatArray
    attitude_std: FloatArray
    events: tuple[Event, ...]


S = TypeVar("S")


def restored(stream: S, load: Callable[[S, bytes], None], blob: bytes) -> S:
    """Return the stream with a saved state loaded; a foreign or damaged blob raises UsageError."""
    try:
        load(stream, blob)
    except ValueError as error:
        raise UsageError(str(error)) from None
    return stream


def events_of(stream: KernelStream, time_origin: float = 0.0) -> tuple[Event, ...]:
    """Turn the kernel's counters into events, times relative to `time_origin` (s)."""
    return tuple(
        Event(code=code, count=count, first_s=first - time_origin, last_s=last - time_origin)
        for code, count, first, last in stream.raw_events
    )


def std_rows(velocity_std: FloatArray | None, epochs: int) -> FloatArray:
    """Return one row (m, 3) of sigmas per epoch, m/s, NaN where the log has none."""
    if velocity_std is None:
        return np.full((epochs, 3), np.nan)
    if velocity_std.ndim == 1:
        return np.repeat(velocity_std[:, None], 3, axis=1)
    return np.ascontiguousarray(velocity_std)


def _chunks(data: SensorData, first: int, last: int) -> Iterator[tuple[slice, slice]]:
    """Cut the log into runs of samples with the epochs up to each run's last sample."""
    done = first
    for start in range(0, data.time.size, CHUNK):
        stop = min(start + CHUNK, data.time.size)
        upto = int(np.searchsorted(data.gnss_time[:last], data.time[stop - 1], side="right"))
        yield slice(start, stop), slice(done, max(done, upto))
        done = max(done, upto)


def run(
    stream: KernelStream,
    data: SensorData,
    progress: Progress | None = None,
    *,
    with_sigma: bool = False,
    recorder: EpochRecorder | None = None,
) -> Trace:
    """Feed a whole log to a stream, the same updates in the same order as live.

    Parameters
    ----------
    stream : Observer or TwoStage
        Its state goes on from where it is.
    data : SensorData
        The log. Epochs outside the span of the IMU and infinite velocities are left out and counted; an epoch whose
        velocity is absent (NaN) is none.
    progress : callable, optional
        Called with the fraction done.
    with_sigma : bool
        Whether the estimator has a covariance; otherwise every sigma is NaN.
    recorder : EpochRecorder, optional
        Keeps the closed intervals, from which the uncertainty of a fixed-gain method follows.

    Raises
    ------
    LogError
        When the log has no GNSS velocity within the span of the IMU.
    """
    if data.velocity_ned is None:
        raise LogError("The log has no GNSS velocities; derive them from the positions first.")
    n = data.time.size
    first = int(np.searchsorted(data.gnss_time, data.time[0], side="left"))
    last = int(np.searchsorted(data.gnss_time, data.time[-1], side="right"))
    inside = data.velocity_ned[first:last]
    if int(np.isfinite(inside).all(axis=1).sum()) < 2:
        raise LogError(
            f"Fewer than two GNSS velocities lie within the IMU's time span ({data.time[0]:.3f} to "
            f"{data.time[-1]:.3f} s{_gnss_span(data.gnss_time)}). Check the time offset between the two."
        )
    std = std_rows(data.velocity_std, data.gnss_time.size)
    usable = np.asarray(np.isfinite(data.velocity_ned).all(axis=1))
    velocity = np.ascontiguousarray(data.velocity_ned)
    gyro_bias, accel_bias, attitude, velocity_out = (np.empty((n, 3)) for _ in range(4))
    status = np.empty(n, dtype=np.uint32)
    sigmas = [np.empty((n if with_sigma else 0, 3)) for _ in range(3)]
    feed = stream.run if recorder is None else recorder
    for rows, epochs in _chunks(data, first, last):
        keep = usable[epochs]
        feed(
            data.time[rows],
            data.gyro[rows],
            data.accel[rows],
            data.gnss_time[epochs][keep],
            velocity[epochs][keep],
            std[epochs][keep],
            gyro_bias[rows],
            accel_bias[rows],
            attitude[rows],
            velocity_out[rows],
            status[rows],
            *(sigma[rows] for sigma in sigmas),
        )
        if progress is not None:
            progress(rows.stop / n)
    events = events_of(stream, float(data.time[0]))
    left_out = int(first + data.gnss_time.size - last)
    if left_out:
        events += (Event(code="W_NO_EPOCHS", count=left_out),)
    infinite = int(np.isinf(inside).any(axis=1).sum())
    if infinite:
        events += (Event(code="E_NONFINITE", count=infinite),)
    if not with_sigma:
        # An unknown sigma is NaN, one shared row seen n times.
        sigmas = [np.broadcast_to(np.full(3, np.nan), (n, 3))] * 3
    return Trace(
        gyro_bias=gyro_bias,
        accel_bias=accel_bias,
        attitude=attitude,
        velocity_ned=velocity_out,
        status=status,
        gyro_bias_std=sigmas[0],
        accel_bias_std=sigmas[1],
        attitude_std=sigmas[2],
        events=events,
    )


def _gnss_span(gnss_time: FloatArray) -> str:
    if gnss_time.size == 0:
        return "; the log has no GNSS epoch at all"
    return f"; GNSS covers {gnss_time[0]:.3f} to {gnss_time[-1]:.3f} s"


def interpolated_position(data: SensorData) -> FloatArray | None:
    """Return GNSS positions interpolated to the IMU's stamps (n, 3), NaN outside their span, or None without any."""
    if data.position_llh is None:
        return None
    known = np.isfinite(data.position_llh).all(axis=1)
    out = np.full((data.time.size, 3), np.nan)
    if known.any():
        for axis in range(3):
            values = data.position_llh[known, axis]
            if axis == 1:
                values = np.unwrap(values)  # a drive across the date line
            out[:, axis] = np.interp(data.time, data.gnss_time[known], values, left=np.nan, right=np.nan)
        out[:, 1] = (out[:, 1] + np.pi) % (2.0 * np.pi) - np.pi
    return out


def finish(
    data: SensorData,
    trace: Trace,
    stream: KernelStream,
    *,
    method: str,
    params: MethodParams,
    warnings: tuple[Event, ...] = (),
    sigma: Sigma | None = None,
) -> Result:
    """Turn a run into a `Result`: mask what was not estimated, say what is known and since when.

    The `sigma` of a fixed-gain method takes the place of the trace's, and decides with what is known.
    """
    vertical = stream.vertical_axis
    accel_bias = trace.accel_bias
    accel_bias[:, vertical] = np.nan
    could_gyro, could_accel = observable(Status(int(trace.status[-1])), vertical)
    gyro_moved, accel_moved = wander(data.time, trace.gyro_bias), wander(data.time, accel_bias)
    unsteady = wander_event(gyro_moved, accel_moved, could_gyro, could_accel)
    backwards = mostly_backwards(trace.status)
    if backwards:
        could_gyro = could_accel = (False, False, False)
    known_gyro, known_accel = steady(could_gyro, gyro_moved, GYRO_BAND), steady(could_accel, accel_moved, ACCEL_BAND)
    stds = trace.gyro_bias_std, trace.accel_bias_std, trace.attitude_std
    if sigma is not None:
        learnt = np.full(3, sigma.level.gyro[-1])
        learnt[vertical] = sigma.level.vertical_gyro[-1]
        known_gyro = certain(known_gyro, learnt, sigma.gyro_bias[-1], GYRO_BAND, sigma.noise.initial_gyro_bias_std)
        learnt = np.full(3, sigma.level.accel[-1])
        known_accel = certain(known_accel, learnt, sigma.accel_bias[-1], ACCEL_BAND, sigma.noise.initial_accel_bias_std)
        stds = (
            widened(data.time, trace.gyro_bias, sigma.gyro_bias),
            widened(data.time, accel_bias, sigma.accel_bias),
            sigma.attitude,
        )
        stds[1][:, vertical] = np.nan
    trace = replace(trace, accel_bias=accel_bias, gyro_bias_std=stds[0], accel_bias_std=stds[1], attitude_std=stds[2])
    events = trace.events + warnings + unsteady + backwards
    return assemble(data, trace, stream, method, params, (known_gyro, known_accel), events)


def assemble(
    data: SensorData,
    trace: Trace,
    stream: KernelStream,
    method: str,
    params: MethodParams,
    known: tuple[Flags, Flags],
    events: tuple[Event, ...],
) -> Result:
    """Return the `Result` of a run; `known` are the flags of gyro and accelerometer axes."""
    # What is not known in the end has not settled, whatever the flags said; the vertical has a flag of its own.
    settled = {
        name: first_settled(data.time, trace.status, flag) if any(np.delete(flags, stream.vertical_axis)) else None
        for name, flags, flag in (
            ("gyro", known[0], Status.GYRO_SETTLED),
            ("accel", known[1], Status.ACCEL_SETTLED),
        )
    }
    return Result(
        time=data.time,
        gyro_bias=trace.gyro_bias,
        accel_bias=trace.accel_bias,
        gyro_bias_std=trace.gyro_bias_std,
        accel_bias_std=trace.accel_bias_std,
        roll=trace.attitude[:, 0],
        pitch=trace.attitude[:, 1],
        heading=trace.attitude[:, 2],
        attitude_std=trace.attitude_std,
        velocity_ned=trace.velocity_ned,
        velocity_std=np.full_like(trace.velocity_ned, np.nan),
        position_llh=interpolated_position(data),
        position_std=None,
        status=trace.status,
        method=method,
        params=params.as_dict(),
        known_gyro=known[0],
        known_accel=known[1],
        settled_at_s=settled,
        events=events,
    )
