"""Columns that a loop reads before it writes the goal of the row: no drive is slow for it, whatever its controller.

Plants of this file: a joint of a walking robot that something moves as it will, and controllers written out again.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.gap.causes.visible import limits
from sealegs.gap.diagnose import diagnose
from sealegs.gap.log.arrays import measured_set
from sealegs.gap.log.parts import cut
from sealegs.gap.log.types import MeasuredSet
from sealegs.gap.replay.driven import DrivenProblem, as_read, driven_problem
from sealegs.gap.replay.joint_model import JointModel

PERIOD = 0.005
IDEAL = [
    {"ideal": {"stiffness": 25.0, "damping": 0.5, "torque_limit": 20.0, "armature": 0.02}},
    {"friction": {"coulomb": 0.15, "viscous": 0.1}},
]
DC = [
    {"position_pd": {"gain": 6.0, "damping": 0.15}},
    {"duty_limit": {"limit": 0.95}},
    {"supply": {"volts": 12.0}},
    {"dc_motor": {"motor_constant": 1.4, "resistance": 2.4, "armature": 0.01}},
]


def walk(seed: int, age: int, slow: float = 1.0) -> tuple[np.ndarray, ...]:
    """Time, goal, the goal that acts ``age`` rows late, position, speed and acceleration of a joint."""
    rng = np.random.default_rng(seed)
    time = PERIOD * np.arange(2400)
    goal, angle, speed, turning = (np.zeros(len(time)) for _ in range(4))
    for hertz, phase in zip((0.4, 0.9, 1.7, 2.6, 1.3), rng.uniform(0.0, 6.0, 5), strict=True):
        w, size = 2.0 * np.pi * hertz * slow, 0.15 if hertz != 1.3 else 0.0
        goal += size * np.sin(w * time + phase)
        size = 0.12 if hertz != 1.3 else 0.08  # what the ground does
        at = w * (time - 0.03) + phase
        angle += size * np.sin(at)
        speed += size * w * np.cos(at)
        turning -= size * w**2 * np.sin(at)
    acting = np.concatenate([np.full(age, goal[0]), goal])[: len(goal)]
    return time, goal, acting, angle, speed, turning


def torque_log(age: int, stiffness: float = 25.0, side: str = "drive", slow: float = 1.0) -> MeasuredSet:
    """The drive's own torque, or that behind its armature and friction."""
    tables = []
    for seed in range(3):
        rng = np.random.default_rng(100 + seed)
        time, goal, acting, angle, speed, turning = walk(seed, age, slow)
        torque = stiffness * (acting - angle) - 0.5 * speed
        if side == "shaft":
            torque -= 0.02 * turning + 0.1 * speed + 0.15 * np.sign(speed)
        noise = rng.normal(size=(2, len(time)))
        tables.append({
            "time": time, "hip.goal": goal, "hip.position": angle + 1e-4 * noise[0],
            "hip.torque": torque + 0.01 * noise[1],
        })  # fmt: skip
    return measured_set(tables, {"robot": "walker", "actuators": {"hip": IDEAL}})


def duty_log(age: int, slow: float = 1.0) -> MeasuredSet:
    """The duty of a PD controller of which each row's goal is written once the row is read."""
    tables = []
    for seed in range(3):
        time, goal, acting, angle, speed, _ = walk(seed, age, slow)
        duty = np.clip(6.0 * (acting - angle) - 0.15 * speed, -0.95, 0.95)
        noise = 1e-4 * np.random.default_rng(200 + seed).normal(size=len(time))
        tables.append({"time": time, "hip.goal": goal, "hip.position": angle + noise, "hip.duty": duty})
    return measured_set(tables, {"robot": "walker", "actuators": {"hip": DC}})


def seen(data: MeasuredSet) -> DrivenProblem:
    models = [JointModel(load_chain(run.actuators["hip"])) for run in data.runs]
    return as_read(driven_problem(data.runs, "hip", models, cut(data.runs, "hip"), 1e-4), told=False)


def said(problem: DrivenProblem) -> set[str]:
    return {finding.code for finding in limits(problem, "hip", ())}


@pytest.mark.parametrize(
    "data", [torque_log(1), torque_log(1, stiffness=17.0), torque_log(1, side="shaft"), duty_log(1)]
)
def test_what_is_read_before_the_goal_of_its_row_acts_is_told_of_any_drive(data: MeasuredSet) -> None:
    problem = seen(data)
    assert problem.read_early and "columns.before_goal" in said(problem)


@pytest.mark.parametrize(
    "data", [torque_log(0), torque_log(0, stiffness=17.0), duty_log(0), torque_log(3), duty_log(3)]
)
def test_what_answers_to_the_goal_of_its_row_or_to_a_much_older_one_is_not(data: MeasuredSet) -> None:
    problem = seen(data)
    assert not problem.read_early and "columns.before_goal" not in said(problem)


def test_nothing_is_told_where_goals_change_too_slowly_to_tell() -> None:
    assert not seen(torque_log(1, slow=0.004)).read_early


def test_a_delay_whose_tolerance_makes_a_goal_one_row_older_is_no_early_reading() -> None:
    data = torque_log(1)
    slow = [{"delay": {"seconds": 0.98 * PERIOD}}, *IDEAL]
    assert not seen(replace(data, runs=tuple(replace(run, actuators={"hip": slow}) for run in data.runs))).read_early


@pytest.mark.parametrize("age", [0, 1, 4])
@pytest.mark.parametrize("side", ["shaft", "drive"])
@pytest.mark.parametrize("stiffness", [17.0, 25.0])
def test_the_side_of_a_torque_is_told_though_its_goal_is_late_and_its_gain_wrong(
    stiffness: float, side: str, age: int
) -> None:
    """A goal one row old made of a drive's torque one of the shaft, and armature and friction went missing."""
    problem = seen(torque_log(age, stiffness, side))
    assert (problem.torque_side, problem.side_reason) == (side, "shown")


def diagnosed(data: MeasuredSet, *causes: str) -> Any:
    return diagnose(data, causes=["drive.goal_filter", "drive.delay", "drive.rate_limit", *causes]).joint("hip")


@pytest.mark.long
@pytest.mark.parametrize("data", [torque_log(1), duty_log(1)])
def test_a_drive_that_is_read_before_its_goal_has_no_goal_filter(data: MeasuredSet) -> None:
    """It came out EXPLAINED by a filter of the goal, with a confidence of 98 %."""
    found = diagnosed(data, "drive.acceleration_limit")
    assert not found.causes, found.text


@pytest.mark.long
def test_a_gain_shows_in_a_drive_that_is_read_before_its_goal() -> None:
    found = diagnosed(torque_log(1, stiffness=17.0), "drive.gain", "friction.coulomb")
    assert [cause.name for cause in found.causes] == ["drive.gain"], found.text
    assert found.causes[0].parameters["ideal.stiffness"].value == pytest.approx(17.0, rel=0.03)
