"""The sample drive as PX4 logs it, and the messages of which a ULog is made."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from samples.cuts import between_records
from samples.drive import EPOCH_UTC_S, sample_drive

BOOT_S = 90.0
"""The autopilot was switched on this long before the drive began."""
HEADER = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1_000_000)
FLAGS = struct.pack("<HB16s3Q", 40, ord("B"), bytes(16), 0, 0, 0)

COMBINED = (
    "sensor_combined:uint64_t timestamp;float[3] gyro_rad;uint32_t gyro_integral_dt;"
    "int32_t accelerometer_timestamp_relative;float[3] accelerometer_m_s2;uint32_t accelerometer_integral_dt;"
    "uint8_t accelerometer_clipping;uint8_t[3] _padding0;"
)
GYRO = "sensor_gyro:uint64_t timestamp;uint64_t timestamp_sample;uint32_t device_id;float x;float y;float z;"
ACCEL = GYRO.replace("gyro", "accel")
INCREMENTS = (
    "vehicle_imu:uint64_t timestamp;uint64_t timestamp_sample;uint32_t accel_device_id;uint32_t gyro_device_id;"
    "float[3] delta_angle;float[3] delta_velocity;uint16_t delta_angle_dt;uint16_t delta_velocity_dt;"
)
SELECTION = "sensor_selection:uint64_t timestamp;uint32_t accel_device_id;uint32_t gyro_device_id;"
GPS = (
    "sensor_gps:uint64_t timestamp;uint64_t timestamp_sample;uint64_t time_utc_usec;double latitude_deg;"
    "double longitude_deg;double altitude_msl_m;float s_variance_m_s;float eph;float epv;float vel_n_m_s;"
    "float vel_e_m_s;float vel_d_m_s;uint8_t fix_type;bool vel_ned_valid;uint8_t[6] _padding0;"
)
PARAMETERS: Sequence[tuple[str, float | int]] = (
    ("CAL_GYRO0_ID", 2424842),
    ("CAL_GYRO0_XOFF", 0.015625),
    ("CAL_ACC0_ZOFF", -0.25),
    ("SENS_BOARD_ROT", 0),
    ("SENS_GPS0_DELAY", 110),
    ("MPC_XY_VEL_MAX", 12.0),
)


CUT_UNSEEN = between_records(16, lambda content, at: 3 + int.from_bytes(content[at : at + 2], "little"))


def message(kind: str, body: bytes) -> bytes:
    """Return one message of a ULog."""
    return struct.pack("<HB", len(body), ord(kind)) + body


def definition(text: str) -> bytes:
    """Return the message that defines a topic's fields."""
    return message("F", text.encode())


def parameter(name: str, value: float) -> bytes:
    """Return the message that tells a parameter: of the type int32 if the value is an int."""
    key = f"{'int32_t' if isinstance(value, int) else 'float'} {name}".encode()
    return message("P", bytes([len(key)]) + key + struct.pack("<i" if isinstance(value, int) else "<f", value))


def subscription(number: int, name: str, instance: int = 0) -> bytes:
    """Return the message that gives a topic its number."""
    return message("A", struct.pack("<BH", instance, number) + name.encode())


def data(number: int, layout: str, *values: float) -> bytes:
    """Return a record of a topic."""
    return message("D", struct.pack("<H" + layout, number, *values))


def head() -> bytes:
    """Return what stands before the data: header, flags, definitions, parameters."""
    texts = (COMBINED, GYRO, ACCEL, INCREMENTS, SELECTION, GPS)
    return b"".join((HEADER, FLAGS, *map(definition, texts), *(parameter(n, v) for n, v in PARAMETERS)))


def microseconds(time: float) -> int:
    """Return the stamp of an instant of the drive."""
    return round((time + BOOT_S) * 1e6)


def combined(number: int = 0) -> list[tuple[float, bytes]]:
    """Return the IMU's records with their times."""
    log = sample_drive()
    rows = zip(log.time, log.gyro, log.accel, strict=True)
    return [(t, data(number, "Q3fIi3fIB", microseconds(t), *g, 20000, 0, *a, 20000, 0)) for t, g, a in rows]


def fixes(number: int = 1) -> list[tuple[float, bytes]]:
    """Return the receiver's records: each arrives 0.1 s after its fix, before the first two there is none."""
    log = sample_drive()
    assert log.velocity_ned is not None
    assert log.position_llh is not None
    records = []
    for k, (t, velocity, (lat, lon, height)) in enumerate(
        zip(log.gnss_time, log.velocity_ned, log.position_llh, strict=True)
    ):
        utc = round((EPOCH_UTC_S + t + 0.1) * 1e6)
        place = (np.degrees(lat), np.degrees(lon), height)
        rest = (0.125, 0.5, 0.75, *velocity, 3 if k > 1 else 1, 1)
        stamps = (microseconds(t + 0.1), microseconds(t), utc)
        records.append((t + 0.1, data(number, "3Q3d6f2B", *stamps, *place, *rest)))
    return records


def in_order(*records: list[tuple[float, bytes]]) -> bytes:
    """Return records in the order of their times."""
    return b"".join(body for _, body in sorted((r for one in records for r in one), key=lambda record: record[0]))


def write(folder: Path) -> Path:
    """Write the sample drive."""
    topics = subscription(0, "sensor_combined") + subscription(1, "sensor_gps") + subscription(2, "sensor_selection")
    selected = data(2, "QII", microseconds(0.0), 2424842, 2424842)
    path = folder / "drive.ulg"
    path.write_bytes(head() + topics + selected + in_order(combined(), fixes()))
    return path
