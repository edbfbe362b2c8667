"""MCAP files of ROS 1 and ROS 2 messages: records of an opcode, a length and content, most of them within chunks.

The file is walked from its begin to its end, so that one that was cut is read as a whole one is; the index at its end
is used only to find the next chunk behind a broken place. Checksums are checked. See https://mcap.dev/spec.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Final

from levelhead.logs.pieces import Pieces
from levelhead.logs.readers.base import Reader, Source
from levelhead.logs.readers.ros_drive import Add, Topics, pieces
from levelhead.logs.readers.ros_files import MAX_CHUNK, Extent, unpacked
from levelhead.logs.readers.ros_messages import MAX_MESSAGE

MAGIC: Final = b"\x89MCAP0\r\n"
METADATA_NAME: Final = "levelhead"
"""Name of the metadata record in which levelhead says what ROS messages have no place for."""
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(1, 9)
ATTACHMENT, ATTACHMENT_INDEX, STATISTICS, METADATA, METADATA_INDEX, SUMMARY_OFFSET, DATA_END = range(9, 16)
_IN_CHUNK: Final = frozenset((SCHEMA, CHANNEL, MESSAGE))
_IN_DATA: Final = frozenset((HEADER, FOOTER, *_IN_CHUNK, CHUNK, MESSAGE_INDEX, ATTACHMENT, METADATA, DATA_END))
_PRIVATE: Final = 0x80
"""Kinds from here on are free for anybody, and skipped."""
_FOOTER_SIZE: Final = 9 + 20 + len(MAGIC)
_MAX_RECORD: Final = 1 << 22
"""Schemas, channels, metadata and chunk headers are shorter, bytes."""

_read_record = struct.Struct("<BQ").unpack
_read_message = struct.Struct("<HIQQ").unpack
_MESSAGE_HEADER: Final = 22


def sniff(_path: Path, head: bytes) -> bool:
    """Return whether the file begins as an MCAP file does."""
    return head.startswith(MAGIC)


def read(source: Source) -> Pieces:
    """Read an MCAP file; stamps are seconds since 1970, UTC, where the recording computer's clock was set.

    Raises
    ------
    LogError
        Where there are no topics that can be used.
    """
    topics = Topics(source)
    extent, meta = scan(source.path, topics)
    return pieces(topics, extent, meta)


def scan(path: Path, topics: Topics) -> tuple[Extent, dict[str, str] | None]:
    """Hand every message of the topics that are used to its taker.

    Returns
    -------
    extent : Extent
        How much of the file was read.
    meta : dict or None
        What levelhead wrote of the log, where the file is from levelhead.
    """
    size = path.stat().st_size
    with path.open("rb", buffering=1 << 18) as file:
        walk = _Walk(topics)
        walk.file(file, size)
    return walk.extent, walk.meta


@dataclass(eq=False)
class _Walk:
    """The way through one file."""

    topics: Topics
    extent: Extent = field(default_factory=Extent)
    schemas: dict[int, tuple[str, str, str]] = field(default_factory=dict)
    adds: dict[int, Add | None] = field(default_factory=dict)
    meta: dict[str, str] | None = None
    ended: bool = False
    orphans: int = 0
    counts: Counter[int] = field(default_factory=Counter)

    def file(self, file: IO[bytes], size: int) -> None:
        """Walk the data section from chunk to chunk, so that a broken one does not take the next with it."""
        summary = _summary(file, size)
        whole = summary is not None
        begins = [len(MAGIC), *(summary.chunks if summary is not None else ())]
        for begin, end in zip(begins, [*begins[1:], size], strict=True):
            at, wrong = self._records(file, begin, end, inside=False, cut=not whole)
            if wrong and whole:
                self.extent.broken(at, wrong)
            if self.ended:
                break
        if not (whole and self.ended):
            self.extent.left_out += 1
        if self.orphans:
            self.extent.note(f"{self.orphans} messages belong to channels that are not in the file")
        if summary is not None and summary.counts and summary.counts != self.counts and not self.extent.damage:
            counted, have = summary.counts.total(), self.counts.total()
            self.extent.note(f"its summary counts {counted} messages, otherwise over the topics than the {have} found")

    def _records(self, stream: IO[bytes], at: int, end: int, *, inside: bool, cut: bool) -> tuple[int, str]:
        """Take the records in [at, end); return where that ended, and what is wrong there, if anything.

        ``inside``: of a chunk, not of the file; ``cut``: the last record may end early.
        """
        while at < end:
            stream.seek(at)
            head = stream.read(9)
            if len(head) < 9 or at + 9 > end:
                return at, "a record is cut off"
            kind, length = _read_record(head)
            begin = at + 9
            if kind not in (_IN_CHUNK if inside else _IN_DATA) and not (kind >= _PRIVATE and not inside):
                return at, f"there is a record of the unknown kind {kind}"
            if kind == CHUNK:
                self._chunk(stream, begin, length, end, cut=cut)
            if length > end - begin:
                return at, "a record is longer than its place"
            if kind == MESSAGE:
                if length < _MESSAGE_HEADER:
                    return at, "a message is too short"
                self._message(stream, length)
            elif kind in (SCHEMA, CHANNEL, METADATA):
                if length > _MAX_RECORD or not self._describe(kind, stream.read(length)):
                    return at, "a schema, channel or metadata is not whole"
            elif kind in (DATA_END, FOOTER):
                self.ended = True
                return at, ""
            at = begin + length
        return at, ""

    def _message(self, stream: IO[bytes], length: int) -> None:
        channel, _, log_time, _ = _read_message(stream.read(_MESSAGE_HEADER))
        self.counts[channel] += 1
        add = self.adds.get(channel)
        if add is not None:
            # A message that is too long counts as one that is not whole.
            add(log_time, stream.read(min(length - _MESSAGE_HEADER, MAX_MESSAGE)))
        else:
            self.orphans += channel not in self.adds

    def _chunk(self, file: IO[bytes], begin: int, length: int, end: int, *, cut: bool) -> None:
        """Take the records of a chunk. Of one that the end of the file cuts, the beginning cannot be checked."""
        head = file.read(min(_CHUNK_HEADER + _MAX_NAME + 8, length, end - begin))
        try:
            size, crc, name = _read_chunk(head, 16)
            compression = head[_CHUNK_HEADER : _CHUNK_HEADER + name].decode()
            (packed,) = _read_u64(head, _CHUNK_HEADER + name)
        except (struct.error, UnicodeDecodeError):
            self._wrong(begin, "the header of a chunk is broken", cut=cut)
            return
        at = begin + _CHUNK_HEADER + name + 8
        if packed > begin + length - at:
            self._wrong(begin, "a chunk is longer than its record", cut=cut)
            return
        cut = cut and at + packed > end
        stop = min(at + packed, end)
        if compression == "":
            if not cut and crc and _checksum(file, at, stop) != crc:
                self._wrong(begin, "the checksum of a chunk is wrong", cut=False)
                return
            self._inner(file, at, stop, begin, cut=cut)
        elif stop - at > MAX_CHUNK:
            self._wrong(begin, "a compressed chunk is too long", cut=False)
        else:
            file.seek(at)
            content, wrong = unpacked(file.read(stop - at), compression, size)
            if not cut and not wrong and crc and zlib.crc32(content) != crc:
                wrong = "the checksum of a chunk is wrong"
            if wrong and not cut:
                self._wrong(begin, wrong, cut=False)
                return
            self._inner(io.BytesIO(content), 0, len(content), begin, cut=cut)

    def _inner(self, stream: IO[bytes], at: int, end: int, place: int, *, cut: bool) -> None:
        _, wrong = self._records(stream, at, end, inside=True, cut=cut)
        if wrong:
            self._wrong(place, f"in the chunk that begins {wrong}", cut=cut)

    def _wrong(self, at: int, what: str, *, cut: bool) -> None:
        """Note what is wrong; the end of a file that was cut is told of at the end."""
        if not cut:
            self.extent.broken(at, what)

    def _describe(self, kind: int, content: bytes) -> bool:
        """Take a schema, a channel or metadata; return whether it is whole."""
        try:
            if kind == SCHEMA:
                name, encoding, text = _texts(content, 2, 3)[:3]
                self.schemas[int.from_bytes(content[:2], "little")] = name, encoding, text
            elif kind == CHANNEL:
                topic, encoding = _texts(content, 4, 2)
                channel, schema = struct.unpack_from("<HH", content)
                self._open(channel, schema, topic, encoding)
            else:
                (name,) = _texts(content, 0, 1)
                if name == METADATA_NAME:
                    words = _texts(content, 8 + len(name.encode()), None)
                    self.meta = dict(zip(words[::2], words[1::2], strict=True))
        except (struct.error, ValueError):
            return False
        return True

    def _open(self, channel: int, schema: int, topic: str, encoding: str) -> None:
        if channel in self.adds:
            return
        name, form, text = self.schemas.get(schema, ("", "", ""))
        definition = text if form in ("ros1msg", "ros2msg") else None
        self.adds[channel] = self.topics.open(topic, name, encoding, definition=definition)


_CHUNK_HEADER: Final = 32
_MAX_NAME: Final = 32
_read_chunk = struct.Struct("<QII").unpack_from
_read_u64 = struct.Struct("<Q").unpack_from
_read_u32 = struct.Struct("<I").unpack_from
_MAX_SUMMARY: Final = 1 << 26
_BLOCK: Final = 1 << 20


def _texts(content: bytes, at: int, count: int | None) -> list[str]:
    """Return texts with their length before them; ValueError or struct.error where there are fewer."""
    texts: list[str] = []
    while (count is None and at < len(content)) or (count is not None and len(texts) < count):
        (length,) = _read_u32(content, at)
        if at + 4 + length > len(content):
            raise ValueError("a text is cut")
        texts.append(content[at + 4 : at + 4 + length].decode())
        at += 4 + length
    return texts


def _checksum(file: IO[bytes], at: int, end: int) -> int:
    """Return the CRC-32 of a part of a file."""
    file.seek(at)
    crc = 0
    while at < end:
        block = file.read(min(_BLOCK, end - at))
        crc, at = zlib.crc32(block, crc), at + max(len(block), 1)
    return crc


@dataclass(frozen=True)
class _Summary:
    """What the end of a file tells: where its chunks begin, and its messages by channel, if it says so."""

    chunks: Sequence[int] = ()
    counts: Counter[int] = field(default_factory=Counter)


def _summary(file: IO[bytes], size: int) -> _Summary | None:
    """Return what the end of the file tells; None where the file has no end."""
    file.seek(max(size - _FOOTER_SIZE, 0))
    footer = file.read(_FOOTER_SIZE)
    if len(footer) < _FOOTER_SIZE or footer[:9] != struct.pack("<BQ", FOOTER, 20) or not footer.endswith(MAGIC):
        return None
    at, _, crc = struct.unpack_from("<QQI", footer, 9)
    end = size - _FOOTER_SIZE
    if not len(MAGIC) < at <= end or end - at > _MAX_SUMMARY:
        return _Summary()
    file.seek(at)
    content = file.read(end - at)
    if crc and zlib.crc32(footer[:25], zlib.crc32(content)) != crc:
        return _Summary()
    places: set[int] = set()
    counts: Counter[int] = Counter()
    begin = 0
    while begin + 9 <= len(content):
        kind, length = _read_record(content[begin : begin + 9])
        if 24 <= length <= len(content) - begin - 9:
            if kind == CHUNK_INDEX:
                places.add(_read_u64(content, begin + 25)[0])
            elif kind == STATISTICS:
                # Behind 42 bytes of other numbers and a length.
                pairs = content[begin + 9 + 46 : begin + 9 + length]
                counts = Counter(dict(struct.iter_unpack("<HQ", pairs[: len(pairs) // 10 * 10])))
        begin += 9 + length
    chunks = [place for place in sorted(places) if len(MAGIC) < place < at and _is_chunk(file, place)]
    return _Summary(chunks, counts)


def _is_chunk(file: IO[bytes], place: int) -> bool:
    file.seek(place)
    return file.read(1) == bytes([CHUNK])


READER: Final = Reader(name="mcap", title="MCAP (.mcap)", sniff=sniff, read=read)
