"""What a canonical file says itself, what only our rules say of it, and what is left of that when files are joined."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import levelhead as lh
from levelhead.logs.readers import read
from levelhead.logs.readers.columns import find_columns
from levelhead.logs.writers import write, write_table
from samples.drive import sample_drive

NAMES = ["time", "gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z", "vel_n", "vel_e", "vel_d"]
UNITS = ["s", *["deg/s"] * 3, *["g"] * 3, *["m/s"] * 3]
ALL = ("gyro_unit", "accel_unit", "axes", "velocity_frame")


def rows() -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    time = np.arange(40) / 10.0
    velocity = np.where(np.arange(40)[:, None] % 2 == 0, 1.0, np.nan)
    return np.column_stack((time, np.zeros((40, 5)), -np.ones(40), velocity, velocity, velocity))


def csv(path: Path, header: list[str], *, columns: slice = slice(None)) -> Path:
    lines = [",".join(header[columns])]
    lines += [",".join("" if np.isnan(v) else repr(float(v)) for v in row[columns]) for row in rows()]
    path.write_text("\n".join(lines) + "\n")
    return path


def test_columns_without_units_follow_our_rules(tmp_path: Path) -> None:
    log = read(csv(tmp_path / "plain.csv", NAMES))
    assert log.meta["assumed"] == ALL
    assert "undeclared" not in log.meta


def test_units_in_the_header_are_declared(tmp_path: Path) -> None:
    header = [f"{name}[{unit}]" for name, unit in zip(NAMES, UNITS, strict=True)]
    log = read(csv(tmp_path / "units.csv", header))
    assert log.meta["assumed"] == ("axes", "velocity_frame")
    np.testing.assert_allclose(log.accel[:, 2], -9.80665)
    header[4:7] = NAMES[4:7]
    assert read(csv(tmp_path / "half.csv", header)).meta["assumed"] == ("accel_unit", "axes", "velocity_frame")
    header[2] = "gyro_y"  # one of three is enough to leave it open
    assert "gyro_unit" in read(csv(tmp_path / "one.csv", header)).meta["assumed"]  # type: ignore[operator]


def test_every_column_says_whether_its_unit_was_declared() -> None:
    columns = find_columns("x", NAMES, [None, *["rad/s"] * 3, *[None] * 6], role="imu")
    assert {name for name, column in columns.items() if column.declared} == {"gyro_x", "gyro_y", "gyro_z"}


def test_two_files_assume_what_either_assumes(tmp_path: Path) -> None:
    imu = csv(tmp_path / "imu.csv", NAMES, columns=slice(0, 7))
    gnss = tmp_path / "gnss.csv"
    gnss.write_text("time,vel_n[m/s],vel_e[m/s],vel_d[m/s]\n" + "".join(f"{k},1,0,0\n" for k in range(4)))
    assert read(imu, gnss=gnss).meta["assumed"] == ALL
    positions = tmp_path / "positions.csv"
    positions.write_text("time,lat,lon,height\n" + "".join(f"{k},45,{7 + 1e-5 * k},100\n" for k in range(4)))
    # Latitude and longitude have no frame that anybody could have taken for another.
    assert read(imu, gnss=positions).meta["assumed"] == ("gyro_unit", "accel_unit", "axes")


def test_parquet_with_units_in_its_fields_declares_them(tmp_path: Path) -> None:
    columns = dict(zip(NAMES, rows().T, strict=True))
    path = tmp_path / "units.parquet"
    write_table(columns, dict(zip(NAMES, UNITS, strict=True)), path)
    assert read(path).meta["assumed"] == ("axes", "velocity_frame")
    pq.write_table(pa.table(columns), tmp_path / "bare.parquet")
    assert read(tmp_path / "bare.parquet").meta["assumed"] == ALL


@pytest.mark.parametrize(
    ("meta", "assumed"),
    [
        ({}, None),  # made by hand: a `Log` is FRD and NED
        ({"assumed": ("axes",)}, ("axes", "velocity_frame")),
        ({"undeclared": ("axes", "clock")}, ("axes", "velocity_frame")),
        ({"undeclared": ("axes",), "preflight": {"findings": []}}, None),
    ],
)
def test_what_we_write_declares_its_frames_only_where_they_are_known(
    meta: dict[str, object], assumed: tuple[str, ...] | None, tmp_path: Path
) -> None:
    path = tmp_path / "log.parquet"
    write(replace(sample_drive(), meta=meta), path)
    assert read(path).meta.get("assumed") == assumed


def test_a_checked_log_that_was_written_is_taken_at_its_word(tmp_path: Path) -> None:
    log = lh.simulate("windrower", seed=1, duration=120.0, speed=7.0)[0]
    assumed = replace(log, gyro=np.degrees(log.gyro), meta={"assumed": ALL})
    found = lh.check(assumed)
    assert found.refused == ()
    write(found.trusted(), tmp_path / "checked.parquet")
    back = read(tmp_path / "checked.parquet")
    assert "assumed" not in back.meta
    np.testing.assert_array_equal(back.gyro, found.log.gyro)
    # And so it is held to it.
    wrong = lh.check(replace(back, gyro=np.degrees(back.gyro)))
    assert [f.name for f in wrong.refused] == ["gyro unit"]
