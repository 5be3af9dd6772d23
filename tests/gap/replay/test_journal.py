"""Fits that are kept are read again for the same question only."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.common.errors import SealegsError
from sealegs.gap.log.parts import cut
from sealegs.gap.log.types import JointLog, LogError, MeasuredRun
from sealegs.gap.output import partial
from sealegs.gap.replay.free import FreeProblem, free_problem
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.replay.parameters import Parameter
from sealegs.gap.replay.problem import Problem
from sealegs.gap.search.fit import fit
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


@pytest.mark.parametrize("kept", [True, False])
def test_a_fit_that_is_asked_for_twice_is_made_once(tmp_path: Path, kept: bool) -> None:
    """Two ways of a search that begin alike made a quarter of their fits twice."""
    problem, parameters = problem_with(), (Parameter("friction.coulomb", "N.m", 0.0, 1.0, 0.05, 0.1),)
    with keeping(tmp_path / "fits.jsonl" if kept else None) as journal:
        first, again = fit(problem, parameters), fit(problem, parameters)
        fit(problem, parameters, {"friction.coulomb": 0.06})
        assert (journal.made, journal.reused) == (2, 1)
    assert first.values == again.values and first.cost == again.cost
    np.testing.assert_array_equal(first.simulated, again.simulated)


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


HOLDS = """
import sys, time
from pathlib import Path
from sealegs.gap.output.partial import Partial, alone

out = Path(sys.argv[1])
with alone(out):
    Partial(out, {})
    print("held", flush=True)
    time.sleep(60.0)
"""


@pytest.mark.long
def test_a_second_process_on_one_folder_is_refused_and_a_killed_one_holds_nothing(tmp_path: Path) -> None:
    """The second went on with the first one's fits, whose folder then went away under it: a traceback."""
    out = tmp_path / "out"
    other = subprocess.Popen([sys.executable, "-c", HOLDS, str(out)], stdout=subprocess.PIPE, text=True)
    assert other.stdout is not None and other.stdout.readline() == "held\n"
    kept = (out / partial.FOLDER / partial.TOLD).read_text()
    said = "Another process is diagnosing into .*out: wait until it is done, or give another out=<folder>"
    with pytest.raises(LogError, match=said), partial.going_on(out, dict, lambda text: None):
        raise AssertionError("it was not refused")
    assert (out / partial.FOLDER / partial.TOLD).read_text() == kept
    other.kill()
    other.wait()
    with partial.alone(out), partial.going_on(out, dict, lambda text: None):
        assert (out / partial.FOLDER / partial.LOCK).exists()
    assert not (out / partial.FOLDER / partial.LOCK).exists() and (out / partial.FOLDER / partial.TOLD).exists()


def test_what_was_only_locked_leaves_nothing(tmp_path: Path) -> None:
    for inner in (partial.FOLDER, ""):
        with partial.alone(tmp_path / "out", inner):
            assert (tmp_path / "out" / inner / partial.LOCK).exists()
        assert not (tmp_path / "out").exists()
    (tmp_path / "file").touch()
    with partial.alone(tmp_path / "file"):
        pass
    assert list(tmp_path.iterdir()) == [tmp_path / "file"]
