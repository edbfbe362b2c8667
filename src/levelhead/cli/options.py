"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from levelhead.cli.console import progress, say_error
from levelhead.errors import LogError, UsageError
from levelhead.estimators import METHODS
from levelhead.estimators.params import NOISE_PRESETS
from levelhead.logs.log import Log
from levelhead.logs.readers import READERS, read

GnssOption = Annotated[
    Path | None, typer.Option("--gnss", metavar="FILE", help="GNSS file where the log holds only the IMU.")
]
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


def read_log(path: Path, *, gnss: Path | None, mapping: Path | None, log_format: str | None) -> Log:
    """Read a log with a word on the terminal while it takes its time."""
    with progress(f"Reading {path.name}"):
        return read(path, format=log_format, gnss=gnss, mapping=mapping)


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
