"""From the topics of a ROS recording to IMU data and GNSS data; what ROS 1, ROS 2 and MCAP files share.

ROS declares rad/s, m/s^2, body axes FLU and navigation axes ENU (REP-103, REP-145), and that is what is taken, but many
drivers publish otherwise: the preflight looks for axes and velocity frame in the data.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import FloatArray
from levelhead.errors import LogError
from levelhead.events import Event
from levelhead.logs.datum import DATUM_KEY, ELLIPSOIDAL, HEIGHT_KEY, WGS84, declared
from levelhead.logs.pieces import FLU_TO_FRD, Fact, GnssData, ImuData, Pieces, Stream, none_if_absent
from levelhead.logs.readers.base import Source, choose
from levelhead.logs.readers.receivers import known_std, without_vertical
from levelhead.logs.readers.ros_files import Extent
from levelhead.logs.readers.ros_messages import (
    LAYOUTS,
    Encoding,
    IntArray,
    Layout,
    Rows,
    Samples,
    has_layout,
    plain_type,
)
from levelhead.logs.timescales import UTC

BoolArray = NDArray[np.bool_]
Add = Callable[[int, bytes], None]

PAIR_NS: Final = 10_000_000
"""Fix and velocity with stamps up to this far apart are one epoch, ns; others stay two: at 20 m/s these are 0.2 m."""
STRAY_S: Final = 60.0
"""A few stamps this much further from the time of recording than the others are broken, s."""
MAX_STRAY: Final = 0.01
"""Share of such stamps above which it is the clock that jumped."""
CLOCKS_APART_S: Final = 0.5
"""IMU and receiver whose stamps differ by this much more from the times of recording have a clock each, s."""
YEAR_2000_S: Final = 946_684_800.0
"""Stamps beyond this count from 1970; those of a simulation or of a clock that nobody set count from its start, s."""

_MAX_NAME: Final = 200

IMU: Final = "sensor_msgs/Imu"
FIX: Final = "sensor_msgs/NavSatFix"
TWISTS: Final = ("geometry_msgs/TwistWithCovarianceStamped", "geometry_msgs/TwistStamped")
ODOMETRY: Final = "nav_msgs/Odometry"

_VELOCITY: Final = re.compile(r"(\w+_)?vel(ocity)?(_\w+)?")
_RECEIVER: Final = re.compile(r"(?<![a-z])(gps|gnss|fix|ublox|navsat|novatel|septentrio)", re.IGNORECASE)
_COMMAND: Final = re.compile(
    r"cmd|command|desired|target|setpoint|wheel|odom|imu|ekf|filtered|ins(?![a-z])", re.IGNORECASE
)
_FILTERED: Final = re.compile(r"filtered|fused|ekf|odom|(?<![a-z])ins(?![a-z])", re.IGNORECASE)
_WHEELS: Final = re.compile(r"wheel|diff_?drive|velocity_controller|steering_controller|ackermann", re.IGNORECASE)
_NO_WHEELS: Final = re.compile(r"cmd|command|desired|filtered|ekf|visual|lidar|gps|gnss", re.IGNORECASE)


@dataclass(eq=False)
class Topics:
    """The topics of a recording that may be used, and their messages.

    Attributes
    ----------
    source : Source
        Of a file that is asked for GNSS data only, IMU topics are not gathered.
    rows : dict
        By topic and message type, in the order of appearance.
    refused : list of str
        Topics that declare another layout than their type has, or an encoding that is not known.
    """

    source: Source
    rows: dict[tuple[str, str], Rows] = field(default_factory=dict)
    refused: list[str] = field(default_factory=list)

    def open(
        self, topic: str, kind: str, encoding: str, *, md5: str | None = None, definition: str | None = None
    ) -> Add | None:
        """Return what takes the messages of a topic (time of recording in ns, bytes), or None where it is not used.

        Parameters
        ----------
        topic, kind : str
            The topic and its message type.
        encoding : str
            "ros1" or "cdr".
        md5, definition : str, optional
            ROS 1's checksum of the definition, or its text, where the file has one: checked.
        """
        kind = plain_type(kind)
        # What a file calls its topics goes to terminals and pages.
        topic = "".join(c if c.isprintable() else "?" for c in topic[:_MAX_NAME])
        layout = LAYOUTS.get(kind)
        if layout is None or (kind == IMU and self.source.role == "gnss") or not _may_be_used(topic, kind):
            return None
        if encoding not in ("ros1", "cdr"):
            self.refused.append(f"{topic}: the message encoding {encoding[:20]!r} is not known")
            return None
        if not _as_declared(layout, md5, definition):
            self.refused.append(f"{topic}: the file declares other fields than {kind} has")
            return None
        add = self.rows.setdefault((topic, kind), Rows(layout)).add
        form: Encoding = "ros1" if encoding == "ros1" else "cdr"
        return lambda record_ns, data: add(form, record_ns, data)


def _may_be_used(topic: str, kind: str) -> bool:
    """Return whether a topic of this name and type may hold what is looked for, not a command or a filter's output."""
    if kind in (IMU, FIX):
        return True
    wheels = is_wheels(topic)
    return wheels if kind == ODOMETRY else wheels or not _COMMAND.search(topic)


