"""Files that appear whole or not at all."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Iterator
from pathlib import Path

UNFINISHED = ".writing-"
"""Prefix of what is being written; what a killed process left begins with it."""
NO_LINKS = (errno.EPERM, errno.ENOTSUP, errno.ENOSYS, errno.EMLINK)
"""What a file system without hard links answers."""


def unfinished(path: Path) -> Path:
    """Where this process writes what will be ``path``."""
    return path.with_name(f"{UNFINISHED}{os.getpid()}-{path.name}")


@contextlib.contextmanager
def written(path: Path, replace: bool = False) -> Iterator[Path]:
    """A file to write, which becomes ``path`` when the block ends, and is removed where the block fails.

    Args:
        path: what it becomes, in a folder that there is.
        replace: take the place of an older file.

    Raises:
        FileExistsError: ``path`` is there and must not be replaced.
        OSError: the disk refuses.
    """
    fresh = unfinished(path)
    try:
        yield fresh
        flush(fresh)
        if replace:
            os.replace(fresh, path)
        else:
            _publish(fresh, path)
    finally:
        fresh.unlink(missing_ok=True)


def flush(path: Path) -> None:
    """Have a file's content on the disk: a full one may show only now."""
    with path.open("rb") as file:
        os.fsync(file.fileno())


def write_text(path: Path, text: str, replace: bool = False) -> None:
    """Write a text; see :func:`written`."""
    with written(path, replace) as fresh:
        fresh.write_text(text, encoding="utf-8")


def _publish(fresh: Path, path: Path) -> None:
    """Give a file its name: a hard link refuses a taken one in a single step, which renaming does not."""
    try:
        os.link(fresh, path)
    except OSError as error:
        if error.errno not in NO_LINKS:
            raise
        if path.exists():
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path)) from None
        os.rename(fresh, path)
