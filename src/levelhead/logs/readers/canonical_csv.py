"""The canonical CSV log: one table with the column names of `levelhead.conventions`, units in brackets."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

from levelhead.conventions import CANONICAL_UNITS, TIME_COLUMN
from levelhead.errors import LogError
from levelhead.logs.pieces import Pieces
from levelhead.logs.readers.base import Reader, Source, Table, content_of
from levelhead.logs.readers.columns import assumed_facts, find_columns, pieces_from_table, split_unit
from levelhead.logs.readers.csv_table import find_layout, is_text, read_numbers


def sniff(_path: Path, head: bytes) -> bool:
    """Return whether the text begins with a header that names at least two canonical columns."""
    if not is_text(head):
        return False
    try:
        layout = find_layout(head, name="")
    except LogError:
        return False
    return len({split_unit(n)[0] for n in layout.names} & set(CANONICAL_UNITS)) > 1


def read(source: Source) -> Pieces:
    """Read a canonical CSV log, or the GNSS columns of one.

    Raises
    ------
    LogError
        Naming file, line and column of what is wrong.
    """
    path = source.path
    content = content_of(path)
    layout = find_layout(content, name=path.name)
    columns = find_columns(path.name, layout.names, [None] * len(layout.names), role=source.role)
    numbers = read_numbers(path, content, layout, {c: k.index for c, k in columns.items()}, time_column=TIME_COLUMN)
    scaled = {c: values * columns[c].factor for c, values in numbers.columns.items()}
    scale = columns[TIME_COLUMN].time_scale
    table = Table(name=path.name, columns=scaled, where=numbers.where, left_out=numbers.left_out, time_scale=scale)
    return replace(pieces_from_table(table), assumed=assumed_facts(columns))


READER: Final = Reader(name="csv", title="canonical CSV", sniff=sniff, read=read)
