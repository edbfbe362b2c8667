"""PX4's ULog (``.ulg``): one of its IMUs and receivers, and the calibration that they were recorded with.

IMU streams, in the order in which one is chosen: ``sensor_combined`` and ``vehicle_imu.N`` are calibrated
(``CAL_GYRO*`` and ``CAL_ACC*`` taken off, turned by ``SENS_BOARD_ROT``) and means over the time between two samples, so
that vibration does not fold back into them; their stamps are those means' ends. ``sensor_gyro.N`` with
``sensor_accel.N`` are the sensors' own readings in the axes of the autopilot's board. All are FRD, rad/s and m/s^2. PX4
logs most of them once a second by default, which is too slow for anything: see `autopilot.MIN_RATE_HZ`.

Receivers: ``sensor_gps.N`` and ``vehicle_gps_position``, what PX4 chose or blended from them. Stamps are us since boot:
of the fix where the log has them (``timestamp_sample``, for which new versions take ``SENS_GPS*_DELAY`` off), else of
the message's arrival. Where a receiver knows UTC all stamps become UTC, as late as the receiver's messages are, so that
GNSS data from elsewhere fits too.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from levelhead.conventions import FloatArray
from levelhead.errors import LogError
from levelhead.events import Event
from levelhead.logs.datum import MEAN_SEA_LEVEL, WGS84, declared
from levelhead.logs.pieces import Fact, GnssData, Pieces, Stream, none_if_absent
from levelhead.logs.readers.autopilot import (
    ImuStream,
    Readings,
    Records,
    chosen,
    columns,
    imu_data,
    paired,
)
from levelhead.logs.readers.base import Reader, Source, choose
from levelhead.logs.readers.receivers import dropped, known_std, without_vertical
from levelhead.logs.readers.ulog import MAGIC, Topic, UlogFile
from levelhead.logs.timescales import UTC

CALIBRATION: Final = re.compile(
    r"CAL_(GYRO|ACC)\w*|SENS_BOARD_\w+|SENS_GPS\d*_DELAY|EKF2_GPS_DELAY|SENS_IMU_AUTOCAL|TC_[AG]_ENABLE"
)
"""Parameters that say what was done to the readings, or that an export of the estimates replaces."""
_APPLIED: Final = re.compile(r"CAL_(GYRO|ACC)\d_([XYZ](OFF|SCALE)|ROT)|SENS_BOARD_\w+")
_TURNED: Final = re.compile(r"(SENS_BOARD|CAL_GYRO\d|CAL_ACC\d)_ROT")
"""How the board lies in the vehicle, beyond the few degrees of its level trim (``SENS_BOARD_X_OFF``)."""
_REMAINS: Final = (
    "PX4 took the offsets of its calibration (CAL_GYRO*, CAL_ACC*) off the readings: an estimate is the bias that "
    "remained."
)
_NO_READING: Final = 2**31 - 1
"""What `accelerometer_timestamp_relative` holds where there is no reading."""
_MIN_FIX: Final = 3
_EARLIEST_UTC_US: Final = 10**15
"""September 2001: what lies before is a receiver that did not know the time yet."""
_MAX_AGE_US: Final = 10**6

_Fields = dict[str, tuple[int, ...]]
_COMBINED: Final[_Fields] = {
    "timestamp": (), "gyro_rad": (3,), "accelerometer_m_s2": (3,), "accelerometer_timestamp_relative": (),
}  # fmt: skip
_INCREMENTS: Final[_Fields] = {"timestamp": (), "delta_angle": (3,), "delta_velocity": (3,)}
_SENSOR: Final[_Fields] = {"timestamp": (), "x": (), "y": (), "z": ()}
_FIX: Final[_Fields] = {
    "timestamp": (), "time_utc_usec": (), "fix_type": (), "vel_n_m_s": (), "vel_e_m_s": (), "vel_d_m_s": (),
    "vel_ned_valid": (), "s_variance_m_s": (), "eph": (), "epv": (),
}  # fmt: skip
_PLACES: Final[tuple[tuple[_Fields, float, float], ...]] = (
    ({"latitude_deg": (), "longitude_deg": (), "altitude_msl_m": ()}, 1.0, 1.0),
    ({"lat": (), "lon": (), "alt": ()}, 1e-7, 1e-3),
)
"""Latitude, longitude and height over mean sea level, since PX4 1.14 and before; their units in degrees and metres."""


def sniff(_path: Path, head: bytes) -> bool:
    """Return whether the file begins as a ULog does."""
    return head.startswith(MAGIC)


def read(source: Source) -> Pieces:
    """Read a ULog.

    Raises
    ------
    LogError
        When it has neither IMU nor GNSS topics, or is not to be read without a newer version.
    """
    name = source.path.name
    log = UlogFile(source.path)
    imus, receivers = _imus(log), _receivers(log)
    if not receivers and (source.role == "gnss" or not imus):
        wanted = "GNSS topic" if source.role == "gnss" else "topic of an IMU or a receiver"
        have = ", ".join(sorted({topic for topic, _ in log.topics})[:12]) or "none"
        cut = " The file ends within a message: it was cut." if log.left_out else ""
        raise LogError(f"{name} has no {wanted} with samples (topics: {have}). {log.damaged}".rstrip() + cut)
    meta: dict[str, object] = {"calibration": dict(log.parameters.lasting(CALIBRATION, log.size))}
    events = _dropouts(log)
    gnss, boot_us = None, None
    if receivers:
        stream = choose([s for s, _ in receivers], source.gnss, name=name)
        gnss, boot_us, stamp, of_gnss = _gnss(log.records(next(t for s, t in receivers if s is stream)))
        meta |= {**declared(name, datum=WGS84, height=MEAN_SEA_LEVEL), "gnss_stamp": stamp}
        events += of_gnss
    if boot_us is not None:
        meta["boot_instant_s"] = boot_us * 1e-6
    imu, compensated, undeclared = None, "", tuple[Fact, ...]()
    if imus and source.role == "imu":
        one = chosen(imus, source)
        imu, of_imu = imu_data(one, name=name, boot_us=boot_us, time_scale=UTC)
        events += (*of_imu, *_changes(log, one))
        compensated = _REMAINS if one.calibrated else ""
        undeclared = () if one.in_body else ("axes",)
        meta |= {"imu_device_ids": one.devices} if one.devices else {}
    return Pieces(
        imu=imu,
        gnss=gnss,
        left_out=log.left_out,
        damaged=log.damaged,
        from_zero=True,
        meta=meta,
        events=events,
        streams=(*(i.stream for i in imus), *(s for s, _ in receivers)),
        compensated=compensated,
        undeclared=undeclared,
    )


def _has(topic: Topic, fields: _Fields) -> bool:
    """Return whether a topic has these fields, each a number or so many of them."""
    for name, shape in fields.items():
        if name not in (topic.dtype.names or ()):
            return False
        kind = topic.dtype[name]
        if kind.shape != shape or kind.base.kind not in "iuf":
            return False
    return True


def _topics(log: UlogFile, name: str, fields: _Fields) -> list[Topic]:
    """Return the instances of a topic that have samples and these fields."""
    found = [t for t in log.topics.values() if t.name == name and len(t.starts) and _has(t, fields)]
    return sorted(found, key=lambda topic: topic.instance)


def _rate(log: UlogFile, topic: Topic) -> float:
    first, last = log.ends(topic)["timestamp"].astype(np.float64)
    return float((len(topic.starts) - 1) / (last - first) * 1e6) if last > first else 0.0


def _imus(log: UlogFile) -> list[ImuStream]:
    """Return the IMU streams in the file, in the order of preference."""
    return [*_combined(log), *_increments(log), *_sensors(log)]


def _combined(log: UlogFile) -> list[ImuStream]:
    found = []
    for topic in _topics(log, "sensor_combined", _COMBINED):
        rate = _rate(log, topic)

        def readings(topic: Topic = topic) -> Readings:
            records = log.records(topic)
            time, relative = records["timestamp"].astype(np.float64), records["accelerometer_timestamp_relative"]
            accel = columns(records, ["accelerometer_m_s2"])
            gyro = columns(records, ["gyro_rad"])
            accel[relative == _NO_READING] = np.nan
            if ((relative != 0) & (relative != _NO_READING)).any():
                return paired(time, gyro, time + relative, accel)
            return Readings(time, gyro, accel)

        stream = Stream(
            kind="imu", name=_name(topic), samples=len(topic.starts), note=f"calibrated, vehicle axes, {rate:.0f} Hz"
        )
        found.append(
            ImuStream(
                stream=stream,
                rate=rate,
                rank=0,
                calibrated=True,
                in_body=True,
                devices=_selected(log)[-1],
                read=readings,
            )
        )
    return found


def _increments(log: UlogFile) -> list[ImuStream]:
    found = []
    for topic in _topics(log, "vehicle_imu", _INCREMENTS):
        spans = ["delta_angle_dt", "delta_velocity_dt"] if _has(topic, {"delta_angle_dt": ()}) else ["dt", "dt"]
        if not _has(topic, dict.fromkeys(spans, ())):
            continue
        rate = _rate(log, topic)

        def readings(topic: Topic = topic, spans: Sequence[str] = spans) -> Readings:
            records = log.records(topic)
            with np.errstate(divide="ignore", invalid="ignore"):
                gyro, accel = (
                    columns(records, [field]) / (columns(records, [span]) * 1e-6)
                    for field, span in zip(("delta_angle", "delta_velocity"), spans, strict=True)
                )
            return Readings(_sampled(records), gyro, accel)

        stream = Stream(
            kind="imu",
            name=f"vehicle_imu.{topic.instance}",
            samples=len(topic.starts),
            note=f"calibrated, vehicle axes, increments, {rate:.0f} Hz",
        )
        devices = _devices(log, topic, gyro="gyro_device_id", accel="accel_device_id")
        found.append(
            ImuStream(stream=stream, rate=rate, rank=1, calibrated=True, in_body=True, devices=devices, read=readings)
        )
    return found


def _sensors(log: UlogFile) -> list[ImuStream]:
    turned = any(value not in (0.0, -1.0) for value in log.parameters.lasting(_TURNED, log.size).values())
    accels = {topic.instance: topic for topic in _topics(log, "sensor_accel", _SENSOR)}
    found = []
    for topic in _topics(log, "sensor_gyro", _SENSOR):
        other = accels.get(topic.instance)
        if other is None:
            continue
        rate = min(_rate(log, topic), _rate(log, other))

        def readings(topic: Topic = topic, other: Topic = other) -> Readings:
            gyro, accel = log.records(topic), log.records(other)
            return paired(_sampled(gyro), columns(gyro, "xyz"), _sampled(accel), columns(accel, "xyz"))

        # Until PX4 1.10 the drivers took the offsets off; their topics had no stamp of the sample.
        calibrated = "timestamp_sample" not in (topic.dtype.names or ())
        note = f"{'calibrated' if calibrated else 'raw'}, the board's axes, {rate:.0f} Hz"
        stream = Stream(kind="imu", name=_name(topic, always=True), samples=len(topic.starts), note=note)
        devices = _devices(log, topic, gyro="device_id") | _devices(log, other, accel="device_id")
        found.append(
            ImuStream(
                stream=stream,
                rate=rate,
                rank=2,
                calibrated=calibrated,
                in_body=not turned,
                devices=devices,
                read=readings,
            )
        )
    return found


def _name(topic: Topic, *, always: bool = False) -> str:
    return f"{topic.name}.{topic.instance}" if topic.instance or always else topic.name


def _sampled(records: Records) -> FloatArray:
    """Return when what was sampled was, us since boot; the driver's stamp where it told no better one."""
    sent = records["timestamp"].astype(np.int64)
    if "timestamp_sample" not in (records.dtype.names or ()):
        return sent.astype(np.float64)
    sampled = records["timestamp_sample"].astype(np.int64)
    return np.where((sampled > sent - _MAX_AGE_US) & (sampled <= sent), sampled, sent).astype(np.float64)


