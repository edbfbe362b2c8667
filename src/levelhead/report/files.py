"""The files of a result: each is written beside its place and renamed, so a folder never holds half of one."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from levelhead.atomic import atomic_path
from levelhead.conventions import AXES, FloatArray
from levelhead.errors import OutputError, UsageError
from levelhead.estimators.base import Result
from levelhead.logs.result_track import RESULT_KEY
from levelhead.logs.writers import write_table
from levelhead.report.html import render_report
from levelhead.sim import Truth

Column = NDArray[Any]
"""Of a result: float64, but for `status` (uint32) and `heading_source` (uint8)."""
PLACE: Final = (("latitude", "rad"), ("longitude", "rad"), ("height", "m"))


def make_folder(folder: Path) -> Path:
    """Make a folder for results, with its parents; an OutputError says why it cannot be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"The folder {folder} cannot be made: {error.strerror}. Name another one with -o.") from None
    return folder


def result_columns(result: Result) -> tuple[dict[str, Column], dict[str, str]]:
    """Return the columns of `result.parquet` and their units, SI and radians."""
    columns: dict[str, Column] = {"time": result.time}
    units = {"time": "s"}

    def put(name: str, values: Column, unit: str) -> None:
        columns[name] = values
        units[name] = unit

    for name, unit in (("gyro_bias", "rad/s"), ("accel_bias", "m/s^2")):
        for suffix in ("", "_std"):
            for i, axis in enumerate(AXES):
                put(f"{name}{suffix}_{axis}", getattr(result, name + suffix)[:, i], unit)
    for i, name in enumerate(("roll", "pitch", "heading")):
        put(name, getattr(result, name), "rad")
        put(f"{name}_std", result.attitude_std[:, i], "rad")
    for i, axis in enumerate("ned"):
        put(f"velocity_{axis}", result.velocity_ned[:, i], "m/s")
    put("status", result.status, "flags")
    if result.position_llh is not None:
        for i, (name, unit) in enumerate(PLACE):
            put(name, result.position_llh[:, i], unit)
    for name, (values, unit) in _navigation_columns(result).items():
        put(name, values, unit)
    return columns, units


def _navigation_columns(result: Result) -> dict[str, tuple[Column, str]]:
    """Return the columns with their units that came with the navigation: behind the older ones, whose order stays."""
    columns: dict[str, tuple[Column, str]] = {}

    def put_ned(name: str, rows: FloatArray | None, unit: str) -> None:
        if rows is not None:
            columns.update({f"{name}_{axis}": (rows[:, i], unit) for i, axis in enumerate("ned")})

    put_ned("velocity_std", result.velocity_std, "m/s")
    put_ned("position_std", result.position_std, "m")
    columns["heading_source"] = result.heading_source, "enum"
    point = result.reference
    if point is None:
        return columns
    if point.position_llh is not None:
        columns.update({f"reference_{name}": (point.position_llh[:, i], unit) for i, (name, unit) in enumerate(PLACE)})
    put_ned("reference_position_std", point.position_std, "m")
    put_ned("reference_velocity", point.velocity_ned, "m/s")
    put_ned("reference_velocity_std", point.velocity_std, "m/s")
    columns["cross_track_correction"] = point.cross_track, "m"
    columns["height_correction"] = point.height, "m"
    return columns


def write_result(result: Result, path: Path) -> None:
    """Write `result.parquet`."""
    columns, units = result_columns(result)
    origin = {"log": dict(result.log_info), "method": result.method}
    write_table(columns, units, path, {RESULT_KEY: json.dumps(origin).encode()})


def write_summary(result: Result, path: Path) -> None:
    """Write `summary.json`."""
    write_json(result.summary(), path)


def write_json(content: Mapping[str, object], path: Path) -> None:
    """Write a JSON file for people and scripts: indented, without NaN."""
    write_text(json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n", path)


def write_text(text: str, path: Path) -> None:
    """Write a text file, UTF-8, whole or not at all."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_report(result: Result, path: Path, *, title: str, reference: Mapping[str, FloatArray] | None = None) -> None:
    """Write `report.html`; `reference` is the truth of a simulated drive."""
    write_text(render_report(result, title=title, reference=reference), path)


def write_truth(truth: Truth, path: Path) -> None:
    """Write the truth of a simulated drive, SI and radians."""
    units = {"time": "s", "roll": "rad", "pitch": "rad", "heading": "rad", "latitude": "rad", "longitude": "rad"}
    columns = dict(truth.columns())
    prefixes = {
        "gyro_bias": "rad/s",
        "accel_bias": "m/s^2",
        "velocity": "m/s",
        "height": "m",
        "angular_rate": "rad/s",
        "specific_force": "m/s^2",
        "relative_rate": "rad/s",
    }
    for name in columns:
        units.setdefault(name, next((unit for prefix, unit in prefixes.items() if name.startswith(prefix)), ""))
    write_table(columns, units, path)


def read_truth(path: Path) -> Truth:
    """Read a truth that `write_truth` wrote.

    Raises
    ------
    UsageError
        When the file does not exist or is not a truth.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.read_table(path, use_threads=False)
        columns = {name: np.asarray(table[name].to_numpy(), dtype=np.float64) for name in table.column_names}
        rows = {
            name: np.column_stack([columns[f"{prefix}_{axis}"] for axis in axes])
            for name, prefix, axes in (
                ("gyro_bias", "gyro_bias", AXES),
                ("accel_bias", "accel_bias", AXES),
                ("velocity_ned", "velocity", "ned"),
                ("angular_rate", "angular_rate", AXES),
                ("specific_force", "specific_force", AXES),
            )
        }
        if "relative_rate_x" in columns:
            rows["relative_rate"] = np.column_stack([columns[f"relative_rate_{axis}"] for axis in AXES])
        rows["position_llh"] = np.column_stack([columns[name] for name in ("latitude", "longitude", "height")])
        return Truth(**rows, **{name: columns[name] for name in ("time", "roll", "pitch", "heading")})
    except (OSError, pa.ArrowException, KeyError, ValueError, TypeError) as error:
        reason = f"it has no column {error}" if isinstance(error, KeyError) else str(error).splitlines()[0].rstrip(".")
        raise UsageError(
            f"{path} cannot be read as the truth of a simulated drive ({reason}); `levelhead simulate` writes one "
            "beside its log."
        ) from None
