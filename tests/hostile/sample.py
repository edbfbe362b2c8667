"""The samples of all formats, found by looking through the package `samples`, ready to be damaged."""

from __future__ import annotations

import importlib
import pkgutil
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import samples
from levelhead.logs.log import Log
from levelhead.logs.readers import read
from levelhead.logs.writers import write
from samples.drive import EPOCH_UTC_S, driving, sample_drive

GPST_AHEAD_S: Final = 18.0
"""Leap seconds when the sample drive was driven."""
MAX_FILES: Final = 6
"""Files of a folder that are damaged at most; a folder may have one for each epoch."""
SHORTEST_S: Final = 1.0

CutUnseen = Callable[[str, bytes, int], bool]


@dataclass(frozen=True, kw_only=True)
class Sample:
    """One sample on disk.

    Attributes
    ----------
    log_path : Path
        What `levelhead.read` gets, with `options`.
    files : tuple of Path
        What is damaged, one at a time.
    whole : Log
        What the undamaged sample gives.
    keeps_prefix, lost_at_cut, cut_unseen, checked, clock_tolerance_s
        See `samples`.
    """

    name: str
    log_path: Path
    options: Mapping[str, Any]
    files: tuple[Path, ...]
    keeps_prefix: bool
    lost_at_cut: int
    cut_unseen: CutUnseen
    checked: bool
    clock_tolerance_s: float

    def read(self, **options: Any) -> Log:
        """Read the sample as its files are now."""
        return read(self.log_path, **{**self.options, **options})

    @cached_property
    def whole(self) -> Log:
        """What the undamaged sample gives; asked for before the first damage."""
        log = self.read()
        assert log.meta["completeness"] == "complete", f"the sample {self.name} itself is {log.meta['completeness']}"
        return log

    @property
    def format(self) -> str:
        """The format of the file, or the files, that are damaged."""
        return str(self.whole.meta["gnss_format" if "gnss" in self.options else "format"])


def names() -> list[str]:
    """Return the names of all samples: the modules of `samples` that write one."""
    found = (module.name for module in pkgutil.iter_modules(samples.__path__))
    return sorted(name for name in found if hasattr(_module(name), "write"))


def prepare(name: str, folder: Path, *, size: int | None = None, log: Log | None = None) -> Sample:
    """Write a sample into an empty folder.

    Parameters
    ----------
    name : str
        One of `names`.
    folder : Path
        Existing and empty.
    size : int, optional
        Bytes that the longest file should have about: the drive is cut short.
    log : Log, optional
        Another log than the sample drive.
    """
    module = _module(name)
    inside = folder / "log"
    log = sample_drive() if log is None else log
    path = _write(module, inside, log)
    longest = max(p.stat().st_size for p in inside.rglob("*") if p.is_file())
    if size is not None and longest > size:
        log = log.slice(0.0, max(getattr(module, "SHORTEST_S", SHORTEST_S), log.duration * size / longest))
        shutil.rmtree(inside)
        path = _write(module, inside, log)
    options = dict(getattr(module, "OPTIONS", {}))
    if hasattr(module, "MAPPING"):
        options["mapping"] = folder / "mapping.toml"
        options["mapping"].write_text(module.MAPPING, encoding="utf-8")
    log_path = path
    if hasattr(module, "write_gnss"):
        with driving(log):
            options["gnss"] = module.write_gnss(inside)
    if getattr(module, "GNSS_ONLY", False):
        log_path, options["gnss"] = folder / "reference.csv", path
        ahead = GPST_AHEAD_S if getattr(module, "TIME_SCALE", "GPST") == "GPST" else 0.0
        write(_imu_alone(log, EPOCH_UTC_S + ahead), log_path)
        _drop_gnss_columns(log_path)
    return Sample(
        name=name,
        log_path=log_path,
        options=options,
        files=_files(inside),
        keeps_prefix=getattr(module, "KEEPS_PREFIX", True) and not path.is_dir(),
        lost_at_cut=getattr(module, "LOST_AT_CUT", 0),
        cut_unseen=_cut_unseen(module),
        checked=getattr(module, "CHECKED", False),
        clock_tolerance_s=getattr(module, "CLOCK_TOLERANCE_S", 0.0),
    )


def _write(module: ModuleType, folder: Path, log: Log) -> Path:
    folder.mkdir()
    with driving(log):
        path: Path = module.write(folder)
    return path


def _module(name: str) -> ModuleType:
    return importlib.import_module(f"samples.{name}")


def _cut_unseen(module: ModuleType) -> CutUnseen:
    declared = getattr(module, "CUT_UNSEEN", None)
    if callable(declared):
        return declared  # type: ignore[no-any-return]
    unseen = isinstance(declared, str)
    return lambda _name, _content, _length: unseen


def _files(folder: Path) -> tuple[Path, ...]:
    """Return what to damage: of files that are alike (one folder, one suffix) the longest, then others."""
    paths = sorted((p for p in folder.rglob("*") if p.is_file()), key=lambda p: (-p.stat().st_size, p))
    first: dict[tuple[Path, str], Path] = {}
    for path in paths:
        first.setdefault((path.parent, path.suffix), path)
    chosen = list(first.values())
    chosen += [p for p in paths if p not in chosen]
    return tuple(chosen[:MAX_FILES])


def _imu_alone(log: Log, epoch: float) -> Log:
    return replace(log, time=log.time + epoch, gnss_time=log.gnss_time + epoch)


def _drop_gnss_columns(path: Path) -> None:
    """Leave the first seven columns, of the rows that have IMU readings: time, gyro, accel."""
    rows = [line.split(",")[:7] for line in path.read_text(encoding="ascii").splitlines()]
    path.write_text("".join(",".join(row) + "\n" for row in rows if all(row)), encoding="ascii")
