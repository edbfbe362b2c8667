"""Writing a log as MCAP with ROS 2 messages, so that tools for robots show and play it. See https://mcap.dev/spec.

All messages of a topic have one length, so that thousands of them are filled in at a time as the rows of an array.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
from numpy.typing import NDArray

from levelhead.atomic import atomic_path
from levelhead.conventions import FloatArray
from levelhead.errors import UsageError
from levelhead.logs.datum import DATUM_KEY, HEIGHT_KEY, WGS84
from levelhead.logs.log import Log
from levelhead.logs.readers import mcap
from levelhead.logs.readers.ros_drive import YEAR_2000_S
from levelhead.logs.readers.ros_messages import LAYOUTS, IntArray
from levelhead.logs.timescales import UTC, between
from levelhead.version import __version__

ChunkArray = NDArray[np.uint8]

CHUNK_SAMPLES: Final = 4096
"""IMU samples in a chunk: 1.4 MB before compression, at 100 Hz 40 s."""
COMPRESSION: Final = "zstd"
_NS: Final = 1_000_000_000
_FLIP: Final = (1.0, -1.0, -1.0)
"""FRD to FLU."""

_HEADER_TEXT: Final = "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
_TIME_TEXT: Final = "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
_VECTOR_TEXT: Final = "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n"
_DEFINITIONS: Final = {
    "sensor_msgs/Imu": (
        "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
        "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
        "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n",
        _HEADER_TEXT,
        _TIME_TEXT,
        "MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
        _VECTOR_TEXT,
    ),
    "sensor_msgs/NavSatFix": (
        "uint8 COVARIANCE_TYPE_UNKNOWN=0\nuint8 COVARIANCE_TYPE_APPROXIMATED=1\n"
        "uint8 COVARIANCE_TYPE_DIAGONAL_KNOWN=2\nuint8 COVARIANCE_TYPE_KNOWN=3\n"
        "std_msgs/Header header\nsensor_msgs/NavSatStatus status\nfloat64 latitude\nfloat64 longitude\n"
        "float64 altitude\nfloat64[9] position_covariance\nuint8 position_covariance_type\n",
        _HEADER_TEXT,
        _TIME_TEXT,
        "MSG: sensor_msgs/NavSatStatus\nint8 STATUS_NO_FIX=-1\nint8 STATUS_FIX=0\nint8 STATUS_SBAS_FIX=1\n"
        "int8 STATUS_GBAS_FIX=2\nuint16 SERVICE_GPS=1\nuint16 SERVICE_GLONASS=2\nuint16 SERVICE_COMPASS=4\n"
        "uint16 SERVICE_GALILEO=8\nint8 status\nuint16 service\n",
    ),
    "geometry_msgs/TwistWithCovarianceStamped": (
        "std_msgs/Header header\ngeometry_msgs/TwistWithCovariance twist\n",
        _HEADER_TEXT,
        _TIME_TEXT,
        "MSG: geometry_msgs/TwistWithCovariance\ngeometry_msgs/Twist twist\nfloat64[36] covariance\n",
        "MSG: geometry_msgs/Twist\ngeometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n",
        _VECTOR_TEXT,
    ),
}


def definition(kind: str) -> str:
    """Return the definition of a message type with those that it refers to, as MCAP wants it."""
    return ("=" * 80 + "\n").join(_DEFINITIONS[kind])


@dataclass(kw_only=True, eq=False)
class _Topic:
    """The messages of one topic: stamps (n,) ns, and what is not zero in them.

    ``numbers`` are values, (n, k) or k for all, by their places among the float64 numbers of the message.
    """

    name: str
    kind: str
    frame: str
    stamp: IntArray
    numbers: Mapping[tuple[int, ...], FloatArray]
    tail: NDArray[np.uint8] | None = None

    def records(self, channel: int, rows: slice) -> NDArray[Any]:
        """Return message records (see the specification) as the rows of an array, with CDR inside."""
        layout, frame = LAYOUTS[self.kind], self.frame.encode() + b"\0"
        # CDR counts places from behind its own 4 bytes: the frame's characters begin at 12.
        end = 12 + len(frame)
        first = end + layout.gaps("cdr")[end % 8]
        at = 35  # behind the record's and the encapsulation's headers
        length = at + first + 8 * layout.floats + int(layout.tail)
        columns = [
            ("kind", "u1", 0, mcap.MESSAGE),
            ("length", "<u8", 1, length - 9),
            ("channel", "<u2", 9, channel),
            ("log", "<u8", 15, np.maximum(self.stamp[rows], 0)),
            ("publish", "<u8", 23, np.maximum(self.stamp[rows], 0)),
            ("encapsulation", "<u4", 31, 0x100),
            ("sec", "<i4", at, self.stamp[rows] // _NS),
            ("nsec", "<u4", at + 4, self.stamp[rows] % _NS),
            ("frame_length", "<u4", at + 8, len(frame)),
            ("frame", f"S{len(frame)}", at + 12, frame),
            ("numbers", f"({layout.floats},)<f8", at + first, 0.0),
        ]
        if self.tail is not None:
            columns.append(("tail", "u1", length - 1, self.tail[rows]))
        names, formats, offsets, values = zip(*columns, strict=True)
        table = np.zeros(
            self.stamp[rows].size,
            np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": length}),
        )
        for name, value in zip(names, values, strict=True):
            table[name] = value
        for places, numbers in self.numbers.items():
            table["numbers"][:, places] = numbers[rows] if numbers.ndim == 2 else numbers
        return table


def write_mcap(log: Log, target: Path) -> None:
    """Write a log as an MCAP file of ROS 2 messages.

    ``/imu/data_raw`` (`sensor_msgs/Imu`, FLU), ``/gnss/fix`` (`sensor_msgs/NavSatFix`), ``/gnss/fix_velocity``
    (`geometry_msgs/TwistWithCovarianceStamped`, ENU) and, where the log has it, ``/wheel/twist`` (the same type, speed
    along x). Stamps are UTC where the log has an absolute clock. Deviations become variances, 0 where not known.

    Raises
    ------
    UsageError
        When the stamps do not fit into ROS's: beyond the year 2038, or two within a nanosecond.
    OutputError
        When the file cannot be written.
    """
    topics = [topic for topic in _topics(log) if topic.stamp.size]
    with atomic_path(target) as temporary, temporary.open("wb") as file:
        out = _Out(file)
        out.begin(topics)
        imu = topics[0].stamp
        edges = imu[CHUNK_SAMPLES::CHUNK_SAMPLES]
        rows = [np.concatenate(([0], np.searchsorted(t.stamp, edges), [t.stamp.size])) for t in topics]
        for k in range(edges.size + 1):
            tables = [t.records(n, slice(r[k], r[k + 1])) for n, (t, r) in enumerate(zip(topics, rows, strict=True))]
            out.chunk(tables)
        out.end(_metadata(log))


def _topics(log: Log) -> list[_Topic]:
    zero = _epoch_ns(log)
    stamp, gnss_stamp = (_stamps(time, zero) for time in (log.time, log.gnss_time))
    readings: dict[tuple[int, ...], FloatArray] = {
        (13, 14, 15): log.gyro * _FLIP,
        (25, 26, 27): log.accel * _FLIP,
        # A quaternion without turn, and the -1 that says that there is no orientation.
        (3, 4): np.array([1.0, -1.0]),
    }
    topics = [_Topic(name="/imu/data_raw", kind="sensor_msgs/Imu", frame="imu_link", stamp=stamp, numbers=readings)]
    if log.position_llh is not None:
        topics.append(_fixes(log.position_llh, log.position_std, gnss_stamp))
    if log.velocity_ned is not None:
        whole = np.isfinite(log.velocity_ned).all(axis=1)
        velocity = log.velocity_ned[whole][:, (1, 0, 2)] * [1.0, 1.0, -1.0]
        variances = _variances(log.velocity_std, gnss_stamp.size)[whole]
        topics.append(_twists("/gnss/fix_velocity", "gnss", gnss_stamp[whole], velocity, variances))
    if log.wheel_speed is not None:
        known = np.isfinite(log.wheel_speed)
        speed = np.zeros((int(known.sum()), 3))
        speed[:, 0] = log.wheel_speed[known]
        topics.append(_twists("/wheel/twist", "base_link", stamp[known], speed, np.zeros_like(speed)))
    return topics


def _fixes(position_llh: FloatArray, position_std: FloatArray | None, stamp: IntArray) -> _Topic:
    whole = np.isfinite(position_llh).all(axis=1)
    variances = _variances(position_std, stamp.size)[whole]
    numbers: dict[tuple[int, ...], FloatArray] = {
        (0, 1): np.degrees(position_llh[whole, :2]),
        (2,): position_llh[whole, 2:],
        (3, 7, 11): variances,
    }
    # Diagonal known, or unknown.
    tail = np.where(variances.any(axis=1), 2, 0).astype(np.uint8)
    kind = "sensor_msgs/NavSatFix"
    return _Topic(name="/gnss/fix", kind=kind, frame="gnss", stamp=stamp[whole], numbers=numbers, tail=tail)


def _twists(name: str, frame: str, stamp: IntArray, linear: FloatArray, variances: FloatArray) -> _Topic:
    numbers: dict[tuple[int, ...], FloatArray] = {(0, 1, 2): linear, (6, 13, 20): variances}
    kind = "geometry_msgs/TwistWithCovarianceStamped"
    return _Topic(name=name, kind=kind, frame=frame, stamp=stamp, numbers=numbers)


def _variances(std: FloatArray | None, count: int) -> FloatArray:
    """Return variances (m, 3), ENU, 0 where the deviation is not known."""
    if std is None:
        return np.zeros((count, 3))
    three = np.tile(std[:, None], (1, 3)) if std.ndim == 1 else std[:, (1, 0, 2)]
    return np.square(np.nan_to_num(three, nan=0.0, posinf=0.0))


def _epoch_ns(log: Log) -> int:
    """Return the stamp of the log's zero, ns since 1970 in UTC where the log has an absolute clock."""
    epoch = log.meta.get("epoch", 0.0)
    seconds = float(epoch) if isinstance(epoch, int | float) else 0.0
    scale = log.meta.get("gnss_time_scale")
    if isinstance(scale, str) and seconds > YEAR_2000_S:
        seconds += between(scale, UTC, seconds)
    whole = math.floor(seconds)
    return whole * _NS + round((seconds - whole) * _NS)


