"""Recorded logs of every format: what the reader and the preflight make of each, without any option.

    python benchmarks/formats.py DATA

DATA is a folder of recordings (`make drives DATA=folder`); every file and folder in it that holds an IMU is tried.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from time import perf_counter

import levelhead as lh
from levelhead.logs.log import Log
from levelhead.preflight import Finding, Preflight, Verdict, check

SUFFIXES = {".csv", ".ulg", ".bin", ".bag", ".mcap", ".ubx", ".sbf", ".mat", ".parquet", ".zip", ".txt"}


def recordings(folder: Path) -> Iterator[Path]:
    """Yield the logs in a folder: files by their suffix, and folders that are logs themselves."""
    for path in sorted(folder.iterdir()):
        if path.is_dir():
            if (path / "processed_log").is_dir() or (path / "oxts").is_dir():
                yield path
            else:
                yield from recordings(path)
        elif path.suffix.lower() in SUFFIXES:
            yield path


def conventions(found: Preflight) -> str:
    """Say in a line what was found of units, axes, frame, mounting and clock."""
    by_name = {f.name: f for f in found.findings}
    parts = []
    for name, key, shown in (
        ("accelerometer unit", "unit", "m/s^2"),
        ("gyro unit", "unit", "rad/s"),
        ("axes", "axes", "?"),
        ("velocity frame", "frame", "NED"),
    ):
        finding = by_name[name]
        value = str(finding.values.get(key, shown))
        parts.append(value + _doubt(finding))
    yaw, clock = by_name.get("mounting yaw"), by_name["clock"]
    if yaw is not None:
        parts.append(f"yaw {yaw.values['yaw_deg']:.2f}({yaw.values['yaw_std_deg']:.2f}) deg" + _doubt(yaw))
    if "latency_s" in clock.values:
        parts.append(f"clock {clock.values['latency_s']:+.3f}({clock.values['latency_std_s']:.3f}) s" + _doubt(clock))
    else:
        parts.append("clock ?")
    return ", ".join(parts)


def _doubt(finding: Finding) -> str:
    if finding.verdict is Verdict.UNDECIDED:
        return " (undecided)"
    return " (refused)" if finding.verdict is Verdict.REFUSED else ""


def row(path: Path, root: Path) -> str:
    """Return one line of the table."""
    name = str(path.relative_to(root))
    begin = perf_counter()
    try:
        log = lh.read(path)
    except lh.LevelheadError as error:
        return f"| {name} | | | {str(error)[:110]} | {perf_counter() - begin:.2f} | |"
    read = perf_counter()
    found = check(log)
    done = perf_counter()
    return f"| {name} | {_format(log)} | {_size(log)} | {conventions(found)} | {read - begin:.2f} | {done - read:.2f} |"


def _format(log: Log) -> str:
    gnss = log.meta.get("gnss_format")
    return f"{log.meta['format']}" + (f" + {gnss}" if gnss else "")


def _size(log: Log) -> str:
    about = log.describe()
    whole = "" if about["completeness"] == "complete" else f", {about['completeness']}"
    return f"{log.duration:.0f} s, {about['imu_rate_hz']:.0f} Hz, {about['gnss_rate_hz'] or 0.0:.1f} Hz{whole}"


def main() -> None:
    """Print the table."""
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    root = Path(sys.argv[1])
    print("| file | format | length, IMU, GNSS | found | read, s | check, s |\n|---|---|---|---|---|---|")
    for path in recordings(root):
        print(row(path, root), flush=True)


if __name__ == "__main__":
    main()
