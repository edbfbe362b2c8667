"""Options of `levelhead estimate` that write calibrations for other programs, and what they do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from levelhead.cli.console import terminal
from levelhead.errors import LogError, UsageError
from levelhead.estimators.base import Result
from levelhead.logs.log import Log
from levelhead.report.exports import EXPORTERS, check_export, exporter_of, render_export
from levelhead.report.exports.base import Document
from levelhead.report.exports.parameters import read_parameters
from levelhead.report.files import write_text

ExportOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="TARGET",
        help=f"Also write the biases for another program; again for more: {', '.join(EXPORTERS)}.",
    ),
]
CalibrationOption = Annotated[
    Path | None,
    typer.Option(
        "--calibration",
        metavar="FILE",
        help="Of --export: the autopilot's parameters, whose offsets the readings had taken off; else from the log.",
    ),
]
SlotOption = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        help="Of --export: which of the autopilot's IMUs: PX4 counts from 0, ArduPilot from 1.",
    ),
]
OnlyKnownOption = Annotated[
    bool, typer.Option("--only-known", help="Of --export: leave out the axes that are not known, instead of refusing.")
]


@dataclass(frozen=True, kw_only=True)
class Exports:
    """The targets that the user wants, the same for every log."""

    targets: tuple[str, ...]
    given: Mapping[str, float] | None
    slot: int | None
    only_known: bool

    def check(self, log: Log) -> None:
        """Refuse what cannot be exported of this log, before it is estimated."""
        for target in self.targets:
            check_export(log, target, self.given)

    def write(self, result: Result, log: Log, folder: Path) -> None:
        """Write the files into a folder: all of them, or none where one is refused."""
        documents: dict[str, Document] = {}
        try:
            for target in self.targets:
                documents[target] = render_export(
                    result, log, target, given=self.given, slot=self.slot, only_known=self.only_known
                )
        except (LogError, UsageError) as error:
            old = [name for t in self.targets if (folder / (name := exporter_of(t).file_name)).exists()]
            if not old:
                raise
            raise type(error)(f"{error} {', '.join(old)} in {folder} is of an earlier run.") from None
        for target, document in documents.items():
            path = folder / exporter_of(target).file_name
            write_text(document.text, path)
            terminal().print(f"Calibration for {target}: {path}.", markup=False)
            for note in document.notes:
                terminal().print(f"  {note}", markup=False)


def exports_wanted(
    targets: list[str] | None, calibration: Path | None, *, slot: int | None, only_known: bool
) -> Exports:
    """Return what the options ask for; the parameter file is read here, before any log."""
    wanted = tuple(dict.fromkeys(targets or ()))
    for target in wanted:
        exporter_of(target)
    if not wanted and (calibration is not None or slot is not None or only_known):
        raise UsageError("--calibration, --slot and --only-known go with --export.")
    given = None if calibration is None else read_parameters(calibration)
    return Exports(targets=wanted, given=given, slot=slot, only_known=only_known)
