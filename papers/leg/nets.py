"""Makes the actuator nets of the leg, from simulated runs of its printed motors under a PD, not from the machine.

    python -m sealegs.papers.leg.nets

Writes ``configs/actuator/silo4_net_1.npz`` to ``silo4_net_3.npz``; a net that is there already stays. A net stands for
controller, supply and motor; the gear's friction stays the stage that it is.
"""

from __future__ import annotations

import sys
from functools import cache

import mujoco
import numpy as np

from ...actuators.layout import S_TORQUE
from ...actuators.net_data import smooth_noise
from ...actuators.net_training import Settings, TrainingRun, train
from ...envs.leg.kinematics import angles
from ...envs.leg.path import position
from ...envs.leg.robot import JOINTS, LEG, chains_of
from ..net_files import make_missing
from .control import paths

RATE = 500.0  # [Hz] that of the controllers
SECONDS, RUNS = 4.0, 12
NOISE = 0.01  # [rad] on the goals, so that nets see more than paths
SETTINGS = Settings(rate=RATE, history=3, hidden=(16, 16), epochs=60, patience=10)


def runs(seed: int = 0) -> dict[str, list[TrainingRun]]:
    """Runs of each joint along paths whose goals are disturbed, with the motor's torque as target."""
    rng, drivetrain, values = np.random.default_rng(seed), LEG.drivetrain(chains_of("silo4_pd")), LEG.parameters()
    model, samples = drivetrain.model, round(SECONDS * RATE)
    every, time = round(1.0 / (RATE * drivetrain.model.opt.timestep)), np.arange(samples) / RATE
    found: dict[str, list[TrainingRun]] = {name: [] for name in JOINTS}
    for number, command in enumerate(paths(RUNS, seed=seed)):
        data = mujoco.MjData(model)
        goals = angles(values, position(np.tile(command, (samples, 1)), time))
        data.qpos[:3] = goals[0]
        for k in range(3):
            disturbance = smooth_noise(rng, samples, RATE, rng.uniform(0.5, 8.0))
            goals[:, k] += NOISE * rng.uniform(0.0, 1.0) * (disturbance - disturbance[0])
        rows = np.empty((samples, 3, 3))
        for k in range(samples):
            data.ctrl[:] = goals[k]
            for j, name in enumerate(JOINTS):
                rows[k, j] = data.qpos[j], data.qvel[j], drivetrain.state(name, data.userdata, S_TORQUE)
            mujoco.mj_step(model, data, every)
        for j, name in enumerate(JOINTS):
            where, speed, torque = rows[:, j].T
            found[name].append(TrainingRun(f"path {number}, {name}", time, goals[:, j], where, speed, torque))
    return found


def main() -> int:
    """Make what is missing."""
    recorded = cache(runs)
    return make_missing({f"silo4_net_{n[-1]}": lambda n=n: train(recorded()[n], SETTINGS) for n in JOINTS})


if __name__ == "__main__":
    sys.exit(main())
