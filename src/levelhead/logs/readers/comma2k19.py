"""comma2k19: drives in minutes, each a folder of NumPy arrays, from a phone behind the windscreen of a car.

Every signal is a folder with two arrays in files without suffix: ``t``, seconds of the phone's boot clock, and
``value``. The public readme declares units and axes: the IMU's are forward, right, down already.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import FloatArray
from levelhead.errors import LogError
from levelhead.events import Event, merge_events
from levelhead.logs.datum import ELLIPSOIDAL, HEIGHT_KEY
from levelhead.logs.pieces import GnssData, ImuData, Pieces, Stream
from levelhead.logs.readers.base import Reader, Source, choose
from levelhead.logs.readers.receivers import dropped, unmeasured_vertical_std, velocity_of

LOG: Final = "processed_log"
GYROS: Final = {"gyro_uncalibrated": "as measured", "gyro": "less Android's estimate of its bias"}
UBLOX: Final = "live_gnss_ublox"
"""Its altitudes count from the ellipsoid: in the public sample they agree with the camera's ECEF positions to 2 m."""
RECEIVERS: Final = (UBLOX, "live_gnss_qcom")
WHEELS: Final = ("wheel_speed", "speed")
MAX_SEGMENTS: Final = 10_000
HELD_S: Final = 0.05
"""Samples of two sensors that are further apart than this do not belong together, s."""
JITTER_S: Final = 0.25
"""A receiver whose UTC and stamps differ by more than this, apart from a constant, is stamped as it came, s."""
COMPENSATED: Final = (
    "Android took its own estimate of the gyro bias off the readings; what is estimated here is the rest of the gyro "
    "bias (the stream gyro_uncalibrated has the readings as measured)."
)


class _Signal(NamedTuple):
    """A signal: stamps (n,), values (n, columns), and the rows that were cut off."""

    time: FloatArray
    value: FloatArray
    left_out: int


def sniff(path: Path, head: bytes) -> bool:
    """Return whether a folder is a minute of comma2k19, or a drive of several."""
    return not head and bool(_find_logs(path))


def read(source: Source) -> Pieces:
    """Read a minute (a folder with ``processed_log``) or a drive (a folder of such minutes, by their numbers).

    The receiver tells speed and bearing only: the vertical velocity is taken as zero with a wide sigma. Its stamps are
    when its messages came; they are made even by the UTC in the messages. Wheel speeds have no sign and count forward.

    Raises
    ------
    LogError
        When a signal that is needed is absent, or is no array of the shape that it should have.
    """
    # Damaged numbers may be huge, or no numbers; what comes of them is checked.
    with np.errstate(over="ignore", invalid="ignore"):
        return _read(source)


def _read(source: Source) -> Pieces:
    """Read all segments, one after the other."""
    logs = _find_logs(source.path)
    if not logs:
        raise LogError(f"{source.path} has no {LOG} with IMU and GNSS signals of comma2k19; pass the segment's folder.")
    streams = tuple(
        Stream(kind="imu", name=name, samples=_rows(logs, "IMU", name), note=note) for name, note in GYROS.items()
    ) + tuple(Stream(kind="gnss", name=name, samples=_rows(logs, "GNSS", name)) for name in RECEIVERS)
    streams = tuple(stream for stream in streams if stream.samples)
    gyro = choose([s for s in streams if s.kind == "imu"], source.imu, name=source.path.name)
    receiver = choose([s for s in streams if s.kind == "gnss"], source.gnss, name=source.path.name)
    left_out = 0
    events: list[Event] = []
    imu = gnss = None
    if gyro is not None and source.role == "imu":
        parts = [_imu(log, gyro.name) for log in logs if _has(log, "IMU", gyro.name)]
        imu = ImuData(
            time=np.concatenate([part.time for part, _, _ in parts]),
            gyro=np.concatenate([part.gyro for part, _, _ in parts]),
            accel=np.concatenate([part.accel for part, _, _ in parts]),
            wheel_speed=_joined([part.wheel_speed for part, _, _ in parts], [part.time.size for part, _, _ in parts]),
        )
        left_out += sum(cut for _, _, cut in parts)
        events += [event for _, found, _ in parts for event in found]
    if receiver is not None:
        fixes = [_gnss(log, receiver.name) for log in logs if _has(log, "GNSS", receiver.name)]
        gnss, found = _joined_gnss([value for value, _ in fixes])
        left_out += sum(cut for _, cut in fixes)
        events += found
    return Pieces(
        imu=imu,
        gnss=gnss,
        left_out=left_out,
        from_zero=True,
        meta={HEIGHT_KEY: ELLIPSOIDAL} if receiver is not None and receiver.name == UBLOX else {},
        streams=streams,
        events=merge_events(events),
        compensated=COMPENSATED if gyro is not None and gyro.name == "gyro" else "",
    )


