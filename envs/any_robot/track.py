"""Follow joint trajectories: each coordinate a sum of two sines, new in every episode."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from scipy.optimize import minimize_scalar

from ...actuators import Drivetrain
from ..engine.batch import BatchEngine
from ..engine.task import Motion, option
from .task import AnyRobotTask, Numbers, columns

WAVES = 2
FIELDS = ("amplitude", "frequency", "phase")


@dataclass(frozen=True)
class TrackTask(AnyRobotTask):
    """The options of :class:`sealegs.envs.any_robot.env.TrackEnv`."""

    amplitude: float = option(0.8, "see Starting State")
    frequency: float | tuple[float, float] = option((0.2, 0.8), "of the sines, or from which to which", "Hz")
    preview: float = option(0.06, "how far ahead the later target is", "s")
    correction: float = option(0.2, "see Action Space")
    lead: float | None = option(None, "see Action Space [s]; `None`: measured")

    ranges = ("frequency",)
    per_joint = WAVES * len(FIELDS) + 1

    def observation_names(self) -> tuple[str, ...]:
        return self.named(
            ("target", "{unit}"),
            ("later target", "{unit}"),
            ("motor reading", "{unit}"),
            ("motor speed", "{unit}/s"),
            ("last action", "-"),
        )

    def commands(self, random: np.ndarray) -> np.ndarray:
        drawn = self.per_coordinate(random)
        low, high = np.broadcast_to(np.asarray(self.frequency, float), (2,))
        parts = []
        for wave in range(WAVES):
            size, rate, phase = (drawn[:, :, len(FIELDS) * wave + k] for k in range(len(FIELDS)))
            parts.append(self.amplitude * self.room / WAVES * (0.5 + 0.5 * size))  # the waves share it
            parts.append(low + (high - low) * rate)
            parts.append(2.0 * math.pi * phase)
        return columns(parts)

    def asked_names(self) -> tuple[str, ...]:
        return self.of_joints()

    def asked_range(self) -> tuple[np.ndarray, np.ndarray]:
        reach = self.amplitude * self.room
        return self.centre - reach, self.centre + reach

    def command_at(self, time: float, asked: Callable[[float], np.ndarray]) -> np.ndarray:
        """Waves that go through what is asked for now, in the preview and in the lead: all that the task looks at.

        The first wave stands still, the second swings about ``time``: three numbers for three places.
        """
        ahead = np.unique([0.0, self.preview, self.lead or 0.0])
        rate = 0.1 / max(ahead[-1], 1e-3)  # a tenth of a turn in that time: nearly a parabola
        turns = 2.0 * math.pi * rate * ahead
        shapes = np.stack([np.ones_like(turns), np.cos(turns), np.sin(turns)], axis=1)
        away = np.stack([asked(time + later) for later in ahead]) - self.centre
        still, cosine, sine = np.linalg.lstsq(shapes, away, rcond=None)[0]
        ones = np.ones(len(self.names))
        phase = np.arctan2(cosine, sine) - 2.0 * math.pi * rate * time
        return np.concatenate([still, 0.0 * ones, 0.5 * math.pi * ones, np.hypot(cosine, sine), rate * ones, phase])

    def asked_start(self, command: np.ndarray) -> np.ndarray:
        return self.target(np.zeros(1), command[None])[0]

    def target(self, time: np.ndarray, command: np.ndarray) -> np.ndarray:
        """Where the coordinates are asked to be (n, k) [rad or m], at times (n,) [s]."""
        count, turns = len(self.names), 2.0 * math.pi * time[:, None]
        total = self.centre
        for wave in range(WAVES):
            at = len(FIELDS) * wave * count
            size = command[:, at : at + count]
            rate = command[:, at + count : at + 2 * count]
            phase = command[:, at + 2 * count : at + 3 * count]
            total = total + size * np.sin(turns * rate + phase)
        return total

    def place(
        self, drivetrain: Drivetrain, numbers: Numbers, random: np.ndarray, qpos: np.ndarray, qvel: np.ndarray
    ) -> np.ndarray:
        del numbers
        noise = self.start_noise * self.half * (2.0 * self.per_coordinate(random)[:, :, -1] - 1.0)
        start = self.target(np.zeros(len(random)), self.commands(random)) + noise
        return self.placed(drivetrain, start, qpos, qvel)

    def reference(
        self, time: np.ndarray, command: np.ndarray, numbers: Numbers
    ) -> tuple[np.ndarray, np.ndarray] | None:
        del numbers
        if self.correction <= 0.0:
            return None
        return self.target(time + (self.lead or 0.0), command), self.correction * self.half

    def fitted(self, trial: Callable[[Self, int], Any]) -> Self:
        if self.lead is not None:
            return self
        if self.correction <= 0.0:
            return replace(self, lead=0.0)
        straight = replace(self, lead=0.0)
        return replace(self, lead=measured_lead(trial(straight, TRIALS), straight.target, self.half))

    def observe(self, motion: Motion) -> tuple[np.ndarray, ...]:
        m = motion
        now, later = self.target(m.time, m.command), self.target(m.time + self.preview, m.command)
        return now, later, m.reading, m.reading_speed, m.action

    def rewards(self, motion: Motion) -> dict[str, np.ndarray]:
        return self.closeness(motion, self.target(motion.time, motion.command))

    def errors(self, motion: Motion) -> dict[str, np.ndarray]:
        return self.away(motion, self.target(motion.time, motion.command))


# --- the lead of the goals, measured on the chains of the servos -----------------------------------------------------


TRIALS = 4  # trajectories
SETTLING_TIME, TRIAL_TIME = 0.5, 2.0  # [s] after which a trial counts, and that it lasts
LONGEST_LEAD = 0.5  # [s] sought


def measured_lead(
    engine: BatchEngine, target: Callable[[np.ndarray, np.ndarray], np.ndarray], half: np.ndarray
) -> float:
    """The time [s] by which the joints are behind goals that are the trajectory itself; delay, gain and load make it.

    Args:
        engine: of :data:`TRIALS` simulations in which goals at action 0 are the trajectory.
        target: the trajectory (n, k) [rad or m] at times (n,) [s], of commands (n, c).
        half: of each joint's range (k,) [rad or m].
    """
    engine.seed(0)
    engine.reset()
    still = np.zeros((TRIALS, len(engine.action_names)))
    times, links, command = [], [], engine.motion(still).command.copy()
    for _ in range(round(TRIAL_TIME / engine.dt)):
        if engine.step(still).flags["unstable"].any():
            return 0.0
        times.append(engine.steps * engine.dt)
        links.append(engine.motion(still).link)
    kept = slice(round(SETTLING_TIME / engine.dt), None)
    link = np.array(links)[kept]

    def squares(late: float) -> float:
        wanted = np.array([target(time - late, command) for time in times[kept]])
        error = (link - wanted) / half
        return float(((error - error.mean(axis=0)) ** 2).sum())  # where gravity holds a joint is not a time

    found: Any = minimize_scalar(squares, bounds=(0.0, LONGEST_LEAD), method="bounded")
    return round(float(found.x), 4)
