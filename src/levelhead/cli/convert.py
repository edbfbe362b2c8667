"""`levelhead convert`: any readable log to the canonical CSV or Parquet or to MCAP, or a track for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final, Literal

import typer

from levelhead.cli.console import progress, say_error, terminal
from levelhead.cli.options import FormatOption, GnssOption, ImuOption, MappingOption, read_log
from levelhead.errors import UsageError
from levelhead.logs.log import Log
from levelhead.logs.result_track import is_result, result_track
from levelhead.logs.tracks import TRACK_WRITERS, Track, thinned, track_of_log, write_track
from levelhead.logs.writers import SUFFIXES, write

RESULT_EVERY_S: Final = 0.1
"""Of a result, which has a position per IMU sample, one in so many seconds is enough for a map."""


def convert(
    source: Annotated[Path, typer.Argument(metavar="LOG", help="The log to read, or a result.parquet.")],
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="Log to write: .parquet, .csv or .mcap (ROS 2). Or track: .kml, .geojson or .pos (RTKLIB).",
        ),
    ],
    gnss: GnssOption = None,
    imu: ImuOption = None,
    mapping: MappingOption = None,
    log_format: FormatOption = None,
    point: Annotated[
        Literal["imu", "reference"] | None,
        typer.Option(help="Of a result: whose path to write. Else the reference point's, if the result has one."),
    ] = None,
    every: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help=f"Of a track: seconds from one position to the next; 0: all. Else {RESULT_EVERY_S:g} for a result and "
            "all of a log.",
        ),
    ] = None,
) -> None:
    """Convert a log to canonical CSV, Parquet or MCAP, or a log or result.parquet to a KML, GeoJSON or RTKLIB track."""
    if output.suffix not in (*SUFFIXES, *TRACK_WRITERS):
        raise UsageError(
            f"{output.name} has the suffix {output.suffix!r}; a log is written as {', '.join(SUFFIXES)}, a track as "
            f"{', '.join(TRACK_WRITERS)}."
        )
    if is_result(source):
        if output.suffix in SUFFIXES:
            raise UsageError(
                f"{source.name} is a result, not a log; it becomes a track ({', '.join(TRACK_WRITERS)}). Convert the "
                "log itself, or run estimate with --corrected."
            )
        if any(option is not None for option in (gnss, imu, mapping, log_format)):
            raise UsageError(f"{source.name} is a result; --gnss, --imu, --mapping and --format go with a log.")
        with progress(f"Reading {source.name}"):
            track = result_track(source, point)
        _write_track(track, output, RESULT_EVERY_S if every is None else every)
        return
    if point is not None:
        raise UsageError(f"{source.name} is not a result.parquet; --point goes with one.")
    if every is not None and output.suffix in SUFFIXES:
        raise UsageError(f"{output.name} is a log, which keeps all samples; --every goes with a track.")
    log = read_log(source, gnss=gnss, imu=imu, mapping=mapping, log_format=log_format)
    if output.suffix in TRACK_WRITERS:
        _write_track(track_of_log(log), output, every or 0.0)
    else:
        _write_log(log, output)
    if log.meta.get("completeness", "complete") != "complete":
        say_error(f"{source.name} was read only in part ({log.meta['completeness']}).")
        raise typer.Exit(3)


def _write_log(log: Log, output: Path) -> None:
    with progress(f"Writing {output.name}"):
        write(log, output)
    terminal().print(f"Wrote {output}: {log.time.size} IMU samples, {log.gnss_time.size} GNSS epochs.", markup=False)
    if output.suffix == ".csv" and (log.meta.get("compensated") or log.meta.get("corrected_by")):
        terminal().print(
            "CSV does not keep that biases were taken off the readings before; Parquet does.", markup=False
        )


def _write_track(track: Track, output: Path, every: float) -> None:
    track = thinned(track, every)
    with progress(f"Writing {output.name}"):
        write_track(track, output)
    terminal().print(f"Wrote {output}: path of the {track.point}, {track.time.size} positions.", markup=False)
