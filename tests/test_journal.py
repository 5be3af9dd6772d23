"""Fits that are kept are read again for the same question only."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.actuators.errors import SealegsError
from sealegs.gap.log.parts import cut
from sealegs.gap.log.types import JointLog, MeasuredRun
from sealegs.gap.output import partial
from sealegs.gap.replay.free import FreeProblem, free_problem
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.replay.problem import Problem
from sealegs.gap.search.journal import keeping, recalled, recorded

from tests.smooth_bench import CHAIN, PARAMS

TIME = np.arange(400.0) * 0.005
ANSWER: dict[str, Any] = {"values": {"friction.coulomb*": 1.1}, "cost": 0.5, "at_bound": []}


def problem_with(bump: float = 0.0) -> FreeProblem:
    """A bench whose reading has a bump in the middle [rad]."""
    position = np.where(np.arange(400) == 200, bump, 0.0)
    log = JointLog(np.sin(2.0 * np.pi * TIME), position)
    run = MeasuredRun("run", TIME, {"servo": log}, {}, "bench", dict(PARAMS), {"servo": CHAIN})
    return free_problem([run], "servo", [JointModel(load_chain(CHAIN))], cut([run], "servo", None), {"position": 1e3})


def is_known(problem: Problem, folder: Path) -> bool:
    with keeping(folder / "fits.jsonl"):
        return recalled(problem, (), {}, 10) is not None


def test_a_fit_is_read_again_for_the_same_data_commands_weights_and_step_only(tmp_path: Path) -> None:
    """Two logs with equal ends, or with other goals, got each other's fits."""
    problem = problem_with()
    with keeping(tmp_path / "fits.jsonl"):
        recorded(problem, (), {}, 10, ANSWER)
    assert is_known(problem_with(), tmp_path)
    others = {
        "a sample in the middle": problem_with(0.01),
        "goal": replace(problem, goal=problem.goal + 0.1),
        "reliability": replace(problem, reliability=0.5 * problem.reliability),
        "step": problem.with_step_factor(2.0),
        "drive": replace(problem, on=~problem.on),
        "chain": replace(problem, models=(problem.models[0].with_values({"delay.seconds": 0.01}),)),
    }
    assert not [name for name, other in others.items() if is_known(other, tmp_path)]


def test_fits_of_other_code_are_not_gone_on_with(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """After an upgrade the fits of the version before were taken."""
    source = {"settings": {}, "files": {}}
    partial.Partial(tmp_path / "out", source)
    partial.Partial(tmp_path / "out", source)
    assert partial.unfinished(iter([tmp_path / "out"]), source) == tmp_path / "out"
    monkeypatch.setattr(partial, "code_digest", lambda: "another")
    assert partial.unfinished(iter([tmp_path / "out"]), source) is None
    with pytest.raises(SealegsError, match="another version of sealegs began"):
        partial.Partial(tmp_path / "out", source)
