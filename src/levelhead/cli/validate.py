"""`levelhead validate`: known biases added to a log and found again, and how much the constants matter."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from levelhead.analysis.estimation import DEFAULT_METHOD
from levelhead.analysis.injection import sensitivity
from levelhead.analysis.injection import validate as validate_method
from levelhead.analysis.outages import OutageTest, check_length, outage_test
from levelhead.cli.analyses import show_outages, show_validation
from levelhead.cli.console import progress, terminal
from levelhead.cli.options import (
    FormatOption,
    GnssOption,
    ImuOption,
    LeverArmOption,
    MappingOption,
    PreflightOption,
    checked,
    read_in_part,
    read_log,
    vector,
)
from levelhead.cli.settings import load_params
from levelhead.estimators import METHODS
from levelhead.estimators.params import MethodParams, Triple
from levelhead.estimators.phasor import PhasorParams
from levelhead.logs.log import Log
from levelhead.report.files import make_folder, write_json, write_text
from levelhead.report.validation import render_validation


def validate(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="The drive's log: IMU and GNSS, or the IMU alone.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for the results.")],
    gnss: GnssOption = None,
    imu: ImuOption = None,
    mapping: MappingOption = None,
    log_format: FormatOption = None,
    preflight: PreflightOption = True,
    method: Annotated[str, typer.Option(help=f"One of: {', '.join(METHODS)}.")] = DEFAULT_METHOD,
    params: Annotated[Path | None, typer.Option(metavar="FILE.toml", help="Constants of the method.")] = None,
    lever_arm: LeverArmOption = None,
    outages: Annotated[
        float, typer.Option(metavar="SECONDS", help="Also take GNSS away for so long, again and again; 0: do not.")
    ] = 0.0,
) -> None:
    """Add known biases to a log and find them again; write validation.json and validation.html into DIR."""
    constants = load_params(method, params)
    arm = vector(lever_arm, "--lever-arm")
    if outages != 0.0:
        check_length(outages)  # before the minutes that the rest may take
    data = read_log(log, gnss=gnss, imu=imu, mapping=mapping, log_format=log_format)
    if preflight:
        data = checked(data)
    with progress(f"Adding biases to {log.name}") as report:
        validation = validate_method(data, method, params=constants, lever_arm=arm, progress=report)
    with progress("Changing the constants") as report:
        changes = sensitivity(data, method, params=constants, lever_arm=arm, progress=report)
    drifts = _outages(data, outages, constants, arm)
    make_folder(output)
    page = render_validation(validation, changes, title=f"{method} validated: {log.name}", outages=drifts)
    write_text(page, output / "validation.html")
    content = {**validation.as_dict(), "sensitivity": changes.as_dict(), "outages": drifts and drifts.as_dict()}
    write_json(content, output / "validation.json")
    show_validation(validation, changes)
    if drifts is not None:
        show_outages(drifts)
    terminal().print(f"Results in {output}: validation.json, validation.html.", markup=False)
    raise typer.Exit(read_in_part(data, log.name))


def _outages(log: Log, length: float, params: MethodParams | None, lever_arm: Triple | None) -> OutageTest | None:
    """Run the outage test, or return None where it was not asked for."""
    if length == 0.0:
        return None
    # Constants of a method that gives no positions say nothing about those that do; only the lever arm is a fact.
    fitting = params if isinstance(params, PhasorParams) else None
    if fitting is None and params is not None and lever_arm is None:
        lever_arm = params.lever_arm
    with progress("Taking GNSS away") as report:
        return outage_test(log, length, params=fitting, lever_arm=lever_arm, progress=report)
