"""The kit that damages logs finds what it is made to find: readers that are broken on purpose."""

from __future__ import annotations

import contextlib
import itertools
import os
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import hostile.sample
from hostile.cases import cuts, mutate
from hostile.rules import Kept, Listener, Outcome, attempt, judge_cut, judge_cuts, judge_mutation
from hostile.sample import Sample, names, prepare
from levelhead.errors import LogError
from levelhead.logs.log import Log

Read = Callable[..., Log]


@pytest.fixture
def sample(tmp_path: Path) -> Sample:
    """A small log, read once."""
    made = prepare("canonical_csv", tmp_path, size=40_000)
    assert made.whole.time.size > 100
    return made


@pytest.fixture
def outcome(sample: Sample, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[Read], Outcome]]:
    """Return what comes of reading the sample by a reader that does this."""
    with contextlib.closing(Listener()) as listener:

        def of(read: Read) -> Outcome:
            monkeypatch.setattr(hostile.sample, "read", read)
            return attempt(sample, listener, limit_s=0.2)

        yield of


def does(sample: Sample, act: Callable[[], Any]) -> Read:
    """Return a reader that does something besides."""

    def read(*_: object, **__: object) -> Log:
        act()
        return sample.whole

    return read


def refuse(sentence: str) -> Callable[[], None]:
    def act() -> None:
        raise LogError(sentence)

    return act


def test_what_a_reader_must_not_do_is_heard(sample: Sample, outcome: Callable[[Read], Outcome]) -> None:
    for act, fault in (
        (lambda: dict[str, int]()["x"], "KeyError: 'x' (test_hostile_rules.py"),
        (lambda: sys.exit(1), "SystemExit: 1"),
        (lambda: print("hello"), "printed 'hello\\n'"),  # noqa: T201  # the point
        (lambda: os.write(2, b"hello"), "printed 'hello'"),
        (lambda: warnings.warn("hello", stacklevel=1), "warned: UserWarning: hello"),
        (lambda: open(os.devnull), "warned: ResourceWarning"),  # noqa: SIM115  # the point
        (lambda: time.sleep(5.0), "took longer than 0.2 s"),
        (refuse("no sentence"), "the error is no sentence"),
    ):
        found = outcome(does(sample, act))
        assert found.fault.startswith(fault)
        assert found.log is None
    # Errors see to it themselves that they are short and harm no terminal.
    assert outcome(does(sample, refuse("\x1b[2J" + "x" * 2000 + "."))).fault == ""
    assert outcome(does(sample, lambda: None)).fault == ""
    assert outcome(does(sample, refuse("A sentence."))).fault == ""


def test_a_cut_log_that_calls_itself_complete_or_is_not_the_beginning_is_found(sample: Sample) -> None:
    whole, file = sample.whole, sample.files[0]
    content = file.read_bytes()
    part = whole.slice(0.0, 2.0)
    cut = replace(part, meta={**part.meta, "completeness": "truncated"})
    bare = replace(sample, cut_unseen=lambda *_: False)

    def judged(log: Log) -> str:
        return judge_cut(bare, file, content, len(content) // 2, Outcome(log=log))

    assert judged(cut) == ""
    assert judged(part).startswith("silently 100 of ")
    wrong = cut.gyro.copy()
    wrong[7, 2] += 1e-12
    assert judged(replace(cut, gyro=wrong)) == "sample 8 is not that of the whole file"
    assert cut.velocity_ned is not None
    assert judged(replace(cut, velocity_ned=cut.velocity_ned * 1.5)) == "epoch 1 is not that of the whole file"
    late = replace(cut, time=cut.time + 0.02, gnss_time=cut.gnss_time + 0.02)
    assert judged(late) == "sample 1 is not that of the whole file"


def test_a_reader_that_keeps_nothing_or_little_of_a_cut_file_is_found(sample: Sample) -> None:
    n, m = sample.whole.time.size, sample.whole.gnss_time.size
    lengths = range(0, 1000, 10)
    good = [Kept(length=k, samples=n * k // 1000, epochs=m * k // 1000) for k in lengths]
    assert judge_cuts(sample, 1000, good) == []
    assert judge_cuts(sample, 1000, [Kept(length=k) for k in lengths])[0][1].startswith("nothing is kept")
    gap = [Kept(length=k.length) if k.length == 500 else k for k in good]
    assert [at for at, _ in judge_cuts(sample, 1000, gap)] == [500]
    half = [replace(k, epochs=k.epochs // 2) for k in good]
    assert len(judge_cuts(sample, 1000, half)) > 70


def test_a_mutation_that_costs_more_than_itself_without_a_word_is_found(sample: Sample) -> None:
    half = sample.whole.slice(0.0, 2.0)
    assert judge_mutation(sample, 0.001, Outcome(log=half)).startswith("silently 100 of ")
    marked = replace(half, meta={**half.meta, "completeness": "malformed_record"})
    assert judge_mutation(sample, 0.001, Outcome(log=marked)) == ""
    assert judge_mutation(sample, 0.001, Outcome(log=sample.whole)) == ""


def test_mutations_are_the_same_for_the_same_number_and_rarely_none() -> None:
    content = bytes(range(256)) * 40
    mutated = [mutate(content, k) for k in range(300)]
    assert mutated == [mutate(content, k) for k in range(300)]
    # Swapped equal blocks and zeros over zeros change nothing.
    assert sum(data != content for data, _ in mutated) > 270
    assert mutate(content, 1, seed=1) != mutate(content, 1, seed=2)
    for empty in (b"", b"x"):
        for k in range(200):
            mutate(empty, k)


def test_cuts_are_spread_and_include_both_ends() -> None:
    lengths = cuts(bytes(10_000), 100)
    assert lengths[0] == 0
    assert lengths[-1] == 9999
    assert max(b - a for a, b in itertools.pairwise(lengths)) <= 101  # 100 over 10 000 bytes
    assert cuts(b"abc", 100) == [0, 1, 2]


def test_every_sample_is_found_and_the_table_runs(tmp_path: Path) -> None:
    assert {"canonical_csv", "canonical_parquet", "mapped_csv", "rtklib_pos"} <= set(names())
    command = [sys.executable, "-m", "hostile.table", "rtklib_pos", "--cuts", "3", "--mutations", "20"]
    command += ["--out", str(tmp_path), "--workers", "1"]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
    for _ in range(2):  # the second time from the tallies
        done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
        assert done.stdout.splitlines()[1].split()[0] == "rtklib_pos"
        assert done.stdout.splitlines()[1].endswith("none")
