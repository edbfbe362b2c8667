"""Drives that cannot tell: no exception, no certain answer, and what is then done says what to pass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import levelhead as lh
from levelhead.errors import LogError
from levelhead.preflight import Told, Verdict, check
from samples.strange_logs import (
    FLU,
    assumed,
    finding,
    in_axes,
    in_degrees,
    in_frame,
    in_g,
    late,
    unsaid,
    velocities,
    without_positions,
    without_velocities,
)

OPTIONS = {
    "gyro unit": "--gyro-unit",
    "accelerometer unit": "--accel-unit",
    "velocity frame": "--velocity-frame",
    "axes": "--axes",
    "clock": "--latency",
}
SETTLED = (Verdict.FINE, Verdict.CORRECTED, Verdict.NOTED)
TOLD = Told(axes="x,y,z", gyro_unit="rad/s", velocity_frame="NED", latency_s=0.0)


def epochs(log: lh.Log, keep: NDArray[np.bool_]) -> lh.Log:
    """Return a log with some of its GNSS epochs."""
    fields = ("gnss_time", "velocity_ned", "velocity_std", "position_llh", "position_std")
    kept: dict[str, Any] = {n: None if getattr(log, n) is None else getattr(log, n)[keep] for n in fields}
    return replace(log, **kept)


def samples(log: lh.Log, keep: NDArray[np.bool_]) -> lh.Log:
    """Return a log with some of its IMU samples."""
    return replace(log, time=log.time[keep], gyro=log.gyro[keep], accel=log.accel[keep])


@pytest.fixture(params=["straight", "circle", "standing", "30 s", "3 s", "half a second", "2 epochs", "gaps"])
def mute(request: pytest.FixtureRequest, drive: lh.Log) -> lh.Log:
    """A log that does not tell its axes, nor its clocks."""
    name = str(request.param)
    if name in ("straight", "circle", "standing"):
        log: lh.Log = request.getfixturevalue(name)
        return without_positions(log)
    if name == "2 epochs":
        return epochs(drive, np.isin(np.arange(drive.gnss_time.size), [500, 501]))
    if name == "gaps":  # eight seconds of every fifteen are missing
        return samples(drive, drive.time % 15.0 > 8.0)
    return drive.slice(100.0, 100.0 + {"30 s": 30.0, "3 s": 3.0, "half a second": 0.5}[name])


def test_what_nobody_says_is_refused_with_the_option_to_pass(mute: lh.Log) -> None:
    found = check(unsaid(mute))
    assert {"axes", "clock"} <= {f.name for f in found.refused}
    for refused in found.refused:
        assert OPTIONS[refused.name] in refused.text, refused.text
    with pytest.raises(LogError) as caught:
        found.trusted()
    for refused in found.refused:
        assert OPTIONS[refused.name] in str(caught.value)
    np.testing.assert_array_equal(found.log.gyro, mute.gyro)  # nothing was turned by a guess
    np.testing.assert_array_equal(found.log.gnss_time, mute.gnss_time)


@pytest.mark.parametrize("claim", [assumed, lambda log: log], ids=["assumed", "declared"])
def test_what_the_rules_or_the_log_say_is_taken(claim: Callable[[lh.Log], lh.Log], mute: lh.Log) -> None:
    found = check(claim(mute))
    assert found.refused == ()
    assert finding(found, "axes").verdict is Verdict.UNDECIDED
    assert finding(found, "clock").verdict is Verdict.UNDECIDED
    assert "taken as the log says" in finding(found, "axes").text
    log = found.trusted()
    for name in ("time", "gyro", "accel", "gnss_time", "velocity_ned"):
        np.testing.assert_array_equal(getattr(log, name), getattr(mute, name))


def test_what_is_told_is_taken_too(mute: lh.Log) -> None:
    log = check(unsaid(mute), told=TOLD).trusted()
    np.testing.assert_array_equal(log.gyro, mute.gyro)


def test_a_straight_road_tells_nothing_wrong_in_any_axes(straight: lh.Log) -> None:
    log = without_positions(straight)
    for strange in (in_axes(log, FLU), in_degrees(log), in_frame(log, "ENU"), late(log, 0.3)):
        found = check(unsaid(strange))
        for name in ("gyro unit", "velocity frame", "axes", "clock"):
            assert finding(found, name).verdict not in SETTLED, name
    # Gravity does tell the accelerometers' unit.
    assert finding(check(unsaid(in_g(log))), "accelerometer unit").verdict is Verdict.CORRECTED


def test_gravity_beside_the_z_axis_is_refused_even_where_axes_are_declared(straight: lh.Log) -> None:
    on_its_side = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    for axes in (FLU, on_its_side):
        (refused,) = check(in_axes(straight, axes)).refused
        assert (refused.name, refused.code) == ("axes", "E_AXES")
        assert "Gravity does not lie along the z axis" in refused.text
        assert refused.text.endswith("Pass --axes.")


@pytest.mark.parametrize("claim", [unsaid, assumed])
def test_a_slow_imu_and_one_epoch_a_second_are_enough(claim: Callable[[lh.Log], lh.Log]) -> None:
    sensors = lh.sim.SensorModel(imu_rate=20.0, gnss_rate=1.0)
    log = lh.simulate("windrower", seed=1, duration=400.0, speed=7.0, sensors=sensors)[0]
    for sparse in (log, without_positions(log), without_velocities(log)):
        found = check(claim(in_axes(sparse, FLU)))
        assert finding(found, "axes").verdict is Verdict.CORRECTED
        np.testing.assert_allclose(found.trusted().gyro, log.gyro, atol=0.01)  # half a degree of 1 rad/s


def test_positions_alone_are_enough_where_they_are_good(drive: lh.Log) -> None:
    found = check(unsaid(late(in_axes(without_velocities(drive), FLU), 0.2)))
    assert finding(found, "velocity frame").verdict is Verdict.FINE
    assert finding(found, "axes").values["axes"] == "x,-y,-z"
    assert found.corrections.latency_s == pytest.approx(0.2, abs=0.03)
    assert found.trusted().velocity_ned is None  # the log keeps what it had


def test_poor_positions_leave_more_undecided_but_nothing_wrong() -> None:
    sensors = lh.sim.SensorModel(gnss_rate=1.0, position_noise=2.0)
    log = lh.simulate("windrower", seed=1, duration=400.0, speed=7.0, sensors=sensors)[0]
    found = check(unsaid(in_axes(without_velocities(log), FLU)))
    for name in ("gyro unit", "axes", "clock"):
        assert finding(found, name).verdict in (*SETTLED, Verdict.REFUSED)
    if finding(found, "axes").verdict is Verdict.CORRECTED:
        assert finding(found, "axes").values["axes"] == "x,-y,-z"


def test_gnss_that_comes_and_goes_is_used_where_it_is(drive: lh.Log) -> None:
    found = check(unsaid(in_axes(epochs(drive, drive.gnss_time % 60.0 < 40.0), FLU)))
    assert finding(found, "axes").values["axes"] == "x,-y,-z"
    assert found.refused == ()


def test_a_log_of_one_epoch_is_refused_in_a_sentence(drive: lh.Log) -> None:
    one = np.arange(drive.gnss_time.size) == 500
    two = np.isin(np.arange(drive.gnss_time.size), [500, 501])
    for log in (
        epochs(drive, one),
        epochs(without_positions(drive), one),
        epochs(without_velocities(drive), one),
        epochs(without_velocities(drive), two),  # one velocity can be derived from them
    ):
        with pytest.raises(LogError, match=r"velocit.*\."):
            check(log)


def test_velocities_that_are_partly_absent_are_left_out(drive: lh.Log) -> None:
    assert drive.velocity_ned is not None
    holes = drive.velocity_ned.copy()
    holes[::3] = np.nan
    found = check(unsaid(replace(in_axes(drive, FLU), velocity_ned=holes)))
    assert finding(found, "axes").values["axes"] == "x,-y,-z"
    np.testing.assert_array_equal(np.isnan(velocities(found.trusted())), np.isnan(holes))


def test_a_speed_and_course_without_vertical_velocity_has_no_frame_to_get_wrong(drive: lh.Log) -> None:
    assert drive.velocity_ned is not None
    flat = drive.velocity_ned.copy()
    flat[:, 2] = 0.0
    found = check(unsaid(in_axes(without_positions(replace(drive, velocity_ned=flat)), FLU)))
    assert found.corrections.velocity_frame == "NED"
    assert finding(found, "axes").values["axes"] == "x,-y,-z"
