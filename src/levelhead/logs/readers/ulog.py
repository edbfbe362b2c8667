"""The ULog container: messages of a size and a type, whose definitions say what the data messages hold.

See PX4's "ULog File Format". The file has no checksums; a message counts as sound when its type is known and its size
is that of its type, for data messages that of its topic. Behind damage it goes on where several sound messages follow
one another.
"""

from __future__ import annotations

import re
import struct
from array import array
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from levelhead.errors import LogError
from levelhead.logs.readers.autopilot import Bytes, Parameters, Records, gather, mapped

MAGIC: Final = b"ULog\x01\x12\x35"
HEADER_BYTES: Final = 16
_HEAD: Final = struct.Struct("<HBH")
"""Size of what follows the first three bytes, type, and of data messages the topic's number."""
_DATA: Final = ord("D")
_SIZES: Final = {
    ord("B"): (40, 255),
    ord("F"): (3, 65535),
    ord("I"): (2, 65535),
    ord("M"): (3, 65535),
    ord("P"): (6, 300),
    ord("Q"): (7, 301),
    ord("A"): (4, 1000),
    ord("R"): (2, 2),
    ord("L"): (9, 4096),
    ord("C"): (11, 4096),
    ord("S"): (8, 8),
    ord("O"): (2, 2),
}
"""The sizes that a message of each type may have, bytes."""
_MAX_RECORD: Final = 65535
_CHAIN: Final = 4
"""Behind damage, so many sound messages in a row are taken for a log again."""
_MAX_BEHIND: Final = 2048
"""Those of them that are no data measure at most this: what is damaged is not to pass for one long message."""
_LEAST, _MOST = np.full(256, _MAX_RECORD + 1), np.full(256, -1)
for _kind, (_least, _most) in _SIZES.items():
    _LEAST[_kind], _MOST[_kind] = _least, min(_most, _MAX_BEHIND)
_LEAST[_DATA], _MOST[_DATA] = 10, _MAX_RECORD
_BLOCKS: Final = (1 << 8, 1 << 16)
"""Behind damage, so many bytes are searched at first, and at most, in one go."""
_MAX_PLACES: Final = 10_000
"""A file that is damaged at more places is not read to its end."""
_MAX_DEPTH: Final = 8
_NUMBERS: Final = {
    "int8_t": "<i1", "uint8_t": "<u1", "int16_t": "<i2", "uint16_t": "<u2", "int32_t": "<i4", "uint32_t": "<u4",
    "int64_t": "<i8", "uint64_t": "<u8", "float": "<f4", "double": "<f8", "bool": "<u1", "char": "S1",
}  # fmt: skip
_FIELD: Final = re.compile(r"(\w+)(?:\[(\d{1,5})\])? (\w+)")
_PADDING: Final = "_padding"
"""Fields whose names begin so fill up a structure; at its end they are not logged."""


@dataclass(eq=False)
class Topic:
    """One instance of a logged topic: its layout, what its messages may measure in bytes, where its records begin."""

    name: str
    instance: int
    dtype: np.dtype[Any]
    sizes: range
    starts: array[int] = field(default_factory=lambda: array("q"))


