"""What all scripts share: the help page, one sentence for what a person can put right, the exit status."""

from __future__ import annotations

import errno
import importlib
import os
import re
import sys
import textwrap
from collections.abc import Callable, Sequence
from types import ModuleType

from ..common import plugins
from ..common.bugs import BUG, reported
from ..common.errors import SealegsError
from ..common.extras import missing_package
from .compose import FOLDER, choices, groups

OTHER_ROBOTS = "         or quadruped, rover, small_biped, which files describe, or the .yaml, .xml or .urdf of yours"
BAD_INPUT = 2
INTERRUPTED = 130


class Interrupted(Exception):
    """The person asked for a stop; the message says what was saved and how to go on."""


def run(main: Callable[[list[str]], None], name: str, description: str, arguments: Sequence[str]) -> int:
    """Run a script and return its exit status: 0, 2 for wrong input or a full disk, 130 for Ctrl-C, 70 for a bug.

    This is the outermost place: what nobody foresaw is reported here, and nowhere else.

    Args:
        main: takes the arguments, raises :class:`SealegsError` for what a person can put right.
        name: of the script and of its config file, without suffix.
        description: the script's docstring, the head of its help page.
        arguments: command line without the script's name.
    """
    try:
        return _run(main, name, description, arguments)
    except Exception as error:
        print(reported(error, ["sealegs", name.replace("_", "-"), *arguments]), file=sys.stderr)
        return BUG


def _run(main: Callable[[list[str]], None], name: str, description: str, arguments: Sequence[str]) -> int:
    try:
        if any(argument in ("-h", "--help") for argument in arguments):
            print(help_page(name, description))
        else:
            plugins.add(*plugins.named_by(arguments))
            main(list(arguments))
        sys.stdout.flush()
        return 0
    except BrokenPipeError:  # whoever read the output, such as `head`, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Interrupted as stop:
        print(stop, file=sys.stderr)
        return INTERRUPTED
    except SealegsError as error:
        print(shown(str(error)), file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print("Stopped; what was written so far stays.", file=sys.stderr)
        return INTERRUPTED
    except ModuleNotFoundError as error:
        return _missing(error, name)
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EACCES, errno.EROFS):
            raise
        where = f" {error.filename}" if error.filename else ""
        print(f"Cannot write{where}: {error.strerror}; what was written before stays.", file=sys.stderr)
        return BAD_INPUT


def shown(text: str) -> str:
    """A text for the terminal: what a file holds may be in it, and must not move the cursor or hide what was said."""
    return re.sub(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]", lambda found: repr(found[0])[1:-1], text)


def _missing(error: ModuleNotFoundError, name: str) -> int:
    """Tell which extra a script lacks."""
    sentence = missing_package(error, f"sealegs {name.replace('_', '-')}")
    if sentence is None:
        raise error
    print(sentence, file=sys.stderr)
    return BAD_INPUT


def load(module: str, name: str) -> ModuleType | int:
    """The module of a script, or the exit status where it lacks a package of an extra, which is told."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        return _missing(error, name)


def _wrapped(key: str, words: Sequence[str]) -> list[str]:
    """``key=`` and its words, as many a line as fit, the further lines indented under the first word."""
    start = f"  {key}="
    return textwrap.wrap(
        ", ".join(words), 100, initial_indent=start, subsequent_indent=" " * len(start), break_on_hyphens=False
    )


def help_page(name: str, description: str) -> str:
    """Help page: the script's docstring, the names that stand for files, and its config file with its comments."""
    text = (FOLDER / f"{name}.yaml").read_text()
    page = [description.strip(), ""]
    named = {key: choices(key) for key in [*groups(name), *re.findall(r"^(\w+):", text, re.MULTILINE)]}
    if any(named.values()):
        page += [
            "One of these words for a file in configs/<key>, whose own keys are given as <key>.<its key>=value:",
            "",
        ]
        for key, words in named.items():
            page += _wrapped(key, words) if words else []
            page += [OTHER_ROBOTS] * (key == "robot")
        page += [""]
    page += [f"Keys and their defaults (configs/{name}.yaml), given as key=value:", ""]
    keys = re.sub(r"^defaults:\n(?:  .*\n)*\n?", "", text, flags=re.MULTILINE).strip()
    page += [*(f"  {line}".rstrip() for line in keys.splitlines()), ""]
    page += ["plugins=<file.py> runs files of your own that add stages, causes, robots, tasks or servos."]
    return "\n".join(page)
