"""Where a cut file cannot be told from a whole one: between two lines, between two records."""

from __future__ import annotations

from collections.abc import Callable

SizeAt = Callable[[bytes, int], int]
CutUnseen = Callable[[str, bytes, int], bool]


def between_records(first: int, size_at: SizeAt) -> CutUnseen:
    """Return what tells whether a length ends a record.

    Parameters
    ----------
    first : int
        Bytes before the first record.
    size_at : callable
        Takes a sound file and a place where a record begins in it; returns its size, bytes.
    """
    ends: dict[bytes, set[int]] = {}

    def unseen(_name: str, content: bytes, length: int) -> bool:
        if content not in ends:
            ends.clear()
            at, found = first, {first}
            while at < len(content):
                at += size_at(content, at)
                found.add(at)
            ends[content] = found
        return length in ends[content]

    return unseen


def last_cell(_name: str, content: bytes, length: int, delimiter: bytes = b",") -> bool:
    """Return whether nothing is missing but a line end, or digits of the last cell: there need be no last line end.

    All cells of the line are there, each with something in it that may be a number.
    """
    line = content[:length].rpartition(b"\n")[2]
    whole = content[: content.find(b"\n", length)].rpartition(b"\n")[2]
    return not line or (line.count(delimiter) == whole.count(delimiter) and not line.endswith(delimiter))


def sentence_end(_name: str, content: bytes, length: int) -> bool:
    """Return whether the cut lies between two lines, or in the end of one whose checksum is there."""
    return content[:length].endswith(b"\n") or content[length : length + 1] in (b"\r", b"\n")


def line_end(_name: str, content: bytes, length: int) -> bool:
    """Return whether the cut lies between two lines."""
    return content[:length].endswith(b"\n")
