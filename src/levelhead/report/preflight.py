"""The report's section on the preflight: what was found in the log before anything was estimated, with its margins."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Final

from levelhead.estimators.base import Result
from levelhead.preflight import Verdict

STYLES: Final[dict[str, str]] = {
    Verdict.REFUSED: "serious",
    Verdict.CORRECTED: "note",
    Verdict.WARNING: "warning",
    Verdict.UNDECIDED: "warning",
    Verdict.NOTED: "state",
    Verdict.FINE: "state",
}
"""The class of a verdict's chip."""


def preflight_section(result: Result) -> str:
    """Return the section as HTML, empty where the log was not checked."""
    about = result.log_info.get("preflight")
    findings = about.get("findings") if isinstance(about, Mapping) else None
    if not isinstance(findings, list) or not findings:
        return ""
    rows = "\n".join(_row(finding) for finding in findings if isinstance(finding, Mapping))
    changed, open_ = (
        sum(f.get("verdict") == verdict for f in findings if isinstance(f, Mapping))
        for verdict in (Verdict.CORRECTED, Verdict.UNDECIDED)
    )
    lead = (
        ("Everything was as the log says." if open_ == 0 else "Nothing was put right.")
        if changed == 0
        else f"{changed} thing{'s were' if changed > 1 else ' was'} put right before the biases were estimated."
    )
    if open_:
        lead += f" {open_} thing{'s' if open_ > 1 else ''} the drive could not tell."
    return (
        '<section aria-labelledby="preflight">\n<h2 id="preflight">Preflight</h2>\n'
        f'<p class="lead">{lead}</p>\n<div class="card">\n<table class="findings">\n'
        '<thead><tr><th scope="col">What</th><th scope="col">Verdict</th><th scope="col">Finding</th></tr></thead>\n'
        f"<tbody>\n{rows}\n</tbody></table>\n</div>\n"
        '<p class="note">Units, axes, frames, clocks and mounting are found from the data alone: gravity, turns and '
        "course, GNSS accelerations against the readings. +- is one sigma.</p>\n</section>"
    )


def _row(finding: Mapping[str, object]) -> str:
    verdict = str(finding.get("verdict"))
    style = STYLES.get(verdict, "state")
    return (
        f'<tr><th scope="row">{escape(str(finding.get("name")))}</th>'
        f'<td class="{style}"><span class="chip">{escape(verdict)}</span></td>'
        f"<td>{escape(str(finding.get('text')))}</td></tr>"
    )
