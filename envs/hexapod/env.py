"""The hexapod's task, walking at little specific resistance, and its Gymnasium environments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...actuators import Drivetrain
from ...actuators.gravity import GRAVITY
from ..engine.task import ModulatedTask, Motion, drawn, option
from ..engine.vector import BatchVectorEnv, SingleEnv
from . import gait
from .gait import PERIOD
from .kinematics import Joints, foot_from_joints, leg_angle, link_angles, stance
from .parameters import GOAL_RANGE, LEGS
from .robot import HEXAPOD, KINDS, ROTATION, VERTICAL, coordinate, loop_joints, penetration, total_mass

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
    memory, goal_period, sample_period = gait.MEMORY, PERIOD, 0.002

    def action_names(self) -> tuple[str, ...]:
        return tuple(gait.MODULATED)

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
            *(f"{name} [{unit}]" for name, (*_, unit) in gait.MODULATED.items()),
            *(f"last {name} action" for name in gait.MODULATED),
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
        return gait.begin(numbers, random[:, 1], goals)

    def generate(
        self, numbers: Mapping[str, float], action: np.ndarray, command: np.ndarray, memory: np.ndarray
    ) -> np.ndarray:
        return gait.advance(numbers, action, command[:, 0], memory)

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
        velocity, clock = m.qvel[:, :3], 2.0 * np.pi * m.memory[:, gait.CLOCK]
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
            m.memory[:, gait.PARAMETERS],
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


class HexapodEnv(SingleEnv, task=HexapodTask):
    r"""
    ## Description
    The six-legged robot AMRU5 of paper 001 ("Dynamic simulation of six-legged robots with a focus on joint friction"):
    34 kg on six pantograph legs. Each leg turns about its upright axis, and a vertical and a horizontal ball screw move
    it, with 18 Maxon RE35 motors in all. The task is to walk forward at a commanded speed with little specific
    resistance (energy over weight and distance). The argument `actuator` chooses drives and joint friction.

    ## Action Space
    The action space is a `Box(-1, 1, (6,), float32)`: parameters of the tripod gait (`envs/hexapod/gait.py`),
    which at action 0 is the reference gait (`envs/hexapod/gait.py`). The parameters follow the action with a time
    constant of 1 s. The gait sets the goals of all joints every 10 ms; they pass the actuation chain (digital PI
    controller, motor, gears, friction) inside the physics engine.

    | Num | Action                                                   | At 0   | Per unit | Lowest | Highest | Unit            |
    |-----|----------------------------------------------------------|--------|----------|--------|---------|-----------------|
    | 0   | travel of the body per step cycle                        | 0.18   | 0.08     | 0.1    | 0.26    | m               |
    | 1   | double stance, twice in a cycle                          | 0.0833 | 0.125    | 0      | 0.2     | of the cycle    |
    | 2   | lift of a foot in the air                                | 0.04   | 0.05     | 0.005  | 0.08    | m               |
    | 3   | part in which it rises, and in which it sinks            | 0.3    | 0.2      | 0.1    | 0.5     | of the transfer |
    | 4   | width: how much farther out the feet at the sides land   | 0      | 0.15     | -0.1   | 0.1     | m               |
    | 5   | spread: how much farther from each other along the way   | 0      | 0.04     | -0.04  | 0.04    | m               |

    Joint k belongs to leg k // 3 and is its rotation, vertical or horizontal screw; leg 0 points forward, the others
    follow counter-clockwise every 60 degrees. Rotation turns a leg clockwise seen from above. A foot follows its
    horizontal screw outward 8 times as far, and its vertical screw downward 7 times.

    ## Observation Space
    The observation space is a `Box(-Inf, Inf, (69,), float32)` of what the on-board computer knows.

    | Num   | Observation                                  | Source                                                     | Unit       |
    | ----- | -------------------------------------------- | ---------------------------------------------------------- | ---------- |
    | 0     | commanded speed                              | command                                                    | m/s        |
    | 1     | height of the body                           | odometry over the standing legs, ideal                     | m          |
    | 2-4   | upward direction in the body                 | inertial unit, ideal                                       | -          |
    | 5-6   | heading of the body on the floor             | inertial unit, ideal                                       | -          |
    | 7-9   | velocity of the body, along the floor's axes | odometry, ideal                                            | m/s        |
    | 10-12 | turn rate of the body, about its own axes    | inertial unit, ideal                                       | rad/s      |
    | 13-30 | joints, from the middle of a stance          | motor encoders of the chain: ticks, offset, scale, latency | rad, m     |
    | 31-48 | speed of the joints                          | difference of 13-30 over the last control step             | rad/s, m/s |
    | 49-54 | foot on the floor                            | from the height of the body and 13-30, ideal               | -          |
    | 55-56 | clock of the gait, sine and cosine           | memory                                                     | -          |
    | 57-62 | parameters of the gait                       | memory                                                     | m, -       |
    | 63-68 | last action                                  | memory                                                     | -          |

    ## Rewards
    The reward is ***forward + alive + straight + resistance***; `info` holds each term.

    - *reward_forward*: $w_{forward} \max(1 - |v - v_{cmd}| / s, -1)$ with the mean forward speed $v$ of the body in the
      step and $s = \max(|v_{cmd}|, 0.01)$ m/s.
    - *reward_alive*: `alive_weight` in every step.
    - *reward_straight*: $-w_{straight} (\min(|v_y| / s, 1) + |h_y|)$ with the mean speed and the heading to the side.
    - *reward_resistance*: $-w_{resistance} \min(P / (m g s), 20)$ with the mean electrical power $P$ of the paper's
      motors, braking not counted: the specific resistance (35) of a robot that travels at the commanded speed.

    `info` also holds `net_out_of_range` (samples of this episode in which an actuator net's input was outside its training
    data) and `unstable` (the simulation diverged; the episode ends).

    ## Starting State
    The robot stands on six legs, sunk into the ground by as much as carries its weight. Each rotation and each horizontal
    screw is off the middle of its range by uniform noise of $\pm$ `start_noise` times half of that range. The tripod that
    goes first is drawn, and so is the commanded speed if `speed` is a range. Then `randomization` is drawn.

    ## Episode End
    ### Termination
    The body sinks below `healthy_height`, the cosine of its tilt falls below `healthy_upright`, or the simulation is
    unstable.

    ### Truncation
    After 30 steps (30 s).

    ## Arguments

    `gymnasium.make_vec("SeaLegs/Hexapod-v0", num_envs=64)` steps the simulations on all cores and starts new episodes in
    the same step; `sealegs.envs.engine.sb3.BatchVecEnv` does so for Stable-Baselines3. Equal seeds give bit-equal trajectories in
    all three.

    ## Version History
    * v0: initial version.

    ## References
    The action follows Iscen et al., "Policies Modulating Trajectory Generators" (CoRL 2018).
    """  # noqa: E501


class HexapodVectorEnv(BatchVectorEnv, task=HexapodTask):
    """Many :class:`HexapodEnv` side by side, with the same arguments."""
