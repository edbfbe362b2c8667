"""VectorNav's ASCII messages as a terminal or a logger wrote them down: ``1751003243.12,$VNIMU,...*66``.

The messages with readings carry no time. So each line must begin with a stamp of the computer that logged it; without
one nothing can be said of when a reading was taken, and the log is refused.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import UNIT_FACTORS, FloatArray
from levelhead.errors import LogError
from levelhead.events import Event
from levelhead.logs.datum import ELLIPSOIDAL, declared
from levelhead.logs.pieces import GnssData, ImuData, Pieces, none_if_absent
from levelhead.logs.readers.base import Reader, Source
from levelhead.logs.readers.csv_table import is_text
from levelhead.logs.readers.receivers import dropped, known_std
from levelhead.logs.readers.stamps import GNSS_INTERVALS_S, IMU_INTERVALS_S, unit_of_stamps
from levelhead.logs.readers.vectornav import COMPENSATED

_LINE: Final = re.compile(
    rb"^([^$\r\n]*)\$VN([A-Z0-9]{3}),([^*$\r\n]*)\*([0-9A-F]{2}(?:[0-9A-F]{2})?|XX)\s*$", re.MULTILINE
)
_AROUND_STAMP: Final = b" \t,;:[]()"
_SNIFFED: Final = re.compile(rb"^[^$\r\n]*\$VN(?:IMU|MAR|YMR|QMR|GPS|G2S|INS|YPR|RRG),", re.MULTILINE)

_ADDED: Final = re.compile(rb"(?:,[A-Z][0-9A-F]+)+$")

_MESSAGES: Final = {"54": "IMU", "20": "MAR", "27": "YMR", "15": "QMR", "58": "GPS"}
"""The same measurements as answers to a request, ``$VNRRG,54,...``, by register."""
_READINGS: Final = {"IMU": (3, True), "MAR": (3, False), "YMR": (6, False), "QMR": (7, False)}
"""Where the acceleration begins, with the angular rate behind it, and whether they are free of the filter's biases."""
_FIXES: Final = ("GPS", "G2S")
_FIX, _LLH, _VELOCITY, _POSITION_STD, _VELOCITY_STD = 2, 4, 7, 10, 13
_LOWEST_FIX: Final = 2
_FIELDS: Final = {"IMU": 11, "MAR": 9, "YMR": 12, "QMR": 13, "GPS": 15, "G2S": 15}


@dataclass(frozen=True, kw_only=True, eq=False)
class _Messages:
    """Messages of one kind: stamps as they stand, and fields (n, k)."""

    stamps: FloatArray
    fields: FloatArray


def sniff(_path: Path, head: bytes) -> bool:
    """Return whether the text has VectorNav's messages in its first lines."""
    return is_text(head) and _SNIFFED.search(head) is not None


def read(source: Source) -> Pieces:
    """Read the readings, uncompensated where there are such, and the receiver's fixes.

    Raises
    ------
    LogError
        Where the lines have no stamps, or no message with readings or fixes is whole.
    """
    path = source.path
    content = path.read_bytes()
    kinds, bad = _collect(content)
    last = content[content.rfind(b"\n") + 1 :]
    cut = int(bool(last) and _LINE.search(last) is None)
    imu_kind = next((k for k in _READINGS if k in kinds), None) if source.role == "imu" else None
    fix_kind = next((k for k in _FIXES if k in kinds), None)
    if imu_kind is None and fix_kind is None:
        raise LogError(
            f"{path.name} has no whole $VNIMU, $VNYMR, $VNMAR or $VNQMR message and no $VNGPS; let the sensor send "
            "them."
        )
    reference = kinds[imu_kind or fix_kind or ""]
    if np.isnan(reference.stamps).mean() > 0.5:
        raise LogError(
            f"{path.name}: the messages carry no time, and no stamp stands before them; let the logger write one "
            "before each line, or record the sensor's binary output with TimeStartup and export it as CSV."
        )
    limits = IMU_INTERVALS_S if imu_kind is not None else GNSS_INTERVALS_S
    factor = UNIT_FACTORS["s"][unit_of_stamps(f"{path.name}, stamps before the messages", reference.stamps, limits)]
    imu = None
    if imu_kind is not None:
        first = _READINGS[imu_kind][0]
        found = kinds[imu_kind]
        accel, gyro = found.fields[:, first : first + 3], found.fields[:, first + 3 : first + 6]
        imu = ImuData(time=found.stamps * factor, gyro=gyro, accel=accel)
    gnss, events = (None, ()) if fix_kind is None else _fixes(kinds[fix_kind], factor)
    damaged = bad - (cut and last.count(b"$VN"))
    return Pieces(
        imu=imu,
        gnss=gnss,
        left_out=cut,
        damaged=f"{path.name}: {damaged} messages have a wrong checksum or are not whole." if damaged else "",
        events=events,
        compensated=COMPENSATED if imu_kind is not None and not _READINGS[imu_kind][1] else "",
        undeclared=("clock",),
        meta=declared(path.name, datum=None, height=ELLIPSOIDAL) if gnss is not None else {},
    )


