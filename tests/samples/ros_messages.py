"""The sample drive as ROS messages, made by the `rosbags` library: the authority that our readers are held against."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from levelhead.conventions import FloatArray
from levelhead.logs.log import Log
from samples.drive import EPOCH_UTC_S, sample_drive

IMU = "sensor_msgs/msg/Imu"
FIX = "sensor_msgs/msg/NavSatFix"
TWIST = "geometry_msgs/msg/TwistWithCovarianceStamped"
CHATTER = "std_msgs/msg/String"
TOPICS = {"/imu/data": IMU, "/gps/fix": FIX, "/gps/fix_velocity": TWIST, "/chatter": CHATTER}
LATE_NS = 3_000_000
"""From a message's stamp to its recording."""


class Message(NamedTuple):
    """One message: topic, type, time of recording (ns) and the library's object."""

    topic: str
    kind: str
    record_ns: int
    content: Any


class Maker:
    """Makes messages of ROS 1 or 2."""

    def __init__(self, store: Stores) -> None:
        self.store: Typestore = get_typestore(store)
        self.types: Mapping[str, Callable[..., Any]] = self.store.types
        self.seq = {"seq": 0} if store == Stores.ROS1_NOETIC else {}

    def header(self, stamp_ns: int, frame: str) -> Any:
        """Return a header."""
        time = self.types["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
        return self.types["std_msgs/msg/Header"](stamp=time, frame_id=frame, **self.seq)

    def vector(self, xyz: FloatArray) -> Any:
        """Return a vector."""
        return self.types["geometry_msgs/msg/Vector3"](x=float(xyz[0]), y=float(xyz[1]), z=float(xyz[2]))

    def imu(self, stamp_ns: int, gyro: FloatArray, accel: FloatArray, *, absent: float = 0.0) -> Any:
        """Return readings, FLU; ``absent`` is the first element of the covariances of rate and acceleration."""
        covariance = np.zeros(9)
        covariance[0] = absent
        return self.types[IMU](
            header=self.header(stamp_ns, "imu_link"),
            orientation=self.types["geometry_msgs/msg/Quaternion"](x=0.1, y=0.2, z=0.3, w=0.4),
            orientation_covariance=np.arange(9.0),
            angular_velocity=self.vector(gyro),
            angular_velocity_covariance=covariance,
            linear_acceleration=self.vector(accel),
            linear_acceleration_covariance=covariance,
        )

    def fix(self, stamp_ns: int, llh_deg: FloatArray, enu_std: FloatArray, *, status: int = 0) -> Any:
        """Return a fix, degrees and m."""
        return self.types[FIX](
            header=self.header(stamp_ns, "gps"),
            status=self.types["sensor_msgs/msg/NavSatStatus"](status=status, service=1),
            latitude=float(llh_deg[0]),
            longitude=float(llh_deg[1]),
            altitude=float(llh_deg[2]),
            position_covariance=np.diag(enu_std**2).ravel(),
            position_covariance_type=2,
        )

    def twist(self, enu: FloatArray) -> Any:
        """Return a linear velocity."""
        zero = self.vector(np.zeros(3))
        return self.types["geometry_msgs/msg/Twist"](linear=self.vector(enu), angular=zero)

    def velocity(self, stamp_ns: int, enu: FloatArray, enu_std: FloatArray) -> Any:
        """Return a velocity with its covariance, as u-blox's driver does: -1 for the turning that it does not know."""
        covariance = np.diag([*enu_std**2, -1.0, 0.0, 0.0]).ravel()
        twist = self.types["geometry_msgs/msg/TwistWithCovariance"](twist=self.twist(enu), covariance=covariance)
        return self.types[TWIST](header=self.header(stamp_ns, "gps"), twist=twist)

    def odometry(self, stamp_ns: int, speed: float) -> Any:
        """Return a wheel odometry."""
        pose = self.types["geometry_msgs/msg/Pose"](
            position=self.types["geometry_msgs/msg/Point"](x=1.0, y=2.0, z=3.0),
            orientation=self.types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
        )
        return self.types["nav_msgs/msg/Odometry"](
            header=self.header(stamp_ns, "odom"),
            child_frame_id="base_link",
            pose=self.types["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=np.zeros(36)),
            twist=self.types["geometry_msgs/msg/TwistWithCovariance"](
                twist=self.twist(np.array([speed, 0.0, 0.0])), covariance=np.zeros(36)
            ),
        )

    def drive(self, log: Log | None = None, *, every_std: float = 0.05) -> Iterator[Message]:
        """Yield the messages of a drive in the order of their recording."""
        log = sample_drive() if log is None else log
        assert log.velocity_ned is not None
        assert log.position_llh is not None
        flip = np.array([1.0, -1.0, -1.0])
        std = np.full(3, every_std)
        messages = []
        for time, gyro, accel in zip(log.time, log.gyro * flip, log.accel * flip, strict=True):
            messages.append((stamp_ns(time), "/imu/data", self.imu(stamp_ns(time), gyro, accel)))
        for time, ned, llh in zip(log.gnss_time, log.velocity_ned, log.position_llh, strict=True):
            at = stamp_ns(time)
            degrees = np.array([*np.degrees(llh[:2]), llh[2]])
            messages.append((at, "/gps/fix", self.fix(at, degrees, std)))
            messages.append((at, "/gps/fix_velocity", self.velocity(at, ned[[1, 0, 2]] * [1.0, 1.0, -1.0], std)))
            messages.append((at, "/chatter", self.types[CHATTER](data="not of interest " * 20)))
        for at, topic, content in sorted(messages, key=lambda m: m[0]):
            yield Message(topic, TOPICS[topic], at + LATE_NS, content)


def stamp_ns(time: float) -> int:
    """Return a stamp of the sample drive."""
    return int(EPOCH_UTC_S) * 10**9 + round(time * 1e9)
