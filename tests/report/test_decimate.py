"""Decimation loses samples, never what the eye looks for: extremes, ends, gaps, turns."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from levelhead.conventions import FloatArray
from levelhead.report.decimate import encode, minmax_indices, path_indices, wrap_with_gaps

WITH_GAPS = st.one_of(st.floats(-1e3, 1e3), st.just(float("nan")))
TABLES = hnp.arrays(np.float64, st.tuples(st.integers(2, 300), st.integers(1, 3)), elements=WITH_GAPS)


@given(table=TABLES, buckets=st.integers(1, 40))
@settings(deadline=None)
def test_each_bucket_keeps_its_extremes_and_its_gap(table: FloatArray, buckets: int) -> None:
    kept = minmax_indices(table, buckets)
    n = table.shape[0]
    assert kept[0] == 0
    assert kept[-1] == n - 1
    assert np.all(np.diff(kept) > 0)
    width = 1 if n <= 2 * buckets else -(-n // buckets)
    for start, column in itertools.product(range(0, n, width), range(table.shape[1])):
        bucket = table[start : start + width, column]
        shown = table[kept[(kept >= start) & (kept < start + width)], column]
        assert np.isnan(bucket).any() == np.isnan(shown).any()
        if np.isfinite(bucket).any():
            assert np.nanmin(shown) == np.nanmin(bucket)
            assert np.nanmax(shown) == np.nanmax(bucket)


def test_a_long_drive_shrinks_to_a_few_samples_per_pixel() -> None:
    noise = np.random.default_rng(1).normal(size=(360_000, 3))
    # Two samples per bucket and column, and the two ends.
    assert minmax_indices(noise, 1000).size <= 3 * 2 * 1000 + 2


def test_a_single_spike_among_many_samples_stays() -> None:
    curve = np.zeros(100_000)
    curve[54_321] = -1.0
    assert 54_321 in minmax_indices(curve)


def test_infinite_values_are_gaps() -> None:
    curve = np.zeros(10_000)
    curve[5_000] = np.inf
    curve[7_000] = 3.0
    kept = minmax_indices(curve, 100)
    assert 5_000 in kept
    assert 7_000 in kept


@given(
    steps=hnp.arrays(np.float64, st.tuples(st.integers(2, 60), st.integers(1, 2)), elements=st.floats(-400.0, 400.0)),
    gap=st.integers(0, 59),
)
@settings(deadline=None)
def test_a_wrapped_heading_never_jumps_across_the_plot(steps: FloatArray, gap: int) -> None:
    angles = np.cumsum(steps, axis=0)
    angles[gap % len(angles), 0] = np.nan
    time = np.arange(len(angles), dtype=np.float64)
    new_time, wrapped = wrap_with_gaps(time, angles)
    assert np.all(np.diff(new_time) > 0.0)
    assert np.isin(time, new_time).all()
    finite = wrapped[np.isfinite(wrapped)]
    assert np.all((finite >= 0.0) & (finite <= 360.0))
    jumps = np.abs(np.diff(wrapped, axis=0))
    assert np.all(jumps[np.isfinite(jumps)] <= 180.0)


def test_a_heading_that_passes_north_reaches_both_edges() -> None:
    time, wrapped = wrap_with_gaps(np.array([0.0, 1.0]), np.array([[350.0], [370.0]]))
    # Half way at 360; the rows beside the gap lie one hundredth of the interval away: 0.2 deg.
    np.testing.assert_allclose(time, [0.0, 0.49, 0.5, 0.51, 1.0], atol=1e-12)
    np.testing.assert_allclose(wrapped[:, 0], [350.0, 359.8, np.nan, 0.2, 10.0], atol=1e-9)


@given(values=hnp.arrays(np.float64, st.integers(0, 50), elements=WITH_GAPS), decimals=st.integers(0, 6))
@settings(deadline=None)
def test_encoded_columns_come_back(values: FloatArray, decimals: int) -> None:
    steps = encode(values, decimals)["steps"]
    assert isinstance(steps, list)
    total, back = 0, []
    for step in steps:
        total += step or 0
        back.append(np.nan if step is None else total / 10**decimals)
    # Half a unit of the last digit, and the rounding of the sum itself.
    np.testing.assert_allclose(back, values, atol=0.5 * 10.0**-decimals + 1e-9, rtol=0.0)


def test_a_path_keeps_its_headland_turns() -> None:
    """Twenty rows of 200 m with half circles of 4 m radius: thinned 20 times, nothing is cut off."""
    along = np.arange(0.0, 20 * (200.0 + 4.0 * np.pi), 0.05)
    row, s = np.divmod(along, 200.0 + 4.0 * np.pi)
    angle = np.clip((s - 200.0) / 4.0, 0.0, np.pi)
    forward = np.minimum(s, 200.0) + 4.0 * np.sin(angle)
    north = np.where(row % 2 == 0, forward, 200.0 - forward)
    east = 8.0 * row + 4.0 * (1.0 - np.cos(angle))
    kept = path_indices(north, east, 2500)
    assert kept.size <= 2502
    shown_north, shown_east = (np.interp(along, along[kept], place[kept]) for place in (north, east))
    # Half of the 2500 points cover 20 half turns: a point every 3 deg, each chord 1.4 mm off its arc of 4 m; a
    # coarse step of the first pass (21 cm) at the start of a turn makes it some centimetres. A pixel is 30 cm.
    assert np.hypot(shown_north - north, shown_east - east).max() < 0.1


@pytest.mark.parametrize("place", [np.zeros(5000), np.linspace(0.0, 1.0, 5000)])
def test_standing_and_straight_paths_keep_their_ends(place: FloatArray) -> None:
    kept = path_indices(place, np.zeros(5000), 100)
    assert kept[0] == 0
    assert kept[-1] == 4999
    assert kept.size <= 102