def _devices(log: UlogFile, topic: Topic, **fields: str) -> dict[str, int]:
    """Return the sensors' own numbers (the ``CAL_*_ID`` of their calibration), by "gyro" and "accel"."""
    last = log.ends(topic)[-1]
    return {what: int(last[name]) for what, name in fields.items() if _has(topic, {name: ()})}


def _selected(log: UlogFile) -> list[dict[str, int]]:
    """Return the sensors that `sensor_combined` came from, one after the other; one that is empty where untold."""
    ids: _Fields = {"gyro_device_id": (), "accel_device_id": ()}
    chosen: list[dict[str, int]] = []
    for topic in _topics(log, "sensor_selection", {"timestamp": (), **ids})[:1]:
        records = log.records(topic)
        pairs = zip(records["gyro_device_id"].tolist(), records["accel_device_id"].tolist(), strict=True)
        for gyro, accel in pairs:
            if not chosen or chosen[-1] != {"gyro": gyro, "accel": accel}:
                chosen.append({"gyro": gyro, "accel": accel})
    return chosen or [{}]


def _changes(log: UlogFile, imu: ImuStream) -> tuple[Event, ...]:
    """Return what stepped in the readings because PX4 calibrated, or changed from one IMU to another."""
    if not imu.calibrated:
        return ()
    what = list(log.parameters.changed(_APPLIED))
    switches = len(_selected(log)) - 1 if imu.rank == 0 else 0
    if switches:
        what.append(f"sensor_combined went over to another IMU {switches} times")
    return (Event(code="W_CALIBRATION_CHANGED", count=len(what), detail=", ".join(what) + "."),) if what else ()


