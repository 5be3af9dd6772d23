"""How torque comes on: each servo where its joint stands then, and with a person at the switch."""

from __future__ import annotations

import os
from collections.abc import Iterator

import numpy as np
import pytest
from sealegs.hw.guard.deadman import LET_GO, DeadMan

from tests.simulated_runs import Simulation


@pytest.mark.parametrize("latency", [0.001, 0.016])
def test_a_joint_that_a_hand_moves_while_torque_comes_on_does_not_jump_back(
    latency: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulation = Simulation("row", latency=latency, limits={"speed": 200.0})
    machine, last = simulation.rig.machine, simulation.rig.servos[3]
    starting, goals = simulation.guard.starting, list[float]()

    def moved() -> bool:
        if sum(simulation.torque) == 2:  # the third servo is next, the last one after it
            machine.drivetrain.set_position(machine.names[3], machine.data.qpos, np.asarray(0.4))
        return starting()

    def noted() -> None:
        goals.append(float(last.goal_steps() - last.sensors.steps) * last.model.step)

    monkeypatch.setattr(simulation.guard, "starting", moved)
    simulation.loop.each_cycle = noted
    assert simulation.run(0.1).fault is None
    assert abs(goals[0]) < 0.1, "it begins where the hand left it, but for what it swings"


# --- a dead-man's switch -----------------------------------------------------------------------------------------


@pytest.fixture
def keys() -> Iterator[tuple[int, int]]:
    reader, writer = os.pipe()
    yield reader, writer
    os.close(reader)
    os.close(writer)


def test_without_anybody_at_the_dead_mans_switch_no_torque_comes_on(keys: tuple[int, int]) -> None:
    times = iter(np.arange(0.0, 100.0, 0.5))
    switch = DeadMan(keys[0], lambda: float(next(times)))
    simulation = Simulation("row", armed=switch.armed, each_cycle=switch)
    outcome = simulation.run(1.0)
    assert outcome.ending == "stopped" and outcome.reason == "space was not pressed within 5 s"
    assert not simulation.switched_on


def test_a_wait_for_the_dead_mans_switch_is_ended_by_a_person(keys: tuple[int, int]) -> None:
    switch = DeadMan(keys[0], lambda: 0.0)
    asked = iter([False, False, True])
    assert switch.armed(lambda: next(asked)) is None and next(asked, None) is None


def test_a_dead_mans_switch_let_go_while_torque_comes_on_lets_no_further_servo_have_it(keys: tuple[int, int]) -> None:
    on: list[Simulation] = []
    switch = DeadMan(keys[0], lambda: 1.0 if on and sum(on[0].torque) == 2 else 0.0)
    os.write(keys[1], b" ")
    on.append(Simulation("row", armed=switch.armed, each_cycle=switch))
    assert on[0].run(1.0).reason == LET_GO
    assert len([True for _, _, torque in on[0].rig.history if torque]) == 2 and not any(on[0].torque)
