"""Joints of a robot as one problem: errors in one unit, shared numbers, accelerations that smoothing flattened."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.gap.causes.cause import Cause
from sealegs.gap.load.robot import Machine
from sealegs.gap.load.terms import T_COLUMNS, T_OWN, T_SIZE
from sealegs.gap.load.tree import TreeLoad
from sealegs.gap.log.parts import Unit, cut
from sealegs.gap.log.types import JointLog, MeasuredRun
from sealegs.gap.prepare.pieces import cut_joint
from sealegs.gap.replay.comparison import robust_loss
from sealegs.gap.replay.flattened import flattened
from sealegs.gap.replay.free import FreeProblem, free_problem
from sealegs.gap.replay.joint_model import Axis, JointModel
from sealegs.gap.replay.parameters import address, factor
from sealegs.gap.robot.problem import RobotModel, RobotProblem
from sealegs.gap.search.several import JointByJoint, Several
from sealegs.gap.search.sketch import sketch
from sealegs.gap.search.structure import fine

from tests.logged_robots import two_link_run
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


TIMES = np.linspace(0.0, 1.0, 60)
TRUE = {"easy|slope": 2.0, "easy|offset": -1.0, "hard|rate": 3.0, "hard|size": 1.5, "mass": 1.3}


class TwoJoints:
    """One joint is linear in its numbers, one has a valley that turns; a shared number turns both."""

    def __init__(self) -> None:
        self.asked = {"easy": 0, "hard": 0}
        self.measured = {joint: self.model(joint, TRUE) for joint in self.asked}

    @staticmethod
    def model(joint: str, values: Mapping[str, float]) -> np.ndarray:
        mass = values.get("mass", 1.0)
        if joint == "easy":
            return 20.0 * (mass * values["easy|slope"] * TIMES + values["easy|offset"])
        return 20.0 * values["hard|size"] * np.exp(-(values["hard|rate"] ** 2) * TIMES) * np.cos(6.0 * mass * TIMES)

    def felt_by(self, path: str) -> tuple[str, ...]:
        joint, bar, _ = path.partition("|")
        return (joint,) if bar else ("easy", "hard")

    def residual_of(self, joint: str, variants: Sequence[Mapping[str, float]], every: int = 1) -> np.ndarray:
        self.asked[joint] += len(variants)
        return np.stack([self.model(joint, values) - self.measured[joint] for values in variants])[:, ::every]

    def each(self, change: Callable[[Any], Any]) -> Any:
        raise NotImplementedError


def fitted(paths: Sequence[str], start: Sequence[float], iterations: int = 40) -> tuple[JointByJoint, dict[str, float]]:
    problem = TwoJoints()
    assert isinstance(problem, Several)

    def values(point: np.ndarray) -> dict[str, float]:
        return {**{path: TRUE[path] for path in TRUE}, **dict(zip(paths, map(float, point), strict=True))}

    bounds = np.full(len(paths), 0.05), np.full(len(paths), 6.0)
    bounds[0][[path.endswith("offset") for path in paths]] = -3.0
    fit = JointByJoint(problem, paths, values, np.array(start, float), bounds, np.full(len(paths), 1e-3), 1)
    return fit, values(fit.run(iterations))


def test_own_and_shared_numbers_are_found_together() -> None:
    fit, found = fitted(list(TRUE), [0.5, 0.0, 2.0, 1.0, 1.0])
    assert fit.cost < 1e-3
    assert found == pytest.approx(TRUE, rel=1e-2)


def test_a_joint_that_is_hard_to_fit_does_not_hold_up_another() -> None:
    """With one damping for all, steps that the hard joint rejects were taken from the easy one too."""
    paths = ["easy|slope", "easy|offset", "hard|rate", "hard|size"]
    fit, found = fitted(paths, [0.21, 0.44, 4.74, 0.47], iterations=3)
    assert fit.costs["easy"] < 1e-6 < 100.0 < fit.costs["hard"]
    assert (found["easy|slope"], found["easy|offset"]) == pytest.approx((2.0, -1.0), abs=1e-3)


@pytest.mark.parametrize("seed", range(8))
def test_no_iteration_makes_it_worse(seed: int) -> None:
    start = np.random.default_rng(seed).uniform([0.1, -2.0, 0.1, 0.1, 0.2], [5, 2, 5, 5, 4])
    fit, _ = fitted(list(TRUE), list(start), 0)
    for _ in range(12):
        before = dict(fit.costs)
        fit.iterate()
        assert fit.cost <= sum(before.values()) + 1e-9
        here = {joint: fit.errors(joint, [fit.at])[0] for joint in fit.joints}
        assert {j: float(robust_loss(e).sum()) for j, e in here.items()} == pytest.approx(fit.costs)
        assert (fit.at >= fit.low).all() and (fit.at <= fit.high).all()


LONG_TIME = np.arange(0.0, 12.0, 0.005)


def chain(stiffness: float) -> list[dict[str, dict[str, float]]]:
    return [
        {"position_p": {"gain": 12.0}},
        {"supply": {"volts": 7.4, "resistance": 0.0}},
        {"dc_motor": {"motor_constant": 0.664, "resistance": 2.723, "armature": 0.01}},
        {"friction": {"coulomb": 0.03, "viscous": 0.02}},
        {"spring": {"stiffness": stiffness, "damping": 0.03}},
    ]


@pytest.mark.parametrize("stiffness", [3.0, 20.0])
def test_what_lies_behind_a_spring_is_sharpened_as_the_link_moved(stiffness: float) -> None:
    """The motor's flattened steps were put back on the link's motion, which left its error as it was."""
    goal = np.repeat(np.random.default_rng(0).uniform(-0.8, 0.8, 20), 120)
    model, unit = JointModel(load_chain(chain(stiffness))), Unit(0, 0, 0, len(LONG_TIME), 1, (goal[0], 0.0))

    def run(motor: np.ndarray, link: np.ndarray) -> MeasuredRun:
        params = {"mass": 0.3, "length": 0.12, "arm_mass": 0.03}
        log = JointLog(goal, motor, link_position=link)
        return MeasuredRun("a", LONG_TIME, {"s": log}, robot_params=params, actuators={"s": chain(stiffness)})

    still = np.zeros_like(LONG_TIME)
    moved = free_problem([run(still, still)], "s", [model], [unit], {"position": 1e4}).simulate([{}])[0]
    logged = run(moved[:, 0], moved[:, 1])
    problem = free_problem([logged], "s", [model], [unit], {"position": 1e4})
    put_back = flattened([logged], {"s": problem}, {})[0]["s"]
    link = np.gradient(np.gradient(moved[:, 1], LONG_TIME), LONG_TIME)
    motor = np.gradient(np.gradient(moved[:, 0], LONG_TIME), LONG_TIME)
    inner = slice(20, -20)
    alike = [float(np.corrcoef(put_back[inner, 2], each[inner])[0, 1]) for each in (link, motor)]
    assert alike[0] > alike[1]


def test_a_log_that_was_edited_is_not_taken_for_the_one_before(tmp_path: Path) -> None:
    """How the robot moved was kept by the objects that hold a log, whose columns anybody may replace."""
    run = two_link_run(tmp_path, 3.0)
    before = cut_joint(Machine.of([run]), "shoulder", None).terms
    elbow = run.joints["elbow"]
    assert isinstance(run.joints, dict)
    run.joints["elbow"] = replace(elbow, position=elbow.position + 0.3)
    after = cut_joint(Machine.of([run]), "shoulder", None).terms
    assert before is not None and after is not None and np.abs(before[0] - after[0]).max() > 1e-3
