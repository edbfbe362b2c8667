"""What many simulated runs add up to: `Trial`, one run of one method, and `MonteCarlo`, all of them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from levelhead.analysis.metrics import json_list, json_number, rms
from levelhead.conventions import FloatArray
from levelhead.version import __version__

QUANTITIES: Final[dict[str, tuple[str, str, float]]] = {
    **{name: (f"{name}_deg", "deg", math.degrees(1.0)) for name in ("roll", "pitch", "heading")},
    **{f"gyro {axis}": (f"gyro_{axis}_deg_s", "deg/s", math.degrees(1.0)) for axis in "xyz"},
    **{f"accel {axis}": (f"accel_{axis}_m_s2", "m/s²", 1.0) for axis in "xyz"},
}
"""What errors are taken of, in the order of every array below: the key in JSON, the reader's unit, the factor to it."""

CHI_95: Final = 1.959964


def _nan() -> FloatArray:
    return np.full(len(QUANTITIES), np.nan)


def _zero() -> NDArray[np.int64]:
    return np.zeros(len(QUANTITIES), dtype=np.int64)


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """One run of one method; arrays have one element per quantity, rad, rad/s, m/s^2.

    Attributes
    ----------
    seed : int
        Of the drive.
    rms : ndarray, shape (9,)
        Errors after `MonteCarlo.after`; NaN where not estimated.
    gyro_settles, accel_settles : float or None
        When the error of x and y came below 0.02 deg/s, 0.04 m/s^2 for good, s; None: not within the run.
    squared : ndarray, shape (9,)
        Mean squared error in units of the method's own sigma, 1 for an honest one; NaN without a sigma.
    covered, samples : ndarray, shape (9,)
        How often the error was within 1.96 sigma, of how many looks.
    gyro_flagged, accel_flagged : bool
        Whether the method called its biases settled in the end.
    failure : str
        Why the method refused the drive; empty where it did not.
    """

    seed: int
    rms: FloatArray = field(default_factory=_nan)
    gyro_settles: float | None = None
    accel_settles: float | None = None
    squared: FloatArray = field(default_factory=_nan)
    covered: NDArray[np.int64] = field(default_factory=_zero)
    samples: NDArray[np.int64] = field(default_factory=_zero)
    gyro_flagged: bool = False
    accel_flagged: bool = False
    failure: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Figures:
    """One method over all runs; arrays have one element per quantity, rad, rad/s, m/s^2.

    Attributes
    ----------
    rms, worst : ndarray, shape (9,)
        Root mean square over the runs of each run's RMS error, and the largest of them.
    coverage : ndarray, shape (9,)
        Share of the looks at which the error was within 1.96 sigma: 0.95 for an honest sigma, NaN without one.
    nees : ndarray, shape (9,)
        Mean squared error in units of sigma: 1 for an honest one; above, the method claims too much.
    nees_band : ndarray, shape (9, 2)
        Where `nees` of an honest sigma lies in 95 % of all Monte Carlo analyses: chi-square with one degree of
        freedom per run, as if errors within a run were all one. They are not quite, so that the true band is
        narrower: what lies outside this one is inconsistent.
    gyro_settles, accel_settles : ndarray, shape (runs,)
        When each run settled, s; infinite where it did not.
    gyro_flagged, accel_flagged : int
        Runs in which the method called its biases settled in the end.
    failures : mapping
        Sentences by seed.
    """

    rms: FloatArray
    worst: FloatArray
    coverage: FloatArray
    nees: FloatArray
    nees_band: FloatArray
    gyro_settles: FloatArray
    accel_settles: FloatArray
    gyro_flagged: int
    accel_flagged: int
    failures: Mapping[int, str]

    @property
    def honest(self) -> NDArray[np.bool_]:
        """Whether `nees` is within its band (9,); False also without a sigma."""
        out: NDArray[np.bool_] = (self.nees >= self.nees_band[:, 0]) & (self.nees <= self.nees_band[:, 1])
        return out

    def as_dict(self) -> dict[str, object]:
        """Return the figures as `montecarlo.json` shows them."""
        quantities = {}
        for k, (key, _, scale) in enumerate(QUANTITIES.values()):
            quantities[key] = {
                "rms": json_number(self.rms[k], scale),
                "worst": json_number(self.worst[k], scale),
                "coverage_95": json_number(self.coverage[k]),
                "nees": json_number(self.nees[k]),
                "nees_band_95": json_list(self.nees_band[k]),
            }
        return {
            "errors": quantities,
            "settles_s": {
                name: {
                    "median": json_number(float(np.median(times)) if times.size else None),
                    "worst": json_number(times.max() if times.size else None),
                    "runs_that_never_did": int(np.isinf(times).sum()),
                }
                for name, times in (("gyro", self.gyro_settles), ("accel", self.accel_settles))
            },
            "runs_called_settled": {"gyro": self.gyro_flagged, "accel": self.accel_flagged},
            "failed": {str(seed): sentence for seed, sentence in self.failures.items()},
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class MonteCarlo:
    """A scenario with many seeds.

    Attributes
    ----------
    scenario : str
        The drive.
    runs, seed0 : int
        How many, and the seed of the first.
    duration, after : float
        Length of each drive and where its errors begin to count, s.
    imu_rate, gnss_rate : float
        Hz.
    params : mapping
        The constants of each method, SI and radians.
    trials : mapping
        Per method, the runs in the order of their seeds.
    """

    scenario: str
    runs: int
    seed0: int
    duration: float
    after: float
    imu_rate: float
    gnss_rate: float
    params: Mapping[str, Mapping[str, object]]
    trials: Mapping[str, tuple[Trial, ...]]

    def figures(self, method: str) -> Figures:
        """Add up one method's runs; those that failed are only counted as such."""
        all_runs = self.trials[method]
        done = [trial for trial in all_runs if not trial.failure]
        squared = _stack([trial.squared for trial in done])
        errors = _stack([trial.rms for trial in done])
        samples = np.sum([trial.samples for trial in done] or [_zero()], axis=0)
        covered = np.sum([trial.covered for trial in done] or [_zero()], axis=0)
        with_sigma = np.isfinite(squared).sum(axis=0)
        # rms of a root is the mean; runs count alike, however many looks each had.
        return Figures(
            rms=rms(errors),
            worst=_largest(errors),
            coverage=np.where(samples > 0, covered / np.maximum(samples, 1), np.nan),
            nees=rms(np.sqrt(squared)) ** 2,
            nees_band=np.array([chi_square_band(int(count)) for count in with_sigma]),
            gyro_settles=_times([trial.gyro_settles for trial in done]),
            accel_settles=_times([trial.accel_settles for trial in done]),
            gyro_flagged=sum(trial.gyro_flagged for trial in done),
            accel_flagged=sum(trial.accel_flagged for trial in done),
            failures={trial.seed: trial.failure for trial in all_runs if trial.failure},
        )

    def as_dict(self) -> dict[str, object]:
        """Return the content of `montecarlo.json`."""
        return {
            "levelhead": __version__,
            "scenario": self.scenario,
            "runs": self.runs,
            "first_seed": self.seed0,
            "duration_s": self.duration,
            "after_s": self.after,
            "imu_rate_hz": self.imu_rate,
            "gnss_rate_hz": self.gnss_rate,
            "methods": {
                method: {**self.figures(method).as_dict(), "params": dict(self.params[method])}
                for method in self.trials
            },
        }


def chi_square_band(degrees: int) -> tuple[float, float]:
    """Return the 95 % band of a chi-square variable divided by its degrees of freedom (Wilson and Hilferty, 1931).

    The edges are within 0.1 of the exact ones for one degree of freedom, 0.025 for two, 0.007 from five up.
    """
    if degrees < 1:
        return math.nan, math.nan
    spread = 2.0 / (9.0 * degrees)
    low, high = (max(0.0, 1.0 - spread + sign * CHI_95 * math.sqrt(spread)) ** 3 for sign in (-1.0, 1.0))
    return low, high


def _stack(rows: list[FloatArray]) -> FloatArray:
    return np.array(rows) if rows else np.full((1, len(QUANTITIES)), np.nan)


def _largest(rows: FloatArray) -> FloatArray:
    finite = np.isfinite(rows)
    largest = np.where(finite, rows, -np.inf).max(axis=0)
    out: FloatArray = np.where(finite.any(axis=0), largest, np.nan)
    return out


def _times(values: list[float | None]) -> FloatArray:
    return np.array([math.inf if value is None else value for value in values], dtype=np.float64)
