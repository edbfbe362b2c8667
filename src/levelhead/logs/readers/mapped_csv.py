"""Any CSV, with a mapping file that says what its columns mean (see `levelhead.logs.mapping`)."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from levelhead.conventions import TIME_COLUMN
from levelhead.errors import LogError, UsageError
from levelhead.logs.mapping import TableMapping
from levelhead.logs.pieces import Pieces
from levelhead.logs.readers.base import Reader, Source, Table, content_of, shown_names
from levelhead.logs.readers.csv_table import CsvLayout, find_layout, read_numbers
from levelhead.logs.readers.mapped import mapped_pieces


def sniff(_path: Path, _head: bytes) -> bool:
    """Return False: only the caller, by giving a mapping, can say that a text is this."""
    return False


def read(source: Source) -> Pieces:
    """Read what the mapping describes: IMU data, GNSS data, or both from one file.

    Raises
    ------
    LogError
        Naming file, line and column of what is wrong.
    UsageError
        When no section of a mapping describes the file.
    """
    if source.imu_mapping is None and source.gnss_mapping is None:
        raise UsageError(f"{source.path.name} is to be read as mapped-csv; pass mapping= with a section for it.")
    return mapped_pieces(source, lambda mapping: _numbers(source.path, mapping))


def _numbers(path: Path, mapping: TableMapping) -> Table:
    """Return the mapped columns as they stand in the file."""
    if mapping.variable is not None:
        raise UsageError(f"{path.name} is no MATLAB file; leave variable = {mapping.variable!r} out.")
    content = content_of(path)
    layout = find_layout(content, name=path.name, header=mapping.header, delimiter=mapping.delimiter)
    wanted = {column: _index(path.name, layout, target) for column, target in mapping.columns.items()}
    numbers = read_numbers(path, content, layout, wanted, time_column=TIME_COLUMN)
    return Table(name=path.name, columns=numbers.columns, where=numbers.where, left_out=numbers.left_out)


def _index(name: str, layout: CsvLayout, target: str | int) -> int:
    """Return the index of a column that the mapping names or numbers."""
    if isinstance(target, int):
        if target > len(layout.names):
            raise LogError(
                f"{name}: the mapping asks for column {target}, but the lines have {len(layout.names)} columns; check "
                "the mapping's columns and delimiter."
            )
        return target - 1
    count = layout.names.count(target)
    if count != 1:
        found = "is missing from" if count == 0 else "appears twice in"
        raise LogError(
            f"{name}: the column {target!r} {found} the header (found: {shown_names(layout.names)}); check the "
            "mapping, and pass gnss= if the GNSS data is in another file."
        )
    return layout.names.index(target)


READER: Final = Reader(name="mapped-csv", title="CSV with a mapping file", sniff=sniff, read=read)
