"""`render_validation`: added biases and changed constants as one self-contained page of tables."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from typing import Final

import numpy as np
from numpy.typing import NDArray

from levelhead.analysis.injection import Recovery, Sensitivity, Validation, largest
from levelhead.analysis.outages import OutageTest
from levelhead.conventions import AXES, FloatArray
from levelhead.report import tables
from levelhead.report.outages import outage_section
from levelhead.report.page import render_page
from levelhead.version import __version__

Flags = NDArray[np.bool_]

DEG: Final = math.degrees(1.0)
GYRO_DIGITS: Final = 4
ACCEL_DIGITS: Final = 4
TILT_DIGITS: Final = 3


def render_validation(
    validation: Validation, changes: Sensitivity, *, title: str, outages: OutageTest | None = None
) -> str:
    """Render a validation as a self-contained HTML page.

    Parameters
    ----------
    validation : Validation
        Recovered biases.
    changes : Sensitivity
        What a change of each constant does.
    title : str
        Heading of the page; any text, it is escaped.
    outages : OutageTest, optional
        What the position did without GNSS; not shown where absent.

    Returns
    -------
    str
        The page, without scripts. The same inputs give the same text.
    """
    body = [
        tables.log_banner(validation.log_info),
        '<section aria-labelledby="recovery"><h2 id="recovery">Added biases found again</h2>'
        f'<p class="lead">{_verdict(validation)}</p><div class="card scroll">{_cases(validation)}</div>'
        '<p class="note">Estimate with the added bias, less the estimate without it, less what was added, at the end '
        "of the log: Tereshkov (2015), section 4. A dash is an axis that the method does not know on this log.</p>"
        "</section>",
        '<section aria-labelledby="sensitivity"><h2 id="sensitivity">Constants changed</h2>'
        f'<p class="lead">{_sensitivity_verdict(changes)}</p><div class="card scroll">{_changes(changes)}</div>'
        '<p class="note">How far the final biases move, and roll and pitch over the log, when one constant changes. '
        "The paper reports less than 0.001 deg/s and 0.01 m/s² for its own drive.</p></section>",
    ]
    if outages is not None:
        body.append(outage_section(outages))
    return render_page(
        title=title,
        source=str(validation.log_info.get("source") or ""),
        facts=tables.log_facts(validation.log_info, __version__, first=("Method", validation.method)),
        body="\n".join(body),
    )


def _verdict(validation: Validation) -> str:
    parts = [
        f"{_at_most(validation.worst(sensor) * scale, digits)}\u00a0{unit} ({sensor})"
        for sensor, scale, digits, unit in (("gyro", DEG, GYRO_DIGITS, "deg/s"), ("accel", 1.0, ACCEL_DIGITS, "m/s²"))
        if math.isfinite(validation.worst(sensor))
    ]
    if not parts:
        return "No bias is known on this log, so that none could be found again."
    text = f"In {len(validation.recoveries)} cases the added biases came back to within {' and '.join(parts)}."
    judged = [r.within_3_sigma for r in validation.recoveries if r.within_3_sigma is not None]
    if judged:
        text += f" Within three sigma: {sum(judged)} of {len(judged)}."
    lost = sum(bool(r.lost) for r in validation.recoveries)
    if lost:
        text += f" In {lost} of the cases a bias that is known without them was no longer known."
    return text


def _at_most(value: float, digits: int) -> str:
    """Return a bound that is never shown as zero: one step of the last digit at least."""
    return tables.number(max(value, 10.0**-digits), digits)


def _cases(validation: Validation) -> str:
    shown = [_given(validation.errors(sensor)) for sensor in ("gyro", "accel")]
    cases = [recovery.case for recovery in validation.recoveries]
    added = [np.any([getattr(c, name) for c in cases], axis=0) for name in ("gyro_bias", "accel_bias")]
    head = _head(
        ("added to gyro, deg/s", _axes(added[0])),
        ("added to accel, m/s²", _axes(added[1])),
        ("gyro error, deg/s", _axes(shown[0])),
        ("accel error, m/s²", _axes(shown[1])),
        ("three sigma", ("",)),
        first="",
    )
    rows = [_case_row(k, recovery, added, shown) for k, recovery in enumerate(validation.recoveries)]
    worst = [
        np.array([largest(column) for column in validation.errors(sensor)[:, there].T])
        for sensor, there in zip(("gyro", "accel"), shown, strict=True)
    ]
    total = _numbers(worst[0] * DEG, GYRO_DIGITS) + _numbers(worst[1], ACCEL_DIGITS)
    gap = f'<td colspan="{np.sum(added)}"></td>' if np.any(added) else ""
    rows.append(f'<tr class="total"><th scope="row">largest</th>{gap}{total}<td></td></tr>')
    return f'<table class="matrix">{head}<tbody>\n' + "\n".join(rows) + "\n</tbody></table>"


def _given(rows: FloatArray) -> Flags:
    """Return which of the columns (n, 3) have anything in them."""
    return np.array([bool(np.isfinite(column).any()) for column in rows.reshape(-1, 3).T])


def _axes(there: Flags) -> tuple[str, ...]:
    return tuple(axis for axis, yes in zip(AXES, there, strict=True) if yes)


def _head(*groups: tuple[str, Sequence[str]], first: str) -> str:
    """Return a head of two rows: groups, and the columns within each."""
    top = f'<tr><th scope="col" class="name" rowspan="2">{first}</th>'
    below = "<tr>"
    for name, columns in groups:
        if columns == ("",):
            top += f'<th scope="col" rowspan="2">{name}</th>'
            continue
        if columns:
            top += f'<th scope="colgroup" class="group" colspan="{len(columns)}">{name}</th>'
        below += "".join(f'<th scope="col">{column}</th>' for column in columns)
    return f"<thead>{top}</tr>{below}</tr></thead>\n"


def _case_row(k: int, recovery: Recovery, added: list[Flags], shown: list[Flags]) -> str:
    case = recovery.case
    texts = [f"{v * DEG:+.2f}" if v else "" for v in np.array(case.gyro_bias)[added[0]]]
    texts += [f"{v:+.1f}" if v else "" for v in np.array(case.accel_bias)[added[1]]]
    cells = "".join(f"<td>{text}</td>" for text in texts)
    cells += _numbers(recovery.gyro_error[shown[0]] * DEG, GYRO_DIGITS)
    cells += _numbers(recovery.accel_error[shown[1]], ACCEL_DIGITS)
    within = recovery.within_3_sigma
    word = tables.ABSENT if within is None else "within" if within else '<strong class="far">beyond</strong>'
    if recovery.lost:
        word = f'<strong class="far">no longer known: {escape(", ".join(recovery.lost))}</strong>'
    return f'<tr><th scope="row">{k + 1}</th>{cells}<td>{word}</td></tr>'


def _numbers(values: FloatArray, decimals: int) -> str:
    return "".join(f"<td>{tables.number(value, decimals)}</td>" for value in values)


def _sensitivity_verdict(changes: Sensitivity) -> str:
    gyro, accel = changes.worst("gyro"), changes.worst("accel")
    parts = [f"{_at_most(gyro * DEG, GYRO_DIGITS)}\u00a0deg/s"] if math.isfinite(gyro) else []
    parts += [f"{_at_most(accel, ACCEL_DIGITS)}\u00a0m/s²"] if math.isfinite(accel) else []
    if not parts:
        return "No bias is known on this log."
    share = max((abs(change.change) for change in changes.changes), default=0.0)
    text = f"A change of {share:.0%} in any constant moves the final biases by at most {' and '.join(parts)}."
    lost = sum(bool(change.lost) for change in changes.changes)
    return f"{text} In {lost} of {len(changes.changes)} changes a bias is no longer known." if lost else text


def _changes(changes: Sensitivity) -> str:
    shown = [_given(np.array([getattr(change, sensor) for change in changes.changes])) for sensor in ("gyro", "accel")]
    head = _head(
        ("change", ("",)),
        ("gyro, deg/s", _axes(shown[0])),
        ("accel, m/s²", _axes(shown[1])),
        ("RMS, deg", ("roll", "pitch")),
        first="constant",
    )
    rows = []
    for change in changes.changes:
        name, *_ = tables.PARAMETERS.get(change.name, (change.name.replace("_", " "), "", ""))
        cells = _numbers(change.gyro[shown[0]] * DEG, GYRO_DIGITS) + _numbers(change.accel[shown[1]], ACCEL_DIGITS)
        cells += _numbers(change.tilt * DEG, TILT_DIGITS)
        if change.refused:
            width = int(shown[0].sum() + shown[1].sum()) + 2
            cells = f'<td class="unknown" colspan="{width}">not possible: {escape(change.refused)}</td>'
        rows.append(f'<tr><th scope="row">{escape(name)}</th><td>{change.change:+.0%}</td>{cells}</tr>')
    return f'<table class="matrix">{head}<tbody>\n' + "\n".join(rows) + "\n</tbody></table>"
