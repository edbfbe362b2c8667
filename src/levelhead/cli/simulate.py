"""`levelhead simulate`: a drive with a known truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from levelhead.cli.console import progress, terminal
from levelhead.logs.writers import write
from levelhead.report.files import write_truth
from levelhead.sim import SCENARIOS
from levelhead.sim import simulate as simulate_drive


def simulate(
    scenario: Annotated[str, typer.Argument(metavar="SCENARIO", help=f"One of: {', '.join(SCENARIOS)}.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE", help="Log to write: .parquet or .csv.")],
    seed: Annotated[int, typer.Option(help="Same seed, same drive.")] = 0,
    duration: Annotated[float, typer.Option(metavar="S", help="Length of the drive, s.")] = 1800.0,
    earth_rotation: Annotated[
        bool, typer.Option(help="Whether the gyros feel the Earth turn, as real ones do.")
    ] = True,
) -> None:
    """Simulate a drive; write its log, and its truth beside it as FILE.truth.parquet."""
    with progress(f"Simulating {scenario}"):
        log, truth = simulate_drive(scenario, seed=seed, duration=duration, earth_rotation=earth_rotation)
    write(log, output)
    beside = output.with_name(output.stem + ".truth.parquet")
    write_truth(truth, beside)
    terminal().print(f"Wrote {output} and {beside}.", markup=False)
