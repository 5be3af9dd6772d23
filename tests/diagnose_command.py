"""The command `sealegs diagnose` in this process."""

from __future__ import annotations

from sealegs.commands import diagnose as script
from sealegs.configs.script import run


def diagnose_command(*arguments: str) -> int:
    """Exit status of the command."""
    return run(script.main, "diagnose", script.__doc__ or "", list(arguments))
