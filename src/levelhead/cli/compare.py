"""`levelhead compare`: every method on one log, side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from levelhead.analysis.comparison import compare as compare_methods
from levelhead.cli.analyses import show_comparison
from levelhead.cli.console import progress, say_error, terminal
from levelhead.cli.options import (
    FormatOption,
    GnssOption,
    ImuOption,
    LeverArmOption,
    MappingOption,
    MethodsOption,
    PreflightOption,
    checked,
    names_of,
    read_in_part,
    read_log,
    vector,
)
from levelhead.errors import LogError
from levelhead.report.comparison import render_comparison
from levelhead.report.files import make_folder, read_truth, write_json, write_text


def compare(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="The drive's log: IMU and GNSS, or the IMU alone.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for the results.")],
    gnss: GnssOption = None,
    imu: ImuOption = None,
    mapping: MappingOption = None,
    log_format: FormatOption = None,
    preflight: PreflightOption = True,
    methods: MethodsOption = None,
    truth: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Truth of a simulated drive, as `simulate` writes it.")
    ] = None,
    lever_arm: LeverArmOption = None,
) -> None:
    """Run every method on one log; write comparison.json and comparison.html into DIR."""
    exact = None if truth is None else read_truth(truth)
    data = read_log(log, gnss=gnss, imu=imu, mapping=mapping, log_format=log_format)
    if preflight:
        data = checked(data)
    arm = vector(lever_arm, "--lever-arm")
    with progress(f"Comparing on {log.name}") as report:
        comparison = compare_methods(data, names_of(methods), truth=exact, lever_arm=arm, progress=report)
    make_folder(output)
    write_text(render_comparison(comparison, title=f"Methods compared: {log.name}"), output / "comparison.html")
    write_json(comparison.as_dict(), output / "comparison.json")
    show_comparison(comparison)
    terminal().print(f"Results in {output}: comparison.json, comparison.html.", markup=False)
    failed = [entry for entry in comparison.entries if entry.failure]
    for entry in failed:
        say_error(f"{entry.method} failed: {entry.failure}")
    code = read_in_part(data, log.name)
    raise typer.Exit(LogError.exit_code if failed else code)
