"""`compare`: every method of the registry on one log, measured against each other and against the truth."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from itertools import count

import numpy as np
import pytest

import levelhead as lh
from levelhead.analysis.comparison import compare
from levelhead.conventions import FloatArray
from levelhead.estimators import METHODS
from levelhead.estimators.base import SensorData

Register = Callable[..., None]


@pytest.fixture(scope="module")
def drive() -> tuple[lh.Log, lh.Truth]:
    """Five minutes of curves."""
    return lh.simulate("windrower", seed=8, duration=300.0)


def tilted(result: lh.Result, _: SensorData) -> lh.Result:
    """Shift the roll by 0.5 deg and turn the heading round once."""
    return replace(result, roll=result.roll + np.radians(0.5), heading=result.heading + 2.0 * np.pi)


def with_sigma(gyro_x: float) -> Callable[[lh.Result, SensorData], lh.Result]:
    """Make a method that is sure of its biases to 3e-4 rad/s and knows gyro x and y only."""

    def change(result: lh.Result, _: SensorData) -> lh.Result:
        shape = result.gyro_bias.shape
        bias = np.broadcast_to([gyro_x, 0.0, 0.0], shape)
        std = np.full(shape, 3e-4)
        none = np.full(shape, np.nan)
        stds = {"gyro_bias_std": std, "accel_bias_std": none, "attitude_std": none}
        return replace(result, gyro_bias=bias, known_gyro=(True, True, False), **stds)

    return change


def test_every_method_of_the_registry_runs(drive: tuple[lh.Log, lh.Truth]) -> None:
    log, _ = drive
    comparison = compare(log)
    assert [entry.method for entry in comparison.entries] == list(METHODS)
    for name, result in comparison.results.items():
        np.testing.assert_array_equal(result.gyro_bias, lh.estimate(log, name).gyro_bias)
    content = json.loads(json.dumps(comparison.as_dict(), allow_nan=False))
    assert list(content["methods"]) == list(METHODS)
    summary = lh.estimate(log, "observer").summary()
    assert content["methods"]["observer"]["gyro_bias_deg_s"] == summary["gyro_bias_deg_s"]
    assert content["methods"]["observer"]["settled_at_s"] == summary["settled_at_s"]


def test_the_smoother_is_the_reference_where_it_runs(drive: tuple[lh.Log, lh.Truth], register: Register) -> None:
    register("smoother", tilted)
    assert compare(drive[0], ["observer", "smoother"]).reference == "smoother"
    assert compare(drive[0], ["two-stage", "observer"]).reference == "two-stage"
    assert compare(drive[0], ["observer", "smoother"], reference="observer").reference == "observer"
    register("smoother", None)
    assert compare(drive[0], ["observer", "smoother"]).reference == "observer"


def test_attitudes_differ_by_what_they_differ(drive: tuple[lh.Log, lh.Truth], register: Register) -> None:
    register("tilted", tilted)
    entry = compare(drive[0], ["observer", "tilted"])["tilted"]
    # The sum of two angles rounds in the 16th digit, a turn of 2 pi in the 15th.
    np.testing.assert_allclose(np.degrees(entry.attitude_difference), [0.5, 0.0, 0.0], atol=1e-12)


def test_differences_in_sigma_count_both_sigmas(drive: tuple[lh.Log, lh.Truth], register: Register) -> None:
    register("a", with_sigma(1e-3))
    register("b", with_sigma(2.5e-3))
    comparison = compare(drive[0], ["a", "b", "observer"])
    np.testing.assert_allclose(comparison["b"].gyro_in_sigma, [1.5e-3 / (3e-4 * np.sqrt(2.0)), 0.0, np.nan], rtol=1e-12)
    assert np.isnan(comparison["b"].attitude_in_sigma).all() == np.isnan(comparison.results["b"].attitude_std[-1]).all()
    # A sigma that is not given, and an axis that is not known, have no number.
    assert np.isnan(comparison["b"].accel_in_sigma).all()
    given = np.isfinite(comparison.results["observer"].gyro_bias_std[-1])
    assert np.isfinite(comparison["observer"].gyro_in_sigma).tolist() == [given[0], given[1], False]


def test_contradictions_on_the_way_count_though_the_ends_agree(
    drive: tuple[lh.Log, lh.Truth], register: Register
) -> None:
    """A filter and its smoother end alike; whether they fit each other shows before."""

    def sure(sign: float) -> Callable[[lh.Result, SensorData], lh.Result]:
        def change(result: lh.Result, _: SensorData) -> lh.Result:
            wave = np.sin(2.0 * np.pi * np.arange(result.time.size) / 1000.0)  # whole periods of 10 s after 120 s
            sigma = np.full(result.gyro_bias.shape, 1e-3)
            return replace(result, roll=result.roll + sign * 4e-3 * wave, attitude_std=sigma)

        return change

    register("a", sure(1.0))
    register("b", sure(-1.0))
    found = compare(drive[0], ["a", "b"])["b"].attitude_in_sigma
    # 8e-3 sin, RMS 8e-3 / sqrt(2), over sqrt(2) 1e-3. Rounding of the angles.
    np.testing.assert_allclose(found, [4.0, 0.0, 0.0], atol=1e-9)


def test_errors_are_those_against_the_truth(drive: tuple[lh.Log, lh.Truth]) -> None:
    log, truth = drive
    found = compare(log, ["observer"], truth=truth)["observer"].errors
    assert found is not None
    result = lh.estimate(log, "observer")
    late = log.time >= 120.0

    def root(error: FloatArray) -> float:
        return float(np.sqrt(np.mean(error[late] ** 2)))

    np.testing.assert_allclose(found.attitude[1], root(result.pitch - truth.pitch), rtol=1e-9)
    np.testing.assert_allclose(found.gyro_bias[0], root(result.gyro_bias[:, 0] - truth.gyro_bias[:, 0]), rtol=1e-12)
    assert np.isnan(found.accel_bias[2])
    # Half a degree would be an error of 360 deg taken for one; the heading of this drive is good to 0.1 deg.
    assert np.degrees(found.attitude[2]) < 0.5


def test_one_that_fails_is_shown_and_the_others_go_on(drive: tuple[lh.Log, lh.Truth], register: Register) -> None:
    register("stubborn", None)
    comparison = compare(drive[0], ["stubborn", "observer"])
    assert comparison["stubborn"].failure == "This method refuses every log; try another."
    assert list(comparison.results) == ["observer"]
    assert comparison.reference == "observer"
    content = json.loads(json.dumps(comparison.as_dict(), allow_nan=False))
    assert content["methods"]["stubborn"] == {"failed": comparison["stubborn"].failure}
    with pytest.raises(lh.LogError, match="refuses every log"):
        compare(drive[0], ["stubborn"])


def test_run_times_are_in_multiples_of_the_observers(drive: tuple[lh.Log, lh.Truth]) -> None:
    # Calls of the clock: 0, 2 (observer: 2 s), 3, 9 (two-stage: 6 s).
    ticks = iter([0.0, 2.0, 3.0, 9.0])
    comparison = compare(drive[0], ["observer", "two-stage"], clock=lambda: next(ticks))
    assert [entry.runtime_ratio for entry in comparison.entries] == [1.0, 3.0]
    steps = count()
    alone = compare(drive[0], ["two-stage"], clock=lambda: float(next(steps)))
    assert alone["two-stage"].runtime_s == 1.0
    assert alone["two-stage"].runtime_ratio is None


def test_parameters_are_given_by_method(drive: tuple[lh.Log, lh.Truth]) -> None:
    params = {"observer": lh.ObserverParams(tau=6.0)}
    comparison = compare(drive[0], ["observer", "two-stage"], params=params, lever_arm=(1.0, 0.0, -2.0))
    assert comparison.results["observer"].params["tau"] == 6.0
    assert comparison.results["two-stage"].params["lever_arm"] == (1.0, 0.0, -2.0)


def test_a_short_log_counts_from_its_middle(drive: tuple[lh.Log, lh.Truth]) -> None:
    comparison = compare(drive[0].slice(0.0, 60.0), ["observer", "two-stage"])
    assert comparison.after_s == pytest.approx(30.0, abs=0.01)  # one sample
    assert np.isfinite(comparison["two-stage"].attitude_difference).all()


def test_mistakes_are_sentences(drive: tuple[lh.Log, lh.Truth]) -> None:
    log, truth = drive
    with pytest.raises(lh.UsageError, match="no method 'kalman'; choose from observer"):
        compare(log, ["observer", "kalman"])
    with pytest.raises(lh.UsageError, match="each once"):
        compare(log, ["observer", "observer"])
    with pytest.raises(lh.UsageError, match="each once"):
        compare(log, [])
    with pytest.raises(lh.UsageError, match="reference 'two-stage' is not among"):
        compare(log, ["observer"], reference="two-stage")
    with pytest.raises(lh.UsageError, match="parameters for two-stage"):
        compare(log, ["observer"], params={"two-stage": lh.TwoStageParams()})
    with pytest.raises(lh.UsageError, match="the truth of this very log"):
        compare(log.slice(0.0, 100.0), ["observer"], truth=truth)


def test_progress_runs_to_the_end(drive: tuple[lh.Log, lh.Truth]) -> None:
    seen: list[float] = []
    compare(drive[0], ["observer", "two-stage"], progress=seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
