"""Which topics are an IMU, a receiver, wheels, and what is made of their stamps, frames and gaps."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores

from levelhead.errors import LogError, UsageError
from levelhead.logs.log import Log
from levelhead.logs.pieces import Pieces
from levelhead.logs.readers import read
from levelhead.logs.readers.base import Source
from levelhead.logs.readers.ros1_bag import READER
from levelhead.logs.readers.ros_drive import is_wheels
from samples import ros1_bag
from samples.ros_messages import FIX, IMU, TWIST, Maker, Message, stamp_ns

MAKE = Maker(Stores.ROS1_NOETIC)
ODOMETRY = "nav_msgs/msg/Odometry"
TWIST_ONLY = "geometry_msgs/msg/TwistStamped"
GYRO, ACCEL = np.array([0.1, 0.2, 0.3]), np.array([1.0, 2.0, 9.8])
PLACE, STD = np.array([45.0, 9.0, 100.0]), np.array([1.0, 2.0, 3.0])
Bag = Callable[..., Path]


def messages(topic: str, kind: str, times: Iterable[float], make: Callable[[int], Any], late: int = 0) -> list[Message]:
    return [Message(topic, kind, stamp_ns(t) + late, make(stamp_ns(t))) for t in times]


def imu(topic: str = "/imu", rate: float = 50.0, **more: float) -> list[Message]:
    return messages(topic, IMU, np.arange(0.0, 2.0, 1.0 / rate), lambda at: MAKE.imu(at, GYRO, ACCEL, **more))


def fixes(topic: str = "/gps/fix", rate: float = 5.0, status: int = 0) -> list[Message]:
    times = np.arange(0.0, 2.0, 1.0 / rate)
    return messages(topic, FIX, times, lambda at: MAKE.fix(at, PLACE, STD, status=status))


def velocities(
    topic: str = "/gps/fix_velocity", shift: float = 0.0, enu: Iterable[float] = (1.0, 2.0, 3.0)
) -> list[Message]:
    times = np.arange(0.0, 1.9, 0.2) + shift
    return messages(topic, TWIST, times, lambda at: MAKE.velocity(at, np.array([*enu]), STD))


def plain_twist(topic: str, enu: Iterable[float], shift: float = 0.0) -> list[Message]:
    def make(at: int) -> Any:
        return MAKE.types[TWIST_ONLY](header=MAKE.header(at, "gps"), twist=MAKE.twist(np.array([*enu])))

    return messages(topic, TWIST_ONLY, np.arange(0.0, 1.9, 0.2) + shift, make)


@pytest.fixture
def bag(tmp_path: Path) -> Bag:
    """Write lists of messages as one bag."""

    def bag(*lists: list[Message]) -> Path:
        everything = sorted((m for part in lists for m in part), key=lambda m: m.record_ns)
        (tmp_path / "a.bag").unlink(missing_ok=True)
        return ros1_bag.write_messages(tmp_path / "a.bag", everything)

    return bag


def pieces_of(path: Path, **wanted: Any) -> Pieces:
    return READER.read(Source(path=path, **wanted))


def names(log: Log, kind: str) -> list[str]:
    streams = log.meta["streams"]
    assert isinstance(streams, tuple)
    return [s.name for s in streams if s.kind == kind]


def dropped(log: Log) -> str:
    return " ".join(e.text for e in log.events if e.code == "W_DROPPED")


def test_flu_becomes_frd_and_enu_ned(bag: Bag) -> None:
    log = read(bag(imu(), fixes(), velocities()))
    np.testing.assert_array_equal(log.gyro[0], [0.1, -0.2, -0.3])
    np.testing.assert_array_equal(log.accel[0], [1.0, -2.0, -9.8])
    np.testing.assert_array_equal(np.array(log.meta["dcm_file_to_body"]) @ [0.1, 0.2, 0.3], log.gyro[0])
    assert log.velocity_ned is not None
    assert log.velocity_std is not None
    assert log.position_std is not None
    np.testing.assert_array_equal(log.velocity_ned[0], [2.0, 1.0, -3.0])
    np.testing.assert_array_equal(log.velocity_std[0], [2.0, 1.0, 3.0])
    np.testing.assert_array_equal(log.position_std[0], [2.0, 1.0, 3.0])


@pytest.mark.parametrize(("ahead_s", "apart"), [(0.0, False), (0.3, False), (18.0, True)])
def test_a_driver_that_stamps_in_gps_time_has_another_clock(bag: Bag, ahead_s: float, apart: bool) -> None:
    # What is recorded at one time has stamps that differ by what the clocks do, and some tenths of latency.
    times = np.arange(0.0, 30.0, 0.02)
    readings = messages("/imu", IMU, times, lambda at: MAKE.imu(at, GYRO, ACCEL))
    places = messages(
        "/fix", FIX, times[::10] + ahead_s, lambda at: MAKE.fix(at, PLACE, STD), late=-round(ahead_s * 1e9)
    )
    undeclared = pieces_of(bag(readings, places)).undeclared
    assert ("clock" in undeclared) == apart


def test_of_several_imus_the_one_with_the_most_samples_is_read_and_the_user_may_choose(bag: Bag) -> None:
    path = bag(imu("/slow", 20.0), imu("/fast", 100.0), fixes())
    log = read(path)
    assert sorted(names(log, "imu")) == ["/fast", "/slow"]
    assert log.time.size == 200
    assert read(path, imu="/slow").time.size == 40
    with pytest.raises(LogError, match=r"no IMU called '/none'; choose one of: .*/fast \(200 samples\)"):
        read(path, imu="/none")


def test_raw_readings_come_before_those_of_a_filter(bag: Bag) -> None:
    filtered = messages("/imu/data", IMU, np.arange(0.0, 2.0, 0.02), lambda at: MAKE.imu(at, 2.0 * GYRO, ACCEL))
    log = read(bag(filtered, imu("/imu/data_raw"), fixes()))
    np.testing.assert_array_equal(log.gyro[:, 0], GYRO[0])


def test_a_filters_positions_are_not_taken_for_a_receivers(bag: Bag) -> None:
    path = bag(imu(), fixes("/gps/filtered", rate=20.0), fixes("/gps/fix"))
    assert read(path).gnss_time.size == 10
    assert read(path, gnss="/gps/filtered").gnss_time.size == 40


@pytest.mark.parametrize(
    ("fix", "velocity", "pairs"),
    [
        ("/ublox/fix", "/ublox/fix_velocity", True),
        ("/fix", "/vel", True),
        ("/gps/fix", "/gps/vel", True),
        ("/navsatfix", "/twist_gnss", True),
        ("/gps/fix", "/cmd_vel", False),
        ("/gps/fix", "/gps/cmd_vel", False),
        ("/navsatfix", "/twist_ins", False),
        ("/gps/fix", "/robot/velocity", False),
    ],
)
def test_velocities_go_with_the_fixes_by_their_names(bag: Bag, fix: str, velocity: str, pairs: bool) -> None:
    log = read(bag(imu(), fixes(fix), velocities(velocity)))
    assert (log.velocity_ned is not None) == pairs
    assert log.gnss_time.size == 10


def test_two_receivers_keep_their_velocities_apart(bag: Bag) -> None:
    parts = [fixes("/left/fix"), velocities("/left/fix_velocity", enu=(1.0, 0.0, 0.5))]
    parts += [fixes("/right/fix"), velocities("/right/fix_velocity", enu=(7.0, 0.0, 0.5))]
    path = bag(imu(), *parts)
    for name, east in (("/left/fix", 1.0), ("/right/fix", 7.0)):
        log = read(path, gnss=name)
        assert log.velocity_ned is not None
        np.testing.assert_array_equal(log.velocity_ned[:, 1], east)


def test_velocities_alone_are_a_receiver(bag: Bag) -> None:
    log = read(bag(imu(), velocities("/gnss/velocity")))
    assert names(log, "gnss") == ["/gnss/velocity"]
    assert log.position_llh is None
    assert "datum" in log.meta  # WGS84 by default of every log
    assert log.velocity_ned is not None


@pytest.mark.parametrize(("shift", "epochs"), [(0.0, 10), (0.004, 10), (0.05, 20)])
def test_only_stamps_that_are_close_are_one_epoch(bag: Bag, shift: float, epochs: int) -> None:
    log = read(bag(imu(), fixes(), velocities(shift=shift)))
    assert log.gnss_time.size == epochs
    assert log.velocity_ned is not None
    assert log.position_llh is not None
    # Nothing is lost, whether together or apart.
    assert np.isfinite(log.velocity_ned).all(axis=1).sum() == 10
    assert np.isfinite(log.position_llh).all(axis=1).sum() == 10


def test_epochs_without_a_fix_are_left_out_with_their_velocity_and_counted(bag: Bag) -> None:
    some = [*fixes(status=-1)[:4], *fixes()[4:]]
    log = read(bag(imu(), some, velocities()))
    assert log.gnss_time.size == 6
    assert "/gps/fix: epochs without a fix (4)" in dropped(log)


def test_a_place_that_is_none_leaves_the_velocity(bag: Bag) -> None:
    some = fixes()
    some[0].content.latitude = some[0].content.longitude = 0.0
    some[1].content.altitude = np.nan
    some[2].content.latitude = 1e9
    log = read(bag(imu(), some, velocities()))
    assert log.gnss_time.size == 10
    assert log.position_llh is not None
    assert np.isnan(log.position_llh[:3]).all()
    assert np.isfinite(log.position_llh[3:]).all()
    log = read(bag(imu(), some))
    assert log.gnss_time.size == 7
    assert "epochs with neither a whole position nor a velocity (3)" in dropped(log)


def test_a_covariance_of_unknown_kind_is_no_sigma(bag: Bag) -> None:
    some = fixes()
    for message in some:
        message.content.position_covariance_type = 0
    assert read(bag(imu(), some)).position_std is None


def test_a_receiver_without_vertical_velocity_says_so(bag: Bag) -> None:
    log = read(bag(imu(), fixes(), plain_twist("/gps/vel", (30.0, 40.0, 0.0))))
    assert log.velocity_ned is not None
    assert log.velocity_std is not None
    np.testing.assert_array_equal(log.velocity_ned[0], [40.0, 30.0, 0.0])
    # 5 % of 50 m/s.
    np.testing.assert_allclose(log.velocity_std, np.tile([np.nan, np.nan, 2.5], (10, 1)))
    (event,) = [e for e in log.events if e.code == "I_VELOCITY_2D"]
    assert event.count == 10
    with_height = read(bag(imu(), fixes(), plain_twist("/gps/vel", (3.0, 4.0, 0.1))))
    assert with_height.velocity_std is None


def unstamped(messages: list[Message], rows: slice) -> list[Message]:
    for message in messages[rows]:
        message.content.header.stamp.sec = message.content.header.stamp.nanosec = 0
    return messages


def test_messages_without_stamps_are_taken_when_they_were_recorded(bag: Bag) -> None:
    log = read(bag(unstamped(imu(), slice(None)), fixes()))
    assert log.time.size == 100
    assert log.time[1] == pytest.approx(0.02, abs=1e-6)
    (event,) = [e for e in log.events if e.code == "W_RECORD_TIME"]
    assert event.count == 100
    assert event.text.endswith("/imu.")


def test_a_few_without_stamps_or_with_strange_ones_are_left_out(bag: Bag) -> None:
    some = unstamped(imu(rate=200.0), slice(0, 2))
    some[50].content.header.stamp.sec += 86400
    log = read(bag(some, fixes()))
    assert log.time.size == 397
    assert "/imu: messages without a stamp (2)" in dropped(log)
    assert "/imu: messages with a stamp far from the others' (1)" in dropped(log)


def test_an_imu_topic_without_rates_is_none(bag: Bag) -> None:
    accel_only = messages("/camera/accel", IMU, np.arange(0.0, 2.0, 0.004), lambda at: MAKE.imu(at, 0.0 * GYRO, ACCEL))
    log = read(bag(imu(), accel_only, fixes()))
    assert names(log, "imu") == ["/imu"]
    assert "/camera/accel: messages without angular rate or without acceleration (500)" in dropped(log)
    # -1 alone does not make readings absent: many drivers write it though they have them.
    assert read(bag(imu(absent=-1.0), fixes())).time.size == 100


def test_a_broken_number_is_left_out_without_a_word_from_numpy(bag: Bag) -> None:
    path = bag(imu(), fixes())
    signalling = bytes.fromhex("01000000 0000f07f")
    path.write_bytes(path.read_bytes().replace(struct.pack("<d", ACCEL[2]), signalling, 1))
    log = read(path)
    assert log.time.size == 99
    assert [e.code for e in log.events] == ["E_NONFINITE"]


def test_wheel_odometry_goes_to_the_nearest_samples(bag: Bag) -> None:
    odometry = messages("/wheel/odom", ODOMETRY, np.arange(0.003, 1.9, 0.1), lambda at: MAKE.odometry(at, 2.5))
    speed = read(bag(imu(), odometry, fixes())).wheel_speed
    assert speed is not None
    np.testing.assert_array_equal(np.flatnonzero(np.isfinite(speed)), np.arange(0, 95, 5))
    assert set(speed[np.isfinite(speed)]) == {2.5}


def test_of_two_odometries_for_one_sample_the_nearer_is_used(bag: Bag) -> None:
    near = messages("/wheel/odom", ODOMETRY, [0.101, 0.3], lambda at: MAKE.odometry(at, 1.0))
    far = messages("/wheel/odom", ODOMETRY, [0.107, 0.092], lambda at: MAKE.odometry(at, 9.0))
    speed = read(bag(imu(), near, far, fixes())).wheel_speed
    assert speed is not None
    assert (speed[5], speed[15]) == (1.0, 1.0)


@pytest.mark.parametrize(
    ("topic", "wheels"),
    [
        ("/wheel/odom", True),
        ("/husky_velocity_controller/odom", True),
        ("/diff_drive_controller/odom", True),
        ("/ackermann_steering_controller/odometry", True),
        ("/odom", False),
        ("/odometry/filtered", False),
        ("/visual/wheel_like", False),
        ("/wheel/cmd_vel", False),
    ],
)
def test_wheels_are_told_by_the_name(topic: str, wheels: bool) -> None:
    assert is_wheels(topic) == wheels


def test_for_its_gnss_data_alone_a_bag_needs_no_imu(bag: Bag) -> None:
    pieces = pieces_of(bag(imu(), fixes(), velocities()), role="gnss")
    assert pieces.imu is None
    assert pieces.gnss is not None
    assert pieces.undeclared == ("velocity_frame",)
    with pytest.raises(LogError, match="holds GNSS data only"):
        read(bag(fixes()))


def test_an_imu_alone_wants_a_gnss_file(bag: Bag) -> None:
    path = bag(imu())
    with pytest.raises(LogError, match="holds no GNSS data"):
        read(path)
    with pytest.raises((UsageError, LogError), match="/none"):
        read(path, gnss="/none")


def test_the_clock_of_a_simulation_has_no_time_scale(bag: Bag) -> None:
    parts = [imu(), fixes()]
    for message in (m for part in parts for m in part):
        message.content.header.stamp.sec -= stamp_ns(0.0) // 10**9 - 7
    log = read(bag(*parts))
    assert "gnss_time_scale" not in log.meta
    assert log.time[0] == 7.0
