"""A log as MCAP: read again it is the same log, and ROS's own library reads it."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from levelhead.errors import OutputError, UsageError
from levelhead.logs import mcap_writer
from levelhead.logs.log import Log
from levelhead.logs.mcap_writer import definition
from levelhead.logs.readers import read
from levelhead.logs.readers.ros_messages import LAYOUTS, has_layout
from levelhead.logs.writers import write
from samples.drive import EPOCH_UTC_S


def assert_same(log: Log, back: Log, *, time_atol: float = 0.0) -> None:
    for name in ("gyro", "accel", "velocity_ned", "wheel_speed"):
        np.testing.assert_array_equal(getattr(back, name), getattr(log, name), err_msg=name)
    for name in ("time", "gnss_time"):
        np.testing.assert_allclose(getattr(back, name), getattr(log, name), rtol=0.0, atol=time_atol, err_msg=name)
    assert log.position_llh is not None
    assert back.position_llh is not None
    # Radians to degrees and back are two roundings.
    np.testing.assert_array_max_ulp(back.position_llh[:, :2], log.position_llh[:, :2], maxulp=2)
    np.testing.assert_array_equal(back.position_llh[:, 2], log.position_llh[:, 2])


@pytest.mark.parametrize("chunk", [4096, 7])
def test_a_drive_survives_the_round_trip(
    drive: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, chunk: int
) -> None:
    monkeypatch.setattr(mcap_writer, "CHUNK_SAMPLES", chunk)
    path = tmp_path / "drive.mcap"
    write(drive, path)
    back = read(path)
    assert_same(drive, back)
    for name in ("velocity_std", "position_std"):
        one, three = getattr(drive, name), getattr(back, name)
        np.testing.assert_array_equal(three, np.tile(one[:, None], (1, 3)), err_msg=name)
    assert back.meta["completeness"] == "complete"
    assert "undeclared" not in back.meta  # what levelhead writes has its axes
    assert back.events == ()
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_three_deviations_and_epochs_of_position_or_velocity_alone_are_kept(drive: Log, tmp_path: Path) -> None:
    assert drive.velocity_ned is not None
    assert drive.position_llh is not None
    std = np.tile([0.01, 0.02, np.nan], (20, 1))
    velocity, position = drive.velocity_ned.copy(), drive.position_llh.copy()
    velocity[3] = position[5] = np.nan
    log = replace(drive, velocity_ned=velocity, position_llh=position, velocity_std=std, position_std=2.0 * std)
    write(log, tmp_path / "a.mcap")
    back = read(tmp_path / "a.mcap")
    assert_same(log, back)
    assert back.velocity_std is not None
    assert back.position_std is not None
    there = np.isfinite(velocity[:, 0])
    np.testing.assert_array_equal(back.velocity_std[there], std[there])
    there = np.isfinite(position[:, 0])
    np.testing.assert_array_equal(back.position_std[there], 2.0 * std[there])


def test_what_is_known_of_a_log_is_kept_and_stamps_are_utc(drive: Log, tmp_path: Path) -> None:
    meta = {
        "epoch": EPOCH_UTC_S + 18.25,
        "gnss_time_scale": "GPST",
        "datum": "ETRS89",
        "height": "mean sea level",
        "earth_rotation": False,
        "corrected_by": "smoother",
    }
    log = replace(drive, meta=meta)
    write(log, tmp_path / "a.mcap")
    back = read(tmp_path / "a.mcap")
    # Since 1970 stamps are float64 of 2^-22 s, and the zero is one of them.
    assert_same(log, back, time_atol=2**-22)
    assert back.meta["epoch"] == EPOCH_UTC_S + 0.25  # GPST was 18 s ahead
    assert back.meta["gnss_time_scale"] == "UTC"
    assert (back.meta["datum"], back.meta["height"]) == ("ETRS89", "mean sea level")
    assert back.meta["earth_rotation"] is False
    assert str(back.meta["compensated"]).startswith("The biases that levelhead's smoother estimated were taken off")


def test_a_height_that_was_not_declared_stays_so(drive: Log, tmp_path: Path) -> None:
    write(drive, tmp_path / "a.mcap")
    assert "height" not in read(tmp_path / "a.mcap").meta


def test_the_library_of_ros_reads_the_same_numbers(drive: Log, tmp_path: Path) -> None:
    write(replace(drive, meta={"epoch": EPOCH_UTC_S}), tmp_path / "a.mcap")
    messages: dict[str, list[object]] = {}
    stamps = []
    with AnyReader([tmp_path / "a.mcap"]) as reader:
        assert reader.message_count == 200 + 20 + 20 + 40
        for connection, record_ns, raw in reader.messages():
            messages.setdefault(connection.topic, []).append(reader.deserialize(raw, connection.msgtype))
            stamps.append(record_ns)
    assert stamps == sorted(stamps)
    assert {topic: len(m) for topic, m in messages.items()} == {
        "/imu/data_raw": 200,
        "/gnss/fix": 20,
        "/gnss/fix_velocity": 20,
        "/wheel/twist": 40,
    }
    imu, fix, velocity = (messages[t][1] for t in ("/imu/data_raw", "/gnss/fix", "/gnss/fix_velocity"))
    assert drive.position_llh is not None
    assert drive.velocity_ned is not None
    assert drive.position_std is not None
    assert imu.header.stamp.sec * 10**9 + imu.header.stamp.nanosec == int(EPOCH_UTC_S) * 10**9 + 50_000_000  # type: ignore[attr-defined]
    assert imu.orientation_covariance[0] == -1.0  # type: ignore[attr-defined]
    rate, force = imu.angular_velocity, imu.linear_acceleration  # type: ignore[attr-defined]
    np.testing.assert_array_equal([rate.x, -rate.y, -rate.z], drive.gyro[1])
    np.testing.assert_array_equal([force.x, -force.y, -force.z], drive.accel[1])
    speed = velocity.twist.twist.linear  # type: ignore[attr-defined]
    np.testing.assert_array_equal([speed.y, speed.x, -speed.z], drive.velocity_ned[1])
    place = [fix.latitude, fix.longitude, fix.altitude]  # type: ignore[attr-defined]
    np.testing.assert_array_equal(place, [*np.degrees(drive.position_llh[1, :2]), drive.position_llh[1, 2]])
    np.testing.assert_allclose(fix.position_covariance[::4], drive.position_std[1] ** 2, rtol=1e-15)  # type: ignore[attr-defined]
    assert fix.position_covariance_type == 2  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "kind", ["sensor_msgs/Imu", "sensor_msgs/NavSatFix", "geometry_msgs/TwistWithCovarianceStamped"]
)
def test_the_definitions_are_those_of_ros(kind: str) -> None:
    name = kind.replace("/", "/msg/")
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition(kind), name))
    # The hash of REP-2011 covers every name and type of the fields.
    assert store.hash_rihs01(name) == get_typestore(Stores.ROS2_HUMBLE).hash_rihs01(name)
    assert has_layout(definition(kind), LAYOUTS[kind])


def test_stamps_that_ros_cannot_hold_are_refused(drive: Log, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="beyond the years 1901 to 2038"):
        write(replace(drive, meta={"epoch": 2.2e9}), tmp_path / "a.mcap")
    time = drive.time.copy()
    time[1] = 1e-10
    with pytest.raises(UsageError, match="samples within a nanosecond"):
        write(replace(drive, time=time), tmp_path / "a.mcap")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_absent_is_an_output_error(drive: Log, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="could not be written"):
        write(drive, tmp_path / "absent" / "a.mcap")


def test_the_commands_write_it(drive: Log, tmp_path: Path) -> None:
    write(drive, tmp_path / "drive.parquet")

    def run(*arguments: str) -> None:
        command = [sys.executable, "-m", "levelhead", *arguments]
        subprocess.run(command, check=True, capture_output=True, cwd=tmp_path)

    run("convert", "drive.parquet", "-o", "drive.mcap")
    assert_same(drive, read(tmp_path / "drive.mcap"))
    run("estimate", "drive.mcap", "-o", "out", "--corrected", "mcap")
    corrected = read(tmp_path / "out" / "corrected.mcap")
    assert "levelhead's smoother" in str(corrected.meta["compensated"])
    assert (corrected.gyro != drive.gyro).any()
