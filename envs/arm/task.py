"""Lead the tool along the paper's straight line, with joints that give way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from ...actuators import Drivetrain
from ..engine.task import Motion, Task, drawn, option
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
