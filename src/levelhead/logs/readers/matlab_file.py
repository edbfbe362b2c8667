"""MATLAB's MAT-file of level 5 (``save -v6`` and ``-v7``): the numbers in it, and nothing else.

The file is a header of 128 bytes and one element per variable, each with its length before it, deflated or not. Of the
elements only arrays of numbers and structs of one element are read; everything is checked against the bytes that are
there before memory is taken for it.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from levelhead.conventions import FloatArray
from levelhead.errors import LogError

HEADER_BYTES: Final = 128
MAGIC: Final = b"MATLAB 5.0 MAT-file"
MAX_BYTES: Final = 1 << 29
"""What a file may have, and what a variable may take, inflated and as float64, bytes: days at 100 Hz."""
MAX_DEPTH: Final = 8
"""Structs in structs."""
MAX_FIELDS: Final = 1000
CHUNK_BYTES: Final = 1 << 16
"""Deflated data is fed in pieces: zlib then takes no more memory than it needs."""
PREFIX_BYTES: Final = 1024
"""Enough of a variable for its class, dimensions and name."""

_MATRIX, _COMPRESSED, _UINT32, _INT32, _INT8 = 14, 15, 6, 5, 1
_TYPES: Final = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""How numbers are stored, which may be more narrowly than their class says."""
_STRUCT: Final = 2
_NUMBERS: Final = range(6, 16)
"""Classes of arrays of numbers: double, single, and integers of 8 to 64 bits."""
_COMPLEX, _LOGICAL = 0x0800, 0x0200
_CLASSES: Final = {1: "cell", 2: "struct", 3: "object", 4: "text", 5: "sparse", 6: "double", 7: "single", 17: "object"}

Value = FloatArray | Mapping[str, "Value | None"]
"""An array of numbers, or the fields of a struct; None for what is neither."""


class _BadElementError(ValueError):
    """An element that is not what its place in the file says."""


@dataclass(frozen=True, kw_only=True)
class Variable:
    """A variable of the file: what its head says, and the bytes from which `values` are read."""

    name: str
    kind: str
    shape: tuple[int, ...]
    start: int
    data: bytes = field(repr=False)
    deflated: bool


@dataclass(frozen=True, kw_only=True)
class MatFile:
    """A MAT-file: its variables by name, whether its end is cut off, and where it is damaged, as a sentence."""

    name: str
    order: str
    variables: Mapping[str, Variable]
    cut: bool
    damaged: str

    def values(self, name: str) -> Value | None:
        """Return a variable's numbers, or a struct's fields; None where it is neither.

        Raises
        ------
        LogError
            When the variable is damaged, or larger than `MAX_BYTES`.
        """
        variable = self.variables[name]
        where = f"{self.name}: the variable {name} (at byte {variable.start})"
        if math.prod(variable.shape) > MAX_BYTES // 8:
            raise LogError(f"{where} is larger than {MAX_BYTES >> 20} MiB; save fewer samples in one file.")
        try:
            element = _inflated(variable.data, where) if variable.deflated else variable.data
            return _Reader(element, self.order).matrix(0)
        except (_BadElementError, zlib.error) as error:
            raise LogError(f"{where} is damaged ({error}); save the file anew.") from None

    def listing(self) -> str:
        """Return the variables for an error: ``IMU (9x2 double), t (1x2 double)``."""
        shown = [f"{v.name} ({'x'.join(map(str, v.shape))} {v.kind})" for v in self.variables.values()]
        return ", ".join(shown[:12]) + (", ..." if len(shown) > 12 else "") if shown else "nothing"


def open_mat(path: Path) -> MatFile:
    """Return the variables of a MAT-file of level 5.

    Raises
    ------
    LogError
        When it is none, or one of level 7.3, which is HDF5.
    """
    if path.stat().st_size > MAX_BYTES:
        raise LogError(f"{path.name} is larger than {MAX_BYTES >> 20} MiB; save only the variables of the drive.")
    content = path.read_bytes()
    if content.startswith(b"MATLAB 7.3"):
        raise LogError(f"{path.name} is a MAT-file of level 7.3 (HDF5), which is not read; save it with -v7.")
    if not content.startswith(MAGIC) or content[126:128] not in (b"IM", b"MI"):
        raise LogError(f"{path.name} has not the header of a MAT-file of level 5; save it with -v7.")
    order = "<" if content[126:128] == b"IM" else ">"
    variables: dict[str, Variable] = {}
    bad: list[int] = []
    at, cut = HEADER_BYTES, False
    while at < len(content):
        if at + 8 > len(content):
            cut = True
            break
        kind, size = struct.unpack_from(f"{order}II", content, at)
        if kind not in (_MATRIX, _COMPRESSED):
            bad.append(at)
            break
        end = at + 8 + size
        if end > len(content):
            cut = True
            break
        try:
            variable = _variable(content, at, end, order, deflated=kind == _COMPRESSED)
            if variable.name:
                variables[variable.name] = variable
        except (_BadElementError, zlib.error):
            bad.append(at)
        at = end
    damaged = f"{path.name} is damaged at byte {bad[0]}; variables there were not read." if bad else ""
    return MatFile(name=path.name, order=order, variables=variables, cut=cut, damaged=damaged)


