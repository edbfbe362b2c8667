"""Where the vehicle is: `make bench`, or `python benchmarks/navigation.py [--seeds N] [--data FOLDER]`.

The reference point under a tractor's roof antenna, drifts in GNSS outages with and without an axle that does not slide,
and the Earth's rotation in a tactical IMU's gyro biases; with recorded drives at hand, those too. Simulated clocks are
one and the simulated vehicle does not slide: the filters are told both.
"""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import levelhead as lh
from filters import rms
from levelhead.analysis.montecarlo import true_params
from levelhead.conventions import GRAVITY, FloatArray
from levelhead.earth import offset_ned, radii, shortest_turn
from levelhead.estimators.params import FilterParams
from levelhead.sim import SensorModel, outage_windows, without_gnss
from real_drives import KARLSRUHE, kitti_log, rtklib_drive, with_biases

GROUND = (0.0, 0.0, 3.0)
"""The point below a roof antenna beside which the IMU sits, m."""
VARIANTS: Mapping[str, tuple[str, bool, bool]] = {
    "EKF": ("ekf", False, False),
    "phasor": ("phasor", False, False),
    "phasor, axle": ("phasor", True, False),
    "phasor, axle, wheels": ("phasor", True, True),
    "smoother": ("smoother", False, False),
    "smoother, axle": ("smoother", True, False),
}
"""Rows of the outage table: method, whether the axle is known not to slide, whether the wheels are read."""


def across(off: FloatArray, heading: FloatArray) -> FloatArray:
    """Return the part of horizontal errors (n, 3) across the heading, to the right, m."""
    right: FloatArray = off[:, 1] * np.cos(heading) - off[:, 0] * np.sin(heading)
    return right


def constants(method: str, sensors: SensorModel, *, axle: bool = False) -> FilterParams:
    """Return the true noise of a simulation, and the axle where it shall count."""
    params = true_params(method, sensors)
    assert isinstance(params, FilterParams)
    return replace(params, rear_axle=(0.0, 0.0, 0.0)) if axle and isinstance(params, lh.PhasorParams) else params


def reference_table(seeds: int) -> None:
    """Print the error of the point on the ground, 3 m below the antenna."""
    print(f"Reference point 3 m below the roof antenna, RTK 2 cm at 10 Hz, {seeds} seeds; RMS after 300 s, mm")
    print(f"{'path':10s}{'':14s}{'across':>10s}{'along':>10s}{'height':>10s}{'error/sigma':>13s}")
    for scenario in ("field", "hill"):
        rows: dict[str, list[FloatArray]] = {"antenna": [], "EKF": [], "phasor": [], "smoother": []}
        roll = []
        for seed in range(seeds):
            log, truth = lh.simulate(scenario, seed=seed, duration=900.0)
            late = log.time >= 300.0
            place = truth.at(GROUND).position_llh
            roll.append(np.degrees(truth.roll[late]))

            def split(
                llh: FloatArray, place: FloatArray = place, late: NDArray[np.bool_] = late, t: lh.Truth = truth
            ) -> FloatArray:
                off = offset_ned(place, llh)[late]
                ahead = off[:, 0] * np.cos(t.heading[late]) + off[:, 1] * np.sin(t.heading[late])
                return np.column_stack([across(off, t.heading[late]), ahead, off[:, 2]])

            above = truth.position_llh - np.array([0.0, 0.0, 3.0])  # the antenna's place, taken for the point's
            rows["antenna"].append(np.column_stack([split(above), np.full(late.sum(), np.nan)]))
            for name, method in (("EKF", "ekf"), ("phasor", "phasor"), ("smoother", "smoother")):
                result = lh.estimate(log, method, params=constants(method, lh.SensorModel()), reference_point=GROUND)
                point = result.reference
                assert point is not None
                assert point.position_llh is not None
                assert point.position_std is not None
                off = offset_ned(place, point.position_llh)[late]
                ratio = np.sqrt(np.mean((off / point.position_std[late]) ** 2, axis=1))
                rows[name].append(np.column_stack([split(point.position_llh), ratio]))
        print(f"{scenario}: roll {rms(np.concatenate(roll)):.1f} deg RMS")
        for name, parts in rows.items():
            table = np.concatenate(parts)
            a, b, c, d = np.sqrt(np.mean(table**2, axis=0))
            print(f"{'':10s}{name:14s}{a * 1e3:10.1f}{b * 1e3:10.1f}{c * 1e3:10.1f}{d:13.2f}")


