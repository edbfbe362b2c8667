"""From numbers to findings: what is certain, what is not, and what follows for the log."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from levelhead.conventions import GRAVITY, UNIT_FACTORS, FloatArray
from levelhead.logs.mapping import rotation_321
from levelhead.logs.pieces import Fact
from levelhead.preflight.corrections import Corrections, angles_321, axes_name, nearest_axes
from levelhead.preflight.findings import Finding, Verdict
from levelhead.preflight.frames import DECIDED
from levelhead.preflight.look import MAX_TURNED, Look, nearest_unit, right_speeds
from levelhead.preflight.speeds import VELOCITY_UNITS

SURE_SIGMAS: Final = 3.0
MIN_LATENCY_S: Final = 0.01
WARN_LATENCY_S: Final = 0.05
MAX_LATENCY_S: Final = 0.5
"""A larger offset of the clocks is not put right unless somebody says that it is so: the files may not belong
together."""
FAR_SIGMAS: Final = 5.0
LATENCY_STD_S: Final = 0.03
MIN_YAW: Final = math.radians(0.2)
WARN_YAW: Final = math.radians(1.0)
YAW_STD: Final = math.radians(1.0)
"""A mounting yaw that is left alone is fine when it is known so well, rad."""
MOSTLY: Final = 0.95
"""Where less of the driving is in one direction, it is said which one is taken as forward."""
MIN_COHERENCE: Final = 0.8
DRIFT_SIGMAS: Final = 6.0
MIN_DRIFT_S: Final = 0.02
FEW: Final = 3
LONE_WINDOWS: Final = 4.0
"""More stretches than a few are told apart only where their squares are so many times what they should be: noise is
modelled roughly, and the fit's own sigma knows how windows scatter."""
MAX_DRIFT: Final = 2e-4
"""No crystal is worse; what looks like a faster drift is a jump, or stamps made by a busy computer, s/s."""
MIN_DRIFT_WINDOWS: Final = 10
WANDER_RATE: Final = math.radians(10.0)
"""Clocks that wander turn the headings by what the vehicle turns in that time, at such a rate, rad/s."""
WANDER_SIGMAS: Final = 5.0
"""The clocks wander where the offsets of stretches of the drive differ by so many sigmas more than they should."""
UPRIGHT: Final = math.radians(60.0)
"""The z axis may lean by this much from the vertical before the axes are said to be wrong, rad."""


@dataclass(frozen=True, kw_only=True)
class Claims:
    """What the log says of itself.

    Attributes
    ----------
    unknown : frozenset of Fact
        Neither format nor file says it.
    assumed : frozenset of Fact
        Only the rules of the canonical log say it.
    told : frozenset of Fact
        The user says it.
    """

    unknown: frozenset[Fact] = frozenset()
    assumed: frozenset[Fact] = frozenset()
    told: frozenset[Fact] = frozenset()

    @classmethod
    def of(cls, meta: Mapping[str, object], told: frozenset[Fact]) -> Claims:
        """Return the claims of a log's meta, less what the user tells."""

        def facts(name: str) -> frozenset[Fact]:
            value = meta.get(name, ())
            return frozenset(value) - told if isinstance(value, tuple | frozenset) else frozenset()

        return cls(unknown=facts("undeclared"), assumed=facts("assumed"), told=told)

    def verdict(self, fact: Fact) -> Verdict:
        """Return what is to be done where the data contradicts what is claimed."""
        return Verdict.CORRECTED if fact in self.unknown or fact in self.assumed else Verdict.REFUSED

    def open(self, fact: Fact) -> Verdict:
        """Return what is to be done where the data cannot tell."""
        return Verdict.REFUSED if fact in self.unknown else Verdict.UNDECIDED

    def remedy(self, fact: Fact, option: str, value: str) -> str:
        """Return what to do where the data contradicts what is claimed: what was found is besides what was told."""
        if self.verdict(fact) is Verdict.CORRECTED:
            return ""
        return f" {option} is wrong, then: leave it out." if fact in self.told else f" Pass {option}{value}."


Decision = tuple[Finding, Corrections]


