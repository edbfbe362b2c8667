"""What the commands show on the terminal: progress, the table of results, errors."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from levelhead.conventions import AXES
from levelhead.estimators.base import Result
from levelhead.estimators.streaming import Progress

if TYPE_CHECKING:
    from rich.console import Console


def terminal(*, errors: bool = False) -> Console:
    """Return the terminal to write to."""
    from rich.console import Console

    return Console(stderr=errors, highlight=False)


def plain(text: str) -> str:
    """Return text from a file or a file name with its control characters shown, so that it cannot steer a terminal."""
    return "".join(c if c.isprintable() or c == "\n" else repr(c)[1:-1] for c in text)


def say_error(sentence: str) -> None:
    """Write one sentence to stderr, without markup and wrapping."""
    sys.stderr.write(f"levelhead: {plain(sentence)}\n")


@contextmanager
def progress(task: str) -> Iterator[Progress]:
    """Show a bar on stderr while a long task runs; nothing where stderr is not a terminal."""
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    console = terminal(errors=True)
    with Bar(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        row = bar.add_task(task, total=1.0)

        def report(fraction: float) -> None:
            bar.update(row, completed=fraction)

        yield report


def show_result(result: Result, *, truth: dict[str, list[float]] | None = None) -> None:
    """Print the table of biases; `truth` (``gyro`` deg/s, ``accel`` m/s^2) adds a column for simulated drives."""
    from rich.table import Table

    summary = result.summary()
    table = Table(title=f"Biases after {result.time[-1] - result.time[0]:.0f} s, method {result.method}")
    for heading in ("sensor", "axis", "bias", *(("truth",) if truth else ()), "settled"):
        table.add_column(heading, justify="right" if heading in ("bias", "truth") else "left")
    for sensor, key, unit, digits in (
        ("gyro", "gyro_bias_deg_s", "deg/s", 4),
        ("accel", "accel_bias_m_s2", "m/s²", 3),
    ):
        values = summary[key]
        settled = result.settled_at_s.get(sensor)
        for i, axis in enumerate(AXES):
            value = values[i] if isinstance(values, list) else None
            shown = "unknown" if value is None else f"{value:+.{digits}f} {unit}"
            since = f"{settled:.0f} s" if settled is not None and value is not None else "–"
            exact = [f"{truth[sensor][i]:+.{digits}f} {unit}"] if truth else []
            table.add_row(sensor, axis, shown, *exact, since)
    console = terminal()
    console.print(table)
    angles = (math.degrees(float(a[-1])) for a in (result.roll, result.pitch, result.heading))
    console.print("At the end: roll {:.2f}°, pitch {:.2f}°, heading {:.1f}°.".format(*angles))
    for event in result.events:
        console.print(f"{event.code} ({event.count}×): {plain(event.text)}", markup=False)
