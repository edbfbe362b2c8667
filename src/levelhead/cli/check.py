"""`levelhead check`: what a log is, and what would be put right in it, before anything is estimated."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from levelhead.cli.console import plain, progress, say_error, terminal
from levelhead.cli.options import (
    AccelUnitOption,
    AxesOption,
    FormatOption,
    GnssOption,
    GyroUnitOption,
    ImuOption,
    LatencyOption,
    LeverArmOption,
    MappingOption,
    MountingYawOption,
    VelocityFrameOption,
    read_in_part,
    read_log,
    told_of,
    vector,
)
from levelhead.errors import LogError
from levelhead.logs.log import Log
from levelhead.logs.pieces import Stream
from levelhead.logs.writers import write
from levelhead.preflight import Preflight, Verdict
from levelhead.preflight import check as preflight
from levelhead.report.files import write_json

COLOURS = {
    Verdict.REFUSED: "bold red",
    Verdict.CORRECTED: "green",
    Verdict.WARNING: "yellow",
    Verdict.UNDECIDED: "yellow",
    Verdict.NOTED: "",
    Verdict.FINE: "dim",
}


def check(
    path: Annotated[Path, typer.Argument(metavar="LOG", help="The drive's log: IMU and GNSS, or the IMU alone.")],
    gnss: GnssOption = None,
    imu: ImuOption = None,
    mapping: MappingOption = None,
    log_format: FormatOption = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="Write the log put right: .parquet or .csv.")
    ] = None,
    as_json: Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Write the findings as JSON.")] = None,
    axes: AxesOption = None,
    gyro_unit: GyroUnitOption = None,
    accel_unit: AccelUnitOption = None,
    velocity_frame: VelocityFrameOption = None,
    latency: LatencyOption = None,
    mounting_yaw: MountingYawOption = None,
    lever_arm: LeverArmOption = None,
) -> None:
    """Find units, axes, frames, clocks, mounting, gaps, noise and what the drive can teach; exit 3 if it is refused."""
    told = told_of(
        axes=axes,
        gyro_unit=gyro_unit,
        accel_unit=accel_unit,
        velocity_frame=velocity_frame,
        latency=latency,
        mounting_yaw=mounting_yaw,
        lever_arm=vector(lever_arm, "--lever-arm"),
    )
    log = read_log(path, gnss=gnss, imu=imu, mapping=mapping, log_format=log_format)
    with progress(f"Checking {path.name}"):
        found = preflight(log, told=told)
    _show(path.name, log, found)
    if as_json is not None:
        write_json({"log": found.log.describe(), **found.as_dict()}, as_json)
    if output is not None and not found.refused:
        write(found.log, output)
        terminal().print(f"Wrote {output}: the log put right.", markup=False)
    code = read_in_part(log, path.name)
    if found.refused:
        say_error(f"{path.name} cannot be trusted as it is: {', '.join(f.name for f in found.refused)}.")
        code = LogError.exit_code
    raise typer.Exit(code)


def _show(name: str, log: Log, found: Preflight) -> None:
    """Print what the file holds, and the findings."""
    from rich.markup import escape
    from rich.table import Table

    console = terminal()
    about = log.describe()
    lead = f"{plain(name)}: {log.meta.get('format')}, {log.duration:.0f} s, {about['distance_m']:.0f} m."
    console.print(lead, markup=False)
    streams = log.meta.get("streams", ())
    for stream in streams if isinstance(streams, tuple) else ():
        if isinstance(stream, Stream):
            what = {"imu": "IMU", "gnss": "GNSS"}[stream.kind]
            note = f" ({stream.note})" if stream.note else ""
            console.print(f"  {what} {plain(stream.name)}: {stream.samples} samples{plain(note)}", markup=False)
    for event in log.events:
        console.print(f"  {event.code} ({event.count}×): {plain(event.text)}", markup=False)
    table = Table(show_header=True, box=None, pad_edge=False)
    for heading in ("what", "verdict", "finding"):
        table.add_column(heading, overflow="fold")
    for finding in found.findings:
        colour = COLOURS[finding.verdict]
        verdict = f"[{colour}]{finding.verdict}[/]" if colour else str(finding.verdict)
        table.add_row(escape(finding.name), verdict, escape(plain(finding.text)))
    console.print(table)
