"""Hop forward at a commanded speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...actuators import Drivetrain
from ..engine.task import Motion, Task, drawn, option
from .robot import FOOT, HIP, HOPPER, KNEE, LOWER, leg_length

SLOWEST = 0.1  # [m/s] below this, errors of speed count in absolute terms
HIGH = 0.04  # [m] of the foot over the floor, where the reward for height is full
FORWARD, UP = 0, 1  # qpos and qvel of the base


@dataclass(frozen=True)
class HopperTask(Task):
    """The options of :class:`sealegs.envs.hopper.env.HopperEnv`."""

    speed: float | Sequence[float] = option(0.3, "commanded speed, or the range it is drawn from", "m/s")
    forward_weight: float = 1.0
    alive_weight: float = 0.2
    height_weight: float = 0.5
    energy_weight: float = option(0.02, "see Rewards", "1/W")
    healthy_height: float = option(0.06, "lowest height of the hip", "m")
    healthy_angle: float = option(2.0, "largest angle of a link", "rad")
    start_noise: float = option(0.05, "see Starting State")

    robot = HOPPER
    draws = 6
    ranges = ("speed",)

    def observation_names(self) -> tuple[str, ...]:
        return (
            "commanded speed [m/s]",
            "hip height [m]",
            "hip link angle [rad]",
            "knee link angle [rad]",
            "hip motor reading [rad]",
            "knee motor reading [rad]",
            "forward speed [m/s]",
            "upward speed [m/s]",
            "hip link speed [rad/s]",
            "knee link speed [rad/s]",
            "hip motor speed [rad/s]",
            "knee motor speed [rad/s]",
            "last hip action",
            "last knee action",
        )

    def asked_names(self) -> tuple[str, ...]:
        return ("speed [m/s]",)

    def commands(self, random: np.ndarray) -> np.ndarray:
        return drawn(self.speed, random[:, :1])

    def place(
        self,
        drivetrain: Drivetrain,
        numbers: Mapping[str, float],
        random: np.ndarray,
        qpos: np.ndarray,
        qvel: np.ndarray,
    ) -> np.ndarray:
        model = drivetrain.model
        noise = self.start_noise * (2.0 * random[:, 1:] - 1.0)
        hip, knee = numbers["hip_rest"] + noise[:, 0], numbers["knee_rest"] + noise[:, 1]
        drivetrain.set_position(HIP, qpos, hip)
        drivetrain.set_position(KNEE, qpos, knee)
        foot = model.geom(FOOT)
        leg = -model.body(LOWER).pos[2] * np.cos(hip) - foot.pos[2] * np.cos(knee) + foot.size[0]
        qpos[:, UP] = leg + np.abs(noise[:, 2])  # dropped from a little above the floor
        qvel[:, FORWARD], qvel[:, UP] = noise[:, 3], noise[:, 4]
        return np.stack([hip, knee], axis=1)

    def observe(self, motion: Motion) -> tuple[np.ndarray, ...]:
        m = motion
        base = m.qvel[:, : UP + 1]
        return m.command, m.qpos[:, UP], m.link, m.reading, base, m.link_speed, m.reading_speed, m.action

    def rewards(self, motion: Motion) -> dict[str, np.ndarray]:
        speed, wanted = motion.qvel[:, FORWARD], motion.command[:, 0]
        error = np.abs(speed - wanted) / np.maximum(np.abs(wanted), SLOWEST)
        clearance = motion.qpos[:, UP] - leg_length(motion.numbers, motion.link[:, 0], motion.link[:, 1])
        power = np.abs(motion.torque * motion.motor_speed).sum(axis=1)
        return {
            "reward_forward": self.forward_weight * np.maximum(1.0 - error, -1.0),
            "reward_alive": np.full(len(speed), self.alive_weight),
            "reward_height": self.height_weight * np.clip(clearance / HIGH, 0.0, 1.0),
            "reward_energy": -self.energy_weight * power,
        }

    def failed(self, motion: Motion) -> np.ndarray:
        folded = motion.qpos[:, UP] < self.healthy_height
        return folded | (np.abs(motion.link) > self.healthy_angle).any(axis=1)
