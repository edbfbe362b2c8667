"""atheris looks for new paths through the readers: ``python -m hostile.guided SAMPLE... --seconds 60``.

One target for each file of a sample, in a process of its own, beginning with the sample and with some mutations of
it. What is looked for is what `hostile.rules` calls a fault: an exception of another kind than ours, a warning, a text
that must not reach a terminal, a hang, memory. The bytes that do it are kept, and ``python -m hostile.table --replay``
shows it.
"""

from __future__ import annotations

import argparse
import contextlib
import inspect
import os
import re
import subprocess
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from types import FunctionType
from typing import Final

TESTS: Final = Path(__file__).parent.parent
SIZE: Final = 4096
"""Bytes of a sample, about: the smaller it is, the faster the search."""
SEEDS: Final = 20
HANGS_S: Final = 20
MAX_RSS_MB: Final = 2000

LIBRARIES: Final = ("levelhead.logs", "pyulog", "rosbags", "pyubx2", "pynmeagps", "pysbf2")
"""What is instrumented, where it is installed; pyarrow is C++ through and through."""


def target(name: str, number: int, folder: Path, seconds: float) -> None:
    """Search one file of one sample; does not return: libFuzzer ends the process, with 0 if nothing was found."""
    import atheris

    # Comparisons of texts are followed, too. (Its hook for regular expressions breaks `match` with a position.)
    atheris.enabled_hooks.add("str")
    from hostile.cases import mutate
    from hostile.rules import bad_sentence, bad_texts
    from hostile.sample import prepare
    from levelhead.errors import LevelheadError

    (folder / "sample").mkdir(parents=True)
    sample = prepare(name, folder / "sample", size=SIZE)
    file = sample.files[number]
    content, form = file.read_bytes(), sample.format
    # Now that the sample was read, all that reads it is imported. (atheris's hook for imports does not see what an
    # editable installation imports.)
    instrument()
    seeds = folder / "seeds"
    seeds.mkdir()
    for k, seed in enumerate([content, *(mutate(content, k)[0] for k in range(SEEDS))]):
        (seeds / str(k)).write_bytes(seed)
    # A damaged beginning must not end the search: every other input is read as what it was.
    force = {} if "gnss" in sample.options or "mapping" in sample.options else {"format": form}

    def one(data: bytes) -> None:
        file.write_bytes(data)
        options = force if data and data[-1] & 1 else {}
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                said = bad_texts(sample.read(**options))
            except LevelheadError as error:
                said = bad_sentence(str(error))
        if said:
            raise AssertionError(said)

    found = folder / "found" / file.name
    found.parent.mkdir()
    settings = {
        "max_total_time": int(seconds),
        "timeout": HANGS_S,
        "rss_limit_mb": MAX_RSS_MB,
        "max_len": 2 * len(content) + 4096,
        "exact_artifact_path": found,
        "print_final_stats": 1,
    }

    def change(data: bytes, most: int, seed: int) -> bytes:
        # Our own mutations know of lengths and numbers; libFuzzer's know what it has seen compared.
        changed = mutate(data, seed)[0][:most] if seed & 1 else atheris.Mutate(data, most)
        return bytes(changed)

    arguments = [f"-{key}={value}" for key, value in settings.items()]
    atheris.Setup([sys.argv[0], *arguments, str(seeds)], one, custom_mutator=change)
    atheris.Fuzz()


def instrument() -> None:
    """Let atheris see which lines run, in all functions of the readers and their libraries."""
    import atheris

    functions = set()
    for name, module in list(sys.modules.items()):
        if name.startswith(LIBRARIES):
            owners = [module, *(thing for thing in vars(module).values() if inspect.isclass(thing))]
            things = [thing for owner in owners for thing in _functions(owner)]
            functions |= {f for f in things if (f.__module__ or "").startswith(LIBRARIES)}
    for function in functions:
        # Some have bytecode that atheris cannot take apart (Python's match).
        with contextlib.suppress(Exception):
            atheris.instrument_func(function)
    say(f"{len(functions)} functions are watched")


def _functions(owner: object) -> Iterator[FunctionType]:
    """Yield the functions of a module or a class, those behind decorators included."""
    for thing in vars(owner).values():
        plain = getattr(thing, "__func__", getattr(thing, "fget", thing))
        if inspect.isfunction(plain) or hasattr(plain, "__wrapped__"):
            found = inspect.unwrap(plain)
            if inspect.isfunction(found):
                yield found


def main() -> int:
    """Search all samples, one after the other, print a table, and return 1 where something was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("samples", nargs="*", help="names of samples; all by default")
    parser.add_argument("--seconds", type=float, default=60.0, help="for each sample")
    parser.add_argument("--out", type=Path, default=Path("out/fuzz/guided"), help="where what was found is kept")
    parser.add_argument("--target", nargs=3, metavar=("SAMPLE", "NUMBER", "FOLDER"), help="one target, in this process")
    chosen = parser.parse_args()
    if chosen.target:
        target(chosen.target[0], int(chosen.target[1]), Path(chosen.target[2]), chosen.seconds)
    # Not before: in the process of a target these must be imported while atheris watches.
    from hostile.sample import names, prepare
    from hostile.worker import scratch

    say(f"{'sample':20s}{'file':28s}{'runs':>9s}{'a second':>10s}{'MB':>7s}  found")
    bad = []
    for name in chosen.samples or names():
        with scratch() as temporary:
            files = [f.name for f in prepare(name, Path(temporary)).files]
        for number, file in enumerate(files):
            with scratch() as temporary:
                bad += _search(name, number, file, Path(temporary), chosen.seconds / len(files), chosen.out)
    for line in bad:
        say(line)
    return 1 if bad else 0


def _search(name: str, number: int, file: str, folder: Path, seconds: float, out: Path) -> list[str]:
    """Run one target, print its row and return what it found."""
    arguments = ["--seconds", str(seconds), "--target", name, str(number), str(folder)]
    done = subprocess.run(
        [sys.executable, "-m", "hostile.guided", *arguments],
        capture_output=True,
        text=True,
        errors="replace",
        env={**os.environ, "PYTHONPATH": str(TESTS)},
        check=False,
    )
    said = done.stdout + done.stderr
    figures = {key: re.search(rf"stat::{key}:\s*(\d+)", said) for key in _STATISTICS}
    runs, rate, memory = (match.group(1) if match else "?" for match in figures.values())
    say(
        f"{name:20s}{file[-27:]:28s}{runs:>9s}{rate:>10s}{memory:>7s}  {'nothing' if done.returncode == 0 else 'this:'}"
    )
    if done.returncode == 0:
        return []
    kept = out / f"{name}-{number}" / file
    kept.parent.mkdir(parents=True, exist_ok=True)
    found = folder / "found" / file
    if found.exists():
        kept.write_bytes(found.read_bytes())
    kept.with_name("said.txt").write_text(said, encoding="utf-8")
    last = [line for line in said.splitlines() if re.match(r"\w*(Error|Exception|Warning|Interrupt)\b|==\d+==", line)]
    return [f"{name}, {file}: {' '.join(last[:2])[:300]}  {kept if found.exists() else kept.with_name('said.txt')}"]


_STATISTICS: Final = ("number_of_executed_units", "average_exec_per_sec", "peak_rss_mb")


def say(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    raise SystemExit(main())
