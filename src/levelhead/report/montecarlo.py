"""`render_monte_carlo`: many simulated drives as one self-contained page of tables."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from html import escape

import numpy as np

from levelhead.analysis.trials import QUANTITIES, Figures, MonteCarlo
from levelhead.conventions import FloatArray
from levelhead.report import tables
from levelhead.report.page import render_page
from levelhead.version import __version__

Cell = Callable[[Figures, int, float, int], str]


def render_monte_carlo(found: MonteCarlo) -> str:
    """Render a Monte Carlo analysis as a self-contained HTML page; the same inputs give the same text."""
    figures = {method: found.figures(method) for method in found.trials}
    last = found.seed0 + found.runs - 1
    facts = tables.fact_list(
        ("Scenario", escape(found.scenario)),
        ("Drives", str(found.runs)),
        ("Seeds", f"{found.seed0}–{last}"),
        ("Each", tables.span(found.duration)),
        ("Errors count after", tables.span(found.after)),
        ("IMU", tables.number(found.imu_rate, 1, "Hz")),
        ("GNSS", tables.number(found.gnss_rate, 1, "Hz")),
        ("levelhead", escape(__version__)),
    )
    body = [
        _section("errors", "Errors", _matrix(figures, _error_cell, errors=True))
        + '<p class="note">Root mean square over the drives; below it the worst drive.</p>',
        _section("settling", "Settling", _settling_table(found, figures))
        + '<p class="note">When the true error of x and y came below 0.02 deg/s, 0.04 m/s² for good; and in how many '
        "drives the method itself called them settled in the end.</p>",
    ]
    if any(np.isfinite(f.coverage).any() for f in figures.values()):
        body += [
            _section("coverage", "Is the sigma honest?", _matrix(figures, _coverage_cell, errors=False))
            + '<p class="note">How often the error is within 1.96 sigma, every 10 s: 95 % if the sigma is honest. '
            "Below it the mean squared error in units of sigma, 1 if honest; <strong>marked</strong> where it lies "
            "outside the band that chi-square, one degree of freedom per drive, gives it in 95 % of all analyses.</p>"
        ]
    failed = [_failures(method, f, found.runs) for method, f in figures.items() if f.failures]
    if failed:
        body.append(f'<section><h2>Failures</h2><ul class="events">{"".join(failed)}</ul></section>')
    return render_page(
        title=f"{found.runs} simulated drives: {found.scenario}",
        source="",
        facts=facts,
        body="\n".join(body),
    )


def _section(name: str, title: str, table: str) -> str:
    head = f'<section aria-labelledby="{name}"><h2 id="{name}">{title}</h2>'
    return f'{head}<div class="card scroll">{table}</div></section>'


def _matrix(figures: Mapping[str, Figures], cell: Cell, *, errors: bool) -> str:
    """Return a table with a row per method and a column per quantity that any method gives; HTML."""
    values: list[FloatArray] = [f.rms if errors else f.coverage for f in figures.values()]
    shown = [k for k in range(len(QUANTITIES)) if any(math.isfinite(v[k]) for v in values)]
    names = list(QUANTITIES)
    units = [unit for _, unit, _ in QUANTITIES.values()]
    scales = [scale for _, _, scale in QUANTITIES.values()]
    head = "".join(f'<th scope="col">{names[k]}{f"<small>{units[k]}</small>" if errors else ""}</th>' for k in shown)
    rows = []
    for method, f in figures.items():
        cells = "".join(cell(f, k, scales[k], 3 if k < 3 else 4) for k in shown)
        if not errors and not np.isfinite(f.coverage).any():
            cells = f'<td class="unknown" colspan="{len(shown)}">gives no sigma</td>'
        rows.append(f'<tr><th scope="row">{escape(method)}</th>{cells}</tr>')
    return _table(head, rows)


def _table(head: str, rows: list[str]) -> str:
    return (
        f'<table class="matrix"><thead><tr><th scope="col" class="name">method</th>{head}</tr></thead>\n<tbody>\n'
        + "\n".join(rows)
        + "\n</tbody></table>"
    )


def _error_cell(figures: Figures, k: int, scale: float, decimals: int) -> str:
    if not math.isfinite(figures.rms[k]):
        return f"<td>{tables.ABSENT}</td>"
    worst = tables.number(figures.worst[k] * scale, decimals)
    return f"<td>{tables.number(figures.rms[k] * scale, decimals)}<small>{worst}</small></td>"


def _coverage_cell(figures: Figures, k: int, _scale: float, _decimals: int) -> str:
    if not math.isfinite(figures.coverage[k]):
        return f"<td>{tables.ABSENT}</td>"
    low, high = figures.nees_band[k]
    nees = f"{figures.nees[k]:.2f} in {low:.2f}–{high:.2f}"
    if not figures.honest[k]:
        nees = f'<strong class="far">{figures.nees[k]:.2f}</strong> not in {low:.2f}–{high:.2f}'
    return f"<td>{100.0 * figures.coverage[k]:.1f}\u00a0%<small>{nees}</small></td>"


def _settling_table(found: MonteCarlo, figures: Mapping[str, Figures]) -> str:
    sensors = ("gyro", "accel")
    head = "".join(
        f'<th scope="col">{sensor}, median</th><th scope="col">worst</th><th scope="col">called settled</th>'
        for sensor in sensors
    )
    rows = []
    for method, f in figures.items():
        cells = ""
        for sensor in sensors:
            times = getattr(f, f"{sensor}_settles")
            for t in (np.median(times), times.max()) if times.size else (math.nan, math.nan):
                cells += f"<td>{'never' if math.isinf(t) else tables.span(float(t))}</td>"
            cells += f"<td>{getattr(f, f'{sensor}_flagged')} of {found.runs}</td>"
        rows.append(f'<tr><th scope="row">{escape(method)}</th>{cells}</tr>')
    return _table(head, rows)


def _failures(method: str, figures: Figures, runs: int) -> str:
    items = []
    for sentence in dict.fromkeys(figures.failures.values()):
        seeds = [str(seed) for seed, other in figures.failures.items() if other == sentence]
        items.append(
            f'<li class="serious"><span class="chip">Failed</span> {escape(method)}: {escape(sentence)}'
            f"<small>{len(seeds)} of {runs} drives, seeds {', '.join(seeds[:20])}</small></li>"
        )
    return "".join(items)