def is_wheels(topic: str) -> bool:
    """Return whether a topic's name says that it holds what the wheels tell, and no more than that."""
    return _WHEELS.search(topic) is not None and _NO_WHEELS.search(topic) is None


def _as_declared(layout: Layout, md5: str | None, definition: str | None) -> bool:
    if md5 is not None and md5 != "*":
        return md5 == layout.md5
    return definition is None or has_layout(definition, layout)


# What a damaged file holds may be no number at all.
@np.errstate(invalid="ignore", over="ignore")
def pieces(topics: Topics, extent: Extent, meta: Mapping[str, str] | None = None) -> Pieces:
    """Return the IMU data and GNSS data among the topics of a recording.

    Parameters
    ----------
    topics : Topics
        All messages of the recording.
    extent : Extent
        How much of it was read.
    meta : mapping, optional
        What levelhead itself wrote into the file (see `levelhead.logs.mcap_writer`): axes and frames are then known.

    Raises
    ------
    LogError
        When there is neither an IMU nor a receiver, or not the one that the user wants.
    """
    source, name = topics.source, topics.source.path.name
    drive = _Drive(topics)
    imus = [Stream(kind="imu", name=n, samples=s.stamp.size) for n, s in drive.of(IMU).items() if s.stamp.size]
    receivers = drive.receivers()
    streams = [
        Stream(kind="gnss", name=n, samples=s.stamp.size, note=f"velocity from {v}" if v else "positions only")
        for n, (s, v) in receivers.items()
    ]
    imu = choose(_measured_first(imus, source.imu), source.imu, name=name)
    gnss = choose(_measured_first(streams, source.gnss), source.gnss, name=name)
    if imu is None and gnss is None:
        reasons = "".join(f" {r[:1].upper()}{r[1:]}." for r in topics.refused)
        if extent.places or extent.left_out:
            reasons += f" The file is damaged: {extent.sentence(name) or 'its end is missing.'}"
        raise LogError(
            f"{name} has no messages of the types {IMU} or {FIX} that can be used.{reasons} Record the topics of IMU "
            "and receiver."
        )
    known = meta is not None
    imu_data = None if imu is None else drive.imu(imu.name)
    gnss_data = None if gnss is None else drive.gnss(*receivers[gnss.name][1:], fix=gnss.name)
    undeclared: list[Fact] = [] if known or imu is None else ["axes"]
    if not known and gnss_data is not None and gnss_data.velocity_ned is not None:
        undeclared.append("velocity_frame")
    if imu is not None and gnss is not None and drive.apart(imu.name, gnss.name) > CLOCKS_APART_S:
        undeclared.append("clock")
    return Pieces(
        imu=imu_data,
        gnss=gnss_data,
        meta=_meta(name, gnss_data, meta or {}) | ({} if imu_data is None else {"dcm_file_to_body": FLU_TO_FRD}),
        events=drive.events(),
        streams=(*imus, *streams),
        compensated=_compensated(meta or {}),
        undeclared=tuple(undeclared),
        left_out=extent.left_out,
        damaged=extent.sentence(name),
        host_clock=True,
    )


def _measured_first(streams: Sequence[Stream], wanted: str | None) -> Sequence[Stream]:
    """Return the streams to choose from: raw ones first, and none that a filter made where there are others.

    A filter's output often has more samples than what was measured.
    """
    if wanted is not None:
        return streams
    measured = [s for s in streams if not _FILTERED.search(s.name)] or streams
    return sorted(measured, key=lambda s: not s.name.endswith("raw"))


def _meta(name: str, gnss: GnssData | None, written: Mapping[str, str]) -> dict[str, object]:
    """Return what is known of the positions: NavSatFix declares WGS 84 and heights over its ellipsoid."""
    meta: dict[str, object] = {}
    if written.get("earth_rotation") == "false":
        meta["earth_rotation"] = False
    if gnss is None or gnss.position_llh is None:
        return meta
    height = written.get(HEIGHT_KEY, "" if written else ELLIPSOIDAL) or None
    return meta | declared(name, datum=written.get(DATUM_KEY, WGS84), height=height)


