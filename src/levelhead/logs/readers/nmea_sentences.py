"""Sentences of NMEA 0183 out of a file: checksums verified, fields turned into numbers, everything else counted."""

from __future__ import annotations

import datetime as dt
import math
import re
from array import array
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np

from levelhead.conventions import FloatArray

_LINE: Final = re.compile(rb"([^\n$]*)\$([^$*\n]*)\*([0-9A-Fa-f]{2})[ \t\r\0]*(?:\n|\Z)|([^\n]*)(?:\n|\Z)")
"""A line with one sentence: what stands before it, its text, its checksum; or any other line."""
_CHUNK: Final = 1 << 24
"""Bytes that are read at once."""
_STAMP: Final = re.compile(rb"\s*[\[(]?(\d{4}-\d\d-\d\d)[T ](\d\d):(\d\d)|\s*(\d{10}(?:\.\d*)?|\d{13})[\s,;:]")
"""A computer's clock before a sentence: a date, or seconds or milliseconds since 1970."""

KNOT: Final = 1852.0 / 3600.0
DAY_S: Final = 86400.0
_NO_FIX_MODES: Final = (b"N", b"E", b"M")
"""Modes of RMC that are no GNSS fix: none, dead reckoning, entered by hand."""


class FieldError(Exception):
    """A field of a sentence with the right checksum holds something else than it should."""


def number(field: bytes) -> float:
    """Return a number, NaN for an empty field."""
    if not field:
        return math.nan
    try:
        value = float(field)
    except ValueError:
        raise FieldError from None
    return value if math.isfinite(value) else math.nan


def clock(field: bytes) -> float:
    """Return the second of the day of ``hhmmss.sss``."""
    if not field:
        return math.nan
    try:
        hour, minute, second = int(field[:2]), int(field[2:4]), float(field[4:])
    except ValueError:
        raise FieldError from None
    if not (0 <= hour < 24 and 0 <= minute < 60 and 0.0 <= second < 61.0):
        raise FieldError
    return 3600.0 * hour + 60.0 * minute + second


def angle(field: bytes, side: bytes, limit: float) -> float:
    """Return radians of degrees and minutes, ``dddmm.mmmm``, with the side of the equator or of Greenwich."""
    if not field:
        return math.nan
    split = max(len(field.partition(b".")[0]) - 2, 0)
    try:
        degrees, minutes = int(field[:split] or b"0"), float(field[split:])
    except ValueError:
        raise FieldError from None
    value = degrees + minutes / 60.0
    if side not in (b"N", b"S", b"E", b"W") or not 0.0 <= minutes < 60.0 or not 0.0 <= value <= limit:
        raise FieldError
    return math.radians(-value if side in (b"S", b"W") else value)


@lru_cache(maxsize=64)
def day_number(day: bytes, month: bytes, year: bytes) -> float:
    """Return days since 1970, NaN for what is no date; of years with two digits those from 80 on are of the 1900s."""
    try:
        full, of_year, of_month = int(year), int(month), int(day)
    except ValueError:
        raise FieldError from None
    full += (1900 if full >= 80 else 2000) if len(year) <= 2 else 0
    try:
        return float((dt.date(full, of_year, of_month) - dt.date(1970, 1, 1)).days)
    except (ValueError, OverflowError):
        # A receiver that knows no date may write 000000.
        return math.nan


def _gga(f: Sequence[bytes]) -> tuple[float, ...]:
    return clock(f[1]), angle(f[2], f[3], 90.0), angle(f[4], f[5], 180.0), number(f[9]), number(f[11]), number(f[6])


def _rmc(f: Sequence[bytes]) -> tuple[float, ...]:
    day = day_number(f[9][:2], f[9][2:4], f[9][4:]) if f[9] else math.nan
    valid = f[2] == b"A" and f[12] not in _NO_FIX_MODES
    return clock(f[1]), day, float(valid), number(f[7]) * KNOT, math.radians(number(f[8]))


def _vtg(f: Sequence[bytes]) -> tuple[float, ...]:
    speed = number(f[5]) * KNOT if f[5] else number(f[7]) / 3.6
    return speed, math.radians(number(f[1]))


def _gst(f: Sequence[bytes]) -> tuple[float, ...]:
    return clock(f[1]), number(f[6]), number(f[7]), number(f[8])


def _zda(f: Sequence[bytes]) -> tuple[float, ...]:
    return clock(f[1]), day_number(f[2], f[3], f[4]) if f[2] and f[3] and f[4] else math.nan


