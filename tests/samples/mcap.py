"""The sample drive as an MCAP file."""

from __future__ import annotations

from pathlib import Path

from rosbags.rosbag2 import CompressionMode, StoragePlugin

from samples import ros2_bag


def write(folder: Path) -> Path:
    """Write the sample and return its path."""
    bag = ros2_bag.write_messages(
        folder / "drive-mcap", ros2_bag.MAKER.drive(), StoragePlugin.MCAP, CompressionMode.STORAGE
    )
    return (bag / "drive-mcap.mcap").rename(folder / "drive.mcap")
