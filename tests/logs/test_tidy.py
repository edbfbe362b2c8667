"""What is out of order is sorted, what repeats or is no number is dropped, and every one of them is counted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from levelhead.conventions import FloatArray
from levelhead.errors import LogError
from levelhead.logs.pieces import GnssData, ImuData
from levelhead.logs.tidy import tidy


def imu(stamps: Sequence[float] | FloatArray) -> ImuData:
    time = np.asarray(stamps, dtype=np.float64)
    rows = np.arange(3.0 * time.size).reshape(-1, 3)
    return ImuData(time=time, gyro=rows, accel=-rows, wheel_speed=rows[:, 0])


def test_data_in_order_is_the_same_object() -> None:
    data = imu([0.0, 1.0, 2.0])
    assert tidy(data, "IMU", ("gyro", "accel")) == (data, ())


def test_a_shuffled_log_is_the_sorted_log_to_the_bit() -> None:
    stamps = np.arange(200.0) / 100.0
    order = np.argsort(stamps + np.random.default_rng(1).uniform(0.0, 0.9, stamps.size))  # late by less than 1 s
    data = imu(stamps)
    shuffled = ImuData(time=stamps[order], gyro=data.gyro[order], accel=data.accel[order])
    tidied, events = tidy(shuffled, "IMU", ("gyro", "accel"))
    np.testing.assert_array_equal(tidied.time, data.time)
    np.testing.assert_array_equal(tidied.gyro, data.gyro)
    np.testing.assert_array_equal(tidied.accel, data.accel)
    assert [e.code for e in events] == ["I_REORDERED"]


def test_of_equal_stamps_the_first_wins() -> None:
    tidied, (event,) = tidy(imu([0.0, 1.0, 1.0, 2.0]), "IMU", ())
    np.testing.assert_array_equal(tidied.gyro[:, 0], [0.0, 3.0, 9.0])
    assert tidied.wheel_speed is not None
    assert tidied.wheel_speed.size == 3
    assert (event.code, event.count, event.first_s) == ("W_DUP_TIME", 1, 1.0)


def test_rows_that_are_no_numbers_are_dropped_and_counted() -> None:
    data = imu([0.0, 1.0, np.nan, 3.0])
    data.gyro[1, 2] = np.inf
    tidied, (event,) = tidy(data, "IMU", ("gyro", "accel"))
    np.testing.assert_array_equal(tidied.time, [0.0, 3.0])
    assert (event.code, event.count, event.first_s, event.last_s) == ("E_NONFINITE", 2, 1.0, 1.0)


def test_absent_readings_of_an_epoch_are_no_fault() -> None:
    epochs = GnssData(time=np.array([0.0, 1.0]), velocity_ned=np.full((2, 3), np.nan))
    assert tidy(epochs, "GNSS", ())[1] == ()


def test_a_few_samples_far_behind_are_dropped_a_clock_that_jumps_is_refused() -> None:
    stamps = np.arange(100.0)
    stamps[50] = 10.5
    tidied, (event,) = tidy(imu(stamps), "IMU", ())
    assert tidied.time.size == 99
    assert (event.code, event.count) == ("W_TIME_BACK", 1)
    jump = np.concatenate((np.arange(50.0), np.arange(50.0)))
    with pytest.raises(LogError, match=r"The IMU clock jumps back from 49\.000 to 0\.000 s at sample 51; 48 of 100"):
        tidy(imu(jump), "IMU", ())
