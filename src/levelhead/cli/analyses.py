"""What `compare`, `validate` and `simulate --compare` show on the terminal: one table each."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from levelhead.analysis.comparison import Comparison, Entry
from levelhead.cli.console import terminal
from levelhead.conventions import AXES
from levelhead.estimators.base import Result

if TYPE_CHECKING:
    from rich.table import Table

ABSENT = "–"
DEG = math.degrees(1.0)


def show_comparison(comparison: Comparison) -> None:
    """Print one column per method: biases with their sigma, when they settled, how far off roll and pitch are."""
    results = comparison.results
    table = _table("", *[entry.method for entry in comparison.entries])
    for sensor, unit, scale, digits in (("gyro", "deg/s", DEG, 4), ("accel", "m/s²", 1.0, 3)):
        for axis, name in enumerate(AXES):
            if any(math.isfinite(getattr(r, f"{sensor}_bias")[-1, axis]) for r in results.values()):
                cells = [_bias(entry.result, sensor, axis, scale, digits) for entry in comparison.entries]
                table.add_row(f"{sensor} {name}, {unit}", *cells)
    for sensor in ("gyro", "accel"):
        cells = [number(e.result.settled_at_s.get(sensor) if e.result else None, 0) for e in comparison.entries]
        table.add_row(f"{sensor} settled, s", *cells)
    for axis, name in enumerate(("roll", "pitch", "heading")):
        table.add_row(f"{name}, deg", *[_angle(entry, comparison, axis) for entry in comparison.entries])
    table.add_row("time, s", *[number(entry.runtime_s, 2) for entry in comparison.entries])
    console = terminal()
    console.print(table)
    against = "error" if comparison.truth is not None else f"difference to {comparison.reference}"
    console.print(
        f"Biases at the end, ± one sigma where the method gives it. Angles: RMS {against} after "
        f"{comparison.after_s:.0f} s.",
        markup=False,
    )


def _table(*headings: str) -> Table:
    """Return an empty table, narrow enough for six methods in 80 columns."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 2, 0, 0))
    for k, heading in enumerate(headings):
        table.add_column(heading, justify="right" if k else "left")
    return table


def number(value: float | None, digits: int, *, sign: bool = False) -> str:
    """Return a number as text, a dash for one that is absent."""
    if value is None or not math.isfinite(value):
        return ABSENT
    return f"{value:{'+' if sign else ''}.{digits}f}"


def _bias(result: Result | None, sensor: str, axis: int, scale: float, digits: int) -> str:
    """Return a bias and, below it, its sigma."""
    if result is None:
        return "failed"
    bias, sigma = (float(getattr(result, f"{sensor}_bias{s}")[-1, axis]) * scale for s in ("", "_std"))
    if not getattr(result, f"known_{sensor}")[axis] or not math.isfinite(bias):
        return "unknown"
    below = f"\n±{sigma:.{digits}f}" if math.isfinite(sigma) else ""
    return f"{bias:+.{digits}f}{below}"


def _angle(entry: Entry, comparison: Comparison, axis: int) -> str:
    if entry.errors is not None:
        return number(float(np.degrees(entry.errors.attitude[axis])), 3)
    if entry.method == comparison.reference:
        return ABSENT
    return number(float(np.degrees(entry.attitude_difference[axis])), 3)