def _stamps(time: FloatArray, zero: int) -> IntArray:
    seconds = np.floor(time)
    if time.size and not -(2**31) <= zero // _NS + seconds.min() <= zero // _NS + seconds.max() < 2**31 - 1:
        raise UsageError("The log's stamps are beyond the years 1901 to 2038, which ROS messages hold; write .parquet.")
    stamp = seconds.astype(np.int64) * _NS + np.round((time - seconds) * _NS).astype(np.int64) + zero
    if (np.diff(stamp) <= 0).any():
        raise UsageError(
            "The log has samples within a nanosecond, which ROS's stamps cannot tell apart; write .parquet."
        )
    return stamp


def _metadata(log: Log) -> dict[str, str]:
    """Return what ROS messages have no place for."""
    kept = {"version": __version__, DATUM_KEY: WGS84}
    for key in (DATUM_KEY, HEIGHT_KEY, "corrected_by"):
        if isinstance(log.meta.get(key), str):
            kept[key] = str(log.meta[key])
    if not log.meta.get("earth_rotation", True):
        kept["earth_rotation"] = "false"
    return kept


def _text(text: str) -> bytes:
    content = text.encode()
    return struct.pack("<I", len(content)) + content


def _map(words: dict[str, str]) -> bytes:
    content = b"".join(_text(word) for pair in words.items() for word in pair)
    return struct.pack("<I", len(content)) + content


