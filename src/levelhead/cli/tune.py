"""`levelhead tune`: constants for every method from one log."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from levelhead.analysis.estimation import constants_for, estimate
from levelhead.analysis.tuning import TUNABLE, measure_noise, propose
from levelhead.atomic import atomic_path
from levelhead.cli.analyses import DEG, number, plain_table
from levelhead.cli.console import progress, terminal
from levelhead.cli.options import (
    FormatOption,
    GnssOption,
    ImuOption,
    MappingOption,
    PreflightOption,
    checked,
    read_in_part,
    read_log,
)
from levelhead.estimators import METHODS
from levelhead.estimators.params import FilterParams, MethodParams, NoiseParams
from levelhead.logs.derive import velocity_from_position
from levelhead.logs.log import Log


@dataclass(frozen=True, kw_only=True)
class Proposal:
    """What one method should run with, and how sure it will then be: deg, deg/s, m/s^2, s from the start."""

    method: str
    params: MethodParams
    tilt: float
    gyro: float
    accel: float
    gyro_settled_s: float | None
    accel_settled_s: float | None


def tune(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="The drive's log: IMU and GNSS, or the IMU alone.")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE.toml", help="Write the constants, for --params.")
    ] = None,
    gnss: GnssOption = None,
    imu: ImuOption = None,
    mapping: MappingOption = None,
    log_format: FormatOption = None,
    preflight: PreflightOption = True,
) -> None:
    """Measure the noise in a log and propose constants for every method, with the sigma that they promise."""
    data = read_log(log, gnss=gnss, imu=imu, mapping=mapping, log_format=log_format)
    if preflight:
        data = checked(data)
    drive = data if data.velocity_ned is not None else velocity_from_position(data)
    proposals = []
    with progress(f"Tuning on {log.name}") as report:
        noise = measure_noise(drive)
        methods = [m for m in METHODS if m in TUNABLE or issubclass(METHODS[m].params, FilterParams)]
        for k, method in enumerate(methods):
            proposals.append(_fixed(drive, method, noise) if method in TUNABLE else _filter(drive, method))
            report((k + 1) / len(methods))
    _show(noise, proposals)
    if output is not None:
        with atomic_path(output) as temporary:
            temporary.write_text(_toml(proposals, log.name), encoding="utf-8")
        terminal().print(f"Wrote {output}; use it with `levelhead estimate LOG --params {output}`.", markup=False)
    raise typer.Exit(read_in_part(data, log.name))


def _fixed(log: Log, method: str, noise: NoiseParams) -> Proposal:
    """Minimise the predicted covariance of this log's turns."""
    tuning = propose(log, method, noise)
    after = tuning.after
    return Proposal(
        method=method,
        params=tuning.params,
        tilt=after.tilt * DEG,
        gyro=after.gyro * DEG,
        accel=after.accel,
        gyro_settled_s=after.gyro_settled_s,
        accel_settled_s=after.accel_settled_s,
    )


def _filter(log: Log, method: str) -> Proposal:
    """Take the constants that `estimate` would find for this log; the filter's own covariance is the promise."""
    constants, _ = constants_for(log, method)
    result = estimate(log, method, params=constants)
    late = result.time >= 0.5 * (result.time[0] + result.time[-1])
    level = [axis for axis in range(3) if np.isfinite(result.accel_bias_std[-1, axis])][:2]

    def rms(rows: np.ndarray) -> float:
        return float(np.sqrt(np.nanmean(rows**2)))

    return Proposal(
        method=method,
        params=constants,
        tilt=rms(result.attitude_std[late, :2]) * DEG,
        gyro=rms(result.gyro_bias_std[late][:, level]) * DEG,
        accel=rms(result.accel_bias_std[late][:, level]),
        gyro_settled_s=result.settled_at_s["gyro"],
        accel_settled_s=result.settled_at_s["accel"],
    )


def _show(noise: NoiseParams, proposals: list[Proposal]) -> None:
    console = terminal()
    console.print(
        f"Noise in the readings: gyro {noise.gyro_noise * DEG:.2g} deg/s/√Hz, accelerometer {noise.accel_noise:.2g} "
        f"m/s²/√Hz, GNSS velocity {noise.velocity_std:.2g} m/s.",
        markup=False,
        highlight=False,
    )
    table = plain_table("", *[proposal.method for proposal in proposals])
    rows = {
        "tilt, deg": [number(p.tilt, 3) for p in proposals],
        "gyro bias, deg/s": [number(p.gyro, 4) for p in proposals],
        "accel bias, m/s²": [number(p.accel, 4) for p in proposals],
        "gyro settles, s": [number(p.gyro_settled_s, 0) for p in proposals],
        "accel settles, s": [number(p.accel_settled_s, 0) for p in proposals],
    }
    for name, cells in rows.items():
        table.add_row(name, *cells)
    console.print("One sigma that the proposed constants promise on this drive (second half), and when they settle:")
    console.print(table)
    for proposal in proposals:
        console.print(f"{proposal.method}: {_changes(proposal.params)}", markup=False, highlight=False, soft_wrap=True)


def _changes(params: MethodParams) -> str:
    """Name the constants that differ from the defaults."""
    default = type(params)()
    parts = []
    for field in fields(params):
        value = getattr(params, field.name)
        if value != getattr(default, field.name) and isinstance(value, float):
            parts.append(f"{field.name} = {value:.4g}")
    return ", ".join(parts) or "the defaults"


def _toml(proposals: list[Proposal], source: str) -> str:
    """Write one table per method, as `--params` reads them: SI and radians."""
    lines = [f"# Constants for this drive, by `levelhead tune {source}`; SI and radians."]
    for proposal in proposals:
        lines += ["", f"[{proposal.method}]"]
        for name, value in proposal.params.as_dict().items():
            if isinstance(value, bool):
                lines.append(f"{name} = {str(value).lower()}")
            elif isinstance(value, float) and math.isfinite(value):
                lines.append(f"{name} = {value!r}")
            elif isinstance(value, str):
                lines.append(f'{name} = "{value}"')
            elif isinstance(value, list | tuple):
                lines.append(f"{name} = [{', '.join(repr(float(v)) for v in value)}]")
    return "\n".join(lines) + "\n"
