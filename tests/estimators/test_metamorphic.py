"""Metamorphic rules (faults.md, kernel promises): what must not change when the world is described differently."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import levelhead as lh

METHODS = ("observer", "two-stage")


@pytest.fixture(scope="module")
def log() -> lh.Log:
    """Ten minutes of curves."""
    made, _ = lh.simulate("windrower", seed=4, duration=900.0)
    return replace(made, position_llh=None, position_std=None)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("angle_deg", [37.0, 180.0, -120.0])
def test_turning_the_world_turns_the_heading_alone(method: str, angle_deg: float, log: lh.Log) -> None:
    assert log.velocity_ned is not None
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    turned = replace(log, velocity_ned=log.velocity_ned @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))
    a, b = lh.estimate(log, method), lh.estimate(turned, method)
    # Rounding only, 1e-16 amplified by nothing.
    np.testing.assert_allclose(a.gyro_bias, b.gyro_bias, atol=1e-10, rtol=0.0)
    np.testing.assert_allclose(a.accel_bias, b.accel_bias, atol=1e-9, rtol=0.0)
    np.testing.assert_allclose(a.roll, b.roll, atol=1e-10, rtol=0.0)
    difference = (b.heading - a.heading - math.radians(angle_deg) + math.pi) % (2.0 * math.pi) - math.pi
    assert np.nanmax(np.abs(difference)) < 1e-9


@pytest.mark.parametrize("method", METHODS)
def test_shifting_time_by_a_power_of_two_gives_the_same_bits(method: str, log: lh.Log) -> None:
    # On a grid of 1/128 s a shift by 1024 s is exact in float64, so dt is too.
    n, m = log.time.size, log.gnss_time.size
    assert log.velocity_ned is not None
    grid = replace(log, time=np.arange(float(n)) / 128.0, gnss_time=np.arange(0.0, 10.0 * m, 10.0) / 128.0)
    shifted = replace(grid, time=grid.time + 1024.0, gnss_time=grid.gnss_time + 1024.0)
    a, b = lh.estimate(grid, method), lh.estimate(shifted, method)
    np.testing.assert_array_equal(a.gyro_bias, b.gyro_bias)
    np.testing.assert_array_equal(a.heading, b.heading)


@pytest.mark.parametrize("method", METHODS)
def test_mirroring_left_and_right_mirrors_the_biases(method: str, log: lh.Log) -> None:
    assert log.velocity_ned is not None
    mirror_rate, mirror = np.array([-1.0, 1.0, -1.0]), np.array([1.0, -1.0, 1.0])
    other = replace(log, gyro=log.gyro * mirror_rate, accel=log.accel * mirror, velocity_ned=log.velocity_ned * mirror)
    a, b = lh.estimate(log, method), lh.estimate(other, method)
    np.testing.assert_allclose(b.gyro_bias, a.gyro_bias * mirror_rate, atol=1e-12, rtol=0.0)
    np.testing.assert_allclose(b.accel_bias, a.accel_bias * mirror, atol=1e-11, rtol=0.0)


def test_a_known_bias_moves_the_observer_by_itself(log: lh.Log) -> None:
    gyro, accel = np.radians([0.2, -0.1, 0.1]), np.array([0.3, -0.2, 0.0])
    a = lh.estimate(log)
    b = lh.estimate(replace(log, gyro=log.gyro + gyro, accel=log.accel + accel))
    # faults.md: within 0.001 deg/s and 0.002 m/s^2 once settled.
    np.testing.assert_allclose(np.degrees(b.gyro_bias[-1] - a.gyro_bias[-1]), np.degrees(gyro), atol=0.001, rtol=0.0)
    np.testing.assert_allclose((b.accel_bias - a.accel_bias)[-1, :2], accel[:2], atol=0.002, rtol=0.0)


def test_a_start_from_the_answer_stays_there(log: lh.Log) -> None:
    result = lh.estimate(log)
    end = result.gyro_bias[-1], np.nan_to_num(result.accel_bias[-1])
    initial = lh.Initial(gyro_bias=tuple(end[0].tolist()), accel_bias=tuple(end[1].tolist()))
    again = lh.estimate(log, initial=initial)
    # Within the bands that count as settled: five sigma of the observer's noise (0.002 deg/s, 0.004 m/s^2) and the walk
    # of the true bias over 900 s (0.0034 deg/s, 0.006 m/s^2). From zero it would start 0.13 deg/s and 0.2 m/s^2 away.
    late = log.time > 10.0
    assert np.degrees(np.abs(again.gyro_bias[late] - end[0]))[:, :2].max() < 0.02
    assert np.abs(again.accel_bias[late, :2] - end[1][:2]).max() < 0.04
