"""A command as somebody types it, run within the test's own process: the start of an interpreter takes seconds."""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass

from sealegs.commands import cli
from sealegs.commands import diagnose as script
from sealegs.configs.script import run


def diagnose_command(*arguments: str) -> int:
    """Exit status of the command."""
    return run(script.main, "diagnose", script.__doc__ or "", list(arguments))


@dataclass(frozen=True)
class Done:
    """How a command ended, and what it printed."""

    returncode: int
    stdout: str
    stderr: str


def typed(*words: str) -> Done:
    """Run ``sealegs <words>`` here; what it prints is returned."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = cli.main(words)
    return Done(code, out.getvalue(), err.getvalue())
