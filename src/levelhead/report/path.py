"""The path of the drive as a drawing: north up, one scale for both axes, start, end and GNSS outages marked."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import FloatArray
from levelhead.estimators.base import Result
from levelhead.report.corridor import corridor
from levelhead.report.decimate import encode, path_indices
from levelhead.report.plots import TIME_DECIMALS, nice_step, status_bands

EARTH_RADIUS: Final = 6371008.8
"""Mean radius, m; a picture of the path does not need the ellipsoid."""
SUBPIXEL: Final = 10
"""The path is drawn in whole tenths of a pixel."""
OUTAGE_POINTS: Final = 1000
"""Vertices added to the stretches without GNSS, all of them together, so that the corridor grows smoothly."""
WIDTH: Final = 600
HEIGHT: Final = 500
LEFT: Final = 58
RIGHT: Final = 12
TOP: Final = 12
BOTTOM: Final = 44
SCALE_PARTS: Final = 7
"""The scale bar is about this part of the drawing's width, and as long as one step of the grid."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """Where a point of the vehicle went.

    Attributes
    ----------
    time : ndarray, shape (p,)
        Seconds.
    north, east : ndarray, shape (p,)
        Metres from the start, finite.
    sigma : ndarray, shape (p,)
        Horizontal sigma, the larger of North and East, m; NaN where the method gives none.
    point : str
        Which point it is and where its positions come from.
    start_deg : (2,), optional
        Latitude and longitude of the start; None without positions.
    """

    time: FloatArray
    north: FloatArray
    east: FloatArray
    sigma: FloatArray
    point: str
    start_deg: tuple[float, float] | None = None


@dataclass(frozen=True, kw_only=True)
class PathDrawing:
    """The drawing and what the script needs to mark the cursor's time on it: times in s, places in the SVG's units.

    ``coasting`` and ``corridor`` tell whether stretches without GNSS, and their sigma, are in it; ``caption`` is text.
    """

    svg: str
    caption: str
    coasting: bool
    corridor: bool
    time: FloatArray
    x: FloatArray
    y: FloatArray

    def as_dict(self) -> dict[str, object]:
        """Return the vertices as the page's script reads them."""
        return {"time": encode(self.time, TIME_DECIMALS), "x": encode(self.x, 1), "y": encode(self.y, 1)}


def drive_track(result: Result) -> Track:
    """Return the path in metres from its start.

    Parameters
    ----------
    result : Result
        The positions of its reference point are used where it has them, else its own, else its velocities are
        integrated.

    Returns
    -------
    Track
        Without any sample when the result has neither positions nor velocities.
    """
    position, sigma, point = _positions(result)
    if position is not None:
        there = np.isfinite(position[:, :2]).all(axis=1)
        if there.any():
            latitude, longitude = position[there, 0], position[there, 1]
            east_angle = np.angle(np.exp(1j * (longitude - longitude[0])))  # crosses the date line unharmed
            return Track(
                time=result.time[there],
                north=EARTH_RADIUS * (latitude - latitude[0]),
                east=EARTH_RADIUS * np.cos(latitude[0]) * east_angle,
                sigma=np.full(latitude.size, np.nan) if sigma is None else sigma[there, :2].max(axis=1),
                point=point,
                start_deg=(math.degrees(latitude[0]), math.degrees(longitude[0])),
            )
    there = np.isfinite(result.velocity_ned[:, :2]).all(axis=1)
    time, velocity = result.time[there], result.velocity_ned[there, :2]
    steps = 0.5 * (velocity[1:] + velocity[:-1]) * np.diff(time)[:, None]
    place = np.vstack((np.zeros((1, 2)), np.cumsum(steps, axis=0)))[: time.size]
    nothing = np.full(time.size, np.nan)
    return Track(time=time, north=place[:, 0], east=place[:, 1], sigma=nothing, point="The velocity, integrated")


