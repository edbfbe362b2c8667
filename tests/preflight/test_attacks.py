"""Drives made to mislead the preflight: it may not know, but it must not be certain and wrong.

Seeds are fixed. A value that is claimed must lie within four of the sigmas that are told with it, or within 10 ms.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import levelhead as lh
from levelhead.conventions import FloatArray
from levelhead.logs.pieces import FACTS
from levelhead.preflight import Finding, Preflight, Verdict, check
from levelhead.sim import SensorModel, Truth

LATENCY_S = 0.1
CERTAIN = (Verdict.FINE, Verdict.CORRECTED)
PINNED_S = 0.010
"""Half of the benchmark's own limit would do; no use is made of a clock that is known better, s."""


def drive(
    scenario: str = "field",
    *,
    seed: int = 0,
    speed: float = 6.0,
    rate: float = 5.0,
    duration: float = 600.0,
    **flaws: object,
) -> tuple[lh.Log, Truth]:
    """Return a drive whose GNSS is 0.1 s late and whose IMU is askew by 20 deg; nothing is declared."""
    usual: dict[str, object] = {
        "gnss_rate": rate,
        "gnss_latency": LATENCY_S,
        "mounting_yaw": math.radians(20.0),
        "mounting_roll": math.radians(3.0),
    }
    sensors = SensorModel(**{**usual, **flaws})  # type: ignore[arg-type]
    log, truth = lh.simulate(scenario, seed=seed, duration=duration, speed=speed, sensors=sensors)
    return replace(log, meta={**log.meta, "undeclared": FACTS}), truth


def finding(found: Preflight, name: str) -> Finding:
    """Return the finding of a name."""
    return next(f for f in found.findings if f.name == name)


def names(found: Preflight) -> set[str]:
    """Return what there are findings on."""
    return {f.name for f in found.findings}


def number(value: object) -> float:
    """Return a value of a finding as a number."""
    assert isinstance(value, float)
    return value


def clock_is_right(found: Preflight) -> bool:
    """Return whether the clock is certain and as simulated."""
    clock = finding(found, "clock")
    if clock.verdict not in CERTAIN:
        return False
    sigma = number(clock.values["latency_std_s"])
    return abs(found.corrections.latency_s - LATENCY_S) < max(PINNED_S, 4.0 * sigma)


def velocities(log: lh.Log, change: FloatArray | float) -> lh.Log:
    """Return the log with its velocities multiplied by a number or turned by a matrix."""
    assert log.velocity_ned is not None
    turn = change if isinstance(change, np.ndarray) else change * np.eye(3)
    return replace(log, velocity_ned=log.velocity_ned @ turn.T)


def without_positions(log: lh.Log) -> lh.Log:
    """Return the log with its velocities alone."""
    return replace(log, position_llh=None, position_std=None)


@pytest.mark.parametrize(
    ("scenario", "speed", "rate", "ahead"),
    [("field", 6.0, 1.0, 3.0), ("windrower", 2.0, 5.0, -3.0), ("hill", 6.0, 10.0, 3.0)],
)
def test_a_lever_arm_at_one_speed_is_no_offset_of_the_clocks(
    scenario: str, speed: float, rate: float, ahead: float
) -> None:
    # At one speed the antenna's path is the IMU's, earlier or later: only its larger speed in turns tells.
    log, _ = drive(scenario, seed=2, speed=speed, rate=rate, lever_arm=(ahead, 0.5, -2.0))
    found = check(log)
    assert clock_is_right(found), finding(found, "clock").text
    arm = finding(found, "lever arm")
    assert arm.code == "W_NO_LEVER"
    shown = arm.values["lever_arm"]
    assert isinstance(shown, list)
    # Four sigmas of the least certain of the three drives, the field's seven turns at 1 Hz: 0.1 m.
    np.testing.assert_allclose(shown[0], ahead, atol=0.4)


@pytest.mark.parametrize("vibration", [0.1, 0.3])
def test_vibration_feigns_no_lever_arm(vibration: float) -> None:
    log, _ = drive("windrower", seed=9, vibration=vibration, duration=900.0)
    found = check(log)
    assert clock_is_right(found), finding(found, "clock").text
    assert "lever arm" not in names(found)


def test_what_a_lever_arm_would_change_is_said() -> None:
    log, _ = drive("windrower")
    clock = finding(check(log), "clock")
    # One metre at 6 m/s.
    np.testing.assert_allclose(number(clock.values["latency_s_per_metre_ahead"]), -1.0 / 6.0, rtol=0.05)
    assert "a metre ahead" in clock.text


@pytest.mark.parametrize(
    ("unit", "factor", "positions"),
    [
        ("km/h", 3.6, True),
        ("km/h", 3.6, False),
        ("knots", 3600.0 / 1852.0, True),
        ("knots", 3600.0 / 1852.0, False),
        ("cm/s", 100.0, True),
    ],
)
def test_velocities_in_another_unit_are_refused(unit: str, factor: float, positions: bool) -> None:
    log, _ = drive("windrower")
    log = velocities(log, factor)
    found = check(log if positions else without_positions(log))
    speed = finding(found, "velocity unit")
    assert speed.verdict is Verdict.REFUSED
    assert speed.code == "E_UNIT_VEL"
    assert speed.text.startswith(unit)
    assert finding(found, "clock").verdict not in CERTAIN
    assert finding(found, "axes").verdict not in CERTAIN


