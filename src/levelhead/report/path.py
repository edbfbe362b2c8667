"""The path of the drive as a drawing: north up, one scale for both axes, start and end marked."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from levelhead.conventions import FloatArray
from levelhead.estimators.base import Result
from levelhead.report.decimate import encode, path_indices
from levelhead.report.plots import TIME_DECIMALS, nice_step

EARTH_RADIUS: Final = 6371008.8
"""Mean radius, m; a picture of the path does not need the ellipsoid."""
SUBPIXEL: Final = 10
"""The path is drawn in whole tenths of a pixel."""
WIDTH: Final = 600
HEIGHT: Final = 500
LEFT: Final = 58
RIGHT: Final = 12
TOP: Final = 12
BOTTOM: Final = 44


@dataclass(frozen=True, kw_only=True)
class PathDrawing:
    """The drawing and what the script needs to mark the cursor's time on it: times in s, places in the SVG's units."""

    svg: str
    time: FloatArray
    x: FloatArray
    y: FloatArray

    def as_dict(self) -> dict[str, object]:
        """Return the vertices as the page's script reads them."""
        return {"time": encode(self.time, TIME_DECIMALS), "x": encode(self.x, 1), "y": encode(self.y, 1)}


def path_north_east(result: Result) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the path in metres from its start.

    Parameters
    ----------
    result : Result
        Its positions are used where there are any, else its velocities are integrated.

    Returns
    -------
    time, north, east : ndarray, shape (p,)
        Seconds and metres, finite; empty when the result has neither.
    """
    if result.position_llh is not None:
        there = np.isfinite(result.position_llh[:, :2]).all(axis=1)
        if there.any():
            latitude, longitude = result.position_llh[there, 0], result.position_llh[there, 1]
            east_angle = np.angle(np.exp(1j * (longitude - longitude[0])))  # crosses the date line unharmed
            north = EARTH_RADIUS * (latitude - latitude[0])
            return result.time[there], north, EARTH_RADIUS * np.cos(latitude[0]) * east_angle
    there = np.isfinite(result.velocity_ned[:, :2]).all(axis=1)
    time, velocity = result.time[there], result.velocity_ned[there, :2]
    if time.size == 0:
        return time, time, time
    steps = 0.5 * (velocity[1:] + velocity[:-1]) * np.diff(time)[:, None]
    place = np.vstack((np.zeros((1, 2)), np.cumsum(steps, axis=0)))
    return time, place[:, 0], place[:, 1]


def draw_path(result: Result) -> PathDrawing | None:
    """Draw the path, or return None where there is nothing to draw.

    Parameters
    ----------
    result : Result
        What to show.

    Returns
    -------
    PathDrawing or None
        None when the result has neither positions nor velocities.
    """
    time, north, east = path_north_east(result)
    if time.size < 2:
        return None
    kept = path_indices(north, east)
    time, north, east = time[kept], north[kept], east[kept]
    frame = _Frame.around(north, east)
    x = np.round(frame.x(east), 1)
    y = np.round(frame.y(north), 1)
    parts = [
        f'<svg id="path" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-labelledby="path-title path-description">',
        '<title id="path-title">Path of the drive, north up</title>',
        f'<desc id="path-description">The path covers {np.ptp(north):.0f} m from south to north and '
        f"{np.ptp(east):.0f} m from west to east.</desc>",
        *_grid(frame),
        f'<path class="track" transform="scale({1 / SUBPIXEL})" d="{_path_data(x, y)}"/>',
        f'<circle class="mark-start" cx="{x[0]:.1f}" cy="{y[0]:.1f}" r="6"/>',
        f'<rect class="mark-end" x="{x[-1] - 5:.1f}" y="{y[-1] - 5:.1f}" width="10" height="10"/>',
        '<circle id="path-cursor" class="mark-cursor" r="6" cx="-20" cy="-20"/>',
        "</svg>",
    ]
    return PathDrawing(svg="\n".join(parts), time=time, x=x, y=y)


@dataclass(frozen=True, kw_only=True)
class _Frame:
    """From metres to the drawing: the centre of the path goes to the centre of the box."""

    north: float
    east: float
    scale: float

    @classmethod
    def around(cls, north: FloatArray, east: FloatArray) -> _Frame:
        # 2 m at least: the wander of a standing GNSS antenna is not worth a magnification beyond that.
        tall, wide = max(float(np.ptp(north)), 2.0), max(float(np.ptp(east)), 2.0)
        box_width, box_height = WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM
        return cls(
            north=0.5 * float(north.max() + north.min()),
            east=0.5 * float(east.max() + east.min()),
            scale=0.94 * min(box_width / wide, box_height / tall),
        )

    def x(self, east: FloatArray) -> FloatArray:
        return 0.5 * (LEFT + WIDTH - RIGHT) + self.scale * (east - self.east)

    def y(self, north: FloatArray) -> FloatArray:
        return 0.5 * (TOP + HEIGHT - BOTTOM) - self.scale * (north - self.north)


def _grid(frame: _Frame) -> list[str]:
    """Grid lines with their metres: the same step along both axes."""
    half_wide = 0.5 * (WIDTH - LEFT - RIGHT) / frame.scale
    half_tall = 0.5 * (HEIGHT - TOP - BOTTOM) / frame.scale
    step = nice_step(2.0 * half_wide, 7)
    decimals = max(0, -math.floor(math.log10(step)))
    lines = []
    for east in _multiples(frame.east - half_wide, frame.east + half_wide, step):
        x = float(frame.x(np.array(east)))
        lines.append(f'<path class="grid" d="M{x:.1f} {TOP}V{HEIGHT - BOTTOM}"/>')
        lines.append(f'<text x="{x:.1f}" y="{HEIGHT - BOTTOM + 17}" text-anchor="middle">{east:.{decimals}f}</text>')
    for north in _multiples(frame.north - half_tall, frame.north + half_tall, step):
        y = float(frame.y(np.array(north)))
        lines.append(f'<path class="grid" d="M{LEFT} {y:.1f}H{WIDTH - RIGHT}"/>')
        lines.append(f'<text x="{LEFT - 7}" y="{y + 4:.1f}" text-anchor="end">{north:.{decimals}f}</text>')
    middle = 0.5 * (LEFT + WIDTH - RIGHT)
    lines.append(f'<text class="axis" x="{middle:.0f}" y="{HEIGHT - 6}" text-anchor="middle">east, m</text>')
    across = 0.5 * (TOP + HEIGHT - BOTTOM)
    lines.append(
        f'<text class="axis" transform="translate(14 {across:.0f}) rotate(-90)" text-anchor="middle">north, m</text>'
    )
    return lines


def _multiples(low: float, high: float, step: float) -> list[float]:
    return [k * step + 0.0 for k in range(math.ceil(low / step), math.floor(high / step) + 1)]


def _path_data(x: FloatArray, y: FloatArray) -> str:
    """Write the vertices as one absolute point and relative steps, in tenths of a pixel."""
    points = np.rint(np.column_stack((x, y)) * SUBPIXEL).astype(np.int64)
    steps = np.diff(points, axis=0)
    steps = steps[steps.any(axis=1)]
    start = f"M{points[0, 0]} {points[0, 1]}"
    if steps.size == 0:
        return start
    return f"{start}l" + " ".join(f"{a} {b}" for a, b in steps.tolist())
