"""ROS messages of fixed layout: from the raw bytes of many messages to columns, without an object per message.

Each begins with a `std_msgs/Header` and is float64 numbers from its last string on, so that the place of the first
number gives all others. ROS 1 packs the fields; CDR (ROS 2) aligns each to its size, counted behind the 4 bytes of
encapsulation.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import FloatArray

IntArray = NDArray[np.int64]
Encoding = Literal["ros1", "cdr"]

MAX_MESSAGE: Final = 65536
"""No message that is read here is longer, bytes: 700 of numbers and two names of frames."""
_BLOCK: Final = 1 << 20
"""So many bytes of messages are gathered before they become columns."""
_MAX_FIELDS: Final = 200
_MAX_DEPTH: Final = 5

_read_u32 = struct.Struct("<I").unpack_from
_pack_i64 = struct.Struct("<q").pack


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Where the numbers of one message type are.

    Attributes
    ----------
    md5 : str
        ROS 1's checksum of the definition.
    fields : str
        The flat fields behind the header, by name; those with a type other than float64 as ``name:type``.
    take : tuple of int
        The float64 numbers that become columns, counted from the first.
    strings : int
        Strings before the numbers: ``frame_id``, and for some ``child_frame_id``.
    lead : tuple of int
        Sizes of the small integers between the strings and the first float64; the first (int8) becomes a column.
    tail : bool
        Whether a uint8 follows the last float64; it becomes the last column.
    """

    md5: str
    fields: str
    take: tuple[int, ...]
    strings: int = 1
    lead: tuple[int, ...] = ()
    tail: bool = False

    @property
    def floats(self) -> int:
        """How many float64 numbers there are."""
        counts = (re.search(r"\[(\d+)\]", name) for name in self.fields.split() if ":" not in name)
        return sum(1 if count is None else int(count[1]) for count in counts)

    def gaps(self, encoding: Encoding) -> tuple[int, ...]:
        """Return the bytes from the end of the strings to the first float64, by that end's place modulo 8."""
        if encoding == "ros1":
            return (sum(self.lead),) * 8
        gaps = []
        for begin in range(8):
            at = begin
            for size in self.lead:
                at = -(-at // size) * size + size
            gaps.append(-(-at // 8) * 8 - begin)
        return tuple(gaps)


def _xyz(*names: str) -> str:
    return " ".join(f"{name}.{axis}" for name in names for axis in "xyz")


_TWIST: Final = _xyz("twist.linear", "twist.angular")
_TWIST_COVARIANCE: Final = _xyz("twist.twist.linear", "twist.twist.angular") + " twist.covariance[36]"

LAYOUTS: Final[dict[str, Layout]] = {
    # Columns: gyro, accel, and the first elements of their covariances.
    "sensor_msgs/Imu": Layout(
        md5="6a62c6daae103f4ff57a132d6f95cec2",
        fields=f"{_xyz('orientation')} orientation.w orientation_covariance[9] "
        f"{_xyz('angular_velocity')} angular_velocity_covariance[9] "
        f"{_xyz('linear_acceleration')} linear_acceleration_covariance[9]",
        take=(13, 14, 15, 25, 26, 27, 16, 28),
    ),
    # Columns: latitude, longitude, altitude, variances east, north, up; the status; the kind of covariance.
    "sensor_msgs/NavSatFix": Layout(
        md5="2d3a8cd499b9b4a0249fb98fd05cfa48",
        fields="status.status:int8 status.service:uint16 latitude longitude altitude position_covariance[9] "
        "position_covariance_type:uint8",
        take=(0, 1, 2, 3, 7, 11),
        lead=(1, 2),
        tail=True,
    ),
    # Columns: linear velocity; then, where there are, its variances.
    "geometry_msgs/TwistStamped": Layout(md5="98d34b0043a2093cf9d9345ab6eef12e", fields=_TWIST, take=(0, 1, 2)),
    "geometry_msgs/TwistWithCovarianceStamped": Layout(
        md5="8927a1a12fb2607ceea095b2dc440a96", fields=_TWIST_COVARIANCE, take=(0, 1, 2, 6, 13, 20)
    ),
    # Column: speed along x of the child frame.
    "nav_msgs/Odometry": Layout(
        md5="cd5e73d190d741a2f92e81eda573aca7",
        fields=f"child_frame_id:string {_xyz('pose.pose.position', 'pose.pose.orientation')} pose.pose.orientation.w "
        f"pose.covariance[36] {_TWIST_COVARIANCE}",
        take=(43, 44, 45),
        strings=2,
    ),
}
"""Every message type that is read, by its ROS 1 name."""


@dataclass(kw_only=True, eq=False)
class Samples:
    """Messages of one topic: when each was recorded and its own stamp, both (n,) ns; its numbers (n, k)."""

    record: IntArray
    stamp: IntArray
    values: FloatArray


@dataclass(eq=False)
class Rows:
    """Gathers the messages of one topic; those of another length or encoding than declared are counted in `broken`."""

    layout: Layout
    broken: int = 0
    _blocks: list[Samples] = field(default_factory=list)
    _buffers: dict[Encoding, bytearray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._size = 8 * self.layout.floats + int(self.layout.tail)
        self._row = 8 + 8 + 1 + self._size
        self._gaps = {encoding: self.layout.gaps(encoding) for encoding in ("ros1", "cdr")}

    def add(self, encoding: Encoding, record_ns: int, data: bytes) -> None:
        """Take one message: the time of its recording, and its bytes."""
        try:
            begin, end = self._places(encoding, data)
            row = _pack_i64(record_ns) + data[4:12] + data[begin : begin + 1] + data[end : end + self._size]
        except struct.error:
            begin, row = 0, b""
        if len(row) != self._row:
            self.broken += 1
            return
        buffer = self._buffers.setdefault(encoding, bytearray())
        buffer += row
        if len(buffer) >= _BLOCK:
            self._flush(encoding)

    def _places(self, encoding: Encoding, data: bytes) -> tuple[int, int]:
        """Return where the strings end and where the first float64 is; raise struct.error where there is none."""
        cdr = encoding == "cdr"
        if cdr and data[:2] != b"\0\1":
            raise struct.error("not little-endian CDR")
        begin = 12
        for _ in range(self.layout.strings):
            begin = -(-begin // 4) * 4 if cdr else begin
            begin += 4 + _read_u32(data, begin)[0]
        # Both headers have 4 bytes before the stamp, so CDR's places modulo 8 count from 4.
        first = begin + self._gaps[encoding][(begin - 4) & 7]
        # DDS may fill a message up to a multiple of 4.
        if not 0 <= len(data) - first - self._size <= (3 if cdr else 0):
            raise struct.error("another length")
        return begin, first

    def _flush(self, encoding: Encoding) -> None:
        seconds = "<u4" if encoding == "ros1" else "<i4"
        names: list[tuple[Any, ...]] = [("record", "<i8"), ("sec", seconds), ("nsec", "<u4"), ("lead", "i1")]
        names += [("numbers", "<f8", (self.layout.floats,))]
        names += [("tail", "u1")] if self.layout.tail else []
        table = np.frombuffer(bytes(self._buffers.pop(encoding)), dtype=np.dtype(names))
        columns = [table["numbers"][:, self.layout.take]]
        columns += [table["lead"][:, None]] if self.layout.lead else []
        columns += [table["tail"][:, None]] if self.layout.tail else []
        stamp = table["sec"].astype(np.int64) * 1_000_000_000 + table["nsec"]
        values = np.concatenate(columns, axis=1, dtype=np.float64)
        self._blocks.append(Samples(record=table["record"].copy(), stamp=stamp, values=values))

    def samples(self) -> Samples:
        """Return all messages in the order in which they were taken."""
        for encoding in tuple(self._buffers):
            self._flush(encoding)
        width = len(self.layout.take) + int(bool(self.layout.lead)) + int(self.layout.tail)
        none = np.empty(0, np.int64)
        blocks = self._blocks or [Samples(record=none, stamp=none, values=np.empty((0, width)))]
        return Samples(
            record=np.concatenate([b.record for b in blocks]),
            stamp=np.concatenate([b.stamp for b in blocks]),
            values=np.concatenate([b.values for b in blocks]),
        )


def plain_type(name: str) -> str:
    """Return a message type's ROS 1 name: ``sensor_msgs/Imu`` of ``sensor_msgs/msg/Imu``."""
    return name.replace("/msg/", "/")


def has_layout(definition: str, layout: Layout) -> bool:
    """Return whether a message definition (.msg text with all that it refers to) has the fields of a layout."""
    top, _, rest = definition.replace("\r", "").partition("\n===")
    parts = {"": top}
    for part in rest.split("\n==="):
        title, _, body = part.lstrip("=\n ").partition("\n")
        parts[_last(title)] = body
    # A definition that refers to itself would have no end.
    flat = [f"{name}:{kind}" for name, kind in islice(_flat(parts, "", "", 0), _MAX_FIELDS)]
    return " ".join(f for f in flat if not f.startswith("header.")).replace(":float64", "") == layout.fields


def _last(name: str) -> str:
    return name.strip().split("/")[-1]


def _flat(parts: Mapping[str, str], kind: str, before: str, depth: int) -> Iterator[tuple[str, str]]:
    """Yield name and type of the primitive fields; of an array the name has the count: ``covariance[36]``."""
    for line in parts[kind].splitlines():
        words = line.partition("#")[0].split()
        if len(words) < 2 or "=" in words[1] or words[2:3] == ["="]:
            continue
        declared, bracket, count = words[0].partition("[")
        name = f"{before}{words[1]}{bracket}{count}"
        inner = _last(declared)
        if inner not in parts or bracket or depth > _MAX_DEPTH:
            yield name, declared
        else:
            yield from _flat(parts, inner, f"{name}.", depth + 1)
