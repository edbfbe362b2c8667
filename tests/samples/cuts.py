"""Where a cut text cannot be told from a whole one."""

from __future__ import annotations


def last_cell(_name: str, content: bytes, length: int) -> bool:
    """Return whether nothing is missing but a line end, or digits of the last cell: there need be no last line end.

    All cells of the line are there, each with something in it that may be a number.
    """
    line = content[:length].rpartition(b"\n")[2]
    whole = content[: content.find(b"\n", length)].rpartition(b"\n")[2]
    return not line or (line.count(b",") == whole.count(b",") and not line.endswith(b","))


def line_end(_name: str, content: bytes, length: int) -> bool:
    """Return whether the cut lies between two lines."""
    return content[:length].endswith(b"\n")
