"""Velocities from positions: against motions whose velocity is known in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from levelhead.conventions import FloatArray
from levelhead.errors import LogError
from levelhead.logs.derive import velocity_from_position
from levelhead.logs.log import Log


def log_of(time: FloatArray, llh: FloatArray, std: FloatArray | None = None) -> Log:
    return Log(
        time=np.array([0.0, 100.0]),
        gyro=np.zeros((2, 3)),
        accel=np.zeros((2, 3)),
        gnss_time=time,
        position_llh=llh,
        position_std=std,
    )


def velocity_of(log: Log) -> FloatArray:
    assert log.velocity_ned is not None
    return log.velocity_ned


def test_east_on_the_equator_is_the_equatorial_radius_times_the_rate_of_longitude() -> None:
    time = np.arange(5.0)
    rate = 2e-6
    derived = velocity_from_position(log_of(time, np.column_stack((0 * time, rate * time, 50.0 + 0.5 * time))))
    np.testing.assert_array_equal(derived.gnss_time, [0.5, 1.5, 2.5, 3.5])
    height = 50.0 + 0.5 * derived.gnss_time
    # WGS-84's defining radius; the tolerance is the rounding of positions near 1e-5 rad.
    np.testing.assert_allclose(velocity_of(derived)[:, 1], rate * (6378137.0 + height), rtol=1e-9)
    np.testing.assert_allclose(velocity_of(derived)[:, 2], -0.5, rtol=1e-12)
    np.testing.assert_array_equal(velocity_of(derived)[:, 0], 0.0)
    assert derived.position_llh is not None
    # Averages of neighbours: rounding only.
    np.testing.assert_allclose(derived.position_llh[:, 1], rate * derived.gnss_time, rtol=1e-12)


def test_the_radii_are_those_of_the_latitude_and_the_height() -> None:
    # Radii at 45 degrees, from a = 6378137 m and 1/f = 298.257223563: M = 6367381.8156 m, N = 6388838.2901 m.
    step = 1e-6
    middle = np.pi / 4.0
    llh = np.array([[middle - step / 2, 0.0, 1000.0], [middle + step / 2, step, 1000.0]])
    velocity = velocity_of(velocity_from_position(log_of(np.array([0.0, 1.0]), llh)))[0]
    # 1e-9: rounding of a latitude near 1 rad (1e-16) against the step of 1e-6.
    assert velocity[0] == pytest.approx(step * (6367381.8156 + 1000.0), rel=1e-9)
    assert velocity[1] == pytest.approx(step * (6388838.2901 + 1000.0) * np.sqrt(0.5), rel=1e-9)


def test_a_steady_acceleration_gives_the_velocity_at_the_midpoint_without_delay() -> None:
    time = np.arange(0.0, 10.0)
    meridian = 6335439.327  # m, on the equator (NIMA TR8350.2)
    north = 0.5 * 1.5 * time**2
    derived = velocity_from_position(log_of(time, np.column_stack((north / meridian, 0 * time, 0 * time))))
    # A velocity at either end of the step would be off by 0.75 m/s; 1e-5: change of the radius within 70 m.
    np.testing.assert_allclose(velocity_of(derived)[:, 0], 1.5 * derived.gnss_time, rtol=1e-5)


def test_a_step_over_the_date_line_is_a_short_one() -> None:
    llh = np.array([[0.0, np.pi - 1e-6, 0.0], [0.0, -np.pi + 1e-6, 0.0]])
    derived = velocity_from_position(log_of(np.array([0.0, 1.0]), llh))
    assert velocity_of(derived)[0, 1] == pytest.approx(2e-6 * 6378137.0, rel=1e-8)  # rounding of pi - 1e-6
    assert derived.position_llh is not None
    assert abs(derived.position_llh[0, 1]) == pytest.approx(np.pi, abs=1e-12)


def test_gaps_and_absent_positions_give_no_epoch_and_the_event_says_how_many_there_are() -> None:
    time = np.array([0.0, 1.0, 2.0, 8.0, 9.0])
    llh = np.column_stack((1e-7 * time, 0 * time, 0 * time))
    llh[1] = np.nan
    derived = velocity_from_position(log_of(time, llh))
    np.testing.assert_array_equal(derived.gnss_time, [1.0, 8.5])
    (event,) = derived.events
    assert (event.code, event.count, event.first_s, event.last_s) == ("I_VELOCITY_DERIVED", 2, 1.0, 8.5)
    assert event.text.endswith("2 velocities from 4 positions.")


def test_the_deviation_of_a_difference_is_that_of_two_positions_over_the_step() -> None:
    time = np.array([0.0, 2.0])
    llh = np.zeros((2, 3))
    scalar = velocity_from_position(log_of(time, llh, np.array([3.0, 3.0])))
    assert scalar.velocity_std is not None
    np.testing.assert_allclose(scalar.velocity_std, [np.sqrt(2.0) * 3.0 / 2.0], rtol=1e-15)  # one rounding
    vector = velocity_from_position(log_of(time, llh, np.tile([1.0, 2.0, 4.0], (2, 1))))
    assert vector.velocity_std is not None
    np.testing.assert_allclose(vector.velocity_std, np.sqrt(2.0) * np.array([[1.0, 2.0, 4.0]]) / 2.0, rtol=1e-15)


def test_no_positions_or_no_neighbours_is_a_sentence(drive: Log) -> None:
    with pytest.raises(LogError, match="no GNSS positions to derive velocities from"):
        velocity_from_position(replace(drive, position_llh=None, position_std=None))
    with pytest.raises(LogError, match="2 GNSS positions, no two of them within 5 s"):
        velocity_from_position(log_of(np.array([0.0, 6.0]), np.zeros((2, 3))))
