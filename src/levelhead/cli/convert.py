"""`levelhead convert`: any readable log to the canonical CSV or Parquet."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from levelhead.cli.console import progress, say_error, terminal
from levelhead.cli.options import FormatOption, GnssOption, MappingOption, read_log
from levelhead.logs.writers import write


def convert(
    source: Annotated[Path, typer.Argument(metavar="LOG", help="The log to read.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE", help="Log to write: .parquet or .csv.")],
    gnss: GnssOption = None,
    mapping: MappingOption = None,
    log_format: FormatOption = None,
) -> None:
    """Convert a log to the canonical CSV or Parquet: body FRD, NED, SI units."""
    log = read_log(source, gnss=gnss, mapping=mapping, log_format=log_format)
    with progress(f"Writing {output.name}"):
        write(log, output)
    terminal().print(f"Wrote {output}: {log.time.size} IMU samples, {log.gnss_time.size} GNSS epochs.", markup=False)
    if log.meta.get("completeness", "complete") != "complete":
        say_error(f"{source.name} was read only in part ({log.meta['completeness']}).")
        raise typer.Exit(3)