def accel_unit(look: Look, claims: Claims, fix: Corrections) -> Decision:
    """Decide on the accelerometers' unit."""
    name, code = "accelerometer unit", "E_UNIT_ACCEL"
    values: dict[str, object] = {"norm": look.accel_norm, "coherence": look.coherence}
    if look.coherence < MIN_COHERENCE:
        text = (
            f"The accelerometers' mean is {look.coherence:.2f} of their usual size: gravity is not in them, or the IMU "
            "turns over. Record the specific force, not the linear acceleration."
        )
        return Finding(name=name, verdict=Verdict.REFUSED, text=text, code="E_NO_GRAVITY", values=values), fix
    unit = look.accel_unit
    if unit is None:
        text = (
            f"At rest the accelerometers read {look.accel_norm:.4g}, which is gravity in none of the units "
            f"{', '.join(UNIT_FACTORS['m/s^2'])}; check --accel-unit, or the export."
        )
        return Finding(name=name, verdict=Verdict.REFUSED, text=text, code=code, values=values), fix
    if UNIT_FACTORS["m/s^2"][unit] == 1.0:
        text = f"m/s^2: they read {look.accel_norm:.2f} where gravity is {GRAVITY:.2f}."
        return Finding(name=name, verdict=Verdict.FINE, text=text, values=values), fix
    verdict = claims.verdict("accel_unit")
    remedy = claims.remedy("accel_unit", "--accel-unit", f" {unit}")
    text = f"{unit}, not m/s^2: they read {look.accel_norm:.4g} where gravity is {GRAVITY:.2f} m/s^2.{remedy}"
    fix = replace(fix, accel_factor=UNIT_FACTORS["m/s^2"][unit])
    return Finding(name=name, verdict=verdict, text=text, code=code, values={**values, "unit": unit}), fix


def gyro_unit(look: Look, claims: Claims, fix: Corrections) -> Decision:
    """Decide on the gyros' unit."""
    name, code = "gyro unit", "E_UNIT_GYRO"
    turns = look.turns
    if turns is None:
        text = "The drive has too few turns to tell the gyros' unit from the course."
        verdict = claims.open("gyro_unit")
        text += " Pass --gyro-unit rad/s or deg/s." if verdict is Verdict.REFUSED else " Taken as the log says."
        return Finding(name=name, verdict=verdict, text=text, code=code), fix
    ratio, sigma = abs(turns.scale), turns.scale_std
    values: dict[str, object] = {"rad_s_per_unit": ratio, "rad_s_per_unit_std": sigma, "explained": turns.explained}
    unit = look.gyro_unit
    if unit is None:
        text = (
            f"The course turns by {ratio:.4g} rad where the gyros' readings add up to 1, which is none of the units "
            f"{', '.join(UNIT_FACTORS['rad/s'])}; check --gyro-unit, or the export."
        )
        return Finding(name=name, verdict=Verdict.REFUSED, text=text, code=code, values=values), fix
    if UNIT_FACTORS["rad/s"][unit] == 1.0:
        text = f"rad/s: the course turns {ratio:.3f} +- {sigma:.3f} times as far as the gyros say."
        return Finding(name=name, verdict=Verdict.FINE, text=text, values=values), fix
    verdict = claims.verdict("gyro_unit")
    remedy = claims.remedy("gyro_unit", "--gyro-unit", f" {unit}")
    text = f"{unit}, not rad/s: the course turns by {ratio:.4g} rad where the readings add up to 1.{remedy}"
    fix = replace(fix, gyro_factor=UNIT_FACTORS["rad/s"][unit])
    return Finding(name=name, verdict=verdict, text=text, code=code, values={**values, "unit": unit}), fix


def velocity_unit(look: Look) -> Finding | None:
    """Return the finding on the unit of the GNSS velocity; None where nothing tells."""
    speeds = look.speeds
    if speeds is None:
        return None
    how = "accelerations and specific force" if speeds.turned is None else "steps between positions"
    values: dict[str, object] = {"m_s_per_unit": speeds.ratio}
    unit = nearest_unit(speeds.ratio, VELOCITY_UNITS)
    if unit == "m/s":
        text = f"m/s: {how} say {speeds.ratio:.2f} m/s for 1."
        return Finding(name="velocity unit", verdict=Verdict.FINE, text=text, values=values)
    if speeds.turned is None and unit is None:
        # Accelerations that are not the vehicle's (few turns, vibration) give any ratio: only a unit's own is evidence.
        text = f"Not certain: {how} say {speeds.ratio:.3g} m/s for 1, which is no unit. Taken as m/s."
        return Finding(name="velocity unit", verdict=Verdict.UNDECIDED, code="E_UNIT_VEL", text=text, values=values)
    shown = f"{unit}, not m/s" if unit else f"none of {', '.join(VELOCITY_UNITS)}"
    text = (
        f"{shown}: {how} say {speeds.ratio:.3g} m/s for 1. Turn the velocities into m/s, or name their unit in the "
        "mapping."
    )
    return Finding(name="velocity unit", verdict=Verdict.REFUSED, code="E_UNIT_VEL", text=text, values=values)


