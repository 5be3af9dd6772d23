"""Makes the actuator nets of the hexapod, from simulated runs of its printed chain, not from the machine: walks, and
joints on their own.

    python -m sealegs.papers.hexapod.nets

Writes ``configs/actuator/amru5_rotation_net.npz`` and ``amru5_screw_net.npz``; a net that is there already stays.
"""

from __future__ import annotations

import sys
from functools import cache

import mujoco
import numpy as np

from ...actuators import Drivetrain
from ...actuators.layout import S_TORQUE
from ...actuators.net_data import smooth_noise
from ...actuators.net_training import Settings, TrainedNet, TrainingRun, train
from ...envs.hexapod.gait import PERIOD, Tripod
from ...envs.hexapod.robot import HORIZONTAL, KINDS, ROTATION, VERTICAL, coordinate
from ..net_files import make_missing
from .paper import Machine

RATE = 500.0  # [Hz] five samples in a period of the controller: held longer, the back-EMF would swing
SECONDS = 6.0
GAITS = tuple(Tripod(speed, lift=lift) for speed in (0.015, 0.03) for lift in (0.01, 0.04))
NOISE = {ROTATION: 0.02, VERTICAL: 5e-4, HORIZONTAL: 5e-4}  # [rad], [m] on the goals, so that nets see more than gaits
FREE = 6  # runs of each joint on its own, where goals jump so far that the drive gives all that it has
JUMPS, PUSH = (
    {ROTATION: 0.05, VERTICAL: 1.5e-3, HORIZONTAL: 1.5e-3},
    {ROTATION: 40.0, VERTICAL: 500.0, HORIZONTAL: 500.0},
)
JOINT = """<mujoco><option timestep="{step}" gravity="0 0 0"/><worldbody><body><joint name="joint" type="slide"/>
<inertial pos="0 0 0" mass="{inertia}" diaginertia="1e-4 1e-4 1e-4"/></body></worldbody></mujoco>"""
LEGS = (0, 1, 5)  # by symmetry, the others move alike
JOINTS = {"rotation": (ROTATION,), "screw": (VERTICAL, HORIZONTAL)}
SETTINGS = Settings(rate=RATE, history=3, hidden=(16, 16), epochs=60, patience=10)


def walks(seed: int = 0) -> dict[str, list[TrainingRun]]:
    """Runs of all kinds of joints in gaits whose goals are disturbed, with the motor's torque as target.

    Joint friction is dry and viscous; it is not part of the target, and stays a stage of its own.
    """
    rng, machine = np.random.default_rng(seed), Machine("dry/viscous")
    data, samples, held = machine.data, round(SECONDS * RATE), round(PERIOD * RATE)
    every = round(1.0 / (RATE * machine.model.opt.timestep))
    names = {kind: [coordinate(leg, kind) for leg in LEGS] for kind in KINDS}
    columns = [item.name for item in machine.drivetrain.coordinates]
    time, found = np.arange(samples) / RATE, {kind: list[TrainingRun]() for kind in KINDS}
    for number, gait in enumerate(GAITS):
        goals = np.repeat(gait.goals(machine.values, PERIOD * np.arange(samples // held)), held, axis=0)
        machine.place(goals[0])
        for k in range(len(columns)):
            disturbance = smooth_noise(rng, samples, RATE, rng.uniform(0.5, 4.0))
            goals[:, k] += NOISE[KINDS[k % len(KINDS)]] * rng.uniform(0.0, 1.0) * (disturbance - disturbance[0])
        rows = {name: np.empty((samples, 3)) for kind in KINDS for name in names[kind]}
        for k in range(samples):
            data.ctrl[:] = goals[k]
            for name, row in rows.items():
                torque = machine.drivetrain.state(name, data.userdata, S_TORQUE)
                row[k] = data.joint(name).qpos[0], data.joint(name).qvel[0], torque
            mujoco.mj_step(machine.model, data, every)
        for kind in KINDS:
            for name in names[kind]:
                goal, (position, velocity, torque) = goals[:, columns.index(name)], rows[name].T
                found[kind].append(TrainingRun(f"walk {number}, {name}", time, goal, position, velocity, torque))
    return found


def free_runs(kind: str, seed: int = 0) -> list[TrainingRun]:
    """Runs of one kind of drive that turns nothing but its rotor, under jumping goals and pushes."""
    rng, machine = np.random.default_rng(seed), Machine("dry/viscous")
    name = coordinate(LEGS[0], kind)
    step, inertia = machine.model.opt.timestep, float(machine.model.dof_armature[machine.model.joint(name).dofadr[0]])
    spec = mujoco.MjSpec.from_string(JOINT.format(step=step, inertia=inertia))
    driven = Drivetrain(spec, {"joint": machine.drivetrain.chains[name]})
    samples, every, recorded = round(SECONDS * RATE), round(1.0 / (RATE * step)), []
    for number in range(FREE):
        data, rows = mujoco.MjData(driven.model), np.empty((samples, 3))
        held = round(rng.uniform(0.05, 0.6) * RATE)
        goal = np.repeat(JUMPS[kind] * rng.uniform(-1.0, 1.0, samples // held + 1), held)[:samples]
        push = rng.uniform(0.0, 1.0) * PUSH[kind] * smooth_noise(rng, samples, RATE, rng.uniform(0.5, 4.0))
        for k in range(samples):
            data.ctrl[0], data.qfrc_applied[0] = goal[k], push[k]
            rows[k] = data.qpos[0], data.qvel[0], driven.state("joint", data.userdata, S_TORQUE)
            mujoco.mj_step(driven.model, data, every)
        time, (position, velocity, torque) = np.arange(samples) / RATE, rows.T
        recorded.append(TrainingRun(f"free {number}, {kind}", time, goal, position, velocity, torque))
    return recorded


def make(kinds: tuple[str, ...], recorded: dict[str, list[TrainingRun]]) -> TrainedNet:
    """Train the net of these kinds of joints."""
    return train([run for kind in kinds for run in (*recorded[kind], *free_runs(kind))], SETTINGS)


def main() -> int:
    """Make what is missing."""
    recorded = cache(walks)
    nets = {f"amru5_{name}_net": lambda kinds=kinds: make(kinds, recorded()) for name, kinds in JOINTS.items()}
    return make_missing(nets)


if __name__ == "__main__":
    sys.exit(main())
