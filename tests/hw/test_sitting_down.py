"""A robot that sits down at the end of a run: along its motion whatever is lost, logged, and let go at once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.gap.log import read_measured
from sealegs.hw.run.commands import Reference, Trajectory, park_motion
from sealegs.hw.run.deployment import prepare
from sealegs.hw.run.live import picture
from sealegs.hw.run.measured_log import read_events

from benchmarks import many_starts
from tests.servo_runs import POLICIES, committed, config
from tests.simulated_runs import Simulation, sine

KINDS = sorted(path.parent.name for path in POLICIES.glob("*/seed0"))


def sitting(motion: bool = True, **keys: Any) -> Simulation:
    """A bench that sits down over 1.5 s, along a stored motion or to a pose."""
    simulation = Simulation(commands=sine(0.1), **keys)
    time = np.arange(0.0, 1.5, 0.01)
    stored = Trajectory("park", time, 0.2 - 0.6 * time[:, None])
    simulation.loop.park = stored if motion else park_motion({"joint": -0.7}, simulation.robot)
    return simulation


def test_a_cycle_in_which_nobody_answers_does_not_send_it_back_to_where_the_motion_began() -> None:
    simulation = sitting(limits={"log_only": ["goal_speed", "following"]})
    sent: list[float] = []

    def noted() -> None:
        if simulation.loop.state == "sitting down":
            sent.append(float(simulation.loop.sent[0]))
            if len(sent) in (80, 100, 101):
                simulation.fault("drop", seconds=0.015)

    simulation.guard.at_each["beat"] = noted
    outcome = simulation.run(1.0)
    assert outcome.ending == "finished" and outcome.bus["NoReplyError"] >= 4
    assert np.abs(np.diff(sent)).max() < 0.02, "1 rad/s at most, in a cycle of 10 ms"
    assert sent[-1] == pytest.approx(-0.69, abs=0.02)


@pytest.mark.parametrize("when", ["running", "sitting down"])
def test_a_dead_mans_switch_that_is_let_go_releases_at_once(when: str) -> None:
    simulation = sitting()
    let_go: list[float] = []

    def held() -> str | None:
        loop = simulation.loop
        if loop.state == when and loop.elapsed > (0.5 if when == "running" else 1.5):
            let_go.append(simulation.port.now())
            return "the dead-man's switch was let go"
        return None

    simulation.loop.each_cycle = held
    outcome = simulation.run(1.0)
    assert outcome.reason == "the dead-man's switch was let go" and simulation.torque == [False]
    assert len(let_go) == 1 and simulation.rig.history[-1][0] - let_go[0] < 0.02


def test_the_way_down_is_logged_and_shown(tmp_path: Path) -> None:
    simulation = sitting(folder=tmp_path, motion=False)
    titles: list[str] = []

    def noted() -> None:
        if simulation.loop.state == "sitting down":
            titles.append(str(picture(simulation.loop).title))

    simulation.guard.at_each["beat"] = noted
    simulation.run(1.0)
    (begun,) = [e["time"] for e in read_events(tmp_path / "run.csv") if e["event"] == "sitting down"]
    run = read_measured(tmp_path / "run.csv").runs[0]
    rows = run.time > begun
    joint = run.joints["joint"]
    assert rows.sum() > 80 and joint.goal is not None and joint.goal[-1] == pytest.approx(-0.7, abs=1e-3)
    assert joint.position[-1] == pytest.approx(-0.7, abs=0.05) and "STALE" not in titles[-1]


def test_the_way_down_begins_near_the_robot_and_not_at_a_goal_that_a_policy_sent_far_ahead() -> None:
    """A leg that pushed off had its goal 0.7 rad ahead: 'blocked or blind', in 6 of 8 normal ends of the hopper."""
    simulation = Simulation("hopper")
    place, safety = np.array([-0.7, 0.5]), simulation.loop.safety
    for goal in (np.array([-0.0, 1.2]), place + 0.01):
        begin = safety.goals_from(goal, place)
        assert (np.abs(begin - place) <= 0.1 + 1e-9).all() and (np.sign(begin - place) == np.sign(goal - place)).all()
    assert begin == pytest.approx(place + 0.01), "who is still is not let sag"


@pytest.mark.parametrize("start", [0, 5])
def test_a_hopper_ends_well_wherever_its_policy_leaves_it(start: int) -> None:
    row = many_starts.end(committed("hopper"), start)
    assert many_starts.well("ends", row), row


@pytest.mark.long
@pytest.mark.parametrize(("kind", "starts"), [("hopper", 25), *((kind, 3) for kind in KINDS if kind != "hopper")])
def test_every_robot_ends_well_wherever_its_policy_leaves_it(kind: str, starts: int) -> None:
    for start in range(100, 100 + starts):
        row = many_starts.end(committed(kind), start)
        assert many_starts.well("ends", row), row


def test_a_joint_that_does_not_get_to_its_park_pose_is_released_at_once_and_that_is_no_fault(tmp_path: Path) -> None:
    simulation = sitting(folder=tmp_path)

    def noted() -> None:
        if simulation.loop.state == "sitting down":
            simulation.rig.held = "order"  # as the ground holds a leg

    simulation.guard.at_each["beat"] = noted
    outcome = simulation.run(0.5)
    assert (outcome.ending, outcome.fault, simulation.torque) == ("finished", None, [False])
    assert outcome.note.startswith("The robot was released before it sat: joint joint (servo 1)")
    (begun,), (ended,) = (
        [e["time"] for e in read_events(tmp_path / "run.csv") if e["event"] == kind]
        for kind in ("sitting down", "not seated")
    )
    assert ended - begun < 1.0, "and not pressed for the whole way"


@pytest.mark.long
def test_the_hopper_folds_its_leg_before_it_is_released_as_its_file_says() -> None:
    settings = config("robot=hopper", patient=False)
    assert settings["robot"]["rest"] == "sit" and prepare({**settings, "reference": True}).park is not None
    simulation = Simulation("hopper", commands=Reference, limits={"range_margin": 3.0})
    simulation.loop.park = park_motion(settings["robot"]["park"], simulation.robot)
    machine, heights = simulation.rig.machine, list[float]()

    def noted() -> None:
        heights.append(machine.base()[0]["base_z"])

    simulation.guard.at_each["beat"] = noted
    outcome = simulation.run(0.5)
    assert outcome.ending == "finished", outcome.fault
    assert heights[-1] < 0.7 * heights[0] and abs(machine.base()[1]["base_z"]) < 0.1, "low, and at rest"


def test_a_joint_that_the_park_pose_leaves_out_stays_where_it_is(tmp_path: Path) -> None:
    begin = np.array([-0.61, 0.4])
    commands = Trajectory("still", np.array([0.0, 1.0]), np.tile(begin, (2, 1)))
    stored = tmp_path / "sit.csv"
    stored.write_text("time,hip.goal\n0,-0.7\n0.5,-0.9\n")
    for park, end in (({"hip": -0.9}, -0.9), (str(stored), -0.9)):
        simulation = Simulation("hopper", commands=lambda _: commands, limits={"range_margin": 3.0})
        simulation.loop.park = park_motion(park, simulation.robot)
        outcome = simulation.run(0.3)
        assert outcome.ending == "finished", outcome.fault
        assert simulation.loop.sent == pytest.approx([end, 0.4], abs=1e-3)
