"""What the log declares and what the user tells: taken where right, refused where the data says otherwise."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import levelhead as lh
from levelhead.errors import UsageError
from levelhead.logs.mapping import rotation_321
from levelhead.preflight import Told, Verdict, check
from samples.strange_logs import (
    BACK_RIGHT_UP,
    FLU,
    assumed,
    finding,
    in_axes,
    in_degrees,
    in_frame,
    in_g,
    late,
    unsaid,
    without_positions,
)

Fault = Callable[[lh.Log], lh.Log]
FAULTS: list[tuple[str, str, Fault, Told, str]] = [
    ("axes", "E_AXES", lambda log: in_axes(log, BACK_RIGHT_UP), Told(axes="-x,y,-z"), "--axes=-x,y,-z"),
    ("gyro unit", "E_UNIT_GYRO", in_degrees, Told(gyro_unit="deg/s"), "--gyro-unit deg/s"),
    ("accelerometer unit", "E_UNIT_ACCEL", in_g, Told(accel_unit="g"), "--accel-unit g"),
    (
        "velocity frame",
        "E_VEL_FRAME",
        lambda log: in_frame(log, "ENU"),
        Told(velocity_frame="ENU"),
        "--velocity-frame ENU",
    ),
    (
        "velocity frame",
        "E_VEL_FRAME",
        lambda log: in_frame(log, "ECEF"),
        Told(velocity_frame="ECEF"),
        "--velocity-frame ECEF",
    ),
]
NAMES = ["axes", "gyro", "accel", "ENU", "ECEF"]


def assert_same(log: lh.Log, other: lh.Log) -> None:
    for name in ("time", "gyro", "accel", "gnss_time", "velocity_ned"):
        # Rounding of units and of the way through ECEF.
        np.testing.assert_allclose(getattr(log, name), getattr(other, name), rtol=1e-12, atol=1e-12, err_msg=name)


@pytest.mark.parametrize(("name", "code", "fault", "told", "option"), FAULTS, ids=NAMES)
def test_one_fault_by_who_said_otherwise(
    name: str, code: str, fault: Fault, told: Told, option: str, drive: lh.Log
) -> None:
    log = fault(drive)
    # Nobody, or only our rules: put right.
    for claim in (unsaid, assumed):
        found = check(claim(log))
        assert finding(found, name).verdict is Verdict.CORRECTED
        assert finding(found, name).code == code
        assert "Pass" not in finding(found, name).text
        assert_same(found.trusted(), drive)
        (event,) = (event for event in found.log.events if event.code == code)
        assert event.text.endswith("Put right.")
    # The log itself: refused, and the sentence says what to pass...
    (refused,) = check(log).refused
    assert (refused.name, refused.code) == (name, code)
    assert refused.text.endswith(f"Pass {option}.")
    # ...which then is right.
    right = check(log, told=told)
    assert right.refused == ()
    assert_same(right.trusted(), drive)
    # Told where the log is right as it is: refused, and the sentence does not tell to pass it again.
    wrong = check(unsaid(drive), told=told)
    if told.velocity_frame != "ECEF":  # what follows is in no frame at all, and undecided
        assert name in {f.name for f in wrong.refused}
        assert "Pass" not in finding(wrong, name).text
        assert option.split()[0].split("=")[0] in finding(wrong, name).text


def test_told_what_the_log_says_anyhow_changes_nothing(drive: lh.Log) -> None:
    told = Told(axes="x,y,z", gyro_unit="rad/s", accel_unit="m/s^2", velocity_frame="NED", latency_s=0.0)
    found = check(drive, told=told)
    assert found.refused == ()
    for name in ("gyro", "accel", "velocity_ned", "gnss_time"):
        np.testing.assert_array_equal(getattr(found.log, name), getattr(drive, name))


def test_velocities_told_to_be_ecef_need_positions(drive: lh.Log) -> None:
    with pytest.raises(UsageError, match="need positions"):
        check(without_positions(drive), told=Told(velocity_frame="ECEF"))


def test_the_latency_that_is_told_beats_the_one_that_is_found(drive: lh.Log) -> None:
    log = late(drive, 0.2)
    found = check(log)
    assert finding(found, "clock").verdict is Verdict.CORRECTED
    assert finding(found, "clock").code == "W_LATENCY"
    assert found.corrections.latency_s == pytest.approx(0.2, abs=0.01)  # faults.md
    assert found.log.meta["latency_s"] == found.corrections.latency_s
    right = check(log, told=Told(latency_s=0.2))
    assert finding(right, "clock").verdict is Verdict.FINE
    np.testing.assert_allclose(right.log.gnss_time, drive.gnss_time, atol=1e-12)  # rounding
    assert right.log.meta["latency_s"] == 0.2
    wrong = check(log, told=Told(latency_s=-0.1))
    clock = finding(wrong, "clock")
    assert clock.verdict is Verdict.WARNING
    assert "0.30" in clock.text
    assert "besides what --latency says: left as told" in clock.text
    assert wrong.refused == ()
    np.testing.assert_allclose(wrong.trusted().gnss_time, log.gnss_time + 0.1, atol=1e-12)
    assert wrong.log.meta["latency_s"] == -0.1


def test_clocks_far_apart_are_refused_unless_the_format_leaves_them_open(drive: lh.Log) -> None:
    log = late(drive, 0.7)
    (refused,) = check(log).refused
    assert (refused.name, refused.code) == ("clock", "W_LATENCY")
    value = refused.text.rpartition("--latency ")[2].rstrip(".")
    assert float(value) == pytest.approx(0.7, abs=0.01)
    np.testing.assert_array_equal(check(log).log.gnss_time, log.gnss_time)
    found = check(log, told=Told(latency_s=float(value)))
    np.testing.assert_allclose(found.trusted().gnss_time, drive.gnss_time, atol=0.01)
    unknown = check(unsaid(log, "clock"))
    np.testing.assert_allclose(unknown.trusted().gnss_time, drive.gnss_time, atol=0.01)
    far = check(drive, told=Told(latency_s=0.7))
    assert [f.name for f in far.refused] == ["clock"]
    assert "--latency says: leave that out" in far.refused[0].text or "--latency is wrong" in far.refused[0].text


@pytest.mark.parametrize("yaw_deg", [-170.0, -95.0, -30.0, -3.0, 8.0, 60.0, 135.0, 180.0])
def test_any_mounting_yaw_is_found_within_half_a_degree(yaw_deg: float, drive: lh.Log) -> None:
    # The body seen from an IMU that is turned to the right.
    turn = rotation_321(roll=0.0, pitch=0.0, yaw=math.radians(yaw_deg)).T
    found = check(unsaid(in_axes(drive, turn)))
    left = found.corrections.accel_dcm @ turn
    assert math.degrees(abs(math.atan2(left[1, 0], left[0, 0]))) < 0.5  # faults.md
    np.testing.assert_allclose(found.corrections.gyro_dcm, found.corrections.accel_dcm)
    if abs(yaw_deg) < 45.0:
        mounting = finding(found, "mounting yaw")
        assert mounting.code == "W_MOUNT_YAW"
        assert mounting.values["yaw_deg"] == pytest.approx(yaw_deg, abs=0.5)
        assert found.log.meta["mounting_deg"]["yaw"] == mounting.values["yaw_deg"]  # type: ignore[index]


def test_the_tilt_of_the_mounting_stays_in_the_readings(drive: lh.Log) -> None:
    turn = rotation_321(roll=math.radians(6.0), pitch=math.radians(-4.0), yaw=math.radians(20.0)).T
    found = check(in_axes(drive, turn))
    tilt = finding(found, "mounting tilt")
    assert tilt.verdict is Verdict.NOTED
    # The road's own mean slope is in it: a few tenths of a degree.
    assert tilt.values["roll_deg"] == pytest.approx(6.0, abs=0.5)
    assert tilt.values["pitch_deg"] == pytest.approx(-4.0, abs=0.5)
    kept = rotation_321(roll=math.radians(6.0), pitch=math.radians(-4.0), yaw=0.0).T
    np.testing.assert_allclose(found.corrections.accel_dcm @ turn, kept, atol=math.radians(0.5))


def test_the_mounting_yaw_that_is_told_beats_the_one_that_is_found(drive: lh.Log) -> None:
    yaw = math.radians(6.0)
    log = in_axes(drive, rotation_321(roll=0.0, pitch=0.0, yaw=yaw).T)
    right = check(log, told=Told(mounting_yaw=yaw))
    assert finding(right, "mounting yaw").verdict is Verdict.FINE
    np.testing.assert_allclose(right.trusted().gyro, drive.gyro, atol=1e-15)  # rounding
    assert right.log.meta["mounting_deg"]["yaw"] == pytest.approx(6.0)  # type: ignore[index]
    wrong = check(log, told=Told(mounting_yaw=-yaw))
    mounting = finding(wrong, "mounting yaw")
    assert mounting.verdict is Verdict.WARNING
    assert "besides what --mounting-yaw says: left as told" in mounting.text
    assert mounting.values["yaw_deg"] == pytest.approx(12.0, abs=0.5)
    twice = in_axes(drive, rotation_321(roll=0.0, pitch=0.0, yaw=2.0 * yaw).T)
    np.testing.assert_allclose(wrong.trusted().gyro, twice.gyro, atol=1e-15)
    assert wrong.log.meta["mounting_deg"]["yaw"] == pytest.approx(-6.0)  # type: ignore[index]


def test_the_corrections_are_all_that_was_done(drive: lh.Log) -> None:
    """What was told and what was found, in one: applied to the log as read they give the log that is returned."""
    turn = rotation_321(roll=0.0, pitch=0.0, yaw=math.radians(5.0)).T
    log = unsaid(late(in_frame(in_g(in_degrees(in_axes(drive, FLU @ turn))), "ENU"), 0.2, drift=1e-4))
    tolds = (
        None,
        Told(axes="x,-y,-z", gyro_unit="deg/s", latency_s=0.1),
        Told(axes="y,x,-z", mounting_yaw=0.3, accel_unit="g"),
        Told(velocity_frame="ENU", axes="-x,y,-z", latency_s=0.2),
    )
    for told in tolds:
        found = check(log, told=told)
        again = found.corrections.apply(log)
        for name in ("gyro", "accel", "velocity_ned", "gnss_time"):
            np.testing.assert_allclose(getattr(again, name), getattr(found.log, name), atol=1e-12, err_msg=name)


def test_axes_of_a_reader_and_corrections_are_one_rotation(drive: lh.Log) -> None:
    log = replace(
        in_axes(drive, FLU), meta={"dcm_file_to_body": ((0, 1, 0), (1, 0, 0), (0, 0, -1)), "undeclared": ("axes",)}
    )
    found = check(log)
    expected = found.corrections.accel_dcm @ np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    np.testing.assert_array_equal(np.array(found.log.meta["dcm_file_to_body"]), expected)


def test_readings_without_gravity_are_refused_whoever_says_what(drive: lh.Log) -> None:
    linear = replace(drive, accel=drive.accel + np.array([0.0, 0.0, 9.80665]))
    for log, told in ((unsaid(linear), None), (assumed(linear), None), (linear, Told(accel_unit="m/s^2"))):
        refused = {f.name: f for f in check(log, told=told).refused}
        assert refused["accelerometer unit"].code == "E_NO_GRAVITY"
        assert "Record the specific force" in refused["accelerometer unit"].text
    nothing = replace(drive, accel=np.zeros_like(drive.accel))
    assert "E_NO_GRAVITY" in {f.code for f in check(nothing).refused}


@pytest.mark.parametrize("factor", [0.3, 0.5, 2.0, 3.28])
def test_accelerometers_in_a_unit_that_is_none_are_refused(factor: float, drive: lh.Log) -> None:
    found = check(unsaid(replace(drive, accel=drive.accel * factor)))
    unit = finding(found, "accelerometer unit")
    assert (unit.verdict, unit.code) == (Verdict.REFUSED, "E_UNIT_ACCEL")
    assert "in none of the units" in unit.text
    assert found.corrections.accel_factor == 1.0


@pytest.mark.parametrize("factor", [0.1, 0.5, 2.0, 30.0])
def test_gyros_in_a_unit_that_is_none_are_refused(factor: float, drive: lh.Log) -> None:
    found = check(unsaid(replace(drive, gyro=drive.gyro * factor)))
    unit = finding(found, "gyro unit")
    assert (unit.verdict, unit.code) == (Verdict.REFUSED, "E_UNIT_GYRO")
    assert "none of the units" in unit.text
    assert found.corrections.gyro_factor == 1.0


@pytest.mark.parametrize("factor", [0.97, 1.03])
def test_a_scale_error_is_no_unit(factor: float, drive: lh.Log) -> None:
    found = check(replace(drive, gyro=drive.gyro * factor, accel=drive.accel * factor))
    assert found.refused == ()
    np.testing.assert_array_equal(found.log.gyro, drive.gyro * factor)
