"""The words and tables of the report: plain HTML that reads without scripts; every text is escaped here."""

from __future__ import annotations

import math
from collections.abc import Mapping
from html import escape
from typing import Final

import numpy as np

from levelhead.conventions import AXES, FloatArray
from levelhead.estimators.base import Result, Status
from levelhead.events import Event

ABSENT: Final = "–"
AXIS_NAMES: Final = {"x": "forward", "y": "right", "z": "down"}

COMPLETENESS_TEXTS: Final[dict[str, str]] = {
    "truncated": "The log is cut off: its end is missing. The results rest on the part before the cut.",
    "malformed_record": "The log has a malformed record; reading stopped there. The results rest on the part before.",
}

SEVERITIES: Final[dict[str, tuple[str, str]]] = {
    "E": ("serious", "Serious"),
    "W": ("warning", "Warning"),
    "S": ("state", "State"),
    "I": ("note", "Note"),
}
"""First letter of an event code: the CSS class and the word."""

PARAMETERS: Final[dict[str, tuple[str, str, str]]] = {
    "tau": ("tau", "s", "time constant of the roll and pitch correction"),
    "tau_heading": ("tau heading", "s", "time constant of the heading steered by the course"),
    "tau_gyro": ("tau gyro", "s", "time constant of the gyro bias estimate"),
    "omega_accel": ("omega accel", "rad/s", "rate constant of the accelerometer bias estimate"),
    "tau_gyro_lowpass": ("tau gyro low-pass", "s", "averaging time of the gyro biases, on straights"),
    "tau_accel_lowpass": ("tau accel low-pass", "s", "averaging time of the accelerometer biases, in turns"),
    "straight_rate": ("straight rate", "rad/s", "below this yaw rate the gyro biases are learnt"),
    "turn_rate": ("turn rate", "rad/s", "above this yaw rate the accelerometer biases are learnt"),
    "min_course_speed": ("minimum course speed", "m/s", "slower than this, the course does not steer the heading"),
    "gravity": ("gravity", "m/s²", "length of the gravity vector"),
    "lever_arm": ("lever arm", "m", "from the IMU to the antenna: forward, right, down"),
    "gain": ("gain", "", "general: by the vertical angular rate; paper: by the body's z rate, Eq. (12)"),
    "sideslip_std": ("sideslip", "rad", "one sigma between course and heading, for seconds at a time"),
    "axle_std": ("axle", "m", "one sigma of the distance from the IMU to the axle that does not steer"),
    "gyro_noise": ("gyro noise", "rad/s/√Hz", "noise density of the gyros, one-sided"),
    "accel_noise": ("accel noise", "m/s²/√Hz", "noise density of the accelerometers with the vibration, one-sided"),
    "gyro_bias_walk": ("gyro bias walk", "rad/s/√s", "random walk of the gyro biases"),
    "accel_bias_walk": ("accel bias walk", "m/s²/√s", "random walk of the accelerometer biases"),
    "velocity_std": ("velocity sigma", "m/s", "of a GNSS velocity, where the log does not tell it"),
    "initial_gyro_bias_std": ("initial gyro bias sigma", "rad/s", "of the gyro biases before the drive"),
    "initial_accel_bias_std": ("initial accel bias sigma", "m/s²", "of the accelerometer biases before the drive"),
    "position_std": ("position sigma", "m", "of a GNSS position, where the log does not tell it"),
    "timing_std": (
        "timing sigma",
        "s",
        "of a fix's stamp against the IMU's clock: along the way a position is off by it",
    ),
    "wheel_std": ("wheel speed sigma", "m/s", "of one reading; the tyre's radius is learnt besides"),
    "rear_axle": (
        "rear axle",
        "m",
        "from the IMU to the axle that does not steer, and does not slide: forward, right, down",
    ),
    "find_standstill": ("find standstill", "", "yes: velocity and rotation are taken as zero where the vehicle stands"),
    "use_positions": ("use positions", "", "no: the velocities alone are used"),
    "earth_rotation": (
        "Earth rotation",
        "",
        "yes: its rotation and local gravity are compensated where the place is known",
    ),
    "latitude": ("latitude", "rad", "for the Earth's rotation; absent: not compensated"),
    "use_gnss_acceleration": ("use GNSS acceleration", "", "false: the specific force is taken for gravity as it is"),
    "feedback": ("feedback", "", "true: estimates are subtracted from the platform's input; false: black box"),
}
"""Per parameter: the name for the reader, the unit inside, the meaning. One that is not here is shown as it is."""


