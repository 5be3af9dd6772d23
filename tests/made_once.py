"""What takes long and several test files need is made once in a session, by one worker, and kept on disk for all."""

from __future__ import annotations

import functools
import os
import pickle
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from filelock import FileLock

SHARED = "SEALEGS_TESTS_SHARED"
"""Environment variable with the folder of the session, which `tests/conftest.py` makes and removes."""

Made = TypeVar("Made")


def folder_made_once(name: str, make: Callable[[Path], object]) -> Path:
    """Folder ``name``, filled by ``make`` in the worker that asks first; the others wait for it.

    Tests only read what is in it.
    """
    folder = Path(os.environ[SHARED]) / name
    done = folder.with_name(f"{name}.done")
    with FileLock(f"{folder}.lock"):
        if not done.exists():
            shutil.rmtree(folder, ignore_errors=True)  # of an attempt that failed: this one says why again
            folder.mkdir()
            make(folder)
            done.touch()
    return folder


def made_once(make: Callable[[], Made]) -> Callable[[], Made]:
    """``make``, called once in a session; each process reads a copy of the result from disk, once."""

    @functools.cache
    def made() -> Made:
        def write(folder: Path) -> None:
            (folder / "result.pickle").write_bytes(pickle.dumps(make(), protocol=5))

        folder = folder_made_once(f"{make.__module__}.{make.__qualname__}", write)
        return pickle.loads((folder / "result.pickle").read_bytes())

    return made
