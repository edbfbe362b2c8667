"""A sensor's own clock: set by the order of arrival, over overflows, restarts, outages and a changing rate."""

from __future__ import annotations

import numpy as np

from levelhead.conventions import FloatArray
from levelhead.logs.readers.sensor_clock import Ticks, place

TICK_S = 39.0625e-6


def every(step_s: float, count: int) -> FloatArray:
    """Return instants, s."""
    return np.linspace(0.0, step_s * (count - 1), count)


def arrival(sample_s: FloatArray, epoch_s: FloatArray, *, late_s: float = 0.0) -> tuple[Ticks, Ticks]:
    """Return the places in a file of samples and epochs that are written as they come, the samples first."""
    moments = np.concatenate((sample_s, epoch_s + late_s))
    place_of = np.empty(moments.size, dtype=np.int64)
    place_of[np.argsort(moments, kind="stable")] = np.arange(moments.size)
    return place_of[: sample_s.size], place_of[sample_s.size :]


def test_an_overflow_during_an_outage_of_gnss_loses_nothing() -> None:
    sample_s = every(0.01, 20_000)
    epoch_s = every(0.2, 500)
    at, epoch_at = arrival(sample_s, epoch_s)
    # The 24 bits overflow at 150 s; the last epoch is at 100 s.
    tags = (np.round(sample_s / TICK_S).astype(np.int64) + 2**24 - round(150 / TICK_S)) % 2**24
    placed = place(tags, at, epoch_at, 1000.0 + epoch_s, nominal_s=None)
    # Half a tick, and the length of a tick told over 100 s by epochs on the samples: 1e-7 of 200 s.
    np.testing.assert_allclose(placed.time, 1000.0 + sample_s, rtol=0, atol=5e-5)
    assert (np.diff(placed.key) > 0).all()


def test_a_rate_that_changes_over_an_hour_is_followed() -> None:
    sample_s = every(0.02, 180_000)
    epoch_s = every(0.2, 18_000)
    at, epoch_at = arrival(sample_s, epoch_s, late_s=0.03)
    # From 0 to 200 ppm fast: 0.36 s in all, up to 0.09 s beside the best straight line.
    own_s = sample_s + 200e-6 * sample_s**2 / (2.0 * 3600.0)
    placed = place(np.round(1e3 * own_s).astype(np.int64), at, epoch_at, epoch_s, nominal_s=1e-3)
    error = placed.time - sample_s
    # The pause between samples tells no better than 0.02 s; a block of 300 s bends by 1.3 ms, its half at the ends of
    # the log goes on straight: 150 s at 90 ppm beside the mean rate are 0.0135 s.
    assert np.ptp(error) < 0.035
    # The receiver is 0.03 s late, the sample that came before up to 0.02 s old.
    assert -0.045 < np.median(error) < -0.005


def test_a_pause_of_the_sensor_does_not_move_its_clock() -> None:
    sample_s = np.concatenate((every(0.01, 3000), 60.0 + every(0.01, 3000)))
    epoch_s = every(0.2, 450)
    at, epoch_at = arrival(sample_s, epoch_s)
    placed = place(np.round(1e3 * sample_s).astype(np.int64) + 77, at, epoch_at, epoch_s, nominal_s=1e-3)
    # Whole milliseconds, each an exact one.
    np.testing.assert_allclose(placed.time, sample_s, rtol=0, atol=1e-9)


def test_what_no_epoch_tells_has_no_time() -> None:
    tags, at = np.arange(100, dtype=np.int64), np.arange(100, dtype=np.int64)
    none = np.zeros(0, dtype=np.int64)
    assert np.isnan(place(tags, at, none, np.zeros(0), nominal_s=1e-3).time).all()
    # Three epochs tell no tick, but set a clock whose tick is known.
    few, when = np.array([10, 20, 30], dtype=np.int64), np.array([0.01, 0.02, 0.03])
    assert np.isnan(place(tags, at, few, when, nominal_s=None).time).all()
    np.testing.assert_allclose(place(tags, at, few, when, nominal_s=1e-3).time, 1e-3 * (tags + 1), atol=1e-12)
    # A restart after which nothing is told.
    again = np.concatenate((tags + 5_000_000, tags))
    placed = place(again, np.arange(200, dtype=np.int64), few, when, nominal_s=1e-3)
    assert np.isfinite(placed.time[:100]).all()
    assert np.isnan(placed.time[100:]).all()
    empty = place(none, none, few, when, nominal_s=1e-3)
    assert empty.time.size == 0
