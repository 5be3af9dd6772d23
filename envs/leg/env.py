"""The leg's task, leading the foot along a line, and its Gymnasium environments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...actuators import Drivetrain
from ..engine.task import ModulatedTask, Motion, drawn, option
from ..engine.vector import BatchVectorEnv, SingleEnv
from . import path
from .kinematics import angles, foot
from .robot import JOINTS, LEG

LARGEST = 0.001  # [m] of the foot's error that the reward counts
AHEAD = 0.01  # [s] between the points of the reference that are observed
TIME, CORRECTION = 0, slice(1, 4)  # in the memory


@dataclass(frozen=True)
class LegTask(ModulatedTask):
    """The options of :class:`sealegs.envs.leg.env.LegEnv`."""

    speed: float | Sequence[float] = option(
        (0.05, 0.15), "mean speed of the foot, or the range it is drawn from [m/s]; its peak is twice that"
    )
    preview: float = option(0.0, "time by which goals run ahead of the path", "s")
    correction: float = option(0.004, "see Action Space", "rad")
    correction_time: float = option(0.01, "see Action Space", "s")
    tracking_weight: float = 1.0
    energy_weight: float = option(0.0, "see Rewards", "1/W")
    start_noise: float = option(0.002, "see Starting State", "rad")

    robot = LEG
    draws = 10  # speed, both ends of the path, joints
    ranges = ("speed",)
    control_rate = 100.0
    memory, goal_period, sample_period = 4, 0.002, 0.002

    def action_names(self) -> tuple[str, ...]:
        return tuple(f"correction of {name}" for name in JOINTS)

    def observation_names(self) -> tuple[str, ...]:
        return (
            *(f"{name} reference [rad]" for name in JOINTS),
            *(f"{name} reference speed [rad/s]" for name in JOINTS),
            *(f"{name} reference acceleration [rad/s2]" for name in JOINTS),
            *(f"{name} reading behind reference [rad]" for name in JOINTS),
            *(f"{name} speed [rad/s]" for name in JOINTS),
            *(f"{name} correction [rad]" for name in JOINTS),
            *(f"last action of {name}" for name in JOINTS),
        )

    def asked_names(self) -> tuple[str, ...]:
        return (*(f"{end} {axis} [m]" for end in ("begin", "end") for axis in "xyz"), "way [s]")

    def commands(self, random: np.ndarray) -> np.ndarray:
        return path.drawn(random[:, 1:7], drawn(self.speed, random[:, 0]))

    def reference_angles(self, numbers: Mapping[str, float], command: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Joint angles of the path (n, 3) [rad]."""
        return angles(numbers, path.position(command, time))

    def place(
        self,
        drivetrain: Drivetrain,
        numbers: Mapping[str, float],
        random: np.ndarray,
        qpos: np.ndarray,
        qvel: np.ndarray,
    ) -> np.ndarray:
        del qvel
        goals = self.reference_angles(numbers, self.commands(random), np.zeros(len(random)))
        start = goals + self.start_noise * (2.0 * random[:, 7:] - 1.0)
        for k, name in enumerate(JOINTS):
            drivetrain.set_position(name, qpos, start[:, k])
        return goals

    def begin(
        self, numbers: Mapping[str, float], random: np.ndarray, goals: np.ndarray, command: np.ndarray
    ) -> np.ndarray:
        del numbers, goals, command
        return np.zeros((len(random), self.memory))

    def generate(
        self, numbers: Mapping[str, float], action: np.ndarray, command: np.ndarray, memory: np.ndarray
    ) -> np.ndarray:
        follow = min(self.goal_period / self.correction_time, 1.0) if self.correction_time > 0.0 else 1.0
        held = memory[:, CORRECTION]
        memory[:, CORRECTION] = held + follow * (self.correction * action - held)
        goals = self.reference_angles(numbers, command, memory[:, TIME] + self.preview)
        memory[:, TIME] = memory[:, TIME] + self.goal_period
        return goals + memory[:, CORRECTION]

    def power(self, numbers: Mapping[str, float], torque: np.ndarray, motor_speed: np.ndarray) -> np.ndarray:
        """What the motors give, where they do not brake (n,) [W]."""
        del numbers
        drawn = np.maximum(torque * motor_speed, 0.0)
        return drawn[:, 0] + drawn[:, 1] + drawn[:, 2]

    def error(self, motion: Motion) -> np.ndarray:
        """Distance of the foot from its path (n,) [m]."""
        wanted = path.position(motion.command, motion.time)
        return np.sqrt(np.square(foot(motion.numbers, motion.link) - wanted).sum(axis=1))

    def observe(self, motion: Motion) -> tuple[np.ndarray, ...]:
        m = motion
        now, soon, later = (
            self.reference_angles(m.numbers, m.command, m.time + k * AHEAD + self.preview) for k in (0, 1, 2)
        )
        return (
            now,
            (soon - now) / AHEAD,
            (later - 2.0 * soon + now) / AHEAD**2,
            self.reference_angles(m.numbers, m.command, m.time) - m.reading,
            m.reading_speed,
            m.memory[:, CORRECTION],
            m.action,
        )

    def rewards(self, motion: Motion) -> dict[str, np.ndarray]:
        return {
            "reward_tracking": self.tracking_weight * (1.0 - np.minimum(self.error(motion) / LARGEST, 1.0)),
            "reward_energy": -self.energy_weight * motion.power,
        }

    def failed(self, motion: Motion) -> np.ndarray:
        return np.zeros(len(motion.qpos), dtype=bool)


