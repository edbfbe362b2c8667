"""`render_comparison`: several methods on one log as one self-contained page."""

from __future__ import annotations

import math
from html import escape
from typing import Final

import numpy as np

from levelhead.analysis.comparison import Comparison, Entry
from levelhead.analysis.metrics import attitude_difference
from levelhead.conventions import AXES, FloatArray
from levelhead.estimators.base import Result
from levelhead.report import tables
from levelhead.report.decimate import DEFAULT_BUCKETS, minmax_indices
from levelhead.report.page import key, plot_data, render_page
from levelhead.report.plots import Curve, Plot, status_bands, status_shares
from levelhead.sim import Truth
from levelhead.version import __version__

TONES: Final = 7
"""Colours in report.css; more methods than that begin again."""
FEWEST_BUCKETS: Final = 150
CONTRADICTION: Final = 3.0
"""Differences beyond this many sigma are marked."""
ANGLES: Final = ("roll", "pitch", "heading")
SENSORS: Final = (("gyro", "deg/s", math.degrees(1.0), 4), ("accel", "m/s²", 1.0, 4))
"""Per sensor: the reader's unit, the factor into it, digits."""


def render_comparison(comparison: Comparison, *, title: str) -> str:
    """Render a comparison as a self-contained HTML page.

    Parameters
    ----------
    comparison : Comparison
        What to show.
    title : str
        Heading of the page; any text, it is escaped.

    Returns
    -------
    str
        The page. The same inputs give the same text.
    """
    results = comparison.results
    plots = comparison_plots(comparison)
    base = results[comparison.reference]
    span = (float(base.time[0]), float(base.time[-1]))
    bands = status_bands(base.time, base.status)
    count = f"{len(results)} of {len(comparison.entries)}"
    body = (
        tables.log_banner(comparison.log_info),
        f'<section aria-labelledby="biases"><h2 id="biases">Biases</h2><p class="lead">{_verdict(comparison)}</p>'
        f'<div class="card scroll">{_bias_table(comparison)}</div><p class="note">At the end of the log, in body axes; '
        "reading = truth + bias. Below a bias its one sigma, where the method gives one.</p></section>",
        '<section aria-labelledby="attitude"><h2 id="attitude">'
        + ("Errors" if comparison.truth is not None else "Agreement")
        + f'</h2><div class="card scroll">{_attitude_table(comparison)}</div>'
        f'<p class="note">{_attitude_note(comparison)}</p></section>',
        f'<section aria-labelledby="said"><h2 id="said">What the methods said</h2>{_said(comparison)}</section>',
    )
    return render_page(
        title=title,
        source=str(comparison.log_info.get("source") or ""),
        facts=tables.log_facts(comparison.log_info, __version__, first=("Methods", count)),
        body="\n".join(body),
        plots=plots,
        data=plot_data(plots, span, bands),
        plots_title="Over time",
        plots_key=key(status_shares(base.status), dashed=comparison.truth is not None),
    )


def comparison_plots(comparison: Comparison) -> tuple[Plot, ...]:
    """Prepare one plot per bias, and roll, pitch and heading less those of the reference or of the truth."""
    results, truth = comparison.results, comparison.truth
    plots = []
    for sensor, unit, scale, _ in SENSORS:
        for axis, name in enumerate(AXES):
            curves = {
                (method, getattr(result, f"known_{sensor}")[axis]): getattr(result, f"{sensor}_bias")[:, axis] * scale
                for method, result in results.items()
            }
            exact = None if truth is None else getattr(truth, f"{sensor}_bias")[:, axis] * scale
            full = "Gyro" if sensor == "gyro" else "Accelerometer"
            frame = Plot(
                name=f"{sensor}-{name}",
                title=f"{full} bias {name}",
                unit=unit,
                decimals=6 if sensor == "gyro" else 5,
                time=results[comparison.reference].time,
                curves=(),
                focused=True,
            )
            plots.append(_filled(frame, curves, exact, comparison))
    base: Result | Truth = results[comparison.reference] if truth is None else truth
    differences = {m: np.degrees(attitude_difference(r, base)) for m, r in results.items() if r is not base}
    for axis, name in enumerate(ANGLES):
        frame = Plot(
            name=name,
            title=f"{name.capitalize()} error" if truth is not None else f"{name.capitalize()} less the reference's",
            unit="deg",
            decimals=4,
            time=results[comparison.reference].time,
            curves=(),
            focused=True,
        )
        plots.append(_filled(frame, {(m, True): d[:, axis] for m, d in differences.items()}, None, comparison))
    return tuple(plots)