def _dropouts(log: UlogFile) -> tuple[Event, ...]:
    if not log.dropouts_ms:
        return ()
    detail = f"{len(log.dropouts_ms)} times, {sum(log.dropouts_ms)} ms in all."
    return (Event(code="W_LOGGER_DROPOUT", count=len(log.dropouts_ms), detail=detail),)


def _receivers(log: UlogFile) -> list[tuple[Stream, Topic]]:
    found = []
    for name in ("sensor_gps", "vehicle_gps_position"):
        for topic in _topics(log, name, _FIX):
            if any(_has(topic, place) for place, _, _ in _PLACES):
                label = _name(topic, always=name == "sensor_gps")
                note = "" if name == "sensor_gps" else "what PX4 chose or blended"
                found.append((Stream(kind="gnss", name=label, samples=len(topic.starts), note=note), topic))
    return found


def _gnss(records: Records) -> tuple[GnssData | None, float | None, str, tuple[Event, ...]]:
    """Return the fixes, the instant of boot in us of UTC where known, which stamp was used, and events."""
    fields, degree, metre = next(p for p in _PLACES if set(p[0]) <= set(records.dtype.names or ()))
    llh = columns(records, list(fields)) * (degree, degree, metre)
    there = (np.abs(llh[:, 0]) <= 90.0) & (np.abs(llh[:, 1]) <= 180.0) & np.isfinite(llh[:, 2])
    fixed = (records["fix_type"] >= _MIN_FIX) & there
    records, llh = records[fixed], llh[fixed]
    events = dropped(int((~fixed).sum()), "GNSS epochs without a 3D fix")
    velocity = columns(records, ["vel_n_m_s", "vel_e_m_s", "vel_d_m_s"])
    velocity[(records["vel_ned_valid"] == 0) | ~np.isfinite(velocity).all(axis=1)] = np.nan
    std = _sigmas(records, ["s_variance_m_s"] * 3)
    # From NMEA receivers PX4 has no vertical velocity, and leaves a zero.
    unknown = np.full(len(records), not np.nan_to_num(velocity[:, 2]).any())
    velocity, std, of_vertical = without_vertical(velocity, std, unknown)
    boot_us = _boot(records)
    time = _sampled(records)
    stamp = "timestamp_sample" if (time != records["timestamp"].astype(np.float64)).any() else "timestamp"
    known = none_if_absent(velocity)
    gnss = GnssData(
        time=(time + (boot_us or 0.0)) * 1e-6,
        velocity_ned=known,
        velocity_std=None if known is None else none_if_absent(std),
        position_llh=np.column_stack((np.radians(llh[:, :2]), llh[:, 2])),
        position_std=none_if_absent(_sigmas(records, ["eph", "eph", "epv"])),
        time_scale=None if boot_us is None else UTC,
    )
    return gnss if len(records) else None, boot_us, stamp, (*events, *of_vertical)


def _sigmas(records: Records, names: Sequence[str]) -> FloatArray:
    """Return standard deviations (m, 3), for that is what PX4 means by s_variance, eph and epv; 0 is unknown."""
    return known_std(columns(records, names))


def _boot(records: Records) -> float | None:
    """Return the instant of boot, us of UTC since 1970: the median over the fixes that tell UTC."""
    utc = records["time_utc_usec"].astype(np.int64)
    told = utc > _EARLIEST_UTC_US
    if not told.any():
        return None
    return float(np.median(utc[told] - records["timestamp"].astype(np.int64)[told]))


READER: Final = Reader(name="px4-ulog", title="PX4 ULog", sniff=sniff, read=read)
