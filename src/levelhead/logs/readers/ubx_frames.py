"""Frames of u-blox's UBX protocol out of a stream that may hold NMEA sentences and RTCM messages besides.

A frame is ``b5 62``, class, identifier, length (two bytes, little-endian), payload, and two checksum bytes (Fletcher's
sums modulo 256 over all from the class to the end of the payload). Both sums of any stretch follow from running sums
over the whole buffer, so that every place that could be a frame is checked at once; what passes is a frame, and a
damaged one hides nothing behind it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Places = NDArray[np.int64]
Message = tuple[int, int]
"""Class and identifier."""

_AROUND: Final = 8
"""Bytes of a frame besides its payload."""
_LONGEST: Final = 65535 + _AROUND
_CHUNK: Final = 1 << 24
"""Bytes that are read at once: memory stays flat however long the file is."""

_NMEA: Final = re.compile(rb"[$!][\x20-\x7e]{3,250}\r?\n")
_PADDING: Final = re.compile(rb"[\r\n\0\xff]+")
"""Line ends, and what a receiver sends on I2C and SPI while it has nothing to say."""
_RTCM_LONGEST: Final = 1023 + 6
_NEXT: Final = re.compile(rb"[$!\xd3]")


@dataclass(eq=False)
class Frames:
    """All frames of one message, in the order of the file.

    Attributes
    ----------
    at : (n,) int64
        Where each begins in the file, bytes.
    start, length : (n,) int64
        Where its payload lies in `data`.
    data : (k,) uint8
        The payloads, one behind the other.
    """

    at: Places
    start: Places
    length: Places
    data: Bytes

    def rows(self, size: int) -> tuple[Bytes, Places]:
        """Return the first `size` bytes of all payloads that have them, and the places of these frames in the file."""
        enough = self.length >= size
        return self.data[self.start[enough][:, np.newaxis] + np.arange(size)], self.at[enough]


@dataclass
class Scan:
    """What a file holds: the wanted frames, how many there are in all, and what is neither frame nor NMEA nor RTCM."""

    frames: dict[Message, Frames]
    count: int = 0
    damaged_bytes: int = 0
    damaged_places: int = 0
    cut_start: bool = False
    cut_end: bool = False


@dataclass
class _Gathered:
    """Frames of one message as they come in."""

    at: list[Places] = field(default_factory=list)
    length: list[Places] = field(default_factory=list)
    data: list[Bytes] = field(default_factory=list)

    def joined(self) -> Frames:
        none = np.zeros(0, dtype=np.int64)
        length = np.concatenate([none, *self.length])
        start = np.concatenate(([0], np.cumsum(length)[:-1])) if length.size else none
        data = np.concatenate([np.zeros(0, dtype=np.uint8), *self.data])
        return Frames(at=np.concatenate([none, *self.at]), start=start.astype(np.int64), length=length, data=data)


def find(buffer: Bytes, limit: int) -> tuple[Places, Places]:
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


def scan(path: Path, wanted: Sequence[Message]) -> Scan:
    """Read a file and keep the payloads of the wanted messages."""
    gathered: dict[Message, _Gathered] = {message: _Gathered() for message in wanted}
    stream = Scan(frames={})
    between = _Between()
    for base, buffer, limit, last in _parts(path, between):
        start, end = find(buffer, limit)
        _gather(gathered, buffer, start, end, base)
        stream.count += start.size
        between.walk(buffer.tobytes(), base, start.tolist(), end.tolist(), limit, last=last)
    stream.frames = {message: parts.joined() for message, parts in gathered.items()}
    between.close(stream)
    return stream


def _parts(path: Path, between: _Between) -> Iterator[tuple[int, Bytes, int, bool]]:
    """Yield parts of the file: its first byte's place, the bytes, where frames may begin, and whether it is the last.

    A part begins where `between` stands, so that no frame and no sentence is cut.
    """
    with path.open("rb") as file:
        base, kept = 0, b""
        while True:
            more = file.read(_CHUNK)
            content = kept + more
            last = len(more) < _CHUNK
            limit = len(content) if last else len(content) - _LONGEST
            yield base, np.frombuffer(content, dtype=np.uint8), limit, last
            if last:
                return
            step = between.seen - base
            base, kept = base + step, content[step:]


def _gather(gathered: dict[Message, _Gathered], buffer: Bytes, start: Places, end: Places, base: int) -> None:
    kind, number = buffer[start + 2], buffer[start + 3]
    for message, parts in gathered.items():
        mine = (kind == message[0]) & (number == message[1])
        if not mine.any():
            continue
        begin, length = start[mine] + 6, (end - start)[mine] - _AROUND
        ramp = np.arange(length.sum()) - np.repeat(np.cumsum(length) - length, length)
        parts.at.append(start[mine] + base)
        parts.length.append(length)
        parts.data.append(buffer[np.repeat(begin, length) + ramp])


class _Between:
    """Goes through what lies between frames: NMEA, RTCM and padding are passed over, the rest is counted as damage."""

    def __init__(self) -> None:
        self.seen = 0
        """All before this place of the file is dealt with."""
        self._first: tuple[int, int] | None = None
        self._last = (-1, -1)
        self._count = 0
        self._bytes = 0

    def walk(self, content: bytes, base: int, start: list[int], end: list[int], limit: int, *, last: bool) -> None:
        """Go on to `limit`, or to the end of the last frame."""
        at = self.seen - base
        for begin, stop in zip(start, end, strict=True):
            if begin > at:
                self._gap(content, base, at, begin)
            at = stop
        if at < limit:
            at = self._gap(content, base, at, limit, more=not last)
        self.seen = at + base

    def _gap(self, content: bytes, base: int, at: int, stop: int, *, more: bool = False) -> int:
        """Deal with the bytes from `at` to `stop`, and return where that ended: before, where a piece goes on."""
        while at < stop:
            passed = _NMEA.match(content, at, stop) or _PADDING.match(content, at, stop)
            ends = passed.end() if passed else _rtcm_end(content, at, stop)
            if ends:
                at = ends
                continue
            if more and stop - at < _RTCM_LONGEST:
                return at
            following = _NEXT.search(content, at + 1, stop)
            ends = following.start() if following else stop
            self._damage(at + base, ends + base)
            at = ends
        return at

    def _damage(self, at: int, stop: int) -> None:
        self._bytes += stop - at
        if self._last[1] == at:
            self._last = (self._last[0], stop)
        else:
            self._count += 1
            self._last = (at, stop)
        if self._count == 1:
            self._first = self._last

    def close(self, scan: Scan) -> None:
        """Say what was found: damage at the very start or end of the file is a cut."""
        if self._first is None:
            return
        scan.cut_start = self._first[0] == 0
        scan.cut_end = self._last[1] == self.seen and not (scan.cut_start and self._count == 1)
        cuts = [self._first] * scan.cut_start + [self._last] * scan.cut_end
        scan.damaged_places = self._count - len(cuts)
        scan.damaged_bytes = self._bytes - sum(stop - at for at, stop in cuts)


def _rtcm_end(content: bytes, at: int, stop: int) -> int:
    """Return where an RTCM 3 message that begins here ends; 0 where there is none."""
    if content[at] != 0xD3 or at + 6 > stop or content[at + 1] & 0xFC:
        return 0
    ends = at + 6 + (content[at + 1] << 8 | content[at + 2])
    return ends if ends <= stop else 0
