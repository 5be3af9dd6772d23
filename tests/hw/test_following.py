"""Joints that do not follow: blocked or blind ones are named, loaded and slow ones left alone, jumps are cut."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.hw.machine.limits import Ability, Following, ability
from sealegs.hw.run.commands import Trajectory
from sealegs.hw.run.measured_log import read_events

from tests.simulated_runs import XL330, Simulation, sine

LOOSE = {"range_margin": 9.0, "speed": 99.0, "current": 99.0}
"""Limits other than those of following."""


@pytest.mark.parametrize(
    ("servo", "amplitude"),
    [
        ((), 0.04),
        (XL330, 0.1),
        *(pytest.param(*row, marks=pytest.mark.long) for row in (((), 0.02), (XL330, 0.06), (XL330, 0.2))),
    ],
    ids=str,
)
def test_a_servo_that_goes_blind_is_stopped_before_it_turns_away(servo: tuple[str, ...], amplitude: float) -> None:
    frozen = {"kind": "frozen", "at": 3.3}
    simulation = Simulation("bench", *servo, commands=sine(amplitude), faults=[frozen], limits=LOOSE)
    outcome = simulation.run(5.0)
    assert outcome.fault is not None and outcome.fault.name in ("following", "frozen"), simulation.port.now()
    assert abs(simulation.rig.machine.position(0)) < 1.5, "it would turn by a radian in each second"
    assert simulation.port.now() - 3.3 < 2.0, "a period of the sine"


@pytest.mark.parametrize("servo", [(), XL330], ids=str)
@pytest.mark.parametrize(("hertz", "seconds"), [(0.1, 7.0), pytest.param(0.02, 30.0, marks=pytest.mark.long)])
def test_a_servo_that_sticks_and_slips_under_its_load_is_left_alone(
    servo: tuple[str, ...], hertz: float, seconds: float
) -> None:
    heavy = ("robot.params.mass=0.6", "robot.params.length=0.12") if not servo else ()
    simulation = Simulation("bench", *servo, *heavy, commands=sine(0.3, hertz, offset=0.5), limits=LOOSE)
    assert simulation.run(seconds).ending == "finished"


@pytest.mark.long
@pytest.mark.parametrize("amplitude", [0.01, 0.05])
def test_twice_the_friction_that_the_chain_has_is_no_blind_servo(amplitude: float, tmp_path: Path) -> None:
    hidden = tmp_path / "stiff.yaml"
    hidden.write_text("friction.coulomb: 0.1\n")
    outcome = Simulation(hidden=str(hidden), commands=sine(amplitude, 0.2), limits=LOOSE).run(4.0)
    assert outcome.ending == "finished", outcome.fault


def test_a_goal_that_shakes_about_one_place_makes_no_servo_blind_and_one_that_goes_away_does() -> None:
    for drift, blind in ((0.0, False), (0.02, True)):  # [rad/s]
        following = Following([Ability(0.3, 10.0, 0.3, 0.0075, 0.3)], np.array([np.nan]), 0.01)
        random, here = np.random.default_rng(0), np.array([1.4])
        for k in range(200):
            goal = here + random.choice((-0.009, 0.0, 0.009), 1) + drift * 0.01 * k
            following.see(goal, here, np.array([True]), 0.01 * k)
        assert (following.stuck[0] > 0.3) == blind


def test_a_joint_that_arrives_with_its_goal_is_not_taken_for_blind() -> None:
    following = Following([Ability(0.3, 10.0, 0.3, 0.0075, 0.3)], np.array([np.nan]), 0.01)
    for k in range(150):
        goal = np.array([min(0.01 * k, 0.5)])
        following.see(goal, np.maximum(goal - 0.02, 0.0), np.array([True]), 0.01 * k)
    assert following.stuck[0] == 0.0


def test_a_joint_that_is_told_to_stand_still_is_not_taken_for_blind() -> None:
    def step(robot: Any) -> Trajectory:
        time = np.arange(0.0, 20.0, 0.01)
        return Trajectory("step", time, np.where(time > 1.0, 0.8, 0.0)[:, None])

    outcome = Simulation(commands=step, limits=LOOSE).run(4.0)
    assert outcome.ending == "finished", outcome.fault


@pytest.mark.long
@pytest.mark.parametrize("amplitude", [0.06, 0.3, 1.0])
@pytest.mark.parametrize("at", [1.0, 1.9, 2.6])
def test_a_frozen_encoder_ends_the_run_within_two_thirds_of_a_period(amplitude: float, at: float) -> None:
    frozen = {"kind": "frozen", "at": at + 1.0}
    simulation = Simulation(commands=sine(amplitude), faults=[frozen], limits={"range_margin": 9.0})
    outcome = simulation.run(12.0)
    assert outcome.fault is not None and outcome.fault.name in ("following", "frozen") and simulation.torque == [False]
    assert simulation.port.now() - at - 1.0 < 1.4, "of a sine of 0.5 Hz"


@pytest.mark.long
def test_a_joint_that_follows_is_left_alone_however_it_is_driven() -> None:
    for commands in (sine(0.9, 0.3), sine(0.5, 4.0), sine(0.9, 1.5)):
        assert Simulation(commands=commands, limits={"speed": 100.0}).run(6.0).ending == "finished"


@pytest.mark.long
def test_a_joint_behind_its_goal_may_be_logged_before_it_stops(tmp_path: Path) -> None:
    frozen = {"kind": "frozen", "at": 2.0, "seconds": 2.0}
    limits = {"range_margin": 9.0, "speed": 99.0, "log_only": ["following"]}
    simulation = Simulation(faults=[frozen], limits=limits, folder=tmp_path)
    assert simulation.run(6.0).ending == "finished"
    noted = [event for event in read_events(tmp_path / "run.csv") if event["event"] == "limit"]
    assert {event["name"] for event in noted} <= {"following", "frozen"} and 1 <= len(noted) <= 6


def test_the_limits_of_following_come_from_the_servos_chain() -> None:
    servo, small = (ability(load_chain(name)) for name in ("sts3215", "xl330"))
    assert servo.error == pytest.approx(0.97 / 5.3) and servo.speed == pytest.approx(0.97 * 7.4 / 1.2)
    assert small.error == pytest.approx(1.0 / 1.151) and small.speed == pytest.approx(7.4 / 0.41)


@pytest.mark.long
def test_a_goal_jumps_no_further_than_its_speed_allows_and_may_not_jump_for_long() -> None:
    def wild(robot: Any) -> Trajectory:
        time = np.arange(0.0, 10.0, 0.01)
        return Trajectory("wild", time, 0.9 * np.where(np.arange(len(time)) % 2, 1.0, -1.0)[:, None])

    simulation = Simulation(commands=wild, limits={"speed": 100.0})
    sent: list[np.ndarray] = []
    simulation.loop.each_cycle = lambda: sent.append(simulation.loop.sent) if simulation.loop.elapsed else None
    outcome = simulation.run(5.0)
    assert outcome.fault is not None and outcome.fault.name == "goal_speed" and outcome.cut["speed"] > 10
    assert np.abs(np.diff(np.array(sent)[-20:, 0])).max() < 0.24, "four times the no-load speed, in a cycle"
    limits = {"speed": 100.0, "current": 99.0, "log_only": ["goal_speed", "following"]}
    outcome = Simulation(commands=wild, limits=limits).run(1.5)
    assert outcome.ending == "finished" and outcome.cut["speed"] == 0, outcome.fault
