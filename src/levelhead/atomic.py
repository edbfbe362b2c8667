"""Writing files so that a reader, a crash or a full disk ever sees the old file or the new one, never half of one."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from levelhead.errors import OutputError


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path beside `path`; when the block ends well it is flushed to disk and takes the name `path`.

    Parameters
    ----------
    path : path
        The file to write or to replace. Its folder must exist.

    Yields
    ------
    Path
        An empty file in the same folder; write the content there.

    Raises
    ------
    OutputError
        When the system refuses to create, write or rename. As after any other exception in the block,
        KeyboardInterrupt included, the old file is untouched and no temporary file is left.
    """
    target = Path(path)
    temporary = target.parent / f".levelhead-{secrets.token_hex(6)}.tmp"
    try:
        _create(temporary)
        yield temporary
        _sync(temporary)
        os.replace(temporary, target)
        _sync(target.parent)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        if isinstance(error, OSError) and not isinstance(error, OutputError):
            reason = error.strerror or str(error)
            raise OutputError(
                f"{target} could not be written: {reason}. Nothing was changed; check the folder, its rights and the "
                "free space."
            ) from error
        raise


def _create(path: Path) -> None:
    """Create an empty new file with the rights that the umask grants (tempfile would make it private)."""
    os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))


def _sync(path: Path) -> None:
    """Wait until a file, or the entry of a renamed file in its folder, is on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
