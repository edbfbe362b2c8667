"""Recordings of the phone app Sensor Logger: a zip, or its folder, with one CSV for each sensor.

Stamps are nanoseconds since 1970 in UTC. Axes are the phone's (x right, y up along the screen, z out of it) and are
left so: how the phone lay in the vehicle is found in the data. An iPhone gives uncalibrated accelerations in g and all
accelerations with the opposite sign, unless the app was told to standardise.
"""

from __future__ import annotations

import csv
import io
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Final

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import GRAVITY, FloatArray
from levelhead.errors import LogError
from levelhead.events import Event
from levelhead.logs.datum import ELLIPSOIDAL, WGS84, declared
from levelhead.logs.pieces import GnssData, ImuData, Pieces, none_if_absent
from levelhead.logs.readers.base import Reader, Source
from levelhead.logs.readers.csv_table import guess_layout, read_numbers
from levelhead.logs.readers.receivers import dropped, known_std, unmeasured_vertical_std, velocity_of
from levelhead.logs.timescales import UTC

_GYROS: Final = ("GyroscopeUncalibrated.csv", "Gyroscope.csv")
_RAW_ACCEL, _TOTAL, _LINEAR, _GRAVITY = (
    "AccelerometerUncalibrated.csv",
    "TotalAcceleration.csv",
    "Accelerometer.csv",
    "Gravity.csv",
)
_LOCATION: Final = "Location.csv"
_METADATA: Final = "Metadata.csv"
_MAGIC: Final = b"PK\x03\x04"
MAX_MEMBER_BYTES: Final = 1 << 29
"""A sensor's CSV beyond this is none: a day at 100 Hz has 0.7 GB, a long drive of 8 h a third of it."""
MAX_RATIO: Final = 200
"""Text of numbers shrinks to a third or a tenth; what shrinks by more than this was made to burst."""
_IN_G: Final = (0.8, 1.2)
_IN_SI: Final = (8.3, 11.3)
"""Median length of an acceleration with gravity in it, in g and in m/s^2."""
_MAX_BRACKET: Final = 5.0
"""An acceleration is interpolated between two that are at most this many of their intervals apart."""
_NS: Final = 1e-9
COMPENSATED: Final = (
    "The phone's own calibration had taken biases off the turn rates; an estimate means what it left. Record the "
    "uncalibrated sensors."
)


def sniff(path: Path, head: bytes) -> bool:
    """Return whether a zip or a folder holds the app's CSVs of a gyroscope and an accelerometer."""
    if path.is_dir():
        names = {entry.name for entry in path.iterdir()}
    elif not head.startswith(_MAGIC):
        return False
    else:
        try:
            with zipfile.ZipFile(path) as archive:
                names = {PurePosixPath(name).name for name in archive.namelist()}
        except (zipfile.BadZipFile, OSError, ValueError):
            # A zip that was cut has lost its directory; its first names may still be there.
            return any(name.encode() in head for name in (*_GYROS, _RAW_ACCEL, _TOTAL))
    return bool(names & set(_GYROS)) and bool(names & {_RAW_ACCEL, _TOTAL, _LINEAR})


