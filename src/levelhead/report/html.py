"""`render_report`: one result as one HTML page that needs no network, no server and no second file."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping
from functools import cache
from html import escape
from importlib import resources
from string import Template
from typing import Final

from numpy.typing import ArrayLike

from levelhead.estimators.base import Result
from levelhead.report import tables
from levelhead.report.path import PathDrawing, draw_path
from levelhead.report.plots import BAND_KINDS, TIME_DECIMALS, Plot, status_bands, status_shares, time_plots
from levelhead.version import __version__

_JSON_ESCAPES: Final = str.maketrans(
    {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028", "\u2029": "\\u2029"}
)


def render_report(result: Result, *, title: str, reference: Mapping[str, ArrayLike] | None = None) -> str:
    """Render a result as a self-contained HTML page.

    Parameters
    ----------
    result : Result
        What to show.
    title : str
        Heading of the page; any text, it is escaped.
    reference : mapping, optional
        The truth of a simulated run, drawn as thin dashed lines: ``time`` (m,), ``gyro_bias`` and ``accel_bias``
        (m, 3), ``roll``, ``pitch``, ``heading`` (m,), SI and radians; a missing one is not drawn.

    Returns
    -------
    str
        The page. The same inputs give the same text: there is no clock in it.

    Raises
    ------
    UsageError
        When the reference has no ``time`` or shapes that do not fit it.
    """
    plots = time_plots(result, reference)
    path = draw_path(result)
    shares = status_shares(result.status)
    data = {
        "start": round(float(result.time[0]), TIME_DECIMALS),
        "end": round(float(result.time[-1]), TIME_DECIMALS),
        "bands": status_bands(result.time, result.status),
        "plots": [plot.as_dict() for plot in plots if plot.drawable],
        "path": path.as_dict() if path is not None else None,
    }
    styles = (_asset("assets/uPlot.min.css"), _asset("assets/report.css"))
    # The licence asks to travel with every copy, and each report is one.
    plotter = f"/*!\n{_asset('assets/LICENSE.uPlot')}\n*/\n{_asset('assets/uPlot.iife.min.js')}"
    scripts = (plotter, _asset("assets/report.js"))
    figures = {plot.name: _figure(plot) for plot in plots}
    return Template(_asset("templates/report.html")).substitute(
        policy=_policy(scripts, styles),
        styles="\n".join(f"<style>{style}</style>" for style in styles),
        scripts="\n".join(f"<script>{script}</script>" for script in scripts),
        data=script_json(data),
        title=escape(title),
        source=escape(str(result.log_info.get("source", ""))),
        banner=tables.banner(result),
        facts=tables.facts(result, __version__),
        verdict=tables.verdict(result),
        gyro_table=tables.bias_table(result, "gyro"),
        accel_table=tables.bias_table(result, "accel"),
        events=tables.event_list(result.events),
        parameters=tables.parameter_table(result),
        key=_key(shares, dashed=reference is not None),
        gyro_plot=figures["gyro-bias"],
        accel_plot=figures["accel-bias"],
        attitude_plot=figures["attitude"],
        heading_plot=figures["heading"],
        speed_plot=figures["speed"],
        yaw_rate_plot=figures["yaw-rate"],
        path_plot=_path_figure(path),
        footer=tables.footer(result),
    )


def script_json(data: object) -> str:
    """Serialise data for a script element: nothing in it can end the element or the line.

    Parameters
    ----------
    data : object
        Anything that `json.dumps` takes; numbers must be finite.

    Returns
    -------
    str
        JSON without ``<``, ``>``, ``&``, U+2028 and U+2029.
    """
    return json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":")).translate(_JSON_ESCAPES)


@cache
def _asset(name: str) -> str:
    return resources.files("levelhead.report").joinpath(name).read_text(encoding="utf-8").strip()


def _policy(scripts: tuple[str, ...], styles: tuple[str, ...]) -> str:
    """Allow exactly the inlined scripts and styles, and nothing from anywhere else."""

    def hashes(texts: tuple[str, ...]) -> str:
        digests = (base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in texts)
        return " ".join(f"'sha256-{digest}'" for digest in digests)

    return (
        f"default-src 'none'; script-src {hashes(scripts)}; style-src {hashes(styles)}; "
        "img-src data:; base-uri 'none'; form-action 'none'"
    )


def _figure(plot: Plot) -> str:
    heading = f"<h3>{plot.title} <small>{plot.unit}</small></h3>"
    if not plot.drawable:
        return (
            f'<figure class="plot empty"><figcaption>{heading}</figcaption><p class="quiet">{plot.absent}</p></figure>'
        )
    note = ""
    if plot.view is not None and not plot.cyclic:
        note = '<span class="note">peaks outside the frame: zoom in to see them</span>'
    label = escape(f"{plot.title} over time in {plot.unit}: {', '.join(curve.label for curve in plot.curves)}")
    return (
        f'<figure class="plot" id="plot-{plot.name}"><figcaption>{heading}{note}<div class="legend"></div></figcaption>'
        f'<div class="canvas" role="img" aria-label="{label}"></div></figure>'
    )


def _path_figure(path: PathDrawing | None) -> str:
    heading = "<h3>Path <small>m</small></h3>"
    if path is None:
        return (
            f'<figure class="plot path empty"><figcaption>{heading}</figcaption>'
            '<p class="quiet">The log gives neither positions nor velocities.</p></figure>'
        )
    key = (
        '<span class="path-key"><span class="swatch mark-start"></span>start '
        '<span class="swatch mark-end"></span>end</span>'
    )
    return f'<figure class="plot path"><figcaption>{heading}{key}</figcaption>{path.svg}</figure>'


def _key(shares: Mapping[str, float], *, dashed: bool) -> str:
    """Explain the bands that occur, with their share of the time, and the dashed lines."""
    items = []
    for kind, (_, text) in BAND_KINDS.items():
        if shares[kind] > 0.0:
            percent = "<0.1" if shares[kind] < 0.001 else f"{100.0 * shares[kind]:.1f}"
            items.append(f'<li><span class="band band-{kind}"></span>{text}, {escape(percent)}\u00a0% of the time</li>')
    if dashed:
        items.append('<li><span class="dash"></span>truth of the simulation</li>')
    return f'<ul class="key">{"".join(items)}</ul>' if items else ""
