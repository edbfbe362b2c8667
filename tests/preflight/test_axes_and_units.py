"""Logs in any axes, units and frames come back as they were, or are left undecided; never wrong and certain."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

import levelhead as lh
from levelhead.conventions import FloatArray
from levelhead.preflight import Preflight, Verdict, check
from samples.strange_logs import (
    SIGNED_AXES,
    finding,
    in_axes,
    in_degrees,
    in_frame,
    in_g,
    unsaid,
    velocities,
    without_positions,
)

SETTLED = (Verdict.FINE, Verdict.CORRECTED)
YAW_DEG = 0.5
"""A mounting yaw is found within this (faults.md)."""


def strange(log: lh.Log, number: int) -> lh.Log:
    """Return a log in the axes of a number, and in units that go with it, so that all pairs of them occur."""
    log = in_axes(log, SIGNED_AXES[number])
    if number % 2:
        log = in_degrees(log)
    return in_g(log) if number // 2 % 2 else log


def left_deg(dcm: FloatArray, axes: FloatArray) -> float:
    """Return how far file axes, turned by corrections, are from the body's, deg; 180 where they are mirrored."""
    turn = dcm @ axes
    if np.linalg.det(turn) < 0.0:
        return 180.0
    return math.degrees(math.acos(min(1.0, 0.5 * (float(np.trace(turn)) - 1.0))))


