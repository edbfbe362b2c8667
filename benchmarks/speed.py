"""Speed, as ratios within one run: `make bench`, or `python benchmarks/speed.py`.

Prints kernel ns per sample against a hand-written C loop of the same equations compiled with the same flags, the cost
of one streaming update from Python, and the whole command on an hour of 100 Hz data.
"""

from __future__ import annotations

import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import timeit
from pathlib import Path
from time import perf_counter

import numpy as np

import levelhead as lh
from levelhead.estimators import METHODS

HERE = Path(__file__).parent
# The flags of the extension module in CMakeLists.txt.
FLAGS = ["-O3", "-DNDEBUG", "-fPIC", "-ffp-contract=off"]


def build(folder: Path) -> Path:
    """Compile the yardstick and the kernel with the same flags; return the program."""
    program = folder / "kernel_loop"
    hand = folder / "hand_loop.o"
    subprocess.run(["cc", *FLAGS, "-c", str(HERE / "hand_loop.c"), "-o", str(hand)], check=True)
    include = f"-I{lh.get_include()}"
    command = ["c++", "-std=c++17", *FLAGS, include, str(HERE / "kernel_loop.cpp"), str(hand), "-o", str(program)]
    subprocess.run(command, check=True)
    return program


def write_drive(path: Path, duration: float) -> tuple[int, int]:
    """Write a drive as the program wants it; return its samples, and the samples per epoch."""
    log, _ = lh.simulate("field", seed=1, duration=duration)
    assert log.velocity_ned is not None
    pieces = (log.time, log.gyro, log.accel, log.velocity_ned)
    path.write_bytes(b"".join(np.ascontiguousarray(piece).tobytes() for piece in pieces))
    return log.time.size, round(log.time.size / log.gnss_time.size)


def kernel_table(folder: Path, rounds: int = 15) -> None:
    """Print ns per sample, medians over rounds in which the loops take turns, and instructions per sample."""
    program, data = build(folder), folder / "log.bin"
    samples, every = write_drive(data, 1800.0)
    command = [str(program), str(data), str(samples), str(every), str(rounds)]
    lines = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()
    names = [line.removeprefix("name ") for line in lines if line.startswith("name ")]
    times = np.array([[float(x) for x in line.split()[1:]] for line in lines if line.startswith("time")])
    biases = [line.split()[1:] for line in lines if line.startswith("bias")]
    observer = names.index("observer, double")
    ratios = np.median(times / times[:, observer : observer + 1], axis=0)
    counts = instructions(folder, program, len(names))
    print("Kernel, 30 min at 100 Hz / 10 Hz, one core; the ratio is to the observer in double")
    print(f"{'loop':26s}{'ns per sample':>14s}{'ratio':>8s}{'instructions':>14s}   final gyro x deg/s, accel x m/s^2")
    for name, time, ratio, bias, count in zip(names, np.median(times, axis=0), ratios, biases, counts, strict=True):
        shown = "-" if count is None else f"{count:.0f}"
        ends = f"{np.degrees(float(bias[0])):+.4f}  {float(bias[2]):+.4f}"
        print(f"{name:26s}{time:14.1f}{ratio:8.2f}{shown:>14s}   {ends}")
    print("Outside marks, instructions per sample: VQF (orientation only) 1,868; KF-GINS 98,700.")


def instructions(folder: Path, program: Path, loops: int) -> list[float | None]:
    """Return instructions per sample of each loop, counted by valgrind's callgrind, or None where it is not installed.

    The program is counted once without any loop, and that start-up is taken off.
    """
    if shutil.which("valgrind") is None:
        print("Instructions are not counted: valgrind is not installed (apt install valgrind).")
        return [None] * loops
    data = folder / "short.bin"
    samples, every = write_drive(data, 60.0)

    def count(loop: int) -> int:
        out = f"--callgrind-out-file={folder / 'callgrind.out'}"
        arguments = [str(data), str(samples), str(every), "1", str(loop)]
        command = ["valgrind", "--tool=callgrind", out, str(program), *arguments]
        said = subprocess.run(command, check=True, capture_output=True, text=True).stderr
        return int(said.split("Collected :")[1].split()[0])

    start_up = count(-1)
    return [(count(loop) - start_up) / samples for loop in range(loops)]


