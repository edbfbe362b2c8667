"""u-blox's UBX streams: GNSS of any receiver, and the IMU of those that fuse one (M8L, M8U, F9K, F9R).

GNSS comes from NAV-PVT, of older receivers from NAV-POSLLH, NAV-VELNED and NAV-SOL; NAV-HPPOSLLH refines the positions.
The IMU's readings come from ESF-RAW and ESF-MEAS: 24 bits with a sign, 2^-12 deg/s and 2^-10 m/s^2. ESF-INS is not
read: its accelerations are free of gravity, so that nothing can be levelled by them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import FloatArray
from levelhead.errors import LogError
from levelhead.events import Event
from levelhead.logs.datum import ELLIPSOIDAL, declared
from levelhead.logs.pieces import GnssData, ImuData, Pieces, Stream, none_if_absent
from levelhead.logs.readers.base import Reader, Source, choose
from levelhead.logs.readers.frames import Bytes, Places, Protocol, Scan, scan
from levelhead.logs.readers.receivers import dropped, held_height
from levelhead.logs.readers.ubx_esf import MEAS, RAW, assemble, readings_of, wheel_speed
from levelhead.logs.timescales import GPS_EPOCH_S, GPST, WEEK_S, continued

Structured = NDArray[np.void]

PVT: Final = 0x0107
POSLLH: Final = 0x0102
VELNED: Final = 0x0112
SOL: Final = 0x0106
HPPOSLLH: Final = 0x0114
INS: Final = 0x1015

_BASES: Final = {PVT: "NAV-PVT", POSLLH: "NAV-POSLLH", VELNED: "NAV-VELNED"}
"""The messages that make epochs, each taken only where those before it are absent."""


def _layout(size: int, *fields: tuple[str, str, int]) -> np.dtype[np.void]:
    """Return the layout of a payload: names, types and places of the fields that are used."""
    names, formats, offsets = zip(*fields, strict=True)
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": size})


_POSITION: Final = (("lon", "<i4", 0), ("lat", "<i4", 4), ("height", "<i4", 8))


def _position_at(offset: int) -> tuple[tuple[str, str, int], ...]:
    return tuple((name, kind, at + offset) for name, kind, at in _POSITION)


LAYOUTS: Final[dict[int, np.dtype[np.void]]] = {
    PVT: _layout(
        84,  # 92 since protocol 15
        ("itow", "<u4", 0),
        ("year", "<u2", 4),
        *((name, "u1", 6 + k) for k, name in enumerate(("month", "day", "hour", "minute", "second", "valid"))),
        ("nano", "<i4", 16),
        ("fix", "u1", 20),
        ("flags", "u1", 21),
        *_position_at(24),
        *((name, "<u4", 40 + 4 * k) for k, name in enumerate(("hacc", "vacc"))),
        *((name, "<i4", 48 + 4 * k) for k, name in enumerate(("vn", "ve", "vd"))),
        ("sacc", "<u4", 68),
        ("flags3", "u1", 78),
    ),
    POSLLH: _layout(28, ("itow", "<u4", 0), *_position_at(4), ("hacc", "<u4", 20), ("vacc", "<u4", 24)),
    VELNED: _layout(36, ("itow", "<u4", 0), ("vn", "<i4", 4), ("ve", "<i4", 8), ("vd", "<i4", 12), ("sacc", "<u4", 28)),
    SOL: _layout(
        52, ("itow", "<u4", 0), ("ftow", "<i4", 4), ("week", "<i2", 8), ("fix", "u1", 10), ("flags", "u1", 11)
    ),
    HPPOSLLH: _layout(
        36,
        ("flags", "u1", 3),
        ("itow", "<u4", 4),
        *_position_at(8),
        *((name, "i1", 24 + k) for k, name in enumerate(("lon_hp", "lat_hp", "height_hp"))),
        ("hacc", "<u4", 28),
        ("vacc", "<u4", 32),
    ),
}
"""Where the fields that are used lie in the payloads."""

_FIXES: Final = (2, 3, 4)
"""Fixes that are used: 2D, 3D, GNSS with dead reckoning; not used are none, dead reckoning alone, and time only."""
_HAS_TIME: Final = 0x03
"""Flags of NAV-PVT: date and time of day are valid."""
_SOL_HAS_TIME: Final = 0x0C
"""Flags of NAV-SOL: week and time of week are set."""
_FLAT: Final = 2
_FUSED: Final = 4
_LLH_UNITS: Final = np.array([np.radians(1e-7), np.radians(1e-7), 1e-3])
_UNKNOWN_M: Final = 1e5
"""Sigmas from here on (m, m/s) say that nothing is known; u-blox writes 2^32 - 1 mm."""


_AROUND: Final = 8
"""Bytes of a frame besides its payload: two of sync, class, identifier, two of length, and two of checksum behind."""


def find_frames(buffer: Bytes, limit: int) -> tuple[Places, Places]:
    """Return where the frames that begin before `limit` begin and end in a part of a stream."""
    marks = np.flatnonzero((buffer[:-1] == 0xB5) & (buffer[1:] == 0x62))
    marks = marks[(marks < limit) & (marks + _AROUND <= buffer.size)]
    if marks.size == 0:
        return marks, marks
    end = marks + _AROUND + buffer[marks + 4] + (buffer[marks + 5].astype(np.int64) << 8)
    marks, end = marks[end <= buffer.size], end[end <= buffer.size]
    # first[k] is the sum of the k bytes before k, second[k] the sum of first[1..k], both modulo 256 by overflow.
    first = np.zeros(buffer.size + 1, dtype=np.uint8)
    np.cumsum(buffer, dtype=np.uint8, out=first[1:])
    second = np.cumsum(first, dtype=np.uint8)
    begin, stop = marks + 2, end - 2
    ck_a = first[stop] - first[begin]
    ck_b = second[stop] - second[begin] - (stop - begin).astype(np.uint8) * first[begin]
    good = (ck_a == buffer[stop]) & (ck_b == buffer[stop + 1])
    marks, end = marks[good], end[good]
    if (marks[1:] >= end[:-1]).all():
        return marks, end
    # Where frames overlap, one is a piece of payload that looks like a frame: the one that began first is right.
    kept, last = [], 0
    for k, (mark, stop_at) in enumerate(zip(marks.tolist(), end.tolist(), strict=True)):
        if mark >= last:
            kept.append(k)
            last = stop_at
    return marks[kept], end[kept]


def _kinds(buffer: Bytes, start: Places) -> Places:
    """Return class and identifier of frames as one number."""
    return (buffer[start + 2].astype(np.int64) << 8) | buffer[start + 3]


UBX: Final = Protocol(find=find_frames, kinds=_kinds, header=6, trailer=2)


def sniff(_path: Path, head: bytes) -> bool:
    """Return whether the bytes hold frames with the right checksum: one at the very beginning, or two anywhere."""
    start, _ = find_frames(np.frombuffer(head, dtype=np.uint8), len(head))
    return start.size >= 2 or (start.size == 1 and int(start[0]) == 0)


def read(source: Source) -> Pieces:
    """Read a UBX stream; times become GPS time in seconds since 1970.

    Raises
    ------
    LogError
        When the file holds neither GNSS epochs nor IMU readings.
    """
    name = source.path.name
    found = scan(source.path, UBX, (*LAYOUTS, MEAS, RAW, INS))
    if found.count == 0:
        raise LogError(f"{name}: no UBX frame has the right checksum; the file is damaged or in another format.")
    events: list[Event] = []
    epochs = _epochs(found, events)
    imu, streams = None, [] if epochs is None else [epochs.stream]
    if source.role == "imu":
        imu, of_imu = _imu(source, found, epochs, events)
        streams = [*of_imu, *streams]
    if imu is None and epochs is None:
        raise LogError(
            f"{name} holds neither GNSS fixes nor IMU readings that can be used, in {found.count} UBX frames; record "
            f"NAV-PVT, and ESF-RAW or ESF-MEAS.{_why(events)}"
        )
    gnss = None if epochs is None else epochs.gnss
    return Pieces(
        imu=imu,
        gnss=gnss,
        left_out=found.left_out,
        damaged=found.damage(name, "UBX frames"),
        meta=declared(name, datum=None, height=ELLIPSOIDAL) if gnss is not None else {},
        events=tuple(events),
        streams=tuple(streams),
        undeclared=("axes", "clock") if imu is not None else (),
    )


def _why(events: list[Event]) -> str:
    details = " ".join(event.detail for event in events)
    return f" Left out: {details}" if details else ""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Epochs:
    """GNSS epochs with a fix: their places in the file, by which the IMU's clock is set, and what they say."""

    at: Places
    gnss: GnssData
    stream: Stream