def _variable(content: bytes, at: int, end: int, order: str, *, deflated: bool) -> Variable:
    """Return what the head of an element says."""
    data = content[at + 8 : end] if deflated else content[at:end]
    prefix = data[: 2 * PREFIX_BYTES]
    if deflated:
        prefix = zlib.decompressobj().decompress(prefix, PREFIX_BYTES)
    head = _Reader(prefix, order).head(0)
    kind = _CLASSES.get(head.kind, "integer" if head.kind in _NUMBERS else "unknown")
    return Variable(name=head.name, kind=kind, shape=head.shape, start=at, data=data, deflated=deflated)


def _inflated(data: bytes, where: str) -> bytes:
    """Return the inflated element; its check sum is checked, and a bomb does not go off."""
    inflater = zlib.decompressobj()
    pieces, left = [], MAX_BYTES
    for at in range(0, len(data), CHUNK_BYTES):
        pieces.append(inflater.decompress(data[at : at + CHUNK_BYTES], left))
        left -= len(pieces[-1])
        if inflater.unconsumed_tail or left == 0:
            raise LogError(f"{where} is larger than {MAX_BYTES >> 20} MiB; save fewer samples in one file.")
    if not inflater.eof:
        raise _BadElementError("its deflated data ends early")
    return b"".join(pieces)


@dataclass(frozen=True, kw_only=True)
class _Head:
    """The head of a matrix element; `body` is where its contents begin, `end` where they must end."""

    kind: int
    flags: int
    shape: tuple[int, ...]
    name: str
    body: int
    end: int


class _Reader:
    """Elements out of bytes, none of them believed."""

    def __init__(self, data: bytes, order: str) -> None:
        self.data = data
        self.order = order

    def tag(self, at: int) -> tuple[int, int, int, int]:
        """Return an element's type, the start and the size of its data, and where the next element begins."""
        if at + 8 > len(self.data):
            raise _BadElementError("an element lies beyond its end")
        first, size = struct.unpack_from(f"{self.order}II", self.data, at)
        if first >> 16:
            # A small element: type and size in one word, the data in the other.
            return first & 0xFFFF, at + 4, min(first >> 16, 4), at + 8
        return first, at + 8, size, at + 8 + (size + 7) // 8 * 8

    def head(self, at: int) -> _Head:
        """Return the head of the matrix element at a byte."""
        kind, start, size, _ = self.tag(at)
        if kind != _MATRIX:
            raise _BadElementError(f"an element of type {kind} stands where a matrix should")
        if size == 0:
            return _Head(kind=0, flags=0, shape=(0, 0), name="", body=start, end=start)
        kind, flags_at, flags_size, at = self.tag(start)
        if kind != _UINT32 or flags_size != 8 or flags_at + 8 > len(self.data):
            raise _BadElementError("a matrix has no flags")
        (flags,) = struct.unpack_from(f"{self.order}I", self.data, flags_at)
        kind, dims_at, dims_size, at = self.tag(at)
        if kind != _INT32 or not 8 <= dims_size <= 128 or dims_at + dims_size > len(self.data):
            raise _BadElementError("a matrix has no dimensions")
        shape = struct.unpack_from(f"{self.order}{dims_size // 4}i", self.data, dims_at)
        kind, name_at, name_size, at = self.tag(at)
        if kind != _INT8 or min(shape) < 0 or name_size > 64 or name_at + name_size > len(self.data):
            raise _BadElementError("a matrix has no name")
        name = self.data[name_at : name_at + name_size].rstrip(b"\0").decode("ascii", errors="replace")
        return _Head(kind=flags & 0xFF, flags=flags, shape=shape, name=name, body=at, end=start + size)

    def matrix(self, at: int, depth: int = 0) -> Value | None:
        """Return the numbers or the fields of the matrix element at a byte."""
        head = self.head(at)
        if head.end > len(self.data):
            raise _BadElementError("a matrix is longer than the data that is there")
        if head.kind in _NUMBERS and not head.flags & _COMPLEX:
            return self.numbers(head)
        if head.kind == _STRUCT and math.prod(head.shape) == 1 and depth < MAX_DEPTH:
            return self.fields(head, depth)
        return None

    def numbers(self, head: _Head) -> FloatArray:
        """Return an array of numbers as float64, in MATLAB's shape."""
        count = math.prod(head.shape)
        kind, start, size, _ = self.tag(head.body)
        if count > MAX_BYTES // 8:
            raise _BadElementError(f"{count} numbers are too many")
        if kind not in _TYPES:
            raise _BadElementError(f"numbers have the type {kind}")
        dtype = np.dtype(f"{self.order}{_TYPES[kind]}")
        if size != count * dtype.itemsize or start + size > min(head.end, len(self.data)):
            raise _BadElementError(f"{size} bytes stand where {count} numbers should")
        flat = np.frombuffer(self.data, dtype=dtype, count=count, offset=start)
        return flat.astype(np.float64).reshape(head.shape, order="F")

    def fields(self, head: _Head, depth: int) -> dict[str, Value | None]:
        """Return the fields of a struct of one element."""
        kind, at, size, following = self.tag(head.body)
        if kind != _INT32 or size != 4:
            raise _BadElementError("a struct has no field names")
        (width,) = struct.unpack_from(f"{self.order}i", self.data, at)
        kind, at, size, following = self.tag(following)
        if kind != _INT8 or width <= 0 or size % width or size // width > MAX_FIELDS or at + size > len(self.data):
            raise _BadElementError("a struct has no field names")
        found: dict[str, Value | None] = {}
        for k in range(size // width):
            text = self.data[at + k * width : at + (k + 1) * width].partition(b"\0")[0]
            _, _, _, after = self.tag(following)
            found[text.decode("ascii", errors="replace")] = self.matrix(following, depth + 1)
            following = after
        return found
