"""What to measure next: the motion, out of a library, on which the rival explanations differ most."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gap.problem import Problem
from gap.search import RIVAL, Search
from gap.simulator import replay_many

DURATION = 12.0  # [s]
RATE = 100.0  # [Hz] goals of an excitation
LIMIT = 1.2  # [rad] around the middle of the motion that was measured, where the log went as far


@dataclass(frozen=True, eq=False)
class Experiment:
    """A proposed measurement.

    Attributes:
        name: of the excitation.
        sentence: what to do and what it tells apart.
        separation: root mean squared difference of the rivals on it, in noise floors.
        time, goal: the excitation (n,) [s], [rad].
        table: separation by excitation.
    """

    name: str
    sentence: str
    separation: float
    time: np.ndarray
    goal: np.ndarray
    table: dict[str, float]


def library(centre: float, reach: float, seed: int = 0) -> dict[str, np.ndarray]:
    """Excitations within ``centre +- reach`` [rad], each (n,) at :data:`RATE`."""
    t = np.arange(0.0, DURATION, 1.0 / RATE)
    rng = np.random.default_rng(seed)
    sweep = 2 * np.pi * (0.1 * t + (2.5 - 0.1) * t**2 / (2 * DURATION))
    multisine = sum(
        np.sin(2 * np.pi * f * t + rng.uniform(0, 2 * np.pi)) / (1 + f) for f in (0.25, 0.5, 1.0, 1.75, 2.5)
    )
    held = np.repeat(rng.uniform(-1, 1, int(DURATION)), int(RATE))[: len(t)]
    shapes = {
        "chirp": np.sin(sweep) * np.linspace(1.0, 0.4, len(t)),
        "multisine": multisine / np.abs(multisine).max(),
        "slow triangle": 4 * np.abs((t / 6.0) % 1.0 - 0.5) - 1.0,
        "slow small triangle": 0.1 * (4 * np.abs((t / 3.0) % 1.0 - 0.5) - 1.0),
        "steps": held,
        "hold and release": np.where((t % 4.0) < 2.0, 1.0, 0.0),
    }
    return {name: centre + reach * shape for name, shape in shapes.items()}


def separate(problem: Problem, search: Search, seed: int = 0) -> Experiment | None:
    """The excitation on which the best candidates of the first undecided round differ most; None without a rival."""
    undecided = next(
        (r for r in search.rounds if len(r.candidates) > 1 and (r.candidates[1].best > RIVAL or not r.accepted)), None
    )
    if undecided is None:
        return None
    first, second = undecided.candidates[:2]
    position = problem.measured[:, 0]
    centre = float(0.5 * (np.nanmax(position) + np.nanmin(position)))
    reach = float(min(LIMIT, 0.5 * np.ptp(position[np.isfinite(position)])))
    best: Experiment | None = None
    table = {}
    for name, goal in library(centre, reach, seed).items():
        time = np.arange(len(goal)) / RATE
        table[name] = _difference(problem, [dict(c.fits[0].values) for c in (first, second)], time, goal)
        if best is None or table[name] > best.separation:
            sentence = (
                f"Run '{name}' ({DURATION:g} s, goals between {goal.min():.2f} and {goal.max():.2f} rad): "
                f"{first.cause.name} and {second.cause.name} differ there by {table[name]:.1f} times the noise."
            )
            best = Experiment(name, sentence, table[name], time, goal, table)
    return best


def _difference(problem: Problem, variants: list[dict[str, float]], time: np.ndarray, goal: np.ndarray) -> float:
    rows = []
    for values in variants:
        joint = problem.models[0].with_fitted(values)
        program = joint.chain.program()
        out = np.empty((1, len(time), 4))
        replay_many(
            program[None],
            joint.constants(problem.params[0], program)[None, None],
            time,
            goal,
            np.ones(len(time), bool),
            np.full(len(time), float(np.median(problem.temperature))),
            np.array([0, len(time)]),
            np.array([[goal[0], 0.0]]),
            np.array([5e-4]),
            out,
        )
        rows.append(out[0, :, 0])
    return float(np.sqrt(np.mean((rows[0] - rows[1]) ** 2)) / problem.noise)