def number(value: object, decimals: int, unit: str = "") -> str:
    """Format a number with its unit, or `ABSENT` where there is none.

    Parameters
    ----------
    value : object
        Anything; what is not a finite number is absent.
    decimals : int
        Digits after the point.
    unit : str
        Written after a no-break space.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not math.isfinite(float(value)):
        return ABSENT
    text = f"{float(value):.{decimals}f}"
    if float(text) == 0.0:
        text = text.lstrip("-")
    return f"{text}\u00a0{escape(unit)}" if unit else text


def span(seconds: object) -> str:
    """Format a time span as ``12.3 s``, ``3 min 04 s`` or ``1 h 02 min``; `ABSENT` for what is not a number."""
    if isinstance(seconds, bool) or not isinstance(seconds, int | float | np.number):
        return ABSENT
    value = float(seconds)
    if not math.isfinite(value):
        return ABSENT
    if value < 60.0:
        return f"{value:.1f}\u00a0s"
    whole = round(value)
    if whole < 3600:
        return f"{whole // 60}\u00a0min {whole % 60:02d}\u00a0s"
    minutes = round(value / 60.0)
    return f"{minutes // 60}\u00a0h {minutes % 60:02d}\u00a0min"


def distance(metres: object) -> str:
    """Format a distance as ``850 m`` or ``12.3 km``; `ABSENT` for what is not a number."""
    if isinstance(metres, int | float | np.number) and float(metres) >= 1000.0:
        return number(float(metres) / 1000.0, 2, "km")
    return number(metres, 0, "m")


def unknown_reason(result: Result, sensor: str, axis: int) -> str | None:
    """Say why a bias is not known, or return None for one that is.

    Parameters
    ----------
    result : Result
        Its ``known_*`` flags decide; the reason comes from its last status.
    sensor : {"gyro", "accel"}
        Which biases.
    axis : int
        0, 1, 2 for x, y, z.
    """
    gyro = sensor == "gyro"
    bias = float((result.gyro_bias if gyro else result.accel_bias)[-1, axis])
    known = (result.known_gyro if gyro else result.known_accel)[axis]
    if known and math.isfinite(bias):
        return None
    if not math.isfinite(bias):
        return "not estimated by this method"
    last = Status(int(result.status[-1]))
    taught = Status.ACCEL_SETTLED if not gyro else Status.HEADING_SETTLED if axis == 2 else Status.GYRO_SETTLED
    if taught in last:
        return "still moving or too uncertain when the log ended"
    if not gyro and Status.ACCEL_UNOBSERVABLE in last:
        return "hardly any turning"
    if Status.UNSEPARATED in last:
        return "gyro and accelerometer bias cannot be told apart"
    if (Status.INITIALIZING | Status.ALIGNING) & last:
        return "the heading never became known"
    if gyro and axis == 2:
        return "the course steered the heading too briefly"
    return "not learnt yet when the log ended"


def verdict(result: Result) -> str:
    """Say in one sentence which biases are known; HTML."""
    parts = []
    for sensor, name in (("gyro", "gyro"), ("accel", "accelerometer")):
        known = [axis for i, axis in enumerate(AXES) if unknown_reason(result, sensor, i) is None]
        if len(known) == 3:
            parts.append(f"The {name} biases are known on all three axes")
        elif known:
            parts.append(f"Of the {name} biases only {' and '.join(known)} {'is' if len(known) == 1 else 'are'} known")
        else:
            parts.append(f"The {name} biases are unknown")
    return " ".join(f"{part}." for part in (*parts, *advice(result)))


def advice(result: Result) -> tuple[str, ...]:
    """Say what to drive so that the next log tells what this one did not."""
    last = Status(int(result.status[-1]))
    estimated = np.isfinite(result.accel_bias[-1])
    if not np.any(estimated & ~np.array(result.known_accel)):
        return ()
    if Status.ACCEL_UNOBSERVABLE in last:
        return (
            "Turn left and right, a headland turn or two each way: on a straight line an accelerometer bias looks "
            "like tilt",
        )
    if Status.UNSEPARATED in last:
        return (
            "Change the rate and the direction of the turns: in a steady circle a gyro bias makes up for an "
            "accelerometer bias",
        )
    if (Status.INITIALIZING | Status.ALIGNING) & last:
        return ("Drive forward faster than 1 m/s: the heading comes from the course",)
    return ()


def banner(result: Result) -> str:
    """Return the banner of a log that was read only in part, or an empty string; HTML."""
    return log_banner(result.log_info)


def log_banner(info: Mapping[str, object]) -> str:
    """Return the banner of a log that was read only in part, from what is known about it; HTML."""
    completeness = str(info.get("completeness", "complete"))
    if completeness == "complete":
        return ""
    fallback = f"The log is not complete ({completeness}). The results rest on the part that could be read."
    text = escape(COMPLETENESS_TEXTS.get(completeness, fallback))
    return f'<div class="banner" role="alert"><strong>Read only in part.</strong> {text}</div>'


def facts(result: Result, version: str) -> str:
    """Return the list of what is known about the log and the method; HTML."""
    duration = float(result.time[-1] - result.time[0])
    return log_facts({"duration_s": duration, **result.log_info}, version, first=("Method", result.method))


def log_facts(info: Mapping[str, object], version: str, *, first: tuple[str, str]) -> str:
    """Return the list of what is known about a log, headed by a name and a text; HTML."""
    return fact_list(
        (first[0], escape(first[1])),
        ("Duration", span(info.get("duration_s"))),
        ("Distance", distance(info.get("distance_m"))),
        ("IMU", number(info.get("imu_rate_hz"), 1, "Hz")),
        ("GNSS", number(info.get("gnss_rate_hz"), 1, "Hz")),
        ("Format", escape(str(info.get("format", ABSENT)))),
        ("Log", escape(str(info.get("completeness", ABSENT)).replace("_", " "))),
        ("levelhead", escape(version)),
    )


def fact_list(*entries: tuple[str, str]) -> str:
    """Return names with their values, both HTML, as the head of a page."""
    return "\n".join(f"<div><dt>{name}</dt><dd>{value}</dd></div>" for name, value in entries)


def bias_table(result: Result, sensor: str) -> str:
    """Return the table of one sensor's biases at the end of the log; HTML.

    Parameters
    ----------
    result : Result
        What to show.
    sensor : {"gyro", "accel"}
        Which biases: deg/s or m/s^2.
    """
    gyro = sensor == "gyro"
    unit, scale = ("deg/s", 180.0 / math.pi) if gyro else ("m/s²", 1.0)
    bias = (result.gyro_bias if gyro else result.accel_bias)[-1] * scale
    sigma = (result.gyro_bias_std if gyro else result.accel_bias_std)[-1] * scale
    reasons = [unknown_reason(result, sensor, i) for i in range(3)]
    decimals = _decimals(sigma)
    rows = []
    for i, axis in enumerate(AXES):
        head = f'<th scope="row"><span class="swatch tone-{i}"></span>{axis} <small>{AXIS_NAMES[axis]}</small></th>'
        reason = reasons[i]
        if reason is None:
            cells = (
                f'<td class="value">{number(bias[i], decimals)}</td><td class="sigma">{number(sigma[i], decimals)}</td>'
            )
        else:
            cells = f'<td class="unknown" colspan="2">unknown <small>{escape(reason)}</small></td>'
        rows.append(f"<tr>{head}{cells}</tr>")
    title = "Gyro biases" if gyro else "Accelerometer biases"
    return (
        f'<table class="bias"><caption>{title} <small>{_settled(result, sensor, reasons)}</small></caption>\n'
        f'<thead><tr><th scope="col">axis</th><th scope="col">bias, {unit}</th>'
        f'<th scope="col">one sigma, {unit}</th></tr></thead>\n<tbody>\n' + "\n".join(rows) + "\n</tbody></table>"
    )


def _decimals(sigma: FloatArray) -> int:
    """Four digits, more when one sigma is too small to be seen in four."""
    small = sigma[np.isfinite(sigma) & (sigma > 0.0)]
    if small.size == 0:
        return 4
    return min(7, max(4, 1 - math.floor(math.log10(float(small.min())))))


def _settled(result: Result, sensor: str, reasons: list[str | None]) -> str:
    if all(reason is not None for reason in reasons):
        return ""
    at = result.settled_at_s.get(sensor)
    return "not settled" if at is None else f"settled after {span(at)}"


def parameter_table(result: Result) -> str:
    """Return the table of the constants that were used; HTML."""
    if not result.params:
        return "<p>This method has no constants.</p>"
    rows = []
    for key, value in result.params.items():
        name, unit, meaning = PARAMETERS.get(key, (key.replace("_", " "), "", ""))
        shown, unit = _readable(value, unit)
        rows.append(
            f'<tr><th scope="row">{escape(name)}</th><td class="value">{escape(shown)}</td>'
            f"<td>{escape(unit)}</td><td>{escape(meaning)}</td></tr>"
        )
    return (
        '<table class="constants"><thead><tr><th scope="col">constant</th><th scope="col">value</th>'
        '<th scope="col">unit</th><th scope="col">meaning</th></tr></thead>\n<tbody>\n'
        + "\n".join(rows)
        + "\n</tbody></table>"
    )


def _readable(value: object, unit: str) -> tuple[str, str]:
    """Turn a parameter into text, angles into degrees."""
    scale = 1.0
    if unit.startswith("rad"):
        scale, unit = 180.0 / math.pi, "deg" + unit[3:]
    if isinstance(value, bool):
        return ("yes" if value else "no"), unit
    if isinstance(value, int | float | np.number):
        return f"{float(value) * scale:.6g}", unit
    if isinstance(value, Mapping):
        return ", ".join(f"{k} {_readable(v, '')[0]}" for k, v in value.items()), unit
    if isinstance(value, list | tuple | np.ndarray):
        return ", ".join(_readable(v * scale if scale != 1.0 else v, "")[0] for v in value), unit
    return (ABSENT if value is None else str(value)), unit


def event_list(events: tuple[Event, ...]) -> str:
    """Return the list of what happened to the data; HTML."""
    if not events:
        return '<p class="quiet">Nothing to report: no gaps, no dropped samples.</p>'
    items = []
    for event in sorted(events, key=lambda e: "EWSI".find(e.code[:1])):
        style, word = SEVERITIES.get(event.code[:1], SEVERITIES["I"])
        items.append(
            f'<li class="{style}"><span class="chip">{word}</span> {escape(event.text)}'
            f" <small>{_when(event)} <code>{escape(event.code)}</code></small></li>"
        )
    return '<ul class="events">\n' + "\n".join(items) + "\n</ul>"


def _when(event: Event) -> str:
    times = "once" if event.count == 1 else f"{event.count} times"
    if event.first_s is None:
        return f"{times}."
    if event.last_s is None or event.last_s == event.first_s:
        return f"{times}, at {number(event.first_s, 1, 's')}."
    return f"{times}, between {number(event.first_s, 1, 's')} and {number(event.last_s, 1, 's')}."


def footer(result: Result) -> str:
    """Say how long the work took, where the result knows; HTML."""
    parts = [f"{escape(str(step))} {number(seconds, 2, 's')}" for step, seconds in result.runtime_s.items()]
    return f"Time spent: {', '.join(parts)}. " if parts else ""
