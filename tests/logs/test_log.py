"""What a `Log` refuses, and what it can say and do about itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from levelhead.conventions import FloatArray
from levelhead.errors import LogError
from levelhead.estimators.base import Result
from levelhead.logs.log import Log


def result_for(time: FloatArray, gyro_bias: FloatArray, accel_bias: FloatArray) -> Result:
    zeros = np.zeros(time.size)
    return Result(
        time=time,
        gyro_bias=gyro_bias,
        accel_bias=accel_bias,
        gyro_bias_std=np.zeros_like(gyro_bias),
        accel_bias_std=np.zeros_like(gyro_bias),
        roll=zeros,
        pitch=zeros,
        heading=zeros,
        attitude_std=np.zeros_like(gyro_bias),
        velocity_ned=np.zeros_like(gyro_bias),
        velocity_std=np.zeros_like(gyro_bias),
        position_llh=None,
        position_std=None,
        status=np.zeros(time.size, dtype=np.uint32),
        method="observer",
        params={},
        known_gyro=(True, True, True),
        known_accel=(True, True, False),
        settled_at_s={},
    )


def test_wrong_arrays_are_refused_with_a_sentence(drive: Log) -> None:
    with pytest.raises(LogError, match=r"gyro has the shape \(200, 2\); pass an array of shape \(200, 3\)"):
        replace(drive, gyro=drive.gyro[:, :2])
    with pytest.raises(LogError, match=r"time does not advance at row 2: 0\.000000 s comes after"):
        replace(drive, time=np.concatenate(([0.0, 0.0], drive.time[2:])))
    accel = drive.accel.copy()
    accel[4, 1] = np.nan
    with pytest.raises(LogError, match=r"accel is not finite at row 5 \(1 such rows"):
        replace(drive, accel=accel)
    with pytest.raises(LogError, match="neither GNSS velocities nor positions"):
        replace(drive, velocity_ned=None, position_llh=None)


def test_a_slice_holds_the_start_and_not_the_stop(drive: Log) -> None:
    part = drive.slice(1.0, 2.0)
    assert part.time[0] == 1.0
    assert part.time[-1] < 2.0
    assert part.time.size == 20
    np.testing.assert_array_equal(part.gnss_time, [1.0, 1.51])
    np.testing.assert_array_equal(part.gyro, drive.gyro[20:40])
    assert part.velocity_ned is not None
    assert drive.velocity_ned is not None
    np.testing.assert_array_equal(part.velocity_ned, drive.velocity_ned[2:4])
    assert part.wheel_speed is not None
    assert drive.wheel_speed is not None
    np.testing.assert_array_equal(part.wheel_speed, drive.wheel_speed[20:40])
    with pytest.raises(LogError, match=r"Between 20 and 30 s the log has 0 IMU samples.*runs from 0 to 9\.95 s"):
        drive.slice(20.0, 30.0)


def test_corrected_readings_are_readings_less_biases_and_unknown_biases_count_as_zero(drive: Log) -> None:
    gyro_bias = np.tile([0.01, -0.02, 0.03], (200, 1))
    accel_bias = np.tile([0.1, 0.2, np.nan], (200, 1))
    corrected = drive.corrected(result_for(drive.time, gyro_bias, accel_bias))
    np.testing.assert_array_equal(corrected.gyro, drive.gyro - gyro_bias)
    np.testing.assert_array_equal(corrected.accel[:, :2], drive.accel[:, :2] - accel_bias[:, :2])
    np.testing.assert_array_equal(corrected.accel[:, 2], drive.accel[:, 2])
    np.testing.assert_array_equal(corrected.time, drive.time)
    assert corrected.meta["corrected_by"] == "observer"


def test_the_result_of_another_log_corrects_nothing(drive: Log) -> None:
    zeros = np.zeros((200, 3))
    with pytest.raises(LogError, match="correct the log that the result was estimated from"):
        drive.corrected(result_for(drive.time + 1.0, zeros, zeros))
    with pytest.raises(LogError, match="The result has 199 samples"):
        drive.corrected(result_for(drive.time[:-1], zeros[:-1], zeros[:-1]))


def test_description_counts_rates_and_distance_but_no_distance_over_gaps() -> None:
    gnss_time = np.array([0.0, 1.0, 2.0, 7.0, 8.0])
    velocity = np.tile([3.0, 4.0, 100.0], (5, 1))
    log = Log(
        time=np.linspace(0.0, 8.0, 801),
        gyro=np.zeros((801, 3)),
        accel=np.zeros((801, 3)),
        gnss_time=gnss_time,
        velocity_ned=velocity,
        meta={"source": "a.csv", "format": "csv"},
    )
    about = log.describe()
    assert about["source"] == "a.csv"
    assert about["format"] == "csv"
    assert about["completeness"] == "complete"
    assert about["duration_s"] == 8.0
    assert about["imu_rate_hz"] == pytest.approx(100.0, rel=1e-9)  # rounding of the stamps
    assert about["gnss_rate_hz"] == 1.0
    # 5 m/s for 2 s and for 1 s: the vertical speed and the gap of 5 s do not count. Rounding only.
    assert about["distance_m"] == pytest.approx(15.0, rel=1e-12)


def test_a_log_of_positions_has_a_distance_too() -> None:
    # One second of arc of latitude per second at the equator, M = 6335439.327 m by NIMA TR8350.2: 30.715 m each.
    latitude = np.radians(np.arange(4) / 3600.0)
    log = Log(
        time=np.arange(4.0),
        gyro=np.zeros((4, 3)),
        accel=np.zeros((4, 3)),
        gnss_time=np.arange(4.0),
        position_llh=np.column_stack((latitude, np.zeros(4), np.zeros(4))),
    )
    # The radius changes by 1e-9 over so short a way; the reference is given to 1e-10.
    assert log.describe()["distance_m"] == pytest.approx(3.0 * np.radians(1.0 / 3600.0) * 6335439.327, rel=1e-8)
