"""ROS 2 bags: folders of SQLite and MCAP files, and single SQLite files; cut, with parts missing, made to mislead."""

from __future__ import annotations

import shutil
import sqlite3
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from hostile.cases import beginnings, mutations
from levelhead.errors import LogError
from levelhead.logs.readers import read
from samples import mcap, ros2_bag
from samples.drive import EPOCH_UTC_S, sample_drive
from samples.refusal import read_or_refusal
from samples.ros_drive import assert_is_the_drive


@pytest.mark.parametrize(
    ("storage", "compression"),
    [
        (StoragePlugin.SQLITE3, CompressionMode.NONE),
        (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
        (StoragePlugin.MCAP, CompressionMode.NONE),
        (StoragePlugin.MCAP, CompressionMode.STORAGE),
    ],
)
def test_the_drive_comes_back(tmp_path: Path, storage: StoragePlugin, compression: CompressionMode) -> None:
    folder = ros2_bag.write_messages(tmp_path / "drive", ros2_bag.MAKER.drive(), storage, compression)
    log = read(folder)
    assert_is_the_drive(log)
    assert log.events == ()
    assert log.meta["completeness"] == "complete"
    assert log.meta["format"] == "ros2-bag"
    assert log.meta["source"] == "drive"
    assert log.meta["undeclared"] == ("axes", "velocity_frame")


def test_the_sample_is_the_same_every_time(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    one, two = (ros2_bag.write(folder) for folder in (tmp_path, tmp_path / "a"))
    for name in ("drive.db3", "metadata.yaml"):
        assert (one / name).read_bytes() == (two / name).read_bytes()


def test_one_file_is_enough(tmp_path: Path) -> None:
    path = (ros2_bag.write(tmp_path) / "drive.db3").rename(tmp_path / "anything")
    log = read(path)
    assert_is_the_drive(log)
    assert [p.name for p in tmp_path.iterdir() if p.is_file()] == ["anything"]  # nothing was written beside it


def halves(tmp_path: Path, storage: StoragePlugin = StoragePlugin.SQLITE3) -> Path:
    """Write the drive as a recorder that splits its files does."""
    folder, suffix = tmp_path / "split", ".db3" if storage == StoragePlugin.SQLITE3 else ".mcap"
    folder.mkdir()
    messages = list(ros2_bag.MAKER.drive())
    for number, part in enumerate((messages[:1000], messages[1000:])):
        part_folder = ros2_bag.write_messages(tmp_path / f"part{number}", part, storage)
        shutil.move(part_folder / f"part{number}{suffix}", folder / f"split_{number}{suffix}")
    names = "".join(f"  - split_{number}{suffix}\n" for number in range(2))
    (folder / "metadata.yaml").write_text(
        f"rosbag2_bagfile_information:\n  version: 9\n  relative_file_paths:\n{names}"
    )
    return folder


@pytest.mark.parametrize("storage", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_the_files_of_a_split_recording_are_one_log(tmp_path: Path, storage: StoragePlugin) -> None:
    folder = halves(tmp_path, storage)
    assert_is_the_drive(read(folder))
    (folder / "metadata.yaml").unlink()  # as after a crash of the recorder
    assert_is_the_drive(read(folder))


def test_a_missing_file_is_told(tmp_path: Path) -> None:
    folder = halves(tmp_path)
    (folder / "split_1.db3").unlink()
    log = read(folder)
    assert log.meta["completeness"] == "malformed_record"
    assert any("the file split_1.db3 is missing" in event.text for event in log.events)
    (folder / "split_0.db3").rename(folder / "else.db3")
    with pytest.raises(LogError, match=r"none of the files that metadata\.yaml names is there"):
        read(folder)


def test_no_path_is_taken_from_the_metadata(tmp_path: Path) -> None:
    folder = halves(tmp_path)
    outside = (folder / "split_0.db3").rename(tmp_path / "split_0.db3")
    text = (folder / "metadata.yaml").read_text()
    (folder / "metadata.yaml").write_text(text.replace("- split_0.db3", f"- {outside}"))
    log = read(folder)
    assert log.time[-1] < 29.0  # the second half alone
    assert any("the file split_0.db3 is missing" in event.text for event in log.events)


def test_several_recordings_in_a_folder_are_not_mixed(tmp_path: Path) -> None:
    folder = halves(tmp_path)
    (folder / "metadata.yaml").unlink()
    (folder / "split_0.db3").rename(folder / "other_0.db3")
    with pytest.raises(LogError, match=r"split holds several recordings and no metadata\.yaml"):
        read(folder)


def test_files_that_are_compressed_as_a_whole_are_named(tmp_path: Path) -> None:
    folder = halves(tmp_path)
    text = (folder / "metadata.yaml").read_text()
    (folder / "metadata.yaml").write_text(text.replace(".db3", ".db3.zstd"))
    with pytest.raises(LogError, match=r"unpack the compressed files \(zstd -d split_0\.db3\.zstd\)"):
        read(folder)


def test_messages_that_are_not_yet_in_the_file_are_told_of(tmp_path: Path) -> None:
    folder = ros2_bag.write(tmp_path)
    (folder / "drive.db3-wal").write_bytes(b"not empty")
    log = read(folder)
    assert log.meta["completeness"] == "malformed_record"
    assert any("drive.db3-wal holds what is not yet in the file" in event.text for event in log.events)


def test_a_cut_database_gives_what_is_there(tmp_path: Path) -> None:
    whole, path, counts = (ros2_bag.write(tmp_path) / "drive.db3").read_bytes(), tmp_path / "cut.db3", []
    drive = sample_drive()
    for content in beginnings(whole, 100):
        path.write_bytes(content)
        log = read_or_refusal(path)
        counts.append(0 if log is None else log.time.size)
        if log is not None:
            assert log.meta["completeness"] == "truncated", len(content)
            # Rows on a page that is not whole are left out, and they need not be the last.
            rows = np.round((log.time + float(str(log.meta["epoch"])) - EPOCH_UTC_S) * 50.0).astype(int)
            np.testing.assert_array_equal(log.gyro, drive.gyro[rows])
            np.testing.assert_array_equal(log.accel, drive.accel[rows])
    # A page holds eleven messages.
    assert (np.diff(counts) >= -11).all()
    assert sum(c > 0 for c in counts) > 90  # of 101


def test_mutated_databases_are_read_or_refused(tmp_path: Path) -> None:
    whole, path = (ros2_bag.write(tmp_path) / "drive.db3").read_bytes(), tmp_path / "changed.db3"
    for content in mutations(whole, 200, seed=14):
        path.write_bytes(content)
        read_or_refusal(path)


def database(path: Path, *statements: str) -> Path:
    with closing(sqlite3.connect(path)) as made:
        for statement in statements:
            made.execute(statement)
        made.commit()
    return path


TOPICS = "CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)"
MESSAGES = "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"
AN_IMU = "INSERT INTO topics VALUES (1, '/imu', 'sensor_msgs/msg/Imu', 'cdr')"
ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i, 1 AS topic_id, i, '' FROM n"


@pytest.mark.parametrize(
    "statements",
    [
        (TOPICS, f"CREATE VIEW messages AS {ENDLESS}", AN_IMU),
        ("CREATE TABLE messages (id)", "CREATE TABLE other (topics)"),
        (
            TOPICS,
            MESSAGES,
            AN_IMU,
            "INSERT INTO messages VALUES (1, 1, 'x', 7)",
            "INSERT INTO messages VALUES (2, 1, 5, 'y')",
        ),
        (TOPICS, MESSAGES, AN_IMU, "INSERT INTO messages VALUES (1, 1, 5, zeroblob(50000000))"),
    ],
)
def test_a_database_that_is_made_to_mislead_is_refused_soon(tmp_path: Path, statements: tuple[str, ...]) -> None:
    path = database(tmp_path / "a.db3", *statements)
    begin = time.perf_counter()
    with pytest.raises(LogError, match=r"a\.db3"):
        read(path)
    assert time.perf_counter() - begin < 2.0


def test_folders_without_a_bag_are_none(tmp_path: Path) -> None:
    (tmp_path / "metadata.yaml").write_text("something: else\n")
    with pytest.raises(LogError, match="is a directory, and no log in a known layout"):
        read(tmp_path)
    mcap.write(tmp_path)
    assert_is_the_drive(read(tmp_path))
