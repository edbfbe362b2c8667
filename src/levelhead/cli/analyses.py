"""What `compare`, `validate` and `simulate --compare` show on the terminal: one table each."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from levelhead.analysis.comparison import Comparison, Entry
from levelhead.analysis.injection import Case, Sensitivity, Validation, largest
from levelhead.analysis.outages import OutageTest
from levelhead.analysis.trials import QUANTITIES, Figures, MonteCarlo
from levelhead.cli.console import terminal
from levelhead.conventions import AXES, FloatArray
from levelhead.estimators.base import Result

if TYPE_CHECKING:
    from rich.table import Table

ABSENT = "–"
DEG = math.degrees(1.0)


def show_comparison(comparison: Comparison) -> None:
    """Print one column per method: biases with their sigma, when they settled, how far off roll and pitch are."""
    results = comparison.results
    table = plain_table("", *[entry.method for entry in comparison.entries])
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


def plain_table(*headings: str) -> Table:
    """Return an empty table, narrow enough for six methods in 80 columns."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    gap = 2 if len(headings) <= 6 else 1
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, gap, 0, 0))
    for k, heading in enumerate(headings):
        table.add_column(heading, justify="right" if k else "left", no_wrap=k == 0)
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


def show_monte_carlo(found: MonteCarlo) -> None:
    """Print one column per method: RMS errors, settling times, and how honest its sigma is."""
    figures = {method: found.figures(method) for method in found.trials}
    table = plain_table("", *figures)
    for k, (name, (_, unit, scale)) in enumerate(QUANTITIES.items()):
        if any(math.isfinite(f.rms[k]) for f in figures.values()):
            table.add_row(f"{name}, {unit}", *[_error(f, k, scale) for f in figures.values()])
    table.add_section()
    for sensor in ("gyro", "accel"):
        times = [getattr(f, f"{sensor}_settles") for f in figures.values()]
        table.add_row(f"{sensor} settles, s", *[_settles(t) for t in times])
        flags = [str(getattr(f, f"{sensor}_flagged")) for f in figures.values()]
        table.add_row(f"{sensor} called settled", *flags)
    if any(np.isfinite(f.coverage).any() for f in figures.values()):
        table.add_section()
        for k, name in enumerate(QUANTITIES):
            if any(math.isfinite(f.coverage[k]) for f in figures.values()):
                table.add_row(f"{name} covered", *[_coverage(f, k) for f in figures.values()])
    console = terminal()
    console.print(table)
    console.print(
        f"{found.runs} drives of {found.duration:.0f} s, {found.scenario}, seeds {found.seed0} to "
        f"{found.seed0 + found.runs - 1}. RMS errors after {found.after:.0f} s, below them the worst drive's. Settles: "
        "median, below it the worst drive. Covered: how often the error is within 1.96 sigma, 95 % if the sigma is "
        "honest; below it the mean squared error in sigma, 1 if honest, ! where that is outside its 95 % band.",
        markup=False,
    )
    for method, f in figures.items():
        for sentence in dict.fromkeys(f.failures.values()):
            count = sum(other == sentence for other in f.failures.values())
            console.print(f"{method} failed on {count} of {found.runs} drives: {sentence}", markup=False)


def _error(figures: Figures, k: int, scale: float) -> str:
    digits = 3 if k < 3 else 4
    return f"{number(figures.rms[k] * scale, digits)}\n{number(figures.worst[k] * scale, digits)}"


def _settles(times: FloatArray) -> str:
    if times.size == 0:
        return ABSENT
    median, worst = float(np.median(times)), float(times.max())
    return "\n".join(f"{t:.0f}" if math.isfinite(t) else "never" for t in (median, worst))


def _coverage(figures: Figures, k: int) -> str:
    if not math.isfinite(figures.coverage[k]):
        return ABSENT
    mark = "" if figures.honest[k] else "!"
    return f"{100.0 * figures.coverage[k]:.1f} %\n{mark}{figures.nees[k]:.2f}"


def show_validation(validation: Validation, changes: Sensitivity) -> None:
    """Print one row per case, then one per changed constant: the largest error or change over the axes."""
    console = terminal()
    table = plain_table("added", "gyro, deg/s", "accel, m/s²", "three sigma")
    for recovery in validation.recoveries:
        within = recovery.within_3_sigma
        judged = ABSENT if within is None else "within" if within else "BEYOND"
        table.add_row(
            _added(recovery.case),
            number(largest(recovery.gyro_error) * DEG, 4),
            number(largest(recovery.accel_error), 4),
            f"no longer known: {', '.join(recovery.lost)}" if recovery.lost else judged,
        )
    console.print(table)
    worst, mean = ((f("gyro") * DEG, f("accel")) for f in (validation.worst, validation.rms))
    console.print(
        f"{validation.method}, {len(validation.recoveries)} cases; recovery error at the end of the log, largest axis. "
        f"At most {number(worst[0], 4)} deg/s and {number(worst[1], 4)} m/s², RMS {number(mean[0], 4)} deg/s and "
        f"{number(mean[1], 4)} m/s².",
        markup=False,
    )
    table = plain_table("constant", "change", "gyro, deg/s", "accel, m/s²", "tilt RMS, deg")
    for change in changes.changes:
        cells = [number(largest(change.gyro) * DEG, 4), number(largest(change.accel), 4)]
        cells += [number(largest(change.tilt) * DEG, 3)]
        table.add_row(change.name, f"{change.change:+.0%}", *(["not possible"] if change.refused else cells))
    console.print(table)


def _added(case: Case) -> str:
    """Return what was added, per axis."""
    parts = [f"gyro {axis} {v * DEG:+.2f} deg/s" for axis, v in zip(AXES, case.gyro_bias, strict=True) if v]
    parts += [f"accel {axis} {v:+.1f} m/s²" for axis, v in zip(AXES, case.accel_bias, strict=True) if v]
    if len(parts) < 2:
        return "".join(parts) or "nothing"
    gyro = " ".join(f"{v * DEG:+.2f}" if v else "0" for v in case.gyro_bias)
    return f"{gyro}, {' '.join(f'{v:+.1f}' if v else '0' for v in case.accel_bias)}"


def show_outages(test: OutageTest) -> None:
    """Print one row per method: how far the position was from GNSS at the end of the outages."""
    console = terminal()
    if test.reason:
        console.print(f"Outages: {test.reason}", markup=False)
        return
    table = plain_table(
        f"{test.windows} outages of {test.length_s:g} s", "RMS, m", "median", "largest", "in sigma", "%"
    )
    for run in test.runs:
        if run.refused:
            continue
        cells = [number(value, 2) for value in run.figures("horizontal_m")]
        cells += [number(run.figures("in_sigma")[0], 2), number(run.figures("percent")[0], 2)]
        table.add_row(run.name, *cells)
    if table.row_count:
        console.print(table)
        console.print(
            "Horizontal distance from GNSS at the end of an outage: in metres, RMS in units of the claimed sigma, and "
            "RMS in per cent of the distance driven.",
            markup=False,
        )
    for sentence in dict.fromkeys(run.refused for run in test.runs if run.refused):
        console.print(f"Outages: {sentence}", markup=False)