@dataclass(frozen=True, kw_only=True, eq=False)
class _Rows:
    """Payloads of one message, zeros where `there` is false."""

    values: Structured
    there: NDArray[np.bool_]

    def metres(self, *names: str, unit: float) -> FloatArray:
        """Return fields in SI, NaN where there is no row."""
        table = np.column_stack([unit * self.values[n].astype(np.float64) for n in names])
        table[~self.there] = np.nan
        return table


def _payloads(found: Scan, message: int) -> tuple[Structured, Places]:
    """Return the payloads of a message as a structured array, and where their frames begin."""
    layout = LAYOUTS[message]
    rows, at = found.frames[message].rows(layout.itemsize)
    return np.ascontiguousarray(rows).view(layout).reshape(at.size), at


def _beside(found: Scan, message: int, at: Places, itow: NDArray[np.uint32]) -> _Rows:
    """Return for each epoch the message next to it in the file that has the same time of week."""
    rows, places = _payloads(found, message)
    values, there = np.zeros(at.size, dtype=LAYOUTS[message]), np.zeros(at.size, dtype=np.bool_)
    if rows.size:
        after = np.searchsorted(places, at)
        for neighbour in (after - 1, after):
            k = np.clip(neighbour, 0, rows.size - 1)
            same = ~there & (rows["itow"][k] == itow)
            values[same], there = rows[k[same]], there | same
    return _Rows(values=values, there=there)


