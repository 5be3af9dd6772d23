"""A stop is named where something pushes the joint on to it, not where friction holds it at the end of a motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
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
    on: np.ndarray = field(default_factory=lambda: np.ones(len(TIME), bool))
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
        model = SimpleNamespace(command="goal", axis=SimpleNamespace(reach=1.0), value=read.__getitem__)
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


def jabbed() -> Scripted:
    """Short goals beyond the stop between long ones at which friction holds the joint."""
    phase = TIME % 6.0
    goal = np.select([phase < 0.14, phase < 2.5, phase < 4.0], [0.30, 0.13, -0.2], 0.13)
    stopped = np.zeros_like(goal)
    for k in range(1, len(goal)):
        stopped[k] = min(max(stopped[k - 1], goal[k] - 0.03), goal[k] + 0.03, STOP)
    return Scripted(goal, stopped, rubbing(goal, 0.03))


def held(top: float, measured: Callable[[np.ndarray], np.ndarray], above: float, onward: float) -> Scripted:
    """A joint that the stop would stop only where it stands above an angle [rad], and only by so much [rad]."""
    goal = swing(top)
    at = measured(goal)
    return Scripted(goal, at, at + onward * (at > above))


def loaded(onward: np.ndarray, goal: np.ndarray | None = None, runs: int = 1) -> Scripted:
    """A joint that would go further than its goals."""
    return Scripted(swing(0.12) if goal is None else goal, np.minimum(onward, STOP), onward, runs=runs)


HALF = len(TIME) // 2
TWICE = np.tile(swing(0.12)[:HALF], 2)
BEYOND, FALLING = swing(0.3), np.minimum(0.02 * TIME, 0.3)
MET = {
    "goals that go beyond it": loaded(BEYOND, BEYOND),
    "the same on the other side": Scripted(-BEYOND, -np.minimum(BEYOND, STOP), -BEYOND, side=-1.0),
    # A gripper's jaw ran 30 mrad into one of 200 N.m/rad: visits to all but the last 7 mrad of it were none, and a stop
    # that took the loss from 141,000 to 2,900 was no candidate.
    "a soft stop, where the joint rests against it and not only where it ran into it": Scripted(
        BEYOND, np.minimum(BEYOND, STOP), np.where(np.abs(TIME - 20.0) < 0.05, 0.9, BEYOND), softness=0.04
    ),
    "a jab beyond it, though friction holds the joint there for long": jabbed(),
    "a load that meets it with a soft gain alone, asked run by run": loaded(
        TWICE + np.where(np.arange(len(TIME)) < HALF, 0.08, 0.02), TWICE, runs=2
    ),
    "a load that the drive works against, short of its goals": loaded(swing(0.12) + 0.08),
    "a joint that falls on to it with its drive off": replace(
        loaded(FALLING, np.zeros(len(TIME))), on=np.full(len(TIME), False)
    ),
    "nothing comes to it": loaded(swing(0.1), swing(0.1)),
}
NOT_MET = {
    # Goals of a public arm's chirp ended at 0.150 rad; friction held the joint at 0.153 while they went back.
    "it only cuts off what friction holds": held(0.15, lambda goal: rubbing(goal, 0.03) + 0.033, 0.13, 0.02),
    **{
        f"friction of {half} rad that the drive cannot overcome, though goals go further": held(
            STOP + half, partial(rubbing, half=half), STOP - 0.02, 0.02
        )
        for half in (0.02, 0.03, 0.05)
    },
    "a soft drive that stays behind its goals everywhere": held(
        0.17, lambda goal: goal - 0.02 * np.sign(goal), -np.inf, 0.015
    ),
}


@pytest.mark.parametrize(("why", "met"), [*((why, True) for why in MET), *((why, False) for why in NOT_MET)])
def test_a_stop_is_met_where_something_pushes_the_joint_on_to_it(why: str, met: bool) -> None:
    log = (MET if met else NOT_MET)[why]
    parameters, end = (UPPER, "load.stop_angle") if log.side > 0.0 else (LOWER, "load.lower_stop")
    assert bool(unmet(log.problem(), parameters, {end: log.side * STOP})) is not met


def bench(effects: Mapping[str, float | str]) -> FreeProblem:
    lifts = (("triangle", "steps"), ("lift_and_drop", "multisine"))
    data, _ = hidden_bench(dict(effects), 3, runs=2, duration=8.0, schedules=lifts)
    models = [JointModel(load_chain(run.actuators["servo"])) for run in data.runs]
    return free_problem(data.runs, "servo", models, cut(data.runs, "servo"), {"position": 1.0 / 6e-4})


@pytest.mark.parametrize("stop", [0.5, 0.75, 0.9])
def test_a_stop_of_another_plant_is_met(stop: float) -> None:
    assert not unmet(bench({"contact.blocked": stop}), UPPER, {"load.stop_angle": stop})
