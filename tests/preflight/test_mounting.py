"""Forward and down: direction of travel in the sensor's axes, driving backwards, the lead of the antenna."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import levelhead as lh
from levelhead.conventions import FloatArray
from levelhead.logs.mapping import rotation_321
from levelhead.preflight import Told, Verdict, check
from levelhead.preflight.look import look_at
from levelhead.preflight.mounting import ONE_WAY, Mounting
from levelhead.sim import SensorModel
from samples.strange_logs import finding, in_axes, unsaid


def mounted(log: lh.Log) -> Mounting:
    mounting = look_at(log).mounting
    assert mounting is not None
    return mounting


def backwards(log: lh.Log, start: float) -> lh.Log:
    """Return a log that pauses for 100 s at an instant, in which the vehicle turns round, to go on backwards.

    The log must be one without biases, which would be turned round too.
    """
    sign = np.where((log.time >= start)[:, None], [-1.0, -1.0, 1.0], 1.0)
    return replace(
        log,
        time=log.time + np.where(log.time >= start, 100.0, 0.0),
        gyro=log.gyro * sign,
        accel=log.accel * sign,
        gnss_time=log.gnss_time + np.where(log.gnss_time >= start, 100.0, 0.0),
    )


def yaw_of(dcm: FloatArray) -> float:
    return math.degrees(math.atan2(dcm[1, 0], dcm[0, 0]))


@pytest.mark.parametrize("yaw_deg", [0.0, 5.35, -90.0, 179.0])
@pytest.mark.parametrize("roll_deg", [0.0, 12.0, 180.0])
def test_any_mounting_is_the_rotation_that_it_is(yaw_deg: float, roll_deg: float, perfect: lh.Log) -> None:
    truth = rotation_321(roll=math.radians(roll_deg), pitch=math.radians(-7.0), yaw=math.radians(yaw_deg))
    level = mounted(perfect).dcm_sensor_to_vehicle
    mounting = mounted(in_axes(perfect, truth.T))
    assert mounting.decided
    assert mounting.one_way == 1.0
    # However it is mounted the same is left, the mean slope of the road: 1e-3 rad is 0.06 deg.
    np.testing.assert_allclose(mounting.dcm_sensor_to_vehicle @ truth.T, level, atol=1e-3)
    # Of that only the yaw is demanded: half a degree (faults.md).
    assert abs(yaw_of(level)) < 0.5


def test_the_sigma_of_the_yaw_holds() -> None:
    ratios = []
    for seed, yaw in enumerate((-0.2, 0.05, 0.3, 1.2)):
        sensors = SensorModel(imu_rate=50.0, gnss_rate=5.0, mounting_yaw=yaw)
        log = lh.simulate("windrower", seed=seed, duration=400.0, speed=7.0, sensors=sensors)[0]
        mounting = mounted(log)
        error = yaw_of(mounting.dcm_sensor_to_vehicle @ rotation_321(roll=0.0, pitch=0.0, yaw=yaw).T)
        assert abs(error) < 0.5  # faults.md
        ratios.append(error / math.degrees(mounting.yaw_std))
    assert np.abs(ratios).max() < 4.0


def test_driving_backwards_for_a_fifth_leaves_forward_where_it_is(perfect: lh.Log) -> None:
    mounting = mounted(backwards(perfect, 320.0))
    assert mounting.decided
    assert mounting.one_way == pytest.approx(0.8, abs=0.1)  # windows are weighed by what they know
    assert np.trace(mounting.dcm_sensor_to_vehicle) > 2.9
    assert finding(check(backwards(perfect, 320.0)), "axes").verdict is Verdict.FINE


def test_mostly_backwards_is_forwards_of_an_imu_that_faces_back(perfect: lh.Log) -> None:
    found = check(unsaid(backwards(perfect, 80.0)))
    assert finding(found, "axes").values["axes"] == "-x,-y,z"


def test_backwards_as_much_as_forwards_is_undecided(perfect: lh.Log) -> None:
    log = backwards(perfect, 200.0)
    mounting = mounted(log)
    assert 0.5 <= mounting.one_way < ONE_WAY
    assert not mounting.decided
    axes = finding(check(unsaid(log)), "axes")
    assert axes.verdict is Verdict.REFUSED
    assert "as much backwards as forwards" in axes.text
    assert finding(check(log), "axes").verdict is Verdict.UNDECIDED


def test_a_vehicle_that_reverses_at_times_is_mounted_as_it_is() -> None:
    log = lh.simulate("reverse", seed=3, duration=400.0, speed=6.0)[0]
    assert np.trace(check(log).corrections.accel_dcm) > 2.9


@pytest.mark.parametrize(("front", "arm"), [(1.5, 0.0), (-1.0, 1.0)])
def test_an_antenna_that_is_not_over_the_axle_leads_in_turns_and_is_no_yaw(front: float, arm: float) -> None:
    sensors = SensorModel(
        imu_rate=50.0, gnss_rate=5.0, imu_from_axle=(front, 0.0, -1.0), lever_arm=(arm, 0.0, -1.0), mounting_yaw=0.1
    )
    log = lh.simulate("windrower", seed=4, duration=400.0, speed=7.0, sensors=sensors)[0]
    found = check(log, told=Told(lever_arm=(arm, 0.0, -1.0)))
    values = finding(found, "mounting yaw").values
    assert values["yaw_deg"] == pytest.approx(math.degrees(0.1), abs=0.5)  # faults.md
    assert mounted(log).axle_m == pytest.approx(front + arm, abs=1.0)  # the turns of 400 s know it no better
