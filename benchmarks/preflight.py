"""The preflight on simulated drives whose axes, units, frames, clocks and mounting are drawn at random.

    python benchmarks/preflight.py [--drives 1000] [--seed 0] [--jobs 2]

Every drive is re-expressed in one of the 48 signed axes, rad/s or deg/s, m/s^2 or g, velocities in NED, ENU, NEU or
ECEF, with clocks up to 0.5 s apart, a mounting yaw up to 180 deg and a tilt up to 15 deg; nothing of that is
declared. Each finding is right, left undecided, or wrong though certain: the last must never be.
"""

from __future__ import annotations

import argparse
import itertools
import math
from collections import Counter, defaultdict
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

import levelhead as lh
from levelhead.conventions import GRAVITY, FloatArray
from levelhead.logs.pieces import FACTS
from levelhead.preflight import Preflight, Verdict, check
from levelhead.sim import SensorModel

TURNING: Final = ("field", "windrower", "hill", "reverse")
STRAIGHT: Final = ("straight", "circle")
AXES: Final = [
    np.eye(3)[list(order)] * np.array(signs)[:, None]
    for order in itertools.permutations(range(3))
    for signs in itertools.product((1.0, -1.0), repeat=3)
]
FRAMES: Final = {
    "NED": np.eye(3),
    "ENU": np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
    "NEU": np.diag([1.0, 1.0, -1.0]),
}
AXES_RIGHT: Final = math.radians(3.0)
"""Axes are right where the whole rotation is, to this angle: besides the yaw there is the tilt of the ground, rad."""
YAW_RIGHT: Final = math.radians(0.5)
LATENCY_RIGHT_S: Final = 0.010
SIGMAS_RIGHT: Final = 4.0
"""A clock offset or a yaw is wrong where it is further off than this many of the sigmas that are told with it."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """What is wrong with one drive."""

    scenario: str
    duration: float
    speed: float
    axes: int
    gyro_unit: str
    accel_unit: str
    frame: str
    positions: bool
    latency: float
    yaw: float
    pitch: float
    roll: float
    gnss_rate: float
    vibration: float
    seed: int


def cases(count: int, seed: int) -> Iterator[Case]:
    """Yield random drives; one in seven never turns, or never straightens."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        frame = str(rng.choice(["NED", "ENU", "NEU", "ECEF"]))
        yield Case(
            scenario=str(rng.choice(TURNING if k % 7 else STRAIGHT)),
            duration=float(rng.choice([600.0, 900.0, 1800.0])),
            speed=float(rng.choice([2.0, 3.0, 6.0, 12.0])),
            axes=int(rng.integers(48)),
            gyro_unit=str(rng.choice(["rad/s", "deg/s"])),
            accel_unit=str(rng.choice(["m/s^2", "g"])),
            frame=frame,
            positions=frame == "ECEF" or bool(rng.random() < 0.6),
            latency=float(rng.uniform(-0.5, 0.5)),
            yaw=float(rng.uniform(-math.pi, math.pi)),
            pitch=math.radians(float(rng.uniform(-15.0, 15.0))),
            roll=math.radians(float(rng.uniform(-15.0, 15.0))),
            gnss_rate=float(rng.choice([1.0, 5.0, 10.0])),
            vibration=float(rng.choice([0.05, 0.1, 0.3])),
            seed=1000 * seed + k,
        )


def log_of(case: Case) -> lh.Log:
    """Simulate a case and re-express it."""
    rng = np.random.default_rng(case.seed)
    sensors = SensorModel(
        gnss_latency=case.latency,
        gnss_rate=case.gnss_rate,
        vibration=case.vibration,
        mounting_yaw=case.yaw,
        mounting_pitch=case.pitch,
        mounting_roll=case.roll,
        gyro_bias=tuple(np.radians(rng.uniform(-0.3, 0.3, 3))),
        accel_bias=tuple(rng.uniform(-0.3, 0.3, 3)),
    )
    log, _ = lh.simulate(case.scenario, seed=case.seed, duration=case.duration, speed=case.speed, sensors=sensors)
    turn = AXES[case.axes]
    assert log.velocity_ned is not None
    if case.frame == "ECEF":
        import pymap3d

        assert log.position_llh is not None
        north, east, down = log.velocity_ned.T
        latitude, longitude, _ = log.position_llh.T
        velocity = np.column_stack(pymap3d.enu2ecefv(east, north, -down, latitude, longitude, deg=False))
    else:
        velocity = log.velocity_ned @ FRAMES[case.frame].T
    return replace(
        log,
        gyro=(log.gyro if case.gyro_unit == "rad/s" else np.degrees(log.gyro)) @ turn.T,
        accel=(log.accel if case.accel_unit == "m/s^2" else log.accel / GRAVITY) @ turn.T,
        velocity_ned=velocity,
        position_llh=log.position_llh if case.positions else None,
        position_std=log.position_std if case.positions else None,
        meta={**log.meta, "undeclared": FACTS},
    )


