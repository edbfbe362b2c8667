"""ROS 1 bags: whole, packed, cut, never closed, broken in the middle."""

from __future__ import annotations

import struct
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Reader as LibraryReader
from rosbags.typesys import Stores, get_typestore

from hostile.cases import beginnings, mutations
from levelhead.errors import LogError
from levelhead.logs.readers import read
from levelhead.logs.readers.base import Source
from levelhead.logs.readers.ros1_bag import READER
from samples import ros1_bag
from samples.drive import EPOCH_UTC_S, sample_drive
from samples.refusal import read_or_refusal
from samples.ros_drive import assert_is_the_drive


@pytest.mark.parametrize("compression", [None, "BZ2", "LZ4"])
def test_the_drive_comes_back(tmp_path: Path, compression: str | None) -> None:
    log = read(ros1_bag.write_messages(tmp_path / "drive.bag", ros1_bag.MAKER.drive(), compression))
    assert_is_the_drive(log)
    assert log.events == ()
    assert log.meta["completeness"] == "complete"
    assert log.meta["format"] == "ros1-bag"
    assert log.meta["epoch"] == EPOCH_UTC_S
    assert log.meta["gnss_time_scale"] == "UTC"
    assert (log.meta["datum"], log.meta["height"]) == ("WGS84", "ellipsoidal")
    assert log.meta["undeclared"] == ("axes", "velocity_frame")
    streams = log.meta["streams"]
    assert isinstance(streams, tuple)
    assert [(s.kind, s.name, s.samples) for s in streams] == [("imu", "/imu/data", 1500), ("gnss", "/gps/fix", 150)]


