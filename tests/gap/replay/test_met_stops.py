"""A stop is named where something pushes the joint on to it, not where friction holds it at the end of a motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.gap.log.parts import cut
from sealegs.gap.replay.free import FreeProblem, free_problem
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.replay.parameters import Parameter
from sealegs.gap.replay.problem import JointProblem
from sealegs.gap.search.met import unmet

from testbed import hidden_bench

UPPER = (Parameter("load.stop_angle", "rad", -1.0, 3.0, 0.5, 0.03),)
LOWER = (Parameter("load.lower_stop", "rad", -3.0, 1.0, -0.5, 0.03),)
STOP = 0.15
SECONDS, RATE = 40.0, 50.0
TIME = np.arange(0.0, SECONDS, 1.0 / RATE)
NOISE = 1e-3


@dataclass
class Scripted:
    """A log, and what a model makes of it with a stop and without it."""

    goal: np.ndarray
    measured: np.ndarray
    onward: np.ndarray
    on: np.ndarray
    side: float = 1.0
    runs: int = 1
    softness: float = 0.0

    def problem(self) -> JointProblem:
        def simulate(variants: Sequence[Mapping[str, float]]) -> np.ndarray:
            beyond = np.maximum(self.side * self.onward - STOP, 0.0)
            stopped = self.onward - self.side * (1.0 - self.softness) * beyond
            rows = [stopped if len(values) else self.onward for values in variants]
            return np.stack(rows)[:, :, None]

        read = {"encoder.scale": 1.0, "encoder.offset": 0.0, "host.scale": 1.0, "host.offset": 0.0}
        model = SimpleNamespace(by_torque=False, axis=SimpleNamespace(reach=1.0), value=read.__getitem__)
        fields: dict[str, Any] = {
            "models": (model,), "simulate": simulate, "time": TIME,
            "starts": np.linspace(0, len(TIME), self.runs + 1).astype(int),
            "judged": np.ones(len(TIME), bool), "noise": NOISE, "goal": self.goal, "on": self.on,
            "measured": self.measured[:, None], "channels": ("position",),
            "units": tuple(SimpleNamespace(run=k) for k in range(self.runs)),
        }  # fmt: skip
        return cast(JointProblem, SimpleNamespace(**fields))


def swing(top: float) -> np.ndarray:
    """Goals that go slowly up and down, faster towards the end, up to an angle [rad]."""
    return top * np.sin(2.0 * np.pi * (0.1 * TIME + 0.005 * TIME**2))


def rubbing(goal: np.ndarray, half: float) -> np.ndarray:
    """A joint that dry friction holds until its goal is so far away (n,) [rad]."""
    at = np.zeros_like(goal)
    for k in range(1, len(goal)):
        at[k] = min(max(at[k - 1], goal[k] - half), goal[k] + half)
    return at


def test_goals_that_go_beyond_a_stop_meet_it() -> None:
    goal = swing(0.3)
    log = Scripted(goal, np.minimum(goal, STOP), goal, np.ones(len(goal), bool))
    assert not unmet(log.problem(), UPPER, {"load.stop_angle": STOP})
    mirrored = Scripted(-goal, -np.minimum(goal, STOP), -goal, log.on, side=-1.0)
    assert not unmet(mirrored.problem(), LOWER, {"load.lower_stop": -STOP})


def test_a_soft_stop_is_met_where_the_joint_rests_against_it_and_not_only_where_it_ran_into_it() -> None:
    """A gripper's jaw ran 30 mrad into one of 200 N.m/rad: visits to all but the last 7 mrad of it were none, and a
    stop that took the loss from 141,000 to 2,900 was no candidate.
    """
    goal = swing(0.3)
    onward = np.where(np.abs(TIME - 20.0) < 0.05, 0.9, goal)
    log = Scripted(goal, np.minimum(goal, STOP), onward, np.ones(len(goal), bool), softness=0.04)
    problem = log.problem()
    assert not unmet(problem, UPPER, {"load.stop_angle": STOP})


def test_a_stop_that_only_cuts_off_what_friction_holds_is_not_met() -> None:
    """Goals of a public arm's chirp ended at 0.150 rad; friction held the joint at 0.153 while they went back."""
    goal = swing(0.15)
    measured = rubbing(goal, 0.03) + 0.033  # it sags, so that it comes a little past its goals
    log = Scripted(goal, measured, measured + 0.02 * (measured > 0.13), np.ones(len(goal), bool))
    assert unmet(log.problem(), UPPER, {"load.stop_angle": STOP})


