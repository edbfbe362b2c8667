"""`levelhead validate`: known biases added to a log and found again, and how much the constants matter."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from levelhead.analysis.estimation import DEFAULT_METHOD
from levelhead.analysis.injection import sensitivity
from levelhead.analysis.injection import validate as validate_method
from levelhead.cli.analyses import show_validation
from levelhead.cli.console import progress, terminal
from levelhead.cli.options import (
    FormatOption,
    GnssOption,
    LeverArmOption,
    MappingOption,
    read_in_part,
    read_log,
    vector,
)
from levelhead.cli.settings import load_params
from levelhead.estimators import METHODS
from levelhead.report.files import make_folder, write_json, write_text
from levelhead.report.validation import render_validation


def validate(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="The drive's log: IMU and GNSS, or the IMU alone.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for the results.")],
    gnss: GnssOption = None,
    mapping: MappingOption = None,
    log_format: FormatOption = None,
    method: Annotated[str, typer.Option(help=f"One of: {', '.join(METHODS)}.")] = DEFAULT_METHOD,
    params: Annotated[Path | None, typer.Option(metavar="FILE.toml", help="Constants of the method.")] = None,
    lever_arm: LeverArmOption = None,
) -> None:
    """Add known biases to a log and find them again; write validation.json and validation.html into DIR."""
    constants = load_params(method, params)
    arm = None if lever_arm is None else vector(lever_arm)
    data = read_log(log, gnss=gnss, mapping=mapping, log_format=log_format)
    with progress(f"Adding biases to {log.name}") as report:
        validation = validate_method(data, method, params=constants, lever_arm=arm, progress=report)
    with progress("Changing the constants") as report:
        changes = sensitivity(data, method, params=constants, lever_arm=arm, progress=report)
    make_folder(output)
    write_text(
        render_validation(validation, changes, title=f"{method} validated: {log.name}"), output / "validation.html"
    )
    write_json({**validation.as_dict(), "sensitivity": changes.as_dict()}, output / "validation.json")
    show_validation(validation, changes)
    terminal().print(f"Results in {output}: validation.json, validation.html.", markup=False)
    raise typer.Exit(read_in_part(data, log.name))
