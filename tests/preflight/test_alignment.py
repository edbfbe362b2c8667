"""Clocks and lever arm: white rows, exact data gives exact answers, and sigmas that hold."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import levelhead as lh
from levelhead.conventions import GRAVITY
from levelhead.preflight import Verdict, check
from levelhead.preflight.alignment import Alignment, Noise, _whitened
from levelhead.preflight.look import look_at
from levelhead.sim import SensorModel
from samples.strange_logs import finding, late, without_positions


def aligned(log: lh.Log, lever_arm: tuple[float, float, float] | None = None) -> Alignment:
    found = look_at(log, lever_arm=lever_arm).alignment
    assert found is not None
    return found


@pytest.mark.parametrize(("gyro_deg_s", "accel", "longest_s"), [(0.1, 0.05, 0.5), (1.0, 0.01, 3.0)])
def test_whitened_rows_are_independent_and_of_unit_size(gyro_deg_s: float, accel: float, longest_s: float) -> None:
    """Noise of all sensors as the docstring models it, some epochs missing: innovations of a Kalman filter."""
    windows, epochs = 2000, 40
    rng = np.random.default_rng(0)
    noise = Noise(gyro=math.radians(gyro_deg_s), accel=accel)
    sigma = np.full((windows, epochs, 3), 0.03)
    elapsed = np.cumsum(rng.uniform(0.1, longest_s, (windows, epochs)), axis=1)
    known = rng.random((windows, epochs)) < 0.8
    velocity, push = np.zeros((windows, 3)), np.zeros((windows, 3))
    rows = np.zeros((windows, epochs, 3, 1))
    before = np.zeros(windows)
    gyro = GRAVITY * noise.gyro * np.array([1.0, 1.0, 0.0])
    for k in range(epochs):
        dt = (elapsed[:, k] - before)[:, None]
        before = elapsed[:, k]
        # A walk of the tilt, its integral, and a walk of the velocity, exactly over dt (one-sided densities: a half).
        a, b, c = rng.standard_normal((3, windows, 3))
        tilt = gyro * np.sqrt(0.5 * dt)
        velocity += dt * push + tilt * dt * (0.5 * a + b / math.sqrt(12.0)) + noise.accel * np.sqrt(0.5 * dt) * c
        push += tilt * a
        rows[:, k, :, 0] = velocity + sigma[:, k] * rng.standard_normal((windows, 3))
    white = _whitened(rows, known, elapsed, sigma, noise)[..., 0]
    assert (white[~known] == 0.0).all()
    count = int(known.sum())
    for axis in range(3):
        values = white[..., axis][known]
        assert values.mean() == pytest.approx(0.0, abs=5.0 / math.sqrt(count))
        assert values.var() == pytest.approx(1.0, abs=5.0 * math.sqrt(2.0 / count))
    for lag in (1, 2, 5):
        both = known[:, lag:] & known[:, :-lag]
        product = (white[:, lag:] * white[:, :-lag])[both]
        assert product.mean() == pytest.approx(0.0, abs=5.0 / math.sqrt(product.size))


def test_whitening_white_noise_alone_is_dividing_by_it() -> None:
    rng = np.random.default_rng(1)
    rows, sigma = rng.standard_normal((4, 9, 3, 2)), rng.uniform(0.1, 2.0, (4, 9, 3))
    known, elapsed = np.ones((4, 9), dtype=np.bool_), np.cumsum(np.ones((4, 9)), axis=1)
    white = _whitened(rows, known, elapsed, sigma, Noise(gyro=0.0, accel=0.0))
    np.testing.assert_allclose(white, rows / sigma[..., None], rtol=1e-12)  # rounding


@pytest.mark.parametrize("offset", [-0.5, -0.13, 0.0, 0.27, 0.5])
def test_exact_data_gives_the_exact_offset(offset: float, perfect: lh.Log) -> None:
    found = aligned(late(perfect, offset))
    # Trapezoids over 0.01 s of motion slower than 1 Hz: (2 pi * 0.01)^2 / 12 of the motion, 0.3 ms.
    assert found.offset_s == pytest.approx(offset, abs=3e-4)
    assert found.offset_std < 1e-3
    assert found.residual_std < 0.1  # of the least sigma that is believed, 0.02 m/s


def test_biases_do_not_move_the_offset(perfect: lh.Log) -> None:
    biased = replace(
        late(perfect, 0.2),
        gyro=perfect.gyro + np.radians([0.2, -0.1, 0.15]),
        accel=perfect.accel + np.array([0.2, -0.1, 0.1]),
    )
    # faults.md demands 10 ms; biases are unknowns of the fit, so what is left of them is second order.
    assert aligned(biased).offset_s == pytest.approx(0.2, abs=1e-3)


@pytest.mark.parametrize("scenario", ["windrower", "field"])
def test_a_lever_arm_that_is_told_leaves_the_clocks_alone(scenario: str) -> None:
    arm = (1.5, -0.5, -2.0)
    sensors = replace(SensorModel.perfect(), lever_arm=arm, gnss_latency=0.2)
    log = lh.simulate(scenario, seed=2, duration=400.0, speed=7.0, sensors=sensors)[0]
    found = aligned(log, arm)
    # The vehicle's axes are known from the mean direction of travel and of gravity, 0.1 deg or so of a 2.5 m arm and
    # the axle besides: millimetres over 7 m/s. A quarter of the 10 ms that are demanded.
    assert found.offset_s == pytest.approx(0.2, abs=2.5e-3)


def test_a_lever_arm_that_nobody_told_is_found_where_the_speed_changes_sign() -> None:
    # A lever arm forward moves the antenna as a late clock does, by arm / speed; reversing tells them apart.
    arm = (1.5, -0.5, -2.0)
    sensors = replace(SensorModel(), lever_arm=arm, gnss_latency=0.1)
    log = lh.simulate("reverse", seed=2, duration=600.0, speed=7.0, sensors=sensors)[0]
    found = check(log)
    clock = finding(found, "clock").values
    assert float(str(clock["latency_s"])) == pytest.approx(0.1, abs=4.0 * float(str(clock["latency_std_s"])))
    lever = finding(found, "lever arm")
    assert lever.verdict is Verdict.WARNING
    assert lever.code == "W_NO_LEVER"
    assert "--lever-arm=" in lever.text
    told = check(log, told=lh.preflight.Told(lever_arm=arm))
    assert not any(f.name == "lever arm" for f in told.findings)


@pytest.mark.parametrize("scenario", ["windrower", "field", "hill", "reverse"])
def test_the_sigma_of_the_clocks_holds(scenario: str) -> None:
    ratios = []
    for seed, offset in enumerate((-0.5, -0.06, 0.24, 0.5)):
        sensors = SensorModel(gnss_latency=offset, imu_rate=50.0, gnss_rate=5.0)
        log = lh.simulate(scenario, seed=seed, duration=400.0, speed=7.0, sensors=sensors)[0]
        found = aligned(without_positions(log))
        ratios.append((found.offset_s - offset) / found.offset_std)
        assert found.offset_s == pytest.approx(offset, abs=0.03)
    # Four sigma happen once in 16 000 draws; 16 are drawn here.
    assert np.abs(ratios).max() < 4.0


@pytest.mark.parametrize("over_the_log", [0.1, -0.1])
def test_a_clock_that_drifts_is_found_and_put_right(over_the_log: float) -> None:
    drive = lh.simulate("windrower", seed=2, duration=600.0, speed=8.0)[0]
    drift = over_the_log / drive.duration
    log = late(drive, 0.15, drift=drift)
    found = check(log)
    clock = finding(found, "clock")
    assert clock.verdict is Verdict.CORRECTED
    assert clock.code == "W_LATENCY"
    assert f"{abs(found.corrections.clock_drift) * drive.duration:.3f} s more so over the log" in clock.text
    # Three tenths of what was there may be left: 15 ms at the ends, where 50 ms were.
    assert found.corrections.clock_drift * drive.duration == pytest.approx(over_the_log, abs=0.03)
    assert (
        np.abs(found.log.gnss_time - drive.gnss_time).max() < 0.5 * np.abs(log.gnss_time - drive.gnss_time - 0.15).max()
    )


def test_a_steady_clock_is_not_said_to_drift(drive: lh.Log) -> None:
    found = check(late(drive, 0.15))
    assert found.corrections.clock_drift == 0.0
    # What one clock offset takes off is the same at all epochs, to rounding of stamps of 400 s.
    assert np.ptp(found.log.gnss_time - drive.gnss_time) < 1e-12


def test_every_window_has_an_offset_of_its_own(drive: lh.Log) -> None:
    found = aligned(late(drive, 0.15))
    used = found.used
    assert used.sum() > 10
    # Chi squared of the windows about the common offset: within a factor of three of one.
    chi = float(np.mean(((found.offsets_s - 0.15) / found.offsets_std)[used] ** 2))
    assert 0.3 < chi < 3.0
