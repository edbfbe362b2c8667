"""ArduPilot's DataFlash log (``.bin``): one of its IMUs and receivers, and the offsets that were in force.

IMU streams: ``IMU.N`` (messages IMU, in old logs also IMU2 and IMU3), filtered, at the rate of the vehicle's loop or
less; ``GYR.N`` (GYR with ACC, each with a stamp of its own), every sample, unfiltered, where ``LOG_BITMASK`` asks for
it. All are FRD, rad/s and m/s^2, in the vehicle's axes by ``AHRS_ORIENTATION`` but not levelled by ``AHRS_TRIM``, and
the offsets ``INS_GYROFFS``, ``INS_ACCOFFS`` and the like are off them. What ISBH and ISBD hold are bursts for spectra.

Receivers: ``GPS.N`` with their accuracies (GPA). Ground speed and course make the horizontal velocity, VZ is down, and
the height is over mean sea level. Stamps are us since boot, of receivers those of the message's arrival; where one
knows GPS time all stamps become GPST, as late as the receiver's messages are: so GNSS data from elsewhere fits too.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from levelhead.conventions import FloatArray
from levelhead.errors import LogError
from levelhead.events import Event
from levelhead.logs.datum import MEAN_SEA_LEVEL, WGS84, declared
from levelhead.logs.pieces import GnssData, Pieces, Stream
from levelhead.logs.pieces import none_if_absent as known
from levelhead.logs.readers.autopilot import (
    ImuStream,
    Parameters,
    Readings,
    Records,
    chosen,
    imu_data,
    paired,
)
from levelhead.logs.readers.base import Reader, Source, choose
from levelhead.logs.readers.dataflash import FMT_NUMBER, MAGIC, DataFlashFile, Kind, in_units
from levelhead.logs.readers.receivers import dropped, velocity_of, without_vertical
from levelhead.logs.timescales import GPST, gps_instant

CALIBRATION: Final = re.compile(
    r"INS\d?_(GYR|ACC)\d?(OFFS|SCAL)_[XYZ]|INS\d?_(GYR|ACC)\d?_ID|INS_GYR_CAL|INS_TCAL\d_ENABLE|AHRS_TRIM_[XYZ]"
    r"|AHRS_ORIENTATION|GPS\d?_DELAY_MS\d?"
)
"""Parameters that say what was done to the readings, or that an export of the estimates replaces."""
_APPLIED: Final = re.compile(r"INS\d?_(GYR|ACC)\d?(OFFS|SCAL)_[XYZ]|AHRS_ORIENTATION")
_REMAINS: Final = (
    "ArduPilot took its offsets (INS_GYROFFS, INS_ACCOFFS and the like) off the readings: an estimate is the bias that "
    "remained."
)
_GYRO: Final = ("GyrX", "GyrY", "GyrZ")
_ACCEL: Final = ("AccX", "AccY", "AccZ")
_FIX: Final = ("Status", "Lat", "Lng", "Alt", "Spd", "GCrs", "VZ")
_ACCURACY: Final = ("TimeUS", "HAcc", "VAcc", "SAcc")
_MIN_FIX: Final = 3
_BLENDED: Final = 2
"""The receiver of this number is made from the other two."""
_MAX_ACCURACY: Final = 655.0
"""An accuracy in cm that fills its 16 bits tells none, m or m/s."""
_STAMPS: Final = {"IMU": (("TimeUS", 1.0), ("TimeMS", 1e3)), "GPS": (("TimeUS", 1.0), ("T", 1e3))}
"""Stamps of the boot clock, in us, since 2015 and before. In old logs the TimeMS of a GPS message is GPS time."""


@dataclass(frozen=True, eq=False)
class _Rows:
    """The messages of one kind that belong to one sensor."""

    kind: Kind
    rows: Records

    def has(self, *names: str, kinds: str = "iuf") -> bool:
        """Return whether there are fields of these names, each one number."""
        return all(name in self.kind.units and self.kind.dtype[name].kind in kinds for name in names)

    def columns(self, *names: str) -> FloatArray:
        """Return fields side by side, shape (n, k)."""
        return in_units(self.kind, self.rows, names)

    def column(self, name: str) -> FloatArray:
        """Return one field, shape (n,)."""
        return self.columns(name)[:, 0]

    def stamps(self) -> FloatArray | None:
        """Return when they were, us since boot; None where that is not told."""
        for name, unit in _STAMPS[self.kind.name[:3]]:
            if self.has(name):
                return self.column(name) * unit
        return None


@dataclass(frozen=True, eq=False)
class _Receiver:
    stream: Stream
    fixes: _Rows
    time: FloatArray
    accuracies: _Rows | None


def sniff(_path: Path, head: bytes) -> bool:
    """Return whether the file begins with the message that describes descriptions."""
    return head.startswith(MAGIC + bytes([FMT_NUMBER, FMT_NUMBER]))


def read(source: Source) -> Pieces:
    """Read a DataFlash log.

    Raises
    ------
    LogError
        When it has neither IMU nor GPS messages.
    """
    name = source.path.name
    log = DataFlashFile(source.path)
    imus, receivers = _imus(log), _receivers(log)
    if not receivers and (source.role == "gnss" or not imus):
        wanted = "GPS messages" if source.role == "gnss" else "messages of an IMU or a receiver"
        have = ", ".join(sorted(kind.name for kind in log.kinds.values() if len(kind.starts))[:12]) or "none"
        cut = " The file ends within a message: it was cut." if log.left_out else ""
        raise LogError(f"{name} has no {wanted} (it has: {have}). {log.damaged}".rstrip() + cut)
    parameters = _parameters(log)
    meta: dict[str, object] = {"calibration": dict(parameters.lasting(CALIBRATION, log.size))}
    events: tuple[Event, ...] = ()
    gnss, boot_us = None, None
    if receivers:
        stream = choose([r.stream for r in receivers], source.gnss, name=name)
        gnss, boot_us, events = _gnss(next(r for r in receivers if r.stream is stream))
        meta |= declared(name, datum=WGS84, height=MEAN_SEA_LEVEL)
    if boot_us is not None:
        meta["boot_instant_s"] = boot_us * 1e-6
    imu = None
    if imus and source.role == "imu":
        one = chosen(imus, source)
        imu, of_imu = imu_data(one, name=name, boot_us=boot_us, time_scale=GPST)
        events += of_imu
        changed = parameters.changed(_APPLIED)
        if changed:
            events += (Event(code="W_CALIBRATION_CHANGED", count=len(changed), detail=", ".join(changed) + "."),)
        meta["imu_instance"] = int(one.stream.name.partition(".")[2])
    return Pieces(
        imu=imu,
        gnss=gnss,
        left_out=log.left_out,
        damaged=log.damaged,
        from_zero=True,
        meta=meta,
        events=events,
        streams=(*(i.stream for i in imus), *(r.stream for r in receivers)),
        compensated=_REMAINS if imu is not None else "",
    )


def _by_sensor(log: DataFlashFile, names: tuple[str, ...], needed: tuple[str, ...]) -> Iterator[tuple[int, _Rows]]:
    """Give the messages of these kinds by sensor: numbered by a field I, or in old logs by a kind for each."""
    for number, name in enumerate(names):
        kind = log.kinds.get(name)
        if kind is None or not len(kind.starts):
            continue
        rows = _Rows(kind, log.records(kind))
        if not rows.has(*needed):
            continue
        if not rows.has("I", kinds="iu"):
            yield number, rows
            continue
        instances = rows.rows["I"]
        for instance in np.unique(instances).tolist():
            yield instance, _Rows(kind, rows.rows[instances == instance])


def _imus(log: DataFlashFile) -> list[ImuStream]:
    """Return the IMU streams in the file, in the order of preference."""
    found = []
    for number, rows in _by_sensor(log, ("IMU", "IMU2", "IMU3"), (*_GYRO, *_ACCEL)):
        time = rows.stamps()
        if time is None or not rows.has(*_GYRO, *_ACCEL, kinds="f"):
            continue

        def readings(rows: _Rows = rows, time: FloatArray = time) -> Readings:
            accel = rows.columns(*_ACCEL)
            if rows.has("GH", "AH"):
                accel[(rows.rows["GH"] == 0) | (rows.rows["AH"] == 0)] = np.nan
            return Readings(time, rows.columns(*_GYRO), accel)

        found.append(_stream(f"IMU.{number}", time, "filtered", 0, readings))
    accels = dict(_by_sensor(log, ("ACC", "ACC1", "ACC2", "ACC3"), ("SampleUS", *_ACCEL)))
    for number, gyro in _by_sensor(log, ("GYR", "GYR1", "GYR2", "GYR3"), ("SampleUS", *_GYRO)):
        accel = accels.get(number)
        if accel is None:
            continue
        time = gyro.column("SampleUS")

        def both(gyro: _Rows = gyro, accel: _Rows = accel, time: FloatArray = time) -> Readings:
            return paired(time, gyro.columns(*_GYRO), accel.column("SampleUS"), accel.columns(*_ACCEL))

        # Kinds with a number of their own count from 1.
        first = 0 if gyro.kind.name == "GYR" else 1
        found.append(_stream(f"GYR.{number - first}", time, "unfiltered", 1, both))
    return found


def _stream(name: str, time: FloatArray, note: str, rank: int, readings: Callable[[], Readings]) -> ImuStream:
    span = time[-1] - time[0]
    rate = float((time.size - 1) / span * 1e6) if span > 0.0 else 0.0
    stream = Stream(kind="imu", name=name, samples=time.size, note=f"calibrated, {note}, {rate:.0f} Hz")
    return ImuStream(stream=stream, rate=rate, rank=rank, calibrated=True, in_body=True, read=readings)


def _parameters(log: DataFlashFile) -> Parameters:
    parameters = Parameters()
    kind = log.kinds.get("PARM")
    if kind is None or "Name" not in kind.units or not _Rows(kind, log.records(kind)).has("Value"):
        return parameters
    rows = log.records(kind)
    for name, value, position in zip(rows["Name"].tolist(), rows["Value"].tolist(), kind.starts, strict=True):
        parameters.add(bytes(name).decode("ascii", errors="replace"), float(value), position)
    return parameters


def _receivers(log: DataFlashFile) -> list[_Receiver]:
    accuracies = dict(_by_sensor(log, ("GPA", "GPA2", "GPAB"), _ACCURACY))
    found = []
    for number, rows in _by_sensor(log, ("GPS", "GPS2", "GPSB"), _FIX):
        time = rows.stamps()
        if time is not None:
            note = "blended from the others" if number == _BLENDED else ""
            stream = Stream(kind="gnss", name=f"GPS.{number}", samples=len(rows.rows), note=note)
            found.append(_Receiver(stream, rows, time, accuracies.get(number)))
    return found


def _gnss(receiver: _Receiver) -> tuple[GnssData | None, float | None, tuple[Event, ...]]:
    """Return the fixes, the instant of boot in us of GPST since 1970 where known, and events."""
    rows = receiver.fixes
    llh = rows.columns("Lat", "Lng", "Alt")
    there = (np.abs(llh[:, 0]) <= 90.0) & (np.abs(llh[:, 1]) <= 180.0) & np.isfinite(llh[:, 2])
    fixed = (rows.rows["Status"] >= _MIN_FIX) & there
    events = dropped(int((~fixed).sum()), "GNSS epochs without a 3D fix")
    rows, llh = _Rows(rows.kind, rows.rows[fixed]), llh[fixed]
    time = receiver.time[fixed]
    speed, course, down = rows.columns("Spd", "GCrs", "VZ").T
    velocity = velocity_of(speed, np.radians(course))
    velocity[:, 2] = down
    velocity[~np.isfinite(velocity).all(axis=1)] = np.nan
    horizontal, vertical, of_speed, told = _matched(time, receiver.accuracies)
    std = np.column_stack((of_speed, of_speed, of_speed))
    # Who does not say whether there is a vertical velocity, and never has one, has none.
    unknown = np.where(np.isnan(told), not np.nan_to_num(down).any(), told == 0.0)
    velocity, std, of_vertical = without_vertical(velocity, std, unknown)
    boot_us = _boot(rows, time)
    velocity_ned = known(velocity)
    gnss = GnssData(
        time=(time + (boot_us or 0.0)) * 1e-6,
        velocity_ned=velocity_ned,
        velocity_std=None if velocity_ned is None else known(std),
        position_llh=np.column_stack((np.radians(llh[:, :2]), llh[:, 2])),
        position_std=known(np.column_stack((horizontal, horizontal, vertical))),
        time_scale=None if boot_us is None else GPST,
    )
    return gnss if time.size else None, boot_us, (*events, *of_vertical)


def _matched(time: FloatArray, accuracies: _Rows | None) -> FloatArray:
    """Return HAcc, VAcc, SAcc and VV for fixes, shape (4, m): those with the fix's own stamp; NaN is unknown."""
    result = np.full((4, time.size), np.nan)
    if accuracies is None:
        return result
    stamps, first = np.unique(accuracies.column("TimeUS"), return_index=True)
    at = np.minimum(np.searchsorted(stamps, time), stamps.size - 1)
    same = stamps[at] == time
    values = accuracies.columns("HAcc", "VAcc", "SAcc")[first[at]].T
    result[:3] = np.where(same & (values > 0.0) & (values < _MAX_ACCURACY), values, np.nan)
    if accuracies.has("VV"):
        result[3] = np.where(same, accuracies.column("VV")[first[at]], np.nan)
    return result


def _boot(rows: _Rows, time: FloatArray) -> float | None:
    """Return the instant of boot, us of GPST since 1970: the median over the fixes that tell week and time in it."""
    names = ("GWk", "GMS") if rows.has("GWk", "GMS") else ("Week", "TimeMS")
    if not rows.has(*names):
        return None
    week, milliseconds = rows.columns(*names).T
    told = week > 0.0
    if not told.any():
        return None
    gps_us = 1e6 * gps_instant(week, 1e-3 * milliseconds)
    return float(np.median((gps_us - time)[told]))


READER: Final = Reader(name="ardupilot-bin", title="ArduPilot DataFlash (.bin)", sniff=sniff, read=read)