def _filled(
    frame: Plot, curves: dict[tuple[str, bool], FloatArray], exact: FloatArray | None, comparison: Comparison
) -> Plot:
    """Return a plot with its curves decimated together: about as many points as one curve of a report has."""
    drawn = {k: values for k, values in curves.items() if np.isfinite(values).any()}
    if not drawn:
        return frame
    buckets = max(FEWEST_BUCKETS, DEFAULT_BUCKETS // len(drawn))
    kept = minmax_indices(np.column_stack(list(drawn.values())), buckets)
    shown = [
        Curve(
            label=method if known else f"{method} (unknown)",
            values=values[kept],
            tone=_tone(comparison, method),
            faint=not known,
        )
        for (method, known), values in drawn.items()
    ]
    if exact is not None:
        shown.append(Curve(label="truth", values=exact[kept], tone=0, dashed=True))
    return Plot(
        name=frame.name,
        title=frame.title,
        unit=frame.unit,
        decimals=frame.decimals,
        time=frame.time[kept],
        curves=tuple(shown),
        focused=frame.focused,
    )


def _tone(comparison: Comparison, method: str) -> int:
    return [entry.method for entry in comparison.entries].index(method) % TONES


def _head(comparison: Comparison, entry: Entry) -> str:
    tone = _tone(comparison, entry.method)
    return f'<th scope="row"><span class="swatch tone-{tone}"></span>{escape(entry.method)}</th>'


def _verdict(comparison: Comparison) -> str:
    """Say in a sentence or two how far the methods are apart; HTML."""
    if len(comparison.results) < 2:
        return "Only one method has run: there is nothing to compare it with."
    parts = []
    for sensor, unit, scale, digits in SENSORS:
        values = [
            (getattr(r, f"{sensor}_bias")[-1, axis] * scale, method, axis)
            for method, r in comparison.results.items()
            for axis in range(3)
            if getattr(r, f"known_{sensor}")[axis]
        ]
        spans = []
        for axis in range(3):
            own = [value for value, _, k in values if k == axis]
            if len(own) > 1:
                spans.append((max(own) - min(own), AXES[axis]))
        if spans:
            widest, axis_name = max(spans)
            parts.append(f"{tables.number(widest, digits, unit)} in {sensor} {axis_name}")
    if not parts:
        return "No bias is known to two methods or more."
    return f"Among the methods that know a bias, the final estimates lie at most {' and '.join(parts)} apart."


def _bias_table(comparison: Comparison) -> str:
    shown = {
        sensor: [
            axis
            for axis in range(3)
            if any(np.isfinite(getattr(r, f"{sensor}_bias")[-1, axis]) for r in comparison.results.values())
        ]
        for sensor, *_ in SENSORS
    }
    top = '<tr><th scope="col" class="name" rowspan="2">method</th>'
    below = "<tr>"
    for sensor, unit, *_ in SENSORS:
        name = "gyro" if sensor == "gyro" else "accelerometer"
        if shown[sensor]:
            top += f'<th scope="colgroup" class="group" colspan="{len(shown[sensor])}">{name}, {unit}</th>'
            below += "".join(f'<th scope="col">{AXES[axis]}</th>' for axis in shown[sensor])
    top += '<th scope="colgroup" class="group" colspan="2">settled after</th>'
    below += '<th scope="col">gyro</th><th scope="col">accel</th>'
    top += '<th scope="colgroup" class="group" colspan="2">time taken</th>'
    below += '<th scope="col">s</th><th scope="col">of the observer\'s</th></tr>'
    columns = sum(len(axes) for axes in shown.values()) + 4
    rows = []
    for entry in comparison.entries:
        result = entry.result
        if result is None:
            chip = f'<span class="chip">Failed</span> {escape(entry.failure)}'
            cell = f'<td class="unknown" colspan="{columns}">{chip}</td>'
            rows.append(f'<tr class="serious">{_head(comparison, entry)}{cell}</tr>')
            continue
        cells = "".join(_bias_cell(result, sensor, axis) for sensor, *_ in SENSORS for axis in shown[sensor])
        since = "".join(f"<td>{tables.span(result.settled_at_s.get(sensor))}</td>" for sensor, *_ in SENSORS)
        ratio = tables.number(entry.runtime_ratio, 1)
        times = (
            f"<td>{tables.number(entry.runtime_s, 2)}</td><td>{ratio if ratio == tables.ABSENT else ratio + '×'}</td>"
        )
        rows.append(f"<tr>{_head(comparison, entry)}{cells}{since}{times}</tr>")
    return f'<table class="matrix"><thead>{top}</tr>{below}</thead>\n<tbody>\n' + "\n".join(rows) + "\n</tbody></table>"


def _bias_cell(result: Result, sensor: str, axis: int) -> str:
    _, _, scale, digits = next(row for row in SENSORS if row[0] == sensor)
    reason = tables.unknown_reason(result, sensor, axis)
    if reason is not None:
        return f'<td class="unknown">unknown<small>{escape(reason)}</small></td>'
    sigma = tables.number(getattr(result, f"{sensor}_bias_std")[-1, axis] * scale, digits)
    small = "" if sigma == tables.ABSENT else f"<small>±{sigma}</small>"
    return f"<td>{tables.number(getattr(result, f'{sensor}_bias')[-1, axis] * scale, digits)}{small}</td>"


def _attitude_table(comparison: Comparison) -> str:
    """Return the table of attitudes and biases against the truth, or against the reference; HTML."""
    exact = comparison.truth is not None
    unit = "error" if exact else "difference"
    groups = [(f"RMS {unit}, deg", ANGLES, 3)]
    if exact:
        groups += [("gyro, deg/s", AXES, 4), ("accel, m/s²", AXES, 4)]
    else:
        groups += [("in sigma", ANGLES, 1), ("gyro, in sigma", AXES, 1), ("accel, in sigma", AXES, 1)]
    numbers = {entry.method: _distances(entry) for entry in comparison.entries if entry.result is not None}
    # An axis that no method gives, the vertical accelerometer's as a rule, needs no column.
    shown = np.isfinite(np.array([value for m, value in numbers.items() if exact or m != comparison.reference]))
    shown = shown.any(axis=0) if shown.size else np.zeros((len(groups), 3), dtype=bool)
    top, below = '<tr><th scope="col" class="name" rowspan="2">method</th>', "<tr>"
    for k, (name, axes, _) in enumerate(groups):
        if shown[k].any():
            top += f'<th scope="colgroup" class="group" colspan="{shown[k].sum()}">{name}</th>'
        below += "".join(f'<th scope="col">{axis}</th>' for axis, there in zip(axes, shown[k], strict=True) if there)
    rows = []
    for entry in comparison.entries:
        if entry.method not in numbers:
            continue
        cells = "".join(
            _numbers(numbers[entry.method][k][shown[k]], digits, limit=math.inf if exact or k == 0 else CONTRADICTION)
            for k, (*_, digits) in enumerate(groups)
        )
        if not exact and entry.method == comparison.reference:
            cells = f'<td class="unknown" colspan="{max(1, shown.sum())}">the reference</td>'
        rows.append(f"<tr>{_head(comparison, entry)}{cells}</tr>")
    return (
        f'<table class="matrix"><thead>{top}</tr>{below}</tr></thead>\n<tbody>\n'
        + "\n".join(rows)
        + "\n</tbody></table>"
    )


def _distances(entry: Entry) -> FloatArray:
    """Return what is shown of a method, three numbers per group: errors, or differences and differences in sigma."""
    if entry.errors is not None:
        found = entry.errors
        rows = [np.degrees(found.attitude), np.degrees(found.gyro_bias), found.accel_bias]
    else:
        rows = [np.degrees(entry.attitude_difference), entry.attitude_in_sigma]
        rows += [entry.gyro_in_sigma, entry.accel_in_sigma]
    return np.array(rows)


def _numbers(values: FloatArray, decimals: int, *, limit: float) -> str:
    """Return one cell per number; beyond the limit it is marked."""
    texts = [(tables.number(value, decimals), bool(value > limit)) for value in values]
    return "".join(
        f'<td><strong class="far">{text}</strong></td>' if far else f"<td>{text}</td>" for text, far in texts
    )


def _attitude_note(comparison: Comparison) -> str:
    after = tables.span(comparison.after_s)
    if comparison.truth is not None:
        return f"Against the truth of the simulation, RMS from {after} after the start."
    return (
        f"Against {escape(comparison.reference)}, RMS from {after} after the start. In sigma: in units of both sigmas "
        "combined, where both methods give one and know the bias. Beyond 3, <strong>marked</strong>, the methods "
        "contradict each other: at least one is surer than it should be. As they read the same noise, a small value "
        "proves nothing."
    )


def _said(comparison: Comparison) -> str:
    """Return every event once with the methods that reported it; HTML."""
    said: dict[tuple[str, str], list[str]] = {}
    for method, result in comparison.results.items():
        for event in result.events:
            said.setdefault((event.code, event.text), []).append(method)
    if not said:
        return '<p class="quiet">Nothing: no gaps, no dropped samples, no warnings.</p>'
    items = [
        _event_item(code, text, "all methods" if len(methods) == len(comparison.results) else ", ".join(methods))
        for (code, text), methods in sorted(said.items(), key=lambda item: "EWSI".find(item[0][0][:1]))
    ]
    return '<ul class="events">\n' + "\n".join(items) + "\n</ul>"


def _event_item(code: str, text: str, who: str) -> str:
    style, word = tables.SEVERITIES.get(code[:1], tables.SEVERITIES["I"])
    return (
        f'<li class="{style}"><span class="chip">{word}</span> {escape(text)}'
        f" <small>{escape(who)} <code>{escape(code)}</code></small></li>"
    )
