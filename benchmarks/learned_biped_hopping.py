"""The learned hopping of the biped: its training, and what is measured of it. See ``benchmarks/learning.py``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import biped_motion
from benchmarks.biped_motion import SECONDS, SEED, STARTS, Act, load, moments, reference_gait
from benchmarks.learning import Bar

TRAINING = ("env=biped_hopping", "video.seconds=0")
HIGH = 0.005  # [m] that both soles must leave the floor by in a hop; lower, they may have bounced
HOPS, SPEED = 92, 0.3  # what the paper's controller did (paper 003, VIII-C); commanded speed of the pictures [m/s]


def reference() -> dict[str, float]:
    """The gait that the policy corrects, with nobody to correct it."""
    return hops(*reference_gait(TRAINING))


def measure(policy: Path) -> dict[str, float]:
    """Hopping of a policy with the drives that it was trained with, at the robot's own time step."""
    return hops(*load(policy))


@dataclass(frozen=True)
class Attempts:
    """Attempts to hop: who is upright at the end, how long each lasted and was in the air [s], its way [m] and its
    hops, all (n,); heights of all hops [m]."""

    upright: np.ndarray
    lasted: np.ndarray
    air: np.ndarray
    way: np.ndarray
    count: np.ndarray
    heights: list[float]


def attempts(
    env: dict[str, Any],
    actuator: Any,
    act: Act,
    starts: int = STARTS,
    seconds: float = SECONDS,
    seed: int | Sequence[int] = SEED,
) -> Attempts:
    """Hop from ``starts`` starts for ``seconds`` [s], each until it falls."""
    upright = np.ones(starts, bool)
    lasted, way, air, highest, count = (np.zeros(starts) for _ in range(5))
    heights: list[float] = []
    for moment in moments(env, actuator, act, starts, seconds, seed):
        upright = moment.upright
        lasted += upright * moment.dt
        way = np.where(upright, moment.forward, way)
        lower = moment.clearance.min(axis=1)
        flying = upright & ~moment.down.any(axis=1)
        air += flying * moment.dt
        landed = upright & ~flying & (highest >= HIGH)
        count += landed
        heights += list(highest[landed])
        highest = np.where(flying, np.maximum(highest, lower), 0.0)
    return Attempts(upright, lasted, air, way, count, heights)


def hops(env: dict[str, Any], actuator: Any, act: Act) -> dict[str, float]:
    """Figures of ``STARTS`` attempts to hop for ``SECONDS``."""
    found = attempts(env, actuator, act)
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


def draw(policy: Path, file: Path) -> None:
    """Pictures of a hop."""
    biped_motion.draw(policy, file, SPEED)


def bars(rows: Sequence[dict[str, float]], reference: dict[str, float]) -> list[Bar]:
    """It hops on for a minute, as often as the paper's controller did in its run."""
    del reference
    upright = sum(row["falls"] == 0.0 for row in rows)
    often = sum(row["falls"] == 0.0 and row["fewest hops"] >= HOPS for row in rows)
    return [
        Bar(
            f"each seed: {SECONDS:g} s without a fall, from each of {STARTS} starts",
            f"{upright} of {len(rows)} seeds",
            upright == len(rows),
        ),
        Bar(
            f"each seed: {HOPS} hops in that time, both soles {1e3 * HIGH:g} mm off the floor in each",
            f"{often} of {len(rows)} seeds",
            often == len(rows),
        ),
    ]
