"""Compare: a robot with its published figures.

    python evaluate.py paper=hopper                 hopping with and without actuator, beside the paper's figures
    python evaluate.py paper=hopper out=comparison  the same, into that folder

Writes the numbers (JSON), the motor positions over time (PNG), and positions and speeds over the hopping period (PNG).
"""

from __future__ import annotations

import datetime
import importlib
import sys
from pathlib import Path

from configs.script import run

PAPERS = {"hopper": "envs.hopper.report"}
"""Modules with a function ``compare(folder, seconds)``, by the word that the command line takes."""


def main(arguments: list[str]) -> None:
    """Make the comparison that the command line names."""
    from actuators.errors import SealegsError, nearest
    from configs.check import checked
    from configs.compose import compose, split

    config = compose("evaluate", split(arguments, plain=("paper", "out")))
    paper = config["paper"]
    if paper is None:
        raise SealegsError(f"say what to compare: paper={'|'.join(PAPERS)}; --help lists the keys.")
    if paper not in PAPERS:
        raise SealegsError(f"there is no paper '{paper}'{nearest(str(paper), PAPERS)}; there are {', '.join(PAPERS)}.")
    seconds = checked("seconds", config["seconds"], float)
    now = datetime.datetime.now().strftime("%Y%m%d-%H%M%S")
    out = Path(str(config["out"] or f"runs/paper-{paper}-{now}"))
    importlib.import_module(PAPERS[paper]).compare(out, seconds)  # only now, so that --help does not wait


if __name__ == "__main__":
    sys.exit(run(main, "evaluate", __doc__ or "", sys.argv[1:]))
