"""The report's section on navigation: how well the position is known with GNSS and without, and what the slope does."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import FloatArray
from levelhead.estimators.base import ReferencePoint, Result, Status
from levelhead.estimators.navigation import corrections, has, heading_shares, outages
from levelhead.report import tables
from levelhead.report.decimate import minmax_indices
from levelhead.report.page import figure
from levelhead.report.plots import Curve, Plot

SOURCES: Final[dict[str, str]] = {
    "course": "course",
    "reverse": "course, reversed",
    "stationary": "standstill: held",
    "inertial": "gyros alone",
    "none": "not known yet",
}
"""Where the heading comes from, in the order of the table, and what the reader is told."""
DIGITS: Final = 3


def navigation_plots(result: Result) -> tuple[Plot, ...]:
    """Prepare the plots over time of the section: horizontal sigma, and the slope compensation of a reference point.

    Parameters
    ----------
    result : Result
        What to show; without estimated positions there is nothing.
    """
    if result.position_std is None:
        return ()
    labels, sigmas = ["IMU"], [result.position_std[:, :2].max(axis=1)]
    point = result.reference
    if point is not None and point.position_std is not None:
        labels.append("reference point")
        sigmas.append(point.position_std[:, :2].max(axis=1))
    sigma = _plot(
        Plot(
            name="position-sigma",
            title="Horizontal position sigma",
            unit="m",
            decimals=4,
            time=result.time,
            curves=(),
            absent="No position is known.",
            focused=True,
        ),
        labels,
        sigmas,
    )
    if point is None:
        return (sigma,)
    slope = Plot(
        name="slope",
        title="Slope compensation",
        unit="m",
        decimals=4,
        time=result.time,
        curves=(),
        absent="The attitude was never known, so that nothing could be compensated.",
        focused=True,
    )
    return sigma, _plot(slope, ["cross-track", "height"], [point.cross_track, point.height])


def _plot(frame: Plot, labels: Sequence[str], columns: Sequence[FloatArray]) -> Plot:
    """Return the frame with curves, decimated."""
    table = np.column_stack(columns)
    kept = minmax_indices(table)
    return Plot(
        name=frame.name,
        title=frame.title,
        unit=frame.unit,
        decimals=frame.decimals,
        time=frame.time[kept],
        curves=tuple(Curve(label=label, values=table[kept, k], tone=k) for k, label in enumerate(labels)),
        absent=frame.absent,
        focused=frame.focused,
    )


def navigation_section(result: Result, plots: Sequence[Plot]) -> str:
    """Return the section with its tables and the frames of its plots; empty without estimated positions; HTML."""
    if result.position_std is None:
        return ""
    cards = [_sigma_table(result, result.position_std), _source_table(result)]
    if result.reference is not None:
        cards.append(_point_table(result.reference, has(result, Status.COASTING)))
    return (
        '<section aria-labelledby="navigation"><h2 id="navigation">Navigation</h2>'
        f'<p class="lead">{_verdict(result, result.position_std)}</p><div class="cards">'
        + "".join(f'<div class="card scroll">{card}</div>' for card in cards)
        + f'</div><div class="plots">{"".join(figure(plot) for plot in plots)}</div></section>'
    )


def _verdict(result: Result, position_std: FloatArray) -> str:
    """Say in a sentence or two how well the position is known; HTML."""
    coasting = has(result, Status.COASTING)
    horizontal = position_std[:, :2].max(axis=1)
    aided = _median(horizontal[~coasting])
    if not math.isfinite(aided):
        return "No position was ever known."
    text = f"With GNSS the position is known to {_metres(aided)} horizontally, one sigma (median)."
    found = outages(result)
    if not found.count:
        return f"{text} There was no GNSS outage."
    worst = _largest(horizontal[coasting])
    times = "one outage" if found.count == 1 else f"{found.count} outages, the longest"
    return f"{text} In {times} of {tables.span(found.longest_s)} it grew to at most {_metres(worst)}."


def _sigma_table(result: Result, position_std: FloatArray) -> str:
    coasting = has(result, Status.COASTING)
    rows = []
    for name, unit, std in (("position", "m", position_std), ("velocity", "m/s", result.velocity_std)):
        for axis, direction in enumerate(("north", "east", "down")):
            column = std[:, axis]
            values = (_median(column[~coasting]), _largest(column[coasting]), float(column[-1]))
            cells = "".join(f"<td>{tables.number(value, DIGITS)}</td>" for value in values)
            rows.append(f'<tr><th scope="row">{name} {direction}, {unit}</th>{cells}</tr>')
    return (
        '<table class="matrix"><caption>One sigma</caption><thead><tr><th scope="col"></th>'
        '<th scope="col">with GNSS<small>median</small></th><th scope="col">without<small>largest</small></th>'
        '<th scope="col">at the end</th></tr></thead><tbody>' + "\n".join(rows) + "</tbody></table>"
    )


def _source_table(result: Result) -> str:
    found = outages(result)
    standing = float(np.mean(has(result, Status.STATIONARY)))
    shares = heading_shares(result)
    entries = [
        ("GNSS outages", str(found.count)),
        ("longest outage", tables.span(found.longest_s) if found.count else tables.ABSENT),
        ("all outages together", tables.span(found.total_s) if found.count else tables.ABSENT),
        ("found standing", _percent(standing)),
        *((f"heading: {text}", _percent(shares[name])) for name, text in SOURCES.items()),
    ]
    return _two_columns("Outages, standstill, heading", "shares of the time", entries)


def _point_table(point: ReferencePoint, coasting: NDArray[np.bool_]) -> str:
    cross_rms, cross_max, height_rms, height_max = corrections(point)
    entries = [
        ("forward / right / down of the IMU", "\u00a0/\u00a0".join(f"{v:g}" for v in point.point) + "\u00a0m"),
    ]
    if point.position_std is not None:
        horizontal, vertical = point.position_std[:, :2].max(axis=1), point.position_std[:, 2]
        entries += [
            ("horizontal sigma with GNSS, median", _metres(_median(horizontal[~coasting]))),
            ("horizontal sigma without, largest", _metres(_largest(horizontal[coasting]))),
            ("vertical sigma with GNSS, median", _metres(_median(vertical[~coasting]))),
        ]
    entries += [
        ("cross-track correction, RMS", _metres(cross_rms)),
        ("cross-track correction, largest", _metres(cross_max)),
        ("height correction, RMS", _metres(height_rms)),
        ("height correction, largest", _metres(height_max)),
    ]
    remark = "corrections: what the slope moves it by"
    return _two_columns("Reference point", remark, entries)


def _two_columns(title: str, remark: str, entries: Sequence[tuple[str, str]]) -> str:
    rows = [f'<tr><th scope="row">{name}</th><td>{value}</td></tr>' for name, value in entries]
    return (
        f'<table class="matrix plain"><caption>{title} <small>{remark}</small></caption><tbody>'
        + "\n".join(rows)
        + "</tbody></table>"
    )


def _metres(value: float) -> str:
    return tables.number(value, DIGITS, "m")


def _percent(share: float) -> str:
    return tables.number(100.0 * share, 1, "%")


def _median(values: FloatArray) -> float:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else math.nan


def _largest(values: FloatArray) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.max()) if finite.size else math.nan
