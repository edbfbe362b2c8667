"""`check`: what a log is, what is put right in it, and what stands against using it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from levelhead.conventions import FloatArray
from levelhead.errors import LogError
from levelhead.events import Event, merge_events
from levelhead.logs.log import Log
from levelhead.logs.pieces import Fact
from levelhead.preflight import decide
from levelhead.preflight.corrections import Corrections, Told, told_corrections
from levelhead.preflight.excitation import excitation
from levelhead.preflight.findings import Finding, Verdict
from levelhead.preflight.health import health
from levelhead.preflight.look import Look, look_at, motion_of


@dataclass(frozen=True, kw_only=True, eq=False)
class Preflight:
    """What `check` finds.

    Attributes
    ----------
    findings : tuple of Finding
        Everything that was looked at, decisions first.
    corrections : Corrections
        What was put right.
    log : Log
        The log with the corrections; its ``meta`` has ``dcm_file_to_body``, ``latency_s``, ``mounting_deg`` and
        ``preflight``, its events the codes of the findings. Where something was refused, corrected as far as is
        certain.
    """

    findings: tuple[Finding, ...]
    corrections: Corrections
    log: Log

    @property
    def refused(self) -> tuple[Finding, ...]:
        """The findings for which the log must not be used as it is."""
        return tuple(f for f in self.findings if f.verdict is Verdict.REFUSED)

    def trusted(self) -> Log:
        """Return the corrected log.

        Raises
        ------
        LogError
            When something was refused; the sentences say what to pass.
        """
        if self.refused:
            name = self.log.meta.get("source") or "The log"
            told = " ".join(f"{f.name[:1].upper()}{f.name[1:]}: {f.text}" for f in self.refused)
            raise LogError(f"{name} cannot be trusted as it is. {told}")
        return self.log

    def as_dict(self) -> dict[str, object]:
        """Return the findings as `summary.json` shows them."""
        return {"findings": [f.as_dict() for f in self.findings]}


def check(log: Log, *, told: Told | None = None) -> Preflight:
    """Look at a log before anything is estimated from it, and put right what is certainly wrong.

    Units, axes, signs, the velocity's frame, the clocks and the mounting are found from the data alone: gravity, turns
    against the course, and GNSS accelerations against specific forces in short windows. What neither format nor file
    says (``meta["undeclared"]``), or only the rules of the canonical log say (``meta["assumed"]``), is corrected;
    what the log declares, as every `Log` made by hand does, is refused where the data contradicts it. Clock offset
    and mounting yaw are corrected in any case.

    Parameters
    ----------
    log : Log
        As it was read.
    told : Told, optional
        What the user knows; it goes before what is found, and is refused where the data contradicts it.

    Returns
    -------
    Preflight

    Raises
    ------
    UsageError
        When what is told makes no sense.
    LogError
        When the log has no GNSS velocities, and too few positions to derive them from.
    """
    told = told or Told()
    claims = decide.Claims.of(log.meta, _told_facts(told))
    given = told_corrections(told)
    start = given.apply(log)
    look = look_at(
        start,
        lever_arm=told.lever_arm,
        frame_told=told.velocity_frame is not None,
        frame_open="velocity_frame" in claims.unknown,
    )
    findings, found = _decisions(start, look, claims)
    if told.latency_s is not None:
        found, findings = _latency_as_told(found, findings)
    if told.mounting_yaw is not None:
        found, findings = _yaw_as_told(found, findings)
    fixed = found.apply(start)
    all_found = (*findings, *health(fixed, motion_of(fixed)), *excitation(fixed, look.motion))
    both = _together(given, found)
    return Preflight(findings=all_found, corrections=both, log=_marked(fixed, all_found, both, told))


def _told_facts(told: Told) -> frozenset[Fact]:
    facts: dict[Fact, object] = {
        "gyro_unit": told.gyro_unit,
        "accel_unit": told.accel_unit,
        "axes": told.axes,
        "velocity_frame": told.velocity_frame,
        "clock": told.latency_s,
    }
    return frozenset(fact for fact, value in facts.items() if value is not None)


def _decisions(log: Log, look: Look, claims: decide.Claims) -> tuple[list[Finding], Corrections]:
    findings: list[Finding] = []
    fix = Corrections()
    for decision in (decide.accel_unit, decide.gyro_unit, decide.velocity_frame):
        finding, fix = decision(look, claims, fix)
        findings.append(finding)
    unit = decide.velocity_unit(look)
    findings += [] if unit is None else [unit]
    middle = 0.5 * float(log.time[0] + log.time[-1])
    more, fix = decide.axes(look, claims, fix, middle, log.duration)
    findings += more
    finding, fix = decide.clock(look, claims, fix, middle, log.duration)
    findings.append(finding)
    arm = decide.lever(look, look.lever_told)
    return findings + ([] if arm is None else [arm]), fix


def _latency_as_told(found: Corrections, findings: list[Finding]) -> tuple[Corrections, list[Finding]]:
    """Leave the clock to the user; what the data says besides is a warning."""
    kept = replace(found, latency_s=0.0, clock_drift=0.0)
    return kept, [_as_told(f, "--latency") if f.name == "clock" else f for f in findings]


def _yaw_as_told(found: Corrections, findings: list[Finding]) -> tuple[Corrections, list[Finding]]:
    """Leave the mounting to the user; axes that are wrong besides stay found."""
    if any(f.name == "axes" and f.verdict is Verdict.CORRECTED for f in findings):
        return found, findings
    kept = replace(found, gyro_dcm=np.eye(3), accel_dcm=np.eye(3))
    return kept, [_as_told(f, "--mounting-yaw") if f.name == "mounting yaw" else f for f in findings]


def _as_told(finding: Finding, option: str) -> Finding:
    if finding.verdict is Verdict.CORRECTED:
        text = finding.text.replace(": taken off.", f" besides what {option} says: left as told.")
        return replace(finding, verdict=Verdict.WARNING, text=text)
    return finding


def _together(first: Corrections, second: Corrections) -> Corrections:
    """Return the one correction that does both, one after the other."""
    return Corrections(
        gyro_factor=first.gyro_factor * second.gyro_factor,
        accel_factor=first.accel_factor * second.accel_factor,
        gyro_dcm=second.gyro_dcm @ first.gyro_dcm,
        accel_dcm=second.accel_dcm @ first.accel_dcm,
        velocity_frame=first.velocity_frame if second.velocity_frame == "NED" else second.velocity_frame,
        latency_s=first.latency_s + second.latency_s,
        clock_drift=second.clock_drift,
    )


def _told(finding: Finding) -> str:
    """Return what an event says of a finding."""
    put_right = finding.verdict is Verdict.CORRECTED and not finding.text.endswith("taken off.")
    return f"{finding.text} Put right." if put_right else finding.text


def _as_read(log: Log) -> FloatArray:
    """Return the rotation from the file's axes to those in which the reader gave the readings."""
    dcm = log.meta.get("dcm_file_to_body")
    return np.eye(3) if dcm is None else np.asarray(dcm, dtype=np.float64)


