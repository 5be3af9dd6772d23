"""Joints of a robot as one problem: errors of hinges and slides are told in one unit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.gap.causes.cause import Cause
from sealegs.gap.load.terms import T_COLUMNS, T_OWN, T_SIZE
from sealegs.gap.load.tree_load import TreeLoad
from sealegs.gap.log.parts import cut
from sealegs.gap.log.types import JointLog, MeasuredRun
from sealegs.gap.replay.free import FreeProblem, free_problem
from sealegs.gap.replay.joint_model import Axis, JointModel
from sealegs.gap.replay.parameters import address, factor
from sealegs.gap.robot.problem import RobotModel, RobotProblem
from sealegs.gap.search.sketch import sketch
from sealegs.gap.search.structure import fine

from tests.smooth_bench import CHAIN, PARAMS

TIME = np.arange(400.0) * 0.005


def joint(noise: float, *, slide: bool = False) -> FreeProblem:
    """A joint at rest whose reading has that noise [rad] or [m]."""
    log = JointLog(np.sin(2.0 * np.pi * TIME), np.zeros(400))
    run = MeasuredRun("run", TIME, {"servo": log}, {}, "bench", dict(PARAMS), {"servo": CHAIN})
    model = JointModel(load_chain(CHAIN), axis=Axis(slide=slide, low=-1.0, high=1.0))
    return free_problem([run], "servo", [model], cut([run], "servo", None), {"position": 1.0 / noise})


def robot(**joints: FreeProblem) -> RobotProblem:
    return RobotProblem.of(joints, {}, (RobotModel(joints, {}, {}),))


def off_by(problem: RobotProblem, **errors: float) -> np.ndarray:
    """Channels (n, 4) whose positions are off by so much, joint by joint."""
    simulated = problem.measured.copy()
    sizes = [np.full(len(each.time), errors[name]) for name, each in problem.joints.items()]
    simulated[:, 0] += np.concatenate(sizes)
    return simulated


def test_errors_of_hinges_and_slides_are_told_in_parts_of_their_own_noise() -> None:
    """Metres and radians were mixed under the unit of the first joint, beside the mean of one over their noise."""
    whole = robot(elbow=joint(1e-3), lift=joint(1e-4, slide=True))
    errors = whole.position_error(off_by(whole, elbow=1e-3, lift=5e-4))
    assert whole.signal == ("position", "noise floors") and whole.noise == pytest.approx(1.0)
    assert sorted(set(np.round(errors, 6))) == [1.0, 5.0]
    assert whole.weight[0] == pytest.approx(1.0)
    assert fine(5.04, whole.signal[1]) == "5.0 noise floors"


def test_errors_of_joints_of_one_kind_keep_their_unit_and_their_noise_is_its_root_mean_square() -> None:
    whole = robot(shoulder=joint(1e-3), elbow=joint(3e-3))
    assert whole.signal == ("position", "rad")
    assert whole.noise == pytest.approx(np.sqrt(5.0) * 1e-3)
    assert whole.position_error(off_by(whole, shoulder=2e-3, elbow=4e-3)).max() == pytest.approx(4e-3)
    same = robot(shoulder=joint(1e-3), elbow=joint(1e-3))
    assert same.noise == pytest.approx(1e-3)


def test_a_path_says_whose_number_it_is_whatever_the_joint_is_called() -> None:
    """Names were taken apart in three places, and a joint called ``a`` took the numbers of ``a|b``."""
    dry = factor("friction.coulomb", 0.5, 2.0).of_joint("left (upper)")
    at = address(dry.path)
    assert (at.joint, at.owner, at.key, at.factor) == ("left (upper)", "friction", "coulomb", True)
    assert dry.joint == "left (upper)" and at.own == "friction.coulomb*" and at.number == dry.number
    assert address("friction.coulomb*").joint == ""
    whole = robot(**{"left (upper)": joint(1e-3), "left": joint(1e-3)})
    assert dry.physical(2.0, whole.models[0]) == pytest.approx(2.0 * whole.joints["left"].models[0].value(at.own[:-1]))


def test_causes_of_one_name_are_told_apart_by_the_body_that_they_are_of() -> None:
    one, other = (Cause("", "", (), name="load.centre_of_mass", about=body) for body in ("upper", "fore"))
    assert one.name == other.name and one.key != other.key
    assert Cause("", "", (), name="load.mass").key == "load.mass"


def test_a_robot_is_searched_in_all_of_its_data() -> None:
    """A sketch of it was to replace its units, which are those of its joints: a long log ended in a traceback."""
    whole = robot(shoulder=joint(1e-3), elbow=joint(1e-3))
    assert sketch(whole, 0.1) is whole


def test_a_joint_is_replayed_once_however_much_else_is_turned(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each fit of what a robot shares began with the same replays of every joint."""
    bench = joint(1e-3)
    row = np.zeros((len(bench.time), T_COLUMNS))
    row[:, T_OWN] = 0.01  # [kg.m2]
    models = tuple(replace(model, load=TreeLoad()) for model in bench.models)
    joints = {name: replace(bench, terms=row, models=models) for name in ("shoulder", "elbow")}
    number = "body.arm.mass_factor"
    more = {number: {"elbow": np.full((len(row), T_SIZE), 0.02)}}
    whole = RobotProblem.of(joints, more, (RobotModel(joints, {number: 1.0}, {number: "1"}),))
    variants: list[dict[str, float]] = [{number: 1.0}, {number: 1.0, "elbow|friction.coulomb*": 3.0}, {number: 1.5}]
    expected = [replace(whole).simulate([one])[0] for one in variants]  # each with no memory of another
    asked: list[int] = []
    simulate = FreeProblem.simulate

    def counted(self: FreeProblem, variants: Sequence[Mapping[str, float]], step: float | None = None) -> np.ndarray:
        asked.append(len(variants))
        return simulate(self, variants, step)

    monkeypatch.setattr(FreeProblem, "simulate", counted)
    for _ in range(2):
        assert whole.simulate(variants) == pytest.approx(np.array(expected), nan_ok=True)
    assert sum(asked) == 1 + 3, "the shoulder once, the elbow for each"
    assert not np.allclose(expected[0], expected[1]) and not np.allclose(expected[0], expected[2])
