"""What the streaming classes and the batch run share: one path through the kernel, and how its state is shown."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from typing import Final, Protocol, TypeVar

import numpy as np

from levelhead.conventions import FloatArray, GnssArrays, ImuArrays, OutArrays, StatusArray
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

    def run(self, imu: ImuArrays, gnss: GnssArrays, out: OutArrays, /) -> int:
        """Feed samples and epochs; fill the arrays after them, from the sigmas on only those that have rows."""
        ...


@dataclass(frozen=True, kw_only=True)
class Trace:
    """What a run of the kernel leaves behind, one row per IMU sample; the order is the kernel's."""

    gyro_bias: FloatArray
    accel_bias: FloatArray
    attitude: FloatArray
    velocity_ned: FloatArray
    status: StatusArray
    gyro_bias_std: FloatArray
    accel_bias_std: FloatArray
    attitude_std: FloatArray
    velocity_std: FloatArray
    position_llh: FloatArray
    position_std: FloatArray
    events: tuple[Event, ...] = ()

    @classmethod
    def empty(cls, n: int, *, with_sigma: bool, with_position: bool) -> Trace:
        """Return arrays for n samples; those of what the estimator does not know have no rows."""
        known, sigma, position = n, n if with_sigma else 0, n if with_position else 0
        rows = (known, known, known, known, sigma, sigma, sigma, sigma, position, position)
        a, b, c, d, e, f, g, h, i, j = (np.empty((count, 3)) for count in rows)
        return cls(
            gyro_bias=a,
            accel_bias=b,
            attitude=c,
            velocity_ned=d,
            status=np.empty(n, dtype=np.uint32),
            gyro_bias_std=e,
            accel_bias_std=f,
            attitude_std=g,
            velocity_std=h,
            position_llh=i,
            position_std=j,
        )

    def arrays(self, rows: slice = slice(None)) -> OutArrays:
        """Return these rows of all arrays, as the kernel takes them."""
        return tuple(getattr(self, f.name)[rows] for f in fields(self) if f.name != "events")


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


def imu_arrays(data: SensorData, rows: slice = slice(None)) -> ImuArrays:
    """Return these samples of a log as the kernel takes them."""
    wheel = np.empty(0) if data.wheel_speed is None else data.wheel_speed[rows]
    return data.time[rows], data.gyro[rows], data.accel[rows], wheel


def gnss_arrays(data: SensorData, *, positions: bool) -> GnssArrays:
    """Return all epochs of a log as the kernel takes them: NaN for what it lacks, or must not use."""
    m = data.gnss_time.size
    nothing = np.full((m, 3), np.nan)
    velocity = nothing if data.velocity_ned is None else np.ascontiguousarray(data.velocity_ned)
    if not positions or data.position_llh is None:
        return data.gnss_time, velocity, std_rows(data.velocity_std, m), nothing, nothing
    position = np.ascontiguousarray(data.position_llh)
    return data.gnss_time, velocity, std_rows(data.velocity_std, m), position, std_rows(data.position_std, m)


def run(
    stream: KernelStream,
    data: SensorData,
    progress: Progress | None = None,
    *,
    with_sigma: bool = False,
    with_position: bool = False,
    recorder: EpochRecorder | None = None,
) -> Trace:
    """Feed a whole log to a stream, the same updates in the same order as live.

    Parameters
    ----------
    stream : Observer or TwoStage
        Its state goes on from where it is.
    data : SensorData
        The log. Epochs outside the span of the IMU and infinite numbers are left out and counted; an epoch of which
        all is absent (NaN) is none.
    progress : callable, optional
        Called with the fraction done.
    with_sigma : bool
        Whether the estimator has a covariance; otherwise every sigma is NaN.
    with_position : bool
        Whether the estimator takes positions and knows its own; otherwise it is fed velocities alone.
    recorder : EpochRecorder, optional
        Keeps the closed intervals, from which the uncertainty of a fixed-gain method follows.

    Raises
    ------
    LogError
        When the log has no GNSS fix that the estimator can use within the span of the IMU.
    """
    if data.velocity_ned is None and not with_position:
        raise LogError("The log has no GNSS velocities; derive them from the positions first.")
    epochs_in = gnss_arrays(data, positions=with_position)
    n = data.time.size
    first = int(np.searchsorted(data.gnss_time, data.time[0], side="left"))
    last = int(np.searchsorted(data.gnss_time, data.time[-1], side="right"))
    _, velocity, _, position, _ = epochs_in
    usable = np.asarray(np.isfinite(velocity).all(axis=1) | np.isfinite(position).all(axis=1))
    if int(usable[first:last].sum()) < 2:
        raise LogError(
            f"Fewer than two GNSS velocities{' or positions' if with_position else ''} lie within the IMU's time span "
            f"({data.time[0]:.3f} to {data.time[-1]:.3f} s{_gnss_span(data.gnss_time)}). Check the time offset between "
            "the two."
        )
    trace = Trace.empty(n, with_sigma=with_sigma, with_position=with_position and data.position_llh is not None)
    feed = stream.run if recorder is None else recorder
    for rows, epochs in _chunks(data, first, last):
        keep = usable[epochs]
        time, v, v_std, p, p_std = (array[epochs][keep] for array in epochs_in)
        feed(imu_arrays(data, rows), (time, v, v_std, p, p_std), trace.arrays(rows))
        if progress is not None:
            progress(rows.stop / n)
    events = events_of(stream, float(data.time[0]))
    left_out = int(first + data.gnss_time.size - last)
    if left_out:
        events += (Event(code="W_NO_EPOCHS", count=left_out),)
    infinite = int((np.isinf(velocity[first:last]) | np.isinf(position[first:last])).any(axis=1).sum())
    if infinite:
        events += (Event(code="E_NONFINITE", count=infinite),)
    if not with_sigma:
        # An unknown sigma is NaN, one shared row seen n times.
        nothing = np.broadcast_to(np.full(3, np.nan), (n, 3))
        trace = replace(
            trace, gyro_bias_std=nothing, accel_bias_std=nothing, attitude_std=nothing, velocity_std=nothing
        )
    return replace(trace, events=events)


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
    estimated = trace.position_llh.shape[0] > 0
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
        velocity_std=trace.velocity_std,
        position_llh=trace.position_llh if estimated else interpolated_position(data),
        position_std=trace.position_std if estimated else None,
        status=trace.status,
        method=method,
        params=params.as_dict(),
        known_gyro=known[0],
        known_accel=known[1],
        settled_at_s=settled,
        events=events,
    )