def read(source: Source) -> Pieces:
    """Read gyroscope, accelerometer and location.

    Raises
    ------
    LogError
        On a damaged or hostile zip, on sensors that are missing, and where it cannot be told which signs the
        accelerations have.
    """
    path = source.path
    with _members(path) as members:
        gnss, events, left_out = _location(members)
        if source.role == "gnss":
            meta = _datum(path) if gnss else {}
            return Pieces(gnss=gnss, left_out=left_out, events=events, meta=meta, host_clock=True)
        gyro_name = next((n for n in _GYROS if members.has(n)), None)
        if gyro_name is None:
            raise LogError(f"{path.name} holds no {_GYROS[0]} with samples; switch the sensor on in the app.")
        gyro = _triples(members, gyro_name)
        accel, sign_and_unit = _acceleration(path.name, members)
    readings, whole = _at(gyro.time, accel.time, accel.values)
    lost = int((~whole).sum())
    if not whole.any():
        raise LogError(f"{path.name}: gyroscope and accelerometer were not recorded at the same time.")
    events = (*events, *dropped(lost, "turn rates without accelerations before and behind them"))
    imu = ImuData(time=gyro.time[whole], gyro=gyro.values[whole], accel=readings[whole] * sign_and_unit, time_scale=UTC)
    return Pieces(
        imu=imu,
        gnss=gnss,
        left_out=left_out + gyro.left_out + accel.left_out,
        events=events,
        compensated="" if gyro_name == _GYROS[0] else COMPENSATED,
        undeclared=("axes",),
        host_clock=True,
        meta=_datum(path) if gnss is not None else {},
    )


def _datum(path: Path) -> dict[str, object]:
    return declared(path.name, datum=WGS84, height=ELLIPSOIDAL)


class _Members:
    """The CSVs of one recording by their names; nothing is written, and no name of the archive is used as a path."""

    def __init__(self, name: str, entries: Mapping[str, Path | zipfile.ZipInfo], archive: zipfile.ZipFile | None):
        self.name = name
        self._entries = entries
        self._archive = archive

    def has(self, member: str) -> bool:
        """Whether a sensor has a file that is not empty: the app leaves empty ones where a phone lacks the sensor."""
        entry = self._entries.get(member)
        if entry is None:
            return False
        return (entry.stat().st_size if isinstance(entry, Path) else entry.file_size) > 0

    def read(self, member: str) -> bytes:
        """Return a file's content; its size and how far it was compressed are looked at first."""
        entry = self._entries[member]
        if isinstance(entry, Path):
            size, packed = entry.stat().st_size, entry.stat().st_size
        else:
            size, packed = entry.file_size, entry.compress_size
        if size > MAX_MEMBER_BYTES or size > MAX_RATIO * max(packed, 1):
            raise LogError(
                f"{self.name}, {member}: {size} bytes out of {packed} are no recording of a sensor; look at where the "
                "file comes from."
            )
        if isinstance(entry, Path):
            return entry.read_bytes()
        assert self._archive is not None  # noqa: S101 - entries of an archive come with it
        try:
            return self._archive.read(entry)
        except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, ValueError) as error:
            raise LogError(
                f"{self.name}, {member}: the zip is damaged ({error}); export the recording again."
            ) from None


@contextmanager
def _members(path: Path) -> Iterator[_Members]:
    wanted = {*_GYROS, _RAW_ACCEL, _TOTAL, _LINEAR, _GRAVITY, _LOCATION, _METADATA}
    if path.is_dir():
        yield _Members(path.name, {p.name: p for p in path.iterdir() if p.name in wanted and p.is_file()}, None)
        return
    try:
        archive = zipfile.ZipFile(path)
    except (zipfile.BadZipFile, ValueError, NotImplementedError) as error:
        raise LogError(
            f"{path.name} is a damaged zip, or was cut short ({error}); export the recording again."
        ) from None
    with archive:
        entries: dict[str, Path | zipfile.ZipInfo] = {}
        for info in archive.infolist():
            member = PurePosixPath(info.filename).name
            if member in wanted and member in entries:
                raise LogError(f"{path.name} holds several recordings; unpack it and read them one by one.")
            if member in wanted:
                entries[member] = info
        yield _Members(path.name, entries, archive)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Samples:
    """One sensor: stamps, s since 1970, and x, y, z (n, 3) as they stand."""

    time: FloatArray
    values: FloatArray
    left_out: int