def _record(kind: int, content: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(content)) + content


@dataclass(eq=False)
class _Out:
    """An MCAP file that is being written: keeps what its summary will say."""

    file: IO[bytes]
    schemas: list[bytes] = field(default_factory=list)
    channels: list[bytes] = field(default_factory=list)
    chunk_indexes: list[bytes] = field(default_factory=list)
    counts: dict[int, int] = field(default_factory=dict)
    spans: list[tuple[int, int]] = field(default_factory=list)

    def begin(self, topics: Sequence[_Topic]) -> None:
        """Write the header and describe the topics."""
        self.file.write(mcap.MAGIC)
        self.file.write(_record(mcap.HEADER, _text("ros2") + _text(f"levelhead {__version__}")))
        kinds = list(dict.fromkeys(topic.kind for topic in topics))
        for number, kind in enumerate(kinds, 1):
            names = _text(kind.replace("/", "/msg/")) + _text("ros2msg") + _text(definition(kind))
            self.schemas.append(_record(mcap.SCHEMA, struct.pack("<H", number) + names))
        for number, topic in enumerate(topics):
            numbers = struct.pack("<HH", number, kinds.index(topic.kind) + 1)
            self.channels.append(_record(mcap.CHANNEL, numbers + _text(topic.name) + _text("cdr") + _map({})))
            self.counts[number] = 0
        self.file.write(b"".join(self.schemas + self.channels))

    def chunk(self, tables: Sequence[NDArray[Any]]) -> None:
        """Write a chunk of messages in the order of their stamps, and where each of them is."""
        import pyarrow as pa

        log = np.concatenate([table["log"] for table in tables])
        sizes = np.concatenate([np.full(table.size, table.itemsize) for table in tables])
        order = np.argsort(log, kind="stable")
        begins = np.empty(log.size, np.int64)
        begins[order] = np.cumsum(sizes[order]) - sizes[order]
        content: ChunkArray = np.empty(int(sizes.sum()), np.uint8)
        places = np.split(begins, np.cumsum([table.size for table in tables])[:-1])
        for table, place in zip(tables, places, strict=True):
            content[place[:, None] + np.arange(table.itemsize)] = table.view(np.uint8).reshape(
                table.size, table.itemsize
            )
        plain = content.tobytes()
        packed = pa.compress(plain, codec=COMPRESSION, asbytes=True)
        span = int(log.min()), int(log.max())
        head = struct.pack("<QQQI", *span, content.size, zlib.crc32(plain)) + _text(COMPRESSION)
        begin = self.file.tell()
        self.file.write(_record(mcap.CHUNK, head + struct.pack("<Q", len(packed)) + packed))
        end = self.file.tell()
        indexes: list[tuple[int, int]] = []
        for number, (table, place) in enumerate(zip(tables, places, strict=True)):
            self.counts[number] += table.size
            if table.size:
                indexes.append((number, self.file.tell()))
                pairs = np.column_stack((table["log"], place.astype(np.uint64))).astype("<u8").tobytes()
                self.file.write(_record(mcap.MESSAGE_INDEX, struct.pack("<HI", number, len(pairs)) + pairs))
        offsets = b"".join(struct.pack("<HQ", *index) for index in indexes)
        self.spans.append(span)
        self.chunk_indexes.append(
            _record(
                mcap.CHUNK_INDEX,
                struct.pack("<QQQQI", *span, begin, end - begin, len(offsets))
                + offsets
                + struct.pack("<Q", self.file.tell() - end)
                + _text(COMPRESSION)
                + struct.pack("<QQ", len(packed), content.size),
            )
        )

    def end(self, metadata: dict[str, str]) -> None:
        """Write the metadata, the summary and the end."""
        begin = self.file.tell()
        length = self.file.write(_record(mcap.METADATA, _text(mcap.METADATA_NAME) + _map(metadata)))
        self.file.write(_record(mcap.DATA_END, struct.pack("<I", 0)))
        counts = b"".join(struct.pack("<HQ", number, count) for number, count in self.counts.items())
        span = min(s[0] for s in self.spans), max(s[1] for s in self.spans)
        numbers = len(self.schemas), len(self.channels), 0, 1, len(self.chunk_indexes)
        statistics = struct.pack("<QHIIIIQQI", sum(self.counts.values()), *numbers, *span, len(counts)) + counts
        index = struct.pack("<QQ", begin, length) + _text(mcap.METADATA_NAME)
        groups = (
            (mcap.SCHEMA, b"".join(self.schemas)),
            (mcap.CHANNEL, b"".join(self.channels)),
            (mcap.CHUNK_INDEX, b"".join(self.chunk_indexes)),
            (mcap.METADATA_INDEX, _record(mcap.METADATA_INDEX, index)),
            (mcap.STATISTICS, _record(mcap.STATISTICS, statistics)),
        )
        summary_begin = at = self.file.tell()
        offsets = []
        for kind, group in groups:
            offsets.append(_record(mcap.SUMMARY_OFFSET, struct.pack("<BQQ", kind, at, len(group))))
            at += len(group)
        summary = b"".join([*(group for _, group in groups), *offsets])
        footer = struct.pack("<BQQQ", mcap.FOOTER, 20, summary_begin, at)
        self.file.write(summary + footer + struct.pack("<I", zlib.crc32(summary + footer)) + mcap.MAGIC)
