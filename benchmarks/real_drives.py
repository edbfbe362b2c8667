"""Real drives: `python benchmarks/real_drives.py [DATA_FOLDER]`, or the folder in LEVELHEAD_DATA.

Recorded logs have no true biases. The artificial-bias test of Tereshkov (2015), section 4, makes some: the estimates
with known biases added to the readings, less those without. For `rtklib-drive` the gyro is also compared with its mean
at rest after the drive; for KITTI the residual biases are about zero (a tactical unit, already corrected).
"""

from __future__ import annotations

import math
import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import levelhead as lh
from levelhead.conventions import FloatArray
from levelhead.estimators import METHODS
from levelhead.estimators.params import FilterParams

EXAMPLES = Path(__file__).parent.parent / "examples" / "mappings"
GYRO = np.radians([0.08, 0.13, 0.05])
ACCEL = np.array([0.11, 0.2, 0.0])
KARLSRUHE = math.radians(49.0)
"""Where the KITTI drives were recorded; the logs hold no positions."""


def with_biases(log: lh.Log, gyro: FloatArray, accel: FloatArray) -> lh.Log:
    """Return the log with known biases (rad/s, m/s^2) added to its readings."""
    return replace(log, gyro=log.gyro + gyro, accel=log.accel + accel)


def rtklib_drive(folder: Path) -> lh.Log:
    """Read the car-roof drive with its author's mounting and time offset."""
    return lh.read(
        folder / "rtklib-drive" / "imu_1934.csv",
        gnss=folder / "rtklib-drive" / "gnss_1934_sf.pos",
        mapping=EXAMPLES / "rtklib-gnss-imu.toml",
    )


def at_rest_after(log: lh.Log) -> FloatArray:
    """Return the mean gyro reading (3,) after the vehicle has stopped for good, rad/s."""
    assert log.velocity_ned is not None
    speed = np.hypot(log.velocity_ned[:, 0], log.velocity_ned[:, 1])
    stopped = log.gnss_time[np.flatnonzero(speed > 0.3)[-1]] + 2.0
    mean: FloatArray = log.gyro[(log.time > stopped) & (log.time < log.gnss_time[-1])].mean(axis=0)
    return mean


def kitti_log(
    path: Path, *, seed: int = 0, rate: float = 10.0, noise: float = 0.03
) -> tuple[lh.Log, dict[str, FloatArray]]:
    """Return a KITTI drive as a log, and its reference: velocity decimated and noised, no epoch inside an IMU gap.

    Samples whose stamp does not advance are left out (the recorder stepped back a few times).
    """
    import pyarrow.parquet as pq

    table = pq.read_table(path)
    columns = {name: np.asarray(table[name].to_numpy(), dtype=np.float64) for name in table.schema.names}
    stamp = columns["time"]
    keep = stamp > np.concatenate([[-np.inf], np.maximum.accumulate(stamp)[:-1]])
    columns = {name: values[keep] for name, values in columns.items()}
    time = columns["time"]
    grid = np.arange(time[0], time[-1], 1.0 / rate)
    right = np.searchsorted(time, grid, side="left").clip(1, time.size - 1)
    grid = grid[time[right] - time[right - 1] < 0.1]
    velocity = np.column_stack([np.interp(grid, time, columns[f"true_vel_{axis}"]) for axis in "ned"])
    velocity += np.random.default_rng(seed).normal(0.0, noise, velocity.shape)
    log = lh.Log(
        time=time,
        gyro=np.column_stack([columns[f"gyro_{axis}"] for axis in "xyz"]),
        accel=np.column_stack([columns[f"accel_{axis}"] for axis in "xyz"]),
        gnss_time=grid,
        velocity_ned=velocity,
        velocity_std=np.full(grid.size, noise),
        meta={"source": path.name, "format": "kitti", "completeness": "complete"},
    )
    return log, columns


def _show(values: FloatArray, digits: int) -> str:
    return " ".join(f"{v:+.{digits}f}" for v in values)


