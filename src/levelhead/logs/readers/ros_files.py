"""What the containers of ROS messages share: how far a file was read, chunks unpacked within limits, marks found."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import IO, Final

MAX_CHUNK: Final = 1 << 28
"""A chunk that says it is larger when unpacked is not unpacked, bytes. Recorders make them of 0.8 to 4 MB."""
MAX_RATIO: Final = 1000
"""Nor one that says it grows more than this, beyond the first `FREE_CHUNK` bytes."""
FREE_CHUNK: Final = 1 << 22
_PIECE: Final = 1 << 16
_SEARCHED: Final = 1 << 20
_TOLD: Final = 3


@dataclass
class Extent:
    """How much of a file was read.

    Attributes
    ----------
    left_out : int
        Records that were cut off at the end; at least 1 where the end is missing.
    damage : list of str
        What was found broken in the middle, and where; the first of `places`.
    """

    left_out: int = 0
    damage: list[str] = field(default_factory=list)
    places: int = 0

    def note(self, what: str) -> None:
        """Note what is wrong with the file; of very many such places the first are kept."""
        self.places += 1
        if len(self.damage) < _TOLD:
            self.damage.append(what)

    def broken(self, at: int, what: str) -> None:
        """Note what was found at a byte of the file."""
        self.note(f"at byte {at} {what}")

    def add(self, other: Extent) -> None:
        """Take in the extent of a further file of the same log."""
        self.left_out += other.left_out
        self.damage = (self.damage + other.damage)[:_TOLD]
        self.places += other.places

    def sentence(self, name: str) -> str:
        """Return `Pieces.damaged`."""
        if not self.damage:
            return ""
        more = self.places - len(self.damage)
        tail = f"; and {more} more places" if more > 0 else ""
        return f"{name}: {'; '.join(self.damage)}{tail}."


def unpacked(data: bytes, compression: str, declared: int) -> tuple[bytes, str]:
    """Return the content of a compressed chunk, and what is wrong with it, or an empty string.

    Parameters
    ----------
    data : bytes
        All of the chunk, or its beginning: then the content's beginning is returned.
    compression : {"lz4", "zstd", "bz2"}
        As frames of these programs.
    declared : int
        Bytes of the content as the file has it; never more are made.
    """
    if compression not in ("lz4", "zstd", "bz2"):
        return b"", f"a chunk has the unknown compression {compression[:20]!r}"
    if declared > MAX_CHUNK or declared > max(FREE_CHUNK, MAX_RATIO * len(data)):
        return b"", f"a chunk of {len(data)} bytes would unpack to {declared}, which is too much"
    import pyarrow as pa

    content = _at_once(data, compression, declared)
    if content is not None:
        return content, ""
    stream = pa.CompressedInputStream(pa.BufferReader(data), compression)
    pieces, have = [], 0
    wrong = ""
    while have <= declared:
        try:
            piece = stream.read(min(_PIECE, declared + 1 - have))
        except (OSError, pa.ArrowException) as error:
            wrong = f"a chunk could not be unpacked ({str(error)[:60].splitlines()[0]})"
            break
        if not piece:
            break
        pieces.append(piece)
        have += len(piece)
    if not wrong and have != declared:
        wrong = f"a chunk unpacks to another length than the {declared} bytes that it says"
    return b"".join(pieces)[:declared], wrong


def _at_once(data: bytes, compression: str, declared: int) -> bytes | None:
    """Return the content if it has the declared length; else None, and it is unpacked by pieces, 20 times slower."""
    import pyarrow as pa

    def unpack(length: int) -> bytes | None:
        try:
            content: bytes = pa.decompress(data, decompressed_size=length, codec=compression, asbytes=True)
        except (OSError, pa.ArrowException):
            return None
        return content

    if compression == "bz2" or declared == 0:
        return None
    content = unpack(declared)
    # Of LZ4 Arrow does not tell when there was less, and the rest is what was in memory: one byte less must not do.
    if content is not None and compression == "lz4" and unpack(declared - 1) is not None:
        return None
    return content


def find(file: IO[bytes], mark: bytes, at: int, end: int) -> int | None:
    """Return the place of the first `mark` that begins in [at, end), or None."""
    while at < end:
        file.seek(at)
        block = file.read(min(_SEARCHED, end - at) + len(mark) - 1)
        found = block.find(mark)
        if found >= 0:
            return at + found if at + found < end else None
        if len(block) < len(mark):
            return None
        at += len(block) - len(mark) + 1
    return None
