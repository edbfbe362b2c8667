"""Frames of a binary protocol out of a stream that may hold NMEA sentences and RTCM messages besides.

A protocol finds its frames by their checksums alone, from every place that could be the beginning of one: what passes
is a frame, and a damaged one hides nothing behind it. What lies between frames is accounted for.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Places = NDArray[np.int64]

_LONGEST: Final = 65535 + 8
"""No frame is longer: lengths have 16 bits."""
_CHUNK: Final = 1 << 22
"""Bytes that are read at once: memory stays flat however long the file is."""

_NMEA: Final = re.compile(rb"[$!][\x20-\x7e]{3,250}\r?\n")
_PADDING: Final = re.compile(rb"[\r\n\0\xff]+")
"""Line ends, and what a receiver sends on I2C and SPI while it has nothing to say."""
_RTCM_LONGEST: Final = 1023 + 6
_NEXT: Final = re.compile(rb"[$!\xd3]")


@dataclass(frozen=True, kw_only=True)
class Protocol:
    """How frames of a protocol look.

    Attributes
    ----------
    find : callable
        Takes a part of a stream and a limit; returns where the frames that begin before the limit begin and end.
    kinds : callable
        Takes a part of a stream and where frames begin; returns the number of each frame's message.
    header, trailer : int
        Bytes before and behind the payload.
    """

    find: Callable[[Bytes, int], tuple[Places, Places]]
    kinds: Callable[[Bytes, Places], Places]
    header: int
    trailer: int


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

    frames: dict[int, Frames]
    count: int = 0
    damaged_bytes: int = 0
    damaged_places: int = 0
    cut_start: bool = False
    cut_end: bool = False

    @property
    def left_out(self) -> int:
        """Cut frames at the start and the end of the file."""
        return int(self.cut_start) + int(self.cut_end)

    def damage(self, name: str, what: str) -> str:
        """Say where the file is damaged in its middle; `what` are the frames."""
        if not self.damaged_places:
            return ""
        return (
            f"{name}: {self.damaged_bytes} bytes in {self.damaged_places} places are neither {what} with the right "
            "checksum nor NMEA or RTCM."
        )


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


def scan(path: Path, protocol: Protocol, wanted: Iterable[int]) -> Scan:
    """Read a file and keep the payloads of the wanted messages."""
    gathered: dict[int, _Gathered] = {message: _Gathered() for message in wanted}
    stream = Scan(frames={})
    between = _Between()
    for base, buffer, limit, last in _parts(path, between):
        start, end = protocol.find(buffer, limit)
        _gather(protocol, gathered, buffer, start, end, base)
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


def _gather(
    protocol: Protocol, gathered: dict[int, _Gathered], buffer: Bytes, start: Places, end: Places, base: int
) -> None:
    kinds = protocol.kinds(buffer, start)
    for message, parts in gathered.items():
        mine = kinds == message
        if not mine.any():
            continue
        begin = start[mine] + protocol.header
        length = end[mine] - protocol.trailer - begin
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