def _table(members: _Members, member: str, wanted: tuple[str, ...]) -> tuple[dict[str, FloatArray], int]:
    """Return columns of one CSV in the order of their stamps, NaN where the file has them not."""
    where = Path(f"{members.name}, {member}".replace("/", "_"))
    content = members.read(member)
    layout = guess_layout(content, name=where.name)
    missing = [n for n in ("time", *wanted[:3]) if n not in layout.names]
    if missing:
        raise LogError(f"{where.name}: the column {missing[0]} is missing; export the recording again.")
    indices = {n: layout.names.index(n) for n in ("time", *wanted) if n in layout.names}
    numbers = read_numbers(where, content, layout, indices, time_column="time")
    time = numbers.columns["time"]
    order = np.flatnonzero(np.isfinite(time))
    order = order[np.argsort(time[order], kind="stable")]
    columns = {n: numbers.columns.get(n, np.full(time.size, np.nan))[order] for n in ("time", *wanted)}
    columns["time"] = columns["time"] * _NS
    return columns, numbers.left_out


def _triples(members: _Members, member: str) -> _Samples:
    columns, left_out = _table(members, member, ("x", "y", "z"))
    values = np.column_stack([columns[a] for a in ("x", "y", "z")])
    return _Samples(time=columns["time"], values=values, left_out=left_out)


def _acceleration(name: str, members: _Members) -> tuple[_Samples, float]:
    """Return the acceleration with gravity in it, and the factor to m/s^2 in the sign of a specific force."""
    iphone, standard = _platform(members)
    if members.has(_RAW_ACCEL):
        samples = _triples(members, _RAW_ACCEL)
        length = _length(samples)
        if _IN_G[0] <= length <= _IN_G[1] and iphone is not False and standard is not True:
            return samples, -GRAVITY
        if _IN_SI[0] <= length <= _IN_SI[1] and (not iphone or standard is not False):
            return samples, 1.0
        device = {True: "an iPhone", False: "Android", None: "no known platform"}[iphone]
        raise LogError(
            f"{name}, {_RAW_ACCEL}: the acceleration has a median length of {length:.3g}, which does not go with "
            f"{device} as {_METADATA} tells it; check the recording."
        )
    if members.has(_TOTAL):
        samples = _triples(members, _TOTAL)
    elif members.has(_LINEAR) and members.has(_GRAVITY):
        linear, gravity = _triples(members, _LINEAR), _triples(members, _GRAVITY)
        values, whole = _at(linear.time, gravity.time, gravity.values)
        samples = _Samples(
            time=linear.time[whole],
            values=(linear.values + values)[whole],
            left_out=linear.left_out + gravity.left_out,
        )
    else:
        raise LogError(f"{name} holds no acceleration with gravity in it; switch on {_RAW_ACCEL[:-4]} in the app.")
    length = _length(samples)
    if not _IN_SI[0] <= length <= _IN_SI[1]:
        raise LogError(f"{name}: the acceleration has a median length of {length:.3g} m/s^2, which is not gravity.")
    if iphone is None or (iphone and standard is None):
        raise LogError(
            f"{name}: {_METADATA} does not tell the platform or whether units and frames were standardised, and the "
            f"sign of the acceleration depends on it; record {_RAW_ACCEL[:-4]}."
        )
    return samples, -1.0 if iphone and not standard else 1.0


def _length(samples: _Samples) -> float:
    with np.errstate(over="ignore"):  # a damaged file may have numbers such as 1e300
        length = np.linalg.norm(samples.values, axis=1)
    length = length[np.isfinite(length)]
    return float(np.median(length)) if length.size else 0.0


def _platform(members: _Members) -> tuple[bool | None, bool | None]:
    """Return whether an iPhone recorded, and whether the app standardised units and signs; None where nobody says."""
    if not members.has(_METADATA):
        return None, None
    text = members.read(_METADATA).decode("utf-8", errors="replace")
    try:
        rows = list(csv.reader(io.StringIO(text)))
    except csv.Error:
        rows = []
    known = dict(zip(rows[0], rows[1], strict=False)) if len(rows) > 1 else {}
    platform = known.get("platform", "").strip().lower()
    iphone = True if platform == "ios" else False if platform == "android" else None
    standard = {"true": True, "false": False}.get(known.get("standardisation", "").strip().lower())
    return iphone, standard


