"""Monte Carlo runs: the same figures however many processes; a sigma that lies is caught."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

import levelhead as lh
from levelhead.analysis.metrics import settling_time
from levelhead.analysis.montecarlo import judge, monte_carlo, true_noise, true_params
from levelhead.analysis.trials import QUANTITIES, MonteCarlo, Trial, chi_square_band
from levelhead.conventions import FloatArray
from levelhead.estimators.base import SensorData
from levelhead.estimators.params import MethodParams, NoiseParams

Change = Callable[[lh.Result, SensorData], lh.Result]
Register = Callable[..., None]

GYRO, ACCEL = slice(3, 6), slice(6, 9)
STEADY = lh.SensorModel(gyro_bias_walk=0.0, accel_bias_walk=0.0)


def guess(claimed: float) -> Change:
    """Make a method whose biases are off by a normal error, and whose sigma is `claimed` times the true one."""
    gyro_sigma, accel_sigma = 1e-4, 0.01

    def change(result: lh.Result, data: SensorData) -> lh.Result:
        # The drive's own first reading is the seed: another error in every drive, the same on every run of the test.
        rng = np.random.default_rng(abs(round(data.gyro[0, 0] * 1e7)))
        shape = result.gyro_bias.shape
        gyro = np.array(STEADY.gyro_bias) + gyro_sigma * rng.standard_normal(3)
        accel = np.array(STEADY.accel_bias) + accel_sigma * rng.standard_normal(3)
        return replace(
            result,
            gyro_bias=np.broadcast_to(gyro, shape),
            accel_bias=np.broadcast_to(accel, shape),
            gyro_bias_std=np.full(shape, claimed * gyro_sigma),
            accel_bias_std=np.full(shape, claimed * accel_sigma),
            attitude_std=np.full(shape, np.nan),
        )

    return change


def test_one_process_or_two_give_the_same_figures() -> None:
    one = monte_carlo("windrower", 3, duration=60.0, seed0=5, workers=1)
    two = monte_carlo("windrower", 3, duration=60.0, seed0=5, workers=2)
    assert one.as_dict() == two.as_dict()
    for method, trials in one.trials.items():
        assert [trial.seed for trial in trials] == [5, 6, 7]
        for a, b in zip(trials, two.trials[method], strict=True):
            np.testing.assert_array_equal(a.rms, b.rms)


def test_a_run_is_the_drive_with_that_seed() -> None:
    trial = monte_carlo("field", 1, ["observer"], duration=120.0, seed0=9, workers=1).trials["observer"][0]
    log, truth = lh.simulate("field", seed=9, duration=120.0)
    result = lh.estimate(log, "observer")
    error = result.gyro_bias - truth.gyro_bias
    late = log.time >= 60.0
    np.testing.assert_allclose(trial.rms[GYRO], np.sqrt(np.mean(error[late] ** 2, axis=0)), rtol=1e-12)
    assert trial.gyro_settles == settling_time(log.time, error[:, :2], float(np.radians(0.02)))
    assert trial.gyro_flagged == (lh.Status.GYRO_SETTLED in lh.Status(int(result.status[-1])))
    assert np.isnan(trial.rms[8])  # the observer does not estimate the vertical accelerometer


def test_an_honest_sigma_passes_and_one_half_as_large_is_caught(register: Register) -> None:
    register("honest", guess(1.0))
    register("liar", guess(0.5))
    runs = 60
    found = monte_carlo("field", runs, ["honest", "liar"], duration=40.0, sensors=STEADY, workers=1)
    honest, liar = found.figures("honest"), found.figures("liar")
    # Six biases in 60 drives, one error each: the coverage has a sigma of sqrt(0.95 0.05 / 360) = 1.1 %, the mean
    # squared error one of sqrt(2 / 360) = 7.5 %; three of them. A sigma of one half covers 67.3 %, and makes 4.
    assert honest.coverage[3:].mean() == pytest.approx(0.95, abs=0.034)
    assert honest.nees[3:].mean() == pytest.approx(1.0, abs=0.225)
    assert liar.coverage[3:].mean() == pytest.approx(0.673, abs=0.075)
    assert liar.nees[3:].mean() == pytest.approx(4.0, abs=0.9)
    # The band of 60 drives is 0.67 to 1.39: no single quantity of the liar's gets by.
    assert not liar.honest[3:].any()
    assert honest.honest[3:].sum() >= 4  # 95 % of six; three or fewer in one analysis of 500
    assert np.isnan(honest.coverage[:3]).all()  # this method gives no sigma of its attitude


def test_coverage_counts_looks_with_a_sigma_only() -> None:
    log, truth = lh.simulate("field", seed=1, duration=100.0)
    plain = lh.estimate(log, "observer")
    shape = plain.gyro_bias.shape
    std = np.full(shape, 1.0)
    std[:, 1] = np.nan
    std[log.time < 75.0, 0] = np.nan
    trial = judge(replace(plain, gyro_bias_std=std, accel_bias_std=np.zeros(shape)), truth, seed=1, after=50.0)
    # Looks at 50, 60, 70, 80, 90 s. A sigma of 0 is none: it would make every error infinite.
    assert trial.samples[GYRO].tolist() == [2, 0, 5]
    assert trial.covered[GYRO].tolist() == [2, 0, 5]
    assert trial.samples[ACCEL].tolist() == [0, 0, 0]


def test_figures_add_up_runs() -> None:
    def trial(seed: int, roll: float, settles: float | None) -> Trial:
        values = np.full(len(QUANTITIES), np.nan)
        values[0] = roll
        return Trial(seed=seed, rms=values, squared=values, gyro_settles=settles, gyro_flagged=settles is not None)

    found = MonteCarlo(
        scenario="field",
        runs=4,
        seed0=0,
        duration=600.0,
        after=300.0,
        imu_rate=100.0,
        gnss_rate=10.0,
        params={"m": {}},
        trials={"m": (trial(0, 3.0, 10.0), trial(1, 4.0, None), trial(2, 0.0, 30.0), Trial(seed=3, failure="No."))},
    )
    figures = found.figures("m")
    assert figures.rms[0] == pytest.approx(math.sqrt(25.0 / 3.0))
    assert figures.worst[0] == 4.0
    assert figures.nees[0] == pytest.approx(7.0 / 3.0)
    assert figures.nees_band[0].tolist() == list(chi_square_band(3))
    assert np.isnan(figures.worst[1])
    assert figures.gyro_settles.tolist() == [10.0, math.inf, 30.0]
    assert (figures.gyro_flagged, figures.accel_flagged) == (2, 0)
    content = json.loads(json.dumps(found.as_dict(), allow_nan=False))["methods"]["m"]
    assert content["settles_s"]["gyro"] == {"median": 30.0, "worst": None, "runs_that_never_did": 1}
    assert content["failed"] == {"3": "No."}
    assert content["errors"]["roll_deg"]["worst"] == pytest.approx(math.degrees(4.0))


def test_a_method_that_fails_is_counted_and_the_others_go_on(register: Register) -> None:
    register("stubborn", None)
    found = monte_carlo("field", 2, ["stubborn", "observer"], duration=30.0, workers=1)
    assert list(found.figures("stubborn").failures) == [0, 1]
    assert found.figures("observer").failures == {}
    assert np.isnan(found.figures("stubborn").rms).all()
    assert json.dumps(found.as_dict(), allow_nan=False)


@pytest.mark.parametrize(
    ("runs", "low", "high", "tolerance"),
    # Quantiles of chi-square at 2.5 and 97.5 %, from printed tables, divided by the degrees of freedom.
    [
        (1, 0.00098, 5.0239, 0.1),
        (2, 0.02532, 3.6889, 0.025),
        (5, 0.16624, 2.5665, 0.007),
        (10, 0.32470, 2.0483, 0.007),
        (100, 0.74222, 1.29561, 0.007),
    ],
)
def test_the_band_is_that_of_chi_square(runs: int, low: float, high: float, tolerance: float) -> None:
    assert chi_square_band(runs) == pytest.approx((low, high), abs=tolerance)
    assert all(math.isnan(edge) for edge in chi_square_band(0))


@dataclass(frozen=True, kw_only=True)
class NoisyParams(NoiseParams, MethodParams):
    """The constants of a filter."""


def test_filters_get_the_true_noise(register: Register) -> None:
    register("filter", guess(1.0), params=NoisyParams)
    sensors = lh.SensorModel(lever_arm=(1.0, 2.0, -3.0), mounting_yaw=math.pi / 2.0)
    noise = true_noise(sensors)
    # 0.1 m/s^2 of white vibration at 100 Hz, one-sided: 0.1 / sqrt(50).
    assert noise["accel_noise"] == pytest.approx(math.hypot(sensors.accel_noise, 0.1 / math.sqrt(50.0)))
    assert noise["velocity_std"] == sensors.velocity_noise
    params = true_params("filter", sensors)
    assert {name: getattr(params, name) for name in noise} == noise
    # The IMU's x axis points to the vehicle's right: two metres right are two metres ahead of it. Rounding.
    assert params.lever_arm == pytest.approx((2.0, -1.0, -3.0), abs=1e-12)
    defaults = true_params("filter", lh.SensorModel.perfect())
    assert defaults == NoisyParams()
    assert true_params("observer", lh.SensorModel()) == lh.ObserverParams()


@dataclass(frozen=True, kw_only=True)
class VehicleParams(MethodParams):
    """The constants of a filter that knows how land vehicles move."""

    sideslip_std: float = 0.02
    axle_std: float = 1.0


def test_filters_get_the_true_vehicle(register: Register) -> None:
    register("wheels", guess(1.0), params=VehicleParams)
    steady = true_params("wheels", lh.SensorModel(), "field")
    assert steady == true_params("wheels", lh.SensorModel()) == VehicleParams(sideslip_std=1e-6, axle_std=1e-6)
    sliding = true_params("wheels", lh.SensorModel(imu_from_axle=(-1.5, 0.4, 1.0)), "crab")
    assert sliding == VehicleParams(sideslip_std=math.radians(4.0), axle_std=1.5)


def test_parameters_can_be_given() -> None:
    params = {"observer": lh.ObserverParams(tau=9.0)}
    found = monte_carlo("field", 1, ["observer"], duration=30.0, params=params, workers=1)
    assert found.params["observer"]["tau"] == 9.0


def test_mistakes_are_sentences_before_anything_runs() -> None:
    def call(scenario: str = "field", runs: int = 2, workers: int = 2, after: float | None = None) -> None:
        monte_carlo(scenario, runs, ["observer"], duration=30.0, workers=workers, after=after)

    with pytest.raises(lh.UsageError, match="no scenario 'moon'"):
        call(scenario="moon")
    with pytest.raises(lh.UsageError, match="runs is 0; give a whole number from 1 up"):
        call(runs=0)
    with pytest.raises(lh.UsageError, match="workers is -1"):
        call(workers=-1)
    with pytest.raises(lh.UsageError, match=r"after 30\.0 s of a drive of 30\.0 s"):
        call(after=30.0)
    with pytest.raises(lh.UsageError, match="no method 'kalman'"):
        monte_carlo("field", 2, ["kalman"])


def test_progress_runs_to_the_end() -> None:
    seen: list[float] = []
    monte_carlo("field", 3, ["observer"], duration=30.0, workers=1, progress=seen.append)
    assert seen == [1 / 3, 2 / 3, 1.0]


def test_errors_of_the_heading_wrap() -> None:
    log, truth = lh.simulate("windrower", seed=1, duration=120.0)
    plain = lh.estimate(log, "observer")
    turned: FloatArray = plain.heading + 2.0 * np.pi
    trial = judge(replace(plain, heading=turned), truth, seed=1, after=60.0)
    assert math.degrees(trial.rms[2]) < 1.0  # the heading of this drive is good to 0.1 deg; a turn is 360
