"""What every page is made of: inlined scripts and styles with the policy that allows nothing else, frames for plots."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping, Sequence
from functools import cache
from html import escape
from importlib import resources
from string import Template
from typing import Final

from levelhead.report.plots import BAND_KINDS, TIME_DECIMALS, Plot

_JSON_ESCAPES: Final = str.maketrans(
    {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028", "\u2029": "\\u2029"}
)


def styles() -> tuple[str, ...]:
    """Return the style sheets of a page."""
    return asset("assets/uPlot.min.css"), asset("assets/report.css")


def scripts() -> tuple[str, ...]:
    """Return the scripts of a page with plots; the plotter's licence asks to travel with every copy, so it does."""
    plotter = f"/*!\n{asset('assets/LICENSE.uPlot')}\n*/\n{asset('assets/uPlot.iife.min.js')}"
    return plotter, asset("assets/report.js")


def plot_data(
    plots: Sequence[Plot], span: tuple[float, float], bands: Mapping[str, object], path: object = None
) -> dict[str, object]:
    """Return what the page's script reads: the plots, their common stretch of time (s), the bands behind them."""
    return {
        "start": round(span[0], TIME_DECIMALS),
        "end": round(span[1], TIME_DECIMALS),
        "bands": bands,
        "plots": [plot.as_dict() for plot in plots if plot.drawable],
        "path": path,
    }


def render_page(
    *,
    title: str,
    source: str,
    facts: str,
    body: str,
    footer: str = "",
    plots: Sequence[Plot] = (),
    data: Mapping[str, object] | None = None,
    plots_title: str = "",
    plots_key: str = "",
) -> str:
    """Render a self-contained page of tables, with plots over time below them.

    Parameters
    ----------
    title, source, plots_title : str
        Any text; it is escaped here.
    facts, body, footer, plots_key : str
        HTML, escaped by whoever made it.
    plots : sequence of Plot
        Those that are drawable are framed, in this order; without any the page has no script at all.
    data : mapping, optional
        Their data, from `plot_data`.
    """
    drawn = [plot for plot in plots if plot.drawable]
    code = scripts() if drawn else ()
    section = ""
    if drawn:
        section = Template(asset("templates/plots.html")).substitute(
            title=escape(plots_title), key=plots_key, figures="\n".join(figure(plot) for plot in drawn)
        )
    return Template(asset("templates/page.html")).substitute(
        policy=policy(code, styles()),
        styles="\n".join(f"<style>{style}</style>" for style in styles()),
        scripts="\n".join(f"<script>{script}</script>" for script in code),
        data=f'<script type="application/json" id="report-data">{script_json(data)}</script>' if drawn else "",
        title=escape(title),
        source=escape(source),
        facts=facts,
        body=body,
        plots=section,
        footer=footer,
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
def asset(name: str) -> str:
    """Return the text of a file of this package, to be inlined."""
    return resources.files("levelhead.report").joinpath(name).read_text(encoding="utf-8").strip()


def policy(scripts: tuple[str, ...], styles: tuple[str, ...]) -> str:
    """Allow exactly the inlined scripts and styles, and nothing from anywhere else."""

    def hashes(texts: tuple[str, ...]) -> str:
        digests = (base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in texts)
        return " ".join(f"'sha256-{digest}'" for digest in digests) or "'none'"

    return (
        f"default-src 'none'; script-src {hashes(scripts)}; style-src {hashes(styles)}; "
        "img-src data:; base-uri 'none'; form-action 'none'"
    )


def figure(plot: Plot) -> str:
    """Return the frame that the page's script draws a plot into; HTML."""
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


def key(shares: Mapping[str, float], *, dashed: bool) -> str:
    """Explain the bands that occur, with their share of the time, and the dashed lines."""
    items = []
    for kind, (_, text) in BAND_KINDS.items():
        if shares[kind] > 0.0:
            percent = "<0.1" if shares[kind] < 0.001 else f"{100.0 * shares[kind]:.1f}"
            items.append(f'<li><span class="band band-{kind}"></span>{text}, {escape(percent)}\u00a0% of the time</li>')
    if dashed:
        items.append('<li><span class="dash"></span>truth of the simulation</li>')
    return f'<ul class="key">{"".join(items)}</ul>' if items else ""
