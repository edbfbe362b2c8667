"""`simulate` as a user meets it: seeds, chunks, columns, and sentences for mistakes."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from levelhead.errors import UsageError
from levelhead.sim import ORIGIN_LLH, SCENARIOS, SensorModel, simulate


def test_a_log_comes_with_its_truth() -> None:
    log, truth = simulate("field", seed=7, duration=30.0)
    assert log.time.size == 3000
    assert log.gnss_time.size == 300
    assert (log.time[0], log.time[-1], log.gnss_time[-1]) == (0.0, 29.99, 29.9)
    assert log.meta["source"] == "simulated:field seed 7"
    assert log.meta["format"] == "simulation"
    assert log.meta["completeness"] == "complete"
    assert log.velocity_std is not None
    assert log.velocity_std.shape == (300,)
    assert np.all(log.velocity_std == 0.03)
    np.testing.assert_array_equal(truth.time, log.time)
    np.testing.assert_allclose(truth.position_llh[0], ORIGIN_LLH, rtol=1e-15)  # rounding


def test_the_heading_is_wrapped() -> None:
    _, truth = simulate("circle", duration=72.0, sensors=SensorModel.perfect())
    assert np.all((truth.heading > -math.pi) & (truth.heading <= math.pi))
    assert np.ptp(truth.heading) > 6.2  # two full circles
    # Unwrapped it turns by 10 deg/s; rounding.
    np.testing.assert_allclose(np.diff(np.unwrap(truth.heading)), math.radians(0.1), atol=1e-13)


def test_the_columns_are_flat_and_named_as_in_a_result() -> None:
    _, truth = simulate("field", duration=2.0)
    columns = truth.columns()
    assert list(columns)[:10] == [
        "time",
        *(f"gyro_bias_{a}" for a in "xyz"),
        *(f"accel_bias_{a}" for a in "xyz"),
        *("roll", "pitch", "heading"),
    ]
    assert {"velocity_n", "velocity_e", "velocity_d", "latitude", "longitude", "height"} < set(columns)
    assert {column.shape for column in columns.values()} == {(200,)}
    np.testing.assert_array_equal(columns["velocity_e"], truth.velocity_ned[:, 1])
    np.testing.assert_array_equal(columns["height"], truth.position_llh[:, 2])
    np.testing.assert_array_equal(columns["specific_force_z"], truth.specific_force[:, 2])


@pytest.mark.parametrize("name", list(SCENARIOS))
def test_a_seed_gives_the_same_run_again_and_another_seed_another(name: str) -> None:
    (log, truth), (again, _), (other, other_truth) = (simulate(name, seed=s, duration=20.0) for s in (1, 1, 2))
    for a, b in ((log.gyro, again.gyro), (log.accel, again.accel)):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(np.asarray(log.velocity_ned), np.asarray(again.velocity_ned))
    np.testing.assert_array_equal(np.asarray(log.position_llh), np.asarray(again.position_llh))
    assert not np.any(log.gyro == other.gyro)
    assert truth.heading[0] != other_truth.heading[0]


@pytest.mark.parametrize("name", list(SCENARIOS))
def test_a_chunk_is_a_part_of_the_long_run(name: str) -> None:
    sensors = replace(SensorModel.perfect(), gnss_latency=0.13, band_vibration=0.3)
    sensors = replace(sensors, gyro_bias_walk=1e-5, accel_bias_walk=1e-3, imu_from_axle=(1.5, 0.4, -1.0))
    whole, whole_truth = simulate(name, seed=2, duration=700.0, sensors=sensors)
    chunk, truth = simulate(name, seed=2, start=600.0, duration=60.0, sensors=sensors)
    part, epochs = slice(60_000, 66_000), slice(6_000, 6_600)
    np.testing.assert_array_equal(chunk.time, whole.time[part])
    np.testing.assert_array_equal(chunk.gnss_time, whole.gnss_time[epochs])
    # The same formulas at the same times; sums over more terms may round differently.
    np.testing.assert_allclose(chunk.gyro, whole.gyro[part], atol=1e-12)
    np.testing.assert_allclose(chunk.accel, whole.accel[part], atol=1e-11)
    np.testing.assert_allclose(np.asarray(chunk.velocity_ned), np.asarray(whole.velocity_ned)[epochs], atol=1e-11)
    # 1e-14 rad is 64 nm; the height's own rounding is smaller.
    np.testing.assert_allclose(np.asarray(chunk.position_llh), np.asarray(whole.position_llh)[epochs], atol=1e-10)
    for key, column in truth.columns().items():
        np.testing.assert_allclose(column, whole_truth.columns()[key][part], atol=1e-10, err_msg=key)


def test_chunks_follow_each_other_without_gap_or_overlap() -> None:
    sensors = replace(SensorModel.perfect(), imu_rate=30.0, gnss_rate=7.0)
    first, _ = simulate("field", duration=0.7, start=0.1, sensors=sensors)
    second, _ = simulate("field", duration=0.9, start=0.8, sensors=sensors)
    # An interval of 1/30 s and 1/7 s to rounding.
    assert second.time[0] - first.time[-1] == pytest.approx(1 / 30, abs=1e-12)
    assert second.gnss_time[0] - first.gnss_time[-1] == pytest.approx(1 / 7, abs=1e-12)


def test_a_boundary_on_a_sample_is_not_lost_to_rounding() -> None:
    sensors = SensorModel.perfect(gnss_rate=100.0)
    assert 0.07 * 100.0 > 7.0  # in floating point
    first, _ = simulate("field", duration=0.07, sensors=sensors)
    second, _ = simulate("field", start=0.07, duration=0.07, sensors=sensors)
    assert (first.time[-1], second.time[0]) == (0.06, 0.07)
    assert (first.gnss_time[-1], second.gnss_time[0]) == (0.06, 0.07)


def test_noise_is_drawn_anew_in_every_chunk() -> None:
    sensors = replace(SensorModel.perfect(), gyro_noise=1e-3)
    (a, a_truth), (b, b_truth) = (simulate("circle", start=s, duration=10.0, sensors=sensors) for s in (0.0, 10.0))
    assert not np.any(a.gyro - a_truth.angular_rate == b.gyro - b_truth.angular_rate)


def test_the_origin_can_be_chosen() -> None:
    origin = (math.radians(-33.0), math.radians(150.0), 200.0)
    log, truth = simulate("field", duration=10.0, origin_llh=origin, sensors=SensorModel.perfect())
    assert log.position_llh is not None
    np.testing.assert_allclose(log.position_llh[0], origin, rtol=1e-15)  # rounding
    assert truth.position_llh[-1] == pytest.approx(origin, abs=5.0)


def test_an_unknown_scenario_is_answered_with_the_known_ones() -> None:
    with pytest.raises(UsageError, match=r"no scenario 'feild'; choose one of field, windrower, .*straight"):
        simulate("feild")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"duration": 0.0}, "duration is 0.0 s"),
        ({"duration": -5.0}, "duration is -5.0 s"),
        ({"duration": math.nan}, "duration is nan s"),
        ({"duration": math.inf}, "duration is inf s"),
        ({"duration": 0.05}, "at least two samples and one epoch"),
        ({"duration": 1e9}, "go on with start="),
        ({"start": -1.0}, "start is -1.0 s"),
        ({"standstill_s": math.nan}, "standstill_s is nan s"),
        ({"seed": -1}, "seed is -1"),
        ({"seed": 1.5}, "seed is 1.5"),
        ({"seed": True}, "seed is True"),
        ({"speed": 0.0}, "speed is 0.0 m/s; give a number from 0.1 to 60"),
        ({"speed": 61.0}, "speed is 61.0 m/s"),
        ({"speed": math.nan}, "speed is nan m/s"),
        ({"origin_llh": (math.radians(90.0), 0.0, 0.0)}, "below 89 deg"),
        ({"origin_llh": (45.0, 0.0, 0.0)}, "below 89 deg"),
    ],
)
def test_bad_arguments_are_refused(arguments: dict[str, Any], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        simulate("field", **arguments)
