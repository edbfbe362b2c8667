"""The figures that the README claims, on simulated drives: half an hour, 100 Hz / 10 Hz, 0.03 m/s velocity noise.

The bounds are the project's demands, not what is reached; `benchmarks/accuracy.py` prints the latter over more seeds.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import levelhead as lh
from levelhead.conventions import FloatArray

SEEDS = (11, 12, 13)
SCENARIOS = ("field", "windrower")
DRIVES: dict[tuple[str, int], tuple[lh.Log, lh.Truth]] = {}


def drive(scenario: str, seed: int) -> tuple[lh.Log, lh.Truth]:
    """Simulate a drive once for all tests."""
    key = (scenario, seed)
    if key not in DRIVES:
        DRIVES[key] = lh.simulate(scenario, seed=seed, duration=1800.0)
    return DRIVES[key]


def rms_after_900(values: list[FloatArray], logs: list[lh.Log]) -> FloatArray:
    """RMS over time after 900 s and over the drives, per column."""
    late = [value[log.time >= 900.0] for value, log in zip(values, logs, strict=True)]
    out: FloatArray = np.sqrt(np.mean(np.concatenate(late) ** 2, axis=0))
    return out


@pytest.mark.parametrize("scenario", SCENARIOS)
@pytest.mark.parametrize(
    ("method", "gyro_deg_s", "accel", "tilt_deg"), [("observer", 0.003, 0.005, 0.06), ("two-stage", 0.01, 0.04, np.inf)]
)
def test_errors_after_a_quarter_of_an_hour(
    method: str, gyro_deg_s: float, accel: float, tilt_deg: float, scenario: str
) -> None:
    drives = [drive(scenario, seed) for seed in SEEDS]
    results = [lh.estimate(log, method) for log, _ in drives]
    logs = [log for log, _ in drives]
    pairs = list(zip(results, (truth for _, truth in drives), strict=True))
    gyro = rms_after_900([(r.gyro_bias - t.gyro_bias)[:, :2] for r, t in pairs], logs)
    accelerometer = rms_after_900([(r.accel_bias - t.accel_bias)[:, :2] for r, t in pairs], logs)
    tilt = rms_after_900([np.column_stack([r.roll - t.roll, r.pitch - t.pitch]) for r, t in pairs], logs)
    assert np.degrees(gyro).max() <= gyro_deg_s
    assert accelerometer.max() <= accel
    assert np.degrees(tilt).max() <= tilt_deg


@pytest.mark.parametrize("scenario", SCENARIOS)
@pytest.mark.parametrize("seed", SEEDS)
def test_the_observer_settles_and_says_so_in_time(scenario: str, seed: int) -> None:
    log, truth = drive(scenario, seed)
    result = lh.estimate(log, "observer")
    gyro = np.degrees(np.abs(result.gyro_bias - truth.gyro_bias))[:, :2].max(axis=1)
    accel = np.abs(result.accel_bias - truth.accel_bias)[:, :2].max(axis=1)
    after_600 = log.time >= 600.0  # with passes of 60-120 s; it depends on the number of turns
    assert gyro[after_600].max() < 0.02
    assert accel[after_600].max() < 0.04
    # When the estimator says "settled", at most 5 % of the initial errors are left. Measured as in V they are 0.027
    # here (0.15 deg/s times sqrt(40 s), and 0.23 m/s^2 times sqrt(omega_a)/g): 0.012 deg/s or 0.015 m/s^2; three sigma
    # of the noise (0.002 deg/s, 0.004 m/s^2) come on top. Wider would be a confident wrong answer.
    for name, error, bound in (("gyro", gyro, 0.012 + 0.006), ("accel", accel, 0.015 + 0.012)):
        since = result.settled_at_s[name]
        assert since is not None
        assert since < 1100.0  # the claim may come later than the fact (600 s), never earlier
        assert error[log.time - log.time[0] >= since].max() < bound, name


@pytest.mark.parametrize("factor", [0.8, 1.2])
@pytest.mark.parametrize("name", ["tau", "tau_gyro", "omega_accel"])
def test_twenty_percent_of_a_constant_hardly_matters(name: str, factor: float) -> None:
    # Tereshkov (2015), section 4: deviations smaller than 0.001 deg/s and 0.01 m/s^2 after convergence.
    base = lh.ObserverParams()
    changed = replace(base, **{name: getattr(base, name) * factor})
    for scenario in SCENARIOS:
        log, _ = drive(scenario, SEEDS[0])
        before, after = lh.estimate(log, "observer"), lh.estimate(log, params=changed)
        gyro = rms_after_900([(after.gyro_bias - before.gyro_bias)[:, :2]], [log])
        accel = rms_after_900([(after.accel_bias - before.accel_bias)[:, :2]], [log])
        assert 0.0 < np.degrees(gyro).max() < 0.001
        assert 0.0 < accel.max() < 0.01


def test_the_hill_needs_the_general_gain_no_worse_than_the_paper_s() -> None:
    log, truth = lh.simulate("hill", seed=3, duration=1800.0)
    errors = {}
    for gain in ("general", "paper"):
        params = lh.ObserverParams(gain="general" if gain == "general" else "paper")
        result = lh.estimate(log, params=params)
        errors[gain] = rms_after_900([(result.accel_bias - truth.accel_bias)[:, :2]], [log])
    # 0.01 m/s^2: twice the demand on level ground, for a 10 deg side slope.
    assert errors["general"].max() < 0.01
    assert errors["general"].max() < errors["paper"].max() * 1.05


def test_reverse_driving_is_recognised_and_harmless() -> None:
    log, truth = lh.simulate("reverse", seed=3, duration=1800.0)
    result = lh.estimate(log, "observer")
    late = log.time >= 900.0
    # faults.md: 20 s in every 120 s backwards cost < 0.01 deg/s and < 0.3 deg of tilt.
    assert np.degrees(np.abs(result.gyro_bias - truth.gyro_bias)[late, :2]).max() < 0.01
    assert np.degrees(np.abs(result.roll - truth.roll)[late]).max() < 0.3
    assert "S_REVERSE" in {event.code for event in result.events}
    assert (result.status[late] & lh.Status.REVERSE).any()
    assert not (result.status[-1] & lh.Status.REVERSE) or truth.velocity_ned[-1] @ heading_axis(truth) < 0.0


def heading_axis(truth: lh.Truth) -> FloatArray:
    """Forward direction at the end of a drive, NED."""
    return np.array([np.cos(truth.heading[-1]), np.sin(truth.heading[-1]), 0.0])
