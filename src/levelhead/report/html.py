"""`render_report`: one result as one HTML page that needs no network, no server and no second file."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from string import Template

from numpy.typing import ArrayLike

from levelhead.estimators.base import Result
from levelhead.report import tables
from levelhead.report.navigation import navigation_plots, navigation_section
from levelhead.report.page import asset, figure, key, plot_data, policy, script_json, scripts, styles
from levelhead.report.path import PathDrawing, draw_path
from levelhead.report.plots import status_bands, status_shares, time_plots
from levelhead.report.preflight import preflight_section
from levelhead.version import __version__


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
    navigation = navigation_plots(result)
    path = draw_path(result)
    shares = status_shares(result.status)
    data = plot_data(
        (*plots, *navigation),
        (float(result.time[0]), float(result.time[-1])),
        status_bands(result.time, result.status),
        path.as_dict() if path is not None else None,
    )
    figures = {plot.name: figure(plot) for plot in plots}
    return Template(asset("templates/report.html")).substitute(
        policy=policy(scripts(), styles()),
        styles="\n".join(f"<style>{style}</style>" for style in styles()),
        scripts="\n".join(f"<script>{script}</script>" for script in scripts()),
        data=script_json(data),
        title=escape(title),
        source=escape(str(result.log_info.get("source", ""))),
        banner=tables.banner(result),
        facts=tables.facts(result, __version__),
        verdict=tables.verdict(result),
        gyro_table=tables.bias_table(result, "gyro"),
        accel_table=tables.bias_table(result, "accel"),
        navigation=navigation_section(result, navigation),
        preflight=preflight_section(result),
        events=tables.event_list(result.events),
        parameters=tables.parameter_table(result),
        key=key(shares, dashed=reference is not None),
        gyro_plot=figures["gyro-bias"],
        accel_plot=figures["accel-bias"],
        attitude_plot=figures["attitude"],
        heading_plot=figures["heading"],
        speed_plot=figures["speed"],
        yaw_rate_plot=figures["yaw-rate"],
        path_plot=_path_figure(path),
        footer=tables.footer(result),
    )


def _path_figure(path: PathDrawing | None) -> str:
    heading = "<h3>Path <small>m</small></h3>"
    if path is None:
        return (
            f'<figure class="plot path empty"><figcaption>{heading}</figcaption>'
            '<p class="quiet">The log gives neither positions nor velocities.</p></figure>'
        )
    marks = [_mark("mark-start", "start"), _mark("mark-end", "end")]
    if path.coasting:
        marks.append(_mark("coast-line", "without GNSS"))
    if path.corridor:
        marks.append(_mark("corridor-patch", "one sigma"))
    return (
        f'<figure class="plot path"><figcaption>{heading}<span class="path-key">{" ".join(marks)}</span></figcaption>'
        f'{path.svg}<p class="note">{escape(path.caption)}</p></figure>'
    )


def _mark(style: str, text: str) -> str:
    return f'<span class="swatch {style}"></span>{text}'
