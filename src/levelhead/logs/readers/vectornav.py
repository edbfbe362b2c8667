"""VectorNav's CSV exports: the columns that its SDK and tools write for the measurements of binary messages.

Names are those of the SDK's versions 0.19 and 1.0 (``uncompGyroX``, ``gnss1VelNedX``; ``UncompAccX``, ``Gnss1VelN``),
whatever their case. Readings are in the sensor's axes, x forward, y right, z down. The ones without the onboard
filter's compensation are preferred: an estimate then means the sensor's bias.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import FloatArray
from levelhead.errors import LogError
from levelhead.events import Event
from levelhead.logs.datum import ELLIPSOIDAL, declared
from levelhead.logs.pieces import Fact, GnssData, ImuData, Pieces, Stream, none_if_absent
from levelhead.logs.readers.base import Reader, Source, choose
from levelhead.logs.readers.csv_table import CsvLayout, guess_layout, is_text, read_numbers
from levelhead.logs.readers.receivers import dropped, known_std
from levelhead.logs.timescales import GPS_EPOCH_S, GPST, WEEK_S, gps_instant

BoolArray = NDArray[np.bool_]

_XYZ: Final = ("x", "y", "z")
_RAW_GYRO: Final = ("uncompgyro",)
_RAW_ACCEL: Final = ("uncompacc", "uncompaccel")
_GYRO: Final = ("gyro", "angularrate")
_ACCEL: Final = ("accel",)
_STARTUP, _GPS, _TOW, _WEEK = "timestartup", "timegps", "timegpstow", "timegpsweek"
_CLOCKS: Final = (_GPS, _TOW, _STARTUP)
_FILTER: Final = "ins"
"""What `gnss=` calls the velocity of the onboard filter."""
_FILTER_PERIOD_S: Final = 0.2
"""The filter's velocities are as many as the IMU's samples, but not as independent: those this far apart are used."""
_TRACKING: Final = 2
"""The mode, bits 0 and 1 of the filter's status, in which GNSS aids it."""
_LOWEST_FIX: Final = 2
"""Fix types from here on are fixes: 0 is none, 1 time only."""
_NS: Final = 1e-9
COMPENSATED: Final = (
    "The VectorNav's onboard filter had taken its own bias estimates off the readings; an estimate means what it left."
)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Table:
    """Columns of one export by their names in lower case, and the stamp of each row, s."""

    columns: Mapping[str, FloatArray]
    time: FloatArray
    scale: str | None

    def triple(self, names: Sequence[str]) -> FloatArray | None:
        """Return three columns side by side, None where one is absent."""
        if any(n not in self.columns for n in names):
            return None
        return np.column_stack([self.columns[n] for n in names])

    def column(self, name: str) -> FloatArray:
        """Return a column, NaN where the file has it not."""
        return self.columns.get(name, np.full(self.time.size, np.nan))


def sniff(_path: Path, head: bytes) -> bool:
    """Return whether the header has VectorNav's names of a clock, and of readings or of a receiver's velocity."""
    if not is_text(head):
        return False
    try:
        layout = guess_layout(head, name="")
    except LogError:
        return False
    names = set(_keys(layout))
    clock = bool(names & {*_CLOCKS, "gps1tow"})
    return layout.header and clock and (_imu_names(names) is not None or bool(_receivers(names)))


