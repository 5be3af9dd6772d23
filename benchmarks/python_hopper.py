"""The hopper as it is usually written: a Gymnasium ``MujocoEnv`` whose actuator law runs in Python every physics step.

It is what the training speed is measured against. Model, task, observations and rewards are those of
``SeaLegs/Hopper-v0`` with the chain ``sv1270tg``; ``tests/package/test_benchmarks.py`` compares the two motions.
"""

from __future__ import annotations

import math
import os
import tempfile
import time
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from gymnasium.envs.mujoco import MujocoEnv
from gymnasium.spaces import Box
from sealegs.actuators import load_chain
from sealegs.envs.hopper.env import HIGH, SLOWEST, HopperTask
from sealegs.envs.hopper.robot import HIP, HOPPER, KNEE, leg_length

FRAME_SKIP = 20  # physics steps of 1 ms per action


def torque_driven_model() -> mujoco.MjSpec:
    """The hopper with its springs and rotors, and plain torque motors in place of the chains."""
    spec = HOPPER.drivetrain("sv1270tg").spec.copy()
    for actuator in spec.actuators:
        actuator.biastype = mujoco.mjtBias.mjBIAS_NONE
        actuator.gainprm[0] = 1.0
        actuator.userdata = []
    spec.nuserdata = 0
    return spec


class PythonHopper(MujocoEnv):
    """Hop forward at a commanded speed; the law of both servos is :meth:`torques`."""

    metadata = {"render_modes": [], "render_fps": 50}  # noqa: RUF012 as Gymnasium has it

    def __init__(self, max_episode_steps: int = 500) -> None:
        chain = load_chain("sv1270tg")
        self.gain, self.limit = chain.value("position_p.gain"), chain.value("duty_limit.limit")
        stage = chain.find("regression")
        self.map = (stage.duty_torque, stage.speed_torque, stage.constant)
        self.task, self.numbers = HopperTask(), HOPPER.parameters()
        limits = np.array([HOPPER.limits[HIP], HOPPER.limits[KNEE]])
        self.goal_centre, self.goal_half = limits.mean(axis=1), 0.5 * (limits[:, 1] - limits[:, 0])
        descriptor, name = tempfile.mkstemp(suffix=".xml")
        os.close(descriptor)
        spec = torque_driven_model()
        spec.compile()
        Path(name).write_text(spec.to_xml(), encoding="utf-8")
        try:
            super().__init__(name, FRAME_SKIP, Box(-np.inf, np.inf, (14,), np.float32))
        finally:
            Path(name).unlink()
        self.action_space = Box(-1.0, 1.0, (2,), np.float32)
        joints = (HIP, KNEE, f"{HIP}_motor", f"{KNEE}_motor")
        self.at = [int(self.model.jnt_qposadr[self.model.joint(joint).id]) for joint in joints]
        self.motors = np.array(self.at[2:])
        self.max_episode_steps, self.elapsed = max_episode_steps, 0

    def torques(self, goals: np.ndarray) -> np.ndarray:
        """The chain sv1270tg in Python: position control, duty limit, regression."""
        per_duty, per_speed, constant = self.map
        duty = np.clip(self.gain * (goals - self.data.qpos[self.motors]), -self.limit, self.limit)
        return per_duty * duty + per_speed * self.data.qvel[self.motors] + constant

    def cpu_seconds(self) -> float:
        """CPU time of this process [s]."""
        return time.process_time()

    def reset_model(self) -> np.ndarray:
        """Drop the leg from a little above the floor."""
        noise = self.task.start_noise * self.np_random.uniform(-1.0, 1.0, 5)
        qpos, qvel = self.init_qpos.copy(), self.init_qvel.copy()
        hip = self.numbers["hip_rest"] + noise[0]
        knee = self.numbers["knee_rest"] + noise[1]
        qpos[self.at] = hip, knee - hip, hip, knee
        qpos[1] = leg_length(self.numbers, hip, knee) + abs(noise[2])
        qvel[0], qvel[1] = noise[3], noise[4]
        self.set_state(qpos, qvel)
        self.elapsed = 0
        self.action = (np.array([hip, knee]) - self.goal_centre) / self.goal_half
        self.angles = self._angles()
        return self._observation(self.angles)

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """One action."""
        self.action = np.clip(np.asarray(action, np.float64), -1.0, 1.0)
        goals = self.goal_centre + self.goal_half * self.action
        torques = np.zeros(2)
        for _ in range(self.frame_skip):
            torques = self.torques(goals)
            self.do_simulation(torques, 1)
        before, self.angles = self.angles, self._angles()
        observation = self._observation(before)
        qpos, qvel, task = self.data.qpos, self.data.qvel, self.task
        wanted = float(task.speed)  # type: ignore[arg-type]
        error = abs(qvel[0] - wanted) / max(abs(wanted), SLOWEST)
        clearance = qpos[1] - leg_length(self.numbers, self.angles[0], self.angles[1])
        power = abs(torques[0] * qvel[self.at[2]]) + abs(torques[1] * qvel[self.at[3]])
        terms = {
            "reward_forward": task.forward_weight * max(1.0 - error, -1.0),
            "reward_alive": task.alive_weight,
            "reward_height": task.height_weight * min(max(clearance / HIGH, 0.0), 1.0),
            "reward_energy": -task.energy_weight * power,
        }
        failed = bool(
            qpos[1] < task.healthy_height or max(abs(self.angles[0]), abs(self.angles[1])) > task.healthy_angle
        )
        self.elapsed += 1
        return observation, float(sum(terms.values())), failed, self.elapsed >= self.max_episode_steps, terms

    def _angles(self) -> tuple[float, float, float, float]:
        """Both links and both motors [rad]; the knee is measured against the vertical, as its belt drives it."""
        qpos = self.data.qpos
        hip = qpos.item(self.at[0])
        return hip, hip + qpos.item(self.at[1]), qpos.item(self.at[2]), qpos.item(self.at[3])

    def _observation(self, before: tuple[float, ...]) -> np.ndarray:
        now, dt = self.angles, self.frame_skip * self.model.opt.timestep
        speeds = [(a - b) / dt for a, b in zip(now, before, strict=True)]
        qvel = self.data.qvel
        values = [self.task.speed, self.data.qpos.item(1), *now, qvel.item(0), qvel.item(1), *speeds, *self.action]
        assert math.isfinite(values[1])
        return np.array(values, np.float32)
