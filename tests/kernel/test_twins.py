"""Three implementations of one estimator: compiled double, compiled float, and NumPy written from the equations."""

from __future__ import annotations

import numpy as np
import pytest

from levelhead.estimators.streaming import std_rows
from levelhead.kernel.reference import ReferenceTrace, run_reference
from levelhead.logs.log import Log
from levelhead.sim import SensorModel, simulate

from .conftest import Kit, Params, irregular


@pytest.fixture(scope="module", params=["regular", "irregular", "from standstill", "slow GNSS", "reverse"])
def drive(request: pytest.FixtureRequest) -> Log:
    """Two minutes at 50 Hz and 5 Hz, as recorded by several kinds of hardware and drivers."""
    if request.param == "slow GNSS":  # 0.75 rad of turn in an interval: half trusted
        return simulate("windrower", seed=3, duration=120.0, sensors=SensorModel(imu_rate=50.0, gnss_rate=0.4))[0]
    if request.param == "reverse":
        slow = SensorModel(imu_rate=50.0, gnss_rate=5.0)
        return simulate("reverse", seed=3, duration=150.0, sensors=slow)[0]
    standstill = 20.0 if request.param == "from standstill" else 0.0
    log, _ = simulate(
        "windrower", seed=3, duration=120.0, standstill_s=standstill, sensors=SensorModel(imu_rate=50.0, gnss_rate=5.0)
    )
    return irregular(log, 5) if request.param == "irregular" else log


def run_numpy(kit: Kit, params: Params, log: Log) -> ReferenceTrace:
    """Run the NumPy twin."""
    assert log.velocity_ned is not None
    inside = (log.gnss_time >= log.time[0]) & (log.gnss_time <= log.time[-1])
    rows = std_rows(log.velocity_std, log.gnss_time.size)
    std = np.sqrt(0.5 * (rows[:, 0] ** 2 + rows[:, 1] ** 2))
    return run_reference(
        kit.reference(params),
        log.time,
        log.gyro,
        log.accel,
        log.gnss_time[inside],
        log.velocity_ned[inside],
        std[inside],
    )


def test_double_agrees_with_numpy(kit: Kit, params: Params, drive: Log) -> None:
    ours, theirs = kit.run(params, drive), run_numpy(kit, params, drive)
    # The twins share the equations, not the arithmetic: per step they differ by the third order of the angle turned in
    # it, (0.3 rad/s * 0.02 s)^3 = 2e-7, seen through loops that forget within tau. A hundredth of the accuracy demanded
    # of the estimators is ten times that.
    np.testing.assert_allclose(np.degrees(ours.gyro_bias), np.degrees(theirs.gyro_bias), atol=1e-5, rtol=0.0)
    np.testing.assert_allclose(ours.accel_bias, theirs.accel_bias, atol=3e-5, rtol=0.0)
    np.testing.assert_array_equal(np.isnan(ours.attitude), np.isnan(theirs.attitude))
    difference = np.degrees((ours.attitude - theirs.attitude + np.pi) % (2.0 * np.pi) - np.pi)
    assert np.nanmax(np.abs(difference)) < 2e-4


def test_float_agrees_with_double(kit: Kit, params: Params, drive: Log) -> None:
    single, double = kit.run(params, drive, single=True), kit.run(params, drive)
    # faults.md promises 1e-4 deg/s, 1e-4 m/s^2 and 0.005 deg over 24 h; two minutes must keep it too.
    assert np.degrees(np.abs(single.gyro_bias - double.gyro_bias)).max() < 1e-4
    assert np.abs(single.accel_bias - double.accel_bias)[:, :2].max() < 1e-4
    difference = np.degrees((single.attitude - double.attitude + np.pi) % (2.0 * np.pi) - np.pi)
    assert np.nanmax(np.abs(difference)) < 0.005


def test_the_drive_teaches_something(kit: Kit, params: Params, drive: Log) -> None:
    # Guards the tests above: twins that both stay at zero would agree as well.
    trace = kit.run(params, drive)
    assert np.degrees(np.abs(trace.gyro_bias[-1])).max() > 0.02
    assert np.abs(trace.accel_bias[-1, :2]).max() > 0.02