def read(source: Source) -> Pieces:
    """Read readings and the receivers' velocities and positions of one export.

    Raises
    ------
    LogError
        Where no clock runs, and naming file, line and column of what is wrong.
    """
    path = source.path
    content = path.read_bytes()
    layout = guess_layout(content, name=path.name)
    keys = _keys(layout)
    imu_names = _imu_names(set(keys)) if source.role == "imu" else None
    receivers = _receivers(set(keys))
    clock = next((c for c in (*_CLOCKS, "gps1tow") if c in keys), None)
    if clock is None or not (imu_names or receivers):
        raise LogError(
            f"{path.name} has no {'clock (TimeStartup or TimeGps)' if clock is None else 'readings'} among its "
            "columns; export them too."
        )
    wanted = _used(keys, imu_names, receivers)
    numbers = read_numbers(path, content, layout, {k: keys.index(k) for k in wanted}, time_column=clock, doubt_end=True)
    table, events = _stamped(path.name, numbers.columns)
    imu = None
    if imu_names is not None:
        rows = np.isfinite([table.columns[n] for n in imu_names]).any(axis=0)
        gyro, accel = table.triple(imu_names[:3]), table.triple(imu_names[3:])
        if gyro is not None and accel is not None and rows.any():
            imu = ImuData(time=table.time[rows], gyro=gyro[rows], accel=accel[rows], time_scale=table.scale)
    epochs = {name: _epochs(table, name, columns) for name, columns in receivers.items()}
    streams = tuple(Stream(kind="gnss", name=n, samples=g.time.size, note=note) for n, (g, _, note) in epochs.items())
    real = [s for s in streams if s.name != _FILTER]
    chosen = choose(real if real and source.gnss is None else streams, source.gnss, name=path.name)
    gnss, without_fix = (None, ()) if chosen is None else epochs[chosen.name][:2]
    if gnss is not None and not gnss.time.size:
        gnss = None
    compensated = imu_names is not None and not all(n.startswith("uncomp") for n in imu_names)
    undeclared: tuple[Fact, ...] = ("clock",) if table.scale is None else ()
    return Pieces(
        imu=imu,
        gnss=gnss,
        left_out=numbers.left_out,
        events=(*events, *without_fix),
        streams=streams,
        compensated=COMPENSATED if compensated and imu is not None else "",
        undeclared=undeclared,
        meta=declared(path.name, datum=None, height=ELLIPSOIDAL) if gnss is not None else {},
    )


def _keys(layout: CsvLayout) -> list[str]:
    """Return the header cells in lower case, without units and signs."""
    return [re.sub(r"[^a-z0-9]", "", re.sub(r"[\[(].*", "", name).lower()) for name in layout.names]


def _imu_names(names: set[str]) -> tuple[str, ...] | None:
    """Return the columns of gyro and accelerometer: the uncompensated ones where there are such."""
    chosen = []
    for kinds in ((*_RAW_GYRO, *_GYRO), (*_RAW_ACCEL, *_ACCEL)):
        triples = [[f"{kind}{axis}" for axis in _XYZ] for kind in kinds]
        triple = next((t for t in triples if set(t) <= names), None)
        if triple is None:
            return None
        chosen += triple
    return tuple(chosen)


def _receivers(names: set[str]) -> dict[str, dict[str, tuple[str, ...]]]:
    """Return velocity, position and their sigmas of each receiver, and of the filter, by the columns' names."""
    found: dict[str, dict[str, tuple[str, ...]]] = {}
    for name in ("gnss1", "gnss2", "gnss3", _FILTER):
        head = "" if name == _FILTER else name
        velocities = [(f"{head}vel{a}", f"{head}vel{b}", f"{head}vel{c}") for a, b, c in _NED_NAMES]
        positions = [(f"{head}{word}lat", f"{head}{word}lon", f"{head}{word}alt") for word in ("pos", "")]
        velocity = next((v for v in velocities if set(v) <= names), None)
        if velocity is None:
            continue
        found[name] = {"velocity": velocity}
        position = next((p for p in positions if set(p) <= names), None)
        if position is not None:
            found[name]["position"] = position
    return found


_NED_NAMES: Final = (("n", "e", "d"), ("nedn", "nede", "nedd"), ("nedx", "nedy", "nedz"))


def _used(keys: list[str], imu: tuple[str, ...] | None, receivers: dict[str, dict[str, tuple[str, ...]]]) -> list[str]:
    extras = [f"{g}{e}" for g in receivers if g != _FILTER for e in ("fix", "veluncertainty")]
    extras += [f"{g}posuncertainty{a}" for g in receivers for a in "ned"]
    extras += [f"gps{n}{e}" for n in "123" for e in ("tow", "week")]
    extras += ["insstatus", "veluncertainty", "velu"] if _FILTER in receivers else []
    groups = [columns for kinds in receivers.values() for columns in kinds.values()]
    wanted = [*_CLOCKS, _WEEK, *(imu or ()), *(c for group in groups for c in group), *extras]
    return [k for k in dict.fromkeys(wanted) if k in keys]


