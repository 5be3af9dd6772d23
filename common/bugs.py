"""What nobody foresaw: kept apart from what was found, and reported in a file with its place in the code.

Wrong input ends in a sentence (:class:`~sealegs.common.errors.SealegsError`). Any other exception is a bug of sealegs
and no verdict: what else is under way goes on, and the outermost place tells of it by :func:`reported`.
"""

from __future__ import annotations

import contextlib
import platform
import re
import shlex
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

from .errors import SealegsError

BUG = 70  # exit status: EX_SOFTWARE of BSD's sysexits
CODE = Path(__file__).resolve().parents[1]
"""The folder that holds the code, of a checkout or of an installed package."""


class Unforeseen(Exception):
    """Some of the work failed in ways that nobody foresaw, and the rest of it was done.

    Attributes:
        errors: by what failed.
        found: what the rest gave.
        where: folder in which that is; None: it is in no folder.
    """

    def __init__(self, errors: Mapping[str, Exception], found: object = None) -> None:
        super().__init__("; ".join(f"{subject}: {told(error)}" for subject, error in errors.items()))
        self.errors, self.found = dict(errors), found
        self.where: Path | None = None


@contextlib.contextmanager
def apart(subject: str, errors: dict[str, Exception]) -> Iterator[None]:
    """Let what is behind the block go on: what nobody foresaw in it is put into ``errors`` under ``subject``."""
    try:
        yield
    except SealegsError:  # which a person can mend
        raise
    except Exception as error:
        errors[subject] = error


def place_of(error: BaseException) -> str:
    """Where in the code of sealegs an exception was raised, also in another process: file and line."""
    remote = getattr(error.__cause__, "tb", None)  # as concurrent.futures brings it
    text = remote if isinstance(remote, str) else "".join(traceback.format_tb(error.__traceback__))
    places = [(Path(file), line) for file, line in re.findall(r'File "(.+?)", line (\d+)', text)]
    own = [at for at in places if at[0].is_relative_to(CODE) and "site-packages" not in at[0].relative_to(CODE).parts]
    if not (own or places):
        return "an unknown place"
    file, line = (own or places)[-1]
    return f"{file.relative_to(CODE) if own else file} line {line}"


def told(error: BaseException) -> str:
    """Kind, text and place of an exception, on one line."""
    if isinstance(error, Unforeseen):
        return str(error)
    text = " ".join(str(error).split())
    return f"{type(error).__name__}{f' ({text})' if text else ''} in {place_of(error)}"


def reported(error: Exception, arguments: Sequence[str]) -> str:
    """Write a file about a bug, and say in a sentence what failed, where the file is, and what was kept.

    Args:
        error: that reached the outermost place.
        arguments: of the command.
    """
    errors = error.errors if isinstance(error, Unforeseen) else {"sealegs": error}
    kept = error.where if isinstance(error, Unforeseen) else None
    lines = [
        f"sealegs {version('sealegs')}, Python {platform.python_version()}, {platform.platform()}",
        f"command: {shlex.join(arguments)}",
        *(f"{subject}: {told(one)}" for subject, one in errors.items()),
        "",
        *("".join(traceback.format_exception(one)) for one in errors.values()),
    ]
    file = _written("\n".join(lines) + "\n")
    notes = dict.fromkeys(note for one in (error, *errors.values()) for note in getattr(one, "__notes__", ()))
    what = str(error) if isinstance(error, Unforeseen) else told(error)
    stays = f" All else was done and is in {kept}." if kept is not None else " What was written before stays."
    return "\n".join(
        [
            *notes,
            f"A bug of sealegs ended this: {what}.{stays} {file} has the details: please report it with that file.",
        ]
    )


def _written(text: str) -> Path:
    """A new file with a text, in the current folder or where temporary files are."""
    for folder in (Path(), Path(tempfile.gettempdir())):
        for number in range(1, 100):
            file = folder / f"sealegs-bug-{time.strftime('%Y%m%d-%H%M%S')}{f'-{number}' if number > 1 else ''}.txt"
            try:
                with file.open("x", encoding="utf-8") as stream:
                    stream.write(text)
            except FileExistsError:
                continue
            except OSError:
                break
            return file
    sys.stderr.write(text)  # no disk takes it
    return Path("what is printed above")