def _marked(log: Log, findings: tuple[Finding, ...], fix: Corrections, told: Told) -> Log:
    """Return the log with what was found in its meta and its events; what was told goes before what was found."""
    events = [
        Event(code=f.code, count=1, detail=_told(f))
        for f in findings
        if f.code and f.verdict not in (Verdict.FINE, Verdict.UNDECIDED) and f.code != "W_COMPENSATED"
    ]
    values = {f.name: f.values for f in findings}
    mounting = {axis: values.get("mounting yaw", {}).get(f"{axis}_deg") for axis in ("yaw", "pitch", "roll")}
    turned = any(f.name == "axes" and f.verdict is Verdict.CORRECTED for f in findings)
    if told.mounting_yaw is not None and not turned:
        mounting["yaw"] = math.degrees(told.mounting_yaw)
    found_late = values.get("clock", {}).get("latency_s")
    meta: dict[str, object] = {
        "dcm_file_to_body": tuple(tuple(float(v) for v in row) for row in fix.accel_dcm @ _as_read(log)),
        "latency_s": found_late if told.latency_s is None else told.latency_s,
        "preflight": {"findings": [f.as_dict() for f in findings]},
    }
    if mounting["yaw"] is not None:
        meta["mounting_deg"] = mounting
    return replace(log, meta={**log.meta, **meta}, events=merge_events((*log.events, *events)))
