"""ROS 1 bags (``.bag``, format 2.0): records of a header with named fields and data, most of them within chunks.

The file is walked from its begin to its end and its index is not used, so that a bag that was cut, or never closed, is
read as a whole one is. See the wiki of ROS, Bags/Format/2.0.
"""

from __future__ import annotations

import io
import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Final, NamedTuple

from levelhead.errors import LogError
from levelhead.logs.pieces import Pieces
from levelhead.logs.readers.base import Reader, Source
from levelhead.logs.readers.ros_drive import Add, Topics, pieces
from levelhead.logs.readers.ros_files import MAX_CHUNK, Extent, find, unpacked
from levelhead.logs.readers.ros_messages import MAX_MESSAGE

_MAGIC: Final = b"#ROSBAG V2.0\n"
_OLD_MAGIC: Final = b"#ROSBAG V1"
_MESSAGE, _BAG, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = 2, 3, 4, 5, 6, 7
_MAX_HEADER: Final = 4096
"""Headers have a few fields of some bytes; the longest has a topic's name."""
_MAX_CONNECTION: Final = 1 << 20
_MAX_SEARCHES: Final = 2000
"""Searches for a record's begin, and places that look like one and are none, after which the rest is left out."""
_LONGEST_BEFORE_OP: Final = 64

_read_u32 = struct.Struct("<I").unpack_from
_read_time = struct.Struct("<II").unpack_from


class _Record(NamedTuple):
    """A record: its kind, header, where its data begins and how long it says it is."""

    kind: int
    fields: dict[bytes, bytes]
    begin: int
    length: int


def sniff(_path: Path, head: bytes) -> bool:
    """Return whether the file begins as a bag does."""
    return head.startswith((_MAGIC, _OLD_MAGIC))


def read(source: Source) -> Pieces:
    """Read a bag; stamps are seconds since 1970, UTC, where the recording computer's clock was set.

    Raises
    ------
    LogError
        On bags of another version, encrypted ones, and those without topics that can be used.
    """
    topics = Topics(source)
    return pieces(topics, scan(source.path, topics))


def scan(path: Path, topics: Topics) -> Extent:
    """Hand every message of the topics that are used to its taker, and return how much of the file was read."""
    size = path.stat().st_size
    with path.open("rb", buffering=1 << 18) as file:
        if file.read(len(_MAGIC)) != _MAGIC:
            raise LogError(f"{path.name} is a bag of another version than 2.0; migrate it (rosbag fix).")
        walk = _Walk(path.name, topics)
        walk.file(file, len(_MAGIC), size)
    return walk.extent