def rtklib_table(folder: Path) -> None:
    """Print the end of the drive against the gyro at rest, and the recovery of added biases."""
    log = rtklib_drive(folder)
    rest = np.degrees(at_rest_after(log))
    print(f"rtklib-drive: gyro at rest after the drive {_show(rest, 4)} deg/s; noise found from the log")
    added = "recovery error, 0.2 deg/s and 0.3 m/s^2 added"
    print(f"{'method':12s}{'gyro x, y at the end':>24s}{'less rest':>20s}{'sigma':>16s}{added:>50s}")
    results = {}
    for method in METHODS:
        plain = results[method] = lh.estimate(log, method)
        # The added biases are constants: they are recovered once the loop has settled, like any other.
        loaded = lh.estimate(with_biases(log, np.radians([0.2, 0.2, 0.0]), np.array([0.3, 0.3, 0.0])), method)
        end = np.degrees(plain.gyro_bias[-1, :2])
        gyro = np.degrees(loaded.gyro_bias[-1] - plain.gyro_bias[-1])[:2] - 0.2
        accel = (loaded.accel_bias[-1] - plain.accel_bias[-1])[:2] - 0.3
        recovered = f"{_show(gyro, 4)} deg/s {_show(accel, 4)} m/s^2"
        sigma = " ".join(f"{v:.4f}" for v in np.degrees(plain.gyro_bias_std[-1, :2]))
        print(f"{method:12s}{_show(end, 4):>24s}{_show(end - rest[:2], 4):>20s}{sigma:>16s}{recovered:>50s}")
    late = log.time > 120.0
    for method in ("ekf", "smoother"):
        apart = [getattr(results[method], a) - getattr(results["phasor"], a) for a in ("roll", "pitch")]
        rms = np.degrees(np.sqrt([np.nanmean(d[late] ** 2) for d in apart]))
        print(f"phasor and {method}: roll and pitch differ by {rms[0]:.4f}, {rms[1]:.4f} deg RMS after 120 s")


def kitti_table(folder: Path) -> None:
    """Print errors on the KITTI drives with biases added: at the end, and of roll and pitch after 120 s."""
    print("\nKITTI, 10 Hz velocity with 0.03 m/s noise, biases 0.08, 0.13, 0.05 deg/s and 0.11, 0.2, 0 m/s^2 added.")
    print("Filters: default constants and the latitude of Karlsruhe. In brackets: over the method's own sigma.")
    print(f"{'drive':7s}{'method':11s}{'gyro error at the end deg/s':>42s}{'accel error m/s^2':>30s}", end="")
    print(f"{'roll, pitch after 120 s, deg':>30s}{'both':>8s}")
    for path in sorted((folder / "kitti").glob("*.parquet")):
        log, reference = kitti_log(path)
        for method in ("observer", "two-stage", "phasor", "smoother", "ekf"):
            params = METHODS[method].params
            constants = params(latitude=KARLSRUHE) if issubclass(params, FilterParams) else None
            result = lh.estimate(with_biases(log, GYRO, ACCEL), method, params=constants)
            gyro = result.gyro_bias[-1] - GYRO
            accel = (result.accel_bias[-1] - ACCEL)[:2]
            late = log.time > 120.0
            tilt = np.column_stack([result.roll - reference["true_roll"], result.pitch - reference["true_pitch"]])[late]
            rms = np.degrees(np.nanstd(tilt, axis=0))
            cells = (
                _in_sigma(np.degrees(gyro), gyro / result.gyro_bias_std[-1]),
                _in_sigma(accel, accel / result.accel_bias_std[-1, :2]),
            )
            both = float(np.sqrt(np.mean(rms**2)))
            print(f"{path.stem[-4:]:7s}{method:11s}{cells[0]:>42s}{cells[1]:>30s}{_show(rms, 3):>30s}{both:8.3f}")


def _in_sigma(errors: FloatArray, ratios: FloatArray) -> str:
    return " ".join(f"{e:+.4f} ({r:+.1f})" for e, r in zip(errors, ratios, strict=True))


def main() -> None:
    """Print both tables, or say what is missing."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else os.environ.get("LEVELHEAD_DATA", "data"))
    if not (folder / "rtklib-drive").is_dir():
        sys.exit(f"{folder} has no recorded drives; name their folder as an argument or in LEVELHEAD_DATA.")
    rtklib_table(folder)
    kitti_table(folder)


if __name__ == "__main__":
    main()
