"""Accuracy on simulated drives with known truth: `make bench`, or `python benchmarks/accuracy.py [--seeds N]`.

Half an hour at 100 Hz / 10 Hz with 0.03 m/s velocity noise (`levelhead.SensorModel`'s defaults). RMS errors are taken
from 900 s to the end and then over the seeds; "settles" is the last time an error was above 0.02 deg/s or 0.04 m/s^2.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass, replace

import numpy as np

import levelhead as lh
from levelhead.analysis.metrics import rms, settling_time
from levelhead.conventions import FloatArray

AFTER = 900.0
GYRO_BAND = np.radians(0.02)
ACCEL_BAND = 0.04


@dataclass(frozen=True, kw_only=True)
class Figures:
    """Errors of one run: (x, y) RMS after 900 s in deg/s and m/s^2, tilt (roll, pitch) in deg, settling times in s."""

    gyro: FloatArray
    accel: FloatArray
    tilt: FloatArray
    heading: float
    gyro_settles: float
    accel_settles: float


def figures(result: lh.Result, truth: lh.Truth) -> Figures:
    """Compare a result with the truth of its drive."""
    late = result.time - result.time[0] >= AFTER
    gyro = (result.gyro_bias - truth.gyro_bias)[:, :2]
    accel = (result.accel_bias - truth.accel_bias)[:, :2]
    tilt = np.column_stack([result.roll - truth.roll, result.pitch - truth.pitch])
    heading = (result.heading - truth.heading + np.pi) % (2.0 * np.pi) - np.pi
    settled = (settling_time(result.time, gyro, GYRO_BAND), settling_time(result.time, accel, ACCEL_BAND))
    return Figures(
        gyro=np.degrees(rms(gyro[late])),
        accel=rms(accel[late]),
        tilt=np.degrees(rms(tilt[late])),
        heading=float(np.degrees(rms(heading[late]))),
        gyro_settles=math.inf if settled[0] is None else settled[0],
        accel_settles=math.inf if settled[1] is None else settled[1],
    )


def accuracy_table(seeds: int) -> None:
    """Print one row per method and scenario."""
    print(f"After {AFTER:.0f} s, RMS over {seeds} seeds (worst seed in brackets)")
    print(
        f"{'method':10s} {'scenario':10s} {'gyro x, y deg/s':>26s} {'accel x, y m/s^2':>24s} "
        f"{'roll, pitch deg':>24s} {'heading':>8s} {'settles gyro, accel s (worst)':>32s}"
    )
    for method in ("observer", "two-stage"):
        for scenario in ("field", "windrower"):
            runs = []
            for seed in range(seeds):
                log, truth = lh.simulate(scenario, seed=seed, duration=1800.0)
                runs.append(figures(lh.estimate(log, method), truth))
            cells = []
            for name, digits in (("gyro", 4), ("accel", 4), ("tilt", 3)):
                values = np.array([getattr(run, name) for run in runs])
                mean, worst = rms(values), values.max(axis=0)
                cells.append(" ".join(f"{m:.{digits}f} ({w:.{digits}f})" for m, w in zip(mean, worst, strict=True)))
            heading = float(rms(np.array([run.heading for run in runs])))
            settles = [np.array([getattr(run, f"{name}_settles") for run in runs]) for name in ("gyro", "accel")]
            times = "  ".join(f"{np.median(s):.0f} ({s.max():.0f})" for s in settles)
            columns = f"{cells[0]:>26s} {cells[1]:>24s} {cells[2]:>24s} {heading:8.3f} {times:>32s}"
            print(f"{method:10s} {scenario:10s} {columns}")


def sensitivity_table(seeds: int) -> None:
    """Print how far the observer's estimates move when one constant changes by 20 %, as in the 2015 paper."""
    print("\nObserver, one constant changed by 20 %: RMS change after 900 s, largest over seeds and axes")
    print(f"{'constant':14s}{'change':>8s}{'gyro deg/s':>14s}{'accel m/s^2':>14s}")
    base = lh.ObserverParams()
    logs = [lh.simulate(s, seed=i, duration=1800.0)[0] for s in ("field", "windrower") for i in range(seeds)]
    before = [lh.estimate(log, "observer") for log in logs]
    for name in ("tau", "tau_gyro", "omega_accel"):
        for factor in (0.8, 1.2):
            params = replace(base, **{name: getattr(base, name) * factor})
            gyro, accel = [], []
            for log, reference in zip(logs, before, strict=True):
                late = log.time >= AFTER
                moved = lh.estimate(log, "observer", params=params)
                gyro.append(np.degrees(rms((moved.gyro_bias - reference.gyro_bias)[late, :2])).max())
                accel.append(rms((moved.accel_bias - reference.accel_bias)[late, :2]).max())
            print(f"{name:14s}{factor - 1.0:+8.0%}{max(gyro):14.5f}{max(accel):14.5f}")


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=8)
    seeds = parser.parse_args().seeds
    accuracy_table(seeds)
    sensitivity_table(min(seeds, 4))


if __name__ == "__main__":
    main()
