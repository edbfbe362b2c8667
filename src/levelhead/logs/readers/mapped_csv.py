"""Any CSV, with a mapping file that says what its columns mean (see `levelhead.logs.mapping`)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

from levelhead.conventions import TIME_COLUMN
from levelhead.errors import LogError, UsageError
from levelhead.logs.mapping import UP_COLUMN, TableMapping
from levelhead.logs.pieces import GnssData, ImuData, Pieces
from levelhead.logs.readers.base import Reader, Source, Table, content_of, shown_names
from levelhead.logs.readers.columns import pieces_from_table
from levelhead.logs.readers.csv_table import CsvLayout, find_layout, read_numbers


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
    imu: ImuData | None = None
    gnss: GnssData | None = None
    left_out = 0
    if source.imu_mapping is not None:
        zero = source.imu_mapping.time_zero_s or 0.0
        table = _read_table(source, source.imu_mapping.table, zero)
        left_out = table.left_out
        raw = pieces_from_table(table).imu
        if raw is not None:
            dcm = source.imu_mapping.dcm_file_to_body
            imu = replace(raw, gyro=raw.gyro @ dcm.T, accel=raw.accel @ dcm.T)
    if source.gnss_mapping is not None:
        table = _read_table(source, source.gnss_mapping.table, 0.0)
        left_out = max(left_out, table.left_out)
        gnss = pieces_from_table(table).gnss
    meta = {} if source.gnss_mapping is None else source.gnss_mapping.meta
    return Pieces(imu=imu, gnss=gnss, left_out=left_out, from_zero=True, meta=meta)


def _read_table(source: Source, mapping: TableMapping, time_zero_s: float) -> Table:
    """Read the mapped columns into canonical names, units and signs."""
    path = source.path
    content = content_of(path)
    layout = find_layout(content, name=path.name, header=mapping.header, delimiter=mapping.delimiter)
    wanted = {column: _index(path.name, layout, target) for column, target in mapping.columns.items()}
    numbers = read_numbers(path, content, layout, wanted, time_column=TIME_COLUMN)
    columns = {c: values * mapping.factors[c] for c, values in numbers.columns.items()}
    columns[TIME_COLUMN] = columns[TIME_COLUMN] + (mapping.time_offset_s + time_zero_s)
    if UP_COLUMN in columns:
        columns["vel_d"] = -columns.pop(UP_COLUMN)
    return Table(name=path.name, columns=columns, where=numbers.where, left_out=numbers.left_out)


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
