"""Damaged files of every format: a log that is marked or one sentence, in no time, and nothing else."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from hostile.cases import cuts, mutate
from hostile.rules import Kept, Listener, attempt, judge_cut, judge_cuts, judge_mutation
from hostile.sample import Sample, names, prepare

SIZE = 40_000
CUTS = 100
MUTATIONS = 200


@pytest.fixture
def listener() -> Iterator[Listener]:
    """What hears everything that is printed."""
    with contextlib.closing(Listener()) as listening:
        yield listening


@pytest.fixture(params=names())
def sample(request: pytest.FixtureRequest, tmp_path: Path) -> Sample:
    """The sample of one format."""
    made = prepare(request.param, tmp_path, size=SIZE)
    assert made.whole.time.size >= 50  # a second
    return made


def test_a_cut_file_gives_its_beginning_and_a_mark_or_a_sentence(sample: Sample, listener: Listener) -> None:
    wrong = []
    for file in sample.files:
        content, kept = file.read_bytes(), []
        for length in cuts(content, CUTS // len(sample.files)):
            file.write_bytes(content[:length])
            outcome = attempt(sample, listener)
            if said := judge_cut(sample, file, content, length, outcome):
                wrong.append(f"{file.name} cut to {length} of {len(content)}: {said}")
            if outcome.log is not None:
                kept.append(Kept(length=length, samples=outcome.log.time.size, epochs=outcome.log.gnss_time.size))
            else:
                kept.append(Kept(length=length))
        file.write_bytes(content)
        wrong += [f"{file.name} cut to {at}: {said}" for at, said in judge_cuts(sample, len(content), kept)]
    assert wrong == []


def test_a_mutated_file_gives_a_log_or_a_sentence(sample: Sample, listener: Listener) -> None:
    wrong = []
    for file in sample.files:
        content = file.read_bytes()
        for number in range(MUTATIONS // len(sample.files)):
            damaged, hit = mutate(content, number)
            file.write_bytes(damaged)
            outcome = attempt(sample, listener)
            if said := judge_mutation(sample, hit / len(content), outcome):
                wrong.append(f"{file.name}, mutation {number}: {said}")
        file.write_bytes(content)
    assert wrong == []
