"""Each imperfection of the simulated sensors is the one asked for, and nothing else changes with it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from levelhead.conventions import GRAVITY, FloatArray
from levelhead.earth import radii
from levelhead.errors import UsageError
from levelhead.logs.log import Log
from levelhead.sim import SensorModel, simulate
from levelhead.sim.scenarios import CRAB_ANGLE
from levelhead.sim.sensors import Stream, generator

PERFECT = SensorModel.perfect()


def log_of(sensors: SensorModel, *, scenario: str = "field", duration: float = 100.0) -> Log:
    """Return the log of one drive with these sensors."""
    return simulate(scenario, seed=1, duration=duration, sensors=sensors)[0]


def apart_m(llh: FloatArray | None, other: FloatArray | None) -> FloatArray:
    """Return how far the first positions are north, east and above the others, m."""
    assert llh is not None
    assert other is not None
    meridian, normal = radii(other[:, 0])
    east = (normal + other[:, 2]) * np.cos(other[:, 0])
    return (llh - other) * np.stack((meridian + other[:, 2], east, np.ones_like(east)), axis=1)


def test_the_defaults_are_those_of_the_design_notes() -> None:
    sensors = SensorModel()
    assert (sensors.imu_rate, sensors.gnss_rate, sensors.velocity_noise) == (100.0, 10.0, 0.03)
    assert math.degrees(sensors.gyro_noise) == pytest.approx(0.01)
    assert sensors.accel_noise == pytest.approx(150e-6 * GRAVITY)
    assert [math.degrees(b) for b in sensors.gyro_bias] == pytest.approx([0.08, 0.13, 0.05])
    assert (sensors.accel_bias, sensors.vibration) == ((0.11, 0.2, 0.0), 0.1)
    assert (sensors.gyro_bias_walk, sensors.accel_bias_walk) == (2e-6, 2e-4)


def test_perfect_sensors_read_the_truth() -> None:
    log, truth = simulate("field", duration=20.0, sensors=PERFECT)
    np.testing.assert_array_equal(log.gyro, truth.angular_rate)
    np.testing.assert_array_equal(log.accel, truth.specific_force)
    assert log.velocity_ned is not None
    np.testing.assert_allclose(log.velocity_ned, truth.velocity_ned[::10], atol=1e-13)  # rounding
    assert log.velocity_std is None
    assert log.position_std is None


def test_noise_densities_are_one_sided() -> None:
    sensors = replace(PERFECT, imu_rate=200.0, gyro_noise=2e-4, accel_noise=3e-3)
    log, truth = simulate("circle", duration=300.0, sensors=sensors)
    # Density times sqrt(rate / 2) = 10. 60,000 samples an axis: the standard deviation is known to 0.3 %, 4 sigma.
    np.testing.assert_allclose(np.std(log.gyro - truth.angular_rate, axis=0), 2e-3, rtol=0.012)
    np.testing.assert_allclose(np.std(log.accel - truth.specific_force, axis=0), 3e-2, rtol=0.012)


def test_gnss_noise_and_its_sigma_columns() -> None:
    sensors = replace(PERFECT, velocity_noise=0.03, position_noise=0.5)
    noisy, perfect = (log_of(s, duration=1000.0) for s in (sensors, PERFECT))
    assert noisy.velocity_ned is not None
    assert perfect.velocity_ned is not None
    assert noisy.velocity_std is not None
    assert noisy.position_std is not None
    # 10,000 epochs: 0.7 %, 4 sigma.
    np.testing.assert_allclose(np.std(noisy.velocity_ned - perfect.velocity_ned, axis=0), 0.03, rtol=0.03)
    np.testing.assert_allclose(np.std(apart_m(noisy.position_llh, perfect.position_llh), axis=0), 0.5, rtol=0.03)
    np.testing.assert_array_equal(noisy.velocity_std, 0.03)
    np.testing.assert_array_equal(noisy.position_std, 0.5)


def test_white_vibration_is_seen_by_the_accelerometers_only() -> None:
    shaken, still = (log_of(s) for s in (replace(PERFECT, vibration=0.1), PERFECT))
    np.testing.assert_array_equal(shaken.gyro, still.gyro)
    # 10,000 samples: 0.7 %, 4 sigma.
    np.testing.assert_allclose(np.std(shaken.accel - still.accel, axis=0), 0.1, rtol=0.03)


def test_band_vibration_stays_in_its_band() -> None:
    shaken, still = (log_of(s) for s in (replace(PERFECT, band_vibration=0.5), PERFECT))
    shaking = shaken.accel - still.accel
    # Twelve sinusoids of equal power over 100 s; neighbours less than 0.01 Hz apart would beat, by some per cent.
    np.testing.assert_allclose(np.sqrt(np.mean(shaking**2, axis=0)), 0.5, rtol=0.05)
    power = np.abs(np.fft.rfft(shaking * np.hanning(len(shaking))[:, None], axis=0)) ** 2
    frequency = np.fft.rfftfreq(len(shaking), 0.01)
    outside = (frequency < 11.9) | (frequency > 40.1)
    assert power[outside].sum() < 1e-6 * power.sum()  # side lobes of the window
    assert abs(np.mean(shaking[:, 0] * shaking[:, 1])) < 0.1 * 0.5**2  # the axes shake on their own


def test_biases_add_and_walk() -> None:
    sensors = replace(
        PERFECT,
        imu_rate=2.0,
        gyro_bias=(0.01, -0.02, 0.03),
        accel_bias=(0.1, 0.2, -0.3),
        gyro_bias_walk=2e-6,
        accel_bias_walk=2e-4,
    )
    log, truth = simulate("circle", seed=4, duration=10_000.0, sensors=sensors)
    np.testing.assert_allclose(log.gyro - truth.angular_rate, truth.gyro_bias, atol=1e-15)  # rounding
    np.testing.assert_allclose(log.accel - truth.specific_force, truth.accel_bias, atol=1e-14)
    np.testing.assert_array_equal(truth.gyro_bias[0], sensors.gyro_bias)
    np.testing.assert_array_equal(truth.accel_bias[0], sensors.accel_bias)
    # 1000 steps of 10 s an axis: 2.2 %, 4 sigma.
    np.testing.assert_allclose(np.diff(truth.gyro_bias[::20], axis=0).std(axis=0), 2e-6 * math.sqrt(10.0), rtol=0.09)
    np.testing.assert_allclose(np.diff(truth.accel_bias[::20], axis=0).std(axis=0), 2e-4 * math.sqrt(10.0), rtol=0.09)


def test_switching_one_error_off_leaves_the_others_alone() -> None:
    full = SensorModel()
    log, no_gyro_noise = log_of(full), log_of(replace(full, gyro_noise=0.0))
    np.testing.assert_array_equal(no_gyro_noise.accel, log.accel)
    np.testing.assert_array_equal(np.asarray(no_gyro_noise.velocity_ned), np.asarray(log.velocity_ned))
    assert np.any(no_gyro_noise.gyro != log.gyro)
    no_velocity_noise = log_of(replace(full, velocity_noise=0.0))
    np.testing.assert_array_equal(np.asarray(no_velocity_noise.position_llh), np.asarray(log.position_llh))
    np.testing.assert_array_equal(no_velocity_noise.gyro, log.gyro)


def test_readings_are_quantised() -> None:
    coarse, fine = (log_of(s) for s in (replace(PERFECT, gyro_step=1e-3, accel_step=0.05), PERFECT))
    for read, true, step in ((coarse.gyro, fine.gyro, 1e-3), (coarse.accel, fine.accel, 0.05)):
        np.testing.assert_allclose(read / step, np.rint(read / step), atol=1e-9)  # rounding of counts up to 200
        assert np.abs(read - true).max() <= step / 2 * (1 + 1e-9)
        assert np.abs(read - true).max() > 0.49 * step  # 10,000 samples come close to the edge


def test_readings_saturate() -> None:
    sensors = replace(PERFECT, gyro_range=0.1, accel_range=9.7)
    cut, free = (log_of(s, duration=200.0) for s in (sensors, PERFECT))
    np.testing.assert_array_equal(cut.gyro, np.clip(free.gyro, -0.1, 0.1))
    np.testing.assert_array_equal(cut.accel, np.clip(free.accel, -9.7, 9.7))
    assert np.any(cut.gyro[:, 2] == 0.1)
    assert np.any(cut.accel[:, 2] == -9.7)


@pytest.mark.parametrize("latency", [0.2, -0.05])
def test_late_stamps_show_what_was_true_before(latency: float) -> None:
    late = log_of(replace(PERFECT, gnss_rate=20.0, gnss_latency=latency), scenario="windrower")
    on_time = log_of(replace(PERFECT, gnss_rate=20.0), scenario="windrower")
    shift = round(latency * 20.0)
    a, b = (late, on_time) if shift > 0 else (on_time, late)
    k = abs(shift)
    np.testing.assert_array_equal(late.gnss_time, on_time.gnss_time)
    # What is stamped t + latency was true at t; the times differ by rounding.
    np.testing.assert_allclose(np.asarray(a.velocity_ned)[k:], np.asarray(b.velocity_ned)[:-k], atol=1e-12)
    # Rounding of a longitude and of its integral: 1e-8 m.
    np.testing.assert_allclose(apart_m(np.asarray(a.position_llh)[k:], np.asarray(b.position_llh)[:-k]), 0.0, atol=1e-7)
    assert np.abs(np.asarray(a.velocity_ned) - np.asarray(b.velocity_ned)).max() > 0.01


def test_the_antenna_moves_with_the_body() -> None:
    forward, right = 2.0, 0.5
    arm = log_of(replace(PERFECT, lever_arm=(forward, right, -3.0)), scenario="circle")
    none, truth = simulate("circle", seed=1, duration=100.0, sensors=PERFECT)
    rate, heading = math.radians(10.0), truth.heading[::10]
    # A point ahead of the IMU moves to the right in a right turn, one on the right moves backwards; rounding only.
    extra_forward, extra_right = -rate * right, rate * forward
    expected = np.stack(
        (
            extra_forward * np.cos(heading) - extra_right * np.sin(heading),
            extra_forward * np.sin(heading) + extra_right * np.cos(heading),
            np.zeros_like(heading),
        ),
        axis=1,
    )
    np.testing.assert_allclose(np.asarray(arm.velocity_ned) - np.asarray(none.velocity_ned), expected, atol=1e-13)
    shift = np.stack(
        (
            forward * np.cos(heading) - right * np.sin(heading),
            forward * np.sin(heading) + right * np.cos(heading),
            np.full_like(heading, 3.0),
        ),
        axis=1,
    )
    # Rounding of a longitude: 1e-9 m.
    np.testing.assert_allclose(apart_m(arm.position_llh, none.position_llh), shift, atol=1e-7)


def test_an_antenna_on_the_roof_swings_when_the_vehicle_rolls() -> None:
    arm = log_of(replace(PERFECT, gnss_rate=100.0, lever_arm=(0.0, 0.0, -3.0)), scenario="straight")
    none, truth = simulate("straight", seed=1, duration=100.0, sensors=replace(PERFECT, gnss_rate=100.0))
    across = np.stack((-np.sin(truth.heading), np.cos(truth.heading)), axis=1)
    moved = np.asarray(arm.velocity_ned) - np.asarray(none.velocity_ned)
    swing = np.sum(moved[:, :2] * across, axis=1)
    # It leans to the right by 3 m times sin(roll); central differences of that are off by h^2 / 6 of 3 rad^3/s^3 m.
    np.testing.assert_allclose(swing[1:-1], 3.0 * (np.sin(truth.roll[2:]) - np.sin(truth.roll[:-2])) / 0.02, atol=1e-4)


def test_the_antenna_does_not_care_where_on_the_vehicle_the_imu_is() -> None:
    axle = log_of(replace(PERFECT, lever_arm=(2.0, 0.5, -3.0)))
    cabin = log_of(replace(PERFECT, imu_from_axle=(1.5, 0.4, -1.0), lever_arm=(0.5, 0.1, -2.0)))
    assert cabin.velocity_ned is not None
    assert axle.velocity_ned is not None
    np.testing.assert_allclose(cabin.velocity_ned, axle.velocity_ned, atol=1e-13)  # rounding
    np.testing.assert_allclose(apart_m(cabin.position_llh, axle.position_llh), 0.0, atol=1e-8)  # rounding of 1 rad


def test_wheels_tell_the_speed_of_the_axle() -> None:
    assert log_of(PERFECT).wheel_speed is None
    sensors = replace(PERFECT, wheel_speed=True, imu_from_axle=(1.5, 0.4, -1.0))
    log, truth = simulate("reverse", seed=1, duration=120.0, sensors=sensors)
    assert log.wheel_speed is not None
    axle = truth.at((-1.5, -0.4, 1.0)).velocity_ned
    # Along the vehicle's x axis is all the axle moves, forwards and backwards; rounding.
    np.testing.assert_allclose(np.abs(log.wheel_speed), np.linalg.norm(axle, axis=1), atol=1e-13)
    assert (log.wheel_speed.max(), log.wheel_speed.min()) == pytest.approx((3.0, -1.5), abs=1e-14)
    # A crabbing vehicle rolls along its x axis and slides across it.
    crab = log_of(sensors, scenario="crab", duration=50.0).wheel_speed
    np.testing.assert_allclose(np.asarray(crab), 3.0 * math.cos(CRAB_ANGLE), rtol=1e-14)


def test_wheels_err_by_scale_and_noise() -> None:
    true, scaled, noisy = (
        log_of(replace(PERFECT, wheel_speed=True, wheel_speed_scale=scale, wheel_speed_noise=noise))
        for scale, noise in ((0.0, 0.0), (0.01, 0.0), (0.0, 0.05))
    )
    assert true.wheel_speed is not None
    np.testing.assert_allclose(np.asarray(scaled.wheel_speed), 1.01 * true.wheel_speed, rtol=1e-14)  # rounding
    # 10,000 samples: 0.7 %, 4 sigma.
    assert np.std(np.asarray(noisy.wheel_speed) - true.wheel_speed) == pytest.approx(0.05, rel=0.03)
    np.testing.assert_array_equal(noisy.gyro, true.gyro)
    np.testing.assert_array_equal(log_of(PERFECT).accel, true.accel)


def test_an_imu_turned_by_90_degrees_reads_the_right_side_as_its_front() -> None:
    turned, truth = simulate("field", seed=1, duration=100.0, sensors=replace(PERFECT, mounting_yaw=math.pi / 2))
    plain, _ = simulate("field", seed=1, duration=100.0, sensors=PERFECT)
    for mine, theirs in ((turned.gyro, plain.gyro), (turned.accel, plain.accel)):
        expected = np.stack((theirs[:, 1], -theirs[:, 0], theirs[:, 2]), axis=1)
        np.testing.assert_allclose(mine, expected, atol=1e-14)  # rounding
    # GNSS knows nothing of how the IMU is screwed on.
    np.testing.assert_array_equal(np.asarray(turned.velocity_ned), np.asarray(plain.velocity_ned))
    np.testing.assert_array_equal(truth.angular_rate, turned.gyro)


def test_with_a_mounting_the_truth_is_the_imu_attitude() -> None:
    sensors = replace(PERFECT, mounting_roll=0.3, mounting_pitch=-0.2, mounting_yaw=2.5)
    log, truth = simulate("circle", seed=1, duration=60.0, sensors=sensors)
    # Standard gravity as the tilted IMU sees it, from roll and pitch of the truth; the circle adds its own force.
    roll, pitch, heading = truth.roll, truth.pitch, truth.heading
    down = np.stack((-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)), axis=1)
    np.testing.assert_allclose(log.gyro, math.radians(10.0) * down, atol=1e-14)  # rounding
    np.testing.assert_allclose(np.sum(log.accel * down, axis=1), -GRAVITY, atol=1e-13)
    # On level ground the mounting's angles are the attitude, and the heading is off by the mounting's yaw.
    np.testing.assert_allclose(roll, 0.3, atol=1e-14)
    np.testing.assert_allclose(pitch, -0.2, atol=1e-14)
    course = np.arctan2(truth.velocity_ned[:, 1], truth.velocity_ned[:, 0])
    np.testing.assert_allclose(np.exp(1j * (heading - course)), np.exp(2.5j), atol=1e-12)


def test_jitter_moves_the_stamps_and_keeps_their_order() -> None:
    sensors = replace(PERFECT, imu_time_jitter=1e-3, gnss_time_jitter=1.0)
    log, truth = simulate("field", seed=1, duration=100.0, sensors=sensors)
    still = log_of(PERFECT)
    np.testing.assert_array_equal(log.gyro, still.gyro)
    np.testing.assert_array_equal(truth.time, still.time)
    assert np.std(log.time - truth.time) == pytest.approx(1e-3, rel=0.03)  # 10,000 stamps: 0.7 %, 4 sigma
    assert np.abs(log.gnss_time - still.gnss_time).max() == pytest.approx(0.045, abs=1e-9)  # cut off; rounding


def test_streams_differ_from_each_other_and_between_chunks() -> None:
    draws = {generator(5, stream, start).random() for stream in Stream for start in (0.0, 600.0)}
    assert len(draws) == 2 * len(Stream)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"gyro_noise": -1.0}, "gyro_noise is -1.0 rad/s/sqrt"),
        ({"velocity_noise": math.nan}, "velocity_noise is nan m/s"),
        ({"imu_rate": 0.0}, "imu_rate is 0.0 Hz"),
        ({"gnss_rate": math.inf}, "gnss_rate is inf Hz"),
        ({"accel_range": 0.0}, "accel_range is 0.0 m/s"),
        ({"accel_range": math.nan}, "accel_range is nan m/s"),
        ({"gnss_latency": math.inf}, "gnss_latency is inf s"),
        ({"wheel_speed_noise": -0.1}, "wheel_speed_noise is -0.1 m/s"),
        ({"wheel_speed_scale": math.nan}, "wheel_speed_scale is nan"),
        ({"imu_from_axle": (1.0, 2.0)}, "imu_from_axle is .* three finite numbers in m"),
        ({"lever_arm": (1.0, 2.0)}, "three finite numbers in m"),
        ({"gyro_bias": (0.0, math.nan, 0.0)}, "three finite numbers in rad/s"),
        ({"vibration_band": (40.0, 12.0)}, "give \\(low, high\\)"),
    ],
)
def test_bad_settings_are_refused(change: dict[str, Any], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        replace(PERFECT, **change)