def _compensated(written: Mapping[str, str]) -> str:
    by = written.get("corrected_by")
    if by is None:
        return ""
    return f"The biases that levelhead's {by[:40]} estimated were taken off; an estimate is of what is left of them."


class _Drive:
    """The messages of a recording on their way to `ImuData` and `GnssData`; keeps account of what is left out."""

    def __init__(self, topics: Topics) -> None:
        self._dropped: dict[str, int] = {}
        self._recorded: list[tuple[str, int]] = []
        self._ahead: dict[str, float] = {}
        self._flat: int = 0
        for text in topics.refused:
            self._drop(text, 1)
        self._kinds: dict[str, dict[str, Samples]] = {}
        for (topic, kind), rows in topics.rows.items():
            self._drop(f"{topic}: messages that are not whole", rows.broken)
            samples = rows.samples()
            if samples.stamp.size:
                self._kinds.setdefault(kind, {})[topic] = self._stamped(topic, samples)
        imus = self._kinds.get(IMU, {})
        for topic, samples in imus.items():
            imus[topic] = self._measured(topic, samples)

    def of(self, kind: str) -> dict[str, Samples]:
        """Return the topics of one message type."""
        return self._kinds.get(kind, {})

    def apart(self, one: str, other: str) -> float:
        """Return how much more the stamps of one topic differ from the times of recording than another's, s."""
        return abs(self._ahead.get(one, 0.0) - self._ahead.get(other, 0.0))

    def _drop(self, why: str, count: int) -> None:
        if count:
            self._dropped[why] = self._dropped.get(why, 0) + count

    def _stamped(self, topic: str, samples: Samples) -> Samples:
        """Return the messages whose stamps tell their time; where hardly any does, all at the time of recording."""
        unset = (samples.stamp == 0) & (samples.record != 0)
        if unset.mean() > 0.5:
            self._recorded.append((topic, samples.stamp.size))
            return Samples(record=samples.record, stamp=samples.record, values=samples.values)
        self._drop(f"{topic}: messages without a stamp", int(unset.sum()))
        offset = (samples.stamp.astype(np.float64) - samples.record.astype(np.float64)) / 1e9
        stray = ~unset & (np.abs(offset - np.median(offset[~unset])) > STRAY_S)
        # Where many are, the clock was set during the drive, which is judged later.
        stray &= stray.mean() <= MAX_STRAY
        self._drop(f"{topic}: messages with a stamp far from the others'", int(stray.sum()))
        self._ahead[topic] = float(np.median(offset[~unset]))
        return _rows(samples, ~unset & ~stray)

    def _measured(self, topic: str, samples: Samples) -> Samples:
        """Leave out messages without rate or acceleration: their covariance says so (-1), or all of them are zero."""
        values = samples.values
        absent = np.zeros(values.shape[0], np.bool_)
        for part, covariance in ((values[:, :3], values[:, 6]), (values[:, 3:6], values[:, 7])):
            zero = (part == 0.0).all(axis=1)
            absent |= zero & ((covariance == -1.0) | zero.all())
        self._drop(f"{topic}: messages without angular rate or without acceleration", int(absent.sum()))
        return _rows(samples, ~absent)

    def imu(self, topic: str) -> ImuData:
        """Return one IMU, turned from FLU to FRD, with the wheel speed where a topic has it."""
        samples = self.of(IMU)[topic]
        flip = np.diag(FLU_TO_FRD)
        time = _seconds(samples.stamp)
        return ImuData(
            time=time,
            gyro=samples.values[:, :3] * flip,
            accel=samples.values[:, 3:6] * flip,
            wheel_speed=self._wheel_speed(samples.stamp),
            time_scale=_scale(time),
        )

    def _wheel_speed(self, stamp: IntArray) -> FloatArray | None:
        """Return the speed of the wheels at the nearest IMU samples, or None where no topic has it."""
        topics = [s for kind in (ODOMETRY, *TWISTS) for t, s in self.of(kind).items() if is_wheels(t) and s.stamp.size]
        if not topics or stamp.size < 2:
            return None
        wheels = max(topics, key=lambda s: s.stamp.size)
        order = np.argsort(stamp, kind="stable")
        near = order[_nearest(stamp[order], wheels.stamp)]
        apart = np.abs(stamp[near] - wheels.stamp)
        speed = np.full(stamp.size, np.nan)
        close = apart <= 0.5 * np.median(np.diff(stamp[order])) + 1.0
        # Of two for one sample the nearer is written last.
        last = np.flatnonzero(close)[np.argsort(-apart[close], kind="stable")]
        speed[near[last]] = wheels.values[last, 0]
        return none_if_absent(np.where(np.isfinite(speed), speed, np.nan))

    def receivers(self) -> dict[str, tuple[Samples, str | None]]:
        """Return the messages of every receiver by the topic of its fixes, and the topic of its velocities."""
        fixes = {topic: samples for topic, samples in self.of(FIX).items() if samples.stamp.size}
        twists = [t for kind in TWISTS for t, s in self.of(kind).items() if s.stamp.size and not is_wheels(t)]
        found: dict[str, tuple[Samples, str | None]] = {}
        for topic, samples in fixes.items():
            velocity = _velocity_topic(topic, twists, alone=len(fixes) == 1)
            found[topic] = samples, velocity
        taken = {velocity for _, velocity in found.values()}
        for topic in twists:
            if topic not in taken and _RECEIVER.search(topic):
                found.setdefault(topic, (self._twist(topic), topic))
        return found

    def _twist(self, topic: str) -> Samples:
        return next(self.of(kind)[topic] for kind in TWISTS if topic in self.of(kind))

    def gnss(self, velocity: str | None, *, fix: str) -> GnssData | None:
        """Return one receiver's epochs, ENU turned to NED: a fix and the velocity with its stamp are one epoch."""
        velocities = None if velocity is None else self._twist(velocity)
        fixes = self.of(FIX).get(fix)
        stamp, fix_row, twist_row = _paired(fixes, velocities)
        position, position_std, no_fix = _positions(fixes, fix_row)
        velocity_ned, velocity_std = self._velocities(velocities, twist_row)
        self._drop(f"{fix}: epochs without a fix", int(no_fix.sum()))
        bare = ~no_fix & ~np.isfinite(position[:, 0]) & ~np.isfinite(velocity_ned).all(axis=1)
        self._drop(f"{fix}: epochs with neither a whole position nor a velocity", int(bare.sum()))
        use = ~no_fix & ~bare
        if not use.any():
            return None
        time = _seconds(stamp[use])
        llh = none_if_absent(position[use])
        return GnssData(
            time=time,
            velocity_ned=none_if_absent(velocity_ned[use]),
            velocity_std=none_if_absent(velocity_std[use]),
            position_llh=llh,
            position_std=None if llh is None else none_if_absent(position_std[use]),
            time_scale=_scale(time),
        )

    def _velocities(self, twists: Samples | None, rows: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return velocity and sigma (m, 3), NED, of the rows of twists (-1: none)."""
        absent = np.full((rows.size, 3), np.nan)
        if twists is None:
            return absent, absent
        has = rows >= 0
        velocity, std = absent.copy(), absent.copy()
        values = twists.values[rows[has]]
        velocity[has] = _ned(values[:, :3])
        if values.shape[1] == 6:
            std[has] = _deviations(values[:, 3:6])
        whole = np.isfinite(velocity).all(axis=1)
        velocity[~whole] = np.nan
        # A receiver measures a vertical velocity of exactly zero now and then, not always.
        flat = whole.any() and not velocity[whole, 2].any() and velocity[whole, :2].any()
        if flat and not np.isfinite(std[whole, 2]).any():
            velocity, std, _ = without_vertical(velocity, std, whole)
            self._flat += int(whole.sum())
        return velocity, std

    def events(self) -> tuple[Event, ...]:
        """Return what was left out or replaced, counted."""
        events = []
        if self._dropped:
            detail = "; ".join(f"{why} ({count})" for why, count in self._dropped.items())
            events.append(Event(code="W_DROPPED", count=sum(self._dropped.values()), detail=f"{detail}."))
        if self._recorded:
            detail = ", ".join(topic for topic, _ in self._recorded)
            events.append(Event(code="W_RECORD_TIME", count=sum(n for _, n in self._recorded), detail=f"{detail}."))
        if self._flat:
            events.append(Event(code="I_VELOCITY_2D", count=self._flat))
        return tuple(events)


def _velocity_topic(fix: str, twists: Sequence[str], *, alone: bool) -> str | None:
    """Return the topic of the velocities that go with the fixes of a topic: by its name, else by its folder."""
    folder, _, leaf = fix.rpartition("/")
    for topic in (f"{fix}_velocity", f"{fix}/velocity", f"{folder}/{leaf}_vel", f"{folder}/vel", f"{folder}/velocity"):
        if topic in twists:
            return topic
    beside = [t for t in twists if t.rpartition("/")[0] == folder and _VELOCITY.fullmatch(t.rpartition("/")[2])]
    if len(beside) == 1:
        return beside[0]
    named = [t for t in twists if _RECEIVER.search(t)]
    return named[0] if alone and len(named) == 1 else None


def _paired(fixes: Samples | None, twists: Samples | None) -> tuple[IntArray, IntArray, IntArray]:
    """Return the stamps of all epochs in their order (ns), and the rows of their fix and velocity, -1 where none is."""
    none = np.empty(0, np.int64)
    at_fix = none if fixes is None else fixes.stamp
    at_twist = none if twists is None else twists.stamp
    partner = np.full(at_twist.size, -1, np.int64)
    if at_fix.size and at_twist.size:
        order = np.argsort(at_fix, kind="stable")
        near = order[_nearest(at_fix[order], at_twist)]
        close = np.flatnonzero(np.abs(at_fix[near] - at_twist) <= PAIR_NS)
        # A fix has one velocity: the first of those that are near.
        _, first = np.unique(near[close], return_index=True)
        partner[close[first]] = near[close[first]]
    twist_of = np.full(at_fix.size, -1, np.int64)
    twist_of[partner[partner >= 0]] = np.flatnonzero(partner >= 0)
    alone = np.flatnonzero(partner < 0)
    stamp = np.concatenate((at_fix, at_twist[alone]))
    fix_row = np.concatenate((np.arange(at_fix.size), np.full(alone.size, -1)))
    twist_row = np.concatenate((twist_of, alone))
    order = np.argsort(stamp, kind="stable")
    return stamp[order], fix_row[order], twist_row[order]


def _positions(fixes: Samples | None, rows: IntArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return positions (m, 3) rad and m, their sigmas (m, 3) NED, NaN where absent, and which rows tell of no fix."""
    position, std = np.full((rows.size, 3), np.nan), np.full((rows.size, 3), np.nan)
    no_fix = np.zeros(rows.size, np.bool_)
    if fixes is None:
        return position, std, no_fix
    has = np.flatnonzero(rows >= 0)
    values = fixes.values[rows[has]]
    llh, variances, status, kind = values[:, :3], values[:, 3:6], values[:, 6], values[:, 7]
    no_fix[has] = status < 0.0
    on_globe = (np.abs(llh[:, 0]) <= 90.0) & (np.abs(llh[:, 1]) <= 360.0) & np.isfinite(llh[:, 2])
    # Latitude and longitude of exactly zero are what drivers publish before they have any.
    on_globe &= (llh[:, 0] != 0.0) | (llh[:, 1] != 0.0)
    whole = has[on_globe]
    position[whole] = np.column_stack((np.radians(llh[on_globe, :2]), llh[on_globe, 2]))
    known = on_globe & (kind > 0.0)
    std[has[known]] = _deviations(variances[known])
    return position, std, no_fix


def _ned(enu: FloatArray) -> FloatArray:
    """Return vectors (n, 3) in NED."""
    return np.column_stack((enu[:, 1], enu[:, 0], -enu[:, 2]))


def _deviations(variances: FloatArray) -> FloatArray:
    """Return sigmas, NED, of variances, ENU; ROS writes 0 or -1 where none is known."""
    return np.sqrt(known_std(variances)[:, (1, 0, 2)])


def _nearest(sorted_stamps: IntArray, wanted: IntArray) -> IntArray:
    """Return the places of the nearest of sorted stamps."""
    right = np.searchsorted(sorted_stamps, wanted).clip(1, max(sorted_stamps.size - 1, 1))
    right = np.minimum(right, sorted_stamps.size - 1)
    left = np.maximum(right - 1, 0)
    nearer = wanted - sorted_stamps[left] <= sorted_stamps[right] - wanted
    return np.asarray(np.where(nearer, left, right), np.int64)


def _rows(samples: Samples, rows: BoolArray) -> Samples:
    return Samples(record=samples.record[rows], stamp=samples.stamp[rows], values=samples.values[rows])


def _seconds(stamp: IntArray) -> FloatArray:
    """Return stamps in s: the nearest number where ns are exact, else (since 1970) within 0.24 microseconds."""
    if stamp.size and np.abs(stamp).max() < 2**53:
        return stamp / 1e9
    seconds = stamp // 1_000_000_000
    return seconds + (stamp - seconds * 1_000_000_000) / 1e9


def _scale(time: FloatArray) -> Literal["UTC"] | None:
    """Return the time scale of stamps: ROS stamps by the clock of the computer, which counts UTC where it is set."""
    return UTC if time.size and float(np.median(time)) > YEAR_2000_S else None
