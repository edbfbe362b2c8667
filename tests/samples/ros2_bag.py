"""The sample drive as a ROS 2 bag: a folder with a SQLite file and metadata.yaml."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores

from samples.ros_messages import Maker, Message

MAKER = Maker(Stores.ROS2_HUMBLE)


def write(folder: Path) -> Path:
    """Write the sample and return its folder."""
    return write_messages(folder / "drive", MAKER.drive())


def write_messages(
    folder: Path,
    messages: Iterable[Message],
    storage: StoragePlugin = StoragePlugin.SQLITE3,
    compression: CompressionMode = CompressionMode.NONE,
) -> Path:
    """Write messages into a new folder."""
    writer = Writer(folder, version=9, storage_plugin=storage)
    writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for topic, kind, record_ns, content in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=MAKER.store)
            writer.write(connections[topic], record_ns, MAKER.store.serialize_cdr(content, kind))
    return folder
