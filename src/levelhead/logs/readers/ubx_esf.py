"""The readings of u-blox's own IMU, and of wheels that told it their speed: the messages ESF-RAW and ESF-MEAS.

Each reading is one axis with its type; readings of one time tag are put together. The tags count on the sensor's own
clock, see `levelhead.logs.readers.sensor_clock`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import FloatArray
from levelhead.logs.pieces import ImuData
from levelhead.logs.readers.frames import Frames, Places
from levelhead.logs.readers.sensor_clock import Placed, Ticks, place

MEAS: Final = 0x1002
RAW: Final = 0x1003

GYRO_TYPES: Final = (14, 13, 5)
"""Types of the readings of the gyroscope's x, y and z axes."""
ACCEL_TYPES: Final = (16, 17, 18)
SPEED_TYPE: Final = 11
"""Speed in mm/s. Wheel ticks (6 to 10) are not read: the file does not tell how far a tick goes."""
GYRO_UNIT: Final = math.radians(2.0**-12)
"""Unit of the 24 bits, rad/s."""
ACCEL_UNIT: Final = 2.0**-10
"""The same, m/s^2."""

_CALIBRATED: Final = 0x08
"""Flag of ESF-MEAS: the last word of the payload is a time, not a reading."""
_AT_ONCE: Final = 1 << 14
_SAME_TAGS: Final = 0.9
"""Share of the gyroscope's tags that the accelerometer shares where both are read together."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Readings:
    """The readings of one message, and of one provider in it, in the order of the file.

    Attributes
    ----------
    name : str
        The message, and the provider where there are several.
    kind : (n,) uint8
        Types.
    value : (n,) int32
        The 24 bits with their sign.
    tag : (n,) int64
        Time tags.
    at : (n,) int64
        Where in the file the message of each begins.
    tick_s : float or None
        The length of a tick by the documentation, s.
    """

    name: str
    kind: NDArray[np.uint8]
    value: NDArray[np.int32]
    tag: Ticks
    at: Places
    tick_s: float | None


@dataclass(frozen=True, kw_only=True, eq=False)
class Assembled:
    """IMU samples made of readings; `unplaced` and `incomplete` count the samples that could not be made."""

    imu: ImuData
    unplaced: int
    incomplete: int
    note: str


def readings_of(raw: Frames, meas: Frames) -> list[Readings]:
    """Take the readings out of the frames: those of ESF-RAW, then of ESF-MEAS, by provider."""
    return ([_of_raw(raw)] if raw.at.size else []) + (_of_meas(meas) if meas.at.size else [])


def _words(frames: Frames, begin: Places, count: Places) -> tuple[NDArray[np.uint32], Places]:
    """Return `count` words of 32 bits from the places `begin` of the data, and the frame of each."""
    frame = np.repeat(np.arange(count.size), count)
    first = begin[frame] + 4 * (np.arange(frame.size) - np.repeat(np.cumsum(count) - count, count))
    if not (begin % 4).any():
        return frames.data[: frames.data.size // 4 * 4].view("<u4")[first // 4], frame
    return np.ascontiguousarray(frames.data[first[:, np.newaxis] + np.arange(4)]).view("<u4")[:, 0], frame


def _readings(
    name: str, word: NDArray[np.uint32], tag: NDArray[np.uint32], at: Places, tick_s: float | None
) -> Readings:
    """Return the readings of words: types of six bits, and 24 bits with a sign; those of other sensors are left out."""
    kind = ((word >> 24) & 0x3F).astype(np.uint8)
    used = np.isin(kind, (*GYRO_TYPES, *ACCEL_TYPES, SPEED_TYPE))
    value = (word[used] << 8).view(np.int32) >> 8
    return Readings(name=name, kind=kind[used], value=value, tag=tag[used].astype(np.int64), at=at[used], tick_s=tick_s)


def _of_raw(frames: Frames) -> Readings:
    parts = []
    # A few thousand frames at a time: the indices of all at once would take many times the file's size.
    for begin in range(0, frames.at.size, _AT_ONCE):
        rows = slice(begin, begin + _AT_ONCE)
        count = np.maximum(frames.length[rows] - 4, 0) // 8
        word, frame = _words(frames, frames.start[rows] + 4, 2 * count)
        # The unit of these tags differs from product to product and is not documented: the GNSS epochs tell it.
        parts.append(_readings("ESF-RAW", word[0::2], word[1::2], frames.at[rows][frame[0::2]], None))
    return _joined(parts)


def _of_meas(frames: Frames) -> list[Readings]:
    """Return the readings of ESF-MEAS, one set for each provider."""
    enough = frames.length >= 8
    frames = Frames(at=frames.at[enough], start=frames.start[enough], length=frames.length[enough], data=frames.data)
    head, _ = _words(frames, frames.start, np.full(frames.at.size, 2))
    tag, flags, provider = head[0::2], head[1::2] & 0xFFFF, head[1::2] >> 16
    told = (flags >> 11).astype(np.int64)
    room = (frames.length - 8 - 4 * ((flags & _CALIBRATED) > 0)) // 4
    # Old protocols tell no number of readings: there it follows from the length.
    count = np.where(told > 0, np.minimum(told, (frames.length - 8) // 4), np.maximum(room, 0))
    numbers = np.unique(provider)
    found = []
    for number in numbers:
        name = "ESF-MEAS" if numbers.size == 1 else f"ESF-MEAS-{number}"
        mine = np.flatnonzero(provider == number)
        parts = []
        for begin in range(0, mine.size, _AT_ONCE):
            rows = mine[begin : begin + _AT_ONCE]
            word, frame = _words(frames, frames.start[rows] + 8, count[rows])
            parts.append(_readings(name, word, tag[rows][frame], frames.at[rows][frame], 1e-3))
        found.append(_joined(parts))
    return found


def _joined(parts: list[Readings]) -> Readings:
    return replace(
        parts[0],
        kind=np.concatenate([part.kind for part in parts]),
        value=np.concatenate([part.value for part in parts]),
        tag=np.concatenate([part.tag for part in parts]),
        at=np.concatenate([part.at for part in parts]),
    )


def assemble(readings: Readings, epoch_at: Places, epoch_time: FloatArray) -> Assembled | None:
    """Make IMU samples of readings; None where they are of no IMU, or no GNSS epoch tells their time.

    Where gyroscope and accelerometer are tagged apart, the accelerometer is interpolated to the gyroscope's instants.
    """
    used = np.isin(readings.kind, (*GYRO_TYPES, *ACCEL_TYPES))
    if not used.any():
        return None
    kind, value = readings.kind[used], readings.value[used]
    placed = place(readings.tag[used], readings.at[used], epoch_at, epoch_time, nominal_s=readings.tick_s)
    gyro_key, gyro_row, gyro_odd = _triples(GYRO_TYPES, kind, placed.key)
    accel_key, accel_row, accel_odd = _triples(ACCEL_TYPES, kind, placed.key)
    if gyro_key.size < 2 or accel_key.size < 2:
        return None
    gyro: FloatArray = GYRO_UNIT * value[gyro_row].astype(np.float64)
    accel: FloatArray = ACCEL_UNIT * value[accel_row].astype(np.float64)
    time = placed.time[gyro_row[:, 0]]
    note = ""
    _, ours, theirs = np.intersect1d(gyro_key, accel_key, assume_unique=True, return_indices=True)
    if ours.size >= _SAME_TAGS * gyro_key.size:
        lost = gyro_key.size + accel_key.size - 2 * ours.size
        time, gyro, accel = time[ours], gyro[ours], accel[theirs]
    else:
        near = _bracketed(gyro_key, accel_key)
        lost = int((~near).sum())
        accel = np.column_stack([np.interp(gyro_key, accel_key, axis) for axis in accel.T])
        time, gyro, accel = time[near], gyro[near], accel[near]
        note = "accelerometer interpolated to the gyroscope's instants"
    known = np.isfinite(time)
    if known.sum() < 2:
        return None
    imu = ImuData(time=time[known], gyro=gyro[known], accel=accel[known])
    return Assembled(imu=imu, unplaced=int((~known).sum()), incomplete=gyro_odd + accel_odd + lost, note=note)


def _triples(types: Sequence[int], kind: NDArray[np.uint8], key: Ticks) -> tuple[Ticks, NDArray[np.intp], int]:
    """Return the tags that all three axes have, the rows of their readings (n, 3), and how many readings are left."""
    keys, rows = [], []
    for wanted in types:
        mine = np.flatnonzero(kind == wanted)
        unique, first = np.unique(key[mine], return_index=True)
        keys.append(unique)
        rows.append(mine[first])
    common = np.intersect1d(np.intersect1d(keys[0], keys[1], assume_unique=True), keys[2], assume_unique=True)
    picked = [row[np.searchsorted(unique, common)] for unique, row in zip(keys, rows, strict=True)]
    left = int(np.isin(kind, types).sum()) - 3 * common.size
    return common, np.column_stack(picked) if common.size else np.zeros((0, 3), dtype=np.intp), left


def _bracketed(gyro_key: Ticks, accel_key: Ticks) -> NDArray[np.bool_]:
    """Return which tags lie between two of the accelerometer's that are not far apart."""
    after = np.clip(np.searchsorted(accel_key, gyro_key), 1, accel_key.size - 1)
    span = accel_key[after] - accel_key[after - 1]
    near: NDArray[np.bool_] = span <= 3 * np.median(np.diff(accel_key))
    return near & (gyro_key >= accel_key[after - 1]) & (gyro_key <= accel_key[after])


def wheel_speed(readings: Readings, epoch_at: Places, epoch_time: FloatArray, imu_time: FloatArray) -> FloatArray:
    """Return speeds that a provider tells, m/s, each on the IMU's sample next to it; NaN on the others."""
    speed = np.full(imu_time.size, np.nan)
    used = readings.kind == SPEED_TYPE
    if not used.any():
        return speed
    placed = place(readings.tag[used], readings.at[used], epoch_at, epoch_time, nominal_s=readings.tick_s)
    row, known = _next_to(imu_time, placed)
    speed[row] = 1e-3 * readings.value[used][known]
    return speed


def _next_to(imu_time: FloatArray, placed: Placed) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the IMU's samples within a step of some reading, and these readings."""
    order = np.argsort(imu_time, kind="stable")
    ordered = imu_time[order]
    known = np.flatnonzero(np.isfinite(placed.time))
    time = placed.time[known]
    after = np.clip(np.searchsorted(ordered, time), 1, ordered.size - 1)
    nearest = np.where(time - ordered[after - 1] < ordered[after] - time, after - 1, after)
    close = np.abs(ordered[nearest] - time) <= np.median(np.diff(ordered))
    return order[nearest[close]], known[close]