def _collect(content: bytes) -> tuple[dict[str, _Messages], int]:
    """Return the whole messages by kind, and how many begun ones are not whole."""
    found = list(_LINE.finditer(content))
    whole = _checked(content, found)
    payloads: dict[str, list[bytes]] = {}
    stamps: dict[str, list[bytes]] = {}
    bad = content.count(b"$VN") - int(whole.sum())
    for match, good in zip(found, whole.tolist(), strict=True):
        before, name, payload, _ = match.groups()
        if not good:
            continue
        kind = name.decode()
        if kind == "RRG":
            register, _, payload = payload.partition(b",")
            kind = _MESSAGES.get(register.strip().lstrip(b"0").decode(errors="replace"), "")
        if kind not in _FIELDS:
            continue
        if payload.count(b",") + 1 != _FIELDS[kind]:
            # The sensor can be told to add counters or the time since an event, marked by a letter.
            payload = _ADDED.sub(b"", payload)
            if payload.count(b",") + 1 != _FIELDS[kind]:
                bad += bool(payload)
                continue
        payloads.setdefault(kind, []).append(payload)
        stamps.setdefault(kind, []).append(before.strip(_AROUND_STAMP))
    kinds = {}
    for kind, texts in payloads.items():
        fields = _floats(texts, _FIELDS[kind])
        good_rows = np.asarray(np.isfinite(fields).all(axis=1), dtype=np.bool_)
        bad += int((~good_rows).sum())
        if good_rows.any():
            kinds[kind] = _Messages(stamps=_floats(stamps[kind], 1)[good_rows, 0], fields=fields[good_rows])
    return kinds, bad


def _checked(content: bytes, found: Sequence[re.Match[bytes]]) -> NDArray[np.bool_]:
    """Return which messages have the checksum that they say, the exclusive or of all bytes between $ and *.

    One of 16 bits, and XX in the place of one, are not checked.
    """
    if not found:
        return np.zeros(0, dtype=np.bool_)
    running = np.bitwise_xor.accumulate(np.frombuffer(content, dtype=np.uint8))
    dollar = np.array([match.start(2) for match in found]) - len("$VN")
    star = np.array([match.end(3) for match in found])
    said = [match.group(4) for match in found]
    short = np.array([len(text) == 2 and text != b"XX" for text in said])
    wanted = np.array([int(text, 16) if check else 0 for text, check in zip(said, short.tolist(), strict=True)])
    right: NDArray[np.bool_] = ~short | ((running[star - 1] ^ running[dollar]) == wanted)
    return right


def _floats(texts: Sequence[bytes], width: int) -> FloatArray:
    """Return comma-separated texts as numbers (n, width); NaN where a text has anything else."""
    try:
        return np.array(b",".join(texts).split(b","), dtype=np.float64).reshape(-1, width)
    except ValueError:
        rows = []
        for text in texts:
            try:
                row = [float(cell) for cell in text.split(b",")]
            except ValueError:
                row = []
            rows.append(row if len(row) == width else [np.nan] * width)
        return np.array(rows)


def _fixes(found: _Messages, factor: float) -> tuple[GnssData | None, tuple[Event, ...]]:
    good = found.fields[:, _FIX] >= _LOWEST_FIX
    lost = int((~good).sum())
    events = dropped(lost, "GNSS messages without a fix")
    if not good.any():
        return None, events
    rows = found.fields[good]
    llh, sigma = rows[:, _LLH : _LLH + 3], rows[:, _POSITION_STD : _POSITION_STD + 3]
    speed = rows[:, _VELOCITY_STD]
    gnss = GnssData(
        time=found.stamps[good] * factor,
        velocity_ned=rows[:, _VELOCITY : _VELOCITY + 3],
        velocity_std=none_if_absent(known_std(speed)),
        position_llh=np.column_stack((np.radians(llh[:, :2]), llh[:, 2])),
        position_std=none_if_absent(known_std(sigma)),
    )
    return gnss, events


READER: Final = Reader(name="vectornav-ascii", title="VectorNav ASCII messages", sniff=sniff, read=read)
