"""What the report draws: curves over time, the bands behind them and the path, decimated, in the reader's units."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from levelhead.conventions import AXES, FloatArray, StatusArray
from levelhead.errors import UsageError
from levelhead.estimators.base import Result, Status
from levelhead.report.decimate import encode, minmax_indices, wrap_with_gaps

TIME_DECIMALS: Final = 3
YAW_RATE_SPAN: Final = 0.2
"""Central differences of the heading span this time, s: a shorter one shows noise, a longer one blurs turns."""
MAX_BANDS: Final = 400
"""At most about this many bands of one kind: what lies closer together than a pixel is drawn as one."""

BAND_KINDS: Final[dict[str, tuple[Status, str]]] = {
    "start": (Status.INITIALIZING | Status.ALIGNING, "starting: attitude or heading not known yet"),
    "coast": (Status.COASTING, "no GNSS correction: biases held"),
    "reverse": (Status.REVERSE, "driving backwards"),
}
"""Kind of band: the flags that it shows and what the key says."""


@dataclass(frozen=True, kw_only=True)
class Curve:
    """One line of a plot: ``values`` on the plot's time base, ``tone`` the number of its colour in the palette."""

    label: str
    values: FloatArray
    tone: int
    faint: bool = False
    dashed: bool = False


@dataclass(frozen=True, kw_only=True)
class Plot:
    """One plot over time: ``time`` in s; ``absent`` stands where there is nothing to draw.

    ``cyclic`` angles are drawn from 0 to 360; a ``focused`` plot may leave a few peaks outside its first look.
    """

    name: str
    title: str
    unit: str
    decimals: int
    time: FloatArray
    curves: tuple[Curve, ...]
    absent: str = ""
    cyclic: bool = False
    focused: bool = False

    @property
    def drawable(self) -> bool:
        """Whether there is anything to draw."""
        return any(np.isfinite(curve.values).any() for curve in self.curves)

    @property
    def view(self) -> tuple[float, float] | None:
        """The vertical range of the first look; None means that of the data."""
        if self.cyclic:
            return 0.0, 360.0
        finite = [curve.values[np.isfinite(curve.values)] for curve in self.curves]
        finite = [values for values in finite if values.size]
        values = np.concatenate(finite) if finite else np.empty(0)
        if not self.focused or values.size < 100:
            return None
        # Zero and the last values stay in sight: the way of a bias from the one to the other is what the plot is for.
        anchors = [0.0, *(curve[-1] for curve in finite)]
        low = min(float(np.percentile(values, 2.0)), *anchors)
        high = max(float(np.percentile(values, 98.0)), *anchors)
        # Four times: start-up and GNSS transients are that large, honest drives are not.
        if values.max() - values.min() <= 4.0 * (high - low) or high <= low:
            return None
        margin = 0.5 * (high - low)
        return max(float(low - margin), float(values.min())), min(float(high + margin), float(values.max()))

    def as_dict(self) -> dict[str, object]:
        """Return the plot as the page's script reads it."""
        return {
            "name": self.name,
            "unit": self.unit,
            "decimals": self.decimals,
            "view": self.view,
            "cyclic": self.cyclic,
            "time": encode(self.time, TIME_DECIMALS),
            "curves": [
                {
                    "label": c.label,
                    "tone": c.tone,
                    "faint": c.faint,
                    "dashed": c.dashed,
                    "values": encode(c.values, self.decimals),
                }
                for c in self.curves
            ],
        }


def time_plots(result: Result, reference: Mapping[str, ArrayLike] | None = None) -> tuple[Plot, ...]:
    """Prepare the six plots over time.

    Parameters
    ----------
    result : Result
        What to show.
    reference : mapping, optional
        The truth of a simulated run: ``time`` (m,), ``gyro_bias`` and ``accel_bias`` (m, 3), ``roll``, ``pitch``,
        ``heading`` (m,), SI and radians; a missing one is not drawn.

    Returns
    -------
    tuple of Plot
        Gyro bias, accelerometer bias, roll and pitch, heading, speed, yaw rate.

    Raises
    ------
    UsageError
        When the reference has no ``time`` or shapes that do not fit it.
    """
    truth = _Truth.from_mapping(reference)
    heading = _unwrapped(result.heading)
    return (
        _bias_plot(result, "gyro", truth),
        _bias_plot(result, "accel", truth),
        _attitude_plot(result, truth),
        _heading_plot(result, heading, truth),
        _single_plot(
            result.time,
            np.hypot(result.velocity_ned[:, 0], result.velocity_ned[:, 1]),
            Plot(name="speed", title="Speed", unit="m/s", decimals=3, time=result.time, curves=()),
            "The log gives no velocity.",
        ),
        _single_plot(
            result.time,
            np.degrees(yaw_rate(result.time, heading)),
            Plot(
                name="yaw-rate", title="Yaw rate", unit="deg/s", decimals=2, time=result.time, curves=(), focused=True
            ),
            "No yaw rate: the heading never became known.",
        ),
    )


