"""`monte_carlo`: a scenario with many seeds; how large the errors are, and whether the sigmas tell the truth."""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, fields
from typing import Final

import numpy as np

from levelhead.analysis.comparison import chosen_methods
from levelhead.analysis.estimation import estimate
from levelhead.analysis.metrics import attitude_difference, rms, settling_time
from levelhead.analysis.trials import QUANTITIES, MonteCarlo, Trial
from levelhead.conventions import FloatArray
from levelhead.errors import LogError, UsageError
from levelhead.estimators import METHODS
from levelhead.estimators.base import Result, Status
from levelhead.estimators.params import FilterParams, MethodParams
from levelhead.estimators.streaming import Progress
from levelhead.estimators.trust import ACCEL_BAND, GYRO_BAND
from levelhead.sim import SCENARIOS, SensorModel, Truth, simulate
from levelhead.sim.simulation import ORIGIN_LLH

SAMPLE_S: Final = 10.0
"""Consistency is looked at this often, s: errors of attitude are forgotten by then, those of the biases are not."""
LIMIT_95: Final = 1.959964
"""A normal error is within this many sigma 95 % of the time."""
HORIZONTAL: Final = 2
"""The first two axes: what settling is about."""


@dataclass(frozen=True, kw_only=True)
class Task:
    """One run, as a worker process gets it."""

    scenario: str
    seed: int
    duration: float
    sensors: SensorModel
    earth_rotation: bool
    after: float
    params: Mapping[str, MethodParams]


def monte_carlo(
    scenario: str,
    runs: int,
    methods: Sequence[str] | None = None,
    *,
    duration: float = 600.0,
    sensors: SensorModel | None = None,
    params: Mapping[str, MethodParams] | None = None,
    seed0: int = 0,
    after: float | None = None,
    earth_rotation: bool = False,
    workers: int | None = None,
    progress: Progress | None = None,
) -> MonteCarlo:
    """Simulate a scenario many times and run every method on each drive.

    Parameters
    ----------
    scenario : str
        A key of `levelhead.sim.SCENARIOS`.
    runs : int
        Number of drives, with the seeds ``seed0``, ``seed0 + 1``...
    methods : sequence of str, optional
        Names from `levelhead.estimators.METHODS`; all of them where absent.
    duration : float
        Length of each drive, s.
    sensors : SensorModel, optional
        What the sensors do wrong; the same in every run but for the noise drawn.
    params : mapping, optional
        Constants by method. By default a method that takes noises gets the true ones (`true_noise`), any other its
        own defaults.
    seed0 : int
        Seed of the first run.
    after : float, optional
        Errors count from here on, s; the second half where absent.
    earth_rotation : bool
        Whether the gyros feel the Earth turn.
    workers : int, optional
        Processes; as many as there are processors where absent. 1 runs everything in this one. The figures do not
        depend on it. With more than one, a script needs the usual ``if __name__ == "__main__":`` round its call.
    progress : callable, optional
        Called with the fraction done.

    Returns
    -------
    MonteCarlo
        One trial per run and method; a method that fails on a drive is counted as failed there.

    Raises
    ------
    UsageError
        For an unknown scenario or method, or a number out of range.
    """
    sensors = SensorModel() if sensors is None else sensors
    names = chosen_methods(methods)
    after = 0.5 * duration if after is None else after
    workers = (os.cpu_count() or 1) if workers is None else workers
    _check(scenario, runs, duration, after, seed0, workers)
    constants = {name: (params or {}).get(name) or true_params(name, sensors, scenario) for name in names}
    tasks = [
        Task(
            scenario=scenario,
            seed=seed0 + k,
            duration=duration,
            sensors=sensors,
            earth_rotation=earth_rotation,
            after=after,
            params=constants,
        )
        for k in range(runs)
    ]
    if min(workers, runs) == 1:
        done = list(_one_by_one(tasks, progress))
    else:
        done = _in_parallel(tasks, min(workers, runs), progress)
    return MonteCarlo(
        scenario=scenario,
        runs=runs,
        seed0=seed0,
        duration=duration,
        after=after,
        imu_rate=sensors.imu_rate,
        gnss_rate=sensors.gnss_rate,
        params={name: constants[name].as_dict() for name in names},
        trials={name: tuple(run[k] for run in done) for k, name in enumerate(names)},
    )


STEADY: Final = 1e-6
"""Sideslip (rad) and distance from the axle (m) that are as good as none."""


def true_noise(sensors: SensorModel) -> dict[str, float]:
    """Return the noises of simulated sensors as a filter's constants, one-sided densities as in `NoiseParams`.

    White vibration of v m/s^2 RMS sampled at the rate f has the density v / sqrt(f / 2). Vibration in a band is not
    white and is left out.
    """
    vibration = sensors.vibration / math.sqrt(0.5 * sensors.imu_rate)
    return {
        "gyro_noise": sensors.gyro_noise,
        "accel_noise": math.hypot(sensors.accel_noise, vibration),
        "gyro_bias_walk": sensors.gyro_bias_walk,
        "accel_bias_walk": sensors.accel_bias_walk,
        "velocity_std": sensors.velocity_noise,
    }


