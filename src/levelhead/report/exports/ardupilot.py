"""``ardupilot``: IMU offsets, level trim and GNSS delay as a parameter file for Mission Planner."""

from __future__ import annotations

from typing import Final

import numpy as np

from levelhead.conventions import AXES
from levelhead.errors import LogError, UsageError
from levelhead.report.exports.autopilot import (
    SHARED_ROTATIONS,
    check_scale,
    dcm_of,
    new_offsets,
    number,
    old_values,
    refuse_scaled,
    sigma_line,
    starting_lines,
)
from levelhead.report.exports.base import Biases, Calibration, Document, Exporter, heading

ROTATIONS: Final[dict[int, tuple[float, float, float]]] = {
    **dict(enumerate(SHARED_ROTATIONS)),
    38: (90, 68.8, 293.3),
    39: (0, 315, 0),
    40: (90, 315, 0),
    41: (0, 7, 0),
    42: (45, 0, 0),
    43: (315, 0, 0),
}
"""ArduPilot's ``enum Rotation``; custom orientations are not known here."""
SLOTS: Final = {1: "", 2: "2", 3: "3"}
"""The first IMU's names have no number."""
KINDS: Final = {"gyro": ("GYR", "GYROFFS", "rad/s"), "accel": ("ACC", "ACCOFFS", "m/s^2")}
LONGEST_DELAY_MS: Final = 250
LARGEST_TRIM_DEG: Final = 10.0
LARGEST_YAW_DEG: Final = 5.0
"""A trim has no yaw: beyond this, its roll and pitch would be about axes that are not the vehicle's."""


def render(calibration: Calibration) -> Document:
    """Return the ``.param`` file; see docs/exports.md."""
    lines, notes = starting_lines(calibration)
    slot, slot_line = _slot(calibration)
    (notes if "assumed" in slot_line else lines).append(slot_line)
    rows: list[str] = []
    for sensor, (kind, first_name, unit) in KINDS.items():
        biases = calibration.recorded(sensor)
        if not any(biases.known):
            continue
        offsets = _offsets(biases, calibration, kind, slot)
        name = f"INS_{first_name}" if slot == 1 else f"INS_{kind}{SLOTS[slot]}OFFS"
        values = [
            f"{name}_{axis.upper()},{number(value)}"
            for axis, value, known in zip(AXES, offsets.value, offsets.known, strict=True)
            if known
        ]
        rows += [sigma_line(offsets, unit), *values]
        if kind == "GYR" and values and (calibration.old.parameters or {}).get("INS_GYR_CAL", 1.0):
            notes.append("ArduPilot measures the gyro offsets anew at each boot; set INS_GYR_CAL to 0 to keep these.")
    if not any(row[0] != "#" for row in rows):
        raise LogError("No calibration is written: each axis of the sensors turns out to mix in one that is not known.")
    for extra, note in (_trim(calibration), _delay(calibration)):
        rows += extra
        notes += note
    head = heading(
        calibration,
        "IMU offsets for ArduPilot",
        "In the sensor's own axes; ArduPilot takes them off the raw readings. Reboot after loading.",
        *lines,
        *notes,
    )
    return Document(text="\n".join((*head, *rows)) + "\n", notes=tuple(notes))


def _offsets(biases: Biases, calibration: Calibration, kind: str, slot: int) -> Biases:
    parameters = calibration.old.parameters
    scale_names = f"INS_{kind}{SLOTS[slot]}SCAL_" + "{}"
    has_scale = kind == "ACC" and parameters is not None
    scale = old_values(parameters, scale_names) if has_scale and parameters is not None else np.ones(3)
    check_scale(scale, scale_names.format("*"))
    if not calibration.old.applied:
        # The file's axes are the sensor's own.
        refuse_scaled(scale, scale_names.format("*"))
        return biases
    if parameters is None:
        raise LogError("What was taken off the readings is not known.")  # refused before, by check_export
    if "AHRS_ORIENTATION" not in parameters:
        raise LogError(
            "The vehicle's parameters lack AHRS_ORIENTATION, without which the sensor's axes are not known; pass the "
            "whole parameter file of the vehicle (--calibration)."
        )
    name = f"INS_{KINDS['gyro' if kind == 'GYR' else 'accel'][1]}" if slot == 1 else f"INS_{kind}{SLOTS[slot]}OFFS"
    return new_offsets(
        biases,
        dcm_sensor_to_file=dcm_of(ROTATIONS, parameters["AHRS_ORIENTATION"], "AHRS_ORIENTATION"),
        old=old_values(parameters, name + "_{}"),
        scale=scale,
    )


