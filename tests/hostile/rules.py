"""What must hold for every file whatever is in it, and what a breach of that is called."""

from __future__ import annotations

import contextlib
import io
import os
import signal
import sys
import tempfile
import traceback
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from types import FrameType
from typing import Final

import numpy as np

from hostile.sample import Sample
from levelhead.conventions import FloatArray
from levelhead.errors import LevelheadError
from levelhead.logs.log import Log

LIMIT_S: Final = 10.0
"""Time that one small file may take, on a machine that does other work besides, s."""
MAX_SENTENCE: Final = 1000
"""Characters of an error at most."""
SLACK: Final = 0.05
"""Share of the samples before a cut that may be missing: records are not spread quite evenly."""


class TooLong(BaseException):
    """Reading took too long; no reader catches it."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What came of one attempt to read: a log, a refusal, or a fault (then what it was)."""

    log: Log | None = None
    refusal: str = ""
    fault: str = ""
    seconds: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Kept:
    """What a cut file of `length` bytes gave: IMU samples and GNSS epochs, none of a refused one."""

    length: int
    samples: int = 0
    epochs: int = 0


class Listener:
    """Catches what is printed while it is at work, by Python or past it."""

    def __init__(self) -> None:
        # Open from the first to the last file that is read: for each a new one would cost more than the reading.
        self._file = tempfile.TemporaryFile("w+b", buffering=0)  # noqa: SIM115
        self._text = io.TextIOWrapper(self._file, encoding="utf-8", write_through=True)

    def close(self) -> None:
        """Give the file back."""
        self._text.close()

    @contextlib.contextmanager
    def at_work(self) -> Iterator[None]:
        """Listen."""
        sys.stdout.flush()
        sys.stderr.flush()
        saved = os.dup(1), os.dup(2)
        os.dup2(self._file.fileno(), 1)
        os.dup2(self._file.fileno(), 2)
        try:
            with contextlib.redirect_stdout(self._text), contextlib.redirect_stderr(self._text):
                yield
        finally:
            for descriptor, old in zip((1, 2), saved, strict=True):
                os.dup2(old, descriptor)
                os.close(old)

    def heard(self) -> str:
        """Return what was printed since this was last asked."""
        size = self._file.seek(0, os.SEEK_END)
        if size == 0:
            return ""
        self._file.seek(0)
        text = self._file.read(size).decode("utf-8", errors="replace")
        self._file.seek(0)
        self._file.truncate()
        return text