def test_the_sample_is_the_same_every_time(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    assert ros1_bag.write(tmp_path).read_bytes() == ros1_bag.write(tmp_path / "a").read_bytes()


def test_a_real_robot(data_folder: Path) -> None:
    path = data_folder / "formats" / "husky_test1.bag"
    log = read(path)
    # 30 Hz and 2.5 Hz as its readme says; the message counts are those of the index.
    assert (log.time.size, log.gnss_time.size) == (11865, 989)
    assert log.describe()["imu_rate_hz"] == pytest.approx(30.0, rel=0.01)
    assert log.describe()["gnss_rate_hz"] == pytest.approx(2.5, rel=0.01)
    # Gravity is on +y of the IMU, so on -y of what FLU would be turned to; the preflight finds that.
    assert log.accel.mean(axis=0) == pytest.approx([0.0, -9.8, 0.0], abs=0.3)
    assert "axes" in str(log.meta["undeclared"])
    assert log.wheel_speed is not None
    # 3952 messages of odometry at 10 Hz, of which two fall to one IMU sample once.
    assert int(np.isfinite(log.wheel_speed).sum()) == 3951
    assert 0.9 < np.nanmax(log.wheel_speed) < 1.1  # m/s: what a Husky does
    assert log.velocity_ned is None
    assert log.events == ()


def test_the_numbers_of_a_real_robot_are_those_of_the_library(data_folder: Path) -> None:
    path = data_folder / "formats" / "husky_test1.bag"
    pieces = READER.read(Source(path=path))
    assert pieces.imu is not None
    store = get_typestore(Stores.ROS1_NOETIC)
    expected = []
    with LibraryReader(path) as reader:
        for connection, _, raw in reader.messages([c for c in reader.connections if c.topic == "/imu/data"]):
            message: Any = store.deserialize_ros1(raw, connection.msgtype)
            rate, force = message.angular_velocity, message.linear_acceleration
            expected.append([rate.x, -rate.y, -rate.z, force.x, -force.y, -force.z])
    np.testing.assert_array_equal(np.hstack((pieces.imu.gyro, pieces.imu.accel)), expected)


@pytest.mark.parametrize("compression", [None, "LZ4"])
def test_a_cut_bag_gives_what_is_there(tmp_path: Path, compression: str | None) -> None:
    whole = ros1_bag.write_messages(tmp_path / "drive.bag", ros1_bag.MAKER.drive(), compression).read_bytes()
    path, counts = tmp_path / "cut.bag", []
    for content in beginnings(whole, 100):
        path.write_bytes(content)
        log = read_or_refusal(path)
        counts.append(0 if log is None else log.time.size)
        if log is not None:
            assert log.meta["completeness"] == "truncated", len(content)
            assert_is_the_drive(log, samples=log.time.size)
    assert counts == sorted(counts)
    assert counts[-1] == 1500
    assert sum(c > 0 for c in counts) > 80  # of 101


def test_a_bag_that_was_never_closed_is_read(tmp_path: Path) -> None:
    path = ros1_bag.write(tmp_path)
    whole = path.read_bytes()
    (index_pos,) = struct.unpack_from("<Q", whole, whole.index(b"index_pos=") + 10)
    # As rosbag leaves it: chunks, and a header that knows of none.
    active = whole[:index_pos].replace(b"index_pos=" + struct.pack("<Q", index_pos), b"index_pos=" + bytes(8))
    path = tmp_path / "drive.bag.active"
    path.write_bytes(active)
    log = read(path)
    assert_is_the_drive(log)
    assert log.meta["completeness"] == "truncated"


def test_mutated_bags_are_read_or_refused(tmp_path: Path) -> None:
    path = tmp_path / "changed.bag"
    whole = ros1_bag.write(tmp_path).read_bytes()
    logs = []
    for content in mutations(whole, 200, seed=11):
        path.write_bytes(content)
        logs.append(read_or_refusal(path))
    # Most are changed in a number, or lose one message: that is not the end of the drive.
    assert sum(log is not None and log.time.size > 1400 for log in logs) > 150


def test_behind_a_broken_place_the_next_record_is_found(tmp_path: Path) -> None:
    path = ros1_bag.write_messages(tmp_path / "drive.bag", ros1_bag.MAKER.drive())
    whole = bytearray(path.read_bytes())
    whole[200_000:200_100] = bytes(100)
    path.write_bytes(whole)
    log = read(path)
    # One message in the block, or two where it lies over their boundary.
    assert 1500 + 150 - 3 <= log.time.size + log.gnss_time.size < 1500 + 150 + 1
    assert log.meta["completeness"] == "malformed_record"
    (event,) = [e for e in log.events if e.code == "W_DAMAGED"]
    assert "drive.bag: at byte" in event.text


@pytest.mark.parametrize("compression", [None, "LZ4"])
def test_a_broken_chunk_does_not_take_the_next_with_it(tmp_path: Path, compression: str | None) -> None:
    path = ros1_bag.write_messages(tmp_path / "drive.bag", ros1_bag.MAKER.drive(), compression, chunk=1 << 16)
    whole = bytearray(path.read_bytes())
    second = whole.index(b"compression=", whole.index(b"compression=") + 1)
    whole[second - 60 : second + 40] = bytes(100)
    path.write_bytes(whole)
    log = read(path)
    assert log.meta["completeness"] == "malformed_record"
    # A chunk has 1/11 of the bag.
    assert 1500 * 9 // 11 < log.time.size < 1500
    assert log.time[-1] == pytest.approx(sample_drive().time[-1])


def test_a_bomb_is_not_unpacked(tmp_path: Path) -> None:
    path = ros1_bag.write_messages(tmp_path / "drive.bag", ros1_bag.MAKER.drive(), "LZ4")
    whole = path.read_bytes()
    at = whole.index(b"size=", whole.index(b"compression=")) + 5
    path.write_bytes(whole[:at] + b"\xff\xff\xff\xff" + whole[at + 4 :])
    begin = time.perf_counter()
    with pytest.raises(LogError, match=r"drive\.bag"):
        read(path)
    assert time.perf_counter() - begin < 2.0


def test_a_message_that_went_to_another_topic_is_missed(tmp_path: Path) -> None:
    path = ros1_bag.write(tmp_path)
    whole = path.read_bytes()
    topics = {t: whole.rindex(b"topic=" + t) for t in (b"/imu/data", b"/chatter")}
    imu, chatter = (whole.rindex(b"conn=", 0, at) + 5 for at in topics.values())
    message = whole.index(b"op=\x02")
    at = whole.rindex(b"conn=" + whole[imu : imu + 4], 0, message + 60) + 5
    path.write_bytes(whole[:at] + whole[chatter : chatter + 4] + whole[at + 4 :])
    log = read(path)
    assert log.time.size == 1499
    assert log.meta["completeness"] == "malformed_record"
    assert any("its index counts 1950 messages" in event.text for event in log.events)


@pytest.mark.parametrize("compression", ["BZ2", "LZ4"])
@pytest.mark.parametrize("more", [-1000, 1000])
def test_a_chunk_that_is_not_as_long_as_it_says_is_told_of(tmp_path: Path, compression: str, more: int) -> None:
    path = ros1_bag.write_messages(tmp_path / "drive.bag", ros1_bag.MAKER.drive(), compression)
    whole = path.read_bytes()
    at = whole.index(b"size=", whole.index(b"compression=")) + 5
    (size,) = struct.unpack_from("<I", whole, at)
    path.write_bytes(whole[:at] + struct.pack("<I", size + more) + whole[at + 4 :])
    log = read(path)
    assert log.meta["completeness"] == "malformed_record"
    assert log.time.size > 1490
    np.testing.assert_array_equal(log.gyro, sample_drive().gyro[: log.time.size])


def test_what_is_no_such_bag_is_named(tmp_path: Path) -> None:
    path = tmp_path / "old.bag"
    path.write_bytes(b"#ROSBAG V1.2\n" + bytes(100))
    with pytest.raises(LogError, match=r"old\.bag is a bag of another version than 2\.0"):
        read(path)
    path.write_bytes(b"#ROSBAG V2.0\n")
    with pytest.raises(LogError, match="no messages of the types sensor_msgs/Imu or sensor_msgs/NavSatFix"):
        read(path)


def test_a_topic_with_other_fields_than_its_type_is_not_used(tmp_path: Path) -> None:
    path = ros1_bag.write(tmp_path)
    whole = path.read_bytes()
    path.write_bytes(whole.replace(b"md5sum=2d3a8cd499b9b4a0249fb98fd05cfa48", b"md5sum=" + b"0" * 32))
    log = read(path)
    assert log.position_llh is None
    assert any("/gps/fix: the file declares other fields than sensor_msgs/NavSatFix" in e.text for e in log.events)
