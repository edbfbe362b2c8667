"""The measures: absent values are skipped, angles wrap, settling is for good."""

from __future__ import annotations

import numpy as np
import pytest

from levelhead.analysis.metrics import json_list, json_number, rms, settling_time, wrapped


def test_rms_skips_what_is_absent() -> None:
    values = np.array([[3.0, np.nan, np.nan], [4.0, 2.0, np.nan]])
    np.testing.assert_allclose(rms(values), [np.sqrt(12.5), 2.0, np.nan], rtol=1e-15)


def test_angles_wrap_at_half_a_turn() -> None:
    # A few units in the last place of pi.
    np.testing.assert_allclose(wrapped(np.radians([350.0, -190.0, 725.0])), np.radians([-10.0, 170.0, 5.0]), atol=1e-14)


@pytest.mark.parametrize(
    ("error", "settled"),
    [
        ([9.0, 0.1, 9.0, 0.1, 0.1], 3.0),
        ([0.1, 0.1, 0.1, 0.1, 0.1], 0.0),
        ([0.1, 0.1, 0.1, 0.1, 9.0], None),
        ([0.1, np.nan, 0.1, -0.1, -0.1], 2.0),
        ([np.nan] * 5, None),
    ],
)
def test_settling_is_for_good(error: list[float], settled: float | None) -> None:
    column = np.array(error)[:, None]
    assert settling_time(10.0 + np.arange(5.0), np.hstack((0.0 * np.nan_to_num(column), column)), 1.0) == settled


def test_what_is_not_finite_is_null_in_json() -> None:
    assert json_list(np.array([1.0, np.nan, np.inf]), 2.0) == [2.0, None, None]
    assert [json_number(v) for v in (1.5, np.nan, np.inf, None)] == [1.5, None, None, None]
