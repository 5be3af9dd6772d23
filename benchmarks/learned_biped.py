"""The learned walk of the biped: its training, and what is measured of a policy. See ``benchmarks/learning.py``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import biped_motion
from benchmarks.biped_motion import SECONDS, STARTS, Act, Moment, load, moments, reference_gait
from benchmarks.learning import Bar

TRAINING = ("env=biped", "video.seconds=0")
COMMANDS = (0.4, 0.6, 0.8, 1.0)  # [m/s]
HEIGHT, SLIP, ALIKE = 30.0, 0.05, 0.2  # [mm] of both feet's swings, of the way, of the higher foot: what a gait is
JUDGED, SPEED = 0.6, 0.5  # [m/s] the command that the walk of a minute is judged at, and what it must reach


def reference() -> dict[str, float]:
    """The gait that the policies correct, with nobody to correct it."""
    return walks(*reference_gait(TRAINING))


def measure(policy: Path) -> dict[str, float]:
    """Walks of a policy with the drives that it was trained with, at the robot's own time step."""
    return walks(*load(policy))


def walks(env: dict[str, Any], actuator: Any, act: Act) -> dict[str, float]:
    """Figures at every command."""
    figures: dict[str, float] = {}
    for command in COMMANDS:
        found = walk({**env, "speed": command}, actuator, act)
        at = f"at {command:g} m/s"
        figures |= {f"falls {at}": found.pop("falls"), f"speed {at} [m/s]": found.pop("speed [m/s]")}
        figures |= {f"{name} {at}": value for name, value in found.items()} if command == JUDGED else {}
    return figures


def walk(
    env: dict[str, Any], actuator: Any, act: Act, starts: int = STARTS, seconds: float = SECONDS
) -> dict[str, float]:
    """Figures of a walk; who has fallen stands still from there on."""
    upright, feet = np.ones(starts, bool), np.zeros(3)
    lasted, way = np.zeros(starts), np.zeros(starts)
    steps = Steps(starts)
    for moment in moments(env, actuator, act, starts, seconds):
        upright = moment.upright
        steps.see(moment)
        lasted += upright * moment.dt
        way = np.where(upright, moment.forward, way)
        feet += np.bincount(moment.down[upright].sum(axis=1), minlength=3)
    return {
        "falls": float((~upright).sum()),
        "speed [m/s]": float((way / seconds).mean()),
        "shortest [s]": float(lasted.min()),
        "slowest [m/s]": float((way / seconds).min()),
        "share on one foot": float(feet[1] / feet.sum()),
        "share in the air": float(feet[0] / feet.sum()),
        **steps.figures(way),
    }


class Steps:
    """What tells a walk from a shuffle: how high each foot swings, how far it slides, and whether both do alike."""

    def __init__(self, starts: int) -> None:
        self._top, self._slid = np.zeros((starts, 2)), np.zeros((starts, 2))
        self._before: Moment | None = None
        self._peaks: tuple[list[float], list[float]] = ([], [])

    def see(self, moment: Moment) -> None:
        """The bipeds after a control step."""
        down = moment.down
        for k, side in enumerate(self._peaks):
            landed = moment.upright & down[:, k] & (self._top[:, k] > 0.0)
            side += self._top[landed, k].tolist()
        self._top = np.where(down, 0.0, np.maximum(self._top, moment.clearance))
        if self._before is not None:
            stood = down & self._before.down & moment.upright[:, None]
            self._slid += np.where(stood, np.abs(moment.places - self._before.places), 0.0)
        self._before = moment

    def figures(self, way: np.ndarray) -> dict[str, float]:
        """Median height of each foot's swings [mm], each foot's slip over the way, and how far both heights differ."""
        heights = [1e3 * float(np.median(side)) if side else 0.0 for side in self._peaks]
        slips = self._slid.sum(axis=0) / max(float(np.abs(way).sum()), 1e-6)
        return {
            "left swings, median [mm]": heights[0],
            "right swings, median [mm]": heights[1],
            "left slip over the way": float(slips[0]),
            "right slip over the way": float(slips[1]),
            "heights differ by": 1.0 - min(heights) / max(*heights, 1e-6),
        }


def is_a_gait(row: dict[str, float]) -> bool:
    """Whether both feet swing over :data:`HEIGHT`, slide less than :data:`SLIP` of the way, and swing alike."""
    at = f"at {JUDGED:g} m/s"
    heights = [row[f"{side} swings, median [mm] {at}"] for side in ("left", "right")]
    slips = [row[f"{side} slip over the way {at}"] for side in ("left", "right")]
    return min(heights) > HEIGHT and max(slips) < SLIP and row[f"heights differ by {at}"] < ALIKE


def draw(policy: Path, file: Path) -> None:
    """Pictures of two steps."""
    biped_motion.draw(policy, file, JUDGED)


def bars(rows: Sequence[dict[str, float]], reference: dict[str, float]) -> list[Bar]:
    """Every seed's policy walks for a minute, from every start, and as fast as it is told to."""
    del reference
    walked = sum(
        row[f"falls at {JUDGED:g} m/s"] == 0.0 and row[f"slowest [m/s] at {JUDGED:g} m/s"] >= SPEED for row in rows
    )
    falls = sum(row[f"falls at {command:g} m/s"] for row in rows for command in COMMANDS)
    off = [abs(row[f"speed at {command:g} m/s [m/s]"] / command - 1.0) for row in rows for command in COMMANDS]
    return [
        Bar(
            f"each seed: {SECONDS:g} s without a fall at {SPEED:g} m/s or more, from each of {STARTS} starts, "
            f"when told to walk at {JUDGED:g} m/s",
            f"{walked} of {len(rows)} seeds",
            walked == len(rows),
        ),
        Bar(
            f"each seed: both feet swing over {HEIGHT:g} mm, slide less than {SLIP:.0%} of the way, and swing alike "
            f"within {ALIKE:.0%}, when told to walk at {JUDGED:g} m/s",
            f"{sum(map(is_a_gait, rows))} of {len(rows)} seeds",
            all(map(is_a_gait, rows)),
        ),
        Bar("no fall at any command", f"{falls:.0f} of {STARTS * len(off)} walks", falls == 0.0),
        Bar(
            "within 20 % of the command, every seed at every command",
            f"{np.mean(off):.0%} off in the mean, {max(off):.0%} at most",
            max(off) <= 0.2,
        ),
    ]