def true_params(method: str, sensors: SensorModel, scenario: str | None = None) -> MethodParams:
    """Return a method's constants for simulated sensors: the true noises and lever arm, defaults for all else.

    A named scenario tells how far the vehicle slips sideways; without one it moves where it points.
    """
    kind = METHODS[method].params
    names = {field.name for field in fields(kind)}
    known: dict[str, object] = {}
    if "accel_noise" in names:
        # A noise of exactly 0 is left at the default: a filter would believe in it without end.
        known = {name: value for name, value in true_noise(sensors).items() if name in names and value > 0.0}
    # What a filter may take as unknown about the vehicle is known here.
    sideslip = 0.0 if scenario is None else SCENARIOS[scenario].sideslip
    vehicle = {"sideslip_std": max(STEADY, sideslip), "axle_std": max(STEADY, abs(sensors.imu_from_axle[0]))}
    clocks = {"timing_std": max(abs(sensors.gnss_latency), sensors.gnss_time_jitter)}
    known |= {name: value for name, value in (vehicle | clocks).items() if name in names}
    if issubclass(kind, FilterParams):
        # So is gravity, which the place tells: unknown, it is in the sigma of every accelerometer axis that tilts.
        known["latitude"] = ORIGIN_LLH[0]
    arm = sensors.dcm_imu_to_vehicle.T @ np.array(sensors.lever_arm)
    return kind.from_dict({**known, "lever_arm": tuple(float(v) for v in arm)})


def _check(scenario: str, runs: int, duration: float, after: float, seed0: int, workers: int) -> None:
    """Raise a sentence about the first argument that is out of range, before any process starts."""
    if scenario not in SCENARIOS:
        raise UsageError(f"There is no scenario {scenario!r}; choose one of {', '.join(SCENARIOS)}.")
    for name, value, least in (("runs", runs, 1), ("workers", workers, 1), ("seed", seed0, 0)):
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
            raise UsageError(f"{name} is {value!r}; give a whole number from {least} up.")
    if not (math.isfinite(duration) and 0.0 <= after < duration):
        raise UsageError(f"Errors would count after {after} s of a drive of {duration} s; give a time within it.")


def run_one(task: Task) -> tuple[Trial, ...]:
    """Simulate one drive and run every method on it; this is what a worker process does."""
    log, truth = simulate(
        task.scenario,
        seed=task.seed,
        duration=task.duration,
        sensors=task.sensors,
        earth_rotation=task.earth_rotation,
    )
    trials = []
    for method, params in task.params.items():
        try:
            result = estimate(log, method, params=params)
        except LogError as error:
            trials.append(Trial(seed=task.seed, failure=str(error)))
        else:
            trials.append(judge(result, truth, seed=task.seed, after=task.after))
    return tuple(trials)


def judge(result: Result, truth: Truth, *, seed: int, after: float) -> Trial:
    """Compare a result with the truth of its drive, sample by sample and with its own sigma."""
    time = result.time
    error = np.column_stack(
        (attitude_difference(result, truth), result.gyro_bias - truth.gyro_bias, result.accel_bias - truth.accel_bias)
    )
    gyro, accel = error[:, 3 : 3 + HORIZONTAL], error[:, 6 : 6 + HORIZONTAL]
    rows = np.searchsorted(time, np.arange(time[0] + after, time[-1], SAMPLE_S))
    sigma = np.column_stack((result.attitude_std[rows], result.gyro_bias_std[rows], result.accel_bias_std[rows]))
    normalised = _normalised(error[rows], sigma)
    given = np.isfinite(normalised)
    last = Status(int(result.status[-1]))
    return Trial(
        seed=seed,
        rms=rms(error[time - time[0] >= after]),
        gyro_settles=settling_time(time, gyro, GYRO_BAND),
        accel_settles=settling_time(time, accel, ACCEL_BAND),
        squared=rms(normalised) ** 2,
        covered=np.sum(np.abs(np.where(given, normalised, np.inf)) < LIMIT_95, axis=0),
        samples=given.sum(axis=0),
        gyro_flagged=Status.GYRO_SETTLED in last,
        accel_flagged=Status.ACCEL_SETTLED in last,
    )


def _normalised(error: FloatArray, sigma: FloatArray) -> FloatArray:
    """Return errors in units of their sigma; NaN where there is no sigma or no estimate."""
    if error.shape[1] != len(QUANTITIES):
        raise ValueError(f"{error.shape[1]} errors for {len(QUANTITIES)} quantities.")
    usable = np.isfinite(sigma) & (sigma > 0.0)
    out: FloatArray = np.where(usable, error / np.where(usable, sigma, 1.0), np.nan)
    return out


def _one_by_one(tasks: Sequence[Task], progress: Progress | None) -> Iterator[tuple[Trial, ...]]:
    for k, task in enumerate(tasks):
        yield run_one(task)
        if progress is not None:
            progress((k + 1) / len(tasks))


def _in_parallel(tasks: Sequence[Task], workers: int, progress: Progress | None) -> list[tuple[Trial, ...]]:
    """Run the tasks in fresh processes; the results are in the order of the tasks.

    On Ctrl-C what has not begun is dropped, and the call ends once the runs under way have.
    """
    # Fresh ("spawn") processes: a fork would copy locks that other threads, such as Arrow's, may hold.
    context = multiprocessing.get_context("spawn")
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(workers, mp_context=context)
    try:
        with _interrupts_held():
            futures: list[Future[tuple[Trial, ...]]] = [pool.submit(run_one, task) for task in tasks]
        for k, future in enumerate(as_completed(futures)):
            future.result()  # the first error ends it all
            if progress is not None:
                progress((k + 1) / len(tasks))
        return [future.result() for future in futures]
    except BrokenProcessPool:
        raise UsageError(
            "A worker process of the Monte Carlo runs ended before its work was done. In a script, put the call under "
            '`if __name__ == "__main__":`; where memory is short, pass fewer workers, or workers=1 to use none.'
        ) from None
    except KeyboardInterrupt:
        # Nobody waits for the drives under way, however busy the machine is.
        for worker in set(multiprocessing.active_children()) - others:
            worker.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Hold Ctrl-C back while processes start: they inherit that, and leave it to the parent for good.

    It reaches every process of a terminal; a worker that dies of it would only print a traceback.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
