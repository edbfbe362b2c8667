"""`levelhead demo`: the main job on a simulated drive, with the truth beside it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Annotated

import numpy as np
import typer

from levelhead.analysis.estimation import estimate
from levelhead.cli.console import progress, show_result, terminal
from levelhead.report.files import make_folder, write_report, write_result, write_summary
from levelhead.sim import simulate


def demo(
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for the results.")] = Path(
        "levelhead-demo"
    ),
    seed: Annotated[int, typer.Option(help="Same seed, same drive.")] = 1,
) -> None:
    """Simulate a tractor on a field for half an hour, find its biases, and write a report; opens nothing."""
    make_folder(output)
    begin = perf_counter()
    with progress("Simulating 30 minutes on a field"):
        log, truth = simulate("field", seed=seed, duration=1800.0)
    simulated = perf_counter()
    with progress("Estimating") as report:
        result = estimate(log, progress=report)
    estimated = perf_counter()
    write_result(result, output / "result.parquet")
    result = replace(result, runtime_s={"read": simulated - begin, "estimate": estimated - simulated})
    reference = {
        "time": truth.time,
        "gyro_bias": truth.gyro_bias,
        "accel_bias": truth.accel_bias,
        "roll": truth.roll,
        "pitch": truth.pitch,
        "heading": truth.heading,
    }
    write_report(result, output / "report.html", title="Simulated field, half an hour", reference=reference)
    result = replace(result, runtime_s={**result.runtime_s, "report": perf_counter() - estimated})
    write_summary(result, output / "summary.json")
    exact = {"gyro": np.degrees(truth.gyro_bias[-1]).tolist(), "accel": truth.accel_bias[-1].tolist()}
    show_result(result, truth=exact)
    terminal().print(f"Open {output / 'report.html'} in a browser.", markup=False)
