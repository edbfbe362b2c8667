"""Windows in closed form: rotations, running products, integrals, the grid, and which stretches are taken."""

from __future__ import annotations

import math

import numpy as np
import pytest

from levelhead.conventions import FloatArray
from levelhead.preflight.windows import (
    LENGTH_S,
    MAX_WINDOWS,
    Increments,
    Motion,
    Windows,
    choose_windows,
    cumulative,
    epoch_times,
    on_grid,
    rotations,
    running_product,
    skew,
    turned,
)


def motion_at(time: FloatArray, *, swing: float = 1.0) -> Motion:
    """Return velocities that swing to and fro."""
    velocity = np.column_stack((swing * np.sin(time), np.zeros((time.size, 2))))
    return Motion(time=time, velocity=velocity, sigma=np.full((time.size, 3), 0.03))


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, 0.5 * math.pi, math.pi, -2.0])
def test_a_rotation_about_an_axis_is_the_textbook_matrix(axis: int, angle: float) -> None:
    vector = np.zeros(3)
    vector[axis] = angle
    c, s = math.cos(angle), math.sin(angle)
    expected = np.eye(3)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    expected[j, j] = expected[k, k] = c
    expected[k, j], expected[j, k] = s, -s
    np.testing.assert_allclose(rotations(vector), expected, atol=1e-15)  # rounding


def test_rotations_are_the_exponential_series() -> None:
    vectors = np.random.default_rng(0).normal(0.0, 1.0, (5, 4, 3))
    series = np.broadcast_to(np.eye(3), (5, 4, 3, 3)).copy()
    term = series.copy()
    for k in range(1, 40):  # |v| < 4: 4^40 / 40! is below 1e-23
        term = term @ skew(vectors) / k
        series += term
    np.testing.assert_allclose(rotations(vectors), series, atol=1e-13)  # rounding of terms up to 4^4 / 4!


def test_skew_is_the_cross_product() -> None:
    a, b = np.random.default_rng(1).normal(0.0, 1.0, (2, 6, 3))
    np.testing.assert_allclose((skew(a) @ b[..., None])[..., 0], np.cross(a, b), atol=1e-14)  # rounding


@pytest.mark.parametrize("count", [1, 2, 3, 7, 8, 29])
def test_a_running_product_is_that_of_a_plain_loop(count: int) -> None:
    matrices = rotations(np.random.default_rng(count).normal(0.0, 0.5, (3, count, 3)))
    expected = matrices.copy()
    for k in range(1, count):
        expected[:, k] = expected[:, k - 1] @ matrices[:, k]
    np.testing.assert_allclose(running_product(matrices), expected, atol=1e-14)  # rounding, 29 products


def test_integrals_of_straight_lines_are_parabolas() -> None:
    time = np.sort(np.random.default_rng(2).uniform(0.0, 10.0, 50))
    time[0] = 0.0
    rates = np.column_stack((np.ones(50), time, -2.0 * time))
    exact = np.column_stack((time, 0.5 * time**2, -(time**2)))
    np.testing.assert_allclose(cumulative(time, rates), exact, atol=1e-12)  # trapezoids are exact here: rounding
    increments = Increments.of(time, rates, 2.0 * rates)
    when = np.array([[0.0, 5.0], [7.5, time[-1]]])
    assert increments.at(when, angle=True).shape == (2, 2, 3)
    np.testing.assert_allclose(increments.at(when, angle=True)[..., 0], when, atol=1e-12)
    np.testing.assert_allclose(increments.at(when, angle=False)[..., 0], 2.0 * when, atol=1e-12)


def windows_of(start: list[float], offsets: FloatArray, epochs: list[list[int]]) -> Windows:
    """Return windows made by hand."""
    return Windows(start=np.array(start), offsets=offsets, epochs=np.array(epochs), swing=np.ones(len(start)))


def test_the_grid_gives_straight_lines_back_and_knows_nothing_where_there_is_no_epoch() -> None:
    windows = windows_of([0.0, 100.0], np.arange(0.0, 2.01, 0.5), [[0, 1, 2], [3, -1, -1]])
    time = np.array([0.2, 0.5, 1.7, 101.3])
    when = epoch_times(windows, motion_at(time))
    np.testing.assert_array_equal(when[0], time[:3])
    assert np.isnan(when[1, 1:]).all()
    np.testing.assert_array_equal(windows.present, [[True, True, True], [True, False, False]])
    line = np.stack((3.0 * windows.offsets, 1.0 - windows.offsets), axis=-1)
    found = on_grid(np.stack((line, 10.0 + line)), windows, when)
    np.testing.assert_allclose(found[0], np.column_stack((3.0 * time[:3], 1.0 - time[:3])), atol=1e-14)
    np.testing.assert_allclose(found[1, 0], [10.0 + 3.9, 10.0 - 0.3], atol=1e-12)
    assert np.isnan(found[1, 1:]).all()


