"""What each learned robot is trained with, measured by, and to reach; for ``python -m benchmarks.learning``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np
from sealegs.agents.config import TrainConfig, read_config
from sealegs.agents.policy_files import load_policy
from sealegs.envs.hexapod.env import HexapodTask

from benchmarks.rollouts import (
    COMMANDED,
    EPISODES,
    HIGH,
    SECONDS,
    SPEED,
    STARTS,
    TOOL_STARTS,
    WINDOW,
    Act,
    at_own_step,
    begin,
    foot_errors,
    hops,
    still,
    tool_errors,
    walk,
    walked,
)

Figures = dict[str, float]
OTHERS = ("ideal", "regression", "net")  # actuator models that no policy was trained with
GAIT = still(len(HexapodTask().action_names()))  # the hexapod's reference, with nobody to correct it


@dataclass(frozen=True)
class Bar:
    """A figure to be reached: in words, what came out, and whether it is reached."""

    wanted: str
    found: str
    holds: bool


def asked(training: Sequence[str]) -> TrainConfig:
    """The config that arguments of ``train.py`` make."""
    config = read_config(training).config
    assert config is not None
    return config


class Learned(Protocol):
    """A robot that learns.

    Attributes:
        training: arguments of ``train.py``, without seed, name and out.
    """

    training: ClassVar[Sequence[str]]

    def reference(self) -> Figures:
        """Figures of the reference controller, named with their units; its ``reward``, if any, is drawn."""
        ...

    def measure(self, policy: Path) -> Figures:
        """The same figures of a policy, with the drives that it was trained with."""
        ...

    def bars(self, rows: Sequence[Figures], reference: Figures) -> list[Bar]:
        """What is to be reached, given the figures of all seeds."""
        ...


class Leg:
    """The learned leg beside the best PID: both lead the foot along the same random paths with the printed drives.

    The PID is that of ``configs/actuator/silo4.yaml``, tuned by ``papers/leg/tuning.py``; the policy corrects the goals
    of a stiff PD (``silo4_pd``). Goals reach the firmware of both every 2 ms.
    """

    training: ClassVar[Sequence[str]] = ("env=leg", "actuator=silo4_pd", "video.seconds=0")
    most = 0.7  # of the best PID's error

    def reference(self) -> Figures:
        return self._figures({"id": "SeaLegs/Leg-v0"}, "silo4", still(3))

    def measure(self, policy: Path) -> Figures:
        act, description = load_policy(policy)
        alone = self._figures(description["env"], description["actuators"], still(3))
        found = self._figures(description["env"], description["actuators"], act)
        return found | {"without the policy, rms error [mm]": alone["rms error [mm]"]}

    def bars(self, rows: Sequence[Figures], reference: Figures) -> list[Bar]:
        share = np.array([row["rms error [mm]"] for row in rows]) / reference["rms error [mm]"]
        return [
            Bar(
                f"every seed: at most {self.most:.0%} of the best PID's {reference['rms error [mm]']:.4f} mm",
                f"{share.min():.0%} to {share.max():.0%}",
                bool(share.max() <= self.most),
            )
        ]

    def _figures(self, env: dict[str, Any], actuator: Any, act: Act) -> Figures:
        error, rewards = foot_errors(env, actuator, act)
        each = np.sqrt(np.mean(np.square(error), axis=0))
        return {
            "rms error [mm]": float(np.sqrt(np.mean(np.square(error)))),
            "median path [mm]": float(np.median(each)),
            "largest error [mm]": float(error.max()),
            "reward": float(rewards.mean()),
        }


class Arm:
    """The learned arm beside the reference that it corrects: all lead the tool along the paper's line in 5 s.

    What counts is the largest distance of the tool from its place, at every control step, from the true angles of the
    links.
    """

    training: ClassVar[Sequence[str]] = ("env=arm", "video.seconds=0")
    most = 1.0  # [mm]

    def reference(self) -> Figures:
        config = asked(self.training)
        found = self._figures(config.env, config.actuator, still(3))
        bare = self._figures({**config.env, "lead": 0.0}, config.actuator, still(3))
        return found | {"largest error without lead [mm]": bare["largest error [mm]"]}

    def measure(self, policy: Path) -> Figures:
        act, description = load_policy(policy)
        found = self._figures(description["env"], description["actuators"], act)
        for word in OTHERS:
            other = self._figures(description["env"], word, act)
            found[f"largest error with {word} [mm]"] = other["largest error [mm]"]
        return found

    def bars(self, rows: Sequence[Figures], reference: Figures) -> list[Bar]:
        errors = np.array([row["largest error [mm]"] for row in rows])
        return [
            Bar(
                f"every seed: largest error of the tool under {self.most:g} mm, from each of {TOOL_STARTS} starts",
                f"{errors.min():.2f} to {errors.max():.2f} mm (reference {reference['largest error [mm]']:.2f} mm)",
                bool(errors.max() < self.most),
            )
        ]

    def _figures(self, env: dict[str, Any], actuator: Any, act: Act) -> Figures:
        errors, rewards = tool_errors(env, actuator, act)
        return {
            "largest error [mm]": float(errors.max()),
            "median start's largest error [mm]": float(np.median(errors.max(axis=0))),
            "rms error [mm]": float(np.sqrt(np.mean(np.square(errors)))),
            "error at the end [mm]": float(errors[-1].max()),
            "reward": float(rewards.mean()),
        }


class Biped:
    """A biped at the robot's own time step, whatever its training took."""

    training: ClassVar[Sequence[str]] = ("env=biped", "video.seconds=0")
    commands = (0.4, 0.6, 0.8, 1.0)  # [m/s]
    judged, speed = 0.6, 0.5  # [m/s] the command that the walk of a minute is judged at, and what it must reach
    height, slip, alike = 30.0, 0.05, 0.2  # [mm] of both feet's swings, of the way, of the higher foot: what a gait is

    def reference(self) -> Figures:
        config = asked(self.training)
        return self.figures(at_own_step(config.env), config.actuator, still(4))

    def measure(self, policy: Path) -> Figures:
        act, description = load_policy(policy)
        return self.figures(at_own_step(description["env"]), description["actuators"], act)

    def figures(self, env: dict[str, Any], actuator: Any, act: Act) -> Figures:
        """Of a walk at every command."""
        figures: Figures = {}
        for command in self.commands:
            found = walk({**env, "speed": command}, actuator, act)
            at = f"at {command:g} m/s"
            figures |= {f"falls {at}": found.pop("falls"), f"speed {at} [m/s]": found.pop("speed [m/s]")}
            figures |= {f"{name} {at}": value for name, value in found.items()} if command == self.judged else {}
        return figures

    def is_a_gait(self, row: Figures) -> bool:
        """Whether both feet swing over :attr:`height`, slide less than :attr:`slip` of the way, and swing alike."""
        at = f"at {self.judged:g} m/s"
        heights = [row[f"{side} swings, median [mm] {at}"] for side in ("left", "right")]
        slips = [row[f"{side} slip over the way {at}"] for side in ("left", "right")]
        return min(heights) > self.height and max(slips) < self.slip and row[f"heights differ by {at}"] < self.alike

    def bars(self, rows: Sequence[Figures], reference: Figures) -> list[Bar]:
        del reference
        at = f"{self.judged:g} m/s"
        lasted = sum(row[f"falls at {at}"] == 0.0 and row[f"slowest [m/s] at {at}"] >= self.speed for row in rows)
        falls = sum(row[f"falls at {command:g} m/s"] for row in rows for command in self.commands)
        off = [abs(row[f"speed at {c:g} m/s [m/s]"] / c - 1.0) for row in rows for c in self.commands]
        return [
            Bar(
                f"each seed: {SECONDS:g} s without a fall at {self.speed:g} m/s or more, from each of {STARTS} starts, "
                f"when told to walk at {at}",
                f"{lasted} of {len(rows)} seeds",
                lasted == len(rows),
            ),
            Bar(
                f"each seed: both feet swing over {self.height:g} mm, slide less than {self.slip:.0%} of the way, and "
                f"swing alike within {self.alike:.0%}, when told to walk at {at}",
                f"{sum(map(self.is_a_gait, rows))} of {len(rows)} seeds",
                all(map(self.is_a_gait, rows)),
            ),
            Bar("no fall at any command", f"{falls:.0f} of {STARTS * len(off)} walks", falls == 0.0),
            Bar(
                "within 20 % of the command, every seed at every command",
                f"{np.mean(off):.0%} off in the mean, {max(off):.0%} at most",
                max(off) <= 0.2,
            ),
        ]