def _slot(calibration: Calibration) -> tuple[int, str]:
    """Return which of ArduPilot's IMUs it is, counted from 1, and the line that says how it was found."""
    parameters = calibration.old.parameters or {}
    slot = calibration.slot
    if slot is None and calibration.imu_instance is not None:
        slot = calibration.imu_instance + 1
    there = [n for n, suffix in SLOTS.items() if parameters.get(f"INS_ACC{suffix}_ID")]
    if slot is None and len(there) > 1:
        raise UsageError(
            f"The vehicle has {len(there)} IMUs, and the log does not say whose readings it holds; pass --slot with "
            "its number, from 1."
        )
    if slot is not None and slot not in SLOTS:
        raise UsageError(f"The slot {slot} does not exist; ArduPilot's first IMUs are 1 to {max(SLOTS)}.")
    if slot is None and not there:
        return 1, "The first IMU was assumed; --slot chooses another."
    slot = slot if slot is not None else there[0]
    return slot, f"For IMU {slot} of this vehicle alone."


def _trim(calibration: Calibration) -> tuple[list[str], list[str]]:
    """Return the rows of the level trim: the attitude of the autopilot in the vehicle, roll and pitch.

    ArduPilot makes its rotation from autopilot to vehicle of the trim, as roll and pitch of a 3-2-1 sequence, which is
    what our mounting is: no sign changes.
    """
    mounting = calibration.mounting_deg
    if mounting is None or "roll" not in mounting or "pitch" not in mounting:
        return [], []
    roll, pitch, yaw = mounting["roll"], mounting["pitch"], mounting.get("yaw", 0.0)
    dcm = calibration.dcm_file_to_body
    turned = dcm is not None and np.diag(dcm).min() < np.cos(np.radians(2.0 * LARGEST_TRIM_DEG))
    if abs(yaw) > LARGEST_YAW_DEG or turned:
        return [], ["The IMU's axes are not nearly the vehicle's, so no AHRS_TRIM is written; set AHRS_ORIENTATION."]
    if max(abs(roll), abs(pitch)) > LARGEST_TRIM_DEG:
        note = f"The IMU is mounted at roll {roll:.1f}, pitch {pitch:.1f} deg; ArduPilot trims {LARGEST_TRIM_DEG:g} deg"
        return [], [f"{note} at most, so no AHRS_TRIM is written."]
    return [
        "# mounting of the autopilot in the vehicle, rad",
        f"AHRS_TRIM_X,{number(float(np.radians(roll)))}",
        f"AHRS_TRIM_Y,{number(float(np.radians(pitch)))}",
    ], []


def _delay(calibration: Calibration) -> tuple[list[str], list[str]]:
    """Return the row of the GNSS delay, and the note where there can be none."""
    if calibration.latency_s is None:
        return [], []
    if calibration.no_delay:
        return [], [calibration.no_delay]
    delay = round(1000.0 * calibration.latency_s)
    if not 1 <= delay <= LONGEST_DELAY_MS:
        return [], [
            f"The GNSS is {delay} ms late; ArduPilot takes 1 to {LONGEST_DELAY_MS} ms (0 means its default), so no "
            "delay is written."
        ]
    old_name = "GPS_DELAY_MS" in (calibration.old.parameters or {})
    return ["# renamed in 4.6: GPS_DELAY_MS before", f"{'GPS' if old_name else 'GPS1'}_DELAY_MS,{delay}"], []


EXPORTER: Final = Exporter(
    name="ardupilot",
    title="ArduPilot parameters",
    file_name="calibration-ardupilot.param",
    render=render,
    adds_to_old=True,
)
