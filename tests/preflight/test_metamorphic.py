"""What must not matter to the preflight: where North is, when the log began, who checked it before."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import levelhead as lh
from levelhead.logs.mapping import rotation_321
from levelhead.preflight import Preflight, Verdict, check
from samples.strange_logs import (
    BACK_RIGHT_UP,
    finding,
    in_axes,
    in_degrees,
    in_frame,
    in_g,
    late,
    unsaid,
    without_positions,
)


def strange(log: lh.Log) -> lh.Log:
    """Return a log in which about everything is to be put right."""
    turn = rotation_321(roll=0.0, pitch=0.0, yaw=math.radians(4.0)).T
    return unsaid(late(in_g(in_degrees(in_axes(log, BACK_RIGHT_UP @ turn))), 0.2))


def assert_same_findings(a: Preflight, b: Preflight, *, tolerance: float) -> None:
    assert [(f.name, f.verdict, f.code) for f in a.findings] == [(f.name, f.verdict, f.code) for f in b.findings]
    np.testing.assert_allclose(a.corrections.accel_dcm, b.corrections.accel_dcm, atol=tolerance)
    assert a.corrections.latency_s == pytest.approx(b.corrections.latency_s, abs=tolerance)
    assert a.corrections.gyro_factor == b.corrections.gyro_factor


@pytest.mark.parametrize("angle_deg", [37.0, -120.0, 180.0])
def test_turning_the_world_changes_nothing(angle_deg: float, drive: lh.Log) -> None:
    log = strange(without_positions(drive))
    assert log.velocity_ned is not None
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    turned = replace(log, velocity_ned=log.velocity_ned @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))
    # What is not quite symmetric is the noise taken per axis: thousandths of a sigma.
    assert_same_findings(check(log), check(turned), tolerance=1e-4)


def test_the_zero_of_time_does_not_matter(drive: lh.Log) -> None:
    log = strange(drive)
    later = replace(log, time=log.time + 1024.0, gnss_time=log.gnss_time + 1024.0)
    # Stamps round at 1e-13 s, so that an epoch at the very edge of a window may fall out of it: a fifth of the
    # clock's sigma of 5 ms.
    assert_same_findings(check(log), check(later), tolerance=1e-3)


def test_the_order_of_faults_does_not_matter(drive: lh.Log) -> None:
    a = check(unsaid(in_frame(in_axes(in_degrees(drive), BACK_RIGHT_UP), "ENU")))
    b = check(unsaid(in_degrees(in_axes(in_frame(drive, "ENU"), BACK_RIGHT_UP))))
    assert_same_findings(a, b, tolerance=1e-9)


def test_what_was_put_right_needs_no_correction_again(drive: lh.Log) -> None:
    first = check(strange(drive))
    assert first.refused == ()
    again = check(first.trusted())
    assert again.refused == ()
    for name in ("gyro unit", "accelerometer unit", "velocity frame", "axes", "mounting yaw", "clock"):
        assert finding(again, name).verdict is Verdict.FINE, name
    for name in ("time", "gyro", "accel", "gnss_time", "velocity_ned"):
        np.testing.assert_array_equal(getattr(again.log, name), getattr(first.log, name))
    turned = np.array(again.log.meta["dcm_file_to_body"])
    np.testing.assert_allclose(turned, first.corrections.accel_dcm, atol=1e-15)  # it is still that of the file


def test_a_log_that_is_right_comes_back_to_the_bit(drive: lh.Log, perfect: lh.Log) -> None:
    for log in (drive, perfect, unsaid(drive)):
        found = check(log)
        assert found.refused == ()
        for name in (
            "time",
            "gyro",
            "accel",
            "gnss_time",
            "velocity_ned",
            "velocity_std",
            "position_llh",
            "position_std",
        ):
            before, after = getattr(log, name), getattr(found.log, name)
            assert (before is None) == (after is None)
            if before is not None:
                np.testing.assert_array_equal(before, after)
        assert {event.code for event in found.log.events} == {event.code for event in log.events}


def test_the_same_log_gives_the_same_answer(drive: lh.Log) -> None:
    assert check(strange(drive)).as_dict() == check(strange(drive)).as_dict()


def test_what_was_found_is_in_the_meta_as_plain_data(drive: lh.Log) -> None:
    import json

    found = check(strange(drive))
    about = found.log.describe()
    assert about["preflight"] == found.as_dict()
    back = json.loads(json.dumps(found.as_dict(), allow_nan=False))
    assert [f["name"] for f in back["findings"]] == [f.name for f in found.findings]
    assert back["findings"][0].keys() >= {"name", "verdict", "code", "text"}
    codes = {event.code for event in found.log.events}
    assert {"E_UNIT_GYRO", "E_UNIT_ACCEL", "E_AXES", "W_LATENCY", "W_MOUNT_YAW"} <= codes
    summary = lh.estimate(found.trusted()).summary()
    assert summary["latency_s"] == pytest.approx(0.2, abs=0.01)  # faults.md
    assert summary["mounting"]["yaw_deg"] == pytest.approx(4.0, abs=0.5)  # type: ignore[index]
    assert summary["preflight"] == found.as_dict()
