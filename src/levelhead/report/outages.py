"""The outage test as a section of the validation page: figures per method, bars and a table per outage."""

from __future__ import annotations

import math
from html import escape
from typing import Final

from levelhead.analysis.outages import OutageRun, OutageTest
from levelhead.report import tables
from levelhead.report.plots import nice_step

WIDTH: Final = 1200
HEIGHT: Final = 250
LEFT: Final = 60
RIGHT: Final = 10
TOP: Final = 10
BOTTOM: Final = 40
TONES: Final = 7
"""Colours of the palette; with more runs than that they come round again."""

COLUMNS: Final = (
    ("drift", "m"),
    ("sigma", "m"),
    ("drift", "/ sigma"),
    ("drift", "%"),
    ("vertical", "m"),
    ("largest", "m"),
)
"""What is told of each outage: the name and, below it, the unit."""


def outage_section(test: OutageTest) -> str:
    """Return the section; HTML."""
    parts = [f'<p class="lead">{_verdict(test)}</p>']
    shown = [run for run in test.runs if run.drifts]
    if test.runs:
        parts.append(f'<div class="card scroll">{_figures(test)}</div>')
    if shown:
        parts += [
            _bars(shown),
            '<p class="note">Bars: horizontal distance from the last fix of each outage; the line across a bar is the '
            "sigma that the method claims for it, with the fix's own. About two bars in three should end below their "
            "line, and hardly one above three times its height.</p>",
            f'<div class="card scroll">{_windows(shown)}</div>',
            '<p class="note">GNSS, velocity and position, is taken out of the log in every outage; the last fix in it '
            "is what the estimated antenna is compared with. A smoother knows what came after the outage: its largest "
            "error lies in the middle, in the last of its columns. With GNSS: the complete log, RMS difference from "
            "the fixes over both sigmas combined; as the method has seen these fixes, 1 is the most that it should be."
            "</p>",
        ]
    return (
        f'<section aria-labelledby="outages"><h2 id="outages">GNSS taken away for {test.length_s:g}\u00a0s</h2>'
        + "\n".join(parts)
        + "</section>"
    )


def _verdict(test: OutageTest) -> str:
    if test.reason:
        return escape(test.reason)
    shown = [run for run in test.runs if run.drifts]
    if not shown:
        return "No method gave positions through an outage."
    parts = [
        f"{escape(run.name)} {tables.number(run.figures('horizontal_m')[0], 2, 'm')} RMS "
        f"({tables.number(run.figures('in_sigma')[0], 2)}\u00a0sigma)"
        for run in shown
    ]
    count = "one outage" if test.windows == 1 else f"{test.windows} outages"
    return f"Horizontal distance from GNSS at the end of {count} of {test.length_s:g}\u00a0s: {'; '.join(parts)}."


def _figures(test: OutageTest) -> str:
    """One row per run: RMS, median and largest, and how it agrees with GNSS when it sees it."""
    groups = (("horizontal, m", "horizontal_m", 2), ("vertical, m", "vertical_m", 2), ("% of distance", "percent", 2))
    head = '<thead><tr><th scope="col" class="name" rowspan="2">method</th>'
    head += "".join(f'<th scope="colgroup" class="group" colspan="3">{name}</th>' for name, *_ in groups)
    head += '<th scope="colgroup" class="group" colspan="2">drift / sigma, RMS</th>'
    head += '<th scope="colgroup" class="group" colspan="4">with GNSS: m, and in sigma</th></tr><tr>'
    head += "".join(f'<th scope="col">{name}</th>' for name in ("RMS", "median", "largest") * 3)
    head += '<th scope="col">horizontal</th><th scope="col">vertical</th>' * 3 + "</tr></thead>"
    rows = [_figure_row(run, k, groups) for k, run in enumerate(test.runs)]
    return f'<table class="matrix">{head}<tbody>\n' + "\n".join(rows) + "\n</tbody></table>"


def _figure_row(run: OutageRun, k: int, groups: tuple[tuple[str, str, int], ...]) -> str:
    head = f'<th scope="row"><span class="swatch tone-{k % TONES}"></span>{escape(run.name)}</th>'
    if run.refused:
        return f'<tr>{head}<td class="unknown" colspan="{3 * len(groups) + 6}">{escape(run.refused)}</td></tr>'
    cells = [tables.number(value, digits) for _, name, digits in groups for value in run.figures(name)]
    cells += [_ratio(run.figures(name)[0]) for name in ("in_sigma", "vertical_in_sigma")]
    aided = run.agreement
    if aided is None:
        cells += [tables.ABSENT] * 4
    else:
        cells += [tables.number(value, 3) for value in (aided.horizontal_m, aided.vertical_m)]
        cells += [_ratio(value) for value in (aided.horizontal_in_sigma, aided.vertical_in_sigma)]
    return f"<tr>{head}{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>"


