"""The papers' estimators say how sure they are, and are right: errors over sigma on simulated drives.

Readings at 50 Hz and 5 Hz with the noise that the parameters say; biases drawn as `NoiseParams` says, each axis anew.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import levelhead as lh
from levelhead.conventions import GRAVITY, FloatArray
from levelhead.errors import UsageError
from levelhead.estimators import METHODS
from levelhead.estimators.params import MethodParams, NoiseParams
from levelhead.estimators.trust import WATCHED, widened
from levelhead.sim import SensorModel

SENSORS = SensorModel(imu_rate=50.0, gnss_rate=5.0)
# Vibration of 0.1 m/s^2, white at 50 Hz, has the density 0.1 sqrt(2 / 50).
NOISE = NoiseParams(
    gyro_noise=SENSORS.gyro_noise,
    accel_noise=float(np.hypot(SENSORS.accel_noise, SENSORS.vibration * np.sqrt(2.0 / SENSORS.imu_rate))),
    velocity_std=SENSORS.velocity_noise,
    initial_gyro_bias_std=float(np.radians(0.1)),
    initial_accel_bias_std=0.15,
)


def drive(scenario: str, seed: int, duration: float, *, vertical_bias: float = 0.0) -> tuple[lh.Log, lh.Truth]:
    """Simulate a drive with biases drawn from the prior; the vertical accelerometer's is given."""
    rng = np.random.default_rng(1000 + seed)
    gyro = NOISE.initial_gyro_bias_std * rng.standard_normal(3)
    accel = NOISE.initial_accel_bias_std * rng.standard_normal(2)
    sensors = replace(
        SENSORS,
        gyro_bias=(float(gyro[0]), float(gyro[1]), float(gyro[2])),
        accel_bias=(float(accel[0]), float(accel[1]), vertical_bias),
    )
    return lh.simulate(scenario, seed=seed, duration=duration, sensors=sensors)


def normalised(result: lh.Result, truth: lh.Truth) -> dict[str, FloatArray]:
    """Errors over sigma of the horizontal axes (n, 2), and of what belongs to the vertical (n, 1)."""
    tilt = np.column_stack([result.roll - truth.roll, result.pitch - truth.pitch])
    heading = (result.heading - truth.heading + np.pi) % (2.0 * np.pi) - np.pi
    gyro = (result.gyro_bias - truth.gyro_bias) / result.gyro_bias_std
    return {
        "gyro": gyro[:, :2],
        "accel": ((result.accel_bias - truth.accel_bias) / result.accel_bias_std)[:, :2],
        "tilt": tilt / result.attitude_std[:, :2],
        "vertical gyro": gyro[:, 2:],
        "heading": (heading / result.attitude_std[:, 2])[:, None],
    }