def _update_cost(gyro: object, accel: object, number: int = 200_000) -> float:
    """Return seconds per `update_imu`, the loop round it included: median of five runs."""
    setup = "update = Observer().update_imu; stamps = [0.01 * i for i in range(number)]"
    names = {"Observer": lh.Observer, "number": number, "gyro": gyro, "accel": accel}
    timer = timeit.Timer("for t in stamps: update(t, gyro, accel)", setup, globals=names)
    return statistics.median(timer.repeat(repeat=5, number=1)) / number


def streaming_table() -> None:
    """Print the cost of one update from Python, beside an empty method call."""
    print("\nStreaming from Python")
    print(f"{'call':44s}{'microseconds':>14s}")
    for label, gyro, accel in (
        ("update_imu, tuples", (0.0, 0.0, 0.1), (0.1, 0.2, -9.8)),
        ("update_imu, lists", [0.0, 0.0, 0.1], [0.1, 0.2, -9.8]),
        ("update_imu, NumPy arrays", np.array([0.0, 0.0, 0.1]), np.array([0.1, 0.2, -9.8])),
    ):
        print(f"{label:44s}{_update_cost(gyro, accel) * 1e6:14.2f}")
    est = lh.Observer()
    est.update_imu(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, -9.8))
    number = 50_000
    clock = iter(range(1, 10_000_000))
    imu, gnss = est.update_imu, est.update_gnss

    def pair() -> None:
        t = 0.1 * next(clock)
        imu(t, (0.0, 0.0, 0.1), (0.1, 0.2, -9.8))
        gnss(t, (3.0, 0.0, 0.0), 0.03)

    print(f"{'update_imu + update_gnss':44s}{timeit.timeit(pair, number=number) / number * 1e6:14.2f}")


def batch_table() -> None:
    """Print the time of each method over half an hour in memory, with its constants given, and over the observer's."""
    log, _ = lh.simulate("field", seed=1, duration=1800.0)
    print("\nlh.estimate, 30 min at 100 Hz / 10 Hz in memory, constants given; median of 9 rounds in turn")
    names = list(METHODS)
    noise = lh.NoiseParams()

    def run(method: str) -> float:
        chosen = METHODS[method]
        begin = perf_counter()
        lh.estimate(log, method, params=chosen.params(), noise=noise if chosen.takes_noise else None)
        return perf_counter() - begin

    times = np.median([[run(method) for method in names] for _ in range(9)], axis=0)
    for name, seconds in zip(names, times, strict=True):
        print(f"{name:26s}{seconds:10.3f} s{seconds / times[names.index('observer')]:8.2f}")


def command_table(folder: Path) -> None:
    """Print wall time and peak memory of `levelhead estimate` on an hour of 100 Hz Parquet, report included."""
    log, _ = lh.simulate("field", seed=1, duration=3600.0)
    path = folder / "hour.parquet"
    lh.write(log, path)
    command = [sys.executable, "-m", "levelhead", "estimate", str(path), "-o", str(folder / "out")]
    print("\nlevelhead estimate, 1 h at 100 Hz / 10 Hz, Parquet in, report included")
    walls = timeit.repeat(lambda: subprocess.run(command, check=True, capture_output=True), number=1, repeat=5)
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    print(f"wall: median {statistics.median(walls):.2f} s, fastest {min(walls):.2f} s; peak memory {peak:.0f} MB")


def main() -> None:
    """Print all tables."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        # First, while no larger child has run: peak memory of the children is a running maximum.
        command_table(folder)
        kernel_table(folder)
        batch_table()
        streaming_table()


if __name__ == "__main__":
    main()