def _ratio(value: float) -> str:
    """Return a ratio of error and sigma, marked beyond 3, where the sigma is surer than it should be."""
    text = tables.number(value, 2)
    return f'<strong class="far">{text}</strong>' if math.isfinite(value) and value > 3.0 else text


def _windows(runs: list[OutageRun]) -> str:
    """One row per outage: what each run was off, what it claimed."""
    head = '<thead><tr><th scope="col" class="name" rowspan="2">outage, s</th>'
    head += '<th scope="col" rowspan="2">driven, m</th>'
    head += "".join(
        f'<th scope="colgroup" class="group" colspan="6"><span class="swatch tone-{k % TONES}"></span>'
        f"{escape(run.name)}</th>"
        for k, run in enumerate(runs)
    )
    head += "</tr><tr>"
    head += "".join(f'<th scope="col">{name}<small>{unit}</small></th>' for _ in runs for name, unit in COLUMNS)
    head += "</tr></thead>"
    rows = []
    for k, first in enumerate(runs[0].drifts):
        cells = [tables.number(first.distance_m, 0)]
        for drift in (run.drifts[k] for run in runs):
            cells += [
                tables.number(drift.horizontal_m, 2),
                tables.number(drift.horizontal_std_m, 2),
                _ratio(drift.in_sigma),
                tables.number(drift.percent, 2),
                tables.number(drift.vertical_m, 2),
                tables.number(drift.largest_m, 2),
            ]
        when = f"{first.window.start_s:.0f}–{first.window.end_s:.0f}"
        rows.append(f'<tr><th scope="row">{when}</th>{"".join(f"<td>{cell}</td>" for cell in cells)}</tr>')
    return f'<table class="matrix compact">{head}<tbody>\n' + "\n".join(rows) + "\n</tbody></table>"


def _bars(runs: list[OutageRun]) -> str:
    """Draw the drifts as bars with the claimed sigma across, one group per outage."""
    drifts = [[drift.horizontal_m for drift in run.drifts] for run in runs]
    sigmas = [[drift.horizontal_std_m for drift in run.drifts] for run in runs]
    top = max((v for row in (*drifts, *sigmas) for v in row if math.isfinite(v)), default=0.0) or 1.0
    count = len(drifts[0])
    group = (WIDTH - LEFT - RIGHT) / count
    wide = min(40.0, 0.8 * group / len(runs))
    foot = HEIGHT - BOTTOM
    scale = 0.96 * (foot - TOP) / top
    lines = _levels(top, scale)
    for k, first in enumerate(runs[0].drifts):
        middle = LEFT + (k + 0.5) * group
        lines.append(f'<text x="{middle:.1f}" y="{foot + 16}" text-anchor="middle">{first.window.start_s:.0f}</text>')
        for j in range(len(runs)):
            left = middle + (j - 0.5 * len(runs)) * wide
            lines += _bar(left, 0.86 * wide, scale * drifts[j][k], scale * sigmas[j][k], j % TONES)
    title = f"Horizontal drift of {count} outages"
    lines.append(f'<text class="axis" x="{WIDTH / 2:.0f}" y="{HEIGHT - 6}" text-anchor="middle">outage from, s</text>')
    return (
        f'<figure class="plot bars"><figcaption><h3>{title} <small>m</small></h3>{_key(runs)}</figcaption>'
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{title}, m; the figures are in the table below">'
        + "\n".join(lines)
        + "</svg></figure>"
    )


def _levels(top: float, scale: float) -> list[str]:
    foot = HEIGHT - BOTTOM
    step = nice_step(top, 5)
    decimals = max(0, -math.floor(math.log10(step)))
    lines = []
    for k in range(math.floor(top / step) + 1):
        y = foot - scale * k * step
        lines.append(f'<path class="grid" d="M{LEFT} {y:.1f}H{WIDTH - RIGHT}"/>')
        lines.append(f'<text x="{LEFT - 7}" y="{y + 4:.1f}" text-anchor="end">{k * step:.{decimals}f}</text>')
    return lines


def _bar(left: float, wide: float, tall: float, sigma: float, tone: int) -> list[str]:
    foot = HEIGHT - BOTTOM
    parts = []
    if math.isfinite(tall):
        place = f'x="{left:.1f}" y="{foot - tall:.1f}" width="{wide:.1f}" height="{max(tall, 0.5):.1f}"'
        parts.append(f'<rect class="tone-{tone}" {place}/>')
    if math.isfinite(sigma):
        parts.append(f'<path class="claimed" d="M{left - 1:.1f} {foot - sigma:.1f}h{wide + 2:.1f}"/>')
    return parts


def _key(runs: list[OutageRun]) -> str:
    marks = [f'<span class="swatch tone-{k % TONES}"></span>{escape(run.name)}' for k, run in enumerate(runs)]
    return f'<span class="path-key">{" ".join(marks)} <span class="swatch claimed-line"></span>claimed sigma</span>'