def velocity_frame(look: Look, claims: Claims, fix: Corrections) -> Decision:
    """Decide on the frame of the GNSS velocity."""
    name, code = "velocity frame", "E_VEL_FRAME"
    by_windows = look.frames is not None and look.frames.decided and look.coherent
    values: dict[str, object]
    if look.velocity_derived:
        text = "The velocities are derived from the positions, so their frame is known."
        return Finding(name=name, verdict=Verdict.FINE, text=text), fix
    turned = 0.0 if look.speeds is None else look.speeds.turned or 0.0
    if abs(turned) > MAX_TURNED:
        text = (
            f"The velocities point {math.degrees(turned):.0f} deg to the left of the steps between positions, in any "
            "frame: turn them into North, East, Down."
        )
        values = {"turned_deg": math.degrees(turned)}
        return Finding(name=name, verdict=Verdict.REFUSED, text=text, code=code, values=values), fix
    if look.by_positions is not None:
        found, margin = look.by_positions, look.positions_margin
        how = f"the positions move so, with a log-likelihood of {margin:.0f}"
    elif by_windows and look.frames is not None:
        found, margin = look.frames.hypothesis.velocity_frame, look.frames.margin
        how = f"the readings say so, with a log-likelihood of {margin:.0f}"
    else:
        verdict = claims.open("velocity_frame")
        text = "Neither positions nor accelerations tell the frame of the velocity."
        text += " Pass --velocity-frame." if verdict is Verdict.REFUSED else " Taken as North, East, Down."
        return Finding(name=name, verdict=verdict, text=text, code=code), fix
    values = {"frame": found, "margin": margin}
    if found == "NED":
        return Finding(name=name, verdict=Verdict.FINE, text=f"NED: {how}.", values=values), fix
    verdict = claims.verdict("velocity_frame")
    remedy = claims.remedy("velocity_frame", "--velocity-frame", f" {found}")
    told = "As told they are " if "velocity_frame" in claims.told else ""
    text = f"{told}{found}, not NED: {how}.{remedy}"
    return (
        Finding(name=name, verdict=verdict, text=text, code=code, values=values),
        replace(fix, velocity_frame=found),
    )


def axes(
    look: Look, claims: Claims, fix: Corrections, middle_s: float, duration_s: float
) -> tuple[list[Finding], Corrections]:
    """Decide on axes and signs, and report how the IMU is mounted."""
    frames, mounting = look.frames, look.mounting
    if frames is None or mounting is None or not (look.coherent and frames.decided and mounting.decided):
        return [_undecided_axes(look, claims)], fix
    best = frames.hypothesis
    dcm = mounting.dcm_sensor_to_vehicle
    nearest = nearest_axes(dcm)
    yaw, pitch, roll = angles_321(dcm @ nearest.T)
    yaw_std = math.hypot(mounting.yaw_std, WANDER_RATE * _drift(look, middle_s, duration_s)[1])
    findings = [_named_axes(best.force_sign, best.rate_sign, nearest, frames.margin, claims)]
    values: dict[str, object] = {
        "yaw_deg": math.degrees(yaw),
        "yaw_std_deg": math.degrees(yaw_std),
        "pitch_deg": math.degrees(pitch),
        "roll_deg": math.degrees(roll),
    }
    told = f"{math.degrees(yaw):.2f} +- {math.degrees(yaw_std):.2f} deg"
    sure = abs(yaw) > max(MIN_YAW, SURE_SIGMAS * yaw_std)
    values["one_way"] = mounting.one_way
    text = f"The IMU's forward axis points {told} to the right of the direction of travel"
    if mounting.one_way < MOSTLY:
        text += f" ({100.0 * mounting.one_way:.0f} % of the driving is that way, and it is taken as forward)"
    if sure:
        verdict, code = Verdict.CORRECTED, "W_MOUNT_YAW" if abs(yaw) > WARN_YAW else ""
        findings.append(
            Finding(name="mounting yaw", verdict=verdict, code=code, text=f"{text}: taken off.", values=values)
        )
    else:
        verdict = Verdict.FINE if yaw_std < YAW_STD else Verdict.UNDECIDED
        findings.append(Finding(name="mounting yaw", verdict=verdict, text=f"{text}: left alone.", values=values))
    tilt = f"pitched by {math.degrees(pitch):.1f} and rolled by {math.degrees(roll):.1f} deg"
    text = f"In the mean over the drive the IMU is {tilt}: accepted as it is."
    findings.append(Finding(name="mounting tilt", verdict=Verdict.NOTED, text=text, values=values))
    # Only the yaw is taken off: the tilt stays in the readings and in the roll and pitch that are estimated.
    tilted = rotation_321(roll=roll, pitch=pitch, yaw=0.0)
    body = tilted.T @ dcm if sure else nearest
    changed = best.force_sign < 0 or best.rate_sign < 0 or not np.array_equal(nearest, np.eye(3))
    if not changed and not sure:
        return findings, fix
    return findings, replace(fix, gyro_dcm=best.rate_sign * body, accel_dcm=best.force_sign * body)


