"""An estimate that still wanders is not called known, and one that wanders a little says by how much."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import levelhead as lh
from levelhead.estimators.trust import ACCEL_BAND, GYRO_BAND, WATCHED, wander


@pytest.fixture(scope="module")
def log() -> lh.Log:
    """Ten minutes of curves, which teach everything."""
    return lh.simulate("windrower", seed=6, duration=600.0)[0]


def drifting(log: lh.Log, gyro: float, accel: float) -> lh.Log:
    """Let the biases of the y axes ramp over the last two minutes by so much in all."""
    ramp = np.clip((log.time - log.time[-1] + WATCHED) / WATCHED, 0.0, 1.0)[:, None]
    return replace(log, gyro=log.gyro + ramp * [0.0, gyro, 0.0], accel=log.accel + ramp * [0.0, accel, 0.0])


def test_a_steady_drive_needs_no_warning(log: lh.Log) -> None:
    result = lh.estimate(log, "observer")
    assert result.known_gyro == (True, True, True)
    assert result.known_accel == (True, True, False)
    assert "W_UNSTEADY" not in {event.code for event in result.events}


def test_a_small_drift_is_told_by_size(log: lh.Log) -> None:
    # A ramp of three bands shows as half of that, 1.5 bands: more than one, less than two.
    result = lh.estimate(drifting(log, 3.0 * GYRO_BAND, 0.0), "observer")
    assert result.known_gyro == (True, True, True)
    text = next(event.text for event in result.events if event.code == "W_UNSTEADY")
    assert "gyro y by +-0.0" in text
    assert "gyro x" not in text


def test_a_large_drift_is_not_known(log: lh.Log) -> None:
    result = lh.estimate(drifting(log, 8.0 * GYRO_BAND, 8.0 * ACCEL_BAND), "observer")
    assert result.known_gyro == (True, False, True)
    assert result.known_accel == (True, False, False)
    summary = result.summary()
    gyro, accel = summary["gyro_bias_deg_s"], summary["accel_bias_m_s2"]
    assert isinstance(gyro, list)
    assert isinstance(accel, list)
    assert gyro[1] is None
    assert accel[1] is None


def test_wander_is_half_of_peak_to_peak_over_the_watched_end() -> None:
    time = np.arange(0.0, 300.0, 1.0)
    estimate = np.zeros((300, 3))
    estimate[:100] = 99.0  # before the watched end: start-up, not wander
    estimate[200:] = [0.0, 0.02, -0.06]
    np.testing.assert_allclose(wander(time, estimate), [0.0, 0.01, 0.03], rtol=1e-12)
