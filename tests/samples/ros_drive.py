"""Whether a log is the sample drive."""

from __future__ import annotations

import numpy as np

from levelhead.logs.log import Log
from samples.drive import sample_drive


def assert_is_the_drive(log: Log, *, samples: int | None = None) -> None:
    """Hold a log against the sample drive, or the first of its samples."""
    drive = sample_drive()
    n = drive.time.size if samples is None else samples
    m = int((drive.gnss_time <= drive.time[n - 1]).sum())
    assert log.time.size == n
    np.testing.assert_array_equal(log.gyro, drive.gyro[:n])
    np.testing.assert_array_equal(log.accel, drive.accel[:n])
    # Seconds since 1970 are float64 of 2^-22 s.
    np.testing.assert_allclose(log.time, drive.time[:n], rtol=0.0, atol=2**-22)
    np.testing.assert_allclose(log.gnss_time[: m - 1], drive.gnss_time[: m - 1], rtol=0.0, atol=2**-22)
    assert log.velocity_ned is not None
    assert drive.velocity_ned is not None
    np.testing.assert_array_equal(log.velocity_ned[: m - 1], drive.velocity_ned[: m - 1])
    assert log.position_llh is not None
    assert drive.position_llh is not None
    # Radians to degrees and back are two roundings.
    np.testing.assert_array_max_ulp(log.position_llh[: m - 1, :2], drive.position_llh[: m - 1, :2], maxulp=2)
    np.testing.assert_array_equal(log.position_llh[: m - 1, 2], drive.position_llh[: m - 1, 2])
    for std in (log.velocity_std, log.position_std):
        assert std is not None
        np.testing.assert_allclose(std[: m - 1], 0.05, rtol=1e-15)  # a square and its root