def _at(wanted: FloatArray, time: FloatArray, values: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Interpolate values (n, 3) to other stamps; also return where there are samples on both sides, near enough."""
    good = np.isfinite(values).all(axis=1) & np.concatenate(([True], np.diff(time) > 0.0))[: time.size]
    time, values = time[good], values[good]
    if time.size < 2:
        return np.full((wanted.size, 3), np.nan), np.zeros(wanted.size, dtype=np.bool_)
    after = np.clip(np.searchsorted(time, wanted), 1, time.size - 1)
    bracket = time[after] - time[after - 1]
    near = bracket <= _MAX_BRACKET * np.median(np.diff(time))
    whole = near & (wanted >= time[0]) & (wanted <= time[-1])
    return np.column_stack([np.interp(wanted, time, values[:, k]) for k in range(3)]), whole


def _location(members: _Members) -> tuple[GnssData | None, tuple[Event, ...], int]:
    """Return the fixes: speed and bearing make the velocity, negative numbers mean that the phone does not know."""
    if not members.has(_LOCATION):
        return None, (), 0
    names = ("latitude", "longitude", "altitude", "speed", "bearing", "horizontalAccuracy", "verticalAccuracy")
    columns, left_out = _table(members, _LOCATION, (*names, "speedAccuracy", "bearingAccuracy"))
    known = np.isfinite(columns["latitude"]) & np.isfinite(columns["longitude"])
    known &= (np.abs(columns["latitude"]) <= 90.0) & (np.abs(columns["longitude"]) <= 180.0)
    lost = int((~known).sum())
    events = [*dropped(lost, f"rows of {_LOCATION} without a place")]
    columns = {n: np.where(np.isfinite(v[known]), v[known], np.nan) for n, v in columns.items()}
    if not known.any():
        return None, tuple(events), left_out
    speed, bearing = columns["speed"], columns["bearing"]
    # Android writes a bearing of 0 where it has none; it then has no accuracy either.
    unknown = (bearing < 0.0) | np.isnan(bearing) | ((bearing == 0.0) & ~(columns["bearingAccuracy"] > 0.0))
    moving = (speed >= 0.0) & ((speed == 0.0) | ~unknown)
    course = np.where(unknown, 0.0, np.radians(bearing))
    velocity = velocity_of(speed, course)
    velocity[~moving] = np.nan
    across = speed * np.radians(np.where(columns["bearingAccuracy"] > 0.0, columns["bearingAccuracy"], 0.0))
    along = known_std(columns["speedAccuracy"])
    horizontal = np.where(moving, np.fmax(along, known_std(across)), np.nan)
    vertical = np.where(moving, unmeasured_vertical_std(speed), np.nan)
    position = np.column_stack((np.radians(columns["latitude"]), np.radians(columns["longitude"]), columns["altitude"]))
    position[np.isnan(position).any(axis=1)] = np.nan
    radius = np.where(np.isfinite(position[:, 0]), known_std(columns["horizontalAccuracy"]), np.nan)
    height = np.where(np.isfinite(position[:, 0]), known_std(columns["verticalAccuracy"]), np.nan)
    if moving.any():
        events.append(Event(code="I_VELOCITY_2D", count=int(moving.sum())))
    gnss = GnssData(
        time=columns["time"],
        velocity_ned=none_if_absent(velocity),
        velocity_std=np.column_stack((horizontal, horizontal, vertical)) if moving.any() else None,
        position_llh=none_if_absent(position),
        position_std=none_if_absent(np.column_stack((radius, radius, height))) if np.isfinite(position).any() else None,
        time_scale=UTC,
    )
    return gnss, tuple(events), left_out


READER: Final = Reader(name="sensor-logger", title="Sensor Logger (phone app)", sniff=sniff, read=read)
