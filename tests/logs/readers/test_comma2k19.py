"""comma2k19: arrays without suffix, several gyros and receivers, speed and bearing, wheels, minutes in a row."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from hostile import cases
from levelhead.conventions import FloatArray
from levelhead.errors import LevelheadError, LogError
from levelhead.logs.log import Log
from levelhead.logs.pieces import Stream
from levelhead.logs.readers import read
from samples import comma2k19 as sample
from samples.drive import sample_drive


@pytest.fixture
def segment(tmp_path: Path) -> Path:
    return sample.write(tmp_path)


def codes(log: Log) -> dict[str, int]:
    return {event.code: event.count for event in log.events}


def signal(segment: Path, name: str) -> Path:
    return segment / "processed_log" / name


def test_the_drive_comes_back_with_horizontal_velocities(segment: Path) -> None:
    log, truth = read(segment), sample_drive()
    assert truth.position_llh is not None
    assert log.position_llh is not None
    # The boot clock resolves 7e-12 s.
    np.testing.assert_allclose(log.time, truth.time, atol=1e-10)
    np.testing.assert_array_equal(log.accel, truth.accel)
    np.testing.assert_allclose(log.gyro - truth.gyro, [[-0.01, -0.035, 0.068]] * truth.time.size, atol=1e-15)
    assert truth.velocity_ned is not None
    assert log.velocity_ned is not None
    assert log.velocity_std is not None
    np.testing.assert_allclose(log.velocity_ned[:, :2], truth.velocity_ned[:, :2], atol=1e-13)  # rounding
    np.testing.assert_array_equal(log.velocity_ned[:, 2], 0.0)
    assert np.isnan(log.velocity_std[:, :2]).all()
    speed = np.hypot(*log.velocity_ned[:, :2].T)
    np.testing.assert_allclose(log.velocity_std[:, 2], np.maximum(0.5, 0.05 * speed), rtol=1e-12)
    np.testing.assert_allclose(log.position_llh, truth.position_llh, rtol=1e-15)  # degrees and back
    assert codes(log) == {"I_VELOCITY_2D": truth.gnss_time.size}
    assert log.meta["height"] == "ellipsoidal"


def test_stamps_of_messages_are_made_even_by_the_utc_in_them(segment: Path) -> None:
    # Half of the messages are 20 ms late: the even stamps are right but for the median of that, and milliseconds of
    # Unix time resolve 2.4e-7 s.
    log, truth = read(segment), sample_drive()
    offset = log.gnss_time - truth.gnss_time
    assert np.ptp(offset) < 1e-6
    assert 0.0 <= offset[0] <= 0.02


def test_the_utc_is_not_followed_where_it_is_another_clock(segment: Path) -> None:
    path = signal(segment, "GNSS/live_gnss_ublox/value")
    fixes = np.load(path)
    fixes[:, 3] *= 1.1
    save(path, fixes)
    np.testing.assert_allclose(read(segment).gnss_time[:2], [0.0, 0.22], atol=1e-10)


def test_streams_are_listed_and_chosen(segment: Path) -> None:
    log = read(segment)
    streams = log.meta["streams"]
    assert isinstance(streams, tuple)
    assert all(isinstance(stream, Stream) for stream in streams)
    counts = {(stream.kind, stream.name): stream.samples for stream in streams}
    n, m = sample_drive().time.size, sample_drive().gnss_time.size
    assert counts == {
        ("imu", "gyro_uncalibrated"): n,
        ("imu", "gyro"): n,
        ("gnss", "live_gnss_ublox"): m,
        ("gnss", "live_gnss_qcom"): (m + 4) // 5,
    }
    assert "compensated" not in log.meta
    calibrated = read(segment, imu="gyro", gnss="live_gnss_qcom")
    np.testing.assert_array_equal(calibrated.gyro, sample_drive().gyro)
    assert "Android took its own estimate" in str(calibrated.meta["compensated"])
    assert calibrated.gnss_time.size == (m + 4) // 5
    assert "height" not in calibrated.meta
    with pytest.raises(LogError, match="has no IMU called 'magnetic'; choose one of: gyro_uncalibrated"):
        read(segment, imu="magnetic")


def test_the_mean_of_the_wheels_is_at_the_nearest_imu_sample(segment: Path) -> None:
    log = read(segment)
    assert log.wheel_speed is not None
    known = np.flatnonzero(np.isfinite(log.wheel_speed))
    np.testing.assert_array_equal(known, np.arange(0, 1500, 2))  # 25 Hz on 50 Hz
    truth = sample_drive()
    assert truth.velocity_ned is not None
    speed = np.interp(log.time, truth.gnss_time, np.hypot(*truth.velocity_ned[:, :2].T))
    np.testing.assert_allclose(log.wheel_speed[known], speed[known], atol=1e-9)  # the clock's rounding
    shutil.rmtree(signal(segment, "CAN"))
    assert read(segment).wheel_speed is None


def test_an_accelerometer_with_stamps_of_its_own_is_read_between_them(segment: Path) -> None:
    path = signal(segment, "IMU/accelerometer")
    time, force = np.load(path / "t"), np.load(path / "value")
    late = time + 0.004
    moved = np.column_stack([np.interp(late, time, column) for column in force.T])
    save(path / "t", late)
    save(path / "value", moved)
    log = read(segment)
    # The first gyro sample is before the first acceleration.
    assert codes(log)["W_DROPPED"] == 1
    expected = np.column_stack([np.interp(time[1:], late, column) for column in moved.T])
    np.testing.assert_allclose(log.accel, expected, atol=1e-12)  # rounding


def test_the_minutes_of_a_drive_are_read_in_a_row(tmp_path: Path) -> None:
    sample.write(tmp_path)
    for number, minute in (("10", 1), ("11", 2)):
        shutil.copytree(tmp_path / "7", tmp_path / number)
        for path in (tmp_path / number).rglob("t"):
            save(path, np.load(path) + 30.0 * minute)
    (tmp_path / "12").mkdir()
    log = read(tmp_path)
    assert log.time.size == 3 * sample_drive().time.size
    assert log.duration == pytest.approx(89.98, abs=1e-6)
    assert log.wheel_speed is not None
    assert np.isfinite(log.wheel_speed).sum() == 3 * 750


def test_records_without_a_fix_are_left_out_and_counted(segment: Path) -> None:
    path = signal(segment, "GNSS/live_gnss_ublox/value")
    fixes = np.load(path)
    fixes[:3, :2] = 0.0
    fixes[3, 2] = np.nan
    save(path, fixes)
    log = read(segment)
    assert log.gnss_time.size == len(fixes) - 4
    assert codes(log)["W_DROPPED"] == 4


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        (
            "IMU/accelerometer/value",
            np.zeros((3, 2)),
            "accelerometer/value: the array has 2 columns where 3 are",
        ),
        ("IMU/accelerometer/value", np.zeros((3, 2, 1)), "is float64 of shape (3, 2, 1), not numbers in one or two"),
        ("IMU/accelerometer/value", np.array([["a"]]), "is <U1 of shape (1, 1), not numbers in one or two dimensions"),
        ("IMU/gyro_uncalibrated/t", b"hello", "gyro_uncalibrated/t: the file is no NumPy array that can be read"),
    ],
)
def test_what_is_no_such_array_is_refused(segment: Path, name: str, content: FloatArray | bytes, sentence: str) -> None:
    path = signal(segment, name)
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        save(path, content)
    with pytest.raises(LogError, match=re.escape(sentence)):
        read(segment)


def test_pickles_and_huge_shapes_are_not_loaded(segment: Path) -> None:
    path = signal(segment, "IMU/gyro_uncalibrated/value")
    with path.open("wb") as file:
        np.save(file, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(LogError, match="the array is object"):
        read(segment)
    head = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000000, 3), }"
    path.write_bytes(b"\x93NUMPY\x01\x00" + len(head + b"\n").to_bytes(2, "little") + head + b"\n" + bytes(24 * 10))
    log = read(segment)
    # Ten rows are there, and no memory is taken for the others.
    assert log.time.size == 10
    assert log.meta["completeness"] == "truncated"


@pytest.mark.parametrize("name", ["IMU/gyro_uncalibrated/t", "IMU/accelerometer/value", "GNSS/live_gnss_ublox/value"])
def test_a_damaged_array_is_marked_or_refused(segment: Path, name: str) -> None:
    path = signal(segment, name)
    content = path.read_bytes()
    for cut in cases.beginnings(content):
        path.write_bytes(cut)
        assert outcome(segment) != "complete"
    for mutated in cases.mutations(content):
        path.write_bytes(mutated)
        outcome(segment)


def test_a_minute_of_highway_is_read_as_its_notes_say(data_folder: Path) -> None:
    log = read(data_folder / "formats" / "comma2k19")
    about = log.describe()
    assert about["imu_rate_hz"] == pytest.approx(104.4, abs=0.1)
    assert about["gnss_rate_hz"] == pytest.approx(10.0, rel=1e-4)
    assert about["completeness"] == "complete"
    assert (log.time.size, log.gnss_time.size) == (6256, 579)
    # Up is minus down: the phone stands upright behind the windscreen, some degrees tilted.
    np.testing.assert_allclose(log.accel.mean(axis=0), [0.0, 0.0, -9.8], atol=0.7)
    assert log.velocity_ned is not None
    assert log.wheel_speed is not None
    speed = np.hypot(*log.velocity_ned[:, :2].T)
    assert speed.min() > 7.0
    assert speed.max() < 30.0
    wheels = np.isfinite(log.wheel_speed)
    by_wheels = np.interp(log.gnss_time, log.time[wheels], log.wheel_speed[wheels])
    np.testing.assert_allclose(np.median(by_wheels / speed), 1.0, atol=0.02)  # tyres


def test_its_axes_are_forward_right_down_as_the_camera_saw_it(data_folder: Path) -> None:
    """The segment's camera poses (not read) turn about the same axes as the gyro says."""
    folder = data_folder / "formats" / "comma2k19"
    log = read(folder)
    epoch = log.meta["epoch"]
    assert isinstance(epoch, float)
    time = np.load(folder / "global_pose" / "frame_times") - epoch
    q = np.load(folder / "global_pose" / "frame_orientations")
    rates = turn_rates(q, time)
    window = np.ones(5) / 5.0
    middle = 0.5 * (time[1:] + time[:-1])
    # The camera's rates are differences over 50 ms, the gyro's averages over as much; yaw hardly changes on a motorway.
    for axis, least in ((0, 0.95), (1, 0.95), (2, 0.85)):
        gyro = np.interp(middle, log.time, np.convolve(log.gyro[:, axis], window, "same"))[20:-20]
        assert np.corrcoef(gyro, rates[20:-20, axis])[0, 1] > least


def turn_rates(q: FloatArray, time: FloatArray) -> FloatArray:
    """Return body rates (n - 1, 3), rad/s, from quaternions (n, 4) that grow by the body's turn on their right."""
    w, x, y, z = (q[:-1] * [1.0, -1.0, -1.0, -1.0]).T
    a, b, c, d = q[1:].T
    turn = np.column_stack(
        (
            w * a - x * b - y * c - z * d,
            w * b + x * a + y * d - z * c,
            w * c - x * d + y * a + z * b,
            w * d + x * c - y * b + z * a,
        )
    )
    rates: FloatArray = 2.0 * turn[:, 1:] * np.sign(turn[:, :1]) / np.diff(time)[:, np.newaxis]
    return rates


def save(path: Path, array: FloatArray) -> None:
    with path.open("wb") as file:
        np.save(file, array, allow_pickle=False)


def outcome(path: Path) -> str:
    """Return how complete a drive is read, or "refused"."""
    try:
        return str(read(path).meta["completeness"])
    except LevelheadError:
        return "refused"