class UlogFile:
    """What a ULog file holds, sound messages only.

    Attributes
    ----------
    topics : dict
        By name and instance.
    parameters : Parameters
    dropouts_ms : list of int
        How long the logger lost data each time.
    left_out : int
        1 where the file ends within a message.
    damaged : str
        A sentence, empty where the file is sound.
    """

    def __init__(self, path: Path) -> None:
        self.topics: dict[tuple[str, int], Topic] = {}
        self.parameters = Parameters()
        self.dropouts_ms: list[int] = []
        self.left_out = 0
        self._formats: dict[str, list[tuple[str, int, str]]] = {}
        self._by_id: dict[int, Topic] = {}
        self._lost: list[tuple[int, int]] = []
        self._flaws: list[str] = []
        self._file = mapped(path)
        self._bytes: Bytes = np.frombuffer(self._file, dtype=np.uint8)
        self.size = len(self._file)
        if self.size < HEADER_BYTES or self._file[: len(MAGIC)] != MAGIC:
            raise LogError(f"{path.name} has no ULog header; check the copy, or name the format that it has.")
        begin = HEADER_BYTES
        for offset in self._appended(path.name):
            if self._walk(begin, offset) != offset:
                self._flaws.append(f"The log breaks off before byte {offset}, where data was appended after a crash.")
            begin = offset
        stopped = self._walk(begin, self.size)
        self.left_out = int(stopped != self.size)
        if self.size - stopped > _MAX_RECORD + 3:
            self._flaws.append(f"From byte {stopped} on nothing can be read ({self.size - stopped} bytes).")

    @property
    def damaged(self) -> str:
        """Where and how the file is damaged in its middle."""
        flaws = list(self._flaws)
        if self._lost:
            count, places = sum(size for _, size in self._lost), len(self._lost)
            where = f"at byte {self._lost[0][0]}" + (f" and {places - 1} other places" if places > 1 else "")
            flaws.insert(0, f"{where.capitalize()}, {count} bytes in all are no sound messages.")
        return " ".join(flaws)

    def records(self, topic: Topic) -> Records:
        """Return a topic's records as a structured array."""
        return gather(self._bytes, topic.starts, topic.dtype)

    def ends(self, topic: Topic) -> Records:
        """Return a topic's first and last record."""
        return gather(self._bytes, [topic.starts[0], topic.starts[-1]], topic.dtype)

    def _appended(self, name: str) -> list[int]:
        """Return where the parts that were appended later begin, as the flags at the file's beginning say."""
        if self.size < HEADER_BYTES + 43 or self._file[HEADER_BYTES + 2] != ord("B"):
            return []
        flags = self._file[HEADER_BYTES + 11 : HEADER_BYTES + 19]
        if flags[0] & ~1 or any(flags[1:]):
            raise LogError(
                f"{name}: the flags say that it cannot be read without knowing a newer ULog format "
                f"(incompatible flags {flags.hex()}); the file is damaged, or levelhead too old."
            )
        offsets = [n for n in struct.unpack_from("<3Q", self._file, HEADER_BYTES + 19) if n] if flags[0] & 1 else []
        if any(b <= a for a, b in zip((HEADER_BYTES, *offsets), (*offsets, self.size + 1), strict=True)):
            self._flaws.append("The flags at its beginning point to no place in the file.")
            return []
        return offsets

    def _walk(self, pos: int, end: int) -> int:
        """Take all sound messages from byte `pos` up to `end`; return where the last one stops."""
        unpack, data, by_id = _HEAD.unpack_from, self._file, self._by_id
        while pos + 5 <= end:
            size, kind, number = unpack(data, pos)
            stop = pos + 3 + size
            if stop <= end:
                if kind == _DATA:
                    topic = by_id.get(number)
                    if topic is not None and size in topic.sizes:
                        topic.starts.append(pos + 5)
                        pos = stop
                        continue
                elif self._take(kind, pos, size):
                    pos = stop
                    continue
            found = self._resume(pos + 1, end)
            if found is None:
                return pos
            self._lost.append((pos, found - pos))
            pos = found
        return pos

    def _resume(self, pos: int, end: int) -> int | None:
        """Return the first byte from `pos` on where sound messages follow one another."""
        length, longest = _BLOCKS
        while pos + 5 <= end and len(self._lost) < _MAX_PLACES:
            block = self._bytes[pos : min(pos + length + 2, end)].astype(np.int64)
            size, kind = block[:-2] | block[1:-1] << 8, block[2:]
            for k in np.flatnonzero((size >= _LEAST[kind]) & (size <= _MOST[kind])):
                if self._goes_on(pos + int(k), end):
                    return pos + int(k)
            pos, length = pos + length, min(4 * length, longest)
        return None

    def _goes_on(self, pos: int, end: int) -> bool:
        for _ in range(_CHAIN):
            if pos == end:
                return True
            if pos + 5 > end:
                return False
            size, kind, number = _HEAD.unpack_from(self._file, pos)
            if kind == _DATA:
                topic = self._by_id.get(number)
                sound = topic is not None and size in topic.sizes
            else:
                sound = bool(_LEAST[kind] <= size <= _MOST[kind])
            pos += 3 + size
            if not sound or pos > end:
                return False
        return True

    def _take(self, kind: int, pos: int, size: int) -> bool:
        """Take a message that is no data; return whether it is sound."""
        least, most = _SIZES.get(kind, (1, 0))
        if not least <= size <= most:
            return False
        body = self._file[pos + 3 : pos + 3 + size]
        if kind == ord("F"):
            return self._define(body)
        if kind == ord("A"):
            return self._subscribe(body)
        if kind == ord("P"):
            return self._note_parameter(body, pos)
        if kind == ord("O"):
            self.dropouts_ms.append(int.from_bytes(body, "little"))
        return True

    def _define(self, body: bytes) -> bool:
        name, colon, text = body.decode("ascii", errors="replace").partition(":")
        matches = [_FIELD.fullmatch(part) for part in text.split(";") if part]
        if not colon or not matches or None in matches:
            return False
        fields = [(m[1], int(m[2] or 0), m[3]) for m in matches if m is not None]
        return self._formats.setdefault(name, fields) == fields

    def _subscribe(self, body: bytes) -> bool:
        number = int.from_bytes(body[1:3], "little")
        name = body[3:].decode("ascii", errors="replace")
        known = self._by_id.get(number)
        if known is not None:
            return (known.name, known.instance) == (name, body[0])
        dtype, whole = self._layout(name)
        if dtype is None or whole is None:
            self._flaws.append(f"What the topic {name[:40]!r} holds is not defined.")
            dtype, sizes = np.dtype("V1"), range(2, _MAX_RECORD + 1)
        else:
            sizes = range(2 + dtype.itemsize, 3 + whole.itemsize)
        topic = self.topics.setdefault((name, body[0]), Topic(name, body[0], dtype, sizes))
        self._by_id[number] = topic
        return topic.dtype == dtype

    def _layout(self, name: str) -> tuple[np.dtype[Any] | None, np.dtype[Any] | None]:
        """Return how a topic's records are laid out: as logged, and with the padding at their end."""
        fields = self._formats.get(name, [])
        logged = len(fields)
        while logged and fields[logged - 1][2].startswith(_PADDING):
            logged -= 1
        return self._structure(fields[:logged]), self._structure(fields)

    def _structure(self, fields: list[tuple[str, int, str]], depth: int = 0) -> np.dtype[Any] | None:
        """Return a type for fields in a row, None where they have none; a structure within it is bytes."""
        if not fields or depth > _MAX_DEPTH or len({name for _, _, name in fields}) < len(fields):
            return None
        spec: list[tuple[str, Any, tuple[int, ...]]] = []
        size = 0
        for kind, count, name in fields:
            inner = (
                np.dtype(_NUMBERS[kind])
                if kind in _NUMBERS
                else self._structure(self._formats.get(kind, []), depth + 1)
            )
            if inner is None:
                return None
            size += inner.itemsize * max(count, 1)
            if size > _MAX_RECORD:
                return None
            spec.append((name, inner if kind in _NUMBERS else f"V{inner.itemsize}", (count,) if count else ()))
        return np.dtype(spec)

    def _note_parameter(self, body: bytes, position: int) -> bool:
        key = body[1 : 1 + body[0]]
        kind, _, name = key.decode("ascii", errors="replace").partition(" ")
        if len(body) != 1 + len(key) + 4 or kind not in ("int32_t", "float"):
            return False
        (value,) = struct.unpack("<i" if kind == "int32_t" else "<f", body[-4:])
        self.parameters.add(name, float(value), position)
        return True
