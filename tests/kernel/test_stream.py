"""The stream: batch equals live to the bit, states survive a save, bad input is dropped and counted."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from levelhead.conventions import FloatArray
from levelhead.errors import UsageError
from levelhead.estimators.base import Status
from levelhead.estimators.ekf import Ekf
from levelhead.estimators.mahony import Mahony
from levelhead.estimators.observer import Observer
from levelhead.estimators.streaming import run
from levelhead.estimators.two_stage import TwoStage
from levelhead.logs.log import Log
from levelhead.sim import SensorModel, simulate

from .conftest import Kit, Params, irregular

Live = Observer | TwoStage | Ekf | Mahony
KINDS: list[type[Live]] = [Observer, TwoStage, Ekf, Mahony]


@pytest.fixture(scope="module")
def drive() -> Log:
    """A minute and a half of curves, irregular stamps, GNSS off the IMU's grid, one gap."""
    log, _ = simulate("windrower", seed=1, duration=90.0, sensors=SensorModel(imu_rate=50.0, gnss_rate=5.0))
    return irregular(log, 2)


def feed(stream: Live, log: Log, first: int, last: int) -> list[FloatArray]:
    """Feed samples first..last and the epochs between them as a live source would; return the state after each."""
    assert log.velocity_ned is not None
    rows = []
    for i in range(first, last):
        before = log.time[i - 1] if i > 0 else -math.inf
        for j in np.flatnonzero((log.gnss_time > before) & (log.gnss_time < log.time[i])):
            if i > 0:
                stream.update_gnss(float(log.gnss_time[j]), log.velocity_ned[j].tolist())
        stream.update_imu(float(log.time[i]), log.gyro[i], tuple(log.accel[i]))
        for j in np.flatnonzero(log.gnss_time == log.time[i]):
            stream.update_gnss(float(log.gnss_time[j]), log.velocity_ned[j])
        state = [*stream.gyro_bias, *stream.accel_bias, stream.roll, stream.pitch, stream.heading, *stream.velocity_ned]
        rows.append(np.array([*state, float(stream.status)]))
    return rows


@pytest.mark.parametrize("kind", KINDS)
def test_live_equals_batch_bit_for_bit(kind: type[Live], drive: Log) -> None:
    live = np.array(feed(kind(), drive, 0, drive.time.size))
    stream = kind()
    trace = run(stream, drive)
    trace.accel_bias[:, :] = np.where(np.isnan(stream.accel_bias), np.nan, trace.accel_bias)  # what is not shown
    batch = np.column_stack([trace.gyro_bias, trace.accel_bias, trace.attitude, trace.velocity_ned, trace.status])
    np.testing.assert_array_equal(
        live[:, [0, 1, 2, 3, 4, 6, 7, 8, 9, 10, 11, 12]], batch[:, [0, 1, 2, 3, 4, 6, 7, 8, 9, 10, 11, 12]]
    )