def _find_logs(path: Path) -> list[Path]:
    """Return the folders ``processed_log`` of a segment, or those of a drive's segments in their order."""
    own = [folder for folder in (path / LOG, path) if _is_log(folder)]
    if own:
        return own[:1]
    if not path.is_dir():
        return []
    with os.scandir(path) as entries:
        numbered = [entry.name for entry in entries if entry.name.isascii() and entry.name.isdigit()][:MAX_SEGMENTS]
    logs = (path / name / LOG for name in sorted(numbered, key=lambda name: (len(name), name)))
    return [log for log in logs if _is_log(log)]


def _is_log(folder: Path) -> bool:
    return any(_has(folder, "IMU", name) for name in GYROS) or any(_has(folder, "GNSS", name) for name in RECEIVERS)


def _has(log: Path, kind: str, name: str) -> bool:
    return all((log / kind / name / part).is_file() for part in ("t", "value"))


def _rows(logs: Sequence[Path], kind: str, name: str) -> int:
    """Return how many samples the headers of a signal promise, in all segments."""
    return sum(_header(log / kind / name / "t").rows for log in logs if _has(log, kind, name))


class _Header(NamedTuple):
    """What the header of an ``.npy`` file says, checked against the file's size."""

    dtype: np.dtype[np.generic]
    fortran: bool
    rows: int
    columns: int
    start: int
    whole_rows: int


