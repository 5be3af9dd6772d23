"""Files and folders that appear whole or not at all."""

from __future__ import annotations

import contextlib
import errno
import glob
import itertools
import os
import shutil
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows has no such lock
    fcntl = None

UNFINISHED = ".writing-"
"""Prefix of what is being written; what a killed process left begins with it."""
REPLACED = ".replaced-"
"""Prefix of an older folder while a new one takes its place."""
STAGED = ".writing"
"""Folder within another in which entries grow before all of them appear in it."""
NO_LINKS = (errno.EPERM, errno.ENOTSUP, errno.ENOSYS, errno.EMLINK)
"""What a file system without hard links answers."""
_HELD: set[Path] = set()
"""Lock files that this process holds."""


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold the lock file ``path`` against other processes while the block runs, then remove it.

    The system releases it where the process is killed. A block within a block of the same file holds it already.

    Args:
        path: of the lock file, in a folder that there is.

    Raises:
        BlockingIOError: another process holds it.
    """
    path = path.absolute()
    if fcntl is None or path in _HELD:
        yield
        return
    with path.open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise BlockingIOError(errno.EWOULDBLOCK, "another process holds the lock", str(path)) from None
        except OSError:  # a file system without locks
            yield
            return
        if not path.exists() or not os.path.samestat(os.fstat(file.fileno()), path.stat()):  # its holder ended just now
            raise BlockingIOError(errno.EWOULDBLOCK, "another process held the lock until now", str(path))
        _HELD.add(path)
        try:
            yield
        finally:
            _HELD.discard(path)
            path.unlink(missing_ok=True)


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


def staged_folder(path: Path) -> Path:
    """Where what will be the folder ``path`` grows, in any process: what a killed one left is found again."""
    return path.with_name(f"{UNFINISHED}{path.name}")


@contextlib.contextmanager
def folder_written(path: Path, replace: bool = False, last: str | None = None) -> Iterator[Path]:
    """A folder to fill, which becomes ``path`` when the block ends, and is removed where the block fails.

    Args:
        path: what it becomes.
        replace: take the place of an older folder, which stays until the new one is complete.
        last: ``path`` is a folder that may be there and hold other things. What was filled is moved into it, the entry
            of this name last: a folder with it is complete.

    Raises:
        OSError: the disk refuses, or ``path`` is there and must not be replaced.
    """
    staged = staged_folder(path) if last is None else path / STAGED
    shutil.rmtree(staged, ignore_errors=True)  # of a session that was killed
    staged.mkdir(parents=True)
    try:
        yield staged
        for file in staged.rglob("*"):
            if file.is_file():
                flush(file)
        if last is not None:
            _moved_into(path, staged, last)
        elif replace:
            _replaced(path, staged)
        else:
            os.rename(staged, path)
    except BaseException:
        shutil.rmtree(staged, ignore_errors=True)
        raise


def _moved_into(path: Path, staged: Path, last: str) -> None:
    for entry in sorted(staged.iterdir(), key=lambda entry: entry.name == last):
        target = path / entry.name
        if target.is_dir():  # half moved by a session that was killed
            shutil.rmtree(target)
        os.replace(entry, target)
    staged.rmdir()


def _replaced(path: Path, staged: Path) -> None:
    older = path.with_name(f"{REPLACED}{path.name}")
    if path.exists():
        os.replace(path, older)
    os.replace(staged, path)
    shutil.rmtree(older, ignore_errors=True)


def finish_replacements(folder: Path) -> None:
    """Put right what a kill between two renames left in a folder, and remove what was never complete."""
    for older in folder.glob(f"{REPLACED}*"):
        target = folder / older.name.removeprefix(REPLACED)
        if target.exists():
            shutil.rmtree(older, ignore_errors=True)
        else:
            os.replace(older, target)
    for incomplete in folder.glob(f"{UNFINISHED}*"):
        if incomplete.is_dir():
            shutil.rmtree(incomplete, ignore_errors=True)
        else:
            incomplete.unlink()


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


# --- names that a command gives by itself: what it is of, and the second in which it began ---------------------------

STAMP = "%Y%m%d-%H%M%S"
"""Of the end of such a name."""


def fresh(folder: Path, label: str, ending: str = "") -> Path:
    """``folder/<label>-<stamp><ending>``, with a number behind the stamp where something there has that name.

    Args:
        folder: that it is to be in; it may be missing.
        label: what it is of, a part of a file name.
        ending: of the file, such as ``.mp4``. A name is taken with whatever ending: a log is several files.
    """
    stem = f"{label}-{datetime.now():{STAMP}}"
    names = itertools.chain([stem], (f"{stem}-{count}" for count in itertools.count(2)))
    free = next(name for name in names if not any(folder.glob(f"{glob.escape(name)}*")))
    return folder / f"{free}{ending}"
