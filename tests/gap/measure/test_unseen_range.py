"""A diagnosis says where the part kept for the test goes further than what was fitted."""

from __future__ import annotations

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.gap.log.parts import TEST, cut
from sealegs.gap.measure.unseen import unseen_range
from sealegs.gap.replay.free import FreeProblem, free_problem
from sealegs.gap.replay.joint_model import JointModel

from benchmarks.hidden import LOADS
from testbed import hidden_bench

STOP = 0.985  # [rad] either side; with this seed the lower one is met in the test part alone
SEED = 30050


def recorded(effects: dict[str, float]) -> FreeProblem:
    data, _ = hidden_bench(dict(effects), SEED, LOADS, nominal_error=0.0)
    models = [JointModel(load_chain(run.actuators["servo"])) for run in data.runs]
    return free_problem(data.runs, "servo", models, cut(data.runs, "servo"), {"position": 1.0 / 6e-4})


def test_a_stop_that_only_the_test_part_meets_is_pointed_out() -> None:
    problem = recorded({"contact.blocked": STOP})
    upper = problem.simulate([{"load.stop_angle": STOP}])[0]
    found = unseen_range(problem, upper, "servo")
    assert found is not None and found.severity == "note" and not found.data_error
    assert found.value == pytest.approx(-STOP, abs=0.05)
    assert "record that motion" in found.sentence


def reaching(problem: FreeProblem, simulated: np.ndarray, *, test: bool) -> None:
    """Let one piece go to 1.5 rad for a moment, measured and simulated."""
    piece = next(k for k, unit in enumerate(problem.units) if (unit.part == TEST) is test)
    middle = (problem.starts[piece] + problem.starts[piece + 1]) // 2
    problem.measured[middle : middle + 2, 0] = simulated[middle : middle + 2, 0] = 1.5


def test_nothing_is_said_where_the_model_is_right_there_as_well() -> None:
    problem = recorded({})
    simulated = problem.simulate([{}])[0]
    reaching(problem, simulated, test=True)
    assert unseen_range(problem, simulated, "servo") is None
    # nor where it is as wrong within the range as beyond it
    assert unseen_range(problem, simulated + 0.05, "servo") is None


def test_nothing_is_said_where_all_parts_reach_as_far() -> None:
    problem = recorded({})
    simulated = problem.simulate([{}])[0]
    reaching(problem, simulated, test=True)
    piece = int(np.searchsorted(problem.starts, np.argmax(simulated[:, 0]), side="right")) - 1
    simulated[problem.starts[piece] : problem.starts[piece + 1], 0] += 0.05
    assert unseen_range(problem, simulated, "servo") is not None
    reaching(problem, simulated, test=False)
    assert unseen_range(problem, simulated, "servo") is None
