"""Calibrations for other programs: each target is one file here and one line in `EXPORTERS`."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from levelhead.errors import LogError, UsageError
from levelhead.estimators.base import Result
from levelhead.logs.log import Log
from levelhead.report.exports import ardupilot, kalibr, kf_gins, plain_json, px4, ros
from levelhead.report.exports.base import Document, Exporter, calibration_of, old_offsets, plain, refuse_unknown
from levelhead.report.exports.parameters import read_parameters
from levelhead.report.files import write_text

EXPORTERS: Final[dict[str, Exporter]] = {
    exporter.name: exporter
    for exporter in (
        px4.EXPORTER,
        ardupilot.EXPORTER,
        ros.EXPORTER,
        kf_gins.EXPORTER,
        kalibr.EXPORTER,
        plain_json.EXPORTER,
    )
}
"""Every target by its name."""


def export_calibration(
    result: Result,
    log: Log,
    target: str,
    path: str | os.PathLike[str],
    *,
    calibration: Mapping[str, float] | str | os.PathLike[str] | None = None,
    slot: int | None = None,
    only_known: bool = False,
) -> tuple[str, ...]:
    """Write the biases at the end of a log for another program (docs/exports.md).

    Parameters
    ----------
    result : Result
        Estimates for this log.
    log : Log
        The log that they are of. Its ``meta`` tells what the readings had taken off and how they were turned.
    target : str
        A key of `EXPORTERS`: "px4", "ardupilot", "ros", "kf-gins", "kalibr" or "json".
    path : path
        File to write or to replace, whole or not at all.
    calibration : mapping or path, optional
        The autopilot's parameters at the time of the drive, or their file: the offsets that were taken off before
        recording, where the log does not tell. The new offsets come on top of them.
    slot : int, optional
        Which of the autopilot's IMUs, as its parameters count: from 0 for PX4, from 1 for ArduPilot.
    only_known : bool
        Leave out axes that were never observable, instead of refusing.

    Returns
    -------
    tuple of str
        What the user must know besides: sentences that are comments in the file.

    Raises
    ------
    UsageError
        For an unknown target or slot, or a parameter file that cannot be read.
    LogError
        When a bias was never observable, or offsets were taken off before recording that are not known.
    """
    given = read_parameters(calibration) if isinstance(calibration, str | os.PathLike) else calibration
    document = render_export(result, log, target, given=given, slot=slot, only_known=only_known)
    write_text(document.text, Path(path))
    return document.notes


def exporter_of(target: str) -> Exporter:
    """Return a target by its name, or raise a UsageError with the names there are."""
    if target not in EXPORTERS:
        raise UsageError(f"There is no export target {target!r}; choose one of {', '.join(EXPORTERS)}.")
    return EXPORTERS[target]


def check_export(log: Log, target: str, given: Mapping[str, float] | None) -> None:
    """Refuse, before anything is estimated, a target whose offsets come on top of others that are not known."""
    old = old_offsets(log, given)
    if not exporter_of(target).adds_to_old:
        return
    no_calibration = f"No calibration for {target} can be made of {plain(str(log.meta.get('source') or 'the log'))}"
    if log.meta.get("corrected_by"):
        raise LogError(
            f"{no_calibration}: levelhead itself had taken biases off its readings. Export with the log that these "
            "were estimated from."
        )
    if old.applied and old.parameters is None:
        raise LogError(
            f"{no_calibration}: offsets were taken off its readings before recording ({plain(old.by)}), and the new "
            "ones come on top of them. Pass the vehicle's parameter file of that day with --calibration."
        )


def render_export(
    result: Result,
    log: Log,
    target: str,
    *,
    given: Mapping[str, float] | None = None,
    slot: int | None = None,
    only_known: bool = False,
) -> Document:
    """Return the file that `export_calibration` writes; `given` are the autopilot's parameters."""
    exporter = exporter_of(target)
    check_export(log, target, given)
    calibration = calibration_of(result, log, given=given, slot=slot)
    if exporter.has_biases:
        refuse_unknown(calibration, only_known=only_known)
    return exporter.render(calibration)
