"""CSV of nothing but numbers: what each column is shows in what is in it, or the file is refused."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from levelhead.conventions import FloatArray
from levelhead.errors import LogError
from levelhead.logs.readers import read
from samples import plain_csv
from samples.drive import sample_drive

MAPPING = Path(__file__).parents[3] / "examples" / "mappings" / "rtklib-gnss-imu.toml"

Change = Callable[[FloatArray], FloatArray]


def test_the_drive_comes_back(tmp_path: Path) -> None:
    log, drive = read(plain_csv.write(tmp_path), gnss=plain_csv.write_gnss(tmp_path)), sample_drive()
    assert log.meta["format"] == "plain-csv"
    assert log.meta["undeclared"] == ("gyro_unit", "accel_unit", "axes", "clock")
    np.testing.assert_allclose(log.time - 5.0, drive.time, atol=5e-4)  # whole milliseconds
    # As they stand, in g and deg/s: half of 1e-6.
    np.testing.assert_allclose(log.accel, drive.accel / 9.80665, atol=5e-7)
    np.testing.assert_allclose(log.gyro, np.degrees(drive.gyro), atol=5e-7)


def test_the_recorded_drive_is_read_as_through_its_mapping(data_folder: Path) -> None:
    folder = data_folder / "rtklib-drive"
    log = read(folder / "imu_1934.csv")
    assert log.meta["format"] == "plain-csv"
    assert log.meta["gnss_source"] == "gnss_1934_sf.pos"
    assert log.meta["undeclared"] == ("gyro_unit", "accel_unit", "axes", "clock")
    mapped = read(folder / "imu_1934.csv", gnss=folder / "gnss_1934_sf.pos", mapping=MAPPING)
    assert log.time.size == mapped.time.size == 54860
    np.testing.assert_allclose(log.time, mapped.time, atol=1e-6)
    # The mapping takes 0.125 s off; its zero was computed from the same tags, and is written to a millisecond.
    assert isinstance(log.meta["epoch"], float)
    assert isinstance(mapped.meta["epoch"], float)
    assert log.meta["epoch"] - mapped.meta["epoch"] == pytest.approx(0.125, abs=0.002)
    rest = log.slice(log.time[-1] - 10.0, np.inf)
    # In g and with z upwards, as the data's notes say; 0.1 g of tilt.
    np.testing.assert_allclose(rest.accel.mean(axis=0), [0.0, 0.0, 1.0], atol=0.15)


def test_time_tags_of_another_file_are_not_believed(data_folder: Path, tmp_path: Path) -> None:
    folder = data_folder / "rtklib-drive"
    content = (folder / "imu_1934.csv").read_bytes()
    (tmp_path / "imu.csv").write_bytes(content[len(content) // 2 :])
    shutil.copy(folder / "imu_1934.csv.tag", tmp_path / "imu.csv.tag")
    gnss = tmp_path / "fixes.csv"
    gnss.write_text("time,vel_n,vel_e,vel_d\n600,1,2,3\n601,1,2,3\n")
    log = read(tmp_path / "imu.csv", gnss=gnss)
    assert log.meta["completeness"] == "truncated"  # it begins with half a line
    assert log.meta["undeclared"] == ("gyro_unit", "accel_unit", "axes", "clock")
    assert any(e.code == "W_DROPPED" and "imu.csv.tag" in e.detail for e in log.events)


@pytest.mark.parametrize("damage", [0, 50, 70, 79, 80])
def test_damaged_time_tags_are_not_believed(tmp_path: Path, damage: int) -> None:
    path = plain_csv.write(tmp_path)
    tag = b"TIMETAG RTKLIB demo5".ljust(64, b"\0") + bytes(12) + bytes(range(200))
    path.with_name(f"{path.name}.tag").write_bytes(tag[:damage] if damage else b"x" + tag)
    log = read(path, gnss=plain_csv.write_gnss(tmp_path))
    assert log.meta["undeclared"] == ("gyro_unit", "accel_unit", "axes", "clock")


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda t: np.column_stack((t[:, 3:6], t[:, 3:6], t[:, 6])), "beside the time .* no three are clearly the acc"),
        (lambda t: np.column_stack((t[:, :3], t[:, :3], t[:, 6])), "beside the time .* no three are clearly the accel"),
        # A magnetometer turns with the vehicle, but the field keeps its size.
        (
            lambda t: np.column_stack(
                (t[:, :3], 40.0 * np.cos(t[:, 6:] / 9e3), 40.0 * np.sin(t[:, 6:] / 9e3), t[:, 5:7])
            ),
            "beside the time .* no three are clearly the accel",
        ),
        (lambda t: np.column_stack((t[:, :6], t[:, 3])), "names no columns, and no column is the time"),
        (lambda t: np.column_stack((t[:, 6], t[:, :6], t[:, 6] / 1e3)), r"and 2 columns could be \(1, 8\) the time"),
        (
            lambda t: np.column_stack((t[:, :6], t[:, 6], t[:, :6])),
            "beside the time .* no three are clearly the acceleration",
        ),
    ],
)
def test_what_is_not_unique_is_refused(tmp_path: Path, change: Change, sentence: str) -> None:
    path = plain_csv.write(tmp_path)
    np.savetxt(path, change(np.loadtxt(path, delimiter=",")), delimiter=",", fmt="%.6f")
    with pytest.raises(LogError, match=f"numbers.csv: the header {'' if 'names' in sentence else '.*'}{sentence}"):
        read(path, gnss=plain_csv.write_gnss(tmp_path))


@pytest.mark.parametrize(
    "change",
    [
        lambda t: np.column_stack((t[:, 6], t[:, :6], 20.0 + 0.0 * t[:, :2])),  # time first, temperatures behind
        lambda t: np.column_stack((np.arange(len(t)), t[:, 6], t[:, :6])),  # a counter before the time
        lambda t: np.column_stack((t[:, 3:6], t[:, :3], t[:, 6])),  # gyros first
    ],
)
def test_other_orders_are_understood(tmp_path: Path, change: Change) -> None:
    path = plain_csv.write(tmp_path)
    np.savetxt(path, change(np.loadtxt(path, delimiter=",")), delimiter=",", fmt="%.6f")
    log = read(path, gnss=plain_csv.write_gnss(tmp_path))
    np.testing.assert_allclose(log.gyro, np.degrees(sample_drive().gyro), atol=5e-7)  # half of 1e-6


@pytest.mark.parametrize(
    ("order", "lost"), [(lambda t: t, 2), (lambda t: t, 3), (lambda t: np.column_stack((t[:, 6] + 2e6, t[:, :6])), 1)]
)
def test_a_first_number_that_lost_its_beginning_is_left_out(tmp_path: Path, order: Change, lost: int) -> None:
    path = plain_csv.write(tmp_path)
    table = np.loadtxt(path, delimiter=",")
    table[0, 0] = table[1:, 0].max()
    np.savetxt(path, order(table), delimiter=",", fmt="%.6f")
    gnss = tmp_path / "fixes.csv"
    gnss.write_text(f"time,vel_n,vel_e,vel_d\n{order(table)[50, 0 if lost == 1 else 6] / 1e3},1,2,3\n")
    assert read(path, gnss=gnss).meta["completeness"] == "complete"
    path.write_bytes(path.read_bytes()[lost:])
    log = read(path, gnss=gnss)
    assert log.meta["completeness"] == "truncated"
    np.testing.assert_array_equal(log.accel[0], table[1, :3])