class Hopping(Biped):
    """The biped that hops, as often as the paper's controller did in its run (paper 003, VIII-C)."""

    training: ClassVar[Sequence[str]] = ("env=biped_hopping", "video.seconds=0")
    least = 92  # hops

    def figures(self, env: dict[str, Any], actuator: Any, act: Act) -> Figures:
        """Of attempts to hop for a minute."""
        found = hops(env, actuator, act)
        lasted = found.lasted
        return {
            "falls": float((~found.upright).sum()),
            "shortest [s]": float(lasted.min()),
            "fewest hops": float(found.count.min()),
            "hops per second": float(found.count.sum() / lasted.sum()),
            "height of a hop, median [mm]": 1e3 * float(np.median(found.heights)) if found.heights else 0.0,
            "share in the air": float(found.air.sum() / lasted.sum()),
            "mean speed [m/s]": float((found.way / SECONDS).mean()),
        }

    def bars(self, rows: Sequence[Figures], reference: Figures) -> list[Bar]:
        del reference
        upright = sum(row["falls"] == 0.0 for row in rows)
        often = sum(row["falls"] == 0.0 and row["fewest hops"] >= self.least for row in rows)
        return [
            Bar(
                f"each seed: {SECONDS:g} s without a fall, from each of {STARTS} starts",
                f"{upright} of {len(rows)} seeds",
                upright == len(rows),
            ),
            Bar(
                f"each seed: {self.least} hops in that time, both soles {1e3 * HIGH:g} mm off the floor in each",
                f"{often} of {len(rows)} seeds",
                often == len(rows),
            ),
        ]


