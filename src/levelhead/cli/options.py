"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from levelhead.cli.console import progress
from levelhead.logs.log import Log
from levelhead.logs.readers import READERS, read

GnssOption = Annotated[
    Path | None, typer.Option("--gnss", metavar="FILE", help="GNSS file where the log holds only the IMU.")
]
MappingOption = Annotated[
    Path | None, typer.Option("--mapping", metavar="FILE.toml", help="Columns, units and axes of a CSV of your own.")
]
FormatOption = Annotated[
    str | None,
    typer.Option("--format", help=f"Force the log's format: {', '.join(READERS)}. Found by content otherwise."),
]


def read_log(path: Path, *, gnss: Path | None, mapping: Path | None, log_format: str | None) -> Log:
    """Read a log with a word on the terminal while it takes its time."""
    with progress(f"Reading {path.name}"):
        return read(path, format=log_format, gnss=gnss, mapping=mapping)
