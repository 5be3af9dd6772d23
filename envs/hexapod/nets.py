"""Makes the actuator nets of the hexapod, from simulated runs of its printed chain, not from the machine.

    python -m envs.hexapod.nets

Writes ``configs/actuator/amru5_rotation_net.npz`` and ``amru5_screw_net.npz``; a net that is there already stays.
"""

from __future__ import annotations

import sys
from pathlib import Path

import mujoco
import numpy as np

from actuators import Chain, Drivetrain
from actuators.chain import LIBRARY
from actuators.errors import SealegsError
from actuators.layout import S_TORQUE
from actuators.net_data import commands, smooth_noise
from actuators.net_file import write_net
from actuators.net_training import Settings, TrainedNet, TrainingRun, train
from envs.hexapod.robot import HEXAPOD, chains_of

RATE = 500.0  # [Hz] five samples in a period of the controller: held longer, the back-EMF would swing
STEP = 0.001  # [s]
RUNS, SECONDS = 10, 6.0
# a free joint of the rotor's inertia; goals and pushes of about the size that the gait gives
KINDS = {
    "rotation": ("leg0_rotation", "rotation_gear", 0.08, 60.0),
    "screw": ("leg0_vertical", "screw_gear", 0.003, 800.0),
}
JOINT = """<mujoco><option timestep="{step}" gravity="0 0 0"/><worldbody><body><joint name="joint" type="slide"
armature="{inertia}"/><inertial pos="0 0 0" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/></body></worldbody></mujoco>"""
SETTINGS = Settings(rate=RATE, history=3, hidden=(16,), epochs=40, patience=10)


def runs(chain: Chain, inertia: float, reach: float, push: float, seed: int = 0) -> list[TrainingRun]:
    """Runs of a chain on a free joint under random goals and pushes, with the motor's torque as target.

    Args:
        chain: to learn; its friction is not part of the target, and stays a stage of its own.
        inertia: of the rotor at the joint.
        reach: size of the goals' motion.
        push: size of the loads.
        seed: of both.
    """
    rng = np.random.default_rng(seed)
    driven = Drivetrain(mujoco.MjSpec.from_string(JOINT.format(step=STEP, inertia=inertia)), {"joint": chain})
    samples, every = round(SECONDS * RATE), round(1.0 / (RATE * STEP))
    recorded = []
    for number in range(RUNS):
        data = mujoco.MjData(driven.model)
        goal = reach * commands(rng, samples, RATE)
        load = rng.uniform(0.0, 1.0) * push * smooth_noise(rng, samples, RATE, rng.uniform(0.5, 4.0))
        rows = np.empty((samples, 3))
        for k in range(samples):
            data.ctrl[0], data.qfrc_applied[0] = goal[k], load[k]
            mujoco.mj_forward(driven.model, data)
            rows[k] = data.qpos[0], data.qvel[0], driven.state("joint", data.userdata, S_TORQUE)
            mujoco.mj_step(driven.model, data, every)
        recorded.append(
            TrainingRun(f"simulated {number}", np.arange(samples) / RATE, goal, rows[:, 0], rows[:, 1], rows[:, 2])
        )
    return recorded


def make(kind: str) -> TrainedNet:
    """Train the net of one kind of joint."""
    joint, gear, reach, push = KINDS[kind]
    numbers = HEXAPOD.parameters()
    inertia = numbers["rotor_inertia"] * numbers[gear] ** 2
    return train(runs(chains_of("amru5_dry")[joint], inertia, reach, push), SETTINGS)


def main() -> int:
    """Make what is missing."""
    for kind in KINDS:
        path = Path(LIBRARY) / f"amru5_{kind}_net.npz"
        if path.exists():
            print(f"{path.name} is there already.")
            continue
        trained = make(kind)
        write_net(trained.arrays, path)
        print(f"{path.name}: rms {trained.rms:.3g}, {trained.r2:.1%} of the variance on unseen runs", flush=True)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except SealegsError as error:
        sys.exit(str(error))