def _stamped(name: str, columns: Mapping[str, FloatArray]) -> tuple[_Table, tuple[Event, ...]]:
    """Stamp the rows: by GPS time where the device knew it most of the time, else by the time since its start."""
    size = next(iter(columns.values())).size
    if size == 0:
        raise LogError(f"{name}: the file has a header but no rows; record data or check the export.")
    absolute = np.full(size, np.nan)
    if _GPS in columns:
        absolute = np.where(columns[_GPS] > 0.0, GPS_EPOCH_S + columns[_GPS] * _NS, np.nan)
    elif _TOW in columns and _WEEK in columns:
        absolute = _instant(columns[_WEEK], columns[_TOW])
    known = np.isfinite(absolute)
    if known.mean() > 0.5 or (known.any() and _STARTUP not in columns):
        lost = int((~known).sum())
        rows = {k: v[known] for k, v in columns.items()}
        events = dropped(lost, "rows from before the GPS time was known")
        return _Table(columns=rows, time=absolute[known], scale=GPST), events
    if _STARTUP in columns:
        return _Table(columns=columns, time=columns[_STARTUP] * _NS, scale=None), ()
    if "gps1tow" in columns and "gps1week" in columns:
        return _Table(columns=columns, time=_instant(columns["gps1week"], columns["gps1tow"]), scale=GPST), ()
    raise LogError(f"{name}: no clock runs in it, GPS time was never known; export TimeStartup too.")


def _instant(week: FloatArray, tow: FloatArray) -> FloatArray:
    """Return seconds since 1970 in GPST; the time of week is in ns in binary messages, in s in ASCII ones."""
    finite = tow[np.isfinite(tow)]
    in_ns = finite.size > 0 and float(finite.max()) > WEEK_S
    seconds = tow * _NS if in_ns else tow
    return np.where(week > 0.0, gps_instant(week, seconds), np.nan)


def _epochs(
    table: _Table, name: str, columns: Mapping[str, tuple[str, ...]]
) -> tuple[GnssData, tuple[Event, ...], str]:
    """Return the epochs of one receiver: rows repeat its last fix until the next one."""
    values = {kind: np.column_stack([table.columns[c] for c in names]) for kind, names in columns.items()}
    there = np.isfinite(values["velocity"]).all(axis=1)
    time = table.time
    if name == _FILTER:
        good: BoolArray = np.asarray(there & _aided(table))
        new = _apart(time, good)
        sigma, note = _first(table, ("veluncertainty", "velu")), "the onboard filter's velocity, not a receiver's"
        position_std = None
    else:
        number = name[-1]
        fix = table.column(f"{name}fix")
        good = there & ~(fix < _LOWEST_FIX)
        instant = _instant(table.column(f"gps{number}week"), table.column(f"gps{number}tow"))
        stamped = table.scale == GPST and bool(np.isfinite(instant[good]).all()) and bool(good.any())
        marks = instant[:, None] if np.isfinite(instant).any() else np.hstack(list(values.values()))
        new = good & np.concatenate(([True], (marks[1:] != marks[:-1]).any(axis=1)))
        time = instant if stamped else time
        sigma, note = _first(table, (f"{name}veluncertainty",)), ""
        position_std = table.triple([f"{name}posuncertainty{a}" for a in "ned"])
    lost = int((there & ~good).sum())
    position = values.get("position")
    if position is not None:
        position = np.column_stack((np.radians(position[:, :2]), position[:, 2]))[new]
    gnss = GnssData(
        time=time[new],
        velocity_ned=values["velocity"][new],
        velocity_std=none_if_absent(known_std(sigma[new])),
        position_llh=None if position is None else none_if_absent(position),
        position_std=None if position is None or position_std is None else none_if_absent(known_std(position_std[new])),
        time_scale=table.scale,
    )
    return gnss, dropped(lost, f"rows of {name} without a fix"), note


def _aided(table: _Table) -> BoolArray:
    """Return the rows in which GNSS aids the filter; all where the file does not say."""
    if "insstatus" not in table.columns:
        return np.ones(table.time.size, dtype=np.bool_)
    status = np.nan_to_num(table.columns["insstatus"]).astype(np.int64)
    aided: BoolArray = (status & 3) == _TRACKING
    return aided


def _apart(time: FloatArray, good: BoolArray) -> BoolArray:
    """Return the good rows that are the first of each period of `_FILTER_PERIOD_S`."""
    period = np.where(good, np.floor(time / _FILTER_PERIOD_S), np.nan)
    rows = np.flatnonzero(good)
    first = np.zeros_like(good)
    first[rows[np.concatenate(([True], np.diff(period[rows]) != 0.0))[: rows.size]]] = True
    return first


def _first(table: _Table, names: Sequence[str]) -> FloatArray:
    """Return the first of some columns that the file has, NaN where it has none."""
    return table.column(next((n for n in names if n in table.columns), names[0]))


READER: Final = Reader(name="vectornav", title="VectorNav CSV export", sniff=sniff, read=read)