def yaw_rate(time: FloatArray, heading: FloatArray) -> FloatArray:
    """Differentiate an unwrapped heading.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Seconds, increasing.
    heading : ndarray, shape (n,)
        Unwrapped, rad; NaN is a gap.

    Returns
    -------
    ndarray, shape (n,)
        rad/s, central differences over `YAW_RATE_SPAN`, one-sided at the ends; NaN beside gaps and across time gaps.
    """
    n = time.size
    interval = float(np.median(np.diff(time)))
    half = max(1, round(0.5 * YAW_RATE_SPAN / interval))
    before = np.maximum(np.arange(n) - half, 0)
    after = np.minimum(np.arange(n) + half, n - 1)
    span = time[after] - time[before]
    rate = (heading[after] - heading[before]) / span
    rate[span > 3.0 * (2 * half) * interval] = np.nan
    return rate


def status_bands(time: FloatArray, status: StatusArray) -> dict[str, list[tuple[float, float]]]:
    """Find when the estimator was starting, coasting, or driving backwards.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Seconds.
    status : ndarray, shape (n,), uint32
        `Status` flags.

    Returns
    -------
    dict
        Per kind of `BAND_KINDS`, the (from, to) times in s; neighbours too close to be seen apart are one band.
    """
    least_gap = (time[-1] - time[0]) / MAX_BANDS
    bands = {}
    for kind, (flags, _) in BAND_KINDS.items():
        on = (status & np.uint32(flags)) != 0
        edges = np.flatnonzero(np.diff(on, prepend=False, append=False))
        first, last = time[edges[0::2]], time[np.minimum(edges[1::2], time.size - 1)]
        apart = first[1:] - last[:-1] > least_gap
        first = first[np.concatenate(([True], apart))] if first.size else first
        last = last[np.concatenate((apart, [True]))] if last.size else last
        bands[kind] = [(round(float(a), 3), round(float(b), 3)) for a, b in zip(first, last, strict=True)]
    return bands


def status_shares(status: StatusArray) -> dict[str, float]:
    """Return, per kind of `BAND_KINDS`, the share of the samples in that state, 0 to 1."""
    return {kind: float(np.mean((status & np.uint32(f)) != 0)) for kind, (f, _) in BAND_KINDS.items()}


@dataclass(frozen=True, kw_only=True)
class _Truth:
    """The reference, interpolated on demand; empty without one."""

    time: FloatArray
    columns: Mapping[str, FloatArray]

    @classmethod
    def from_mapping(cls, reference: Mapping[str, ArrayLike] | None) -> _Truth:
        if reference is None:
            return cls(time=np.empty(0), columns={})
        if "time" not in reference:
            raise UsageError("The reference of the report has no time; give it as reference['time'], in seconds.")
        time = np.asarray(reference["time"], dtype=np.float64)
        columns = {}
        for name in ("gyro_bias", "accel_bias", "roll", "pitch", "heading"):
            if name not in reference:
                continue
            column = np.asarray(reference[name], dtype=np.float64)
            wanted = (time.size, 3) if name.endswith("bias") else (time.size,)
            if column.shape != wanted:
                raise UsageError(
                    f"{name} of the report's reference has the shape {column.shape}; its time wants {wanted}."
                )
            columns[name] = _unwrapped(column) if name == "heading" else column
        return cls(time=time, columns=columns)

    def at(self, time: FloatArray, name: str, axis: int | None = None) -> FloatArray | None:
        """Interpolate one quantity, or return None when the reference does not have it."""
        if name not in self.columns:
            return None
        column = self.columns[name] if axis is None else self.columns[name][:, axis]
        return np.interp(time, self.time, column, left=np.nan, right=np.nan)


