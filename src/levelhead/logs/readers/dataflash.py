"""ArduPilot's DataFlash container (``.bin``): messages of a fixed size each, which FMT messages describe.

A message begins with the bytes A3 95 and its number; there is no checksum. It counts as sound when its number is known
and the file is long enough for it; behind damage it goes on where sound messages follow one another.
"""

from __future__ import annotations

import struct
from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from levelhead.conventions import FloatArray
from levelhead.errors import LogError
from levelhead.logs.readers.autopilot import Bytes, Records, columns, gather, mapped

MAGIC: Final = b"\xa3\x95"
FMT_NUMBER: Final = 128
FMT: Final = struct.Struct("<2s3B4s16s64s")
"""A message that describes another: its number, size, name, types, and the names of its fields."""
_HEAD: Final = struct.Struct("<HB")
_MAGIC_NUMBER: Final = int.from_bytes(MAGIC, "little")
_CHAIN: Final = 3
"""Behind damage, so many sound messages in a row are taken for a log again."""
_MAX_PLACES: Final = 100_000
"""A file that is damaged at more places is not read to its end."""
_TYPES: Final = {
    "a": ("(32,)<i2", 1.0), "b": ("<i1", 1.0), "B": ("<u1", 1.0), "h": ("<i2", 1.0), "H": ("<u2", 1.0),
    "i": ("<i4", 1.0), "I": ("<u4", 1.0), "f": ("<f4", 1.0), "d": ("<f8", 1.0), "g": ("<f2", 1.0),
    "n": ("S4", 1.0), "N": ("S16", 1.0), "Z": ("S64", 1.0), "c": ("<i2", 0.01), "C": ("<u2", 0.01),
    "e": ("<i4", 0.01), "E": ("<u4", 0.01), "L": ("<i4", 1e-7), "M": ("<u1", 1.0), "q": ("<i8", 1.0),
    "Q": ("<u8", 1.0),
}  # fmt: skip
"""What each letter stands for, and the unit that a value of 1 has."""


@dataclass(eq=False)
class Kind:
    """One kind of message: its layout without the three bytes of the head, the fields' units, where each begins."""

    name: str
    size: int
    dtype: np.dtype[Any]
    units: dict[str, float]
    starts: array[int] = field(default_factory=lambda: array("q"))


class DataFlashFile:
    """What a DataFlash log holds, sound messages only.

    Attributes
    ----------
    kinds : dict of Kind
        By name.
    left_out : int
        1 where the file ends within a message.
    damaged : str
        A sentence, empty where the file is sound.
    """

    def __init__(self, path: Path) -> None:
        self.kinds: dict[str, Kind] = {}
        self.left_out = 0
        self._by_number: list[Kind | None] = [None] * 256
        self._by_number[FMT_NUMBER] = Kind("FMT", FMT.size, np.dtype("V1"), {})
        self._lost: list[tuple[int, int]] = []
        self._file = mapped(path)
        self._bytes: Bytes = np.frombuffer(self._file, dtype=np.uint8)
        self.size = len(self._file)
        if not self._file[:3] == MAGIC + bytes([FMT_NUMBER]):
            raise LogError(f"{path.name} does not begin as an ArduPilot log does; check the copy.")
        stopped = self._walk()
        self.left_out = int(stopped < self.size)
        if self.size - stopped > 255:
            self._lost.append((stopped, self.size - stopped))

    @property
    def damaged(self) -> str:
        """Where and how the file is damaged in its middle."""
        if not self._lost:
            return ""
        count, places = sum(size for _, size in self._lost), len(self._lost)
        where = f"At byte {self._lost[0][0]}" + (f" and {places - 1} other places" if places > 1 else "")
        return f"{where}, {count} bytes in all are no known messages."

    def records(self, kind: Kind) -> Records:
        """Return all messages of a kind as a structured array of what the file has, without units."""
        return gather(self._bytes, kind.starts, kind.dtype)

    def _walk(self) -> int:
        """Take all sound messages; return where the last one stops."""
        unpack, data, by_number, end, pos = _HEAD.unpack_from, self._file, self._by_number, self.size, 0
        while pos + 3 <= end:
            magic, number = unpack(data, pos)
            kind = by_number[number]
            if magic == _MAGIC_NUMBER and kind is not None:
                stop = pos + kind.size
                if stop <= end and (number != FMT_NUMBER or self._describe(pos)):
                    kind.starts.append(pos + 3)
                    pos = stop
                    continue
            found = self._resume(pos + 1)
            if found is None:
                return pos
            self._lost.append((pos, found - pos))
            pos = found
        return pos

    def _resume(self, pos: int) -> int | None:
        """Return the first byte from `pos` on where sound messages follow one another."""
        if len(self._lost) >= _MAX_PLACES:
            return None
        found = self._file.find(MAGIC, pos)
        while found >= 0:
            if self._goes_on(found):
                return found
            found = self._file.find(MAGIC, found + 1)
        return None

    def _goes_on(self, pos: int) -> bool:
        for _ in range(_CHAIN):
            if pos == self.size:
                return True
            if pos + 3 > self.size:
                return False
            magic, number = _HEAD.unpack_from(self._file, pos)
            kind = self._by_number[number]
            if magic != _MAGIC_NUMBER or kind is None or pos + kind.size > self.size:
                return False
            pos += kind.size
        return True

    def _describe(self, pos: int) -> bool:
        """Take the description of a kind of message; return whether it is one and contradicts no other."""
        _, _, number, size, *texts = FMT.unpack_from(self._file, pos)
        name, letters, labels = (text.partition(b"\0")[0].decode("ascii", errors="replace") for text in texts)
        names = labels.split(",") if labels else []
        if len(names) != len(letters) or len(set(names)) != len(names) or not all(c in _TYPES for c in letters):
            return False
        dtype = np.dtype([(n, _TYPES[c][0]) for n, c in zip(names, letters, strict=True)])
        if size != 3 + dtype.itemsize or not name.isalnum() or not all(names):
            return False
        known = self._by_number[number]
        if number == FMT_NUMBER:
            return bool(name == "FMT" and size == FMT.size)
        if known is not None:
            return bool(known.name == name and known.dtype == dtype)
        if name in self.kinds:
            return False
        kind = Kind(name, size, dtype, {n: _TYPES[c][1] for n, c in zip(names, letters, strict=True)})
        self._by_number[number] = self.kinds[name] = kind
        return True


def in_units(kind: Kind, records: Records, names: Sequence[str]) -> FloatArray:
    """Return fields of messages side by side, shape (n, k), in the units that their letters stand for."""
    return columns(records, names) * [kind.units[name] for name in names]
