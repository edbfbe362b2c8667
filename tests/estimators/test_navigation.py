"""Position, velocity and the reference point, through outages: against the 15-state Kalman filter, truth and sigma."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import levelhead as lh
from levelhead.analysis.montecarlo import true_params
from levelhead.conventions import GRAVITY, FloatArray
from levelhead.earth import offset_ned
from levelhead.errors import UsageError
from levelhead.estimators.params import FilterParams
from levelhead.sim import SensorModel, outage_windows, without_gnss

ROOF = SensorModel(lever_arm=(0.3, 0.1, -1.5))


def constants(method: str, sensors: SensorModel, **changes: object) -> FilterParams:
    """The true noise, and the lever arm."""
    params = true_params(method, sensors)
    assert isinstance(params, FilterParams)
    values: dict[str, Any] = {"lever_arm": sensors.lever_arm, **changes}
    return replace(params, **values)


def off_ned(estimate_llh: FloatArray | None, truth_llh: FloatArray) -> FloatArray:
    """How far places (n, 3) are from the truth, North, East, Down, m."""
    assert estimate_llh is not None
    return offset_ned(truth_llh, estimate_llh)


def rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def position_sigma(result: lh.Result) -> FloatArray:
    assert result.position_std is not None
    return result.position_std


@pytest.fixture(scope="module")
def drive() -> tuple[lh.Log, lh.Truth]:
    return lh.simulate("windrower", seed=3, duration=400.0, sensors=ROOF)


@pytest.fixture(scope="module")
def holed() -> tuple[lh.Log, lh.Truth, lh.Log, list[tuple[int, int]]]:
    """A field and its headlands at 5 m/s, GNSS away for 20 s seven times; rows of the samples within."""
    log, truth = lh.simulate("field", seed=2, duration=700.0, sensors=ROOF, speed=5.0)
    windows = outage_windows(250.0, 690.0, 20.0, count=7)
    rows = [tuple(int(i) for i in np.searchsorted(log.time, [w.start, w.start + w.length])) for w in windows]
    return log, truth, without_gnss(log, windows), [(first, last) for first, last in rows]


def test_it_is_the_kalman_filter_with_positions_too(drive: tuple[lh.Log, lh.Truth]) -> None:
    # The 15-state filter shares no line of the error model with the phasor filter. Same noise, same fixes: both are the
    # Kalman filter of the same problem, so that they differ by what either neglects, a fraction of a sigma.
    log, _ = drive
    ours, theirs = (lh.estimate(log, m, params=constants(m, ROOF)) for m in ("phasor", "ekf"))
    late = log.time > 60.0
    apart = off_ned(ours.position_llh, np.asarray(theirs.position_llh))[late]
    assert rms(apart / position_sigma(theirs)[late]) < 0.15
    assert rms((ours.velocity_ned - theirs.velocity_ned)[late] / theirs.velocity_std[late]) < 0.15
    # Sigma too, at the epochs: in between the textbook's grows with every sample, ours is that of the last epoch.
    epochs = np.flatnonzero(late)[::10]
    np.testing.assert_allclose(position_sigma(ours)[epochs], position_sigma(theirs)[epochs], rtol=0.05)
    np.testing.assert_allclose(ours.velocity_std[epochs], theirs.velocity_std[epochs], rtol=0.05)


@pytest.mark.parametrize("method", ["phasor", "smoother"])
def test_sigma_is_honest(drive: tuple[lh.Log, lh.Truth], method: str) -> None:
    log, truth = drive
    result = lh.estimate(log, method, params=constants(method, ROOF))
    late = log.time > 30.0
    for errors, sigma in (
        (off_ned(result.position_llh, truth.position_llh), position_sigma(result)),
        (result.velocity_ned - truth.velocity_ned, result.velocity_std),
    ):
        # Errors last for some seconds, so 370 s hold a hundred independent ones: 1 +- 0.07, three times that.
        assert 0.8 < rms((errors / sigma)[late]) < 1.2


def worst(result: lh.Result, truth: lh.Truth, rows: list[tuple[int, int]], at_end: bool) -> tuple[float, float]:
    """RMS over windows of the horizontal error at its worst, and of it over sigma per axis."""
    off, sigma = off_ned(result.position_llh, truth.position_llh)[:, :2], position_sigma(result)[:, :2]
    picked = [last - 1 if at_end else first + int(np.argmax(np.hypot(*off[first:last].T))) for first, last in rows]
    return rms(np.hypot(*off[picked].T)), rms(off[picked] / sigma[picked])


def test_outages_drift_as_the_kalman_filter_s_and_less_with_what_is_known_of_the_vehicle(
    holed: tuple[lh.Log, lh.Truth, lh.Log, list[tuple[int, int]]],
) -> None:
    _, truth, log, rows = holed
    ekf, _ = worst(lh.estimate(log, "ekf", params=constants("ekf", ROOF)), truth, rows, True)
    free = lh.estimate(log, "phasor", params=constants("phasor", ROOF))
    axle = lh.estimate(log, "phasor", params=constants("phasor", ROOF, rear_axle=(0.0, 0.0, 0.0)))
    smooth = lh.estimate(log, "smoother", params=constants("smoother", ROOF))
    assert ekf > 0.5  # something drifts at all
    figures = {
        name: worst(r, truth, rows, end)
        for name, r, end in (("free", free, True), ("axle", axle, True), ("smooth", smooth, False))
    }
    # The 1.1 and 0.3; on straights the axle says nothing of the way ahead, one of two directions: 0.71.
    assert figures["free"][0] < 1.1 * ekf
    assert figures["axle"][0] < 0.8 * ekf
    assert figures["smooth"][0] < 0.3 * ekf
    # Seven windows, two axes: RMS of fourteen normal numbers, 0.4 to 1.6 with three sigma of chance.
    assert all(0.4 < ratio < 1.6 for _, ratio in figures.values()), figures
    # The vertical, too, once the axle keeps to the ground.
    down = [off_ned(r.position_llh, truth.position_llh)[[last - 1 for _, last in rows], 2] for r in (free, axle)]
    assert rms(down[1]) < 0.3 * rms(down[0])
    # Without a fix it says so, and its sigma grows.
    first, last = rows[0]
    assert (free.status[last - 1] & lh.Status.COASTING) != 0
    assert position_sigma(free)[last - 1, 0] > 5.0 * position_sigma(free)[first - 1, 0]


def test_the_smoother_has_no_step_where_gnss_comes_back(
    holed: tuple[lh.Log, lh.Truth, lh.Log, list[tuple[int, int]]],
) -> None:
    _, truth, log, rows = holed
    result = lh.estimate(log, "smoother", params=constants("smoother", ROOF))
    off = off_ned(result.position_llh, truth.position_llh)
    # The error moves on by velocity errors of centimetres per second: a tenth of a millimetre per sample, not in steps.
    for _, last in rows:
        assert np.abs(np.diff(off[last - 200 : last + 200], axis=0)).max() < 2e-3


def test_wheels_tell_the_way_ahead_and_their_radius_is_learnt() -> None:
    sensors = SensorModel(wheel_speed=True, wheel_speed_noise=0.05, wheel_speed_scale=0.02)
    log, truth = lh.simulate("field", seed=4, duration=420.0, sensors=sensors, speed=5.0)
    log = without_gnss(log, outage_windows(300.0, 400.0, 60.0, count=1))
    with_axle = constants("phasor", sensors, rear_axle=(0.0, 0.0, 0.0))
    end = int(np.searchsorted(log.time, 359.9))
    off = {
        wheels: off_ned(
            lh.estimate(log if wheels else replace(log, wheel_speed=None), "phasor", params=with_axle).position_llh,
            truth.position_llh,
        )[end]
        for wheels in (True, False)
    }
    # 300 m of driving at 2 % more would be 6 m: the scale is learnt before. Without wheels it drifts by metres.
    assert math.hypot(*off[True][:2]) < 1.5
    assert math.hypot(*off[True][:2]) < 0.5 * math.hypot(*off[False][:2])


def test_the_reference_point_is_known_to_millimetres_where_the_antenna_is_off_by_decimetres() -> None:
    log, truth = lh.simulate("hill", seed=1, duration=500.0)
    point = (0.0, 0.0, 3.0)
    ratio = {}
    for method in ("phasor", "ekf"):
        result = lh.estimate(log, method, params=constants(method, SensorModel()), reference_point=point)
        found, late, true = result.reference, log.time > 300.0, truth.at(point)
        assert found is not None
        assert found.position_std is not None
        off = off_ned(found.position_llh, true.position_llh)[late]
        side = off[:, 1] * np.cos(truth.heading[late]) - off[:, 0] * np.sin(truth.heading[late])
        ratio[method] = rms(side)
        assert rms(side) < 0.015
        assert 0.7 < rms(off / found.position_std[late]) < 1.3
        # Velocity of the point: the swing of 3 m at the gyros' noise of 1.2 mrad/s per sample, 4 mm/s, on top of 9.
        assert rms((found.velocity_ned - true.velocity_ned)[late]) < 0.02
    assert ratio["phasor"] < 1.05 * ratio["ekf"]
    assert found is not None
    # What the slope does to 3 m: 3 sin(roll) to the right, up by what a tilted mast is shorter.
    np.testing.assert_allclose(found.cross_track[late], -3.0 * np.sin(result.roll[late]), atol=1e-12)
    assert rms(found.cross_track[late]) > 0.1
    assert found.height[late].min() > 0.0


def test_positions_alone_give_velocity_heading_and_biases(drive: tuple[lh.Log, lh.Truth]) -> None:
    log, truth = drive
    alone = replace(log, velocity_ned=None, velocity_std=None)
    result = lh.estimate(alone, "phasor", params=constants("phasor", ROOF))
    assert "I_VELOCITY_DERIVED" not in {e.code for e in result.events}  # through the filter, not by differences
    late = log.time > 200.0
    assert rms(result.velocity_ned[late] - truth.velocity_ned[late]) < 0.02  # differences of 2 cm at 10 Hz: 0.28 m/s
    assert rms((off_ned(result.position_llh, truth.position_llh) / position_sigma(result))[late]) < 1.3
    turn = (result.heading - truth.heading + np.pi) % (2.0 * np.pi) - np.pi
    assert np.degrees(rms(turn[late])) < 0.5
    gyro = (result.gyro_bias - truth.gyro_bias)[-1]
    assert (np.abs(gyro) < 4.0 * result.gyro_bias_std[-1]).all()
    assert result.known_accel[:2] == (True, True)


def tactical_at_60() -> tuple[lh.Log, lh.Truth]:
    sensors = SensorModel(
        imu_rate=50.0,
        gyro_noise=math.radians(0.002),
        accel_noise=50e-6 * GRAVITY,
        vibration=0.0,
        gyro_bias=(math.radians(0.01), math.radians(-0.02), math.radians(0.015)),
        accel_bias=(0.02, -0.03, 0.01),
        gyro_bias_walk=2e-8,
        accel_bias_walk=2e-6,
    )
    origin = (math.radians(60.0), math.radians(10.0), 60.0)
    return lh.simulate(
        "field", seed=1, duration=2400.0, standstill_s=600.0, sensors=sensors, earth_rotation=True, origin_llh=origin
    )


def test_a_tactical_gyro_bias_is_free_of_the_earth_at_rest_and_after_the_drive() -> None:
    log, truth = tactical_at_60()
    per_hour = np.degrees(1.0) * 3600.0
    smooth = lh.estimate(log, "smoother", grade="tactical")
    still = int(np.searchsorted(log.time, 599.0))
    for row in (still, -1):
        assert np.abs((smooth.gyro_bias[row] - truth.gyro_bias[row]) * per_hour).max() < 0.6  # of 15: 0.5 and noise
    # Before anything has told North, the Earth's rate hides in the level biases, and sigma says so.
    live = lh.estimate(log, "phasor", grade="tactical")
    off = (live.gyro_bias - truth.gyro_bias)[still] * per_hour
    assert np.abs(off[:2]).max() > 2.0
    assert (np.abs(off) < 3.0 * live.gyro_bias_std[still] * per_hour).all()
    # With the first course it is told apart at once.
    moving = int(np.searchsorted(log.time, 615.0))
    assert np.abs((live.gyro_bias - truth.gyro_bias)[moving, :2] * per_hour).max() < 2.0
    # Told the heading, the standstill alone will do.
    start = lh.Initial(heading=float(truth.heading[0]), heading_std=math.radians(0.5))
    told = lh.estimate(log.slice(0.0, 600.0), "phasor", grade="tactical", initial=start)
    assert np.abs((told.gyro_bias[-1] - truth.gyro_bias[still]) * per_hour).max() < 1.2  # three of its sigmas


def test_standstill_is_found_and_teaches_the_gyros() -> None:
    log, truth = lh.simulate("field", seed=5, duration=150.0, standstill_s=60.0)
    result = lh.estimate(log, "phasor")
    rest = (result.status & lh.Status.STATIONARY) != 0
    assert rest[(log.time > 5.0) & (log.time < 58.0)].mean() > 0.95
    assert not rest[log.time > 66.0].any()
    assert {e.code for e in result.events} >= {"S_STATIONARY"}
    row = int(np.searchsorted(log.time, 58.0))
    # 55 s of gyro noise of 0.01 deg/s/sqrt(Hz): 0.001 deg/s; sigma says so, and blind it knows nothing of z.
    assert np.degrees(np.abs(result.gyro_bias[row] - truth.gyro_bias[row])).max() < 0.004
    blind = lh.estimate(log, "phasor", params=lh.PhasorParams(find_standstill=False))
    assert result.gyro_bias_std[row, 2] < 0.01 * blind.gyro_bias_std[row, 2]


def test_at_rest_the_gyros_are_as_sure_as_they_are_right_from_the_first_seconds() -> None:
    # Large biases that nobody knew: one correction of a window changes the bias that its next is measured against.
    # Counted twice, they were eight sigmas off here after the first seconds.
    rng, ratios = np.random.default_rng(1), []
    for seed in range(20):
        bias = tuple(float(b) for b in rng.normal(0.0, math.radians(0.5), 3))
        sensors = SensorModel(gyro_bias=(bias[0], bias[1], bias[2]))
        log, truth = lh.simulate("field", seed=seed, duration=16.0, standstill_s=16.0, sensors=sensors)
        params = constants("phasor", sensors, use_positions=False)
        result = lh.estimate(log, "phasor", params=params)
        rows = np.searchsorted(log.time, [2.5, 4.5, 8.0, 15.0])
        ratios.append((result.gyro_bias[rows] - truth.gyro_bias[rows]) / result.gyro_bias_std[rows])
    # Twenty drives, three axes: RMS of sixty normal numbers per time, 1 +- 0.09; three times that, and what correlates.
    spread = np.sqrt(np.mean(np.square(ratios), axis=(0, 2)))
    assert spread.max() < 1.4, spread
    assert spread.min() > 0.7, spread


def test_creeping_is_no_standstill() -> None:
    # faults.md: a vehicle at 0.3 m/s moves. At 10 Hz and 0.03 m/s the mean of a second shows a tenth of that.
    log, _ = lh.simulate("straight", seed=1, duration=120.0, speed=0.3)
    result = lh.estimate(log, "phasor")
    assert ((result.status & lh.Status.STATIONARY) == 0).all()


def test_the_source_of_the_heading_is_told() -> None:
    log, _ = lh.simulate("reverse", seed=1, duration=300.0, standstill_s=20.0)
    source = lh.estimate(log, "phasor").heading_source
    assert {int(s) for s in source} >= {lh.HeadingSource.NONE, lh.HeadingSource.COURSE, lh.HeadingSource.REVERSE}
    assert source[0] == lh.HeadingSource.NONE


def test_a_crabbing_tractor_keeps_its_heading_within_sigma_when_told() -> None:
    sensors = SensorModel()
    log, truth = lh.simulate("crab", seed=1, duration=900.0, sensors=sensors)
    told = constants("phasor", sensors, sideslip_std=math.radians(4.0))
    result = lh.estimate(log, "phasor", params=told)
    late = log.time > 300.0
    turn = (result.heading - truth.heading + np.pi) % (2.0 * np.pi) - np.pi
    # Four degrees of crab are in every course; the accelerations of the turns hold against them.
    assert np.degrees(rms(turn[late])) < 0.7
    # Ten minutes of passes hold some seven changes of side: 1 +- 0.27, and the crab is two values, not a normal number.
    assert rms(turn[late] / result.attitude_std[late, 2]) < 1.6


@pytest.mark.parametrize("method", ["phasor", "smoother", "ekf"])
def test_epochs_may_hold_a_velocity_or_a_position_in_turn(method: str, drive: tuple[lh.Log, lh.Truth]) -> None:
    log, truth = drive
    assert log.velocity_ned is not None
    assert log.position_llh is not None
    velocity, position = log.velocity_ned.copy(), log.position_llh.copy()
    velocity[::2], position[1::2] = np.nan, np.nan
    mixed = replace(log, velocity_ned=velocity, position_llh=position)
    result = lh.estimate(mixed, method, params=constants(method, ROOF))
    late = log.time > 100.0
    # As in test_sigma_is_honest, with half of the fixes.
    assert 0.8 < rms((off_ned(result.position_llh, truth.position_llh) / position_sigma(result))[late]) < 1.25
    assert 0.8 < rms(((result.velocity_ned - truth.velocity_ned) / result.velocity_std)[late]) < 1.25


def test_each_fix_counts_as_its_own_sigma_says(drive: tuple[lh.Log, lh.Truth]) -> None:
    # Every other fix is off by a metre and says so: it must hardly be felt.
    log, truth = drive
    assert log.position_llh is not None
    worse = log.position_llh.copy()
    worse[::2, 0] += 1.0 / 6.37e6
    std = np.where(np.arange(log.gnss_time.size) % 2 == 0, 1.0, 0.02)
    told = lh.estimate(replace(log, position_llh=worse, position_std=std), "phasor", params=constants("phasor", ROOF))
    late = log.time > 100.0
    assert rms(off_ned(told.position_llh, truth.position_llh)[late]) < 0.02


def test_an_axle_that_reverses_is_no_turn_of_the_vehicle() -> None:
    log, truth = lh.simulate("reverse", seed=1, duration=500.0)
    params = constants("phasor", SensorModel(), rear_axle=(0.0, 0.0, 0.0))
    result = lh.estimate(log, "phasor", params=params)
    late = log.time > 200.0  # after the first turn, before which tilt and accelerometer bias are one; two spells follow
    turn = (result.heading - truth.heading + np.pi) % (2.0 * np.pi) - np.pi
    # faults.md: 20 s in every 120 s backwards cost less than 0.3 deg of tilt, 0.01 deg/s; here of heading as well.
    assert np.degrees(np.abs(turn[late]).max()) < 0.3
    assert np.degrees(np.abs(result.roll - truth.roll)[late].max()) < 0.3
    assert np.degrees(np.abs(result.gyro_bias - truth.gyro_bias)[-1]).max() < 0.01


def test_a_position_jump_is_followed_after_ten_seconds(drive: tuple[lh.Log, lh.Truth]) -> None:
    log, _ = drive
    assert log.position_llh is not None
    llh = log.position_llh.copy()
    llh[log.gnss_time > 200.0, 0] += 50.0 / 6.37e6
    result = lh.estimate(replace(log, position_llh=llh), "phasor", params=constants("phasor", ROOF))
    assert {e.code: e.count for e in result.events}["W_POSITION_JUMP"] == 1
    assert result.position_llh is not None
    at = result.position_llh[np.searchsorted(log.time, [195.0, 205.0, 215.0]), 0] * 6.37e6
    steady = log.position_llh[np.searchsorted(log.gnss_time, [195.0, 205.0, 215.0]), 0] * 6.37e6
    moved = at - steady
    assert abs(moved[0]) < 3.0  # the arm, and the fix's own noise
    assert abs(moved[1]) < 10.0  # not yet believed
    assert moved[2] == pytest.approx(50.0, abs=3.0)


def test_live_is_batch_with_positions_and_wheels_and_goes_on_after_a_restore(drive: tuple[lh.Log, lh.Truth]) -> None:
    log = drive[0].slice(0.0, 30.0)
    params = lh.PhasorParams(lever_arm=ROOF.lever_arm, rear_axle=(-1.0, 0.0, 0.5))
    assert log.velocity_ned is not None
    assert log.position_llh is not None
    batch = lh.estimate(log, "phasor", params=params)
    est, epochs = (
        lh.Phasor(replace(params, earth_rotation=False)),
        dict(zip(np.round(log.gnss_time * 100), range(999), strict=False)),
    )
    for i, t in enumerate(log.time):
        est.update_imu(t, log.gyro[i], log.accel[i])
        j = epochs.get(round(t * 100))
        if j is not None:
            est.update_gnss(t, log.velocity_ned[j], 0.03, log.position_llh[j], 0.02)
        if i == 1500:
            est = lh.Phasor.restore(est.save())
    assert batch.position_llh is not None
    np.testing.assert_array_equal(est.position_llh, batch.position_llh[-1])
    np.testing.assert_array_equal(est.velocity_ned, batch.velocity_ned[-1])
    assert est.update_wheel(3.0)
    assert not est.update_wheel(math.nan)


@pytest.mark.parametrize(
    ("ask", "sentence"),
    [
        (lambda log: lh.estimate(log, reference_point=(0.0, 0.0, 51.0)), "reference_point .* within 50 m"),
        (lambda log: lh.estimate(log, lever_arm=(60.0, 0.0, 0.0)), "lever_arm .* within 50 m"),
        (lambda log: lh.estimate(log, rear_axle=(0.0, -70.0, 0.0)), "rear_axle .* within 50 m"),
        (lambda log: lh.estimate(log, "observer", rear_axle=(0.0, 0.0, 0.0)), "knows no rear axle"),
        (lambda log: lh.estimate(log, "observer", reference_point=(0.0, 0.0, 1.0)), "estimates no position"),
        (lambda log: lh.estimate(log, grade="military"), "no grade 'military'"),
        (lambda log: lh.estimate(log, grade="tactical", params=lh.PhasorParams()), "grade or params, not both"),
    ],
)
def test_bad_input_is_a_sentence(
    ask: Callable[[lh.Log], object], sentence: str, drive: tuple[lh.Log, lh.Truth]
) -> None:
    with pytest.raises(UsageError, match=sentence):
        ask(drive[0].slice(0.0, 40.0))
