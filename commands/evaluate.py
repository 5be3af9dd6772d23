"""Compare: a robot with its published figures, or a policy in its models and on the machine.

    sealegs evaluate paper=hopper                 hopping with and without actuator, beside the paper's figures
    sealegs evaluate paper=hexapod                also biped, leg, arm: what their papers print, repeated
    sealegs evaluate relevant robot=leg           what a robot's motor torque goes into, and what can be left out
    sealegs evaluate paper=hopper out=comparison  the same, into that folder

    sealegs evaluate policy=runs/first/final robot=hopper extended=diagnosis hw=virtual
                                                    one policy in the nominal model, the extended one and on the machine

paper= writes the numbers (JSON), the motor positions over time (PNG), and positions and speeds over the hopping period
(PNG). policy= writes a table, comparison.json, comparison.html (one page to send) and the machine's log.
"""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

from ..common.atomic import fresh

PLAIN = ("paper", "out", "policy", "task", "nominal", "extended", "port", "calibration", "hw.virtual.hidden")

PAPERS = ("arm", "biped", "hexapod", "hopper", "leg")
"""Robots with published figures: folders of ``papers/`` whose module ``report`` has ``compare(folder, seconds)``."""


def main(arguments: list[str]) -> None:
    """Make the comparison that the command line names."""
    from ..common.errors import SealegsError, nearest
    from ..configs.check import checked
    from ..configs.compose import compose, split
    from ..hw.machine.own_robot import READERS
    from . import relevant

    if arguments and arguments[0] == relevant.WORD:
        relevant.main(arguments[1:])
        return
    config = compose("evaluate", split(arguments, plain=PLAIN, first="policy"), readers=READERS)
    if config["policy"] is not None:
        compare_policy(config)
        return
    paper = config["paper"]
    if paper is None:
        raise SealegsError(f"say what to compare: paper={'|'.join(PAPERS)}, or policy=<file>; --help lists the keys.")
    if paper not in PAPERS:
        raise SealegsError(f"there is no paper '{paper}'{nearest(str(paper), PAPERS)}; there are {', '.join(PAPERS)}.")
    seconds = checked("seconds", config["seconds"], float)
    out = Path(str(config["out"] or fresh(Path("runs"), f"paper-{paper}")))
    try:
        report = importlib.import_module(f"sealegs.papers.{paper}.report")  # only now, so that --help does not wait
    except ModuleNotFoundError as missing:
        if missing.name != "sealegs.papers":
            raise
        raise SealegsError(
            "what repeats the papers comes with a checkout, not with an installed sealegs: clone the repository, run "
            f"make setup there, and .venv/bin/sealegs evaluate paper={paper}."
        ) from None
    report.compare(out, seconds)


def compare_policy(config: dict[str, Any]) -> None:
    """Compare a policy in its models and on the machine."""
    from ..evaluation.comparison import compare
    from ..evaluation.page import write_comparison
    from ..gap.output.files import fresh_folder

    out = fresh_folder(Path(str(config["out"] or fresh(Path("runs"), "comparison"))))
    write_comparison(compare(config, out), out)
