"""Walk at a commanded speed, at little specific resistance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...actuators import Drivetrain
from ...actuators.gravity import GRAVITY
from ..engine.task import ModulatedTask, Motion, drawn, option
from . import modulated_gait
from .gait import PERIOD
from .ground import penetration
from .kinematics import Joints, foot_from_joints, leg_angle, link_angles, stance
from .parameters import GOAL_RANGE, LEGS
from .robot import HEXAPOD, KINDS, ROTATION, VERTICAL, coordinate, loop_joints, total_mass

SLOWEST = 0.01  # [m/s] below this, errors of speed count in absolute terms
TOUCH = 1e-3  # [m] under which the switch of a foot says that it is on the floor
MOST = 20.0  # of the specific resistance that the reward counts
UP, UPRIGHT = 2, slice(3, 7)  # height and quaternion of the body in qpos


@dataclass(frozen=True)
class HexapodTask(ModulatedTask):
    """The options of :class:`sealegs.envs.hexapod.env.HexapodEnv`."""

    speed: float | Sequence[float] = option(0.03, "commanded speed, or the range it is drawn from", "m/s")
    forward_weight: float = 1.0
    alive_weight: float = 0.1
    straight_weight: float = 0.3
    resistance_weight: float = 0.3
    healthy_height: float = option(0.12, "lowest height of the body", "m")
    healthy_upright: float = option(0.85, "lowest cosine of its tilt")
    start_noise: float = option(0.1, "see Starting State")

    robot = HEXAPOD
    draws = 2 + 3 * LEGS  # speed, first tripod, joints
    ranges = ("speed",)
    control_rate = 1.0  # a step cycle of the reference gait takes 6 to 12 s
    memory, goal_period, sample_period = modulated_gait.MEMORY, PERIOD, 0.002

    def action_names(self) -> tuple[str, ...]:
        return tuple(modulated_gait.MODULATED)

    def observation_names(self) -> tuple[str, ...]:
        joints = [item.name for item in HEXAPOD.coordinates]
        units = ["rad" if name.endswith(ROTATION) else "m" for name in joints]
        return (
            "commanded speed [m/s]",
            "body height [m]",
            *(f"upward in the body {axis}" for axis in "xyz"),
            *(f"heading {axis}" for axis in "xy"),
            *(f"body speed {axis} [m/s]" for axis in "xyz"),
            *(f"body turn rate {axis} [rad/s]" for axis in "xyz"),
            *(f"{name} reading from stance [{unit}]" for name, unit in zip(joints, units, strict=True)),
            *(f"{name} speed [{unit}/s]" for name, unit in zip(joints, units, strict=True)),
            *(f"leg{leg} foot switch" for leg in range(LEGS)),
            "clock of the gait, sine",
            "clock of the gait, cosine",
            *(f"{name} [{unit}]" for name, (*_, unit) in modulated_gait.MODULATED.items()),
            *(f"last {name} action" for name in modulated_gait.MODULATED),
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
        rest = stance(numbers)._asdict()
        noise = self.start_noise * (2.0 * random[:, 2:] - 1.0)
        goals = np.empty((len(qpos), 3 * LEGS))
        lowest = np.full(len(qpos), np.inf)
        for leg in range(LEGS):
            for k, kind in enumerate(KINDS):
                reach = 0.0 if kind == VERTICAL else GOAL_RANGE[kind]  # all feet stand
                goals[:, 3 * leg + k] = float(rest[kind]) + reach * noise[:, 3 * leg + k]
                drivetrain.set_position(coordinate(leg, kind), qpos, goals[:, 3 * leg + k])
            joints = Joints(*goals[:, 3 * leg : 3 * leg + 3].T)
            rise, bend = link_angles(numbers, joints.vertical, joints.horizontal)
            for name, angle in zip(loop_joints(leg), (rise, np.pi - bend, np.pi - bend), strict=True):
                qpos[:, int(model.joint(name).qposadr[0])] = angle
            lowest = np.minimum(lowest, foot_from_joints(numbers, joints)[2] - numbers["foot_radius"])
        weight = total_mass(numbers) * GRAVITY
        qpos[:, UP] = -lowest - penetration(numbers, weight / LEGS, weight)
        return goals

    def begin(
        self, numbers: Mapping[str, float], random: np.ndarray, goals: np.ndarray, command: np.ndarray
    ) -> np.ndarray:
        del command
        return modulated_gait.begin(numbers, random[:, 1], goals)

    def generate(
        self, numbers: Mapping[str, float], action: np.ndarray, command: np.ndarray, memory: np.ndarray
    ) -> np.ndarray:
        return modulated_gait.advance(numbers, action, command[:, 0], memory)

    def power(self, numbers: Mapping[str, float], torque: np.ndarray, motor_speed: np.ndarray) -> np.ndarray:
        """What the motors give, where they do not brake, and what their windings lose: that of the paper's motors,
        whatever chain there is.
        """
        gear = np.array([numbers["rotation_gear" if kind == ROTATION else "screw_gear"] for kind in KINDS] * LEGS)
        drawn = np.maximum(torque * motor_speed + numbers["winding_loss"] * np.square(torque / gear), 0.0)
        total = drawn[:, 0].copy()
        for k in range(1, drawn.shape[1]):  # in one order at any batch size
            total += drawn[:, k]
        return total

    def observe(self, motion: Motion) -> tuple[np.ndarray, ...]:
        m = motion
        _, upward, heading = _axes(m.qpos)
        velocity, clock = m.qvel[:, :3], 2.0 * np.pi * m.memory[:, modulated_gait.CLOCK]
        middle = np.array([value for _ in range(LEGS) for value in stance(m.numbers)], dtype=float)
        return (
            m.command,
            m.qpos[:, UP],
            upward,
            heading,
            velocity,
            m.qvel[:, 3:6],
            m.reading - middle,
            m.reading_speed,
            (foot_heights(m) < TOUCH).astype(float),
            np.sin(clock),
            np.cos(clock),
            m.memory[:, modulated_gait.PARAMETERS],
            m.action,
        )

    def rewards(self, motion: Motion) -> dict[str, np.ndarray]:
        speed, wanted = motion.qpos_rate[:, 0], motion.command[:, 0]
        scale = np.maximum(np.abs(wanted), SLOWEST)
        _, _, heading = _axes(motion.qpos)
        aside = np.minimum(np.abs(motion.qpos_rate[:, 1]) / scale, 1.0) + np.abs(heading[:, 1])
        resistance = np.minimum(motion.power / (total_mass(motion.numbers) * GRAVITY * scale), MOST)
        return {
            "reward_forward": self.forward_weight * np.maximum(1.0 - np.abs(speed - wanted) / scale, -1.0),
            "reward_alive": np.full(len(speed), self.alive_weight),
            "reward_straight": -self.straight_weight * aside,
            "reward_resistance": -self.resistance_weight * resistance,
        }

    def failed(self, motion: Motion) -> np.ndarray:
        vertical, _, _ = _axes(motion.qpos)
        return (motion.qpos[:, UP] < self.healthy_height) | (vertical < self.healthy_upright)


def foot_heights(motion: Motion) -> np.ndarray:
    """Height of each sole over the floor, from the readings of the joints (n, 6) [m]."""
    vertical, upward, _ = _axes(motion.qpos)
    heights = np.empty((len(vertical), LEGS))
    for leg in range(LEGS):
        x, y, z = foot_from_joints(motion.numbers, Joints(*motion.reading[:, 3 * leg : 3 * leg + 3].T))
        angle, radius = leg_angle(leg), motion.numbers["leg_radius"]
        ahead = (radius + x) * np.cos(angle) - y * np.sin(angle)
        left = (radius + x) * np.sin(angle) + y * np.cos(angle)
        along = upward[:, 0] * ahead + upward[:, 1] * left + upward[:, 2] * z
        heights[:, leg] = motion.qpos[:, UP] + along - motion.numbers["foot_radius"]
    return heights


def _axes(qpos: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cosine of the body's tilt (n,), the world's upward axis in the body (n, 3), the body's forward axis on the floor
    (n, 2).
    """
    w, x, y, z = qpos[:, UPRIGHT].T
    upward = np.stack([2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)], axis=1)
    heading = np.stack([1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z)], axis=1)
    return upward[:, 2], upward, heading