class LegEnv(SingleEnv, task=LegTask):
    r"""
    ## Description
    One leg of the quadruped SILO4 of paper 000 ("On finding the relevant dynamics for model based controlling walking
    robots"), on a stand. It has three joints, and DC motors behind planetary and skew-axis gears of 246:1 and 287:1, whose
    friction is larger than any torque that the leg's own mass requires. The task is to move the foot to and fro along a
    line, bang-bang in acceleration. The argument `actuator` chooses the drives.

    ## Action Space
    The action space is a `Box(-1, 1, (3,), float32)`: corrections of the joints' goals, which are the joint angles of the
    path, every 2 ms. The correction follows the action with a time constant of `correction_time`. Goals pass the
    actuation chain (digital PID, bridge, motor, gears with meshing friction) inside the physics engine.

    | Num | Action                  | Min | Max | Correction at -1 | Correction at 1 | Joint   | Type (Unit) |
    |-----|-------------------------|-----|-----|------------------|-----------------|---------|-------------|
    | 0   | correction of joint 1   | -1  | 1   | -0.004           | 0.004           | joint_1 | angle (rad) |
    | 1   | correction of joint 2   | -1  | 1   | -0.004           | 0.004           | joint_2 | angle (rad) |
    | 2   | correction of joint 3   | -1  | 1   | -0.004           | 0.004           | joint_3 | angle (rad) |

    Joint 1 turns the leg about the vertical, joint 2 lifts link 2 from the horizontal, joint 3 lifts link 3 from the
    line of link 2; goals stay within -1.2 to 1.2, -0.7 to 0.9 and -2.3 to -0.5 rad.

    ## Observation Space
    The observation space is a `Box(-Inf, Inf, (21,), float32)` of what the on-board computer knows; each row has all three
    joints, in order.

    | Num   | Observation                  | Source                                                           | Unit   |
    |-------|------------------------------|------------------------------------------------------------------|--------|
    | 0-2   | reference                    | path, `preview` ahead                                            | rad    |
    | 3-5   | reference speed              | path, over the next 10 ms                                        | rad/s  |
    | 6-8   | reference acceleration       | path, over the next 20 ms                                        | rad/s2 |
    | 9-11  | reference less reading       | motor encoder of the chain: its ticks, offset, scale and latency | rad    |
    | 12-14 | speed                        | difference of the reading over the last control step             | rad/s  |
    | 15-17 | correction                   | memory                                                           | rad    |
    | 18-20 | last action                  | memory                                                           | -      |

    ## Rewards
    The reward is ***tracking - energy***; `info` holds each term, and the flags `net_out_of_range` and `unstable` (see
    `HopperEnv`).

    - *reward_tracking*: $w_{tracking} (1 - \min(|p - p_{path}| / 0.001, 1))$ with the position $p$ of the foot [m].
    - *reward_energy*: $-w_{energy}$ times the mean power that the motors give [W].

    ## Starting State
    The leg is at rest at the start of the path, with uniform noise of $\pm$ `start_noise` rad on the joint angles. Start and
    end of the path are uniform in a box of 12 x 24 x 14 cm below the level of the first joint; the mean speed of the foot
    is drawn from `speed`. Then `randomization` is drawn.

    ## Episode End
    ### Termination
    Only if the simulation is unstable.

    ### Truncation
    After 400 steps (4 s).

    ## Arguments

    ## Version History
    * v0: initial version.
    """  # noqa: E501


class LegVectorEnv(BatchVectorEnv, task=LegTask):
    """Many :class:`LegEnv` side by side, with the same arguments."""
