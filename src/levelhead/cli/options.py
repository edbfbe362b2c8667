"""Options that several commands share."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from levelhead.cli.console import progress, say_error
from levelhead.conventions import UNIT_FACTORS
from levelhead.errors import LogError, UsageError
from levelhead.estimators import METHODS
from levelhead.estimators.params import NOISE_PRESETS, Triple
from levelhead.logs.log import Log
from levelhead.logs.readers import READERS, read
from levelhead.preflight import Told, check

GnssOption = Annotated[
    str | None,
    typer.Option(
        "--gnss", metavar="FILE|NAME", help="GNSS file where the log holds only the IMU; or one of its receivers."
    ),
]
ImuOption = Annotated[str | None, typer.Option("--imu", metavar="NAME", help="One of several IMUs in the log.")]
MappingOption = Annotated[
    Path | None, typer.Option("--mapping", metavar="FILE.toml", help="Columns, units and axes of a CSV of your own.")
]
MethodsOption = Annotated[
    str | None, typer.Option(metavar="A,B", help=f"Methods, separated by commas, of: {', '.join(METHODS)}; else all.")
]
FormatOption = Annotated[
    str | None,
    typer.Option("--format", help=f"Force the log's format: {', '.join(READERS)}. Found by content otherwise."),
]
LeverArmOption = Annotated[
    str | None, typer.Option(metavar="X,Y,Z", help="From the IMU to the antenna, m: forward,right,down.")
]
RearAxleOption = Annotated[
    str | None,
    typer.Option(metavar="X,Y,Z", help="From the IMU to the axle that does not steer, m: it does not slide sideways."),
]
ReferencePointOption = Annotated[
    str | None,
    typer.Option(metavar="X,Y,Z", help="From the IMU to the point of the vehicle to tell of besides, m."),
]
GradeOption = Annotated[
    str | None, typer.Option(help=f"Grade of the sensors, instead of --params: {', '.join(NOISE_PRESETS)}.")
]
PreflightOption = Annotated[
    bool, typer.Option(help="Find units, axes, frames, clocks and mounting first, and put right what is certain.")
]
AxesOption = Annotated[
    str | None, typer.Option(metavar="F,R,D", help="Forward, right, down as axes of the file: -x,y,-z.")
]
GyroUnitOption = Annotated[str | None, typer.Option(help=f"One of: {', '.join(UNIT_FACTORS['rad/s'])}.")]
AccelUnitOption = Annotated[str | None, typer.Option(help=f"One of: {', '.join(UNIT_FACTORS['m/s^2'])}.")]
VelocityFrameOption = Annotated[str | None, typer.Option(help="Of the GNSS velocity: NED, ENU, NEU or ECEF.")]
LatencyOption = Annotated[
    float | None, typer.Option(metavar="SECONDS", help="How much later than the IMU's the GNSS stamps are.")
]
MountingYawOption = Annotated[
    float | None,
    typer.Option(metavar="DEG", help="How far the IMU's forward axis points to the right of the vehicle's."),
]


def read_log(
    path: Path, *, gnss: str | None, mapping: Path | None, log_format: str | None, imu: str | None = None
) -> Log:
    """Read a log with a word on the terminal while it takes its time."""
    with progress(f"Reading {path.name}"):
        return read(path, format=log_format, gnss=gnss, imu=imu, mapping=mapping)


def checked(log: Log, told: Told | None = None) -> Log:
    """Return a log with what the preflight finds put right; a LogError says what to pass where it cannot be trusted."""
    with progress("Checking units, axes, frames, clocks and mounting"):
        return check(log, told=told).trusted()


def told_of(
    *,
    axes: str | None = None,
    gyro_unit: str | None = None,
    accel_unit: str | None = None,
    velocity_frame: str | None = None,
    latency: float | None = None,
    mounting_yaw: float | None = None,
    lever_arm: Triple | None = None,
) -> Told:
    """Return what the options say of a log."""
    return Told(
        axes=axes,
        gyro_unit=gyro_unit,
        accel_unit=accel_unit,
        velocity_frame=velocity_frame,
        latency_s=latency,
        mounting_yaw=None if mounting_yaw is None else math.radians(mounting_yaw),
        lever_arm=lever_arm,
    )


def read_in_part(log: Log, name: str) -> int:
    """Return the exit code that a log deserves: 3, with a word on stderr, where it was read only in part."""
    completeness = log.meta.get("completeness", "complete")
    if completeness == "complete":
        return 0
    say_error(f"{name} was read only in part ({completeness}); the results are marked.")
    return LogError.exit_code


def names_of(text: str | None) -> list[str] | None:
    """Return the names in a list separated by commas; None where the option was not given."""
    return None if text is None else [part.strip() for part in text.split(",")]


def vector(text: str | None, option: str) -> tuple[float, float, float] | None:
    """Return the three lengths of an option such as `--lever-arm`; None where it was not given."""
    if text is None:
        return None
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise UsageError(f"{option} is {text!r}; pass three lengths in metres such as 0.2,0,-1.5.") from None
    return x, y, z