def _unwrapped(angle: FloatArray) -> FloatArray:
    """Unwrap an angle, rad; the gaps stay."""
    unwrapped = np.full(angle.shape, np.nan)
    finite = np.isfinite(angle)
    unwrapped[finite] = np.unwrap(angle[finite])
    return unwrapped


def _with_truth(curves: Sequence[Curve], truths: Sequence[FloatArray | None]) -> tuple[Curve, ...]:
    """Put the truth after the estimates: its thin dashes are drawn over them."""
    dashed = [
        Curve(label=f"{curve.label} truth", values=values, tone=curve.tone, dashed=True)
        for curve, values in zip(curves, truths, strict=True)
        if values is not None
    ]
    return (*curves, *dashed)


def _bias_plot(result: Result, sensor: str, truth: _Truth) -> Plot:
    gyro = sensor == "gyro"
    biases = np.degrees(result.gyro_bias) if gyro else result.accel_bias
    known = result.known_gyro if gyro else result.known_accel
    kept = minmax_indices(biases)
    time = result.time[kept]
    curves = []
    for i, axis in enumerate(AXES):
        label = axis if known[i] else f"{axis} (unknown)"
        curves.append(Curve(label=label, values=biases[kept, i], tone=i, faint=not known[i]))
    truths = [truth.at(time, f"{sensor}_bias", i) for i in range(3)]
    if gyro:
        truths = [None if t is None else np.degrees(t) for t in truths]
    drawn = [i for i in range(3) if np.isfinite(curves[i].values).any()]
    return Plot(
        name=f"{sensor}-bias",
        title="Gyro biases" if gyro else "Accelerometer biases",
        unit="deg/s" if gyro else "m/s²",
        decimals=6 if gyro else 5,
        time=time,
        curves=_with_truth([curves[i] for i in drawn], [truths[i] for i in drawn]),
        absent=f"This method does not estimate {'gyro' if gyro else 'accelerometer'} biases.",
        focused=True,
    )


def _attitude_plot(result: Result, truth: _Truth) -> Plot:
    angles = np.degrees(np.column_stack((result.roll, result.pitch)))
    kept = minmax_indices(angles)
    time = result.time[kept]
    curves = [Curve(label=name, values=angles[kept, i], tone=i) for i, name in enumerate(("roll", "pitch"))]
    truths = [None if t is None else np.degrees(t) for t in (truth.at(time, "roll"), truth.at(time, "pitch"))]
    return Plot(
        name="attitude",
        title="Roll and pitch",
        unit="deg",
        decimals=3,
        time=time,
        curves=_with_truth(curves, truths),
        absent="Roll and pitch never became known.",
        focused=True,
    )


def _heading_plot(result: Result, heading: FloatArray, truth: _Truth) -> Plot:
    kept = minmax_indices(heading)
    columns = [heading[kept]]
    true_heading = truth.at(result.time[kept], "heading")
    if true_heading is not None:
        columns.append(true_heading)
    time, wrapped = wrap_with_gaps(result.time[kept], np.degrees(np.column_stack(columns)))
    curve = Curve(label="heading", values=wrapped[:, 0], tone=0)
    return Plot(
        name="heading",
        title="Heading",
        unit="deg",
        decimals=2,
        time=time,
        curves=_with_truth([curve], [wrapped[:, 1] if true_heading is not None else None]),
        absent="The heading never became known: no trustworthy course was seen.",
        cyclic=True,
    )


def _single_plot(time: FloatArray, values: FloatArray, frame: Plot, absent: str) -> Plot:
    kept = minmax_indices(values)
    return Plot(
        name=frame.name,
        title=frame.title,
        unit=frame.unit,
        decimals=frame.decimals,
        time=time[kept],
        curves=(Curve(label=frame.title.lower(), values=values[kept], tone=0),),
        absent=absent,
        focused=frame.focused,
    )


def nice_step(span: float, count: int) -> float:
    """Return the 1, 2 or 5 times a power of ten that divides a span into at most about ``count`` parts."""
    raw = span / count
    power = 10.0 ** math.floor(math.log10(raw))
    return next(power * factor for factor in (1.0, 2.0, 5.0, 10.0) if power * factor >= raw * 0.999)
