"""Septentrio's SBF streams: GNSS of PVTGeodetic with its covariances, and the IMU of INS receivers (ExtSensorMeas).

A block is ``$@``, a CRC, its number and revision, its length, then the time of week and the week in GPS time. Both
clocks are the receiver's. The IMU's axes are those printed on the device, however it is mounted.
"""

from __future__ import annotations

from binascii import crc_hqx
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import FloatArray
from levelhead.errors import LogError
from levelhead.events import Event
from levelhead.logs.datum import ELLIPSOIDAL, WGS84, declared
from levelhead.logs.pieces import GnssData, ImuData, Pieces, Stream, none_if_absent
from levelhead.logs.readers.base import Reader, Source, choose
from levelhead.logs.readers.frames import Bytes, Frames, Places, Protocol, Scan, scan
from levelhead.logs.readers.receivers import dropped, held_height, known_std
from levelhead.logs.timescales import GPS_EPOCH_S, GPST, WEEK_S

Structured = NDArray[np.void]

PVT: Final = 4007
POSITION_COV: Final = 5906
VELOCITY_COV: Final = 5908
EXT_SENSOR: Final = 4050

_HEAD: Final = 8
_WASTE: Final = 64
"""Bytes checked in vain for each byte of a file until long blocks are no longer believed in: a file made of false
headers must not take for ever."""
_SHORT: Final = 512


def _layout(size: int, *fields: tuple[str, str, int]) -> np.dtype[np.void]:
    """Return the layout of a block behind its first 8 bytes: names, types and places of the fields that are used."""
    stamped = (("tow", "<u4", 0), ("week", "<u2", 4), ("mode", "u1", 6), ("error", "u1", 7), *fields)
    names, formats, offsets = zip(*stamped, strict=True)
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": size})


LAYOUTS: Final[dict[int, np.dtype[np.void]]] = {
    PVT: _layout(
        72,
        *((name, "<f8", 8 + 8 * k) for k, name in enumerate(("lat", "lon", "height"))),
        *((name, "<f4", 36 + 4 * k) for k, name in enumerate(("vn", "ve", "vu"))),
        ("datum", "u1", 65),
    ),
    POSITION_COV: _layout(48, *((name, "<f4", 8 + 4 * k) for k, name in enumerate(("n", "e", "u")))),
    VELOCITY_COV: _layout(48, *((name, "<f4", 8 + 4 * k) for k, name in enumerate(("n", "e", "u")))),
}
"""Where the fields that are used lie; the covariances are in m^2 and m^2/s^2, of latitude, longitude and height."""

_SET: Final = np.dtype(
    {"names": ("source", "kind", "info", "xyz"), "formats": ("u1", "u1", "u1", ("<f8", 3)), "offsets": (0, 2, 3, 4),
     "itemsize": 28}
)  # fmt: skip
"""One measurement of ExtSensorMeas."""
_ACCELERATION: Final = 0
_ANGULAR_RATE: Final = 1
_UNUSABLE: Final = 0b110
"""Flags of a measurement: the sensor is saturated, the values are scrambled for want of a permission."""

_NO_TOW: Final = 0xFFFFFFFF
_NO_WEEK: Final = 0xFFFF
_ABSENT: Final = 1e9
"""Numbers of this size say that there is none; Septentrio writes -2e10."""
_FIXES: Final = (1, 2, 4, 5, 6, 7, 8, 10)
"""Kinds of solution that are measured positions: not "none", and not 3, a location that was entered."""
_FLAT: Final = 0x80
"""Mode: the height was held."""
_DATUMS: Final = {
    0: WGS84,
    30: "ETRS89",
    31: "NAD83(2011)",
    32: "NAD83(PA11)",
    33: "NAD83(MA11)",
    34: "GDA94",
    35: "GDA2020",
    36: "JGD2011",
    250: "the first user-defined one",
    251: "the second user-defined one",
}
"""Datums by their number."""
_BASE_DATUM: Final = 19
"""That of the base station, which the stream does not name."""


def find_blocks(buffer: Bytes, limit: int) -> tuple[Places, Places]:
    """Return where the blocks that begin before `limit` begin and end in a part of a stream."""
    content = buffer.tobytes()
    start, end = [], []
    at, wasted, longest = content.find(b"$@"), 0, len(content)
    while 0 <= at < limit:
        size = int.from_bytes(content[at + 6 : at + 8], "little")
        if _HEAD + 6 <= size <= longest and size % 4 == 0 and at + size <= len(content):
            if crc_hqx(content[at + 4 : at + size], 0) == int.from_bytes(content[at + 2 : at + 4], "little"):
                start.append(at)
                at += size
                end.append(at)
                at = content.find(b"$@", at)
                continue
            wasted += size
            if wasted > _WASTE * len(content):
                longest = _SHORT
        at = content.find(b"$@", at + 1)
    return np.array(start, dtype=np.int64), np.array(end, dtype=np.int64)