def outage_rows(scenario: str, length: float, seeds: int) -> dict[str, FloatArray]:
    """Return per variant (windows, 3): horizontal and vertical error where it is largest, and error over sigma."""
    sensors = SensorModel(wheel_speed=True, wheel_speed_noise=0.05, wheel_speed_scale=0.01)
    count = 20 // seeds
    duration = 400.0 + 180.0 * count
    rows: dict[str, list[list[float]]] = {name: [] for name in VARIANTS}
    for seed in range(seeds):
        log, truth = lh.simulate(scenario, seed=seed, duration=duration, speed=5.0, sensors=sensors)
        windows = outage_windows(400.0, duration - 60.0, length, count=count)
        holed = without_gnss(log, windows)
        for name, (method, axle, wheels) in VARIANTS.items():
            seen = holed if wheels else replace(holed, wheel_speed=None)
            result = lh.estimate(seen, method, params=constants(method, sensors, axle=axle))
            assert result.position_llh is not None
            assert result.position_std is not None
            off = offset_ned(truth.position_llh, result.position_llh)
            for window in windows:
                first, last = np.searchsorted(log.time, [window.start, window.start + length])
                # A filter is worst at the end; a smoother knows both ends.
                far = np.hypot(off[first:last, 0], off[first:last, 1])
                worst = first + int(np.argmax(far)) if method == "smoother" else int(last) - 1
                e, s = off[worst], result.position_std[worst]
                ratio = math.sqrt(0.5 * float(np.sum((e[:2] / s[:2]) ** 2)))
                rows[name].append([math.hypot(e[0], e[1]), abs(float(e[2])), ratio])
    return {name: np.array(values) for name, values in rows.items()}


def outage_table(seeds: int) -> None:
    """Print drifts after GNSS outages on converged filters, 5 m/s, 20 windows each."""
    print("\nGNSS outages at 5 m/s, 20 windows each: horizontal RMS, over the Kalman filter's, vertical, error/sigma")
    print("(filters at the end of the window, smoothers where they are worst within it)")
    for scenario in ("field", "windrower"):
        for length in (10.0, 30.0, 60.0):
            rows = outage_rows(scenario, length, seeds)
            base = rms(rows["EKF"][:, 0])
            for name, table in rows.items():
                h, v, ratio = (rms(table[:, i]) for i in range(3))
                print(f"{scenario:10s}{length:4.0f} s  {name:22s}{h:9.3f} m{h / base:8.3f}{v:9.3f} m{ratio:8.2f}")


def earth_table() -> None:
    """Print a tactical IMU's gyro bias errors at 60 deg of latitude: ten minutes at rest, then an hour's drive."""
    tactical = SensorModel(
        gyro_noise=math.radians(0.002),
        accel_noise=50e-6 * GRAVITY,
        vibration=0.0,
        band_vibration=0.1,
        gyro_bias=(math.radians(0.01), math.radians(-0.02), math.radians(0.015)),
        accel_bias=(0.02, -0.03, 0.01),
        gyro_bias_walk=2e-8,
        accel_bias_walk=2e-6,
    )
    origin = (math.radians(60.0), math.radians(10.0), 60.0)
    log, truth = lh.simulate(
        "field", seed=1, duration=4200.0, standstill_s=600.0, sensors=tactical, earth_rotation=True, origin_llh=origin
    )
    still = log.slice(0.0, 600.0)
    print("\nTactical IMU at 60 deg: gyro bias less truth (and one sigma), deg/h; the Earth turns by 15")

    def show(name: str, result: lh.Result, row: int) -> None:
        off = np.degrees(result.gyro_bias[row] - truth.gyro_bias[row]) * 3600.0
        sigma = np.degrees(result.gyro_bias_std[row]) * 3600.0
        cells = "".join(f"{o:+10.2f} ({s:.2f})" for o, s in zip(off, sigma, strict=True))
        print(f"{name:52s}{cells}")

    for method in ("phasor", "smoother"):
        result = lh.estimate(log, method, grade="tactical")
        show(f"{method}, after the hour's drive", result, -1)
        show(f"{method}, at the end of the standstill before it", result, 59_900)
    alone = lh.estimate(still, "phasor", grade="tactical")
    show("phasor, the standstill alone, heading unknown", alone, -1)
    heading = lh.Initial(heading=float(truth.heading[0]), heading_std=math.radians(0.5))
    show(
        "phasor, the standstill alone, heading known",
        lh.estimate(still, "phasor", grade="tactical", initial=heading),
        -1,
    )
    show("observer, after the drive", lh.estimate(log, "observer", grade="tactical"), -1)
    show("observer with MEMS constants, after the drive", lh.estimate(log, "observer"), -1)


