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
from levelhead.cli.exporting import (
    CalibrationOption,
    ExportOption,
    Exports,
    OnlyKnownOption,
    SlotOption,
    exports_wanted,
)
from levelhead.cli.options import (
    AccelUnitOption,
    AxesOption,
    FormatOption,
    GnssOption,
    GradeOption,
    GyroUnitOption,
    ImuOption,
    LatencyOption,
    LeverArmOption,
    MappingOption,
    MountingYawOption,
    PreflightOption,
    RearAxleOption,
    ReferencePointOption,
    VelocityFrameOption,
    checked,
    read_log,
    told_of,
    vector,
)
from levelhead.cli.settings import load_params
from levelhead.errors import LevelheadError, UsageError
from levelhead.estimators import METHODS
from levelhead.estimators.params import MethodParams, Triple
from levelhead.logs.writers import write
from levelhead.preflight import Told
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
    told: Told | None
    exports: Exports


@dataclass(frozen=True, kw_only=True)
class Files:
    """Where the readings are, besides the log itself."""

    gnss: str | None
    imu: str | None
    mapping: Path | None
    log_format: str | None


def estimate(
    logs: Annotated[
        list[Path], typer.Argument(metavar="LOG...", help="The drive's log: IMU and GNSS, or the IMU alone.")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for the results.")],
    gnss: GnssOption = None,
    imu: ImuOption = None,
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
    preflight: PreflightOption = True,
    axes: AxesOption = None,
    gyro_unit: GyroUnitOption = None,
    accel_unit: AccelUnitOption = None,
    velocity_frame: VelocityFrameOption = None,
    latency: LatencyOption = None,
    mounting_yaw: MountingYawOption = None,
    export: ExportOption = None,
    calibration: CalibrationOption = None,
    slot: SlotOption = None,
    only_known: OnlyKnownOption = False,
) -> None:
    """Estimate biases, roll, pitch and heading; write summary.json, result.parquet and report.html into DIR."""
    if len(logs) > 1 and gnss is not None and Path(gnss).exists():
        raise UsageError("--gnss goes with one IMU file; run the command once per drive.")
    arm = vector(lever_arm, "--lever-arm")
    told = told_of(
        axes=axes,
        gyro_unit=gyro_unit,
        accel_unit=accel_unit,
        velocity_frame=velocity_frame,
        latency=latency,
        mounting_yaw=mounting_yaw,
        lever_arm=arm,
    )
    if not preflight and replace(told, lever_arm=None) != Told():
        raise UsageError("--no-preflight takes the log as it is; leave out --axes, --latency and the like, or it.")
    folders = [output] if len(logs) == 1 else [output / name for name in _names(logs)]
    constants = load_params(method, params)
    wanted = Wanted(
        method=method,
        constants=constants,
        grade=grade,
        lever_arm=arm,
        rear_axle=vector(rear_axle, "--rear-axle"),
        reference_point=vector(reference_point, "--reference-point"),
        corrected=corrected,
        told=told if preflight else None,
        exports=exports_wanted(export, calibration, slot=slot, only_known=only_known),
    )
    files = Files(gnss=gnss, imu=imu, mapping=mapping, log_format=log_format)
    codes = []
    for path, folder in zip(logs, folders, strict=True):
        try:
            codes.append(_one(path, folder, files, wanted))
        except LevelheadError as error:
            if len(logs) == 1:
                raise
            say_error(f"{path}: {error}")
            codes.append(error.exit_code)
    raise typer.Exit(max(codes))


def _one(path: Path, folder: Path, files: Files, wanted: Wanted) -> int:
    """Run one drive and return its exit code."""
    begin = perf_counter()
    log = read_log(path, gnss=files.gnss, imu=files.imu, mapping=files.mapping, log_format=files.log_format)
    read_done = perf_counter()
    if wanted.told is not None:
        log = checked(log, wanted.told)
    check_done = perf_counter()
    wanted.exports.check(log)
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
    result = replace(result, runtime_s=_runtime(begin, read_done, check_done, estimated))
    write_report(result, folder / "report.html", title=path.name)
    runtime = {**result.runtime_s, "report": perf_counter() - estimated}
    result = replace(result, runtime_s=runtime)
    if wanted.corrected is not None:
        write(log.corrected(result), folder / f"corrected.{wanted.corrected}")
    write_summary(result, folder / "summary.json")
    show_result(result)
    terminal().print(f"Results in {folder}: summary.json, result.parquet, report.html.", markup=False)
    complete = result.log_info.get("completeness") == "complete"
    if not complete:
        say_error(f"{path.name} was read only in part ({result.log_info.get('completeness')}); the results are marked.")
    # Last: where a calibration is refused, the results are there.
    wanted.exports.write(result, log, folder)
    return 0 if complete else PARTLY_READ


def _runtime(begin: float, read_done: float, check_done: float, estimated: float) -> dict[str, float]:
    """Return what each step took, s."""
    return {"read": read_done - begin, "preflight": check_done - read_done, "estimate": estimated - check_done}


def _names(logs: list[Path]) -> list[str]:
    """Return one folder name per log: its stem, or its whole name where stems repeat."""
    stems = [path.stem for path in logs]
    names = [path.stem if stems.count(path.stem) == 1 else path.name for path in logs]
    if len(set(names)) < len(names):
        raise UsageError(
            "Two logs have the same file name, so their results would overwrite each other; run them apart."
        )
    return names
