"""The flexible-joint arm's task, leading the tool along the paper's line, and its Gymnasium environments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from ...actuators import Drivetrain
from ..engine.task import Motion, Task, drawn, option
from ..engine.vector import BatchVectorEnv, SingleEnv
from .kinematics import Lengths, tool
from .robot import ARM
from .tables import JOINTS
from .trajectory import Line

REACH = np.array([0.02, 0.02, 0.02])  # [rad] that a correction of 1 moves the goals by
FINE = 5e-4  # [m] error at which the fine part of the reward has fallen to a third


@cache
def line_of(lengths: Lengths) -> Line:
    """The line in one second, for arms of these lengths."""
    return Line(seconds=1.0, lengths=lengths)


def lengths_of(numbers: Mapping[str, float]) -> Lengths:
    """Lengths of a robot with these numbers."""
    return Lengths(numbers["height"], numbers["upper_length"], numbers["fore_length"])


@dataclass(frozen=True)
class ArmTask(Task):
    """The options of :class:`sealegs.envs.arm.env.ArmEnv`."""

    seconds: float | Sequence[float] = option(5.0, "duration of the line, or the range it is drawn from", "s")
    correction: float = option(1.0, "how far actions correct the goals; 0: actions are goals")
    lead: float = option(0.06, "time by which goals run ahead of the line", "s")
    tracking_weight: float = 1.0
    fine_weight: float = 1.0
    smooth_weight: float = 0.05
    tracking_range: float = option(0.005, "error at which *reward_tracking* is zero", "m")
    largest_error: float = option(0.15, "see Termination", "m")
    start_noise: float = option(5e-4, "see Starting State", "rad")

    robot = ARM
    draws = 4
    ranges = ("seconds",)
    control_rate = 100.0

    def observation_names(self) -> tuple[str, ...]:
        return (
            "share of the time",
            *(f"{name} wanted [rad]" for name in JOINTS),
            *(f"{name} wanted speed [rad/s]" for name in JOINTS),
            *(f"{name} wanted acceleration [rad/s2]" for name in JOINTS),
            *(f"{name} link, less wanted [rad]" for name in JOINTS),
            *(f"{name} motor reading, less wanted [rad]" for name in JOINTS),
            *(f"{name} link speed, less wanted [rad/s]" for name in JOINTS),
            *(f"{name} motor speed, less wanted [rad/s]" for name in JOINTS),
            *(f"last {name} action" for name in JOINTS),
        )

    def asked_names(self) -> tuple[str, ...]:
        return ("way [s]",)

    def commands(self, random: np.ndarray) -> np.ndarray:
        return drawn(self.seconds, random[:, :1])

    def place(
        self,
        drivetrain: Drivetrain,
        numbers: Mapping[str, float],
        random: np.ndarray,
        qpos: np.ndarray,
        qvel: np.ndarray,
    ) -> np.ndarray:
        del numbers, qvel
        angles = self.start_noise * (2.0 * random[:, 1:] - 1.0)
        for k, name in enumerate(JOINTS):
            drivetrain.set_position(name, qpos, angles[:, k])
        return angles

    def wanted(
        self, time: np.ndarray, command: np.ndarray, numbers: Mapping[str, float]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Joint angles [rad], speeds [rad/s] and accelerations [rad/s2] on the line, (n, 3) each."""
        seconds = command[:, :1]
        place, speed, acceleration = line_of(lengths_of(numbers)).joints(time / seconds[:, 0])
        return place, speed / seconds, acceleration / seconds**2

    def reference(
        self, time: np.ndarray, command: np.ndarray, numbers: Mapping[str, float]
    ) -> tuple[np.ndarray, np.ndarray] | None:
        if self.correction == 0.0:
            return None
        place, speed, _ = self.wanted(time, command, numbers)
        return place + self.lead * speed, self.correction * REACH

    def observe(self, motion: Motion) -> tuple[np.ndarray, ...]:
        m = motion
        place, speed, acceleration = self.wanted(m.time, m.command, m.numbers)
        return (
            m.time / m.command[:, 0],
            place,
            speed,
            acceleration,
            m.link - place,
            m.reading - place,
            m.link_speed - speed,
            m.reading_speed - speed,
            m.action,
        )

    def error(self, motion: Motion) -> np.ndarray:
        """Distance of the tool from its place on the line (n,) [m]."""
        place, _, _ = self.wanted(motion.time, motion.command, motion.numbers)
        lengths = lengths_of(motion.numbers)
        return np.sqrt(np.sum(np.square(tool(motion.link, lengths) - tool(place, lengths)), axis=1))

    def rewards(self, motion: Motion) -> dict[str, np.ndarray]:
        error = self.error(motion)
        change = np.square(motion.action - motion.previous_action)
        return {
            "reward_tracking": self.tracking_weight * (1.0 - np.minimum(error / self.tracking_range, 1.0)),
            "reward_fine": self.fine_weight * np.exp(-error / FINE),
            "reward_smooth": -self.smooth_weight * (change[:, 0] + change[:, 1] + change[:, 2]),
        }

    def failed(self, motion: Motion) -> np.ndarray:
        return self.error(motion) > self.largest_error


