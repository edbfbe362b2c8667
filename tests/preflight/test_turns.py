"""Yaw rate against course on turns made by formula: unit, sign, bias and clocks."""

from __future__ import annotations

import math

import numpy as np
import pytest

from levelhead.conventions import FloatArray
from levelhead.preflight.turns import compare_turns
from levelhead.preflight.windows import Increments, Motion

UP = np.array([0.0, 0.0, -1.0])
IMU = np.arange(0.0, 300.0, 0.01)


def course(time: FloatArray) -> FloatArray:
    """Return a course that swings by 80 deg to both sides, slowly and faster, rad."""
    found: FloatArray = 1.0 * np.sin(0.1 * time) + 0.4 * np.sin(0.37 * time)
    return found


def rate(time: FloatArray) -> FloatArray:
    found: FloatArray = 0.1 * np.cos(0.1 * time) + 0.4 * 0.37 * np.cos(0.37 * time)
    return found


def motion(*, late: float = 0.0, noise: float = 0.0, speed: float = 8.0, step: float = 0.2) -> Motion:
    stamp = np.arange(-2.0, 302.0, step)
    angle = course(stamp - late)
    velocity = speed * np.column_stack((np.cos(angle), np.sin(angle), np.zeros_like(angle)))
    velocity[:, :2] += np.random.default_rng(0).normal(0.0, max(noise, 1e-9), (stamp.size, 2))
    return Motion(time=stamp, velocity=velocity, sigma=np.full((stamp.size, 3), max(noise, 0.03)))


def gyros(*, scale: float = 1.0, bias: float = 0.0) -> Increments:
    """Return a gyro whose z axis points down: what it reads is the rate over `scale`, and a bias."""
    reading = rate(IMU) / scale + bias
    return Increments.of(IMU, np.column_stack((np.zeros((IMU.size, 2)), reading)), np.zeros((IMU.size, 3)))


@pytest.mark.parametrize("scale", [1.0, -1.0, math.pi / 180.0, -math.pi / 180.0, 1e-3])
@pytest.mark.parametrize("late", [0.0, 0.43, -1.2])
def test_scale_bias_and_clocks_are_found(scale: float, late: float) -> None:
    bias = 0.005 / abs(scale)
    found = compare_turns(gyros(scale=scale, bias=bias), motion(late=late), UP)
    assert found is not None
    # The axis points up where the gyro's points down: scale and bias change their sign. The lags are tried in steps
    # of 0.02 s with a parabola between them.
    assert found.scale == pytest.approx(-scale, rel=1e-3)
    assert found.bias == pytest.approx(-bias, rel=0.02)
    assert found.offset_s == pytest.approx(late, abs=0.005)
    assert found.explained > 0.999


def test_the_sigma_is_that_of_many_drives() -> None:
    clean = gyros()
    found = []
    for seed in range(20):
        noisy = motion(noise=0.3)
        noise = np.random.default_rng(seed).normal(0.0, 0.3, noisy.velocity.shape)
        found.append(
            compare_turns(clean, Motion(time=noisy.time, velocity=motion().velocity + noise, sigma=noisy.sigma), UP)
        )
    scales = np.array([f.scale for f in found if f is not None])
    sigma = float(np.mean([f.scale_std for f in found if f is not None]))
    assert scales.size == 20
    # Of 20 drives the spread is known to a sixth; the sigma must not promise more than twice what holds.
    assert scales.std() < 2.0 * sigma
    assert abs(scales.mean() + 1.0) < 4.0 * sigma


def test_without_turns_nothing_is_found() -> None:
    time = np.arange(-2.0, 302.0, 0.2)
    velocity = np.column_stack((np.full_like(time, 8.0), np.zeros((time.size, 2))))
    velocity += np.random.default_rng(0).normal(0.0, 0.03, velocity.shape)
    straight = Motion(time=time, velocity=velocity, sigma=np.full((time.size, 3), 0.03))
    noise = np.random.default_rng(1).normal(0.0, 0.01, (IMU.size, 3))
    assert compare_turns(Increments.of(IMU, noise, noise), straight, UP) is None


def test_turns_that_the_gyros_do_not_share_are_not_believed() -> None:
    other = np.column_stack((np.zeros((IMU.size, 2)), np.cos(0.23 * IMU + 1.0)))
    assert compare_turns(Increments.of(IMU, other, other), motion(), UP) is None


@pytest.mark.parametrize("speed", [0.0, 0.3])
def test_a_crawling_vehicle_has_no_course(speed: float) -> None:
    assert compare_turns(gyros(), motion(speed=speed, noise=0.03), UP) is None


def test_few_epochs_are_no_drive() -> None:
    whole = motion()
    short = Motion(time=whole.time[:9], velocity=whole.velocity[:9], sigma=whole.sigma[:9])
    assert compare_turns(gyros(), short, UP) is None


def test_one_wild_epoch_in_fifty_does_not_matter() -> None:
    whole = motion(noise=0.03)
    rng = np.random.default_rng(5)
    velocity = whole.velocity.copy()
    wild = rng.random(whole.time.size) < 0.02
    velocity[wild, :2] = rng.normal(0.0, 10.0, (int(wild.sum()), 2))
    found = compare_turns(gyros(), Motion(time=whole.time, velocity=velocity, sigma=whole.sigma), UP)
    assert found is not None
    assert found.scale == pytest.approx(-1.0, abs=0.05)  # a unit is believed within 20 %
