"""The phasor filter and its smoother on drives whose truth is known: how accurate, how sure, how soon, how robust."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np
import pytest

import levelhead as lh
from levelhead.conventions import FloatArray

SENSORS: Final = lh.SensorModel()
TRUE: Final = lh.PhasorParams(
    # White vibration per sample is noise of density vibration / sqrt(rate / 2); the simulated vehicle never slides.
    accel_noise=math.hypot(SENSORS.accel_noise, SENSORS.vibration / math.sqrt(0.5 * SENSORS.imu_rate)),
    velocity_std=SENSORS.velocity_noise,
    sideslip_std=1e-6,
    axle_std=1e-6,
)


def tilt_error(result: lh.Result, truth: lh.Truth) -> FloatArray:
    """Return the errors of roll and pitch (n, 2), rad."""
    return np.column_stack([result.roll - truth.roll, result.pitch - truth.pitch])


def rms(values: FloatArray) -> float:
    """Return the root mean square of everything."""
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.fixture(scope="module", params=["field", "windrower"])
def drive(request: pytest.FixtureRequest) -> tuple[lh.Log, lh.Truth]:
    """Twenty minutes on a field and along swaths."""
    return lh.simulate(str(request.param), seed=4, duration=1200.0)


def test_it_is_as_accurate_as_its_model_allows(drive: tuple[lh.Log, lh.Truth]) -> None:
    log, truth = drive
    result = lh.estimate(log, "phasor", params=TRUE)
    late = log.time > 600.0
    # The steady covariance: 0.026 deg on the field, 0.023 along swaths; a tilt error lasts for seconds, so that ten
    # minutes hold about 60 of them and the RMS of one drive spreads by 10 %. Three of those.
    assert np.degrees(rms(tilt_error(result, truth)[late])) < 0.034
    # Four sigma, one in 16,000; and sigma is what the constants promise.
    assert (np.abs(result.gyro_bias - truth.gyro_bias)[-1] < 4.0 * result.gyro_bias_std[-1]).all()
    assert (np.abs(result.accel_bias - truth.accel_bias)[-1, :2] < 4.0 * result.accel_bias_std[-1, :2]).all()
    assert np.degrees(result.gyro_bias_std[-1]).max() < 0.0013
    assert result.accel_bias_std[-1, :2].max() < 0.0035
    heading = (result.heading - truth.heading + np.pi) % (2.0 * np.pi) - np.pi
    assert np.degrees(rms(heading[late])) < 0.06
    assert result.known_gyro == (True, True, True)
    assert result.known_accel[:2] == (True, True)


def test_the_smoother_knows_the_first_second_as_well_as_the_last(drive: tuple[lh.Log, lh.Truth]) -> None:
    log, truth = drive
    filtered, smoothed = lh.estimate(log, "phasor", params=TRUE), lh.estimate(log, "smoother", params=TRUE)
    error = tilt_error(smoothed, truth)
    late = log.time > 600.0
    # The future halves the variance of a tilt that both sides tell alike; the filter's converged part is the measure.
    assert rms(error) < 0.8 * rms(tilt_error(filtered, truth)[late])
    assert np.isfinite(error).all()
    # At the start only the future tells: the smoother is as sure there as the filter at the end, 0.026 deg; 3 sigma.
    assert np.degrees(np.abs(error[:100]).max()) < 0.08
    assert (smoothed.attitude_std[:, :2].mean(axis=0) < filtered.attitude_std[late][:, :2].mean(axis=0)).all()


def test_the_smoother_has_no_steps_at_the_epochs(drive: tuple[lh.Log, lh.Truth]) -> None:
    log, truth = drive
    result = lh.estimate(log, "smoother", params=TRUE)
    steps = np.diff(tilt_error(result, truth), axis=0)
    at_epochs = np.isin(np.round(log.time[1:], 3), np.round(log.gnss_time, 3))
    # What is left from sample to sample is gyro noise. The two RMS rest on 12,000 and 108,000 values: 1.5 % is three
    # sigma of their ratio; a step of the forward filter's size (2e-4 rad) would be twenty times the noise.
    assert rms(steps[at_epochs]) == pytest.approx(rms(steps[~at_epochs]), rel=0.03)
    # Biases wander by 2e-6 rad/s per root second; no sample may jump by a hundred times what a sample allows.
    assert np.abs(np.diff(result.gyro_bias, axis=0)).max() < 100 * 2e-6 * 0.1


def test_errors_are_as_large_as_sigma_says() -> None:
    gyro, accel, tilt = [], [], []
    for seed in range(6):
        log, truth = lh.simulate("windrower", seed=100 + seed, duration=400.0)
        for method in ("phasor", "smoother"):
            result = lh.estimate(log, method, params=TRUE)
            some = np.arange(10_000, log.time.size, 3000)
            gyro.append(((result.gyro_bias - truth.gyro_bias) / result.gyro_bias_std)[some])
            accel.append(((result.accel_bias - truth.accel_bias) / result.accel_bias_std)[some][:, :2])
            tilt.append((tilt_error(result, truth) / result.attitude_std[:, :2])[some])
    # Tilt: 12 runs of 10 nearly independent moments, two axes: 240 values, a RMS of 1 +- 5 %; filter and smoother share
    # half of it: three sigma are 20 %. A bias error lasts as long as these drives: about 4 x 6 values, +- 15 %.
    assert rms(np.concatenate(tilt)) == pytest.approx(1.0, abs=0.2)
    assert rms(np.concatenate(gyro)) == pytest.approx(1.0, abs=0.45)
    assert rms(np.concatenate(accel)) == pytest.approx(1.0, abs=0.45)


@pytest.mark.parametrize("scenario", ["straight", "circle"])
@pytest.mark.parametrize("method", ["phasor", "smoother", "ekf"])
def test_what_the_drive_does_not_tell_is_not_known(scenario: str, method: str) -> None:
    log, _ = lh.simulate(scenario, seed=2, duration=600.0)
    result = lh.estimate(log, method)
    last = lh.Status(int(result.status[-1]))
    assert lh.Status.ACCEL_SETTLED not in last
    assert (lh.Status.UNSEPARATED if scenario == "circle" else lh.Status.ACCEL_UNOBSERVABLE) in last
    assert result.known_accel[:2] == (False, False)
    assert result.settled_at_s["accel"] is None
    shown = result.summary()["accel_bias_m_s2"]
    assert isinstance(shown, list)
    assert shown[:2] == [None, None]


@pytest.fixture(scope="module")
def drives() -> list[tuple[lh.Log, lh.Truth]]:
    """Several drives that do not tell their velocity noise."""
    made = [lh.simulate("windrower", seed=seed, duration=1200.0) for seed in range(4)]
    return [(replace(log, velocity_std=None), truth) for log, truth in made]


@pytest.mark.parametrize("name", ["gyro_noise", "accel_noise", "gyro_bias_walk", "accel_bias_walk", "velocity_std"])
@pytest.mark.parametrize("factor", [0.2, 5.0])
def test_five_times_wrong_noise_costs_little(name: str, factor: float, drives: list[tuple[lh.Log, lh.Truth]]) -> None:
    def error(params: lh.PhasorParams) -> float:
        late = slice(60_000, None)
        return rms(
            np.concatenate(
                [tilt_error(lh.estimate(log, "phasor", params=params), truth)[late] for log, truth in drives]
            )
        )

    # The promise. Five times too much gyro noise costs sqrt((5 + 1/5) / 2) = 1.61 in theory, were there no GNSS noise.
    assert error(replace(TRUE, **{name: factor * getattr(TRUE, name)})) < 1.6 * error(TRUE)


@pytest.mark.parametrize("method", ["phasor", "smoother"])
def test_an_imu_on_its_side_or_upside_down_is_as_good(method: str) -> None:
    level, truth = lh.simulate("windrower", seed=5, duration=400.0)
    base = lh.estimate(level, method, params=TRUE)
    sensors = lh.SensorModel(mounting_roll=math.pi)
    log, turned = lh.simulate("windrower", seed=5, duration=400.0, sensors=sensors)
    result = lh.estimate(log, method, params=TRUE)
    late = log.time > 200.0
    error = tilt_error(result, turned)
    error[:, 0] = (error[:, 0] + np.pi) % (2.0 * np.pi) - np.pi
    # The same drive and noise seen from other axes; the noise's draw is not the same, which costs its usual spread.
    assert rms(error[late]) < 1.5 * rms(tilt_error(base, truth)[late])
    assert result.known_gyro == base.known_gyro


def test_a_start_at_a_standstill_waits_for_the_course() -> None:
    log, truth = lh.simulate("field", seed=3, duration=300.0, standstill_s=30.0)
    filtered, smoothed = lh.estimate(log, "phasor", params=TRUE), lh.estimate(log, "smoother", params=TRUE)
    standing = (log.time > 2.0) & (log.time < 30.0)
    assert np.isnan(filtered.heading[standing]).all()
    # Afterwards the heading of the standing vehicle is known too: the gyros tell how far it is from the first course.
    heading = (smoothed.heading - truth.heading + np.pi) % (2.0 * np.pi) - np.pi
    assert np.degrees(np.abs(heading).max()) < 0.5
    assert np.degrees(rms(tilt_error(smoothed, truth))) < 0.03


def test_driving_backwards_is_recognised() -> None:
    log, truth = lh.simulate("reverse", seed=3, duration=600.0)
    result = lh.estimate(log, "phasor", params=TRUE)
    assert ((result.status & int(lh.Status.REVERSE)) != 0).any()
    late = log.time > 300.0
    assert np.degrees(rms(tilt_error(result, truth)[late])) < 0.04


def test_wild_fixes_are_trusted_less() -> None:
    """One epoch in fifty is off by metres per second, and ten seconds by a steady jump."""
    log, truth = lh.simulate("field", seed=6, duration=900.0)
    assert log.velocity_ned is not None
    velocity = log.velocity_ned.copy()
    rng = np.random.default_rng(6)
    wild = rng.random(velocity.shape[0]) < 0.02
    velocity[wild] += rng.normal(0.0, 3.0, (int(np.count_nonzero(wild)), 3))
    jump = (log.gnss_time > 700.0) & (log.gnss_time < 710.0)
    velocity[jump] += [1.0, -2.0, 3.0]
    faulty = replace(log, velocity_ned=velocity)
    late = log.time > 600.0
    for method in ("phasor", "smoother"):
        clean, hit = (rms(tilt_error(lh.estimate(each, method, params=TRUE), truth)[late]) for each in (log, faulty))
        # Two percent of the fixes lost cost nothing; ten seconds without GNSS let a tilt of 0.03 deg grow by 0.02.
        assert hit < 1.5 * clean, method


def test_gaps_in_the_readings_cost_accuracy_for_seconds_only() -> None:
    log, truth = lh.simulate("field", seed=7, duration=900.0)
    keep = np.ones(log.time.size, dtype=bool)
    for start, length in ((650.0, 0.5), (700.0, 1.5), (750.0, 5.0)):
        keep &= ~((log.time > start) & (log.time < start + length))
    holed = replace(log, time=log.time[keep], gyro=log.gyro[keep], accel=log.accel[keep])
    filtered, smoothed = lh.estimate(holed, "phasor", params=TRUE), lh.estimate(holed, "smoother", params=TRUE)
    assert {event.code for event in filtered.events} >= {"W_GAP", "E_GAP_RESET"}
    true = np.column_stack([truth.roll, truth.pitch])[keep]
    for result, worst in ((filtered, 3.0), (smoothed, 0.3)):
        error = np.column_stack([result.roll, result.pitch]) - true
        late = holed.time > 600.0
        known = np.isfinite(error).all(axis=1) & late
        # The filter levels anew after the long gap, on a second of velocities: 0.04 m/s^2 of noise are 0.25 deg, and
        # a turn of the unseen ground adds to it; the smoother sees both sides of every gap.
        assert np.degrees(np.abs(error[known]).max()) < worst
        far = known & (holed.time > 800.0)
        assert np.degrees(rms(error[far])) < 0.045
    assert np.isfinite(smoothed.roll).all()


def test_noise_in_the_readings_is_reckoned_with() -> None:
    sensors = lh.SensorModel(gyro_noise=math.radians(0.03), vibration=0.3)
    log, _ = lh.simulate("windrower", seed=8, duration=600.0, sensors=sensors)
    result = lh.estimate(log)
    true_accel = math.hypot(sensors.accel_noise, sensors.vibration / math.sqrt(0.5 * sensors.imu_rate))
    # A variance from 20 windows of 300 differences: its root is good to 1 %; what motion adds is below 10 %.
    assert result.params["gyro_noise"] == pytest.approx(sensors.gyro_noise, rel=0.1)
    assert result.params["accel_noise"] == pytest.approx(true_accel, rel=0.1)
    # Gyros as noisy as that are of the consumer grade.
    assert result.params["gyro_bias_walk"] == lh.PhasorParams.preset("consumer").gyro_bias_walk
    assert "I_NOISE_FOUND" in {event.code for event in result.events}
    calm = lh.simulate("windrower", seed=8, duration=600.0, sensors=lh.SensorModel.perfect())[0]
    # Readings without noise do not make the filter believe that nothing is ever wrong.
    assert lh.estimate(calm).params["gyro_noise"] == lh.PhasorParams().gyro_noise
    assert lh.estimate(log, params=TRUE).params["accel_noise"] == TRUE.accel_noise


def test_the_earth_turns_under_the_vehicle() -> None:
    """Its rate is 0.003 deg/s here: three sigma of the gyro bias. With positions in the log it is taken off."""
    log, truth = lh.simulate("windrower", seed=9, duration=900.0, earth_rotation=True)
    aware = lh.estimate(log, "phasor", params=TRUE)
    blind = lh.estimate(replace(log, position_llh=None, position_std=None), "phasor", params=TRUE)
    assert aware.params["latitude"] is not None
    assert (np.abs(aware.gyro_bias - truth.gyro_bias)[-1] < 4.0 * aware.gyro_bias_std[-1]).all()
    vertical = np.degrees(blind.gyro_bias - truth.gyro_bias)[-1, 2]
    # -15.04 deg/h sin(45.7 deg) = -0.00299 deg/s about down; sigma is 0.001.
    assert vertical == pytest.approx(-0.00299, abs=0.002)
    assert blind.params["latitude"] is None


def test_what_surprises_the_filter_widens_its_sigma() -> None:
    """A receiver that is four times noisier than it says."""
    log, truth = lh.simulate("windrower", seed=5, duration=900.0, sensors=lh.SensorModel(velocity_noise=0.12))
    modest = replace(log, velocity_std=np.full(log.gnss_time.size, 0.03))
    result, told = lh.estimate(modest, "phasor", params=TRUE), lh.estimate(log, "phasor", params=TRUE)
    assert "W_INNOVATIONS" in {event.code for event in result.events}
    assert "W_INNOVATIONS" not in {event.code for event in told.events}
    late = slice(60_000, None)
    # RMS of one drive's normalised tilt errors: 1 +- 10 %; with the claimed noise it would be above 2.
    assert rms((tilt_error(result, truth) / result.attitude_std[:, :2])[late]) < 1.3
    # A log that says nothing about its velocities has them looked at.
    silent = lh.estimate(replace(log, velocity_std=None), "phasor")
    assert silent.params["velocity_std"] == pytest.approx(0.12, rel=0.15)


def test_presets_are_grades_of_sensors() -> None:
    grades = [lh.PhasorParams.preset(name) for name in ("consumer", "industrial", "tactical")]
    for name in ("gyro_noise", "accel_noise", "gyro_bias_walk", "initial_gyro_bias_std"):
        values = [getattr(grade, name) for grade in grades]
        assert values == sorted(values, reverse=True)
    assert grades[1] == lh.PhasorParams()
    assert lh.PhasorParams.preset("tactical", velocity_std=0.01).velocity_std == 0.01
    with pytest.raises(lh.UsageError, match="choose one of consumer, industrial, tactical"):
        lh.PhasorParams.preset("cheap")