@pytest.mark.parametrize("kind", KINDS)
def test_any_chunking_gives_the_same_bits(kind: type[Live], drive: Log, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = run(kind(), drive)
    monkeypatch.setattr("levelhead.estimators.streaming.CHUNK", 17)
    pieces = run(kind(), drive)
    np.testing.assert_array_equal(whole.gyro_bias, pieces.gyro_bias)
    np.testing.assert_array_equal(whole.attitude, pieces.attitude)
    np.testing.assert_array_equal(whole.status, pieces.status)


@pytest.mark.parametrize("kind", KINDS)
def test_save_and_restore_continue_bit_for_bit(kind: type[Live], drive: Log) -> None:
    straight_through = kind()
    expected = feed(straight_through, drive, 0, 3000)
    first = kind()
    feed(first, drive, 0, 1234)
    second = kind.restore(first.save())
    assert type(second) is kind
    np.testing.assert_array_equal(feed(second, drive, 1234, 3000), expected[1234:])
    assert second.save() == straight_through.save()


def test_a_damaged_or_foreign_blob_is_refused() -> None:
    blob = Observer().save()
    with pytest.raises(UsageError, match="checksum"):
        Observer.restore(blob[:-9] + bytes([blob[-9] ^ 1]) + blob[-8:])
    with pytest.raises(UsageError, match="damaged"):
        Observer.restore(blob[:-1])
    for wrong in (b"", b"hello", TwoStage().save()):
        with pytest.raises(UsageError, match="not a state saved by this estimator"):
            Observer.restore(wrong)


def test_vectors_may_be_tuples_lists_arrays_and_slices() -> None:
    states = []
    strided = np.arange(12.0).reshape(3, 4)
    values = (0.0, 4.0, 8.0)
    for vector in (
        values,
        list(values),
        np.array(values),
        strided[:, 0],
        np.array(values, dtype=np.float32),
        [0, 4, 8],
    ):
        stream = Observer()
        assert stream.update_imu(0.0, vector, vector)
        states.append(stream.save())
    assert all(state == states[0] for state in states)


@pytest.mark.parametrize("vector", [(1.0, 2.0), [1.0, 2.0, 3.0, 4.0], np.zeros(4), 3.0, None, "abc", ("a", 1.0, 2.0)])
def test_anything_else_is_an_error(vector: Any) -> None:
    with pytest.raises((ValueError, TypeError)):
        Observer().update_imu(0.0, vector, (0.0, 0.0, -9.8))


def test_bad_samples_are_dropped_counted_and_leave_no_trace(kit: Kit, params: Params, drive: Log) -> None:
    assert drive.velocity_ned is not None
    clean, dirty = kit.compiled(params), kit.compiled(params)
    nan = math.nan
    for i in range(1500):
        t, w, f = float(drive.time[i]), drive.gyro[i], drive.accel[i]
        clean.update_imu(t, w, f)
        assert dirty.update_imu(t, w, f)
        assert not dirty.update_imu(t, w, f)  # the same stamp again
        assert not dirty.update_imu(t - 0.5, w, f)  # back in time
        assert not dirty.update_imu(t + 0.001, (nan, 0.0, 0.0), f)
        assert not dirty.update_imu(t + 0.001, w, (0.0, math.inf, 0.0))
        assert not dirty.update_imu(nan, w, f)
        if i % 10 == 0 and i > 0:
            v = drive.velocity_ned[i // 10]
            clean.update_gnss(t, v)
            assert not dirty.update_gnss(t, (nan, 0.0, 0.0))
            assert dirty.update_gnss(t, v)
            assert not dirty.update_gnss(t, v)
            assert not dirty.update_gnss(t - 0.01, v)
    np.testing.assert_array_equal(clean.gyro_bias, dirty.gyro_bias)
    np.testing.assert_array_equal(clean.dcm_body_to_ned, dirty.dcm_body_to_ned)
    events = {code: count for code, count, _, _ in dirty.raw_events}
    epochs = len(range(10, 1500, 10))
    assert events["W_TIME_BACK"] == 2 * 1500 + 2 * epochs
    assert events["E_NONFINITE"] == 3 * 1500 + epochs
    assert not {"W_TIME_BACK", "E_NONFINITE"} & {code for code, *_ in clean.raw_events}


def test_a_gap_teaches_nothing_and_a_long_one_levels_anew() -> None:
    log, _ = simulate("windrower", seed=1, duration=200.0)
    short = (log.time > 150.0) & (log.time < 151.0)
    long = (log.time > 150.0) & (log.time < 153.0)
    for hole, code in ((short, "W_GAP"), (long, "E_GAP_RESET")):
        cut = replace(log, time=log.time[~hole], gyro=log.gyro[~hole], accel=log.accel[~hole])
        trace = run(Observer(), cut)
        events = {event.code: event.count for event in trace.events}
        assert events[code] == 1
        before = int(np.flatnonzero(cut.time <= 150.0)[-1])
        # The epoch that closes the broken interval is at most 0.1 s after the gap: nothing is learnt by then.
        np.testing.assert_array_equal(trace.gyro_bias[before + 1], trace.gyro_bias[before])
        np.testing.assert_array_equal(trace.accel_bias[before + 1], trace.accel_bias[before])
        after = int(np.flatnonzero(cut.time <= 170.0)[-1])
        assert (trace.gyro_bias[after] != trace.gyro_bias[before]).all()  # and it goes on learning
        restarted = bool(trace.status[before + 1] & Status.INITIALIZING)
        assert restarted == (code == "E_GAP_RESET")
        assert not trace.status[-1] & Status.INITIALIZING


def test_without_gnss_the_platform_coasts_and_the_biases_hold() -> None:
    log, truth = simulate("windrower", seed=1, duration=300.0)
    keep = (log.gnss_time < 200.0) | (log.gnss_time > 260.0)
    assert log.velocity_ned is not None
    cut = replace(
        log,
        gnss_time=log.gnss_time[keep],
        velocity_ned=log.velocity_ned[keep],
        velocity_std=None,
        position_llh=None,
        position_std=None,
    )
    trace = run(Observer(), cut)
    outage = (log.time > 200.5) & (log.time < 260.0)
    assert (trace.status[outage] & Status.COASTING).all()
    assert not (trace.status[log.time < 199.0] & Status.COASTING).any()
    assert np.ptp(trace.gyro_bias[outage], axis=0).max() == 0.0
    assert np.ptp(trace.accel_bias[outage], axis=0).max() == 0.0
    # faults.md: after 60 s without GNSS the tilt is still within 0.3 deg (0.003 deg/s times 60 s, and noise).
    tilt = np.degrees(trace.attitude[outage, :2] - np.column_stack([truth.roll, truth.pitch])[outage])
    assert np.abs(tilt).max() < 0.3
    assert {event.code for event in trace.events} == {"S_COAST"}


def test_several_epochs_between_two_samples_count_as_their_last() -> None:
    log, _ = simulate("windrower", seed=1, duration=60.0, sensors=SensorModel(imu_rate=20.0, gnss_rate=100.0))
    trace = run(Observer(), log)
    assert np.isfinite(trace.gyro_bias).all()
    assert not trace.status[-1] & Status.INITIALIZING


@pytest.mark.parametrize("kind", KINDS)
def test_an_imu_turned_over_and_over_stays_finite(kind: type[Live]) -> None:
    # Half a turn of roll per GNSS interval: the mean attitude of each interval has no vertical at all.
    stream = kind()
    for k in range(3000):
        t = 0.01 * k
        roll = math.pi * k / 10.0
        stream.update_imu(t, (math.pi * 10.0, 0.0, 0.2), (0.0, -9.8 * math.sin(roll), -9.8 * math.cos(roll)))
        if k % 10 == 0:
            stream.update_gnss(t, (3.0 * math.cos(0.2 * t), 3.0 * math.sin(0.2 * t), 0.0))
    assert np.isfinite(stream.gyro_bias).all()
    if kind is not Mahony:  # it has none
        assert np.isfinite(np.delete(stream.accel_bias, stream.vertical_axis)).all()
    np.testing.assert_allclose(stream.dcm_body_to_ned @ stream.dcm_body_to_ned.T, np.eye(3), atol=1e-12)


def test_the_velocity_follows_the_truth_between_epochs() -> None:
    log, truth = simulate("windrower", seed=1, duration=300.0, sensors=SensorModel(gnss_rate=1.0))
    trace = run(Observer(), log)
    unknown = np.isnan(trace.velocity_ned).any(axis=1)
    np.testing.assert_array_equal(unknown, (trace.status & Status.INITIALIZING) != 0)
    late = log.time > 100.0
    # Over one second: 0.03 m/s of the last epoch, 0.2 m/s^2 of vertical bias unseen, 0.1 deg of tilt (0.02 m/s^2).
    assert np.abs(trace.velocity_ned - truth.velocity_ned)[late].max() < 0.35


def test_events_keep_their_first_and_last_time() -> None:
    stream = Observer()
    stream.update_imu(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, -9.8))
    for t in (1.0, 2.0, 3.0):
        stream.update_imu(t, (math.nan, 0.0, 0.0), (0.0, 0.0, -9.8))
    (event,) = stream.events
    assert (event.code, event.count, event.first_s, event.last_s) == ("E_NONFINITE", 3, 1.0, 3.0)
    early = Observer()
    early.update_imu(math.nan, (0.0, 0.0, 0.0), (0.0, 0.0, -9.8))
    assert early.events[0].first_s == 0.0


@pytest.mark.parametrize("std", [0.03, np.float32(0.03), np.array(0.03), (0.03, 0.03, 9.0), None])
def test_a_velocity_std_may_be_one_number_three_or_none(std: Any) -> None:
    stream = Observer()
    stream.update_imu(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, -9.8))
    assert stream.update_gnss(0.0, (3.0, 0.0, 0.0), std)


@pytest.mark.parametrize("std", ["a", (1.0, 2.0), 10**400])
def test_any_other_std_is_an_error(std: Any) -> None:
    stream = Observer()
    stream.update_imu(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, -9.8))
    with pytest.raises((TypeError, ValueError, OverflowError)):
        stream.update_gnss(0.0, (3.0, 0.0, 0.0), std)


def test_the_axis_nearest_to_the_vertical_is_not_claimed() -> None:
    stream = Observer()
    for k in range(300):  # on its right side: the reading of gravity lies on y
        stream.update_imu(0.01 * k, (0.0, 0.0, 0.0), (0.0, 9.8, 0.0))
        if k % 10 == 0:
            stream.update_gnss(0.01 * k, (0.0, 0.0, 0.0))
    assert stream.vertical_axis == 1
    np.testing.assert_array_equal(np.isnan(stream.accel_bias), [False, True, False])