def _named_axes(force_sign: int, rate_sign: int, nearest: FloatArray, margin: float, claims: Claims) -> Finding:
    """Return the finding on axes that were found."""
    shown = axes_name(force_sign * nearest if force_sign == rate_sign else nearest)
    values: dict[str, object] = {
        "axes": shown,
        "force_sign": force_sign,
        "rate_sign": rate_sign,
        "margin": margin,
    }
    lead = f"(log-likelihood {margin:.0f} ahead of any other reading)"
    verdict = claims.verdict("axes")
    remedy = claims.remedy("axes", "--axes", f"={shown}")
    if force_sign == rate_sign == 1 and np.array_equal(nearest, np.eye(3)):
        return Finding(name="axes", verdict=Verdict.FINE, text=f"x forward, y right, z down {lead}.", values=values)
    if force_sign == rate_sign:
        mirrored = ", which is a mirror image" if force_sign < 0 else ""
        named = "axes as told" if "axes" in claims.told else "file"
        text = f"Forward, right, down are {shown} of the {named}{mirrored} {lead}.{remedy}"
        code = "E_AXES"
    elif force_sign < 0:
        code = "E_FSIGN"
        text = f"The accelerometers' sign is wrong: at rest they point down; besides, the axes are {shown} {lead}."
    else:
        code = "E_AXES"
        text = f"The gyros' sign is wrong: they turn against the course; besides, the axes are {shown} {lead}."
    if force_sign != rate_sign and verdict is Verdict.REFUSED:
        text += " Turn that sign round in the log."
    return Finding(name="axes", verdict=verdict, code=code, text=text, values=values)