def _epochs(found: Scan, events: list[Event]) -> _Epochs | None:
    """Return the GNSS epochs of NAV-PVT, else of what older receivers send; None where there are none with a fix."""
    message = next((m for m in _BASES if found.frames[m].at.size), PVT)
    base, at = _payloads(found, message)
    itow = base["itow"]
    if message == PVT:
        position = velocity = status = _Rows(values=base, there=np.ones(base.size, dtype=np.bool_))
        week_start = _week_of_date(base)
        dated = (base["valid"] & _HAS_TIME) == _HAS_TIME
        # Times of week are whole milliseconds; the date has what they leave off.
        finer = 1e-9 * (base["nano"] - 1e6 * np.round(1e-6 * base["nano"]))
    else:
        position, velocity, status = (_beside(found, m, at, itow) for m in (POSLLH, VELNED, SOL))
        week_start = WEEK_S * status.values["week"].astype(np.float64)
        dated = (status.values["flags"] & _SOL_HAS_TIME) == _SOL_HAS_TIME
        finer = 1e-9 * status.values["ftow"]
    time = continued(1e-3 * itow, week_start, dated, WEEK_S) + np.where(dated, finer, 0.0)
    fixed = np.isin(status.values["fix"], _FIXES) & ((status.values["flags"] & 1) > 0)
    of_sol = "" if message == PVT else " in NAV-SOL"
    events += dropped(int((~fixed).sum()), f"{_BASES[message]} messages without a fix{of_sol}")
    if not fixed.any():
        return None
    flat = status.values["fix"] == _FLAT
    llh, llh_std = _positions(position, _beside(found, HPPOSLLH, at, itow))
    ned, ned_std = _velocities(velocity, 1e-3 if message == PVT else 1e-2, flat)
    gnss = GnssData(
        time=time[fixed] + (GPS_EPOCH_S if dated.any() else 0.0),
        velocity_ned=none_if_absent(ned[fixed]),
        velocity_std=none_if_absent(ned_std[fixed]),
        position_llh=none_if_absent(llh[fixed]),
        position_std=none_if_absent(llh_std[fixed]),
        time_scale=GPST if dated.any() else None,
    )
    fused = int((status.values["fix"][fixed] == _FUSED).sum())
    note = f"{fused} fixes are the receiver's own fusion of GNSS with its sensors" if fused else ""
    stream = Stream(kind="gnss", name=_BASES[message], samples=int(fixed.sum()), note=note)
    return _Epochs(at=at[fixed], gnss=gnss, stream=stream)


