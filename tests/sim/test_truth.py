"""The truth at other points of the body: a rigid body, on a round Earth."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from levelhead.conventions import FloatArray
from levelhead.earth import EARTH_RATE, radii
from levelhead.errors import UsageError
from levelhead.report.files import read_truth, write_truth
from levelhead.sim import SensorModel, Truth, simulate

HITCH = (-3.0, 0.2, 0.8)
PERFECT = SensorModel.perfect()


def drive(sensors: SensorModel = PERFECT, *, earth_rotation: bool = False) -> Truth:
    """Return the truth of two minutes on a field, a turn in it."""
    return simulate("field", seed=4, duration=120.0, sensors=sensors, earth_rotation=earth_rotation)[1]


def metres(llh: FloatArray, other: FloatArray) -> FloatArray:
    """Return how far the first places are from the others, m: north, east, down."""
    meridian, normal = radii(other[:, 0])
    east = (normal + other[:, 2]) * np.cos(other[:, 0])
    return (llh - other) * np.stack((meridian + other[:, 2], east, -np.ones_like(east)), axis=1)


def test_no_arm_is_the_imu_itself() -> None:
    truth = drive()
    here = truth.at((0.0, 0.0, 0.0))
    np.testing.assert_array_equal(here.position_llh, truth.position_llh)
    np.testing.assert_array_equal(here.velocity_ned, truth.velocity_ned)


@pytest.mark.parametrize("earth_rotation", [False, True])
def test_a_point_of_the_body_moves_as_an_imu_there_would(earth_rotation: bool) -> None:
    truth = drive(earth_rotation=earth_rotation)
    there = drive(replace(PERFECT, imu_from_axle=HITCH), earth_rotation=earth_rotation)
    hitch = truth.at(HITCH)
    np.testing.assert_allclose(hitch.velocity_ned, there.velocity_ned, atol=1e-13)  # rounding
    np.testing.assert_allclose(metres(hitch.position_llh, there.position_llh), 0.0, atol=1e-8)  # rounding of 1 rad


def test_the_body_is_rigid_and_its_points_move_as_their_velocities_say() -> None:
    truth = drive(earth_rotation=True)
    hitch, h = truth.at(HITCH), 0.01
    away = np.linalg.norm(metres(hitch.position_llh, truth.position_llh), axis=1)
    # Angles of 1 rad are rounded to 1e-16, 1e-9 m.
    np.testing.assert_allclose(away, math.hypot(*HITCH), atol=1e-8)
    moved = metres(hitch.position_llh[2:], hitch.position_llh[:-2]) / (2.0 * h)
    # Central differences are off by h^2 / 6 of the velocity's second derivative, 3 m times a few rad/s^3 over rough
    # ground: 2e-4 m/s.
    np.testing.assert_allclose(moved, hitch.velocity_ned[1:-1], atol=3e-4)
    # In the mean over two minutes that vanishes; what is left is speed times arm over the Earth's radius, 1.4e-6 m/s,
    # and what the quadrature is off at the ends, 1e-4 m in 120 s. The Earth's rate, 2e-4 m/s, would show.
    np.testing.assert_allclose(np.mean(moved - hitch.velocity_ned[1:-1], axis=0), 0.0, atol=3e-6)


def test_the_earth_s_rotation_is_no_motion_of_the_body() -> None:
    standing, turning = (
        simulate("circle", duration=5.0, standstill_s=10.0, sensors=PERFECT, earth_rotation=e)[1] for e in (False, True)
    )
    assert np.linalg.norm(turning.angular_rate[0]) == pytest.approx(EARTH_RATE)
    assert standing.relative_rate is None
    assert turning.relative_rate is not None
    for truth in (standing, turning):
        np.testing.assert_array_equal(truth.at(HITCH).velocity_ned, 0.0)


@pytest.mark.parametrize("earth_rotation", [False, True])
def test_the_point_is_along_the_imu_s_axes(earth_rotation: bool) -> None:
    turned_right = replace(PERFECT, mounting_yaw=math.pi / 2)
    plain = drive(earth_rotation=earth_rotation).at(HITCH)
    # What is 3 m behind the vehicle is 3 m to the right of such an IMU, and what is to the right is ahead of it.
    turned = drive(turned_right, earth_rotation=earth_rotation).at((0.2, 3.0, 0.8))
    np.testing.assert_allclose(turned.velocity_ned, plain.velocity_ned, atol=1e-13)  # rounding
    np.testing.assert_allclose(metres(turned.position_llh, plain.position_llh), 0.0, atol=1e-8)  # rounding of 1 rad


@pytest.mark.parametrize("earth_rotation", [False, True])
def test_a_written_truth_tells_the_same(earth_rotation: bool, tmp_path: Path) -> None:
    truth = drive(earth_rotation=earth_rotation)
    write_truth(truth, tmp_path / "truth.parquet")
    again = read_truth(tmp_path / "truth.parquet")
    np.testing.assert_array_equal(again.at(HITCH).velocity_ned, truth.at(HITCH).velocity_ned)
    assert (again.relative_rate is None) is not earth_rotation


@pytest.mark.parametrize("point", [(1.0, 2.0), (1.0, math.nan, 0.0)])
def test_a_point_that_is_none_is_refused(point: Any) -> None:
    truth = drive()
    with pytest.raises(UsageError, match="three finite numbers in m"):
        truth.at(point)