def judged(case: Case) -> dict[str, tuple[str, float, float]]:
    """Run one case: verdict, error and its sigma by what was to be found."""
    found = check(log_of(case))
    verdicts = {f.name: f.verdict for f in found.findings}
    truth = _rotation(case)
    results: dict[str, tuple[str, float, float]] = {}

    def put(name: str, finding: str, error: float, limit: float, sigma: float = 0.0) -> None:
        decided = verdicts.get(finding) in (Verdict.FINE, Verdict.CORRECTED)
        bound = max(limit, SIGMAS_RIGHT * sigma)
        results[name] = ("undecided" if not decided else "right" if error <= bound else "wrong", error, sigma)

    fix = found.corrections
    factor = {"rad/s": 1.0, "deg/s": math.pi / 180.0, "m/s^2": 1.0, "g": GRAVITY}
    put("gyro unit", "gyro unit", abs(math.log(fix.gyro_factor / factor[case.gyro_unit])), 1e-6)
    put("accelerometer unit", "accelerometer unit", abs(math.log(fix.accel_factor / factor[case.accel_unit])), 1e-6)
    put("velocity frame", "velocity frame", float(fix.velocity_frame != case.frame), 0.5)
    tilt = _tilt(found, truth, case)
    put("axes", "axes", tilt[0], AXES_RIGHT)
    yaw = next((f.values for f in found.findings if f.name == "mounting yaw"), {})
    yaw_std = math.radians(float(str(yaw.get("yaw_std_deg", 0.0))))
    put("mounting yaw", "mounting yaw", tilt[1], YAW_RIGHT, yaw_std)
    clock = next((f.values for f in found.findings if f.name == "clock"), {})
    sigma = float(str(clock.get("latency_std_s", 0.0)))
    put("clock", "clock", abs(fix.latency_s - case.latency), LATENCY_RIGHT_S, sigma)
    return results


def _rotation(case: Case) -> FloatArray:
    """Return the rotation from the file's axes to the vehicle's (mirrored for half of the 48)."""
    sensors = SensorModel(mounting_yaw=case.yaw, mounting_pitch=case.pitch, mounting_roll=case.roll)
    return np.asarray(sensors.dcm_imu_to_vehicle @ AXES[case.axes].T)


def _tilt(found: Preflight, truth: FloatArray, case: Case) -> tuple[float, float]:
    """Return how far the corrected axes are off beyond a mounting tilt, which is kept, and the yaw, rad."""
    # Vehicle axes seen from the corrected body: a rotation by the mounting's tilt alone, if all is right.
    left = truth @ found.corrections.accel_dcm.T
    gyro = truth @ found.corrections.gyro_dcm.T
    yaw = math.atan2(left[1, 0], left[0, 0])
    kept = math.hypot(case.pitch, case.roll) + math.radians(2.0)
    proper = np.linalg.det(left) > 0.0 and np.linalg.det(gyro) > 0.0 and left[2, 2] > math.cos(2.0 * kept)
    beyond = abs(yaw) if proper and left[0, 0] > 0.0 else math.pi
    return beyond, abs(yaw)


def _run(case: Case) -> tuple[Case, dict[str, tuple[str, float, float]]]:
    return case, judged(case)


def main() -> None:
    """Print the table of what was found, and every wrong answer."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drives", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--why", action="store_true", help="list what was left undecided on drives that turn")
    options = parser.parse_args()
    counts: dict[tuple[str, str], Counter[str]] = defaultdict(Counter)
    errors: dict[str, list[float]] = defaultdict(list)
    over: dict[str, list[float]] = defaultdict(list)
    wrong: list[Any] = []
    unsure: list[Any] = []
    with ProcessPoolExecutor(options.jobs) as pool:
        for case, results in pool.map(_run, cases(options.drives, options.seed), chunksize=4):
            kind = "turning" if case.scenario in TURNING else "straight or circle"
            for name, (verdict, error, sigma) in results.items():
                counts[kind, name][verdict] += 1
                if verdict != "undecided":
                    errors[name].append(error)
                    if sigma:
                        over[name].append(error / sigma)
                if verdict == "undecided" and kind == "turning":
                    unsure.append((name, error, case))
                if verdict == "wrong":
                    wrong.append((name, error, case))
    for name, reason, case in unsure if options.why else []:
        print(f"undecided {name}: {reason} {case}")
    print(f"{'drives':20s} {'what':20s} {'right':>6s} {'undecided':>10s} {'certain but wrong':>18s}")
    for (kind, name), counter in counts.items():
        print(f"{kind:20s} {name:20s} {counter['right']:6d} {counter['undecided']:10d} {counter['wrong']:18d}")
    for name, unit, scale, right in (
        ("clock", "ms", 1e3, LATENCY_RIGHT_S),
        ("mounting yaw", "deg", 180.0 / math.pi, YAW_RIGHT),
    ):
        if errors[name]:
            rms, most = np.sqrt(np.mean(np.square(errors[name]))) * scale, max(errors[name]) * scale
            good = 100.0 * float(np.mean(np.array(errors[name]) <= right))
            share = f"{good:.1f} % within {right * scale:g}"
            honest = (
                f"error over sigma {np.sqrt(np.mean(np.square(over[name]))):.2f} RMS, {max(over[name]):.1f} at most"
            )
            print(f"{name}, where decided: {rms:.2f} {unit} RMS, {share}, all within {most:.2f}; {honest}")
    for name, error, case in wrong:
        print(f"wrong {name}: {error:.4f} {case}")


if __name__ == "__main__":
    main()
