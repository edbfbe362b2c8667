"""``px4``: IMU offsets and the GNSS delay as a parameter file that QGroundControl loads."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from levelhead.conventions import AXES, FloatArray
from levelhead.errors import LogError, UsageError
from levelhead.logs.mapping import rotation_321
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
    38: (90, 68, 293),
    39: (0, 315, 0),
    40: (90, 315, 0),
    41: (270, 0, 180),
    42: (270, 0, 270),
    43: (0, 90, 180),
    44: (0, 9, 180),
    45: (0, 45, 0),
    46: (270, 0, 225),
    47: (270, 0, 315),
}
"""PX4's ``enum Rotation``; beyond 40 it is not ArduPilot's."""
SLOTS: Final = range(4)
LONGEST_DELAY_MS: Final = 300
FLOAT, INT32 = 9, 6
"""MAVLink's types of parameters."""
KINDS: Final = {"gyro": ("GYRO", "rad/s"), "accel": ("ACC", "m/s^2")}


def render(calibration: Calibration) -> Document:
    """Return the ``.params`` file; see docs/exports.md."""
    lines, notes = starting_lines(calibration)
    parameters = calibration.old.parameters
    rows: list[str] = []
    for sensor, (kind, unit) in KINDS.items():
        biases = calibration.recorded(sensor)
        if not any(biases.known):
            continue
        slot, id_line = _slot(calibration, sensor, kind)
        offsets = _offsets(biases, calibration, kind, slot)
        if "assumed" in id_line:
            notes.append(id_line)
        else:
            rows.append(f"# {id_line}")
        rows.append(sigma_line(offsets, unit))
        rows += [
            _row(f"CAL_{kind}{slot}_{axis.upper()}OFF", number(value), FLOAT)
            for axis, value, known in zip(AXES, offsets.value, offsets.known, strict=True)
            if known
        ]
    if not any(row[0] != "#" for row in rows):
        raise LogError("No calibration is written: each axis of the sensors turns out to mix in one that is not known.")
    if parameters is None or parameters.get("SENS_IMU_AUTOCAL", 1.0):
        notes.append(
            "SENS_IMU_AUTOCAL = 1 lets PX4 overwrite the offsets with its own after a drive; set it to 0 to keep these."
        )
    delay, notes_of_delay = _delay(calibration)
    notes += notes_of_delay
    head = heading(
        calibration,
        "IMU offsets for PX4",
        "In the sensor's own axes; PX4 takes them off the raw readings. Reboot after loading.",
        *lines,
        *notes,
    )
    return Document(
        text="\n".join((*head, "# Vehicle-Id Component-Id Name Value Type", *rows, *delay)) + "\n", notes=tuple(notes)
    )


def _row(name: str, value: str, kind: int) -> str:
    return f"1\t1\t{name}\t{value}\t{kind}"


def _offsets(biases: Biases, calibration: Calibration, kind: str, slot: int) -> Biases:
    old = calibration.old
    scale_names = f"CAL_{kind}{slot}_" + "{}SCALE"
    has_scale = kind == "ACC" and old.parameters is not None
    if not old.applied:
        # The file's axes are the sensor's own.
        if has_scale and old.parameters is not None:
            refuse_scaled(old_values(old.parameters, scale_names), scale_names.format("*"))
        compensated = f"TC_{kind[0]}_ENABLE"
        if old.parameters is not None and old.parameters.get(compensated):
            raise LogError(
                f"The log has raw readings, but PX4 compensates their temperature ({compensated} is 1): their bias is "
                "not what is left for the offset. Estimate from the calibrated readings of the log."
            )
        return biases
    if old.parameters is None:
        raise LogError("What was taken off the readings is not known.")  # refused before, by check_export
    scale = old_values(old.parameters, scale_names) if has_scale else np.ones(3)
    check_scale(scale, scale_names.format("*"))
    return new_offsets(
        biases,
        dcm_sensor_to_file=sensor_to_body(old.parameters, kind, slot),
        old=old_values(old.parameters, f"CAL_{kind}{slot}_" + "{}OFF"),
        scale=scale,
    )


