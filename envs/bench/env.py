"""The bench's task, to bring the pendulum to an angle and hold it there, and its Gymnasium environments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...actuators import Drivetrain
from ..engine.task import Motion, Task, option
from ..engine.vector import BatchVectorEnv, SingleEnv
from .robot import BENCH, JOINT


@dataclass(frozen=True)
class BenchTask(Task):
    """The options of :class:`sealegs.envs.bench.env.BenchEnv`."""

    target_range: float = option(1.2, "see Starting State", "rad")
    tracking_weight: float = 1.0
    energy_weight: float = option(0.02, "see Rewards", "1/W")
    start_noise: float = option(0.2, "see Starting State")

    robot = BENCH
    draws = 3

    def observation_names(self) -> tuple[str, ...]:
        return (
            "target [rad]",
            "link angle [rad]",
            "motor reading [rad]",
            "link speed [rad/s]",
            "motor speed [rad/s]",
            "last action",
        )

    def asked_names(self) -> tuple[str, ...]:
        return (f"{JOINT} [rad]",)

    def commands(self, random: np.ndarray) -> np.ndarray:
        return self.target_range * (2.0 * random[:, :1] - 1.0)

    def place(
        self,
        drivetrain: Drivetrain,
        numbers: Mapping[str, float],
        random: np.ndarray,
        qpos: np.ndarray,
        qvel: np.ndarray,
    ) -> np.ndarray:
        del numbers
        angle = self.start_noise * (2.0 * random[:, 1] - 1.0)
        drivetrain.set_position(JOINT, qpos, angle)
        qvel[:] = (self.start_noise * (2.0 * random[:, 2] - 1.0))[:, None]
        return angle[:, None]

    def observe(self, motion: Motion) -> tuple[np.ndarray, ...]:
        m = motion
        return m.command, m.link, m.reading, m.link_speed, m.reading_speed, m.action

    def rewards(self, motion: Motion) -> dict[str, np.ndarray]:
        error = np.abs(motion.link[:, 0] - motion.command[:, 0])
        power = np.abs(motion.torque[:, 0] * motion.motor_speed[:, 0])
        return {
            "reward_tracking": self.tracking_weight * (1.0 - np.minimum(error, 1.0)),
            "reward_energy": -self.energy_weight * power,
        }

    def failed(self, motion: Motion) -> np.ndarray:
        return np.zeros(len(motion.qpos), dtype=bool)


class BenchEnv(SingleEnv, task=BenchTask):
    r"""
    ## Description
    A servo on a stand turns a pendulum, a point mass at the end of a uniform rod. The task is to bring the pendulum to
    an angle and to hold it there, against gravity and the imperfections of the actuation chain.

    ## Action Space
    The action space is a `Box(-1, 1, (1,), float32)`: the position goal of the servo.

    | Num | Action            | Min | Max | Goal at -1 | Goal at 1 | Coordinate | Type (Unit) |
    |-----|-------------------|-----|-----|------------|-----------|------------|-------------|
    | 0   | Goal of the servo | -1  | 1   | -3.1416    | 3.1416    | joint      | angle (rad) |

    ## Observation Space
    The observation space is a `Box(-Inf, Inf, (6,), float32)`. Angles are counter-clockwise; at 0 the pendulum hangs.

    | Num | Observation        | Source                                                           | Unit  |
    |-----|--------------------|------------------------------------------------------------------|-------|
    | 0   | target             | command                                                          | rad   |
    | 1   | angle of pendulum  | link encoder, ideal                                              | rad   |
    | 2   | angle of motor     | motor encoder of the chain: its ticks, offset, scale and latency | rad   |
    | 3   | speed of pendulum  | difference of 1 over the last control step                       | rad/s |
    | 4   | speed of motor     | difference of 2 over the last control step                       | rad/s |
    | 5   | last action        | memory                                                           | -     |

    ## Rewards
    The reward is ***tracking - energy***; `info` holds each term, and the flags `net_out_of_range` and `unstable` (see
    `HopperEnv`).

    - *reward_tracking*: $w_{tracking} (1 - \min(|q - q_{target}|, 1))$.
    - *reward_energy*: $-w_{energy} |\tau \omega|$ of the motor [W].

    ## Starting State
    The pendulum hangs; its angle [rad] and speed [rad/s] have uniform noise of $\pm$ `start_noise`. The target is uniform in
    $\pm$ `target_range`. Then `randomization` is drawn.

    ## Episode End
    ### Termination
    Only if the simulation is unstable.

    ### Truncation
    After 250 steps (5 s).

    ## Arguments

    ## Version History
    * v0: initial version.
    """  # noqa: E501


class BenchVectorEnv(BatchVectorEnv, task=BenchTask):
    """Many :class:`BenchEnv` side by side, with the same arguments."""
