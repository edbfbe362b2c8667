"""``make fuzz``: every sample cut at every byte of 64 KB and mutated ten thousand times, as one table.

Each piece of work has a process and a file with its tally, so that a run that was stopped goes on where it was, and a
crash or a hang of the process is found and is a breach like others. ``--replay SAMPLE FILE`` reads one file that
breached a rule, with its traceback.
"""

from __future__ import annotations

import argparse
import dataclasses
import hashlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final

import levelhead
from hostile.cases import SEED
from hostile.rules import Kept, judge_cuts
from hostile.sample import Sample, names, prepare
from hostile.worker import SIZE, Kind, Piece, Tally, damaged, lengths, scratch

PIECE: Final = 2000
"""Cases of one process."""
MAX_SHOWN: Final = 10
"""Breaches of one sample that are printed; the tallies have all."""
HANGS_S: Final = 60.0
"""A case that takes longer hangs where no signal reaches it, s."""

TESTS: Final = Path(__file__).parent.parent


def main() -> int:
    """Run what is not done yet, print the table, and return 1 where a rule was broken."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("samples", nargs="*", help="names of samples; all by default")
    parser.add_argument("--cuts", type=int, default=65536, help="bytes of each file's beginning to cut at")
    parser.add_argument("--mutations", type=int, default=10_000, help="mutations of each sample")
    parser.add_argument("--out", type=Path, default=Path("out/fuzz"), help="where the tallies are")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--size", type=int, default=SIZE, help="of the sample, for --replay")
    parser.add_argument("--replay", nargs=2, metavar=("SAMPLE", "FILE"))
    chosen = parser.parse_args()
    if chosen.replay:
        return replay(chosen.replay[0], Path(chosen.replay[1]), chosen.size)
    folder = chosen.out / _state()
    folder.mkdir(parents=True, exist_ok=True)
    plans = {name: plan(name, chosen) for name in chosen.samples or names()}
    with ThreadPoolExecutor(chosen.workers) as pool:
        tallies = {name: [pool.submit(tally_of, p, folder) for p in pieces] for name, pieces in plans.items()}
        say(
            f"{'sample':20s}{'cuts':>8s}{'mutations':>11s}{'logs':>8s}{'refusals':>10s}{'worst s':>9s}{'MB':>6s}"
            "  breaches"
        )
        bad = [
            broken
            for name, pieces in plans.items()
            for broken in report(name, list(zip(pieces, [f.result() for f in tallies[name]], strict=True)))
        ]
    for name in plans:
        lines = [line for line in bad if line.startswith(f"{name},")]
        for line in lines[:MAX_SHOWN]:
            say(line)
        if len(lines) > MAX_SHOWN:
            say(f"{name}: {len(lines) - MAX_SHOWN} more")
    return 1 if bad else 0


def plan(name: str, chosen: argparse.Namespace) -> list[Piece]:
    """Return the pieces of work for one sample."""
    with scratch() as temporary:
        sizes = [len(lengths(f.read_bytes(), chosen.cuts)) for f in prepare(name, Path(temporary), size=SIZE).files]

    def pieces(file: int, kind: Kind, number: int) -> Iterator[Piece]:
        for first in range(0, number, PIECE):
            last = min(first + PIECE, number)
            yield Piece(sample=name, file=file, kind=kind, first=first, last=last, every=chosen.cuts, seed=chosen.seed)

    found: list[Piece] = []
    for file, size in enumerate(sizes):
        found += pieces(file, "cut", size)
        found += pieces(file, "mutation", -(-chosen.mutations // len(sizes)))
    return found


def tally_of(piece: Piece, folder: Path) -> Tally:
    """Return the tally of a piece, done now if it is not there; a process that dies is a breach of one case."""
    path = folder / f"{piece.name}.json"
    if not path.exists():
        parts: list[Tally] = []
        rest = piece
        while True:
            said = run_process(rest, folder)
            done = folder / f"{rest.name}.json"
            if done.exists():
                parts.append(read_tally(done))
                break
            number = _at(folder / f"{rest.name}.at", -1)
            if number < 0:
                raise RuntimeError(f"A worker could not begin: {said}.")
            if number > rest.first:
                # What came before the case that killed it is done again, and ends well.
                parts.append(tally_of(dataclasses.replace(rest, last=number), folder))
            parts.append(
                Tally(cases=1, breaches=[{"case": number, "said": said, "saved": save_case(rest, number, folder)}])
            )
            if number + 1 >= rest.last:
                break
            rest = dataclasses.replace(rest, first=number + 1)
        path.write_text(json.dumps(dataclasses.asdict(merged(parts))), encoding="utf-8")
    return read_tally(path)


def run_process(piece: Piece, folder: Path) -> str:
    """Run a worker to its end; return how it ended where it did not end well."""
    command = [sys.executable, "-m", "hostile.worker", json.dumps(dataclasses.asdict(piece)), str(folder)]
    environment = {**os.environ, "PYTHONPATH": str(TESTS)}
    progress = folder / f"{piece.name}.at"
    progress.unlink(missing_ok=True)
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=environment) as process:
        assert process.stderr is not None
        last, since = -1, time.monotonic()
        while process.poll() is None:
            time.sleep(0.05)
            now = _at(progress, -1)
            if now != last:
                last, since = now, time.monotonic()
            elif time.monotonic() - since > HANGS_S:
                process.kill()
                return f"hangs: killed after {HANGS_S:g} s"
        lines = process.stderr.read().decode("utf-8", errors="replace").splitlines()[-2:]
    return f"the process ended with {process.returncode}: {' '.join(lines)[:300]}"


def report(name: str, done: Sequence[tuple[Piece, Tally]]) -> list[str]:
    """Print the row of one sample; return its breaches, those included that show only when all cuts are there."""
    total = merged([tally for _, tally in done])
    said = [
        f"{name}, {p.kind} {b['case']} (file {p.file}, seed {p.seed}): {b['said']}  {b['saved']}"
        for p, t in done
        for b in t.breaches
    ]
    with scratch() as temporary:
        sample = prepare(name, Path(temporary), size=SIZE)
        said += lost(name, sample, done)
    cases = {kind: sum(t.cases for p, t in done if p.kind == kind) for kind in ("cut", "mutation")}
    say(
        f"{name:20s}{cases['cut']:8d}{cases['mutation']:11d}{total.logs:8d}{total.refusals:10d}{total.worst_s:9.2f}"
        f"{total.worst_rss_mb:6.0f}  {len(said) or 'none'}"
    )
    return said


def lost(name: str, sample: Sample, done: Sequence[tuple[Piece, Tally]]) -> list[str]:
    """Return the cuts at which more was lost than what was cut off."""
    said = []
    for number, file in enumerate(sample.files):
        kept = [
            Kept(length=length, samples=samples, epochs=epochs)
            for piece, tally in done
            if piece.file == number
            for length, samples, epochs in tally.kept
        ]
        said += [
            f"{name}, {file.name} cut to {at}: {what}" for at, what in judge_cuts(sample, file.stat().st_size, kept)
        ]
    return said


def merged(tallies: Sequence[Tally]) -> Tally:
    """Add tallies up."""
    return Tally(
        cases=sum(t.cases for t in tallies),
        logs=sum(t.logs for t in tallies),
        refusals=sum(t.refusals for t in tallies),
        worst_s=max((t.worst_s for t in tallies), default=0.0),
        worst_rss_mb=max((t.worst_rss_mb for t in tallies), default=0.0),
        breaches=[b for t in tallies for b in t.breaches],
        kept=[k for t in tallies for k in t.kept],
    )


def read_tally(path: Path) -> Tally:
    """Read what a worker wrote."""
    content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return Tally(**{**content, "kept": [tuple(k) for k in content["kept"]]})


def save_case(piece: Piece, number: int, folder: Path) -> str:
    """Keep the file that killed its process."""
    with scratch() as temporary:
        file = prepare(piece.sample, Path(temporary), size=SIZE).files[piece.file]
        data, _ = damaged(piece, file.read_bytes(), number)
    target = folder / "breaches" / f"{piece.sample}-{piece.kind}-{number}" / file.name
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_bytes(data)
    return str(target)


def replay(name: str, saved: Path, size: int) -> int:
    """Read the sample with one of its files replaced by a saved one of the same name; errors come with a traceback."""
    with scratch() as temporary:
        sample = prepare(name, Path(temporary), size=size)
        file = next(f for f in sample.files if f.name == saved.name)
        file.write_bytes(saved.read_bytes())
        log = sample.read()
    say(f"{log.time.size} samples, {log.gnss_time.size} epochs, {log.meta['completeness']}, {log.events}")
    return 0


def say(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def _at(path: Path, otherwise: int) -> int:
    try:
        return int(path.read_text(encoding="ascii") or otherwise)
    except (OSError, ValueError):
        return otherwise


def _state() -> str:
    """Return a name for what is tested: another reader or sample is another state, with tallies of its own."""
    digest = hashlib.sha256()
    folders = (Path(levelhead.__file__).parent / "logs", TESTS / "hostile", TESTS / "samples")
    for path in sorted(p for folder in folders for p in folder.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


if __name__ == "__main__":
    raise SystemExit(main())