def test_velocities_turned_against_the_positions_are_refused() -> None:
    c, s = math.cos(math.radians(40.0)), math.sin(math.radians(40.0))
    log, _ = drive("windrower")
    found = check(velocities(log, np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])))
    frame = finding(found, "velocity frame")
    assert frame.verdict is Verdict.REFUSED
    # Positions and velocities are of the same epochs; their noise turns nothing by a degree.
    np.testing.assert_allclose(number(frame.values["turned_deg"]), -40.0, atol=1.0)
    assert finding(found, "axes").verdict not in CERTAIN


def test_level_velocities_in_an_open_frame_may_be_east_and_north() -> None:
    log, _ = drive("windrower")
    flat = without_positions(velocities(log, np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])))
    found = check(flat)
    assert finding(found, "velocity frame").verdict not in CERTAIN
    assert finding(found, "axes").verdict not in CERTAIN


def test_speed_and_course_of_a_format_that_knows_its_frame_are_enough() -> None:
    log, _ = drive("windrower")
    log = without_positions(velocities(log, np.diag([1.0, 1.0, 0.0])))
    found = check(replace(log, meta={**log.meta, "undeclared": tuple(f for f in FACTS if f != "velocity_frame")}))
    assert finding(found, "axes").verdict is Verdict.FINE
    assert clock_is_right(found)


@pytest.mark.parametrize("scenario", ["field", "hill", "reverse"])
def test_earth_fixed_velocities_without_positions_have_no_frame_that_fits(scenario: str) -> None:
    log, _ = drive(scenario, seed=3)
    latitude, longitude = math.radians(45.7), math.radians(10.0)
    up = np.array(
        [math.cos(latitude) * math.cos(longitude), math.cos(latitude) * math.sin(longitude), math.sin(latitude)]
    )
    east = np.array([-math.sin(longitude), math.cos(longitude), 0.0])
    found = check(without_positions(velocities(log, np.column_stack((np.cross(up, east), east, -up)))))
    for name in ("velocity frame", "axes", "clock"):
        assert finding(found, name).verdict not in CERTAIN, finding(found, name).text


@pytest.mark.parametrize(
    "gyro_axes",
    [np.diag([-1.0, 1.0, 1.0]), np.diag([-1.0, -1.0, 1.0]), np.eye(3)[[1, 0, 2]]],
    ids=["flip", "turn", "swap"],
)
def test_gyros_in_other_axes_than_the_accelerometers_are_told(gyro_axes: FloatArray) -> None:
    # Turns are right all the same: the vertical axis is.
    log, _ = drive("field", seed=2)
    axes = finding(check(replace(log, gyro=log.gyro @ gyro_axes.T)), "axes")
    assert axes.verdict is Verdict.REFUSED
    # With both level gyros turned round the fit may fall apart before it is known why.
    assert "gyros" in axes.text or np.linalg.det(gyro_axes) > 0.0


def test_velocities_that_jump_now_and_then_are_left_out() -> None:
    log, _ = drive("windrower", speed=2.0)
    rng = np.random.default_rng(0)
    assert log.velocity_ned is not None
    off = np.where(rng.random((log.gnss_time.size, 1)) < 0.01, 5.0, 0.0) * rng.standard_normal((log.gnss_time.size, 3))
    found = check(replace(log, velocity_ned=log.velocity_ned + off))
    assert clock_is_right(found), finding(found, "clock").text
    assert finding(found, "axes").verdict in CERTAIN


@pytest.mark.parametrize("jump", [0.06, 0.2])
def test_clocks_that_jump_are_not_one_offset_nor_a_drift(jump: float) -> None:
    log, _ = drive("windrower")
    late = np.where(log.gnss_time > 300.0, jump, 0.0)
    clock = finding(check(replace(log, gnss_time=log.gnss_time + late)), "clock")
    assert clock.verdict not in CERTAIN, clock.text


def test_a_crystal_s_drift_is_still_found() -> None:
    log, _ = drive("windrower", duration=1800.0)
    drifting = replace(log, gnss_time=log.gnss_time + 1e-4 * (log.gnss_time - 900.0))
    found = check(drifting)
    assert clock_is_right(found), finding(found, "clock").text
    # Four sigmas: 2 ms of offset, times the square root of twelve, over 1800 s.
    np.testing.assert_allclose(found.corrections.clock_drift, 1e-4, atol=1.6e-5)


def test_a_vertical_velocity_from_a_barometer_does_not_draw_the_clock() -> None:
    log, _ = drive("windrower", speed=2.0)
    assert log.velocity_ned is not None
    slow = log.velocity_ned.copy()
    slow[:, 2] = np.convolve(slow[:, 2], np.full(10, 0.1))[: slow.shape[0]]  # the mean of the last two seconds
    assert clock_is_right(check(replace(log, velocity_ned=slow)))


def test_which_way_is_taken_as_forward_is_said() -> None:
    log, _ = drive("reverse")
    yaw = finding(check(log), "mounting yaw")
    # 20 s of 120 s at half the speed, less the ramps.
    np.testing.assert_allclose(number(yaw.values["one_way"]), 0.88, atol=0.06)
    assert "taken as forward" in yaw.text
