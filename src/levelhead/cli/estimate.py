"""`levelhead estimate`: the main job."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Annotated, Literal

import typer

from levelhead.analysis.estimation import DEFAULT_METHOD
from levelhead.analysis.estimation import estimate as estimate_log
from levelhead.cli.console import progress, say_error, show_result, terminal
from levelhead.cli.options import (
    FormatOption,
    GnssOption,
    GradeOption,
    LeverArmOption,
    MappingOption,
    RearAxleOption,
    ReferencePointOption,
    read_log,
    vector,
)
from levelhead.cli.settings import load_params
from levelhead.errors import LevelheadError, UsageError
from levelhead.estimators import METHODS
from levelhead.estimators.params import MethodParams, Triple
from levelhead.logs.writers import write
from levelhead.report.files import make_folder, write_report, write_result, write_summary

PARTLY_READ = 3


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """What the user asked for, the same for every log."""

    method: str
    constants: MethodParams | None
    grade: str | None
    lever_arm: Triple | None
    rear_axle: Triple | None
    reference_point: Triple | None
    corrected: str | None


def estimate(
    logs: Annotated[
        list[Path], typer.Argument(metavar="LOG...", help="The drive's log: IMU and GNSS, or the IMU alone.")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for the results.")],
    gnss: GnssOption = None,
    mapping: MappingOption = None,
    log_format: FormatOption = None,
    method: Annotated[str, typer.Option(help=f"One of: {', '.join(METHODS)}.")] = DEFAULT_METHOD,
    params: Annotated[Path | None, typer.Option(metavar="FILE.toml", help="Constants of the method.")] = None,
    grade: GradeOption = None,
    lever_arm: LeverArmOption = None,
    rear_axle: RearAxleOption = None,
    reference_point: ReferencePointOption = None,
    corrected: Annotated[
        Literal["parquet", "csv", "mcap"] | None, typer.Option(help="Also write the log with the biases taken off.")
    ] = None,
) -> None:
    """Estimate biases, roll, pitch and heading; write summary.json, result.parquet and report.html into DIR."""
    if len(logs) > 1 and gnss is not None:
        raise UsageError("--gnss goes with one IMU file; run the command once per drive.")
    folders = [output] if len(logs) == 1 else [output / name for name in _names(logs)]
    constants = load_params(method, params)
    wanted = Wanted(
        method=method,
        constants=constants,
        grade=grade,
        lever_arm=vector(lever_arm, "--lever-arm"),
        rear_axle=vector(rear_axle, "--rear-axle"),
        reference_point=vector(reference_point, "--reference-point"),
        corrected=corrected,
    )
    codes = []
    for path, folder in zip(logs, folders, strict=True):
        try:
            codes.append(_one(path, folder, gnss, mapping, log_format, wanted))
        except LevelheadError as error:
            if len(logs) == 1:
                raise
            say_error(f"{path}: {error}")
            codes.append(error.exit_code)
    raise typer.Exit(max(codes))


def _one(
    path: Path,
    folder: Path,
    gnss: Path | None,
    mapping: Path | None,
    log_format: str | None,
    wanted: Wanted,
) -> int:
    """Run one drive and return its exit code."""
    begin = perf_counter()
    log = read_log(path, gnss=gnss, mapping=mapping, log_format=log_format)
    read_done = perf_counter()
    with progress(f"Estimating {path.name}") as report:
        result = estimate_log(
            log,
            wanted.method,
            params=wanted.constants,
            grade=wanted.grade,
            lever_arm=wanted.lever_arm,
            rear_axle=wanted.rear_axle,
            reference_point=wanted.reference_point,
            progress=report,
        )
    estimated = perf_counter()
    make_folder(folder)
    write_result(result, folder / "result.parquet")
    result = replace(result, runtime_s={"read": read_done - begin, "estimate": estimated - read_done})
    write_report(result, folder / "report.html", title=path.name)
    runtime = {**result.runtime_s, "report": perf_counter() - estimated}
    result = replace(result, runtime_s=runtime)
    if wanted.corrected is not None:
        write(log.corrected(result), folder / f"corrected.{wanted.corrected}")
    write_summary(result, folder / "summary.json")
    show_result(result)
    terminal().print(f"Results in {folder}: summary.json, result.parquet, report.html.", markup=False)
    if result.log_info.get("completeness") != "complete":
        say_error(f"{path.name} was read only in part ({result.log_info.get('completeness')}); the results are marked.")
        return PARTLY_READ
    return 0


def _names(logs: list[Path]) -> list[str]:
    """Return one folder name per log: its stem, or its whole name where stems repeat."""
    stems = [path.stem for path in logs]
    names = [path.stem if stems.count(path.stem) == 1 else path.name for path in logs]
    if len(set(names)) < len(names):
        raise UsageError(
            "Two logs have the same file name, so their results would overwrite each other; run them apart."
        )
    return names