def _positions(result: Result) -> tuple[FloatArray | None, FloatArray | None, str]:
    """Return the positions to draw, their sigma, and whose they are."""
    reference = result.reference
    if reference is not None and reference.position_llh is not None:
        where = "The reference point, ({:g}, {:g}, {:g}) m forward, right, down of the IMU".format(*reference.point)
        return reference.position_llh, reference.position_std, where
    if result.position_std is None:
        return result.position_llh, None, "The GNSS antenna, straight from fix to fix"
    return result.position_llh, result.position_std, "The IMU"


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
    track = drive_track(result)
    if track.time.size < 2:
        return None
    bands = status_bands(result.time, result.status)["coast"]
    kept, stretches = _vertices(track, bands)
    north, east = track.north[kept], track.east[kept]
    frame = _Frame.around(north, east)
    x, y = np.round(frame.x(east), 1), np.round(frame.y(north), 1)
    width = frame.scale * track.sigma[kept]
    zone = "".join(corridor(x[part], y[part], width[part]) for part in stretches)
    scaled = f'transform="scale({1 / SUBPIXEL})"'
    parts = [
        f'<svg id="path" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-labelledby="path-title path-description">',
        '<title id="path-title">Path of the drive, north up</title>',
        f'<desc id="path-description">The path covers {np.ptp(north):.0f} m from south to north and '
        f"{np.ptp(east):.0f} m from west to east.</desc>",
        *_grid(frame),
        *_scale_bar(frame),
        *([_inside_the_box(f'<g class="corridor">{zone}</g>')] if zone else []),
        f'<path class="track" {scaled} d="{_path_data(x, y)}"/>',
        *(f'<path class="coast" {scaled} d="{_path_data(x[part], y[part])}"/>' for part in stretches),
        f'<circle class="mark-start" cx="{x[0]:.1f}" cy="{y[0]:.1f}" r="6"/>',
        f'<rect class="mark-end" x="{x[-1] - 5:.1f}" y="{y[-1] - 5:.1f}" width="10" height="10"/>',
        '<circle id="path-cursor" class="mark-cursor" r="6" cx="-20" cy="-20"/>',
        "</svg>",
    ]
    return PathDrawing(
        svg="\n".join(parts),
        caption=_caption(track),
        coasting=bool(stretches),
        corridor=bool(zone),
        time=track.time[kept],
        x=x,
        y=y,
    )


def _vertices(track: Track, bands: list[tuple[float, float]]) -> tuple[NDArray[np.intp], list[slice]]:
    """Choose the samples that are drawn, and say which of the chosen ones are each stretch without GNSS."""
    found = np.minimum(np.searchsorted(track.time, np.array(bands).reshape(-1, 2)), track.time.size - 1)
    ends = [(a, b) for a, b in found.tolist() if b > a]
    each = max(2, min(40, OUTAGE_POINTS // max(1, len(ends))))
    added = [np.linspace(a, b, each).astype(np.intp) for a, b in ends]
    kept = np.unique(np.concatenate((path_indices(track.north, track.east), *added)))
    return kept, [slice(int(np.searchsorted(kept, a)), int(np.searchsorted(kept, b)) + 1) for a, b in ends]


def _caption(track: Track) -> str:
    if track.start_deg is None:
        return f"{track.point}."
    latitude, longitude = track.start_deg
    return f"{track.point}; from latitude {latitude:.6f}°, longitude {longitude:.6f}°."


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

    @property
    def step(self) -> float:
        """Distance of the grid lines, m."""
        return nice_step((WIDTH - LEFT - RIGHT) / self.scale, SCALE_PARTS)


def _grid(frame: _Frame) -> list[str]:
    """Grid lines with their metres: the same step along both axes."""
    half_wide = 0.5 * (WIDTH - LEFT - RIGHT) / frame.scale
    half_tall = 0.5 * (HEIGHT - TOP - BOTTOM) / frame.scale
    step = frame.step
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


def _scale_bar(frame: _Frame) -> list[str]:
    """Draw a bar as long as one step of the grid, below the box, where the path never is."""
    right, foot = WIDTH - RIGHT, HEIGHT - 6
    left = right - frame.step * frame.scale
    text = f"{frame.step / 1000:g} km" if frame.step >= 1000.0 else f"{frame.step:g} m"
    return [
        f'<path class="scale-bar" d="M{left:.1f} {foot - 7}V{foot}H{right}V{foot - 7}"/>',
        f'<text x="{left - 7:.1f}" y="{foot}" text-anchor="end">{text}</text>',
    ]


def _inside_the_box(svg: str) -> str:
    """Clip to the box of the axes: an inner drawing does that without a reference that would need an address."""
    wide, tall = WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM
    return f'<svg x="{LEFT}" y="{TOP}" width="{wide}" height="{tall}" viewBox="{LEFT} {TOP} {wide} {tall}">{svg}</svg>'


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