_KINDS: Final[dict[bytes, tuple[Callable[[Sequence[bytes]], tuple[float, ...]], int]]] = {
    b"GGA": (_gga, 6),
    b"RMC": (_rmc, 5),
    b"VTG": (_vtg, 2),
    b"GST": (_gst, 4),
    b"ZDA": (_zda, 2),
}
"""What is read, and how many numbers it gives: time of day, latitude, longitude, altitude, separation, quality; time of
day, day, valid, speed, course; speed, course; time of day, three sigmas; time of day, day. Seconds, radians, metres."""
_FIELDS: Final = 13
_EMPTY: Final = [b""] * _FIELDS


class Sentences:
    """The numbers of all sentences of a file by their kind, and what else is in it.

    Attributes
    ----------
    datum : str or None
        What DTM says of the datum.
    damaged : int
        Lines with a ``$`` or ``*`` that are no sentence with the right checksum, or whose fields are not what they
        should be; `first_damaged` is the first of them, counted from 1.
    odd : int
        Other lines that are not empty.
    left_out : int
        Cut lines at the start and the end of the file.
    """

    def __init__(self) -> None:
        self._numbers = {kind: array("d") for kind in _KINDS}
        self._host = array("d")
        self.datum: str | None = None
        self.sentences = 0
        self.damaged = 0
        self.first_damaged = 0
        self.odd = 0
        self.left_out = 0
        self._line = 0

    def of(self, kind: bytes) -> FloatArray:
        """Return the line and the numbers of each sentence of a kind, shape (n, 1 + numbers)."""
        return np.array(self._numbers[kind], dtype=np.float64).reshape(-1, _KINDS[kind][1] + 1)

    @property
    def host_days(self) -> FloatArray:
        """Lines, and the days since 1970 that a computer's clock wrote before their sentences, (n, 2)."""
        return np.array(self._host, dtype=np.float64).reshape(-1, 2)

    def take(self, content: bytes, *, last: bool) -> None:
        """Take the sentences out of whole lines."""
        running = np.bitwise_xor.accumulate(np.frombuffer(b"\0" + content, dtype=np.uint8)).tobytes()
        for match in _LINE.finditer(content):
            if match.start() == len(content):
                return
            self._line += 1
            before, text, told, other = match.groups()
            if other is not None:
                self._other(other, cut=self._line == 1 or (last and match.end() == len(content)))
            elif running[match.end(2)] ^ running[match.start(2)] != int(told, 16) or not self._sentence(before, text):
                self._hurt(cut=self._line == 1 or (last and match.end() == len(content) and content[-1:] != b"\n"))

    def _sentence(self, before: bytes, text: bytes) -> bool:
        """Keep what is read of a sentence; return whether its fields are what they should be."""
        self.sentences += 1
        kind = text[2:5]
        if kind == b"DTM" and text[5:6] == b",":
            self.datum = text[6:].partition(b",")[0].decode("ascii", errors="replace")
        if kind not in _KINDS or text[5:6] != b",":
            return True
        parse, _ = _KINDS[kind]
        try:
            numbers = parse(text.split(b",") + _EMPTY)
        except FieldError:
            return False
        self._numbers[kind].append(self._line)
        self._numbers[kind].extend(numbers)
        stamp = _STAMP.match(before) if before else None
        if stamp is not None:
            self._host.extend((self._line, _host_day(stamp)))
        return True

    def _other(self, line: bytes, *, cut: bool) -> None:
        line = line.strip(b" \t\r\0")
        if not line or line.startswith((b"#", b"!")):
            return
        if b"$" in line or b"*" in line or cut:
            self._hurt(cut=cut)
        else:
            self.odd += 1

    def _hurt(self, *, cut: bool) -> None:
        if cut:
            self.left_out += 1
            return
        self.damaged += 1
        self.first_damaged = self.first_damaged or self._line


def _host_day(stamp: re.Match[bytes]) -> float:
    """Return days since 1970 with their fraction, on the computer's own clock."""
    date, hour, minute, seconds = stamp.groups()
    if date is not None:
        try:
            day = dt.date.fromisoformat(date.decode())
        except ValueError:
            return math.nan
        return (day - dt.date(1970, 1, 1)).days + int(hour) / 24.0 + int(minute) / 1440.0
    value = float(seconds)
    return (value * 1e-3 if value > 1e11 else value) / DAY_S


def scan(path: Path) -> Sentences:
    """Read all sentences of a file."""
    found = Sentences()
    kept = b""
    with path.open("rb") as file:
        while more := file.read(_CHUNK):
            content = kept + more
            end = content.rfind(b"\n") + 1
            if end == 0 and len(content) > 4 * _CHUNK:
                end = len(content)  # This is no text; it is counted as one line.
            found.take(content[:end], last=False)
            kept = content[end:]
    # The last line may lack its end: it is held back, so that it is seen as the last.
    found.take(kept, last=True)
    return found


def checksum(text: bytes) -> int:
    """Return the checksum of what stands between ``$`` and ``*``."""
    return int(np.bitwise_xor.reduce(np.frombuffer(text, dtype=np.uint8))) if text else 0
