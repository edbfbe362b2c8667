"""One piece of `hostile.table` in a process of its own: a file cut or mutated some hundred times, within its limits."""

from __future__ import annotations

import contextlib
import json
import os
import resource
import sys
import tempfile
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

from hostile.cases import SEED, mutate
from hostile.rules import Kept, Listener, Outcome, attempt, judge_cut, judge_mutation
from hostile.sample import Sample, prepare

SIZE: Final = 65536
"""Bytes of the longest file of a sample, about."""
MAX_RSS_MB: Final = 1000.0
"""Memory that a worker may have come to need: its libraries, and one small file."""
ADDRESS_SPACE: Final = 4 << 30
"""Bytes of address space beyond those at the start; what wants more gets a MemoryError."""
LAST_BYTES: Final = 2048
"""Where a file is longer than what is cut at every byte, so many of its last bytes are cut off one by one, too."""
MAX_SAVED: Final = 20

Kind = Literal["cut", "mutation"]


@dataclass(frozen=True, kw_only=True)
class Piece:
    """Cases `first` to `last` (without it) of one kind, of one file of one sample; `every` bytes are cut at each."""

    sample: str
    file: int
    kind: Kind
    first: int
    last: int
    every: int
    seed: int = SEED

    @property
    def name(self) -> str:
        """For the file with its result."""
        return f"{self.sample}-{self.file}-{self.kind}-{self.first}-{self.last}-{self.every}-{self.seed}"


@dataclass(kw_only=True)
class Tally:
    """What came of a piece; `kept` has length, samples and epochs of each cut."""

    cases: int = 0
    logs: int = 0
    refusals: int = 0
    worst_s: float = 0.0
    worst_rss_mb: float = 0.0
    breaches: list[dict[str, Any]] = field(default_factory=list)
    kept: list[tuple[int, int, int]] = field(default_factory=list)


def scratch() -> tempfile.TemporaryDirectory[str]:
    """Return a folder that goes with the process, in memory where the machine has one there."""
    return tempfile.TemporaryDirectory(dir="/dev/shm" if os.access("/dev/shm", os.W_OK) else None)  # noqa: S108


def lengths(content: bytes, every: int) -> list[int]:
    """Return the lengths that a file is cut to."""
    last = min(every, LAST_BYTES)
    if len(content) <= every + last:
        return list(range(len(content)))
    return [*range(every), *range(len(content) - last, len(content))]


def damaged(piece: Piece, content: bytes, number: int) -> tuple[bytes, int]:
    """Return the file of a case, and its length (of a cut) or how many bytes were hit (by a mutation)."""
    if piece.kind == "mutation":
        return mutate(content, number, seed=piece.seed)
    length = lengths(content, piece.every)[number]
    return content[:length], length


def work(piece: Piece, folder: Path) -> None:
    """Do a piece and write its tally into `folder`; ``NAME.at`` says which case is being tried."""
    with scratch() as name, contextlib.closing(Listener()) as listener:
        sample = prepare(piece.sample, Path(name), size=SIZE)
        file = sample.files[piece.file]
        content, whole = file.read_bytes(), sample.whole
        assert whole is not None
        _limit_memory()
        tally = Tally()
        with (folder / f"{piece.name}.at").open("w") as at:
            for number in range(piece.first, piece.last):
                at.seek(0)
                at.write(f"{number:<12d}")
                at.flush()
                data, measure = damaged(piece, content, number)
                file.write_bytes(data)
                outcome = attempt(sample, listener)
                said = _judged(piece, sample, file, content, measure, outcome)
                _add(tally, piece, outcome, measure)
                if said:
                    saved = _save(folder, piece, number, file.name, data) if len(tally.breaches) < MAX_SAVED else ""
                    tally.breaches.append({"case": number, "said": said, "saved": saved})
    (folder / f"{piece.name}.json").write_text(json.dumps(asdict(tally)), encoding="utf-8")


def _judged(piece: Piece, sample: Sample, file: Path, content: bytes, measure: int, outcome: Outcome) -> str:
    if peak_mb() > MAX_RSS_MB and not outcome.fault:
        return f"needs {peak_mb():.0f} MB"
    if piece.kind == "cut":
        return judge_cut(sample, file, content, measure, outcome)
    return judge_mutation(sample, measure / max(len(content), 1), outcome)


def _add(tally: Tally, piece: Piece, outcome: Outcome, measure: int) -> None:
    tally.cases += 1
    tally.logs += outcome.log is not None
    tally.refusals += bool(outcome.refusal)
    tally.worst_s = max(tally.worst_s, outcome.seconds)
    tally.worst_rss_mb = peak_mb()
    if piece.kind == "cut":
        log = outcome.log
        kept = (
            Kept(length=measure)
            if log is None
            else Kept(length=measure, samples=log.time.size, epochs=log.gnss_time.size)
        )
        tally.kept.append((kept.length, kept.samples, kept.epochs))


def _save(folder: Path, piece: Piece, number: int, name: str, data: bytes) -> str:
    """Keep the file of a breach, for ``python -m hostile.table --replay``."""
    target = folder / "breaches" / f"{piece.sample}-{piece.kind}-{number}" / name
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_bytes(data)
    return str(target)


def peak_mb() -> float:
    """Return the most memory that this process has had, MB."""
    # Not getrusage: its maximum is handed down from the parent.
    return int(Path("/proc/self/status").read_text(encoding="ascii").split("VmHWM:")[1].split()[0]) / 1024.0


def _limit_memory() -> None:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    limit = pages * resource.getpagesize() + ADDRESS_SPACE
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


if __name__ == "__main__":
    work(Piece(**json.loads(sys.argv[1])), Path(sys.argv[2]))