def kitti_table(folder: Path) -> None:
    """Print position, velocity and heading on the KITTI drives, with positions made from the reference's velocity."""
    print("\nKITTI, 10 Hz, velocity 0.03 m/s and position 2 cm of noise, biases added; RMS after 120 s, (error/sigma)")
    print(f"{'drive':8s}{'method':10s}{'position m':>20s}{'velocity m/s':>22s}{'heading deg':>20s}")
    for path in sorted((folder / "kitti").glob("*.parquet")):
        log, reference, place = with_positions(path)
        for method in ("phasor", "smoother", "ekf"):
            params = lh.EkfParams(latitude=KARLSRUHE) if method == "ekf" else lh.PhasorParams(latitude=KARLSRUHE)
            biased = with_biases(log, np.radians([0.08, 0.13, 0.05]), np.array([0.11, 0.2, 0.0]))
            result = lh.estimate(biased, method, params=params)
            late = log.time > 120.0
            assert result.position_llh is not None
            assert result.position_std is not None
            off = offset_ned(place, result.position_llh)[late, :2]
            speed = result.velocity_ned - np.column_stack([reference[f"true_vel_{axis}"] for axis in "ned"])
            turn = shortest_turn(result.heading - reference["true_heading"])[late]
            cells = []
            for e, s in (
                (off, result.position_std[late, :2]),
                (speed[late], result.velocity_std[late]),
                (np.degrees(turn), np.degrees(result.attitude_std[late, 2])),
            ):
                good = np.isfinite(e)
                cells.append(f"{rms(e[good]):.3f} ({rms(e[good] / s[good]):.1f})")
            print(f"{path.stem[-4:]:8s}{method:10s}{cells[0]:>20s}{cells[1]:>22s}{cells[2]:>20s}")


def with_positions(path: Path) -> tuple[lh.Log, dict[str, FloatArray], FloatArray]:
    """Return a KITTI drive with positions: the reference's velocity integrated from a place of its own, plus noise."""
    log, reference = kitti_log(path)
    speed = np.column_stack([reference[f"true_vel_{axis}"] for axis in "ned"])
    step = 0.5 * (speed[1:] + speed[:-1]) * np.diff(log.time)[:, None]
    way = np.concatenate([np.zeros((1, 3)), np.cumsum(step, axis=0)])
    place = np.empty_like(way)
    meridian, normal = radii(np.array([KARLSRUHE]))
    place[:, 0] = KARLSRUHE + way[:, 0] / meridian
    place[:, 1] = way[:, 1] / (normal * np.cos(place[:, 0]))
    place[:, 2] = -way[:, 2]
    noise = np.random.default_rng(7).normal(0.0, 0.02, (log.gnss_time.size, 3))
    noise /= np.array([float(meridian[0]), float(normal[0]) * math.cos(KARLSRUHE), 1.0])
    fixes = np.column_stack([np.interp(log.gnss_time, log.time, place[:, axis]) for axis in range(3)]) + noise
    log = replace(log, position_llh=fixes, position_std=np.full(log.gnss_time.size, 0.02))
    return log, reference, place


def recorded_table(folder: Path) -> None:
    """Print positions alone on two drives of one sensor, and how positions agree on the car roof."""
    mapping = Path(__file__).parent.parent / "examples" / "mappings" / "neu-freecode.toml"
    print("\nneu-freecode, positions only, 1 Hz: accelerometer bias at the end of both drives, m/s^2 (one sigma)")
    found = []
    for drive in ("first_test", "town"):
        name = folder / "neu-freecode" / drive
        log = lh.read(f"{name}_imu.csv", gnss=f"{name}_gps.csv", mapping=mapping)
        result = lh.estimate(log)
        found.append(result.accel_bias[-1])
        cells = "".join(
            f"{b:+9.4f} ({s:.4f})" for b, s in zip(result.accel_bias[-1], result.accel_bias_std[-1], strict=True)
        )
        print(f"{drive:12s}{cells}   known {result.known_accel}, {[e.code for e in result.events]}")
    print(f"{'difference':12s}{np.round(found[1] - found[0], 4)}")
    log = rtklib_drive(folder)
    print("\nrtklib-drive, RTK 4 Hz: place less fix over both sigmas and the clocks', RMS north, east, down")
    assert log.position_llh is not None
    assert log.position_std is not None
    for method in ("phasor", "smoother"):
        result = lh.estimate(log, method)
        assert result.position_llh is not None
        assert result.position_std is not None
        row = np.searchsorted(log.time, log.gnss_time).clip(0, log.time.size - 1)
        use = (log.gnss_time > log.time[0] + 120.0) & (log.gnss_time < log.time[-1])
        off = offset_ned(log.position_llh, result.position_llh[row])[use]
        # Along the way the clocks may differ by as much as the filter reckons with.
        late = lh.PhasorParams().timing_std * result.velocity_ned[row]
        sigma = np.sqrt(result.position_std[row] ** 2 + log.position_std**2 + late**2)[use]
        good = np.isfinite(off).all(axis=1)
        ratio = np.sqrt(np.mean((off[good] / sigma[good]) ** 2, axis=0))
        print(
            f"{method:12s}{np.round(ratio, 2)}   RMS {np.round(1e3 * np.sqrt(np.mean(off[good] ** 2, axis=0)), 1)} mm"
        )


def main() -> None:
    """Print all tables; those of recorded drives where they are."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=4, help="drives per row; the outages take a divisor of 20")
    parser.add_argument("--data", default=os.environ.get("LEVELHEAD_DATA", "data"), help="folder of recorded drives")
    arguments = parser.parse_args()
    reference_table(arguments.seeds)
    outage_table(arguments.seeds)
    earth_table()
    folder = Path(arguments.data)
    if (folder / "rtklib-drive").is_dir():
        kitti_table(folder)
        recorded_table(folder)


if __name__ == "__main__":
    main()
