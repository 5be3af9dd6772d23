"""The hopper's task, hopping forward at a commanded speed, and its Gymnasium environments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...actuators import Drivetrain
from ..engine.task import Motion, Task, drawn, option
from ..engine.vector import BatchVectorEnv, SingleEnv
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


class HopperEnv(SingleEnv, task=HopperTask):
    r"""
    ## Description
    A one-legged robot of 0.587 kg with two series elastic actuators, the leg of paper 004 ("Practical Approach to
    Characterize Realistic Motor Dynamics for Robotic Simulation Independent of the Use Case"). Its base translates in
    the plane and does not rotate. Both motors sit in the base. One drives the upper link through a spring of 2 N.m/rad,
    the other the lower link through an equal spring and a belt. The task is to hop forward at a commanded speed. The
    argument `actuator` chooses the servo.

    ## Action Space
    The action space is a `Box(-1, 1, (2,), float32)`: position goals for the two servos. They go through the actuation
    chain (delay, controller, power stage, motor, friction, spring) inside the physics engine.

    | Num | Action        | Min | Max | Goal at -1 | Goal at 1 | Coordinate | Type (Unit)  |
    |-----|---------------|-----|-----|------------|-----------|------------|--------------|
    | 0   | Goal of hip   | -1  | 1   | -1.21      | -0.01     | hip        | angle (rad)  |
    | 1   | Goal of knee  | -1  | 1   | 0.01       | 1.21      | knee       | angle (rad)  |

    Angles are counter-clockwise from the vertical for a viewer who has forward to the right. The knee's angle is that of
    the lower link from the vertical, not relative to the upper link. The goals reach 0.6 rad to both sides of the rest
    angles (`hip_rest` and `knee_rest` of `params`).

    ## Observation Space
    The observation space is a `Box(-Inf, Inf, (14,), float32)` of what the on-board computer knows.

    | Num | Observation            | Source                                                            | Unit  |
    |-----|------------------------|-------------------------------------------------------------------|-------|
    | 0   | commanded speed        | command                                                           | m/s   |
    | 1   | height of the hip      | encoder of the boom that guides the base, ideal                   | m     |
    | 2   | angle of upper link    | link encoder, ideal                                               | rad   |
    | 3   | angle of lower link    | link encoder, ideal                                               | rad   |
    | 4   | angle of hip motor     | motor encoder of the chain: its ticks, offset, scale and latency  | rad   |
    | 5   | angle of knee motor    | as 4                                                              | rad   |
    | 6   | forward speed of base  | boom and inertial unit, ideal                                     | m/s   |
    | 7   | upward speed of base   | as 6                                                              | m/s   |
    | 8   | speed of upper link    | difference of 2 over the last control step                        | rad/s |
    | 9   | speed of lower link    | difference of 3                                                   | rad/s |
    | 10  | speed of hip motor     | difference of 4                                                   | rad/s |
    | 11  | speed of knee motor    | difference of 5                                                   | rad/s |
    | 12  | last action of hip     | memory                                                            | -     |
    | 13  | last action of knee    | memory                                                            | -     |

    With a chain without a series spring (`ideal`), motor and link have the same angle.

    ## Rewards
    The reward is ***forward + alive + height - energy***; `info` holds each term.

    - *reward_forward*: $w_{forward} \max(1 - |v - v_{cmd}| / \max(|v_{cmd}|, 0.1), -1)$ with the forward speed $v$ of the base.
    - *reward_alive*: `alive_weight` in every step.
    - *reward_height*: $w_{height}$ times the height of the foot above the floor, over 0.04 m, between 0 and 1.
    - *reward_energy*: $-w_{energy} \sum |\tau \omega|$ of the motors [W].

    `info` also holds `net_out_of_range` (samples of this episode in which an actuator net's input was outside its training
    data) and `unstable` (the simulation diverged; the episode ends).

    ## Starting State
    The hopper stands at its rest angles, (-0.61, 0.61) rad unless `params` has others. Springs are relaxed, and the foot is
    up to `start_noise` m above the floor. Angles [rad] and base speeds [m/s] have uniform noise of $\pm$ `start_noise`.
    The commanded speed is drawn if `speed` is a range. Then `randomization` is drawn.

    ## Episode End
    ### Termination
    The hip sinks below `healthy_height`, a link turns further than `healthy_angle` from the vertical, or the simulation
    is unstable.

    ### Truncation
    After 500 steps (10 s).

    ## Arguments

    `gymnasium.make_vec("SeaLegs/Hopper-v0", num_envs=64)` steps the simulations on all cores and starts new episodes in
    the same step; `sealegs.envs.engine.sb3.BatchVecEnv` does so for Stable-Baselines3. Equal seeds give bit-equal trajectories in
    all three.

    ## Version History
    * v0: initial version.
    """  # noqa: E501


class HopperVectorEnv(BatchVectorEnv, task=HopperTask):
    """Many :class:`HopperEnv` side by side, with the same arguments."""
