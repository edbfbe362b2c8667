"""The example mappings on the recorded drives: units, axes, clock and mounting, checked against the GNSS data."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow.parquet as pq
import pytest

from levelhead.conventions import ACCEL_COLUMNS, GYRO_COLUMNS, TIME_COLUMN, FloatArray
from levelhead.logs.derive import velocity_from_position
from levelhead.logs.log import Log
from levelhead.logs.mapping import load_mapping
from levelhead.logs.pieces import GnssData, ImuData, join
from levelhead.logs.readers import read

MAPPINGS = Path(__file__).parents[2] / "examples" / "mappings"


@pytest.fixture(scope="module")
def rtklib(data_folder: Path) -> Log:
    folder = data_folder / "rtklib-drive"
    return read(folder / "imu_1934.csv", gnss=folder / "gnss_1934_sf.pos", mapping=MAPPINGS / "rtklib-gnss-imu.toml")


@pytest.fixture(scope="module", params=["first_test", "town"])
def neu(data_folder: Path, request: pytest.FixtureRequest) -> Log:
    folder, name = data_folder / "neu-freecode", str(request.param)
    log = read(folder / f"{name}_imu.csv", gnss=folder / f"{name}_gps.csv", mapping=MAPPINGS / "neu-freecode.toml")
    return velocity_from_position(log)


def integral(log: Log, values: FloatArray, at: FloatArray) -> FloatArray:
    """Integrate values (n,) by trapezoids over the IMU's stamps, from the first one to the instants `at`."""
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(log.time)
    return np.interp(at, log.time, np.concatenate(([0.0], np.cumsum(steps))))


class Motion(NamedTuple):
    """Motion between consecutive GNSS epochs, at more than 5 m/s."""

    start: FloatArray
    stop: FloatArray
    speed: FloatArray
    speed_rate: FloatArray
    course_change: FloatArray
    slope: FloatArray


def motion_of(log: Log) -> Motion:
    assert log.velocity_ned is not None
    north, east, down = log.velocity_ned.T
    speed, course = np.hypot(north, east), np.arctan2(east, north)
    start, stop = log.gnss_time[:-1], log.gnss_time[1:]
    # Inside by half a second, so that the latencies that are tried stay within the data.
    use = (np.minimum(speed[1:], speed[:-1]) > 5.0) & (start > log.time[0] + 0.5) & (stop < log.time[-1] - 0.5)
    turn = np.diff(course)
    turn -= 2.0 * np.pi * np.round(turn / (2.0 * np.pi))
    mean_speed = 0.5 * (speed[1:] + speed[:-1])
    return Motion(
        start=start[use],
        stop=stop[use],
        speed=mean_speed[use],
        speed_rate=(np.diff(speed) / (stop - start))[use],
        course_change=turn[use],
        slope=(-0.5 * (down[1:] + down[:-1]))[use] / mean_speed[use],
    )


def latency(log: Log) -> float:
    """Return the shift of the IMU's stamps with which the turns of yaw gyro and course agree best, s."""
    motion = motion_of(log)
    shifts = np.arange(-50.0, 51.0) / 100.0
    misfits = []
    for shift in shifts:
        turn = integral(log, log.gyro[:, 2], motion.stop - shift) - integral(log, log.gyro[:, 2], motion.start - shift)
        difference = turn - motion.course_change
        misfits.append(np.abs(difference - np.median(difference)).mean())
    return float(shifts[int(np.argmin(misfits))])


def leak_of_turns(log: Log) -> float:
    """Return how much of the lateral acceleration shows in the forward reading, by least squares."""
    motion = motion_of(log)
    period = motion.stop - motion.start
    forward = (integral(log, log.accel[:, 0], motion.stop) - integral(log, log.accel[:, 0], motion.start)) / period
    lateral = motion.speed * motion.course_change / period
    ones = np.ones_like(lateral)
    design = np.column_stack((lateral, motion.speed_rate, motion.slope, ones))
    return float(np.linalg.lstsq(design, forward, rcond=None)[0][0])


def test_the_car_roof_drive_is_read_as_its_notes_say(rtklib: Log) -> None:
    about = rtklib.describe()
    assert about["completeness"] == "complete"
    assert about["gnss_rate_hz"] == pytest.approx(4.0, rel=1e-6)  # stamps of 1 ms near 1.75e9 s
    assert about["imu_rate_hz"] == pytest.approx(100.0, rel=1e-3)  # stamps of 1 ms
    assert about["duration_s"] == pytest.approx(549.0, abs=1.0)  # as the notes give it
    assert about["distance_m"] == pytest.approx(4000.0, rel=0.05)  # as the notes give it
    assert rtklib.meta["gnss_time_scale"] == "GPST"
    # At rest after the drive, in deg/s, from the data's notes (which give z as the file does, upwards); vibration of
    # 2 deg/s over 10 s averages to 0.01.
    rest = rtklib.slice(rtklib.time[-1] - 10.0, np.inf)
    np.testing.assert_allclose(np.degrees(rest.gyro.mean(axis=0)), [0.0135, -0.045, -0.17], atol=0.03)
    # Gravity less 0.1 g of tilt and bias: the mapping's units and axes.
    np.testing.assert_allclose(rest.accel.mean(axis=0), [0.0, 0.0, -9.8], atol=1.5)