def _undecided_axes(look: Look, claims: Claims) -> Finding:
    """Return the finding on axes that the drive cannot tell: gravity alone may still contradict them."""
    values: dict[str, object]
    frames = look.frames
    if frames is not None and frames.gyro_margin >= DECIDED and look.gyro_unit is not None:
        text = (
            "The gyros' axes are not the accelerometers': readings and velocities fit best where the gyros' "
            f"{axes_name(frames.gyro_axes)} stand for x,y,z (log-likelihood {frames.gyro_margin:.0f} ahead). Put the "
            "columns right."
        )
        values = {"gyro_axes": axes_name(frames.gyro_axes), "margin": frames.gyro_margin}
        return Finding(name="axes", verdict=Verdict.REFUSED, text=text, code="E_AXES", values=values)
    lean = math.acos(max(-1.0, min(1.0, -float(look.up[2]))))
    values = {
        "gravity": [float(-v) for v in look.up],
        "margin": None if frames is None else frames.margin,
    }
    if look.speeds is not None and not right_speeds(look.speeds):
        reason = "the velocities are not what they should be"
    elif frames is None or look.alignment is None:
        reason = "the drive has no turns and no braking that would tell forward and right"
    elif frames.alternatives:
        others = " or ".join(_spoken(h.force_sign, h.rate_sign, h.velocity_frame) for h in frames.alternatives)
        best = frames.hypothesis
        reason = f"the data fits {_spoken(best.force_sign, best.rate_sign, best.velocity_frame)} as well as {others}"
    elif not frames.decided:
        reason = f"the signs are not certain (log-likelihood {frames.margin:.0f}, and 20 is asked for)"
    elif not look.alignment.settled or look.mounting is None:
        reason = "readings and velocities do not fit together"
    elif look.mounting is not None and look.mounting.one_way < 0.7:
        reason = "the vehicle drives as much backwards as forwards"
    else:
        reason = "the direction of travel is not certain in the sensor's axes"
    if lean > UPRIGHT and look.coherence > MIN_COHERENCE:
        text = (
            f"Gravity does not lie along the z axis ({math.degrees(lean):.0f} deg off), so the axes are not forward, "
            f"right, down; which they are is not certain: {reason}. "
            f"{'--axes is wrong, then.' if 'axes' in claims.told else 'Pass --axes.'}"
        )
        return Finding(name="axes", verdict=Verdict.REFUSED, text=text, code="E_AXES", values=values)
    verdict = claims.open("axes")
    text = f"Not certain: {reason}."
    text += (
        " Pass --axes." if verdict is Verdict.REFUSED else " Gravity lies along z as it should; taken as the log says."
    )
    return Finding(name="axes", verdict=verdict, text=text, code="E_AXES", values=values)


def _spoken(force_sign: int, rate_sign: int, frame: str) -> str:
    """Say a combination of signs and frame in words."""
    wrong = {
        (1, 1): "right signs",
        (-1, -1): "mirrored axes",
        (-1, 1): "the accelerometers' sign turned round",
        (1, -1): "the gyros' sign turned round",
    }[force_sign, rate_sign]
    return f"{wrong} with velocities in {frame}"


def clock(look: Look, claims: Claims, fix: Corrections, middle_s: float, duration_s: float) -> Decision:
    """Decide on the offset of the clocks and its drift."""
    name, fit = "clock", look.alignment
    frames = look.frames
    known = frames is not None and frames.decided and look.coherent
    drift, wander = _drift(look, middle_s, duration_s)
    sigma = math.inf if fit is None else math.hypot(fit.offset_std, wander)
    if fit is None or not known or sigma > LATENCY_STD_S:
        found = "" if fit is None or not known else f" (within {sigma:.3f} s)"
        if known and wander > LATENCY_STD_S:
            found = f": they do not stay so, but go {wander:.2f} s to and fro"
        far = 0.0 if fit is None or not known else abs(fit.offset_s) - FAR_SIGMAS * sigma
        if far > WARN_LATENCY_S and "clock" in claims.told:
            # How far they are apart is open, but not that they are.
            text = f"The clocks are {far:.2f} s apart at least besides what --latency says: --latency is wrong, then."
            return Finding(name=name, verdict=Verdict.REFUSED, text=text, code="W_LATENCY"), fix
        verdict = claims.open("clock")
        text = f"The drive cannot tell how far the clocks of IMU and GNSS are apart{found}."
        text += " Pass --latency." if verdict is Verdict.REFUSED else " Taken as one clock."
        return Finding(name=name, verdict=verdict, text=text), fix
    late = fit.offset_s
    values: dict[str, object] = {"latency_s": late, "latency_std_s": sigma, "drift_s_per_h": drift * 3600.0}
    side = "late" if late > 0.0 else "early"
    text = f"The GNSS stamps are {abs(late):.3f} +- {sigma:.3f} s {side} against the IMU's"
    text += f", and {abs(drift) * duration_s:.3f} s more so over the log" if drift else ""
    if look.mounting is not None:
        per_metre = float(look.mounting.dcm_sensor_to_vehicle[0] @ fit.offset_per_lever)
        if abs(per_metre) > MIN_LATENCY_S:
            values["latency_s_per_metre_ahead"] = per_metre
            text += f" (were the antenna a metre ahead of the IMU: {late - per_metre:+.3f} s)"
    if abs(late) < max(MIN_LATENCY_S, SURE_SIGMAS * sigma) and not drift:
        small = abs(late) + SURE_SIGMAS * sigma < WARN_LATENCY_S
        verdict = Verdict.FINE if small else Verdict.UNDECIDED
        return Finding(name=name, verdict=verdict, text=f"{text}: left alone.", values=values), fix
    code = "W_LATENCY" if abs(late) > WARN_LATENCY_S or drift else ""
    if abs(late) > MAX_LATENCY_S and "clock" not in claims.unknown:
        text += (
            " besides what --latency says: leave that out."
            if "clock" in claims.told
            else f", which is more than one log should have. If they belong together pass --latency {late:.3f}."
        )
        return Finding(name=name, verdict=Verdict.REFUSED, text=text, code="W_LATENCY", values=values), fix
    fix = replace(fix, latency_s=late, clock_drift=drift)
    return Finding(name=name, verdict=Verdict.CORRECTED, text=f"{text}: taken off.", code=code, values=values), fix