class Hexapod:
    """The learned hexapod beside the reference gait, both with the printed chain (LuGre joint friction).

    They walk in the same simulations, started alike: the reference gait is the action 0. Energy and way count after the
    start.
    """

    training: ClassVar[Sequence[str]] = ("env=hexapod", "video.seconds=0")
    most = 0.8  # of the reference gait's specific resistance

    def reference(self) -> Figures:
        """Of the reference gait, and the reward of an episode as in training."""
        config = asked(self.training)
        found = self._figures(config.env, config.actuator, GAIT, SPEED)
        engine = begin({**config.env, "speed": SPEED}, config.actuator, EPISODES, 2000)
        seen, total = engine.reset(), np.zeros(EPISODES)
        for _ in range(30):
            step = engine.step(GAIT(seen))
            seen, total = step.observation, total + step.reward
        return found | {"reward": float(total.mean())}

    def measure(self, policy: Path) -> Figures:
        act, description = load_policy(policy)
        return self._figures(description["env"], description["actuators"], act, COMMANDED)

    def bars(self, rows: Sequence[Figures], reference: Figures) -> list[Bar]:
        """What issue 4 asks for, of the best seed and of all."""
        resistance, speed = (np.array([row[name] for row in rows]) for name in ("specific resistance", "speed [cm/s]"))
        share = resistance / reference["specific resistance"]
        best, wanted = int(np.argmin(share)), reference["speed [cm/s]"]
        return [
            Bar(
                f"the best seed: at most {self.most:.0%} of the reference gait's specific resistance, at its "
                f"{wanted:.3f} cm/s",
                f"seed {best}: {share[best]:.1%} at {speed[best]:.3f} cm/s",
                bool(share[best] <= self.most and speed[best] >= wanted),
            ),
            Bar(
                f"every seed: at most {self.most:.0%} of its specific resistance",
                f"{share.min():.1%} to {share.max():.1%}",
                bool(share.max() <= self.most),
            ),
            Bar(
                f"every seed: at least its speed, {wanted:.3f} cm/s",
                f"{speed.min():.3f} to {speed.max():.3f} cm/s",
                bool(speed.min() >= wanted),
            ),
            Bar(
                "every seed: no fall",
                f"{sum(row['falls'] for row in rows):.0f} falls",
                all(row["falls"] == 0.0 for row in rows),
            ),
        ]

    def _figures(self, env: dict[str, Any], actuator: Any, act: Act, speed: float) -> Figures:
        found = walked(env, actuator, act, speed)
        way = found.way
        return {
            "specific resistance": float(found.resistance.mean()),
            "largest of an episode": float(found.resistance.max()),
            "speed [cm/s]": float(100.0 * way[:, 0].mean() / WINDOW),
            "to the side [cm/m]": float(100.0 * np.abs(way[:, 1] / way[:, 0]).max()),
            "falls": float(found.fallen.sum()),
        }


LEARNED: Mapping[str, Learned] = {
    "hexapod": Hexapod(),
    "biped": Biped(),
    "biped_hopping": Hopping(),
    "leg": Leg(),
    "arm": Arm(),
}