@pytest.mark.parametrize("half", [0.02, 0.03, 0.05])
def test_friction_that_a_drive_cannot_overcome_is_no_stop_though_goals_go_further(half: float) -> None:
    goal = swing(STOP + half)
    measured = rubbing(goal, half)
    log = Scripted(goal, measured, measured + 0.02 * (measured > STOP - 0.02), np.ones(len(goal), bool))
    assert unmet(log.problem(), UPPER, {"load.stop_angle": STOP})


def test_a_soft_drive_that_stays_behind_its_goals_everywhere_meets_no_stop() -> None:
    goal = swing(0.17)
    measured = goal - 0.02 * np.sign(goal)
    log = Scripted(goal, measured, measured + 0.015, np.ones(len(goal), bool))
    assert unmet(log.problem(), UPPER, {"load.stop_angle": STOP})


def test_a_jab_beyond_a_stop_meets_it_though_friction_holds_the_joint_there_for_long() -> None:
    phase = TIME % 6.0
    goal = np.select([phase < 0.14, phase < 2.5, phase < 4.0], [0.30, 0.13, -0.2], 0.13)
    free = rubbing(goal, 0.03)
    stopped = np.zeros_like(free)
    for k in range(1, len(goal)):
        stopped[k] = min(max(stopped[k - 1], goal[k] - 0.03), goal[k] + 0.03, STOP)
    log = Scripted(goal, stopped, free, np.ones(len(goal), bool))
    assert not unmet(log.problem(), UPPER, {"load.stop_angle": STOP})


def test_a_load_that_meets_a_stop_with_a_soft_gain_alone_is_asked_run_by_run() -> None:
    goal = np.tile(swing(0.12)[: len(TIME) // 2], 2)
    onward = goal + np.where(np.arange(len(TIME)) < len(TIME) // 2, 0.08, 0.02)
    log = Scripted(goal, np.minimum(onward, STOP), onward, np.ones(len(goal), bool), runs=2)
    assert not unmet(log.problem(), UPPER, {"load.stop_angle": STOP})


def test_a_load_that_the_drive_works_against_may_meet_a_stop_short_of_its_goals() -> None:
    goal = swing(0.12)
    sagging = goal + 0.08  # a spring-like drive under a load
    log = Scripted(goal, np.minimum(sagging, STOP), sagging, np.ones(len(goal), bool))
    assert not unmet(log.problem(), UPPER, {"load.stop_angle": STOP})


def test_a_joint_whose_drive_is_off_falls_on_to_a_stop() -> None:
    off = np.full(len(TIME), False)
    falling = np.minimum(0.02 * TIME, 0.3)
    log = Scripted(np.zeros(len(TIME)), np.minimum(falling, STOP), falling, off)
    assert not unmet(log.problem(), UPPER, {"load.stop_angle": STOP})


def test_a_stop_that_nothing_comes_to_is_no_matter() -> None:
    goal = swing(0.1)
    log = Scripted(goal, goal, goal, np.ones(len(goal), bool))
    assert not unmet(log.problem(), UPPER, {"load.stop_angle": STOP})


def bench(effects: Mapping[str, float | str]) -> FreeProblem:
    lifts = (("triangle", "steps"), ("lift_and_drop", "multisine"))
    data, _ = hidden_bench(dict(effects), 3, runs=2, duration=8.0, schedules=lifts)
    models = [JointModel(load_chain(run.actuators["servo"])) for run in data.runs]
    return free_problem(data.runs, "servo", models, cut(data.runs, "servo"), {"position": 1.0 / 6e-4})


@pytest.mark.parametrize("stop", [0.5, 0.75, 0.9])
def test_a_stop_of_another_plant_is_met(stop: float) -> None:
    assert not unmet(bench({"contact.blocked": stop}), UPPER, {"load.stop_angle": stop})
