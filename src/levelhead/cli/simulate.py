"""`levelhead simulate`: a drive with a known truth, or many of them with every method run on each."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from levelhead.analysis.montecarlo import monte_carlo
from levelhead.cli.analyses import show_monte_carlo
from levelhead.cli.console import progress, terminal
from levelhead.cli.options import LeverArmOption, MethodsOption, names_of, vector
from levelhead.errors import UsageError
from levelhead.logs.writers import write
from levelhead.report.files import make_folder, write_json, write_text, write_truth
from levelhead.report.montecarlo import render_monte_carlo
from levelhead.sim import ORIGIN_LLH, SCENARIOS, SensorModel, without_gnss
from levelhead.sim import simulate as simulate_drive
from levelhead.sim.vehicle import CRUISE_SPEED

ONE_DRIVE_S = 1800.0
OF_MANY_S = 600.0


def simulate(
    scenario: Annotated[str, typer.Argument(metavar="SCENARIO", help=f"One of: {', '.join(SCENARIOS)}.")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="Log to write: .parquet or .csv; with --compare a folder."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Same seed, same drive; of many drives, the first one's.")] = 0,
    duration: Annotated[
        float | None,
        typer.Option(metavar="S", help=f"Length of a drive, s: {ONE_DRIVE_S:.0f}, of many drives {OF_MANY_S:.0f}."),
    ] = None,
    runs: Annotated[int | None, typer.Option(metavar="N", help="With --compare: how many drives.")] = None,
    compare: Annotated[
        bool, typer.Option("--compare", help="Run the methods on N drives; how large are their errors?")
    ] = False,
    methods: MethodsOption = None,
    workers: Annotated[
        int | None, typer.Option(metavar="K", help="With --compare: processes; one per processor if absent.")
    ] = None,
    earth_rotation: Annotated[
        bool, typer.Option(help="Whether the gyros feel the Earth turn, as real ones do.")
    ] = True,
    speed: Annotated[
        float | None, typer.Option(metavar="M/S", help=f"Cruise speed, m/s; {CRUISE_SPEED:g} if absent.")
    ] = None,
    lever_arm: LeverArmOption = None,
    wheel_speed: Annotated[bool, typer.Option("--wheel-speed", help="Give the log the speed of the wheels.")] = False,
    latitude_deg: Annotated[
        float | None,
        typer.Option(metavar="DEG", help=f"Where it starts; {math.degrees(ORIGIN_LLH[0]):g} if absent."),
    ] = None,
    outage: Annotated[
        list[str] | None,
        typer.Option(metavar="START,LENGTH", help="Take GNSS away for LENGTH s from START s on; may be repeated."),
    ] = None,
) -> None:
    """Simulate a drive; write its log, and its truth beside it as FILE.truth.parquet. Or compare methods on many."""
    if compare:
        if runs is None:
            raise UsageError("--compare goes with --runs N, the number of drives.")
        of_one = {"--speed": speed, "--lever-arm": lever_arm, "--latitude-deg": latitude_deg, "--outage": outage}
        for name, value in {**of_one, "--wheel-speed": wheel_speed or None}.items():
            if value is not None:
                raise UsageError(f"{name} is for one drive; it does not go with --compare.")
        length = OF_MANY_S if duration is None else duration
        _many(scenario, output, seed=seed, duration=length, runs=runs, methods=methods, workers=workers)
        return
    for name, number in (("--runs", runs), ("--methods", methods), ("--workers", workers)):
        if number is not None:
            raise UsageError(f"{name} goes with --compare; without it `simulate` writes one drive.")
    if output is None:
        raise UsageError("Name the log to write with -o FILE (.parquet or .csv).")
    windows = [_window(text) for text in outage or ()]
    with progress(f"Simulating {scenario}"):
        log, truth = simulate_drive(
            scenario,
            seed=seed,
            duration=ONE_DRIVE_S if duration is None else duration,
            sensors=_sensors(lever_arm, wheel_speed=wheel_speed),
            earth_rotation=earth_rotation,
            origin_llh=_origin(latitude_deg),
            speed=CRUISE_SPEED if speed is None else speed,
        )
    write(without_gnss(log, windows), output)
    beside = output.with_name(output.stem + ".truth.parquet")
    write_truth(truth, beside)
    terminal().print(f"Wrote {output} and {beside}.", markup=False)


def _sensors(lever_arm: str | None, *, wheel_speed: bool) -> SensorModel:
    """Return the usual sensors with what was asked for."""
    sensors = SensorModel(wheel_speed=wheel_speed)
    arm = vector(lever_arm, "--lever-arm")
    return sensors if arm is None else replace(sensors, lever_arm=arm)


def _origin(latitude_deg: float | None) -> tuple[float, float, float]:
    """Return where the drive starts."""
    latitude, longitude, height = ORIGIN_LLH
    return latitude if latitude_deg is None else math.radians(latitude_deg), longitude, height


def _window(text: str) -> tuple[float, float]:
    """Return start and length of an `--outage`."""
    try:
        start, length = (float(part) for part in text.split(","))
    except ValueError:
        raise UsageError(f"--outage is {text!r}; pass start and length in seconds such as 300,60.") from None
    return start, length


def _many(
    scenario: str,
    folder: Path | None,
    *,
    seed: int,
    duration: float,
    runs: int,
    methods: str | None,
    workers: int | None,
) -> None:
    """Run a Monte Carlo analysis, show it, and write it where a folder is named."""
    with progress(f"{runs} drives, {scenario}") as report:
        found = monte_carlo(
            scenario, runs, names_of(methods), duration=duration, seed0=seed, workers=workers, progress=report
        )
    if folder is not None:
        make_folder(folder)
        write_text(render_monte_carlo(found), folder / "montecarlo.html")
        write_json(found.as_dict(), folder / "montecarlo.json")
    show_monte_carlo(found)
    if folder is not None:
        terminal().print(f"Results in {folder}: montecarlo.json, montecarlo.html.", markup=False)
