"""What the readers of autopilots' logs share: scattered records, the choice among IMUs, parameters that change."""

from __future__ import annotations

import mmap
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import FloatArray
from levelhead.errors import LogError
from levelhead.events import Event
from levelhead.logs.pieces import ImuData, Stream
from levelhead.logs.readers.base import Source, choose
from levelhead.logs.readers.receivers import dropped

Bytes = NDArray[np.uint8]
Records = NDArray[Any]

MAX_BRIDGED: Final = 3.0
"""Readings are interpolated between samples that lie at most this many of the usual intervals apart."""
MIN_RATE_HZ: Final = 20.0
"""Streams below this rate were logged for a look at the sensor, not for navigation."""


@dataclass(frozen=True)
class Readings:
    """Stamps (n,) us since boot, gyro (n, 3) rad/s and accel (n, 3) m/s^2, FRD; accel is NaN where not to be used."""

    time_us: FloatArray
    gyro: FloatArray
    accel: FloatArray


@dataclass(frozen=True, kw_only=True)
class ImuStream:
    """One of the IMUs in a log.

    Attributes
    ----------
    stream : Stream
    rate : float
        Hz.
    rank : int
        Of those that are fast enough the lowest is preferred.
    calibrated, in_body : bool
        Whether biases were taken off, and whether the axes are the vehicle's.
    devices : dict
        The numbers by which the calibration knows the sensors.
    read : callable
    """

    stream: Stream
    rate: float
    rank: int
    calibrated: bool
    in_body: bool
    devices: dict[str, int] = field(default_factory=dict)
    read: Callable[[], Readings]


def chosen(imus: Sequence[ImuStream], source: Source) -> ImuStream:
    """Return the wanted IMU; else of those that are fast enough the one of the lowest rank and the most samples."""
    usable = [i for i in imus if i.rate >= MIN_RATE_HZ] or imus
    offered = imus if source.imu else [i for i in usable if i.rank == min(u.rank for u in usable)]
    stream = choose([i.stream for i in offered], source.imu, name=source.path.name)
    return next(i for i in offered if i.stream is stream)


def imu_data(imu: ImuStream, *, name: str, boot_us: float | None, time_scale: str) -> tuple[ImuData, tuple[Event, ...]]:
    """Return the samples of an IMU that are whole, and an event of what was left out.

    Parameters
    ----------
    imu : ImuStream
    name : str
        The file's name, for errors.
    boot_us : float or None
        The instant of boot, us since 1970 in `time_scale`; stamps count from boot where it is not known.
    time_scale : str
    """
    readings = imu.read()
    whole = np.isfinite(readings.accel).all(axis=1)
    without = int((~whole).sum())
    if not whole.any():
        raise LogError(f"{name}: the IMU {imu.stream.name} has no usable sample; choose another (imu=).")
    data = ImuData(
        time=(readings.time_us[whole] + (boot_us or 0.0)) * 1e-6,
        gyro=readings.gyro[whole],
        accel=readings.accel[whole],
        time_scale=None if boot_us is None else time_scale,
    )
    return data, dropped(without, "IMU samples that lack a reading of the accelerometer, or are marked as unhealthy")


def mapped(path: Path) -> mmap.mmap:
    """Return a file's bytes without reading them; they are looked at as they are needed."""
    with path.open("rb") as file:
        try:
            return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except ValueError:
            # It had bytes a moment ago.
            raise LogError(f"{path.name} is empty; check the recording or the copy.") from None


def gather(data: Bytes, starts: Sequence[int], dtype: np.dtype[Any]) -> Records:
    """Return the records that begin at these bytes of a file, shape (n,), of a structured type."""
    if len(starts) == 0:
        return np.empty(0, dtype=dtype)
    windows = np.lib.stride_tricks.sliding_window_view(data, dtype.itemsize)
    return np.ascontiguousarray(windows[np.asarray(starts, dtype=np.intp)]).view(dtype)[:, 0]


def columns(records: Records, names: Sequence[str]) -> FloatArray:
    """Return fields side by side, shape (n, k): several fields of one number each, or one field of several."""
    # Damaged bytes can be a signalling NaN, which the conversion would warn of.
    with np.errstate(invalid="ignore"):
        return np.column_stack([records[name].astype(np.float64) for name in names])


def paired(time: FloatArray, gyro: FloatArray, accel_time: FloatArray, accel: FloatArray) -> Readings:
    """Bring an accelerometer with stamps of its own (k,), us, onto the gyro's stamps (n,).

    Its readings are interpolated; across its gaps (see `MAX_BRIDGED`) they are NaN. What one sensor has before the
    other begins or after it ends is left out.
    """
    sound = np.isfinite(accel).all(axis=1)
    of, first = np.unique(accel_time[sound], return_index=True)
    values = accel[sound][first]
    if of.size < 2:
        return Readings(time[:0], gyro[:0], accel[:0])
    common = (time >= of[0]) & (time <= of[-1])
    time, gyro = time[common], gyro[common]
    steps = np.diff(of)
    after = np.clip(np.searchsorted(of, time), 1, of.size - 1)
    result = np.column_stack([np.interp(time, of, column) for column in values.T])
    result[steps[after - 1] > MAX_BRIDGED * np.median(steps)] = np.nan
    return Readings(time, gyro, result)


class Parameters:
    """The autopilot's parameters as the log tells them, each with the places in the file where it changed."""

    def __init__(self) -> None:
        self._history: dict[str, list[tuple[int, float]]] = {}

    def add(self, name: str, value: float, position: int) -> None:
        """Note a value from this byte of the file on."""
        history = self._history.setdefault(name, [])
        if not history or history[-1][1] != value:
            history.append((position, value))

    def lasting(self, pattern: re.Pattern[str], end: int) -> Mapping[str, float]:
        """Return those whose whole name matches: of each the value that holds for most of the file's bytes."""
        return {name: _lasting(history, end) for name, history in self._history.items() if pattern.fullmatch(name)}

    def changed(self, pattern: re.Pattern[str]) -> tuple[str, ...]:
        """Return the names of those that had more than one value."""
        return tuple(n for n, history in self._history.items() if len(history) > 1 and pattern.fullmatch(n))


def _lasting(history: Sequence[tuple[int, float]], end: int) -> float:
    # What was read first held from the start: logs begin with all parameters.
    bounds = [0, *(position for position, _ in history[1:]), end]
    spans: dict[float, int] = {}
    for (_, value), begin, until in zip(history, bounds[:-1], bounds[1:], strict=True):
        spans[value] = spans.get(value, 0) + until - begin
    return max(spans, key=lambda value: spans[value])
