"""The sample drive as ArduPilot logs it, and the messages of which a DataFlash log is made."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from levelhead.logs.timescales import GPS_EPOCH_S, GPST, UTC, WEEK_S, between
from samples.cuts import between_records
from samples.drive import EPOCH_UTC_S, sample_drive

BOOT_S = 60.0
"""The autopilot was switched on this long before the drive began."""
EPOCH_GPST_S = EPOCH_UTC_S + between(UTC, GPST, EPOCH_UTC_S)
_CODES = {
    "Q": "Q",
    "B": "B",
    "f": "f",
    "I": "I",
    "H": "H",
    "c": "h",
    "C": "H",
    "L": "i",
    "e": "i",
    "E": "I",
    "N": "16s",
}

FORMATS = {
    "FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns"),
    "PARM": (64, "QNff", "TimeUS,Name,Value,Default"),
    "IMU": (130, "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"),
    "GPS": (131, "QBBIHBcLLeffffB", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U"),
    "GPA": (132, "QBCCCCfBIH", "TimeUS,I,VDop,HAcc,VAcc,SAcc,YAcc,VV,SMS,Delta"),
    "GYR": (133, "QBQfff", "TimeUS,I,SampleUS,GyrX,GyrY,GyrZ"),
    "ACC": (134, "QBQfff", "TimeUS,I,SampleUS,AccX,AccY,AccZ"),
}
PARAMETERS = (
    ("INS_GYROFFS_X", 0.015625),
    ("INS_ACC2OFFS_Z", -0.25),
    ("AHRS_ORIENTATION", 0.0),
    ("GPS1_DELAY_MS", 110.0),
    ("SYSID_THISMAV", 1.0),
)


def fmt(number: int, letters: str, name: str, labels: str) -> bytes:
    """Return the message that describes a kind."""
    size = 89 if name == "FMT" else 3 + struct.calcsize("<" + "".join(_CODES[c] for c in letters))
    texts = (name.encode(), letters.encode(), labels.encode())
    return struct.pack("<5B4s16s64s", 0xA3, 0x95, 128, number, size, *texts)


def message(name: str, *values: float | bytes) -> bytes:
    """Return a message of one of the kinds above; numbers as the file holds them, without units."""
    number, letters, _ = FORMATS[name]
    return struct.pack("<3B" + "".join(_CODES[c] for c in letters), 0xA3, 0x95, number, *values)


def parameter(name: str, value: float, time: float = 0.0) -> bytes:
    """Return the message of a parameter."""
    return message("PARM", microseconds(time), name.encode(), value, 0.0)


def head() -> bytes:
    """Return the descriptions and the parameters."""
    kinds = (fmt(number, letters, name, labels) for name, (number, letters, labels) in FORMATS.items())
    return b"".join((*kinds, *(parameter(name, value) for name, value in PARAMETERS)))


def microseconds(time: float) -> int:
    """Return the stamp of an instant of the drive."""
    return round((time + BOOT_S) * 1e6)


def readings(instance: int = 0, *, healthy: tuple[int, int] = (1, 1)) -> list[tuple[float, bytes]]:
    """Return an IMU's messages with their times; gyro and accelerometer healthy or not."""
    log = sample_drive()
    rest = (0, 0, 44.5, *healthy, 1000, 1000)
    return [
        (t, message("IMU", microseconds(t), instance, *w, *f, *rest))
        for t, w, f in zip(log.time, log.gyro, log.accel, strict=True)
    ]


def fixes(instance: int = 0, *, vertical: bool = True) -> list[tuple[float, bytes]]:
    """Return a receiver's messages with their times; the first two have no fix."""
    log = sample_drive()
    assert log.velocity_ned is not None
    assert log.position_llh is not None
    records = []
    for k, (t, (north, east, down), (lat, lon, height)) in enumerate(
        zip(log.gnss_time, log.velocity_ned, log.position_llh, strict=True)
    ):
        week, seconds = divmod(EPOCH_GPST_S + t - GPS_EPOCH_S, WEEK_S)
        place = (round(np.degrees(lat) * 1e7), round(np.degrees(lon) * 1e7), round(height * 100.0))
        motion = (np.hypot(north, east), np.degrees(np.arctan2(east, north)) % 360.0, down if vertical else 0.0)
        when = (microseconds(t), instance)
        fix = message("GPS", *when, 4 if k > 1 else 1, round(1e3 * seconds), int(week), 12, 80, *place, *motion, 0.0, 1)
        accuracy = message("GPA", *when, 120, 50, 75, 13, 0.0, int(vertical), 0, 200)
        records.append((t, fix + accuracy))
    return records


def in_order(*records: list[tuple[float, bytes]]) -> bytes:
    """Return messages in the order of their times."""
    return b"".join(body for _, body in sorted((r for one in records for r in one), key=lambda record: record[0]))


def _size_at(content: bytes, at: int) -> int:
    """Return the size of the message that begins here, which its description at the beginning tells."""
    if content[at + 2] == 128:
        return 89
    described = content.index(bytes([0xA3, 0x95, 128, content[at + 2]]))
    return content[described + 4]


CUT_UNSEEN = between_records(0, _size_at)


def write(folder: Path) -> Path:
    """Write the sample drive, with the same readings from two IMUs."""
    path = folder / "drive.bin"
    path.write_bytes(head() + in_order(readings(0), readings(1), fixes()))
    return path
