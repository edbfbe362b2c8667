"""Time and memory of reading recordings of 2 GB: `python benchmarks/big_bag.py [GIGABYTES]`.

Makes a ROS 1 bag, an MCAP file and a SQLite file in a temporary folder, one after the other, each an hour of IMU at
100 Hz and GNSS at 10 Hz among images, reads each in a process of its own, and prints wall time and peak memory of that
process, beside the time in which the `rosbags` library goes through the same messages and decodes them.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

IMU, FIX, IMAGE = "sensor_msgs/msg/Imu", "sensor_msgs/msg/NavSatFix", "sensor_msgs/msg/Image"
SECONDS = 3600
IMAGE_RATE = 2

READ = """
import resource, sys, time
import levelhead as lh
begin = time.perf_counter()
log = lh.read(sys.argv[1])
wall = time.perf_counter() - begin
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
print(f"{wall:10.2f} {peak:10.0f}   {log.time.size} samples, {log.gnss_time.size} epochs, {log.meta['completeness']}")
"""
DECODE = """
import resource, sys, time
from pathlib import Path
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
begin = time.perf_counter()
with AnyReader([Path(sys.argv[1])], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
    wanted = [c for c in reader.connections if c.msgtype.endswith(("Imu", "NavSatFix"))]
    count = sum(reader.deserialize(raw, c.msgtype) is not None for c, _, raw in reader.messages(wanted))
wall = time.perf_counter() - begin
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
print(f"{wall:10.2f} {peak:10.0f}   {count} messages")
"""


def raw_messages(store: Typestore, gigabytes: float, *, ros1: bool) -> Iterator[tuple[str, str, int, bytes]]:
    """Yield topic, type, time (ns) and bytes of all messages in the order of their stamps."""
    types = store.types
    seq = {"seq": 0} if ros1 else {}
    rng = np.random.default_rng(1)
    pixels = rng.integers(0, 256, int(gigabytes * 1e9 / (SECONDS * IMAGE_RATE)), dtype=np.uint8)

    def header(at: int) -> Any:
        stamp = types["builtin_interfaces/msg/Time"](sec=at // 10**9, nanosec=at % 10**9)
        return types["std_msgs/msg/Header"](stamp=stamp, frame_id="a", **seq)

    def vector(scale: float) -> Any:
        x, y, z = (float(v) for v in scale * rng.normal(size=3))
        return types["geometry_msgs/msg/Vector3"](x=x, y=y, z=z)

    for tick in range(SECONDS * 100):
        at = 1_751_003_243 * 10**9 + tick * 10**7
        messages: list[tuple[str, str, Any]] = []
        turn = types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
        imu = types[IMU](header(at), turn, np.zeros(9), vector(0.1), np.zeros(9), vector(9.8), np.zeros(9))
        messages.append(("/imu/data", IMU, imu))
        if tick % 10 == 0:
            status = types["sensor_msgs/msg/NavSatStatus"](status=0, service=1)
            place = 45.0 + 1e-6 * tick, 9.0, 100.0
            messages.append(("/gps/fix", FIX, types[FIX](header(at), status, *place, np.eye(3).ravel(), 2)))
        if tick % (100 // IMAGE_RATE) == 0:
            image = types[IMAGE](header(at), 1, pixels.size, "mono8", 0, pixels.size, np.roll(pixels, tick))
            messages.append(("/camera/image", IMAGE, image))
        for topic, kind, message in messages:
            raw = store.serialize_ros1(message, kind) if ros1 else store.serialize_cdr(message, kind)
            yield topic, kind, at, bytes(raw)


def write_all(writer: Writer1 | Writer2, store: Typestore, gigabytes: float, *, ros1: bool) -> None:
    """Write all messages."""
    connections = {}
    with writer:
        for topic, kind, at, raw in raw_messages(store, gigabytes, ros1=ros1):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], at, raw)


def ros1_bag(folder: Path, gigabytes: float) -> Path:
    """Write a ROS 1 bag, its chunks packed by LZ4."""
    writer = Writer1(folder / "big.bag")
    writer.set_compression(Writer1.CompressionFormat.LZ4)
    write_all(writer, get_typestore(Stores.ROS1_NOETIC), gigabytes, ros1=True)
    return folder / "big.bag"


def mcap(folder: Path, gigabytes: float) -> Path:
    """Write an MCAP file, its chunks packed by Zstandard."""
    writer = Writer2(folder / "big", version=9, storage_plugin=StoragePlugin.MCAP)
    writer.compression_mode = CompressionMode.STORAGE
    write_all(writer, get_typestore(Stores.ROS2_HUMBLE), gigabytes, ros1=False)
    return folder / "big" / "big.mcap"


def sqlite(folder: Path, gigabytes: float) -> Path:
    """Write a SQLite file."""
    writer = Writer2(folder / "big", version=9)
    write_all(writer, get_typestore(Stores.ROS2_HUMBLE), gigabytes, ros1=False)
    return folder / "big" / "big.db3"


def main() -> None:
    """Print a line for each format and reader."""
    gigabytes = float(sys.argv[1]) if len(sys.argv) > 1 else 2.0
    print(f"An hour of IMU at 100 Hz and fixes at 10 Hz among images, {gigabytes:g} GB")
    print(f"{'format':14s}{'reader':12s}{'wall s':>10s} {'peak MB':>10s}")
    for make in (ros1_bag, mcap, sqlite):
        with tempfile.TemporaryDirectory() as name:
            if shutil.disk_usage(name).free < 2e9 + 1.2e9 * gigabytes:
                print(f"{make.__name__}: not enough free space in {name}; set TMPDIR")
                continue
            path, shown = make(Path(name), gigabytes), {}
            # The first round finds the file half on the disk; of each reader the second is shown.
            for label, code in (("levelhead", READ), ("rosbags", DECODE)) * 2:
                done = subprocess.run(
                    [sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=False
                )
                said = done.stdout.rstrip() or done.stderr.splitlines()[-1]
                shown[label] = said
            for label, said in shown.items():
                print(f"{make.__name__:14s}{label:12s}{said}", flush=True)


if __name__ == "__main__":
    main()