def _week_of_date(pvt: Structured) -> FloatArray:
    """Return the beginnings of the GPS weeks that the dates lie in, s since 1980.

    The dates are UTC; a week's beginning is found by rounding, so that leap seconds play no part.
    """
    month = (pvt["year"].astype(np.int64) - 1970) * 12 + pvt["month"].astype(np.int64) - 1
    day = month.astype("datetime64[M]").astype("datetime64[D]").astype(np.int64) + pvt["day"].astype(np.int64) - 1
    clock = 3600.0 * pvt["hour"] + 60.0 * pvt["minute"] + pvt["second"]
    utc = 86400.0 * day + clock - GPS_EPOCH_S
    start: FloatArray = WEEK_S * np.round((utc - 1e-3 * pvt["itow"]) / WEEK_S)
    return start


def _positions(rows: _Rows, finer: _Rows) -> tuple[FloatArray, FloatArray]:
    """Return latitude, longitude (rad) and ellipsoidal height (m), and their sigmas (m)."""
    llh = rows.metres("lat", "lon", "height", unit=1.0) * _LLH_UNITS
    std = rows.metres("hacc", "hacc", "vacc", unit=1e-3)
    if "flags3" in (rows.values.dtype.names or ()):
        llh[(rows.values["flags3"] & 1) > 0] = np.nan
    better = finer.there & ((finer.values["flags"] & 1) == 0)
    more = finer.metres("lat", "lon", "height", unit=1.0) + finer.metres("lat_hp", "lon_hp", "height_hp", unit=1e-2)
    # The hundredths of a height are tenths of a millimetre.
    more[:, 2] = finer.values["height"] + 0.1 * finer.values["height_hp"]
    llh[better] = more[better] * _LLH_UNITS
    std[better] = finer.metres("hacc", "hacc", "vacc", unit=1e-4)[better]
    std[(std <= 0.0) | (std >= _UNKNOWN_M) | np.isnan(llh)] = np.nan
    return llh, std


def _velocities(rows: _Rows, unit: float, flat: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """Return velocities NED and their sigmas, m/s; of 2D fixes the vertical one is wide."""
    ned = rows.metres("vn", "ve", "vd", unit=unit)
    std = rows.metres("sacc", "sacc", "sacc", unit=unit)
    std = held_height(ned, std, flat)
    std[(std <= 0.0) | (std >= _UNKNOWN_M)] = np.nan
    return ned, std


def _imu(
    source: Source, found: Scan, epochs: _Epochs | None, events: list[Event]
) -> tuple[ImuData | None, list[Stream]]:
    """Return the chosen IMU's samples on the GNSS epochs' clock, and all IMUs in the file."""
    providers = readings_of(found.frames[RAW], found.frames[MEAS])
    if epochs is None:
        if providers:
            count = sum(readings.value.size for readings in providers)
            events += dropped(count, "sensor readings whose time no GNSS epoch in the file tells")
        return None, []
    made = {r.name: found_imu for r in providers if (found_imu := assemble(r, epochs.at, epochs.gnss.time)) is not None}
    streams = [Stream(kind="imu", name=n, samples=m.imu.time.size, note=m.note) for n, m in made.items()]
    stream = choose(streams, source.imu, name=source.path.name)
    if stream is None:
        events += dropped(found.frames[INS].at.size, "ESF-INS messages, whose accelerations are free of gravity")
        return None, []
    chosen = made[stream.name]
    events += dropped(chosen.unplaced, f"samples of {stream.name} whose time no fix tells")
    events += dropped(chosen.incomplete, f"readings of {stream.name} without the other axes, or repeated")
    speed = np.full(chosen.imu.time.size, np.nan)
    for readings in providers:
        told = wheel_speed(readings, epochs.at, epochs.gnss.time, chosen.imu.time)
        speed = np.where(np.isnan(speed), told, speed)
    return replace(chosen.imu, wheel_speed=none_if_absent(speed), time_scale=epochs.gnss.time_scale), streams


READER: Final = Reader(name="ublox-ubx", title="u-blox UBX", sniff=sniff, read=read)
