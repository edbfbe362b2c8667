"""SBG Systems' text exports: what sbgBasicLogger writes, one tab-separated file per message with a line of units.

The IMU is in ``imuData.txt`` (device axes x forward, y right, z down), the receiver in ``gnss1Vel.txt`` and
``gnss1Pos.txt`` beside it (``gps1Vel.txt`` in older versions), all stamped by the device in microseconds since it was
switched on, as a uint32 that begins anew every 71.6 minutes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from levelhead.conventions import UNIT_FACTORS, FloatArray
from levelhead.errors import LogError
from levelhead.events import Event
from levelhead.logs.datum import MEAN_SEA_LEVEL, declared
from levelhead.logs.pieces import GnssData, ImuData, Pieces, Stream, none_if_absent
from levelhead.logs.readers.base import Reader, Source, choose
from levelhead.logs.readers.csv_table import guess_layout, is_text, read_numbers
from levelhead.logs.readers.receivers import dropped, known_std

_FIRST: Final = ("timestamp", "status")
_IMU: Final = ("accelX", "accelY", "accelZ", "gyroX", "gyroY", "gyroZ")
_VELOCITY: Final = ("velN", "velE", "velD")
_VELOCITY_STD: Final = ("velStdN", "velStdE", "velStdD")
_POSITION: Final = ("latitude", "longitude", "altitude")
_POSITION_STD: Final = ("latitudeStd", "longitudeStd", "altitudeStd")
_TOW: Final = "gpsTow"
_UNITS: Final = {
    "timestamp": "us",
    **dict.fromkeys(_IMU[:3], "m.s^-2"),
    **dict.fromkeys(_IMU[3:], "deg.s^-1"),
    **dict.fromkeys((*_VELOCITY, *_VELOCITY_STD), "m.s^-1"),
    **dict.fromkeys(_POSITION[:2], "deg"),
    **dict.fromkeys((_POSITION[2], *_POSITION_STD), "m"),
    _TOW: "ms",
}
_IMU_FILES: Final = ("imuData.txt", "imuShort.txt", "imuFast.txt")
_GNSS_FILES: Final = ("gnss{}", "gps{}", "log_gps{}")
_WRAP: Final = 2.0**32
_SOLUTION_MASK: Final = 0x3F
"""Status: bits 0 to 5 are 0 where a solution was computed, bits 6 to 11 are its type, 0 for none."""


def sniff(path: Path, head: bytes) -> bool:
    """Return whether a file has the header of sbgBasicLogger, or a folder holds such an IMU file."""
    if path.is_dir():
        return _imu_file(path) is not None
    first = head.partition(b"\n")[0].decode("ascii", errors="replace").rstrip("\r").split("\t")
    known = first[:2] in (list(_FIRST), ["iso8601Time", "status"])
    return is_text(head) and known and (first[2:8] == list(_IMU) or _TOW in first)


def read(source: Source) -> Pieces:
    """Read an IMU file with the GNSS files beside it, or a GNSS file alone.

    Raises
    ------
    LogError
        On stamps that are dates, other units, and naming file, line and column of what is wrong.
    """
    folder = source.path if source.path.is_dir() else source.path.parent
    imu_path = _imu_file(folder) if source.path.is_dir() else source.path
    if imu_path is None:
        raise LogError(f"{source.path} holds none of {', '.join(_IMU_FILES)}; export the IMU's messages as text.")
    title = _titles(imu_path)
    if set(_IMU) <= set(title):
        imu_file = _read(imu_path, _IMU)
        receivers = _receivers(folder)
    else:
        imu_file = None
        receivers = {"gnss": [imu_path]}
    files = {name: [_read_gnss(path) for path in paths] for name, paths in receivers.items()}
    streams = tuple(
        Stream(kind="gnss", name=name, samples=max(f.time.size for f in parts)) for name, parts in files.items()
    )
    chosen = choose(streams, source.gnss, name=source.path.name)
    parts = [] if chosen is None else files[chosen.name]
    events = tuple(event for f in parts for event in f.events)
    imu = None
    if imu_file is not None and source.role == "imu":
        accel, gyro = imu_file.columns(_IMU[:3]), imu_file.columns(_IMU[3:]) * UNIT_FACTORS["rad/s"]["deg/s"]
        imu = ImuData(time=imu_file.time, gyro=gyro, accel=accel)
    gnss = None
    if parts:
        gnss = _joined(parts, imu_file.time[0] if imu_file is not None and imu_file.time.size else None)
        if imu_file is not None:
            names = " and ".join(f.name for f in parts)
            events = (Event(code="I_SIBLING", count=len(parts), detail=f"{names}."), *events)
    return Pieces(
        imu=imu,
        gnss=gnss,
        left_out=sum(f.left_out for f in ([imu_file] if imu_file is not None else []) + parts),
        events=events,
        streams=streams if imu_file is not None else (),
        meta=declared(source.path.name, datum=None, height=MEAN_SEA_LEVEL) if gnss is not None else {},
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _File:
    """One file: stamps in s since power-up, unwrapped, and its other columns as they stand."""

    name: str
    time: FloatArray
    values: dict[str, FloatArray]
    left_out: int
    events: tuple[Event, ...] = ()

    def columns(self, names: tuple[str, ...]) -> FloatArray:
        """Return columns side by side, NaN where the file has them not."""
        blank = np.full(self.time.size, np.nan)
        return np.column_stack([self.values.get(n, blank) for n in names])


def _imu_file(folder: Path) -> Path | None:
    for name in _IMU_FILES:
        if (folder / name).is_file() and _titles(folder / name)[:2] == list(_FIRST):
            return folder / name
    return None


def _receivers(folder: Path) -> dict[str, list[Path]]:
    """Return the files of each receiver that lie in a folder."""
    found = {}
    for number in (1, 2):
        for prefix in _GNSS_FILES:
            paths = [folder / f"{prefix.format(number)}{kind}.txt" for kind in ("Vel", "Pos")]
            paths = [p for p in paths if p.is_file()]
            if paths:
                found[f"gnss{number}"] = paths
                break
    return found


def _titles(path: Path) -> list[str]:
    with path.open("rb") as file:
        return file.readline(4096).decode("ascii", errors="replace").rstrip("\r\n").split("\t")


def _read(path: Path, wanted: tuple[str, ...], content: bytes | None = None) -> _File:
    """Read columns of one file, by the names and with the units that sbgBasicLogger gives them."""
    content = path.read_bytes() if content is None else content
    layout = guess_layout(content, name=path.name)
    if layout.names[:1] == ("iso8601Time",):
        raise LogError(
            f"{path.name} is stamped with dates, which sbgBasicLogger derives roughly; export with "
            "--time-mode=timestamp."
        )
    names = ("timestamp", *wanted)
    missing = [n for n in names if n not in layout.names]
    if missing:
        raise LogError(f"{path.name}: the column {missing[0]} is missing; export the message with its header.")
    indices = {n: layout.names.index(n) for n in names}
    for name, index in indices.items():
        if layout.units and layout.units[index] != _UNITS[name]:
            raise LogError(
                f"{path.name}: {name} is in {layout.units[index]!r} where sbgBasicLogger writes {_UNITS[name]!r}; "
                "describe the file in a mapping (mapping=)."
            )
    numbers = read_numbers(path, content, layout, indices, time_column="timestamp", doubt_end=True)
    stamps = numbers.columns["timestamp"]
    wraps = np.cumsum(np.diff(stamps, prepend=stamps[:1]) < -_WRAP / 2.0)
    time = (stamps + wraps * _WRAP) * UNIT_FACTORS["s"]["us"]
    values = {n: numbers.columns[n] for n in wanted}
    return _File(name=path.name, time=time, values=values, left_out=numbers.left_out)


def _read_gnss(path: Path) -> _File:
    """Read a file of velocities or positions, without the rows whose status tells of no solution."""
    content = path.read_bytes()
    if not content:
        # A message that never came has no file: an empty one lost what was in it.
        none = np.empty(0)
        return _File(name=path.name, time=none, values={_TOW: none}, left_out=1)
    titles = content.partition(b"\n")[0].decode("ascii", errors="replace").split("\t")
    wanted = (_TOW, *_VELOCITY, *_VELOCITY_STD) if _VELOCITY[0] in titles else (_TOW, *_POSITION, *_POSITION_STD)
    file = _read(path, wanted, content)
    # Statuses are hexadecimal: no column of numbers.
    cells = [line.split(b"\t", 2)[1:2] for line in content.split(b"\n") if line.strip()]
    first = next((k for k, cell in enumerate(cells) if cell and _status(cell[0]) is not None), len(cells))
    codes = [_status(cell[0]) if cell else None for cell in cells[first : first + file.time.size]]
    codes += [None] * (file.time.size - len(codes))
    good = np.array([c is not None and not c & _SOLUTION_MASK and bool(c >> 6 & _SOLUTION_MASK) for c in codes], bool)
    lost = int((~good).sum())
    values = {n: v[good] for n, v in file.values.items()}
    events = dropped(lost, f"rows of {path.name} without a solution")
    return replace(file, time=file.time[good], values=values, events=events)


def _status(cell: bytes) -> int | None:
    try:
        return int(cell, 0)
    except ValueError:
        return None


def _joined(parts: list[_File], start: float | None) -> GnssData | None:
    """Bring velocities and positions of one epoch together, which is known by its time of week."""
    tows = [f.values[_TOW] for f in parts]
    keys = np.unique(np.concatenate(tows))
    keys = keys[np.isfinite(keys)]
    if not keys.size:
        return None
    columns: dict[str, FloatArray] = {}
    time = np.full(keys.size, np.nan)
    for file, tow in zip(parts, tows, strict=True):
        known = np.isfinite(tow)
        place = np.searchsorted(keys, tow[known])
        time[place] = np.where(np.isnan(time[place]), file.time[known], time[place])
        for name, values in file.values.items():
            column = columns.setdefault(name, np.full(keys.size, np.nan))
            column[place] = values[known]
    if start is not None:
        # The counters of the two files may have begun anew a different number of times before their first rows.
        seconds = _WRAP * UNIT_FACTORS["s"]["us"]
        time = time - seconds * np.round((np.nanmin(time) - start) / seconds)
    order = np.argsort(time, kind="stable")
    whole = _File(name="", time=time[order], values={n: v[order] for n, v in columns.items()}, left_out=0)
    velocity, position = whole.columns(_VELOCITY), whole.columns(_POSITION)
    position[:, :2] = np.radians(position[:, :2])
    return GnssData(
        time=whole.time,
        velocity_ned=none_if_absent(velocity),
        velocity_std=none_if_absent(known_std(whole.columns(_VELOCITY_STD))) if np.isfinite(velocity).any() else None,
        position_llh=none_if_absent(position),
        position_std=none_if_absent(known_std(whole.columns(_POSITION_STD))) if np.isfinite(position).any() else None,
    )


READER: Final = Reader(name="sbg", title="SBG text export", sniff=sniff, read=read)
