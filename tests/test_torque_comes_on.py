"""How torque comes on: each servo where its joint stands then, and with a person at the switch."""

from __future__ import annotations

import numpy as np
import pytest

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