def _drift(look: Look, middle_s: float, duration_s: float) -> tuple[float, float]:
    """Return the drift of the clocks where the windows agree on one, s/s, and how far they wander about it, s."""
    fit = look.alignment
    if fit is None or fit.used.sum() < 2:
        return 0.0, 0.0
    when = look.windows.start[fit.used] - middle_s
    off, sigma = fit.offsets_s[fit.used] - fit.offset_s, fit.offsets_std[fit.used]
    weight = 1.0 / sigma**2
    slope, left = 0.0, off
    if when.size >= MIN_DRIFT_WINDOWS:
        design = np.column_stack((np.ones_like(when), when))
        inverse = np.linalg.pinv(design.T @ (weight[:, None] * design))
        solution = inverse @ (design.T @ (weight * off))
        left = off - design @ solution
        chi = max(1.0, float((weight * left**2).sum() / max(when.size - 2, 1)))
        slope, slope_std = float(solution[1]), math.sqrt(float(inverse[1, 1]) * chi)
        clear = abs(slope) > DRIFT_SIGMAS * slope_std and abs(slope) * duration_s > MIN_DRIFT_S
        if clear and abs(slope) > MAX_DRIFT:
            return 0.0, abs(slope) * duration_s / math.sqrt(12.0)
        slope, left = (slope, left) if clear else (0.0, off)
    return slope, max(_spread(left, sigma, count) for count in (2, 4, when.size // 2, when.size))


def _spread(values: FloatArray, sigma: FloatArray, count: int) -> float:
    """Return by how much values differ between so many stretches that follow on each other, beyond their noise."""
    parts = [part for part in np.array_split(np.arange(values.size), max(count, 1)) if part.size]
    if len(parts) < 2:
        return 0.0
    weight = 1.0 / sigma**2
    total = np.array([weight[part].sum() for part in parts])
    mean = np.array([weight[part] @ values[part] for part in parts]) / total
    within = sum(float(weight[p] @ (values[p] - m) ** 2) for p, m in zip(parts, mean, strict=True))
    total = total / max(1.0, within / max(values.size - len(parts), 1))
    misfit = float(total @ (mean - total @ mean / total.sum()) ** 2)
    freedom = len(parts) - 1
    limit = max(freedom + WANDER_SIGMAS * math.sqrt(2.0 * freedom), LONE_WINDOWS * freedom if freedom > FEW else 0.0)
    if misfit < limit:
        return 0.0
    # Moments (DerSimonian and Laird): what the stretches' own sigmas leave to be explained.
    return math.sqrt((misfit - freedom) / float(total.sum() - (total @ total) / total.sum()))


def lever(look: Look, told: bool) -> Finding | None:
    """Return a finding where the velocities show an antenna that is not above the IMU, and nobody said so."""
    fit, mounting = look.alignment, look.mounting
    if told or not look.lever_found or fit is None or mounting is None or not mounting.decided:
        return None
    arm = mounting.dcm_sensor_to_vehicle @ fit.lever_arm
    shown = ",".join(f"{v:.1f}" for v in arm)
    text = (
        f"In turns the antenna moves as if it were {shown} m (forward, right, down) from the IMU. Measure it and pass "
        f"--lever-arm={shown}."
    )
    values: dict[str, object] = {"lever_arm": [float(v) for v in arm]}
    return Finding(name="lever arm", verdict=Verdict.WARNING, code="W_NO_LEVER", text=text, values=values)