@contextlib.contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Raise `TooLong` in what takes longer."""

    def stop(_signal: int, _frame: FrameType | None) -> None:
        raise TooLong

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def attempt(sample: Sample, listener: Listener, *, limit_s: float = LIMIT_S) -> Outcome:
    """Read a sample as its files are now."""
    log, refusal, fault = None, "", ""
    begin = perf_counter()
    with listener.at_work(), warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        try:
            with time_limit(limit_s):
                log = sample.read()
        except LevelheadError as error:
            refusal = str(error) or "(no sentence)"
        except TooLong:
            fault = f"took longer than {limit_s:g} s"
        except (Exception, SystemExit) as error:  # noqa: BLE001  # each of them is what is looked for
            fault = _where(error)
    seconds = perf_counter() - begin
    if not fault and (said := listener.heard()):
        fault = f"printed {said[:200]!r}"
    if not fault and warned:
        fault = f"warned: {warned[0].category.__name__}: {str(warned[0].message)[:200]}"
    if not fault:
        fault = bad_sentence(refusal) if log is None else bad_texts(log)
    return Outcome(log=None if fault else log, refusal=refusal, fault=fault, seconds=seconds)


def judge_cut(sample: Sample, file: Path, content: bytes, length: int, outcome: Outcome) -> str:
    """Return what is wrong with what a cut file gave, or nothing."""
    log, whole = outcome.log, sample.whole
    if outcome.fault or log is None:
        return outcome.fault
    unseen = sample.cut_unseen(file.name, content, length)
    if _numbers(log) < _numbers(whole) and not unseen and log.meta["completeness"] == "complete":
        return (
            f"silently {log.time.size} of {whole.time.size} samples, {log.gnss_time.size} of {whole.gnss_time.size} "
            "epochs: the log calls itself complete"
        )
    return _differs(sample, log, last_may_differ=unseen)


def judge_cuts(sample: Sample, size: int, kept: Sequence[Kept]) -> list[tuple[int, str]]:
    """Return the cuts (length, what is wrong) at which more was lost than what was cut off."""
    if not sample.keeps_prefix or not kept:
        return []
    whole = sample.whole
    read = [k.length for k in kept if k.samples]
    begin = min(read, default=size)
    if max((k.length for k in kept if k.length < begin), default=0) > size // 2:
        return [(begin, f"nothing is kept of a file cut to less than {begin} of {size} bytes")]
    found = []
    for k in kept:
        expected = (k.length - begin) / (size - begin) - SLACK
        # The record that was cut, and an epoch that is made of several.
        share = min((k.samples + 2) / whole.time.size, (k.epochs + 2) / max(whole.gnss_time.size, 1))
        if share < expected - sample.lost_at_cut / whole.time.size:
            what = f"{k.samples} samples and {k.epochs} epochs" if k.samples else "nothing"
            found.append((k.length, f"keeps {what}, less than {expected:.0%} of the whole"))
    return found


def judge_mutation(sample: Sample, share: float, outcome: Outcome) -> str:
    """Return what is wrong with what a file gave of which a share was mutated, or nothing."""
    log, whole = outcome.log, sample.whole
    if outcome.fault or log is None:
        return outcome.fault
    if log.meta["completeness"] != "complete" or {e.code for e in log.events} - {e.code for e in whole.events}:
        return ""
    if sample.checked:
        return _differs(sample, log, last_may_differ=False) or _fewer(log, whole, 0.0)
    return _fewer(log, whole, share + SLACK)


def _fewer(log: Log, whole: Log, allowed: float) -> str:
    """Say that a log without any mark has lost more than was damaged."""
    for what, have, had in (
        ("samples", log.time.size, whole.time.size),
        ("epochs", log.gnss_time.size, whole.gnss_time.size),
    ):
        # A record has its length: what touches it loses it.
        if had - have > max(2.0, allowed * had):
            return f"silently {have} of {had} {what}: the log calls itself complete and no event tells"
    return ""


def _differs(sample: Sample, log: Log, *, last_may_differ: bool) -> str:
    """Say that samples of a log are not those of the whole one."""
    whole = sample.whole
    # A log that lost its first samples may count its time from another instant; stamps since 1970 are kept to 0.24 us.
    epoch, other = (meta.get("epoch", 0.0) for meta in (log.meta, whole.meta))
    assert isinstance(epoch, float)
    assert isinstance(other, float)
    tolerance = sample.clock_tolerance_s if epoch == other else max(sample.clock_tolerance_s, 1e-6)
    for what, since_epoch, all_stamps, pairs in (
        ("sample", log.time, whole.time, ((log.gyro, whole.gyro), (log.accel, whole.accel))),
        (
            "epoch",
            log.gnss_time,
            whole.gnss_time,
            (
                (_or_nan(log.velocity_ned, log.gnss_time), _or_nan(whole.velocity_ned, whole.gnss_time)),
                (_or_nan(log.position_llh, log.gnss_time), _or_nan(whole.position_llh, whole.gnss_time)),
            ),
        ),
    ):
        stamps = since_epoch + (epoch - other)
        rows = np.arange(stamps.size)
        if not sample.keeps_prefix:
            rows = np.searchsorted(all_stamps, stamps - tolerance)
        rows = np.minimum(rows, all_stamps.size - 1)
        keep = slice(0, max(stamps.size - last_may_differ, 0))
        if stamps.size > all_stamps.size:
            return f"{stamps.size} {what}s where the whole file has {all_stamps.size}"
        wrong = np.abs(stamps - all_stamps[rows])[keep] > tolerance
        for have, had in pairs:
            different = (have != had[rows]) & ~(np.isnan(have) & np.isnan(had[rows]))
            if what == "epoch" and different.size:
                # The last epoch may be made of several records, of which not all were left; where there are several
                # files, so may any.
                some = slice(None) if len(sample.files) > 1 else slice(-1, None)
                different[some] &= ~np.isnan(have[some])
            wrong |= different.any(axis=1)[keep]
        if wrong.any():
            return f"{what} {int(np.flatnonzero(wrong)[0]) + 1} is not that of the whole file"
    return ""


def _numbers(log: Log) -> int:
    """Return how many numbers there are of what a log is made of."""
    arrays = (log.time, log.gnss_time, log.velocity_ned, log.position_llh, log.wheel_speed)
    return sum(int(np.isfinite(array).sum()) for array in arrays if array is not None)


def _or_nan(values: FloatArray | None, stamps: FloatArray) -> FloatArray:
    return np.full((stamps.size, 3), np.nan) if values is None else values


def _where(error: BaseException) -> str:
    """Return the exception and the two last places that it came through."""
    frames = traceback.extract_tb(error.__traceback__)[-2:]
    places = " < ".join(f"{Path(f.filename).name}:{f.lineno} {f.name}" for f in reversed(frames))
    return f"{type(error).__name__}: {str(error)[:200]} ({places})"


def bad_sentence(text: str) -> str:
    """Say what keeps an error from being one printable sentence: hostile bytes must not reach a terminal."""
    if not text.isprintable():
        return f"the error is not printable: {text[:300]!r}"
    if len(text) > MAX_SENTENCE:
        return f"the error has {len(text)} characters: {text[:200]!r}"
    if not text.endswith((".", ")")):
        return f"the error is no sentence: {text[:300]!r}"
    return ""


def bad_texts(log: Log) -> str:
    """Say which text of a log is not printable."""
    texts = [event.detail for event in log.events] + [v for v in log.meta.values() if isinstance(v, str)]
    streams = log.meta.get("streams", ())
    assert isinstance(streams, tuple)
    texts += [text for stream in streams for text in (stream.name, stream.note)]
    for text in texts:
        if not text.isprintable() or len(text) > MAX_SENTENCE:
            return f"the log has a text that is not printable, or too long: {text[:300]!r}"
    return ""
