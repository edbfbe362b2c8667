"""Joining IMU and GNSS data: one clock, one zero."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from levelhead.errors import LogError
from levelhead.logs.pieces import GnssData, ImuData, join


def imu_at(start: float) -> ImuData:
    return ImuData(time=start + np.linspace(0.0, 1.0, 5), gyro=np.zeros((5, 3)), accel=np.zeros((5, 3)))


def gnss_at(start: float) -> GnssData:
    return GnssData(time=start + np.arange(2.0), velocity_ned=np.zeros((2, 3)))


def test_small_stamps_stay_as_they_are() -> None:
    log = join(imu_at(12.5), gnss_at(12.75))
    assert log.time[0] == 12.5
    assert log.gnss_time[0] == 12.75
    assert "epoch" not in log.meta


@pytest.mark.parametrize(("start", "from_zero"), [(1.7e9, False), (12.5, True)])
def test_a_foreign_clock_is_counted_from_the_first_imu_sample(start: float, from_zero: bool) -> None:
    log = join(imu_at(start), gnss_at(start + 0.25), from_zero=from_zero)
    assert log.time[0] == 0.0
    assert log.gnss_time[0] == 0.25
    assert log.meta["epoch"] == start


def test_files_that_do_not_belong_together_are_refused() -> None:
    with pytest.raises(LogError, match=r"IMU's stamps run from 0\.000 to 1\.000 s, the GNSS stamps from 50\.000 to 51"):
        join(imu_at(0.0), gnss_at(50.0))


def test_stamps_in_two_time_scales_are_brought_together() -> None:
    start = 1751003261.0  # 2025: GPS time is 18 s ahead of UTC
    imu = replace(imu_at(start), time_scale="UTC")
    log = join(imu, replace(gnss_at(start + 18.25), time_scale="GPST"))
    assert log.gnss_time[0] == 0.25
    assert log.meta["gnss_time_scale"] == "UTC"
