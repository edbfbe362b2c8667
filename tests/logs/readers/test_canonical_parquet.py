"""The canonical Parquet log: units in names or metadata, types, damaged files."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from levelhead.errors import LogError
from levelhead.logs.log import Log
from levelhead.logs.readers import read
from levelhead.logs.writers import write

NAMES = ("time", "gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z", "vel_n", "vel_e", "vel_d")


def table(**changes: object) -> pa.Table:
    """Three rows of small numbers; `changes` replaces columns."""
    columns: dict[str, object] = {name: [1.0, 2.0, 3.0] for name in NAMES}
    columns.update(changes)
    return pa.table(columns)


def save(tmp_path: Path, content: pa.Table) -> Path:
    path = tmp_path / "a.parquet"
    pq.write_table(content, path)
    return path


def test_units_stand_in_the_name_or_in_the_metadata(tmp_path: Path) -> None:
    content = table()
    fields = [content.schema.field(name) for name in NAMES]
    fields[1] = pa.field("gyro_x[deg/s]", pa.float64())
    fields[2] = pa.field("gyro_y", pa.float64(), metadata={b"unit": b"mrad/s"})
    log = read(save(tmp_path, pa.table(content.columns, schema=pa.schema(fields))))
    np.testing.assert_allclose(log.gyro[0], [np.pi / 180.0, 1e-3, 1.0], rtol=1e-15)  # one rounding


def test_integers_single_precision_and_nulls_are_numbers_too(tmp_path: Path) -> None:
    content = table(
        time=pa.array([0, 1, 2], pa.int32()),
        gyro_x=pa.array([0.5, 0.25, 0.125], pa.float32()),
        **{name: pa.array([None, 4, None], pa.int64()) for name in ("vel_n", "vel_e", "vel_d")},
    )
    log = read(save(tmp_path, content))
    np.testing.assert_array_equal(log.gyro[:, 0], [0.5, 0.25, 0.125])
    np.testing.assert_array_equal(log.gnss_time, [1.0])


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (table(gyro_x=["a", "b", "c"]), "a.parquet: the column gyro_x is of type string; store numbers (float64)."),
        (table(gyro_x=[1.0, None, 1.0]), "a.parquet, row 2: gyro_x is empty where the other readings"),
        (table().drop_columns("accel_z"), "a.parquet: the column accel_z is missing"),
        (table().append_column("gyro_x", [[1.0, 2.0, 3.0]]), "a.parquet: the column gyro_x appears twice"),
        (table().slice(0, 0), "a.parquet: the file has a header but no rows"),
        (
            table().replace_schema_metadata({b"levelhead.epoch": b"noon"}),
            "a.parquet: the metadata levelhead.epoch is 'noon'",
        ),
    ],
)
def test_a_mistake_is_named_with_its_row(tmp_path: Path, content: pa.Table, sentence: str) -> None:
    with pytest.raises(LogError, match=re.escape(sentence)):
        read(save(tmp_path, content))


def test_a_cut_or_damaged_file_is_a_sentence(drive: Log, tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    write(drive, path)
    content = path.read_bytes()
    for length in (4, 100, len(content) // 2, len(content) - 1):
        path.write_bytes(content[:length])
        with pytest.raises(LogError, match=r"a\.parquet: the Parquet file is damaged or cut short"):
            read(path)
    path.write_bytes(content[:4] + bytes(len(content) - 12) + content[-8:])
    with pytest.raises(LogError, match="damaged or cut short"):
        read(path)


def test_a_file_that_would_fill_the_memory_is_refused_unread(tmp_path: Path) -> None:
    rows = 2_000_000
    same = pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, dtype=np.int8)), pa.array([1.0]))
    path = save(tmp_path, pa.table(dict.fromkeys(NAMES, same)))
    assert path.stat().st_size < 100_000
    with pytest.raises(LogError, match=r"the file claims 2000000 rows in \d+ bytes, which no log does"):
        read(path)