def assert_put_right(found: Preflight, drive: lh.Log, number: int) -> None:
    assert found.refused == (), number
    fix = found.corrections
    assert fix.gyro_factor == (math.pi / 180.0 if number % 2 else 1.0), number
    assert fix.accel_factor == (lh.conventions.GRAVITY if number // 2 % 2 else 1.0), number
    assert left_deg(fix.gyro_dcm, SIGNED_AXES[number]) < YAW_DEG, number
    np.testing.assert_array_equal(fix.accel_dcm, fix.gyro_dcm)
    np.testing.assert_allclose(velocities(found.log), velocities(drive), atol=1e-9)  # rounding by way of ECEF
    # So are the readings: half a degree of 11 m/s^2 and of 1 rad/s, which neither ever exceeds.
    np.testing.assert_allclose(found.log.gyro, drive.gyro, atol=math.radians(YAW_DEG))
    np.testing.assert_allclose(found.log.accel, drive.accel, atol=11.0 * math.radians(YAW_DEG))
    turned = np.array(found.log.meta["dcm_file_to_body"])
    np.testing.assert_array_equal(turned, fix.accel_dcm)


def test_all_48_axes_with_all_units_and_frames_come_back(drive: lh.Log) -> None:
    drive = drive.slice(0.0, 240.0)
    frames = itertools.cycle(("NED", "ENU", "NEU", "ECEF", "ENU"))  # five and 48 have no common factor
    for number, frame in zip(range(48), frames, strict=False):
        log = drive if frame == "NED" else in_frame(drive, frame)
        found = check(unsaid(strange(log, number)))
        assert found.corrections.velocity_frame == frame, number
        assert_put_right(found, drive, number)
        axes = finding(found, "axes")
        assert axes.verdict is (Verdict.FINE if number == 0 else Verdict.CORRECTED)
        if number:
            assert axes.code == "E_AXES"
            mirrored = np.linalg.det(SIGNED_AXES[number]) < 0.0
            assert ("mirror image" in axes.text) == mirrored, number


@pytest.mark.parametrize("frame", ["NED", "ENU"])
def test_axes_come_back_without_positions(frame: str, drive: lh.Log) -> None:
    log = without_positions(drive if frame == "NED" else in_frame(drive, frame))
    for number in range(0, 48, 9):
        found = check(unsaid(strange(log, number)))
        assert found.corrections.velocity_frame == frame
        assert_put_right(found, drive, number)


def test_the_name_of_the_axes_is_what_axes_takes(drive: lh.Log) -> None:
    for number in (3, 40):
        log = strange(drive, number)
        found = check(unsaid(log))
        name = str(finding(found, "axes").values["axes"])
        told = check(unsaid(log), told=lh.preflight.Told(axes=name))
        assert finding(told, "axes").verdict is Verdict.FINE
        np.testing.assert_allclose(told.log.gyro, found.log.gyro, atol=math.radians(YAW_DEG))


@pytest.mark.parametrize("number", [0, 17, 30])
def test_one_wrong_sign_is_named(number: int, drive: lh.Log) -> None:
    upright = in_axes(drive, SIGNED_AXES[number], force_sign=-1.0)
    found = check(unsaid(upright))
    axes = finding(found, "axes")
    # In mirrored axes a wrong sign of the one sensor is the wrong sign of the other in axes that are not mirrored.
    mirrored = np.linalg.det(SIGNED_AXES[number]) < 0.0
    assert axes.code == ("E_AXES" if mirrored else "E_FSIGN")
    assert ("gyros' sign" if mirrored else "accelerometers' sign") in axes.text
    assert axes.verdict is Verdict.CORRECTED
    np.testing.assert_allclose(found.log.accel, drive.accel, atol=11.0 * math.radians(YAW_DEG))
    np.testing.assert_allclose(found.log.gyro, drive.gyro, atol=math.radians(YAW_DEG))
    assert axes.code in {event.code for event in found.log.events}


def test_gyros_that_turn_the_wrong_way_are_named(drive: lh.Log) -> None:
    found = check(unsaid(in_axes(drive, np.eye(3), gyro_sign=-1.0)))
    axes = finding(found, "axes")
    assert (axes.code, axes.verdict) == ("E_AXES", Verdict.CORRECTED)
    assert "gyros' sign is wrong" in axes.text
    np.testing.assert_array_equal(found.log.gyro, drive.gyro)
    np.testing.assert_array_equal(found.log.accel, drive.accel)


def test_a_wrong_sign_that_is_declared_is_refused_and_not_to_be_told_away(drive: lh.Log) -> None:
    for log in (in_axes(drive, np.eye(3), gyro_sign=-1.0), in_axes(drive, np.eye(3), force_sign=-1.0)):
        (refused,) = check(log).refused
        assert refused.name == "axes"
        assert "Turn that sign round in the log." in refused.text
        assert "--axes" not in refused.text  # no axes put one sign right


def test_never_wrong_and_certain_without_positions(drive: lh.Log) -> None:
    """Frames with a wrong sign of the force: what is said with certainty is right, the rest is undecided."""
    drive = drive.slice(0.0, 240.0)
    log = without_positions(drive)
    outcomes = set()
    for number, frame, force in itertools.product((0, 9, 33), ("NED", "ENU", "NEU"), (1.0, -1.0)):
        if frame == "NEU" and force < 0.0:
            continue  # looks exactly like ENU with right signs, which is far plainer (see `Hypothesis.oddity`)
        told = in_axes(log if frame == "NED" else in_frame(log, frame), SIGNED_AXES[number], force_sign=force)
        found = check(unsaid(told))
        certain = finding(found, "axes").verdict in SETTLED
        assert certain == (finding(found, "velocity frame").verdict in SETTLED)
        outcomes.add((frame, certain))
        if not certain:
            assert {f.name for f in found.refused} >= {"axes", "velocity frame"}
            assert "--axes" in finding(found, "axes").text
            assert "--velocity-frame" in finding(found, "velocity frame").text
            continue
        assert found.corrections.velocity_frame == frame, (number, frame, force)
        np.testing.assert_allclose(found.log.accel, drive.accel, atol=11.0 * math.radians(YAW_DEG))
        np.testing.assert_allclose(found.log.gyro, drive.gyro, atol=math.radians(YAW_DEG))
    assert {("NED", True), ("ENU", False), ("NEU", False)} <= outcomes


def test_what_is_undecided_names_both_readings(drive: lh.Log) -> None:
    log = unsaid(in_axes(in_frame(without_positions(drive), "ENU"), np.eye(3), force_sign=-1.0))
    text = finding(check(log), "axes").text
    assert "the accelerometers' sign turned round with velocities in ENU" in text
    assert "right signs with velocities in NEU" in text
    # Told the frame, the sign is certain.
    told = check(log, told=lh.preflight.Told(velocity_frame="ENU"))
    assert finding(told, "axes").code == "E_FSIGN"
    np.testing.assert_array_equal(told.trusted().accel, drive.accel)


def test_fast_and_slow_units_are_all_found(drive: lh.Log) -> None:
    for gyro_unit, accel_unit in (("mrad/s", "mg"), ("deg/h", "g"), ("deg/s", "m/s^2")):
        gyro = drive.gyro / lh.conventions.UNIT_FACTORS["rad/s"][gyro_unit]
        accel = drive.accel / lh.conventions.UNIT_FACTORS["m/s^2"][accel_unit]
        found = check(unsaid(replace(drive, gyro=gyro, accel=accel)))
        assert finding(found, "gyro unit").values.get("unit") == gyro_unit
        assert finding(found, "accelerometer unit").values.get("unit", "m/s^2") == accel_unit
        np.testing.assert_allclose(found.log.gyro, drive.gyro, rtol=1e-12, atol=1e-15)  # rounding
        np.testing.assert_allclose(found.log.accel, drive.accel, rtol=1e-12)
        assert found.refused == ()
