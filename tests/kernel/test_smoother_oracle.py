"""The smoother against two others that share nothing with it but the model, and the promises it makes to its users.

The kernel runs modified Bryson-Frazier recursions on four complex numbers and two pairs, without inverses. The oracles
are Rauch, Tung and Striebel's smoother on the ten joint real errors, and one dense least-squares problem for a drive.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import levelhead as lh
from levelhead.conventions import FloatArray
from levelhead.estimators.phasor import PhasorParams
from levelhead.estimators.streaming import Trace, imu_arrays, run, std_rows
from levelhead.kernel._kernel import SmootherF64
from levelhead.kernel.reference import euler_of
from levelhead.kernel.reference_phasor import reference_phasor, run_reference_phasor
from levelhead.kernel.reference_smoother import Record, Smoothed, corrected, smooth_reference
from levelhead.logs.log import Log
from levelhead.sim import SensorModel, Truth, simulate

QUICK = SensorModel(imu_rate=50.0, gnss_rate=5.0)
PARAMS = PhasorParams(
    accel_noise=math.sqrt(QUICK.accel_noise**2 + 2.0 * QUICK.vibration**2 / QUICK.imu_rate),
    use_positions=False,
    find_standstill=False,
)


def forward(log: Log) -> Trace:
    return run(lh.Phasor(PARAMS), log, with_sigma=True)


def smoothed_once(log: Log) -> Trace:
    """One pass of the compiled smoother (`estimate` makes two)."""
    smoother = SmootherF64(lh.Phasor(PARAMS))
    t = run(smoother, log, with_sigma=True)
    smoother.retrace(imu_arrays(log), t.arrays())
    return t


def reference_records(log: Log) -> list[Record]:
    """Run the NumPy filter and return what it did at each epoch."""
    assert log.velocity_ned is not None
    twin = reference_phasor(PARAMS.kernel_arguments())
    std = std_rows(log.velocity_std, log.gnss_time.size)
    run_reference_phasor(twin, log.time, log.gyro, log.accel, log.gnss_time, log.velocity_ned, std)
    assert [r.fresh for r in twin.records] == [True] + [False] * (len(twin.records) - 1)
    return twin.records


def compare(log: Log, ours: Trace, theirs: list[Smoothed], *, within: float) -> None:
    """Hold the compiled smoother's states at the epochs to an oracle's, in parts of sigma."""
    rows = np.searchsorted(log.time, [s.time for s in theirs])
    np.testing.assert_allclose(log.time[rows], [s.time for s in theirs], atol=1e-9)
    attitude = np.array([euler_of(s.dcm_body_to_ned) for s in theirs])
    off = (ours.attitude[rows] - attitude + np.pi) % (2.0 * np.pi) - np.pi
    assert np.abs(off / ours.attitude_std[rows]).max() < within
    for name in ("gyro_bias", "accel_bias"):
        off = getattr(ours, name)[rows] - np.array([getattr(s, name) for s in theirs])
        assert np.abs(off / getattr(ours, f"{name}_std")[rows]).max() < within, name
    velocity = np.array([s.velocity for s in theirs])
    assert np.abs(ours.velocity_ned[rows] - velocity).max() < within * 0.005  # its sigma is some 5 mm/s


@pytest.mark.parametrize("scenario", ["windrower", "field", "circle", "straight"])
def test_it_is_the_textbook_s_smoother(scenario: str) -> None:
    log, _ = simulate(scenario, seed=4, duration=90.0, sensors=QUICK)
    ours, theirs = smoothed_once(log), smooth_reference(reference_records(log))
    # Same model, same forward run but for its arithmetic, which test_phasor_twin.py allows a hundredth of the forward
    # sigma; the smoothed sigma is smaller than that by up to ten at the beginning.
    compare(log, ours, theirs, within=0.1)
    rows = np.searchsorted(log.time, [s.time for s in theirs])
    joint, lift = np.array([s.covariance for s in theirs]), np.array([s.lift_covariance for s in theirs])
    diagonal = np.diagonal(joint, axis1=1, axis2=2)
    level = (diagonal[:, :4] + diagonal[:, 4:8]) / 2.0  # the kernel shows the mean of the two axes
    down = np.array([s.dcm_body_to_ned[2] for s in theirs])
    gravity_var = PARAMS.kernel_arguments()["gravity_std"] ** 2
    pairs = [
        (ours.attitude_std[rows, 1], level[:, 1]),
        (ours.attitude_std[rows, 2], diagonal[:, 8] + level[:, 1] * down[:, 0] ** 2),
    ]
    for shown, horizontal, vertical in (
        (ours.gyro_bias_std[rows], level[:, 2], diagonal[:, 9]),
        (ours.accel_bias_std[rows], level[:, 3], lift[:, 1, 1] + gravity_var),
    ):
        pairs += [(shown[:, k], horizontal + (vertical - horizontal) * down[:, k] ** 2) for k in range(3)]
    # Both smooth all errors together: near the ends they agree to the forward runs' arithmetic (some thousandths of
    # sigma, test_phasor_twin.py). In between the kernel shows one sigma for half a second, while the ground turns the
    # body's axes by degrees, and a well known axis shares in one that is not.
    time = np.array([s.time for s in theirs])
    ends = (time < 20.0) | (time > 70.5)
    for shown, variance in pairs:
        ratio = shown / np.sqrt(variance)
        np.testing.assert_allclose(ratio[ends & (time > 1.5)], 1.0, atol=3e-3)
        np.testing.assert_allclose(ratio[~ends], 1.0, atol=0.15)
        assert ratio[time > 1.5].mean() == pytest.approx(1.0, abs=2e-3)


def least_squares(records: list[Record]) -> list[FloatArray]:
    """Return the errors left in each record's state, by one dense least-squares problem over all of them.

    Unknown are the ten errors after each record. Before the measurements of record k they are e_k plus the filter's
    correction; they grew out of moved e_{k-1} with the process noise between.
    """
    n = len(records)
    blocks: list[tuple[FloatArray, FloatArray]] = []

    def add(parts: dict[int, FloatArray], value: FloatArray, covariance: FloatArray) -> None:
        rows = np.zeros((value.size, 10 * n))
        for k, part in parts.items():
            rows[:, 10 * k : 10 * k + 10] = part
        white = np.linalg.inv(np.linalg.cholesky(covariance))
        blocks.append((white @ rows, white @ value))

    add({0: np.eye(10)}, np.zeros(10), records[0].covariance)
    for k in range(1, n):
        r, m = records[k], records[k].measured
        noise = m.predicted - r.moved @ records[k - 1].covariance @ r.moved.T
        add({k: np.eye(10), k - 1: -r.moved}, -m.correction, noise)
        if m.seen.size:
            add({k: m.rows}, m.seen - m.rows @ m.correction, np.diag(m.noise))
    a, b = (np.concatenate([block[i] for block in blocks]) for i in (0, 1))
    scale = np.tile(np.sqrt(np.diag(records[-1].covariance)), n)
    solution = np.linalg.lstsq(a * scale, b, rcond=None)[0] * scale
    return list(solution.reshape(n, 10))


def test_it_is_the_least_squares_solution_of_the_whole_drive() -> None:
    sensors = replace(QUICK, gnss_rate=2.5)
    # On a straight the heading hardly shows in the velocity: the noise between two epochs, of which the filter takes
    # the heading's as circular, is then positive as least squares needs it.
    log, _ = simulate("straight", seed=2, duration=30.0, sensors=sensors)
    records = reference_records(log)
    direct = least_squares(records)
    textbook = smooth_reference(records)
    for x, record, other in zip(direct, records, textbook, strict=True):
        dcm, velocity, gyro_bias, accel_bias = corrected(record, x, np.zeros(2))
        # The same minimum by two ways: what differs is rounding, in a problem whose condition is 1e6.
        np.testing.assert_allclose(dcm, other.dcm_body_to_ned, atol=1e-7)
        np.testing.assert_allclose(velocity[:2], other.velocity[:2], atol=1e-6)
        np.testing.assert_allclose(gyro_bias, other.gyro_bias, atol=1e-8)
        # The vertical, a pair of its own, is left out of this problem.
        level = record.dcm_body_to_ned @ (accel_bias - other.accel_bias)
        np.testing.assert_allclose(level[:2], 0.0, atol=1e-7)
    compare(log, smoothed_once(log), textbook, within=0.1)


def test_no_sample_shows_where_the_epochs_were() -> None:
    log, _ = simulate("windrower", seed=1, duration=120.0, sensors=QUICK)
    trace = smoothed_once(log)
    at_epoch = np.isin(np.round(log.time * 50.0), np.round(log.gnss_time * 50.0))[1:-1]
    for values in (*np.unwrap(trace.attitude, axis=0).T, *trace.velocity_ned.T):
        bend = np.abs(np.diff(values, 2))
        # Noise and ground bend the track at every sample; a step at the epochs would add its own there. RMS over 600
        # epochs is good to 3 %.
        assert np.sqrt(np.mean(bend[at_epoch] ** 2)) < 1.1 * np.sqrt(np.mean(bend[~at_epoch] ** 2))
        assert bend[at_epoch].max() < 1.5 * bend[~at_epoch].max()
    for values, sigma in zip(
        (*trace.gyro_bias.T, *trace.accel_bias.T), (*trace.gyro_bias_std.T, *trace.accel_bias_std.T), strict=True
    ):
        assert np.abs(np.diff(values)).max() < 0.2 * sigma.max()


def test_looking_back_is_never_less_sure() -> None:
    log, _ = simulate("windrower", seed=1, duration=120.0, sensors=QUICK)
    before, after = forward(log), smoothed_once(log)
    epochs = np.isin(np.round(log.time * 50.0), np.round(log.gnss_time * 50.0)) & (log.time >= 1.0)
    for name in ("gyro_bias_std", "accel_bias_std", "attitude_std"):
        # Sigma in body axes and as roll depends on the attitude too, which the smoother corrects by up to 0.02 rad.
        assert (getattr(after, name)[epochs] <= getattr(before, name)[epochs] * 1.001).all(), name
    assert after.attitude_std.min() > 1e-5


def held_to(truth: Truth, rows: NDArray[np.bool_], result: lh.Result) -> FloatArray:
    """Errors of roll, pitch and heading in sigmas."""
    off = np.column_stack(
        [result.roll - truth.roll[rows], result.pitch - truth.pitch[rows], result.heading - truth.heading[rows]]
    )
    ratio: FloatArray = ((off + np.pi) % (2.0 * np.pi) - np.pi) / result.attitude_std
    return ratio


def test_every_sample_has_an_attitude_from_the_first() -> None:
    log, truth = simulate("windrower", seed=5, duration=60.0, sensors=QUICK)
    result = lh.estimate(log, "smoother", params=PARAMS)
    ratio = held_to(truth, np.ones(log.time.size, dtype=bool), result)
    assert np.isfinite(ratio).all()
    assert np.isfinite(result.velocity_ned).all()
    # Before the first epochs the readings are integrated backwards. Of three angles hardly one in 5000
    # is beyond four sigma.
    assert np.abs(ratio[:50]).max() < 4.0


def test_a_gap_is_smoothed_from_both_sides_and_nothing_is_invented_inside() -> None:
    log, truth = simulate("windrower", seed=5, duration=90.0, sensors=QUICK)
    keep = (log.time < 40.0) | (log.time >= 45.0)
    gappy = replace(log, time=log.time[keep], gyro=log.gyro[keep], accel=log.accel[keep])
    result = lh.estimate(gappy, "smoother", params=PARAMS)
    assert result.time.size == keep.sum()  # no rows where no readings are
    ratio = held_to(truth, keep, result)
    assert np.isfinite(ratio).all()
    assert np.abs(ratio).max() < 5.0
    near = np.abs(gappy.time - 42.5) < 3.5
    # A second before and after, levelled by what lies on its own side only, tilt is as good as at either end of a log.
    assert np.degrees(result.attitude_std[near, :2]).max() < 0.1


def test_the_heading_before_the_first_course_is_told_by_what_comes_after() -> None:
    log, truth = simulate("windrower", seed=5, duration=90.0, standstill_s=30.0, sensors=QUICK)
    live = lh.estimate(log, "phasor", params=PARAMS)
    assert np.isnan(live.heading[log.time < 29.0]).all()
    result = lh.estimate(log, "smoother", params=PARAMS)
    ratio = held_to(truth, np.ones(log.time.size, dtype=bool), result)
    still = log.time < 30.0
    assert np.isfinite(ratio).all()
    assert np.abs(ratio[still]).max() < 4.0
    assert np.degrees(result.attitude_std[still, 2]).max() < 1.0