def test_the_zero_of_the_host_clock_is_that_of_the_tag_file(data_folder: Path) -> None:
    """RTKLIB's .tag: the start in GPST, then pairs of ms since the start and bytes received by then."""
    folder = data_folder / "rtklib-drive"
    tag = (folder / "imu_1934.csv.tag").read_bytes()
    seconds, fraction = struct.unpack("<Id", tag[64:76])
    received = np.frombuffer(tag[76:], dtype="<u4").reshape(-1, 2).astype(np.float64)
    lines = (folder / "imu_1934.csv").read_bytes().splitlines()
    stamps = np.array([float(line.rpartition(b",")[2]) for line in lines])
    # The stream had two bytes at each line's end; the file has lost one of them.
    ends = np.cumsum([len(line) + 2 for line in lines])
    assert ends[-1] == received[-1, 1]
    complete_ms = received[np.searchsorted(received[:, 1], ends), 0]
    zero = seconds + fraction + np.median(complete_ms - stamps) / 1000.0
    imu = load_mapping(MAPPINGS / "rtklib-gnss-imu.toml").imu
    assert imu is not None
    assert imu.time_zero_s == pytest.approx(zero, abs=0.001)  # the .tag counts whole milliseconds


def test_the_offset_of_the_mapping_brings_imu_and_gnss_together(rtklib: Log) -> None:
    # Course of the antenna and yaw of the car differ by up to 0.05 s of lead, as the antenna is not over the rear axle;
    # an offset of the wrong sign would leave -0.2 s or so.
    assert abs(latency(rtklib)) <= 0.08
    assert rtklib.velocity_ned is not None
    late = replace(rtklib, gnss_time=rtklib.gnss_time + 0.3)
    assert latency(late) == pytest.approx(latency(rtklib) + 0.3, abs=0.02)  # steps of 0.01 s


def test_the_mounting_yaw_keeps_turns_out_of_the_forward_axis(rtklib: Log, data_folder: Path, tmp_path: Path) -> None:
    # 1 %: 0.6 degrees of yaw. 0 or -5.35 degrees of mounting leave 10 % and 19 %.
    assert abs(leak_of_turns(rtklib)) < 0.01
    folder = data_folder / "rtklib-drive"
    wrong = tmp_path / "wrong.toml"
    text = (MAPPINGS / "rtklib-gnss-imu.toml").read_text(encoding="utf-8")
    wrong.write_text(text.replace("yaw = 5.35", "yaw = -5.35"), encoding="utf-8")
    log = read(folder / "imu_1934.csv", gnss=folder / "gnss_1934_sf.pos", mapping=wrong)
    assert leak_of_turns(log) == pytest.approx(np.sin(np.radians(2.0 * 5.35)), abs=0.02)  # 1 %, and cos of the yaw


def test_the_vn100_drives_are_read_as_their_notes_say(neu: Log) -> None:
    about = neu.describe()
    assert about["completeness"] == "complete"
    assert about["imu_rate_hz"] == pytest.approx(40.0, rel=0.01)  # the host's stamps jitter
    assert about["gnss_rate_hz"] == pytest.approx(1.0, rel=0.01)
    assert about["duration_s"] == pytest.approx(11.0 * 60.0, abs=20.0)
    # The static |accel| of the notes, 10.03 and 9.99; engine and road add a little.
    assert np.median(np.linalg.norm(neu.accel, axis=1)) == pytest.approx(10.01, abs=0.05)
    assert [event.code for event in neu.events] == ["I_VELOCITY_DERIVED"]
    # One-second steps blur the course; the scan by lateral and yaw motion gives 0.45 to 0.65 s on both drives.
    assert abs(latency(neu)) <= 0.15


def test_the_offset_of_the_tokyo_mapping_brings_imu_and_gnss_together(data_folder: Path) -> None:
    folder = data_folder / "tumsat-0412"
    imu, rtk = folder / "IMUData0412.mat", folder / "RTK0412.mat"
    log = read(imu, gnss=rtk, mapping=MAPPINGS / "tumsat-matlab.toml")
    plain = read(imu)
    np.testing.assert_array_equal(log.gyro, plain.gyro)
    assert log.velocity_ned is not None
    assert plain.velocity_ned is not None
    np.testing.assert_allclose(log.velocity_ned, plain.velocity_ned, atol=1e-12)  # rounding
    # Course of the antenna and yaw of the car differ in their lead, and the scan is blurred by urban outliers; without
    # the offset there is 0.5 s and more (the end of the scan) to find.
    assert abs(latency(log)) <= 0.1
    assert abs(latency(plain)) >= 0.45


def test_kitti_as_recorded_is_put_in_the_order_of_its_stamps(data_folder: Path) -> None:
    table = pq.read_table(data_folder / "kitti" / "2011_09_30_drive_0018.parquet")
    time, gyro, accel = (
        np.column_stack([table[name].to_numpy().astype(np.float64) for name in names])
        for names in ((TIME_COLUMN,), GYRO_COLUMNS, ACCEL_COLUMNS)
    )
    back = int((np.diff(time[:, 0]) < 0.0).sum())
    assert back > 0
    imu = ImuData(time=time[:, 0], gyro=gyro, accel=accel)
    log = join(imu, GnssData(time=np.array([1.0]), velocity_ned=np.ones((1, 3))))
    counts = {event.code: event.count for event in log.events}
    assert counts["I_REORDERED"] == back
    assert set(log.time) == set(time[:, 0])  # nothing lost but what is there twice
    assert log.time.size + counts.get("W_DUP_TIME", 0) == time.shape[0]