def _kinds(buffer: Bytes, start: Places) -> Places:
    """Return the numbers of blocks, without their revisions."""
    return buffer[start + 4] | ((buffer[start + 5].astype(np.int64) & 0x1F) << 8)


SBF: Final = Protocol(find=find_blocks, kinds=_kinds, header=_HEAD, trailer=0)


def sniff(_path: Path, head: bytes) -> bool:
    """Return whether the bytes hold blocks with the right CRC: one at the very beginning, or two anywhere."""
    start, _ = find_blocks(np.frombuffer(head, dtype=np.uint8), len(head))
    return start.size >= 2 or (start.size == 1 and int(start[0]) == 0)


def read(source: Source) -> Pieces:
    """Read an SBF stream; times become GPS time in seconds since 1970.

    Raises
    ------
    LogError
        When the file holds neither GNSS positions nor IMU readings, or positions in another datum.
    """
    name = source.path.name
    found = scan(source.path, SBF, (*LAYOUTS, EXT_SENSOR))
    if found.count == 0:
        raise LogError(f"{name}: no SBF block has the right CRC; the file is damaged or in another format.")
    events: list[Event] = []
    gnss, datum = _gnss(name, found, events)
    imu, streams = _imu(source, found.frames[EXT_SENSOR], events) if source.role == "imu" else (None, [])
    if imu is None and gnss is None:
        details = " ".join(event.detail for event in events)
        raise LogError(
            f"{name} holds neither GNSS fixes nor IMU readings that can be used, in {found.count} SBF blocks; record "
            f"PVTGeodetic and ExtSensorMeas.{f' Left out: {details}' if details else ''}"
        )
    if gnss is not None:
        streams.append(Stream(kind="gnss", name="PVTGeodetic", samples=gnss.time.size))
    return Pieces(
        imu=imu,
        gnss=gnss,
        left_out=found.left_out,
        damaged=found.damage(name, "SBF blocks"),
        meta={} if gnss is None else declared(name, datum=datum, height=ELLIPSOIDAL),
        events=tuple(events),
        streams=tuple(streams),
        undeclared=("axes",) if imu is not None else (),
    )


def _blocks(found: Scan, number: int) -> tuple[Structured, NDArray[np.int64]]:
    """Return blocks that have a time, and that time in ms since 1980."""
    layout = LAYOUTS[number]
    rows, at = found.frames[number].rows(layout.itemsize)
    blocks = np.ascontiguousarray(rows).view(layout).reshape(at.size)
    blocks = blocks[(blocks["tow"] != _NO_TOW) & (blocks["week"] != _NO_WEEK)]
    return blocks, _instants(blocks["tow"], blocks["week"])


def _instants(tow: NDArray[np.uint32], week: NDArray[np.uint16]) -> NDArray[np.int64]:
    return tow.astype(np.int64) + week.astype(np.int64) * round(1e3 * WEEK_S)


def _seconds(instants: NDArray[np.int64]) -> FloatArray:
    return GPS_EPOCH_S + 1e-3 * instants.astype(np.float64)


def _table(blocks: Structured, *names: str) -> FloatArray:
    """Return fields as columns, NaN where the receiver has no value."""
    table = np.column_stack([blocks[n].astype(np.float64) for n in names])
    return np.where(np.abs(table) < _ABSENT, table, np.nan)


def _gnss(name: str, found: Scan, events: list[Event]) -> tuple[GnssData | None, str | None]:
    """Return the epochs with a solution, and the datum of their positions."""
    pvt, instants = _blocks(found, PVT)
    fixed = np.isin(pvt["mode"] & 0x0F, _FIXES) & (pvt["error"] == 0)
    events += dropped(found.frames[PVT].at.size - int(fixed.sum()), "PVTGeodetic blocks without a solution")
    if not fixed.any():
        return None, None
    pvt, instants = pvt[fixed], instants[fixed]
    numbers = np.unique(pvt["datum"])
    if numbers.size > 1:
        raise LogError(
            f"{name}: the datum of the positions changes (numbers {', '.join(map(str, numbers))}); cut the log there."
        )
    ned = _table(pvt, "vn", "ve", "vu") * (1.0, 1.0, -1.0)
    ned[np.isnan(ned).any(axis=1)] = np.nan
    ned_std = held_height(ned, _deviations(found, VELOCITY_COV, instants), (pvt["mode"] & _FLAT) > 0)
    llh = _table(pvt, "lat", "lon", "height")
    llh[np.isnan(llh).any(axis=1)] = np.nan
    llh_std = np.where(np.isnan(llh), np.nan, _deviations(found, POSITION_COV, instants))
    gnss = GnssData(
        time=_seconds(instants),
        velocity_ned=none_if_absent(ned),
        velocity_std=none_if_absent(ned_std),
        position_llh=none_if_absent(llh),
        position_std=none_if_absent(llh_std),
        time_scale=GPST,
    )
    number = int(numbers[0])
    return gnss, None if number == _BASE_DATUM else _DATUMS.get(number, f"number {number}")