def test_a_steady_turn_about_a_tilted_axis_is_carried_exactly() -> None:
    time = np.arange(0.0, 30.0, 0.01)
    rate = np.array([0.02, -0.05, 0.3])
    bias = np.array([0.01, 0.0, -0.02])
    still_push = np.array([0.5, 0.1, -9.8])
    # The force stands still in F, so the sensor feels it turned back; gyros in deg/s with a bias.
    attitude = rotations(time[:, None] * rate)
    accel = np.einsum("nji,j->ni", attitude, still_push)
    gyro = np.degrees(np.broadcast_to(rate, attitude.shape[:2]) + bias)
    windows = windows_of([0.0], np.arange(0.0, 23.0, 0.04), [[0]])
    found, velocity = turned(windows, Increments.of(time, gyro, accel), scale=math.pi / 180.0, bias=np.degrees(bias))
    np.testing.assert_allclose(found[0], rotations(windows.offsets[:, None] * rate), atol=1e-10)
    # Of the force's turn within a step of 0.04 s second order is left: (0.3 * 0.04)^2 / 12 of 10 m/s^2 over 23 s.
    error = velocity[0] - windows.offsets[:, None] * still_push
    assert np.abs(error).max() < (0.3 * 0.04) ** 2 / 12.0 * 10.0 * 23.0


def test_a_gyro_of_the_wrong_sign_turns_the_other_way() -> None:
    time = np.arange(0.0, 30.0, 0.01)
    gyro = np.broadcast_to([0.0, 0.0, 0.2], (time.size, 3))
    windows = windows_of([0.0], np.arange(0.0, 5.0, 0.04), [[0]])
    increments = Increments.of(time, gyro, gyro)
    forth, _ = turned(windows, increments, scale=1.0, bias=np.zeros(3))
    back, _ = turned(windows, increments, scale=-1.0, bias=np.zeros(3))
    np.testing.assert_allclose(back, forth.swapaxes(-1, -2), atol=1e-13)


def test_windows_lie_side_by_side_within_the_imu_data() -> None:
    imu = np.arange(0.0, 201.0, 0.01)
    motion = motion_at(np.arange(-5.0, 205.0, 0.2))
    windows = choose_windows(imu, motion, margin=1.6)
    np.testing.assert_allclose(np.diff(windows.start), LENGTH_S)
    assert windows.start[0] == imu[0]
    assert windows.start[-1] + windows.offsets[-1] <= imu[-1] + 0.05
    when = epoch_times(windows, motion)
    assert (np.nanmin(when, axis=1) >= windows.start + 1.6).all()
    assert (np.nanmax(when, axis=1) <= windows.start + 1.6 + LENGTH_S).all()


@pytest.mark.parametrize(
    ("gap", "spared"), [((43.0, 44.0), 7), ((43.0, 99.0), 5), ((59.9, 60.5), 7), ((5.0, 195.0), 0)]
)
def test_no_window_reaches_into_a_gap(gap: tuple[float, float], spared: int) -> None:
    imu = np.arange(0.0, 203.5, 0.01)
    imu = imu[(imu < gap[0]) | (imu > gap[1])]
    windows = choose_windows(imu, motion_at(np.arange(0.0, 203.0, 0.2)), margin=1.6)
    ends = windows.start + windows.offsets[-1]
    assert not ((windows.start < gap[1]) & (ends > gap[0])).any()
    assert windows.start.size >= spared


def test_windows_without_enough_epochs_are_left_out() -> None:
    imu = np.arange(0.0, 203.0, 0.01)
    time = np.arange(0.0, 203.0, 0.2)
    windows = choose_windows(imu, motion_at(time[(time < 80.0) | (time > 120.0)]), margin=1.6)
    assert not np.isin(windows.start, [80.0, 100.0]).any()
    assert choose_windows(imu, motion_at(time[:7]), margin=1.6).start.size == 0
    # One epoch in five seconds: windows grow until there are eight in them.
    assert choose_windows(imu, motion_at(np.arange(0.0, 203.0, 5.0)), margin=1.6).offsets[-1] > 8 * 5.0


def test_of_a_long_drive_the_liveliest_windows_are_kept() -> None:
    imu = np.arange(0.0, 4.0 * 3600.0, 0.05)
    time = np.arange(0.0, 4.0 * 3600.0, 0.5)
    quiet = motion_at(time)
    lively = np.where(time < 2.0 * 3600.0, 0.1, 2.0)
    motion = Motion(time=time, velocity=quiet.velocity * lively[:, None], sigma=quiet.sigma)
    windows = choose_windows(imu, motion, margin=1.6)
    assert windows.start.size == MAX_WINDOWS
    assert windows.start.min() > 2.0 * 3600.0 - 30.0
    assert (np.diff(windows.start) > 0.0).all()


def test_a_steady_acceleration_is_no_swing() -> None:
    time = np.arange(0.0, 100.0, 0.2)
    steady = Motion(time=time, velocity=np.outer(time, [0.5, -0.2, 3.0]), sigma=np.full((time.size, 3), 0.03))
    assert choose_windows(np.arange(0.0, 100.0, 0.01), steady, margin=1.6).swing.max() < 1e-9  # rounding of 50 m/s
    swinging = choose_windows(np.arange(0.0, 100.0, 0.01), motion_at(time, swing=2.0), margin=1.6).swing
    # RMS of a sine of 2 m/s over three periods, which a straight line can take a few per cent off.
    np.testing.assert_allclose(swinging, 2.0 / math.sqrt(2.0), rtol=0.1)