class ArmEnv(SingleEnv, task=ArmTask):
    r"""
    ## Description
    An arm of three links of 8.9 kg without gravity, the SRLFJ of paper 002 ("Joints flexibility effect on the dynamic
    performance of robots"). Each joint has a spring between rotor and link and a damper between rotor and stator; the
    rotors are bodies of their own. The task is to move the tool along the paper's straight line, from the stretched arm
    to (-0.033, -0.372, 0.818) m in 5 s. The argument `actuator` chooses the servos.

    ## Action Space
    The action space is a `Box(-1, 1, (3,), float32)`: corrections of the servos' position goals. The goal at action 0 is
    the joint angle on the line, plus `lead` times its speed. Goals pass the actuation chain (controller, motor,
    friction, spring) inside the physics engine.

    | Num | Action               | Min | Max | Change of the goal at 1 | Coordinate | Type (Unit) |
    |-----|----------------------|-----|-----|-------------------------|------------|-------------|
    | 0   | Correction of joint1 | -1  | 1   | 0.02 x `correction`     | joint1     | angle (rad) |
    | 1   | Correction of joint2 | -1  | 1   | 0.02 x `correction`     | joint2     | angle (rad) |
    | 2   | Correction of joint3 | -1  | 1   | 0.02 x `correction`     | joint3     | angle (rad) |

    Angles are those of table I. With a `correction` of 0 the actions are goals, from -1 to 1 over (-pi, pi), (-0.5, 1.5)
    and (-0.5, 2.5) rad.

    ## Observation Space
    The observation space is a `Box(-Inf, Inf, (25,), float32)` of what the on-board computer knows.

    | Num     | Observation                           | Source                                                | Unit   |
    |---------|---------------------------------------|-------------------------------------------------------|--------|
    | 0       | elapsed share of the line's time      | clock                                                 | -      |
    | 1 - 3   | wanted angles of joints 1 to 3        | the line                                              | rad    |
    | 4 - 6   | wanted speeds                         | the line                                              | rad/s  |
    | 7 - 9   | wanted accelerations                  | the line                                              | rad/s2 |
    | 10 - 12 | angles of the links, less wanted      | link encoders, ideal                                  | rad    |
    | 13 - 15 | angles of the motors, less wanted     | motor encoder of the chain: its ticks, offset, scale  | rad    |
    | 16 - 18 | speeds of the links, less wanted      | differences of the link encoders                      | rad/s  |
    | 19 - 21 | speeds of the motors, less wanted     | differences of the motor encoders                     | rad/s  |
    | 22 - 24 | last actions                          | memory                                                | -      |

    ## Rewards
    The reward is ***tracking + fine + smooth***; `info` holds each term. $e$ is the distance of the tool from its place
    on the line, from the link encoders.

    - *reward_tracking*: $w_{tracking} (1 - \min(e / e_{range}, 1))$.
    - *reward_fine*: $w_{fine} \exp(-e / 0.5\,mm)$.
    - *reward_smooth*: $-w_{smooth} \sum (a_t - a_{t-1})^2$.

    `info` also holds `net_out_of_range` (samples of this episode in which an actuator net's input was outside its training
    data) and `unstable` (the simulation diverged; the episode ends).

    ## Starting State
    The arm is stretched and at rest, each joint off by up to `start_noise` rad; the goals are the joint angles. The
    duration of the line is drawn if `seconds` is a range. Then `randomization` is drawn.

    ## Episode End
    ### Termination
    The tool is further than `largest_error` from its place, or the simulation is unstable.

    ### Truncation
    After 500 steps (5 s).

    ## Arguments

    `gymnasium.make_vec("SeaLegs/Arm-v0", num_envs=64)` steps the simulations on all cores and starts new episodes in
    the same step; `sealegs.envs.engine.sb3.BatchVecEnv` does so for Stable-Baselines3. Equal seeds give bit-equal trajectories in
    all three.

    ## Version History
    * v0: initial version.
    """  # noqa: E501


class ArmVectorEnv(BatchVectorEnv, task=ArmTask):
    """Many :class:`ArmEnv` side by side, with the same arguments."""