def rms(parts: list[FloatArray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


@pytest.mark.parametrize("scenario", ["field", "windrower"])
def test_the_observer_s_errors_are_as_large_as_it_says(scenario: str) -> None:
    parts: dict[str, list[FloatArray]] = {}
    for seed in range(16):
        log, truth = drive(scenario, seed, 750.0)
        result = lh.estimate(log, "observer", noise=NOISE)
        for name, values in normalised(result, truth).items():
            parts.setdefault(name, []).append(values[log.time > 450.0])
    # 16 drives, two axes, 300 s of errors that stay alike for some 80 s (twice tau_gyro): 120 independent values for
    # the biases, whose RMS scatters by 6 % (1 / sqrt(2 N)); 20 % are three of these, 25 % for the vertical's one axis.
    # Tilt and heading stay alike for a few seconds only; 10 % leave room for what the model rounds off.
    for name, tolerance in {"gyro": 0.2, "accel": 0.2, "tilt": 0.1, "vertical gyro": 0.25, "heading": 0.1}.items():
        assert rms(parts[name]) == pytest.approx(1.0, abs=tolerance), name


@pytest.mark.parametrize("feedback", [True, False])
def test_the_two_stage_estimator_s_errors_are_as_large_as_it_says(feedback: bool) -> None:
    params = lh.TwoStageParams(feedback=feedback)
    settled: list[FloatArray] = []
    learning: dict[str, list[FloatArray]] = {}
    for seed in range(32):
        log, truth = drive("field", seed, 600.0)
        result = lh.estimate(log, "two-stage", params=params, noise=NOISE)
        errors = normalised(result, truth)
        settled.append(errors["gyro"][log.time > 450.0])
        for name in ("accel", "tilt"):
            learning.setdefault(name, []).append(errors[name][log.time > 100.0])
    # The gyro: 32 drives, two axes, 150 s of errors alike for 80 s: 120 values, three times 6 %.
    assert rms(settled) == pytest.approx(1.0, abs=0.2)
    # The accelerometer is still on its way, and each drive's errors are what is left of its own first one: 64 values,
    # 9 %, three of which are 27 %. In the black box the tilt keeps its first error for ever.
    for name, values in learning.items():
        assert rms(values) == pytest.approx(1.0, abs=0.27), name


def test_a_vertical_accelerometer_bias_on_rough_ground_counts() -> None:
    # 0.5 m/s^2 times 3.6 deg RMS of tilt is 0.03 m/s^2, which comes and goes with the ground: too fast to be learnt as
    # a bias, too slow to be averaged, and 0.13 deg of tilt beside the 0.06 deg that the noise makes.
    errors, sigmas, plain = [], [], []
    for seed in range(10):
        log, truth = drive("field", seed, 750.0, vertical_bias=0.5)
        late = log.time > 450.0
        result = lh.estimate(log, "observer", noise=NOISE)
        errors.append(np.column_stack([result.roll - truth.roll, result.pitch - truth.pitch])[late])
        sigmas.append(result.attitude_std[late, :2])
        log, _ = drive("field", seed, 750.0)
        plain.append(lh.estimate(log, "observer", noise=NOISE).attitude_std[late, :2])
    assert rms(sigmas) > 1.3 * rms(plain)
    # Tilt errors now stay alike for as long as the ground does, 6 s: 10 drives of 300 s and two axes give 1000 values,
    # 2 %; 10 % leave room for slopes and turns that come together.
    assert rms(errors) == pytest.approx(rms(sigmas), rel=0.1)


def test_on_a_side_slope_the_vertical_bias_is_a_matter_of_roll() -> None:
    # Passes along the contour lines of a 10 deg slope, there and back: the part that the vertical bias of 0.3 m/s^2 has
    # in the level changes sign with every turn, 0.05 m/s^2 or 0.3 deg, and is all roll.
    errors, sigmas = [], []
    for seed in range(6):
        log, truth = drive("hill", seed, 750.0, vertical_bias=0.3)
        late = log.time > 450.0
        result = lh.estimate(log, "observer", noise=NOISE)
        errors.append(np.column_stack([result.roll - truth.roll, result.pitch - truth.pitch])[late])
        sigmas.append(result.attitude_std[late, :2])
    error, sigma = (np.sqrt(np.mean(np.concatenate(parts) ** 2, axis=0)) for parts in (errors, sigmas))
    assert sigma[0] > 2.0 * sigma[1]
    # Roll follows a known size; pitch is noise and what is left of the biases: 6 drives of 300 s, alike for 80 s at
    # most, are 22 values and 15 % of that part; 25 % in all.
    np.testing.assert_allclose(sigma, error, rtol=0.25)


def test_on_a_straight_the_accelerometer_stays_unknown() -> None:
    log, _ = drive("straight", 3, 600.0)
    for method in ("observer", "two-stage"):
        result = lh.estimate(log, method, noise=NOISE)
        # The random walk of 600 s adds in squares: sqrt(600) 2e-4 / 0.15 = 3 % and 0.05 % of the sum.
        np.testing.assert_allclose(result.accel_bias_std[-1, :2], NOISE.initial_accel_bias_std, rtol=2e-3)
        assert result.known_accel == (False, False, False)
        # A tilt that cannot be told from the bias: theta = beta / g.
        np.testing.assert_allclose(
            result.attitude_std[-1, :2], NOISE.initial_accel_bias_std / GRAVITY, rtol=0.01
        )  # 0.04 deg of noise beside 0.88 deg


def test_on_a_circle_the_accelerometer_stays_unknown() -> None:
    log, truth = drive("circle", 3, 900.0)
    result = lh.estimate(log, "observer", noise=NOISE)
    assert not any(result.known_accel)
    assert result.accel_bias_std[-1, :2].min() > 0.3 * NOISE.initial_accel_bias_std
    # What stays is what was there at the beginning: within three sigma on both axes.
    assert np.abs((result.accel_bias - truth.accel_bias) / result.accel_bias_std)[-1, :2].max() < 3.0


def test_sigma_says_what_a_constant_does() -> None:
    log, _ = drive("windrower", 1, 900.0)

    def end(params: MethodParams, method: str = "observer") -> FloatArray:
        result = lh.estimate(log, method, params=params, noise=NOISE)
        return np.array([result.gyro_bias_std[-1, 0], result.accel_bias_std[-1, 0], result.attitude_std[-1, 0]])

    base = end(lh.ObserverParams())
    assert end(lh.ObserverParams(tau_gyro=80.0))[0] < 0.9 * base[0]
    assert end(lh.ObserverParams(omega_accel=2.0))[1] < 0.9 * base[1]
    assert end(lh.ObserverParams(tau=2.0))[2] > 1.2 * base[2]
    # At a steady state a shorter low-pass lets more noise into the gyro.
    paper = end(lh.TwoStageParams(tau_gyro_lowpass=10.0), "two-stage")
    assert end(lh.TwoStageParams(tau_gyro_lowpass=20.0), "two-stage")[0] < 0.9 * paper[0]


def test_more_gnss_noise_makes_more_sigma() -> None:
    log, _ = drive("windrower", 1, 600.0)
    silent = replace(log, velocity_std=None)

    def tilt(drive: lh.Log, noise: NoiseParams) -> float:
        return float(lh.estimate(drive, "observer", noise=noise).attitude_std[-1, 0])

    base = tilt(silent, NOISE)
    assert tilt(silent, replace(NOISE, velocity_std=0.12)) > 2.0 * base
    # The log's own sigma comes first.
    assert tilt(log, replace(NOISE, velocity_std=0.12)) == pytest.approx(base, rel=1e-9)
    assert log.velocity_std is not None
    assert tilt(replace(log, velocity_std=4.0 * log.velocity_std), NOISE) > 2.0 * base


def test_in_an_outage_the_angles_grow_less_sure() -> None:
    ends, sigmas = [], []
    for seed in range(12):
        log, truth = drive("straight", seed, 180.0)
        kept = (log.gnss_time < 90.0) | (log.gnss_time > 170.0)
        assert log.velocity_ned is not None
        cut = replace(
            log,
            gnss_time=log.gnss_time[kept],
            velocity_ned=log.velocity_ned[kept],
            velocity_std=None,
            position_llh=None,
            position_std=None,
        )
        result = lh.estimate(cut, "observer", noise=NOISE)
        row = int(np.searchsorted(log.time, 169.0))
        tilt = np.array([result.roll - truth.roll, result.pitch - truth.pitch])[:, row]
        ends.append(tilt - np.array([result.roll - truth.roll, result.pitch - truth.pitch])[:, row - 78 * 50])
        sigma = result.attitude_std[:, 0] ** 2
        sigmas.append(np.sqrt(sigma[row] - sigma[row - 78 * 50]))
        assert result.attitude_std[row, 0] > 1.3 * result.attitude_std[row - 78 * 50, 0]
        assert result.attitude_std[row, 2] > 3.0 * result.attitude_std[row - 78 * 50, 2]
    # What 78 s without GNSS add to the tilt, 24 values: 14 %, three of which are 43 %.
    assert np.sqrt(np.mean(np.square(ends))) == pytest.approx(np.sqrt(np.mean(np.square(sigmas))), rel=0.43)


def test_unknown_is_nan_and_not_a_number_out_of_the_air() -> None:
    log, _ = lh.simulate("field", seed=1, duration=60.0, sensors=SENSORS, standstill_s=30.0)
    result = lh.estimate(log, "observer", noise=NOISE)
    assert np.isnan(result.accel_bias_std[:, 2]).all()
    np.testing.assert_array_equal(np.isnan(result.attitude_std[:, 2]), np.isnan(result.heading))
    np.testing.assert_array_equal(np.isnan(result.attitude_std[:, 0]), np.isnan(result.roll))
    assert np.isfinite(result.gyro_bias_std).all()


def test_an_imu_on_its_side_maps_the_vertical_to_its_own_axis() -> None:
    log, _ = drive("windrower", 2, 300.0)
    swap = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # the new y axis points up
    side = replace(log, gyro=log.gyro @ swap.T, accel=log.accel @ swap.T)
    level, tipped = lh.estimate(log, "observer", noise=NOISE), lh.estimate(side, "observer", noise=NOISE)
    assert np.isnan(tipped.accel_bias_std[-1]).tolist() == [False, True, False]
    # The same drive with the axes renamed; the platform starts from another matrix, hence not to the last bit.
    np.testing.assert_allclose(tipped.gyro_bias_std[-1], level.gyro_bias_std[-1, [0, 2, 1]], rtol=1e-3)
    np.testing.assert_allclose(tipped.accel_bias_std[-1, [0, 2]], level.accel_bias_std[-1, :2], rtol=1e-3)


def test_a_movement_that_noise_does_not_explain_widens_sigma() -> None:
    time = np.arange(0.0, 600.0, 0.1)
    sigma = np.full((time.size, 3), 0.01)
    estimate = np.zeros((time.size, 3))
    estimate[:, 0] = 0.03 * np.sin(2.0 * np.pi * time / 60.0)  # three sigmas: the end of what noise may do
    estimate[:, 1] = 0.3 * np.sin(2.0 * np.pi * time / 60.0)
    estimate[:, 2] = np.where(time < 300.0, 0.0, 1.0)
    wide = widened(time, estimate, sigma)
    np.testing.assert_allclose(wide[:, 0], 0.01, rtol=1e-9)
    # Nearly all of it is unmodelled: half of the wander, here the 30 sigmas of the amplitude.
    np.testing.assert_allclose(wide[:, 1], 0.15, rtol=0.01)
    # Before a jump the estimate was wrong by it; the look ahead covers it from two minutes before, and not after.
    assert wide[time < 300.0 - WATCHED - 2.0, 2].max() == 0.01
    assert wide[(time > 300.0 - WATCHED + 2.0) & (time < 299.0), 2].min() > 0.2
    assert wide[time > 301.0, 2].max() == 0.01


def test_a_wandering_bias_is_not_sure_of_itself() -> None:
    log, _ = drive("windrower", 6, 600.0)
    swing = np.radians(0.03) * np.sin(2.0 * np.pi * log.time / 240.0)[:, None] * [0.0, 1.0, 0.0]
    moved = lh.estimate(replace(log, gyro=log.gyro + swing), "observer", noise=NOISE)
    calm = lh.estimate(log, "observer", noise=NOISE)
    assert moved.gyro_bias_std[-1, 1] > 2.0 * calm.gyro_bias_std[-1, 1]
    assert moved.gyro_bias_std[-1, 0] < 1.5 * calm.gyro_bias_std[-1, 0]


def test_noise_is_for_the_methods_that_have_none_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    log, _ = drive("straight", 0, 30.0)
    monkeypatch.setitem(METHODS, "observer", replace(METHODS["observer"], takes_noise=False))
    with pytest.raises(UsageError, match="has its noise in params"):
        lh.estimate(log, "observer", noise=NOISE)
