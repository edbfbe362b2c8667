"""The filters against each other: `make bench`, or `python benchmarks/filters.py [--seeds N]`.

Half an hour on the field and along swaths with the true noise parameters. The phasor filter against the 15-state Kalman
filter on the same logs (RMS after 600 s, settling); the smoother over the whole log, first second included; what five
times wrong noise parameters cost. Two kinds of vehicle: vibration as white noise of 0.1 m/s^2 (the default sensors),
and as an engine in a band of 12-40 Hz with the Earth turning and a vertical bias of 0.05 m/s^2.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

import levelhead as lh
from levelhead.analysis.metrics import settling_time
from levelhead.analysis.montecarlo import true_noise, true_params
from levelhead.conventions import FloatArray
from levelhead.estimators.params import FilterParams

AFTER = 600.0
DURATION = 1800.0
WHITE = lh.SensorModel()
ENGINE = lh.SensorModel(vibration=0.0, band_vibration=0.1, accel_bias=(0.11, 0.2, 0.05))
SCENARIOS = ("field", "windrower")


def rms(values: FloatArray) -> float:
    """Return the root mean square of everything."""
    return float(np.sqrt(np.mean(np.square(values))))


def tilt(result: lh.Result, truth: lh.Truth) -> FloatArray:
    """Return the errors of roll and pitch, deg."""
    return np.degrees(np.column_stack([result.roll - truth.roll, result.pitch - truth.pitch]))


def drives(scenario: str, sensors: lh.SensorModel, seeds: int) -> Iterator[tuple[lh.Log, lh.Truth]]:
    """Simulate one drive per seed."""
    for seed in range(seeds):
        earth = sensors is ENGINE
        log, truth = lh.simulate(scenario, seed=seed, duration=DURATION, sensors=sensors, earth_rotation=earth)
        # Velocities alone, as the papers have it; the positions serve for the latitude only.
        yield log, truth


def velocities_alone(method: str, sensors: lh.SensorModel) -> FilterParams:
    """Return the true noise; positions tell the latitude and nothing else."""
    params = true_params(method, sensors)
    assert isinstance(params, FilterParams)
    return replace(params, use_positions=False)


def figures(result: lh.Result, truth: lh.Truth) -> list[float]:
    """Return tilt, gyro, accel RMS after 600 s, tilt RMS over the whole log, both settling times."""
    late = result.time - result.time[0] >= AFTER
    gyro = np.degrees(result.gyro_bias - truth.gyro_bias)[:, :2]
    accel = (result.accel_bias - truth.accel_bias)[:, :2]
    angle = tilt(result, truth)
    settled = (settling_time(result.time, gyro, 0.02), settling_time(result.time, accel, 0.04))
    return [
        rms(angle[late]),
        rms(gyro[late]),
        rms(accel[late]),
        rms(angle[np.isfinite(angle).all(axis=1)]),
        *(math.inf if time is None else time for time in settled),
    ]


def accuracy_table(name: str, sensors: lh.SensorModel, seeds: int) -> None:
    """Print one row per scenario and filter, with the ratio to the Kalman filter."""
    params = {method: velocities_alone(method, sensors) for method in ("ekf", "phasor", "smoother")}
    print(
        f"\n{name}, {seeds} seeds; RMS after {AFTER:.0f} s, mean settling time; in brackets: over the Kalman filter's"
    )
    print(
        f"{'scenario':11s}{'method':10s}{'tilt deg':>16s}{'gyro deg/s':>18s}{'accel m/s^2':>18s}"
        f"{'gyro settles s':>18s}{'accel settles s':>18s}{'tilt, whole log':>18s}"
    )
    for scenario in SCENARIOS:
        rows: dict[str, list[list[float]]] = {method: [] for method in params}
        for log, truth in drives(scenario, sensors, seeds):
            for method, constants in params.items():
                rows[method].append(figures(lh.estimate(log, method, params=constants), truth))
        base = np.array(rows["ekf"])
        for method in params:
            table = np.array(rows[method])
            cells = []
            for column, digits in ((0, 4), (1, 5), (2, 5), (4, 1), (5, 1)):
                mean = np.mean if column >= 4 else rms
                value, against = mean(table[:, column]), mean(base[:, column])
                cells.append(f"{value:.{digits}f} ({value / against:.2f})")
            print(
                f"{scenario:11s}{method:10s}{cells[0]:>16s}{cells[1]:>18s}{cells[2]:>18s}{cells[3]:>18s}{cells[4]:>18s}"
                f"{rms(table[:, 3]):18.4f}"
            )


def robustness_table(seeds: int) -> None:
    """Print what noise parameters that are five times wrong cost in tilt."""
    print(f"\nNoise parameters wrong by a factor of five, {seeds} seeds: tilt RMS over that with the true ones")
    print(f"{'scenario':11s}{'method':10s}{'parameter':18s}{'a fifth':>9s}{'five times':>12s}")
    true = velocities_alone("phasor", WHITE)
    assert isinstance(true, lh.PhasorParams)
    for scenario in SCENARIOS:
        logs = [(replace(log, velocity_std=None), truth) for log, truth in drives(scenario, WHITE, seeds)]

        def error(params: lh.PhasorParams, method: str, logs: list[tuple[lh.Log, lh.Truth]] = logs) -> float:
            """Return the RMS of all drives: the filter's converged part, the smoother's whole."""
            late = slice(60_000, None) if method == "phasor" else slice(None)
            return rms(np.concatenate([tilt(lh.estimate(g, method, params=params), t)[late] for g, t in logs]))

        for method in ("phasor", "smoother"):
            base = error(true, method)
            for name in true_noise(WHITE):
                low, high = (error(replace(true, **{name: getattr(true, name) * f}), method) / base for f in (0.2, 5.0))
                print(f"{scenario:11s}{method:10s}{name:18s}{low:9.2f}{high:12.2f}")


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    seeds = parser.parse_args().seeds
    accuracy_table("White vibration of 0.1 m/s^2", WHITE, seeds)
    accuracy_table("Engine vibration in 12-40 Hz, Earth rotation, vertical bias", ENGINE, seeds)
    robustness_table(min(seeds, 5))


if __name__ == "__main__":
    main()
