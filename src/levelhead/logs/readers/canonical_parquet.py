"""The canonical Parquet log: the table of the canonical CSV, units in the names or in the field metadata ``unit``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from levelhead.conventions import TIME_COLUMN, FloatArray
from levelhead.errors import LogError
from levelhead.logs.datum import DATUM_KEY, HEIGHT_KEY, declared
from levelhead.logs.pieces import Pieces
from levelhead.logs.readers.base import Reader, Source, Table, shown
from levelhead.logs.readers.columns import assumed_facts, find_columns, pieces_from_table
from levelhead.logs.timescales import TIME_SCALES

if TYPE_CHECKING:
    import pyarrow.parquet as pq

MAGIC: Final = b"PAR1"
UNIT_KEY: Final = b"unit"
EPOCH_KEY: Final = b"levelhead.epoch"
"""Table metadata: ``meta["epoch"]`` of the log that was written."""
EARTH_KEY: Final = b"levelhead.earth_rotation"
"""Table metadata: "false" in a simulated log whose Earth stands still."""
FRAMES_KEY: Final = b"levelhead.frames"
"""Table metadata: `FRAMES` where whoever wrote the log knew that its axes and velocities are these."""
FRAMES: Final = "FRD, NED"
TEXT_KEYS: Final = {
    "datum": b"datum",
    "height": b"height",
    "gnss_time_scale": b"levelhead.gnss_time_scale",
    "compensated": b"levelhead.compensated",
    "corrected_by": b"levelhead.corrected_by",
}
"""Entries of `Log.meta` that are text, and the table metadata that keep them; who writes a log may declare the first
two (see `levelhead.logs.datum`)."""
MAX_VALUES: Final = 500_000_000
"""Numbers that are read at most (4 GB): more is a mistake or an attack."""
MAX_ROWS_PER_BYTE: Final = 20
"""No advancing time stamps compress so well: a file that claims more rows is a decompression bomb."""
MAX_PACKED_VALUES: Final = 20_000_000
"""Numbers (160 MB) up to which a file may be packed so well, or nearly."""
MAX_UNPACKED_PER_BYTE: Final = 100
MAX_GROUPS: Final = 100_000

MAX_REASON: Final = 200
"""Characters of the library's own words that an error shows at most."""


def sniff(_path: Path, head: bytes) -> bool:
    """Return whether the file begins with Parquet's magic bytes."""
    return head.startswith(MAGIC)


def read(source: Source) -> Pieces:
    """Read a canonical Parquet log, or the GNSS columns of one.

    Raises
    ------
    LogError
        Naming file, row and column of what is wrong.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    path = source.path
    try:
        # Checksums of pages, where the file has them: our own has.
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            return _read(source, file)
    except (pa.ArrowException, OSError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0].rstrip(".")[:MAX_REASON]
        raise LogError(
            f"{path.name}: the Parquet file is damaged or cut short ({reason}). Its index stands at the end, so that "
            "nothing can be saved of a cut one; copy or export it again."
        ) from error


def _read(source: Source, file: pq.ParquetFile) -> Pieces:
    import pyarrow as pa

    name = source.path.name
    schema = file.schema_arrow
    rows = file.metadata.num_rows
    units = [_decoded((schema.field(k).metadata or {}).get(UNIT_KEY)) for k in range(len(schema.names))]
    columns = find_columns(name, schema.names, units, role=source.role)
    _check_size(name, file.metadata, len(columns), source.path.stat().st_size)
    for column, found in columns.items():
        kind = schema.field(found.index).type
        if not _is_numeric(kind):
            raise LogError(f"{name}: the column {column} is of type {kind}; store numbers (float64).")
    meta = _meta(name, schema.metadata or {})
    # One column at a time: the whole table beside its copies would double what a long log needs. One thread: Arrow's
    # pool sometimes aborts a short process at its exit (apache/arrow#34314).
    scaled: dict[str, FloatArray] = {}
    for column, found in columns.items():
        data = file.read(columns=[schema.names[found.index]], use_threads=False).column(0)
        if len(data) != rows:
            raise LogError(
                f"{name}: the column {column} has {len(data)} rows where {rows} are declared; the file is damaged, "
                "copy or export it again."
            )
        values = data.cast("float64").to_numpy()
        scaled[column] = values if found.factor == 1.0 else values * found.factor
    scale = columns[TIME_COLUMN].time_scale
    pieces = pieces_from_table(Table(name=name, columns=scaled, where=lambda row: f"row {row + 1}", time_scale=scale))
    scaled.clear()
    pa.default_memory_pool().release_unused()
    assumed = assumed_facts(columns, frames_declared=_decoded((schema.metadata or {}).get(FRAMES_KEY)) == FRAMES)
    compensated = _decoded((schema.metadata or {}).get(TEXT_KEYS["compensated"])) or ""
    return replace(pieces, meta=meta, assumed=assumed, compensated=compensated)


def _check_size(name: str, metadata: pq.FileMetaData, columns: int, size: int) -> None:
    """Refuse what would take more memory than a log of this size can need.

    Few bytes that unpack to many values are fine while these are few enough; noise, of which readings consist, does not
    pack to less than a byte for a whole row.
    """
    rows = metadata.num_rows
    groups = [metadata.row_group(k) for k in range(min(metadata.num_row_groups, MAX_GROUPS + 1))]
    unpacked = sum(group.total_byte_size for group in groups)
    many = rows * columns > MAX_PACKED_VALUES and rows > size
    bomb = many or rows > MAX_ROWS_PER_BYTE * size or unpacked > MAX_UNPACKED_PER_BYTE * size + MAX_PACKED_VALUES * 8
    if bomb or rows * columns > MAX_VALUES or len(groups) > MAX_GROUPS:
        raise LogError(
            f"{name}: the file claims {rows} rows in {size} bytes, which no log does or which is too much to read at "
            "once; split it if it is real."
        )


def _meta(name: str, metadata: Mapping[bytes, bytes]) -> dict[str, object]:
    """Return what the table's metadata say of the log."""
    epoch = _decoded(metadata.get(EPOCH_KEY))
    meta: dict[str, object] = {} if epoch is None else {"epoch": _epoch(name, epoch)}
    if _decoded(metadata.get(EARTH_KEY)) == "false":
        meta["earth_rotation"] = False
    text = {entry: _decoded(metadata[key]) for entry, key in TEXT_KEYS.items() if key in metadata}
    if text.get("gnss_time_scale", TIME_SCALES[0]) not in TIME_SCALES:
        raise LogError(
            f"{name}: the metadata levelhead.gnss_time_scale is {shown(str(text['gnss_time_scale']))}; it must be one "
            f"of {', '.join(TIME_SCALES)}."
        )
    meta |= {entry: text[entry] for entry in ("gnss_time_scale", "corrected_by") if entry in text}
    return {**meta, **declared(name, datum=text.get(DATUM_KEY), height=text.get(HEIGHT_KEY))}


def _is_numeric(kind: object) -> bool:
    import pyarrow as pa

    return bool(pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_null(kind))


def _decoded(value: bytes | None) -> str | None:
    return None if value is None else value.decode("utf-8", errors="replace")


def _epoch(name: str, text: str) -> float:
    try:
        epoch = float(text)
    except ValueError:
        epoch = math.nan
    if not math.isfinite(epoch):
        raise LogError(f"{name}: the metadata levelhead.epoch is {shown(text)}; it must be a number of seconds.")
    return epoch


READER: Final = Reader(name="parquet", title="canonical Parquet", sniff=sniff, read=read)
