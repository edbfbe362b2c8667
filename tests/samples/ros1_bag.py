"""The sample drive as a ROS 1 bag."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores

from samples.ros_messages import Maker, Message

MAKER = Maker(Stores.ROS1_NOETIC)


def write(folder: Path) -> Path:
    """Write the sample and return its path."""
    return write_messages(folder / "drive.bag", MAKER.drive())


def write_messages(
    path: Path, messages: Iterable[Message], compression: str | None = None, chunk: int = 1 << 20
) -> Path:
    """Write messages; ``compression`` is BZ2 or LZ4, ``chunk`` the bytes after which a chunk ends."""
    writer = Writer(path)
    writer.chunk_threshold = chunk
    if compression is not None:
        writer.set_compression(Writer.CompressionFormat[compression])
    with writer:
        connections = {}
        for topic, kind, record_ns, content in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=MAKER.store)
            writer.write(connections[topic], record_ns, MAKER.store.serialize_ros1(content, kind))
    return path
