"""MCAP: whole, packed in each way, cut, with a wrong checksum, broken in the middle."""

from __future__ import annotations

import struct
import time
import zlib
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

from hostile.cases import beginnings, mutations
from levelhead.errors import LogError
from levelhead.logs import mcap_writer
from levelhead.logs.readers import mcap as reader
from levelhead.logs.readers import read
from levelhead.logs.writers import write
from samples import mcap, ros1_bag, ros2_bag
from samples.drive import sample_drive
from samples.refusal import read_or_refusal
from samples.ros_drive import assert_is_the_drive


def test_the_drive_comes_back(tmp_path: Path) -> None:
    log = read(mcap.write(tmp_path))
    assert_is_the_drive(log)
    assert log.events == ()
    assert log.meta["completeness"] == "complete"
    assert log.meta["format"] == "mcap"
    assert log.meta["undeclared"] == ("axes", "velocity_frame")


def test_the_sample_is_the_same_every_time(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    assert mcap.write(tmp_path).read_bytes() == mcap.write(tmp_path / "a").read_bytes()


def record(kind: int, content: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(content)) + content


def rewritten(
    tmp_path: Path, compression: str, *, crc: int | None = None, end: bool = True, ros1: bool = False
) -> Path:
    """Write the sample's messages in one chunk, or in none, without an index; ``ros1``: as a converted bag has them."""
    maker = ros1_bag.MAKER if ros1 else ros2_bag.MAKER
    serialize = maker.store.serialize_ros1 if ros1 else maker.store.serialize_cdr
    content = [record(reader.HEADER, struct.pack("<I4sI", 4, b"ros2", 0))]
    for number, (topic, kind) in enumerate({"/imu/data": "Imu", "/gps/fix": "NavSatFix"}.items(), 1):
        name = f"sensor_msgs/{kind}" if ros1 else f"sensor_msgs/msg/{kind}"
        definition = maker.store.generate_msgdef(f"sensor_msgs/msg/{kind}", ros_version=1 if ros1 else 2)[0]
        schema = (name, "ros1msg" if ros1 else "ros2msg", definition)
        texts = b"".join(struct.pack("<I", len(t)) + t.encode() for t in schema)
        content.append(record(reader.SCHEMA, struct.pack("<H", number) + texts))
        texts = b"".join(struct.pack("<I", len(t)) + t.encode() for t in (topic, "ros1" if ros1 else "cdr"))
        content.append(record(reader.CHANNEL, struct.pack("<HH", number, number) + texts + bytes(4)))
    messages = []
    for topic, kind, record_ns, message in maker.drive():
        if topic in ("/imu/data", "/gps/fix"):
            head = struct.pack("<HIQQ", 1 if topic == "/imu/data" else 2, 0, record_ns, record_ns)
            messages.append(record(reader.MESSAGE, head + bytes(serialize(message, kind))))
    plain = b"".join(messages)
    if compression == "no chunk":
        content.append(plain)
    else:
        import pyarrow as pa

        packed = pa.compress(plain, codec=compression, asbytes=True) if compression else plain
        label = compression.encode()
        head = struct.pack("<QQQI", 0, 0, len(plain), zlib.crc32(plain) if crc is None else crc)
        head += struct.pack("<I", len(label)) + label + struct.pack("<Q", len(packed))
        content.append(record(reader.CHUNK, head + packed))
    if end:
        content.append(record(reader.DATA_END, bytes(4)) + record(reader.FOOTER, bytes(20)) + reader.MAGIC)
    path = tmp_path / "drive.mcap"
    path.write_bytes(reader.MAGIC + b"".join(content))
    return path


@pytest.mark.parametrize("compression", ["no chunk", "", "lz4", "zstd"])
def test_chunks_of_each_kind_and_none_are_read(tmp_path: Path, compression: str) -> None:
    log = read(rewritten(tmp_path, compression))
    np.testing.assert_array_equal(log.gyro, sample_drive().gyro)
    assert log.gnss_time.size == 150
    assert log.meta["completeness"] == "complete"


def test_a_converted_bag_of_ros_1_is_read(tmp_path: Path) -> None:
    log = read(rewritten(tmp_path, "lz4", ros1=True))
    np.testing.assert_array_equal(log.gyro, sample_drive().gyro)
    assert log.gnss_time.size == 150
    assert log.meta["completeness"] == "complete"


@pytest.mark.parametrize("compression", ["no chunk", "", "lz4", "zstd"])
def test_a_file_without_its_end_is_read_and_marked(tmp_path: Path, compression: str) -> None:
    log = read(rewritten(tmp_path, compression, end=False))
    np.testing.assert_array_equal(log.gyro, sample_drive().gyro)
    assert log.meta["completeness"] == "truncated"


@pytest.mark.parametrize("compression", ["", "lz4", "zstd"])
def test_a_chunk_with_a_wrong_checksum_is_not_used(tmp_path: Path, compression: str) -> None:
    with pytest.raises(LogError, match=r"drive\.mcap has no messages .* damaged: .* the checksum of a chunk is wrong"):
        read(rewritten(tmp_path, compression, crc=1))
    # Zero is a checksum that was not taken.
    assert read(rewritten(tmp_path, compression, crc=0)).time.size == 1500


def chunked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Write the drive in fifteen chunks, with checksums and an index."""
    monkeypatch.setattr(mcap_writer, "CHUNK_SAMPLES", 100)
    path = tmp_path / "drive.mcap"
    write(sample_drive(), path)
    return path


def test_a_broken_chunk_does_not_take_the_next_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = chunked(tmp_path, monkeypatch)
    whole = path.read_bytes()
    third = [k for k in range(len(whole)) if whole.startswith(b"\x04\0\0\0zstd", k)][2]
    places = {
        "in its data": third + 500,
        "in its length": third - 36,
        "in its kind": third - 37,
        "in its size": third - 10,
    }
    for where, at in places.items():
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 0x55]) + whole[at + 1 :])
        log = read(path)
        # With a wrong length it is still whole, by its own checksum.
        assert log.time.size == (1500 if where == "in its length" else 1400), where
        assert log.time[-1] == sample_drive().time[-1], where
        assert log.meta["completeness"] == "malformed_record", where
        (event,) = [e for e in log.events if e.code == "W_DAMAGED"]
        assert "drive.mcap: at byte" in event.text, where


def test_a_cut_file_gives_what_is_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, counts = chunked(tmp_path, monkeypatch), []
    for content in beginnings(path.read_bytes(), 100):
        path.write_bytes(content)
        log = read_or_refusal(path)
        counts.append(0 if log is None else log.time.size)
        if log is not None:
            assert log.meta["completeness"] == "truncated"
            np.testing.assert_array_equal(log.gyro, sample_drive().gyro[: log.time.size])
    assert counts == sorted(counts)
    assert counts[-1] == 1500
    assert sum(c > 0 for c in counts) > 80  # of 101


def test_of_a_cut_chunk_the_beginning_is_used(tmp_path: Path) -> None:
    path = rewritten(tmp_path, "", end=False)
    path.write_bytes(path.read_bytes()[:300_000])
    log = read(path)
    assert log.meta["completeness"] == "truncated"
    assert 700 < log.time.size < 900  # an IMU message has 355 bytes, a fix 150
    np.testing.assert_array_equal(log.gyro, sample_drive().gyro[: log.time.size])


@pytest.mark.parametrize("compression", ["no chunk", "lz4"])
def test_mutated_files_are_read_or_refused(tmp_path: Path, compression: str) -> None:
    path = rewritten(tmp_path, compression)
    for content in mutations(path.read_bytes(), 100, seed=12):
        path.write_bytes(content)
        log = read_or_refusal(path)
        # A file of one packed chunk is whole or refused; the numbers are never others.
        if compression == "lz4" and log is not None:
            np.testing.assert_array_equal(log.gyro, sample_drive().gyro[: log.time.size])


def test_mutated_files_with_an_index_lose_little(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, kept = chunked(tmp_path, monkeypatch), []
    for content in mutations(path.read_bytes(), 100, seed=13):
        path.write_bytes(content)
        log = read_or_refusal(path)
        kept.append(0 if log is None else log.time.size)
    # Bytes put in or taken out (half of the cases) move all that follows away from where the index has it.
    assert sum(n >= 1500 - 4 * 100 for n in kept) > 40


def test_a_message_that_went_to_another_topic_is_missed(tmp_path: Path) -> None:
    # The library writes no checksums, but counts.
    folder = ros2_bag.write_messages(tmp_path / "drive", ros2_bag.MAKER.drive(), StoragePlugin.MCAP)
    path = folder / "drive.mcap"
    whole = path.read_bytes()
    chatter = whole.index(b"/chatter") - 8
    # An IMU message has 324 bytes behind the 22 of its record.
    at = whole.index(struct.pack("<BQH", reader.MESSAGE, 22 + 324, 1), len(whole) // 2) + 9
    path.write_bytes(whole[:at] + whole[chatter : chatter + 2] + whole[at + 2 :])
    log = read(path)
    assert log.time.size == 1499
    assert log.meta["completeness"] == "malformed_record"
    assert any("its summary counts 1950 messages" in event.text for event in log.events)


@pytest.mark.parametrize("size", [2**40, 2**62, 200_000_000])
def test_a_bomb_is_not_unpacked(tmp_path: Path, size: int) -> None:
    path = rewritten(tmp_path, "zstd", crc=0)
    whole = path.read_bytes()
    at = whole.index(b"\x04\0\0\0zstd") - 12
    path.write_bytes(whole[:at] + struct.pack("<Q", size) + whole[at + 8 :])
    begin = time.perf_counter()
    with pytest.raises(LogError, match=r"drive\.mcap has no messages"):
        read(path)
    assert time.perf_counter() - begin < 2.0


def test_an_encoding_that_is_not_known_is_named(tmp_path: Path) -> None:
    path = rewritten(tmp_path, "no chunk")
    path.write_bytes(path.read_bytes().replace(b"\x03\0\0\0cdr", b"\x03\0\0\0xyz"))
    with pytest.raises(LogError, match="/imu/data: the message encoding 'xyz' is not known"):
        read(path)