def _deviations(found: Scan, number: int, instants: NDArray[np.int64]) -> FloatArray:
    """Return the sigmas that the covariances of the same instants tell; NaN where there are none."""
    std = np.full((instants.size, 3), np.nan)
    blocks, told = _blocks(found, number)
    if blocks.size:
        unique, first = np.unique(told, return_index=True)
        near = np.clip(np.searchsorted(unique, instants), 0, unique.size - 1)
        same = (unique[near] == instants) & (blocks["error"][first[near]] == 0)
        variance = _table(blocks[first[near[same]]], "n", "e", "u")
        std[same] = np.sqrt(known_std(variance))
    return std


@dataclass(frozen=True, kw_only=True, eq=False)
class _Measured:
    """All measurements of ExtSensorMeas with the instants of their blocks, ms since 1980."""

    sets: Structured
    instants: NDArray[np.int64]


def _measured(frames: Frames) -> _Measured:
    head, _ = frames.rows(8)
    kept = frames.length >= 8
    frames = Frames(at=frames.at[kept], start=frames.start[kept], length=frames.length[kept], data=frames.data)
    size = np.maximum(head[:, 7].astype(np.int64), 1)
    # A block cannot hold more measurements than its length has room for, whatever it says.
    count = np.minimum(head[:, 6], (frames.length - 8) // size) * (size >= _SET.itemsize)
    block = np.repeat(np.arange(count.size), count)
    ramp = np.arange(block.size) - np.repeat(np.cumsum(count) - count, count)
    begin = frames.start[block] + 8 + ramp * size[block]
    rows = frames.data[begin[:, np.newaxis] + np.arange(_SET.itemsize)]
    tow = np.ascontiguousarray(head[:, :4]).view("<u4").reshape(count.size)
    week = np.ascontiguousarray(head[:, 4:6]).view("<u2").reshape(count.size)
    known = ((tow != _NO_TOW) & (week != _NO_WEEK))[block]
    sets = np.ascontiguousarray(rows).view(_SET).reshape(block.size)
    return _Measured(sets=sets[known], instants=_instants(tow, week)[block][known])


def _imu(source: Source, frames: Frames, events: list[Event]) -> tuple[ImuData | None, list[Stream]]:
    """Return the chosen sensor's samples, and all sensors."""
    measured = _measured(frames)
    used = np.isin(measured.sets["kind"], (_ACCELERATION, _ANGULAR_RATE))
    sets, instants = measured.sets[used], measured.instants[used]
    values = np.where(np.abs(sets["xyz"]) < _ABSENT, sets["xyz"], np.nan)
    good = ((sets["info"] & _UNUSABLE) == 0) & np.isfinite(values).all(axis=1)
    events += dropped(int((~good).sum()), "measurements of ExtSensorMeas that are saturated, scrambled or absent")
    sensors = np.unique(sets["source"][good])
    made = {}
    for number in sensors.tolist():
        name = "ExtSensorMeas" if sensors.size == 1 else f"ExtSensorMeas-{number}"
        mine = good & (sets["source"] == number)
        made[name] = _samples(sets["kind"][mine], values[mine], instants[mine])
    streams = [Stream(kind="imu", name=name, samples=imu.time.size) for name, (imu, _) in made.items()]
    stream = choose(streams, source.imu, name=source.path.name)
    if stream is None:
        return None, []
    imu, alone = made[stream.name]
    events += dropped(alone, f"measurements of {stream.name} without the other kind of the same time, or repeated")
    return (imu, streams) if imu.time.size > 1 else (None, [])


def _samples(kind: NDArray[np.uint8], values: FloatArray, instants: NDArray[np.int64]) -> tuple[ImuData, int]:
    """Return the samples of the instants that have both a rate and an acceleration, and how many have not."""
    rate, force = np.flatnonzero(kind == _ANGULAR_RATE), np.flatnonzero(kind == _ACCELERATION)
    common, first, second = np.intersect1d(instants[rate], instants[force], return_indices=True)
    imu = ImuData(
        time=_seconds(common),
        gyro=np.radians(values[rate[first]]),
        accel=values[force[second]],
        time_scale=GPST,
    )
    return imu, kind.size - 2 * common.size


READER: Final = Reader(name="septentrio-sbf", title="Septentrio SBF", sniff=sniff, read=read)