def sensor_to_body(parameters: Mapping[str, float], kind: str, slot: int) -> FloatArray:
    """Return the rotation from a sensor's axes to those of PX4's calibrated readings.

    Sensors on the board follow ``SENS_BOARD_ROT``, others have ``CAL_*_ROT`` (-1 on the board); the level horizon's
    angles ``SENS_BOARD_*_OFF`` come on top of both.
    """
    name = f"CAL_{kind}{slot}_ROT"
    if parameters.get(name, -1.0) < 0.0:
        name = "SENS_BOARD_ROT"
    if name not in parameters:
        raise LogError(
            f"The vehicle's parameters lack {name}, without which the sensor's axes are not known; pass the whole "
            "parameter file of the vehicle (--calibration)."
        )
    roll, pitch, yaw = (float(np.radians(parameters.get(f"SENS_BOARD_{axis}_OFF", 0.0))) for axis in "XYZ")
    dcm: FloatArray = rotation_321(roll=roll, pitch=pitch, yaw=yaw) @ dcm_of(ROTATIONS, parameters[name], name)
    return dcm


def _slot(calibration: Calibration, sensor: str, kind: str) -> tuple[int, str]:
    """Return which of PX4's calibrations is this sensor's, and the line that says how it was found."""
    parameters = calibration.old.parameters or {}
    given = calibration.slot
    if given is not None and given not in SLOTS:
        raise UsageError(f"The slot {given} does not exist; PX4 counts its IMUs from 0 to {SLOTS[-1]}.")
    ids = {n: _unsigned(parameters[f"CAL_{kind}{n}_ID"]) for n in SLOTS if parameters.get(f"CAL_{kind}{n}_ID")}
    device = calibration.device_ids.get(sensor)
    if given is None and device is not None and ids:
        matching = [n for n, known in ids.items() if known == _unsigned(device)]
        if not matching:
            raise LogError(
                f"The log's {sensor} has the ID {device}, for which the vehicle's parameters have no calibration "
                f"(CAL_{kind}*_ID): PX4 would not use the offsets. Calibrate once in QGroundControl."
            )
        given = matching[0]
    if given is None and len(ids) == 1:
        given = next(iter(ids))
    if given is None and len(ids) > 1:
        raise UsageError(
            f"The vehicle has several calibrated IMUs (CAL_{kind}{', '.join(str(n) for n in ids)}), and the log does "
            "not say whose readings it holds; pass --slot with its number."
        )
    if given is not None and f"CAL_{kind}{given}_ID" in parameters and given not in ids:
        raise LogError(
            f"CAL_{kind}{given}_ID is 0: PX4 would not use the offsets. Calibrate once in QGroundControl, or pass the "
            "--slot of the right IMU."
        )
    if given is None:
        return 0, f"CAL_{kind}0 was assumed: CAL_{kind}0_ID must be the ID of this sensor (--slot chooses another)."
    if given in ids:
        return given, f"For the sensor with CAL_{kind}{given}_ID = {int(parameters[f'CAL_{kind}{given}_ID'])} alone."
    return given, f"CAL_{kind}{given}_ID must be the ID of this sensor."


def _unsigned(value: float) -> int:
    """Return a device ID as PX4 compares it: its parameters are signed, its topics are not."""
    return int(value) & 0xFFFFFFFF


def _delay(calibration: Calibration) -> tuple[list[str], list[str]]:
    """Return the row of the GNSS delay, and the note where there can be none."""
    if calibration.latency_s is None:
        return [], []
    if calibration.no_delay:
        return [], [calibration.no_delay]
    delay = round(1000.0 * calibration.latency_s)
    if not 0 <= delay <= LONGEST_DELAY_MS:
        return [], [f"The GNSS is {delay} ms late; PX4 takes 0 to {LONGEST_DELAY_MS} ms, so no delay is written."]
    if "SENS_GPS0_DELAY" in (calibration.old.parameters or {}):
        return [_row("SENS_GPS0_DELAY", str(delay), INT32)], []
    return ["# SENS_GPS0_DELAY in releases that have it", _row("EKF2_GPS_DELAY", str(delay), FLOAT)], []


EXPORTER: Final = Exporter(
    name="px4", title="PX4 parameters", file_name="calibration-px4.params", render=render, adds_to_old=True
)
