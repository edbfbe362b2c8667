"""Numbers taken from the raw bytes of ROS messages are those that ROS's own library finds there."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from levelhead.logs.readers.ros_messages import LAYOUTS, Encoding, Rows, has_layout
from samples.ros_messages import FIX, IMU, TWIST, Maker

KINDS = {kind.replace("/", "/msg/"): layout for kind, layout in LAYOUTS.items()}
FRAMES = ["", "a", "ab", "imu", "base", "frame", "gps_an", "antenna", "imu_link"]
"""CDR aligns the first number by the length of the name before it: all lengths modulo 8."""
ROS1 = Maker(Stores.ROS1_NOETIC)
ROS2 = Maker(Stores.ROS2_HUMBLE)
STAMP_NS = 1_751_003_243_123_456_789


def numbers_of(kind: str, message: Any) -> list[float]:
    """Return what a layout takes of a message, by the names of the fields."""
    if kind == IMU:
        rate, force = message.angular_velocity, message.linear_acceleration
        covariances = message.angular_velocity_covariance[0], message.linear_acceleration_covariance[0]
        return [rate.x, rate.y, rate.z, force.x, force.y, force.z, *covariances]
    if kind == FIX:
        place = [message.latitude, message.longitude, message.altitude]
        return [*place, *message.position_covariance[::4], message.status.status, message.position_covariance_type]
    if kind == "nav_msgs/msg/Odometry":
        speed = message.twist.twist.linear
        return [speed.x, speed.y, speed.z]
    if kind == TWIST:
        speed = message.twist.twist.linear
        return [speed.x, speed.y, speed.z, *message.twist.covariance[[0, 7, 14]]]
    speed = message.twist.linear
    return [speed.x, speed.y, speed.z]


def a_message(maker: Maker, kind: str, frame: str, rng: np.random.Generator) -> Any:
    xyz, std = rng.normal(0.0, 5.0, 3), rng.uniform(0.1, 1.0, 3)
    message = {
        IMU: lambda: maker.imu(STAMP_NS, xyz, -xyz, absent=0.25),
        FIX: lambda: maker.fix(STAMP_NS, xyz, std, status=-1),
        TWIST: lambda: maker.velocity(STAMP_NS, xyz, std),
        "nav_msgs/msg/Odometry": lambda: maker.odometry(STAMP_NS, float(xyz[0])),
        "geometry_msgs/msg/TwistStamped": lambda: maker.types["geometry_msgs/msg/TwistStamped"](
            header=maker.header(STAMP_NS, "x"), twist=maker.twist(xyz)
        ),
    }[kind]()
    message.header.frame_id = frame
    if kind == "nav_msgs/msg/Odometry":
        message.child_frame_id = frame[::-1] + "s"
    return message


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("encoding", ["ros1", "cdr"])
def test_the_columns_are_what_the_library_decodes(kind: str, encoding: Encoding) -> None:
    rng = np.random.default_rng(3)
    maker, rows, expected = (ROS1 if encoding == "ros1" else ROS2), Rows(KINDS[kind]), []
    for number, frame in enumerate(FRAMES):
        message = a_message(maker, kind, frame, rng)
        if encoding == "ros1":
            raw = bytes(maker.store.serialize_ros1(message, kind))
            decoded = maker.store.deserialize_ros1(raw, kind)
        else:
            raw = bytes(maker.store.serialize_cdr(message, kind))
            decoded = maker.store.deserialize_cdr(raw, kind)
        expected.append(numbers_of(kind, decoded))
        rows.add(encoding, number, raw)
    samples = rows.samples()
    assert rows.broken == 0
    np.testing.assert_array_equal(samples.values, expected)
    np.testing.assert_array_equal(samples.stamp, STAMP_NS)
    np.testing.assert_array_equal(samples.record, np.arange(len(FRAMES)))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("encoding", ["ros1", "cdr"])
def test_a_message_of_another_length_is_counted_and_not_used(kind: str, encoding: Encoding) -> None:
    maker, rows = (ROS1 if encoding == "ros1" else ROS2), Rows(KINDS[kind])
    message = a_message(maker, kind, "imu", np.random.default_rng(3))
    raw = bytes(
        maker.store.serialize_ros1(message, kind) if encoding == "ros1" else maker.store.serialize_cdr(message, kind)
    )
    for length in (*range(60), len(raw) - 9, len(raw) - 8, len(raw) - 1, len(raw) + 8):
        rows.add(encoding, 0, raw[:length].ljust(length, b"\0"))
    rows.add(encoding, 0, raw[:12] + b"\xff\xff\xff\xff" + raw[16:])
    rows.add(encoding, 2**63, raw)  # a time of recording beyond int64
    rows.add(encoding, 0, b"\0\0" + raw[2:] if encoding == "cdr" else b"")  # big-endian
    assert rows.broken == 60 + 4 + 3
    assert rows.samples().values.shape[0] == 0


@pytest.mark.parametrize("kind", KINDS)
def test_ros_itself_has_these_layouts(kind: str) -> None:
    text, md5 = ROS1.store.generate_msgdef(kind)
    assert md5 == KINDS[kind].md5
    assert has_layout(text, KINDS[kind])
    for store in (Stores.ROS2_FOXY, Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY):
        assert has_layout(get_typestore(store).generate_msgdef(kind, ros_version=2)[0], KINDS[kind])


def test_fields_in_another_order_or_of_another_type_are_another_layout() -> None:
    text = ROS2.store.generate_msgdef(IMU, ros_version=2)[0]
    layout = KINDS[IMU]
    swapped = text.replace("angular_velocity", "x").replace("linear_acceleration", "angular_velocity")
    assert not has_layout(swapped.replace(" x", " linear_acceleration"), layout)
    assert not has_layout(text.replace("float64 z", "float32 z"), layout)
    assert not has_layout(text.replace("float64[9]", "float64[6]"), layout)
    assert not has_layout("", layout)
    # One that refers to itself comes to an end.
    assert not has_layout("std_msgs/Header header\nA a\n===\nMSG: x/A\n" + "A a\n" * 50, layout)
    commented = "# of an IMU\n" + text.replace("float64 x", "float64  x   # forward") + "\n\n"
    assert has_layout(commented.replace("\n", "\r\n"), layout)


def test_the_count_of_numbers_follows_from_the_fields() -> None:
    assert [layout.floats for layout in LAYOUTS.values()] == [37, 12, 6, 42, 85]