def _header(path: Path) -> _Header:
    """Return the checked header of an array of numbers with one or two dimensions."""
    where = "/".join(path.parts[-3:])
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    with path.open("rb") as file, warnings.catch_warnings():
        # Headers that Python 2 wrote are read with a warning.
        warnings.simplefilter("ignore")
        try:
            version = np.lib.format.read_magic(file)
            shape, fortran, dtype = readers[version](file)
        except Exception as error:  # noqa: BLE001 (a damaged header lets NumPy raise what its parsers raise)
            raise LogError(f"{where}: the file is no NumPy array that can be read ({error}); copy it anew.") from None
        start = file.tell()
        size = file.seek(0, os.SEEK_END) - start
    one = len(shape) == 1
    if dtype.kind not in "fiu" or len(shape) not in (1, 2) or min(shape) < 0 or dtype.hasobject:
        raise LogError(f"{where}: the array is {dtype} of shape {shape}, not numbers in one or two dimensions.")
    rows, columns = int(shape[0]), 1 if one else int(shape[1])
    fits = rows if columns * dtype.itemsize == 0 else min(rows, size // (columns * dtype.itemsize))
    if fits < rows and fortran and not one:
        raise LogError(f"{where}: the file is cut short, and lies column by column; copy it anew.")
    return _Header(dtype=dtype, fortran=fortran, rows=rows, columns=columns, start=start, whole_rows=fits)


def _array(path: Path, columns: int) -> tuple[FloatArray, int]:
    """Return the numbers of an array, (n, columns), and how many rows were cut off at its end."""
    header = _header(path)
    if header.columns != columns:
        where = "/".join(path.parts[-3:])
        raise LogError(f"{where}: the array has {header.columns} columns where {columns} are expected; copy it anew.")
    with path.open("rb") as file:
        file.seek(header.start)
        flat = np.fromfile(file, dtype=header.dtype, count=header.whole_rows * columns)
    values = flat.reshape((header.whole_rows, columns), order="F" if header.fortran else "C")
    return values.astype(np.float64), header.rows - header.whole_rows


def _signal(log: Path, kind: str, name: str, columns: int) -> _Signal:
    """Return a signal; of two arrays that are not of one length what is beyond the shorter is cut off."""
    time, cut_time = _array(log / kind / name / "t", 1)
    value, cut_value = _array(log / kind / name / "value", columns)
    rows = min(len(time), len(value))
    promised = max(len(time) + cut_time, len(value) + cut_value)
    return _Signal(time=time[:rows, 0], value=value[:rows], left_out=promised - rows)


def _imu(log: Path, name: str) -> tuple[ImuData, list[Event], int]:
    """Return the IMU data of one segment, what was left out of it, and how many rows were cut off."""
    if not _has(log, "IMU", "accelerometer"):
        raise LogError(f"{'/'.join(log.parts[-2:])} has no IMU/accelerometer with t and value; copy the segment anew.")
    gyro, accel = _signal(log, "IMU", name, 3), _signal(log, "IMU", "accelerometer", 3)
    cut = gyro.left_out + accel.left_out
    events: list[Event] = []
    time, rates = gyro.time, gyro.value
    if np.array_equal(gyro.time, accel.time):
        force = accel.value
    else:
        force, known = _at(time, accel)
        events += dropped(int((~known).sum()), "gyro samples without acceleration")
        time, rates, force = time[known], rates[known], force[known]
    wheel, wheel_cut = _wheel_speed(log, time)
    return ImuData(time=time, gyro=rates, accel=force, wheel_speed=wheel), events, cut + wheel_cut


def _at(time: FloatArray, signal: _Signal) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return a signal between its samples at other stamps, and where it has samples close enough for that."""
    finite = np.isfinite(signal.time) & np.isfinite(signal.value).all(axis=1)
    stamps, first = np.unique(signal.time[finite], return_index=True)
    if stamps.size < 2:
        return np.full((time.size, signal.value.shape[1]), np.nan), np.zeros(time.size, dtype=np.bool_)
    values = signal.value[finite][first]
    after = np.clip(np.searchsorted(stamps, time), 1, stamps.size - 1)
    inside = (time >= stamps[0]) & (time <= stamps[-1]) & (stamps[after] - stamps[after - 1] <= HELD_S)
    return np.column_stack([np.interp(time, stamps, column) for column in values.T]), inside


def _wheel_speed(log: Path, time: FloatArray) -> tuple[FloatArray | None, int]:
    """Return the mean speed of the wheels at the IMU samples nearest to it, NaN elsewhere, and the rows cut off."""
    name = next((name for name in WHEELS if _has(log, "CAN", name)), None)
    if name is None or time.size < 2:
        return None, 0
    wheels = _signal(log, "CAN", name, _header(log / "CAN" / name / "value").columns)
    speed = wheels.value.mean(axis=1) if wheels.value.shape[1] else np.full(len(wheels.value), np.nan)
    usable = np.isfinite(speed) & np.isfinite(wheels.time)
    order = np.argsort(time, kind="stable")
    after = np.clip(np.searchsorted(time[order], wheels.time[usable]), 1, time.size - 1)
    left, right = time[order][after - 1], time[order][after]
    nearest = np.where(wheels.time[usable] - left < right - wheels.time[usable], after - 1, after)
    close = np.abs(time[order][nearest] - wheels.time[usable]) <= HELD_S
    values = np.full(time.size, np.nan)
    values[order[nearest[close]]] = speed[usable][close]
    return values, wheels.left_out


def _joined(parts: Sequence[FloatArray | None], sizes: Sequence[int]) -> FloatArray | None:
    if all(part is None for part in parts):
        return None
    filled = [np.full(n, np.nan) if part is None else part for part, n in zip(parts, sizes, strict=True)]
    return np.concatenate(filled)


def _gnss(log: Path, name: str) -> tuple[FloatArray, int]:
    """Return the fixes of a segment, (m, 6): stamp, latitude, longitude, height, speed, bearing; and the rows cut."""
    signal = _signal(log, "GNSS", name, 6)
    latitude, longitude, speed, utc_ms, height, bearing = signal.value.T
    time = _even_stamps(signal.time, utc_ms / 1e3)
    return np.column_stack((time, latitude, longitude, height, speed, bearing)), signal.left_out


def _even_stamps(time: FloatArray, utc: FloatArray) -> FloatArray:
    """Return the receiver's own UTC as seconds of the boot clock: the stamps tell when messages came, give or take."""
    offset = time - utc
    if not time.size or not np.isfinite(offset).all() or (np.diff(utc) <= 0.0).any() or np.ptp(offset) > JITTER_S:
        return time
    return utc + float(np.median(offset))


def _joined_gnss(segments: Sequence[FloatArray]) -> tuple[GnssData, list[Event]]:
    """Return the fixes of all segments, and what was left out."""
    fixes = np.concatenate(segments)
    _, latitude, longitude, _, speed, _ = fixes.T
    fixed = np.isfinite(fixes).all(axis=1) & ((latitude != 0.0) | (longitude != 0.0))
    fixed &= (np.abs(latitude) <= 90.0) & (np.abs(longitude) <= 180.0) & (speed >= 0.0)
    events = [*dropped(int((~fixed).sum()), "GNSS records without a fix")]
    time, latitude, longitude, height, speed, bearing = fixes[fixed].T
    unknown = np.full(time.size, np.nan)
    if time.size:
        events.append(Event(code="I_VELOCITY_2D", count=int(time.size)))
    gnss = GnssData(
        time=time,
        velocity_ned=velocity_of(speed, np.radians(bearing)),
        velocity_std=np.column_stack((unknown, unknown, unmeasured_vertical_std(speed))),
        position_llh=np.column_stack((np.radians(latitude), np.radians(longitude), height)),
    )
    return gnss, events


READER: Final = Reader(name="comma2k19", title="comma2k19 (folder processed_log)", sniff=sniff, read=read)
