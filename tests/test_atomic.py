"""A file is the old one or the new one, whatever happens while it is written."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

import pytest

from levelhead.atomic import atomic_path
from levelhead.errors import OutputError


def names(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir())


def test_the_new_file_takes_the_place_of_the_old_one_at_the_end_only(tmp_path: Path) -> None:
    target = tmp_path / "result.txt"
    target.write_text("old")
    with atomic_path(target) as temporary:
        temporary.write_text("new")
        assert temporary.parent == target.parent  # a rename across file systems would not be atomic
        assert target.read_text() == "old"
    assert target.read_text() == "new"
    assert names(tmp_path) == ["result.txt"]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, SystemExit])
def test_any_exception_leaves_the_old_file_and_no_temporary_one(tmp_path: Path, error: type[BaseException]) -> None:
    target = tmp_path / "result.txt"
    target.write_text("old")

    def fail() -> None:
        with atomic_path(target) as temporary:
            temporary.write_text("half")
            raise error

    with pytest.raises(error):
        fail()
    assert target.read_text() == "old"
    assert names(tmp_path) == ["result.txt"]


def test_a_full_disk_is_an_output_error_with_a_sentence(tmp_path: Path) -> None:
    target = tmp_path / "result.txt"

    def fail() -> None:
        with atomic_path(target):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with pytest.raises(OutputError, match=r"result\.txt could not be written: No space left on device\. Nothing was"):
        fail()
    assert names(tmp_path) == []


def test_a_failing_flush_to_disk_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "result.txt"
    target.write_text("old")

    def refuse(_descriptor: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    def write() -> None:
        with atomic_path(target) as temporary:
            temporary.write_text("new")

    monkeypatch.setattr(os, "fsync", refuse)
    with pytest.raises(OutputError, match="Input/output error"):
        write()
    assert target.read_text() == "old"
    assert names(tmp_path) == ["result.txt"]


def test_a_missing_folder_is_an_output_error(tmp_path: Path) -> None:
    def write() -> None:
        with atomic_path(tmp_path / "absent" / "result.txt"):
            pass

    with pytest.raises(OutputError, match="No such file or directory"):
        write()


def test_the_file_has_the_rights_that_the_umask_grants(tmp_path: Path) -> None:
    plain = tmp_path / "plain"
    plain.touch()
    with atomic_path(tmp_path / "result") as temporary:
        temporary.write_text("new")
    assert stat.S_IMODE((tmp_path / "result").stat().st_mode) == stat.S_IMODE(plain.stat().st_mode)