@dataclass(eq=False)
class _Walk:
    """The way through one bag."""

    name: str
    topics: Topics
    extent: Extent = field(default_factory=Extent)
    adds: dict[int, Add | None] = field(default_factory=dict)
    infos: int = 0
    counted: Counter[int] = field(default_factory=Counter)
    counts: Counter[int] = field(default_factory=Counter)
    orphans: int = 0
    searches: int = 0
    bag: dict[bytes, bytes] = field(default_factory=dict)

    def file(self, file: IO[bytes], at: int, size: int) -> None:
        """Walk the records of the file itself; a place that is none is left out up to the next chunk."""
        while at < size:
            for record in _records(file, at, size):
                whole = record.begin + record.length <= size
                if whole or record.kind == _CHUNK:
                    self._use(file, record, size)
                at = record.begin + record.length if whole else record.begin
            if at == size:
                break
            next_chunk = self._search(file, _CHUNK, at + 1, size)
            if next_chunk is None:
                self.extent.left_out += 1
                break
            self.extent.broken(at, "there is no record")
            at = next_chunk
        self._check_end()

    def _use(self, file: IO[bytes], record: _Record, size: int) -> None:
        """Take what one record of the file holds."""
        if record.kind == _CHUNK:
            self._chunk(file, record, min(record.begin + record.length, size))
        elif record.kind == _BAG:
            self.bag = record.fields
            if record.fields.get(b"encryptor"):
                raise LogError(f"{self.name} is encrypted; decrypt it with the tools of ROS (rosbag decrypt).")
        elif record.kind == _CHUNK_INFO:
            self.infos += 1
            self._count(file, record)
        else:
            self._take(file, record)

    def _chunk(self, file: IO[bytes], record: _Record, end: int) -> None:
        """Take the records of a chunk, which may be cut by the end of the file."""
        compression = record.fields.get(b"compression", b"?").decode(errors="replace")
        if compression == "none":
            self._inner(file, record.begin, end, record.begin, cut=end < record.begin + record.length)
            return
        if end - record.begin > MAX_CHUNK:
            self.extent.broken(record.begin, "a compressed chunk is too long")
            return
        file.seek(record.begin)
        content, wrong = unpacked(file.read(end - record.begin), compression, _number(record.fields, b"size"))
        cut = end < record.begin + record.length
        if wrong and not cut:
            self.extent.broken(record.begin, wrong)
        self._inner(io.BytesIO(content), 0, len(content), record.begin, cut=cut or bool(wrong))

    def _inner(self, stream: IO[bytes], at: int, end: int, place: int, *, cut: bool) -> None:
        """Take the records of a chunk's content; a place that is none is left out up to the next message."""
        while at < end:
            for record in _records(stream, at, end):
                if record.kind not in (_MESSAGE, _CONNECTION) or record.begin + record.length > end:
                    break
                at = record.begin + record.length
                self._take(stream, record)
            if at >= end:
                return
            following = self._search(stream, _MESSAGE, at + 1, end)
            if following is None:
                if not cut:
                    self.extent.broken(place, "the chunk that begins there ends in no whole record")
                return
            self.extent.broken(place, "in the chunk that begins there is no record where one should be")
            at = following

    def _count(self, file: IO[bytes], record: _Record) -> None:
        """Add up the messages that the index counts in a chunk: pairs of connection and count."""
        if record.length <= _MAX_CONNECTION:
            file.seek(record.begin)
            pairs = file.read(record.length)
            for connection, count in struct.iter_unpack("<II", pairs[: len(pairs) // 8 * 8]):
                self.counted[connection] += count

    def _take(self, stream: IO[bytes], record: _Record) -> None:
        """Take a connection or a message."""
        if record.kind == _CONNECTION:
            if record.length <= _MAX_CONNECTION:
                stream.seek(record.begin)
                self._connect(record.fields, _fields(stream.read(record.length)) or {})
        elif record.kind == _MESSAGE:
            connection = _number(record.fields, b"conn")
            self.counts[connection] += 1
            add = self.adds.get(connection)
            if add is None:
                self.orphans += connection not in self.adds
                return
            seconds, nanoseconds = _read_time(record.fields[b"time"].ljust(8, b"\0"), 0)
            stream.seek(record.begin)
            # A message that is too long counts as one that is not whole.
            add(seconds * 1_000_000_000 + nanoseconds, stream.read(min(record.length, MAX_MESSAGE)))

    def _connect(self, fields: dict[bytes, bytes], data: dict[bytes, bytes]) -> None:
        number = _number(fields, b"conn")
        if number in self.adds:
            return
        if b"topic" not in fields or b"type" not in data:
            self.extent.note("the description of a topic is broken")
            return
        topic, kind, md5 = (
            text.decode(errors="replace") for text in (fields[b"topic"], data[b"type"], data.get(b"md5sum", b"*"))
        )
        self.adds[number] = self.topics.open(topic, kind, "ros1", md5=md5)

    def _search(self, stream: IO[bytes], kind: int, at: int, end: int) -> int | None:
        """Return where the next record of a kind begins, or None."""
        if self.searches >= _MAX_SEARCHES:
            return None
        self.searches += 1
        mark = b"\x04\0\0\0op=" + bytes([kind])
        found = find(stream, mark, at, end)
        while found is not None and self.searches < _MAX_SEARCHES:
            for begin in range(max(found - 4, at), max(found - _LONGEST_BEFORE_OP, at) - 1, -1):
                record = next(_records(stream, begin, end), None)
                if record is not None and record.kind == kind:
                    return begin
            self.searches += 1
            found = find(stream, mark, found + 1, end)
        return None

    def _check_end(self) -> None:
        """Find out whether the end is missing, where the records themselves do not tell."""
        closed = any(self.bag.get(b"index_pos", b""))
        missing = not closed or self.infos < _number(self.bag, b"chunk_count")
        if missing and self.extent.left_out == 0:
            self.extent.left_out = 1
        if not missing and self.counted != self.counts and not self.extent.damage:
            counted, have = self.counted.total(), self.counts.total()
            self.extent.note(f"its index counts {counted} messages, otherwise over the topics than the {have} found")
        if self.orphans:
            self.extent.note(f"{self.orphans} messages belong to connections that are not in the file")


def _records(stream: IO[bytes], at: int, end: int) -> Iterator[_Record]:
    """Yield records as long as there is one with a header that is whole; its data may go beyond the end."""
    while at + 8 <= end:
        stream.seek(at)
        length = _read_u32(stream.read(4))[0]
        if length > _MAX_HEADER or at + 8 + length > end:
            return
        header = stream.read(length + 4)
        fields = _fields(header[:length])
        if fields is None or len(fields.get(b"op", b"")) != 1:
            return
        kind = fields[b"op"][0]
        if not _MESSAGE <= kind <= _CONNECTION or (kind == _MESSAGE and not fields.keys() >= {b"conn", b"time"}):
            return
        begin = at + 8 + length
        record = _Record(kind, fields, begin, _read_u32(header, length)[0])
        yield record
        at = begin + record.length


def _fields(header: bytes) -> dict[bytes, bytes] | None:
    """Return the fields ``name=value`` of a header, or None where it is none."""
    fields: dict[bytes, bytes] = {}
    at = 0
    while at + 4 <= len(header):
        length = _read_u32(header, at)[0]
        at += 4
        name, equals, value = header[at : at + length].partition(b"=")
        at += length
        if not equals or at > len(header):
            return None
        fields[name] = value
    return fields if at == len(header) else None


def _number(fields: dict[bytes, bytes], name: bytes) -> int:
    return int.from_bytes(fields.get(name, b"")[:8], "little")


READER: Final = Reader(name="ros1-bag", title="ROS 1 bag (.bag)", sniff=sniff, read=read)
