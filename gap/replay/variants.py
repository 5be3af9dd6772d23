"""Variants of the nominal joints, replayed together."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ...actuators.stages.base import ChainError
from ..log.parts import Unit
from .joint_model import JointModel
from .simulator import CHANNELS
from .steps import largest_step

FAR = 1e3  # [rad] where a variant is said to be whose values make no chain


class Laid(Protocol):
    """What of a :class:`sealegs.gap.replay.problem.JointProblem` is replayed."""

    @property
    def models(self) -> tuple[JointModel, ...]:
        """Nominal joint of each run."""
        ...

    @property
    def params(self) -> tuple[dict[str, float], ...]:
        """Bench parameters of each run."""
        ...

    @property
    def units(self) -> tuple[Unit, ...]:
        """Pieces of runs."""
        ...

    @property
    def starts(self) -> np.ndarray:
        """First sample of each unit and the end of the last (u + 1,)."""
        ...

    @property
    def states(self) -> np.ndarray:
        """Position and speed of the units at their start (u, 2) [rad, rad/s]."""
        ...

    @property
    def time(self) -> np.ndarray:
        """Time of the samples (n,) [s]."""
        ...

    @property
    def step(self) -> float:
        """Largest step [s]."""
        ...

    @property
    def coarse(self) -> float:
        """Factor on the step of play and of firmware that switches."""
        ...


@dataclass(frozen=True, eq=False)
class Batch:
    """The units of one run with every variant, and where their channels go.

    Attributes:
        rows: samples of the units.
        programs: of the variants (v, L).
        constants: of the joint (v, units, K.size).
        starts: first of these samples of each unit, and the end of the last (units + 1,).
        states: of the units at their start (units, 2).
        steps: largest step of each variant (v,) [s].
        out: channels at the samples (v, samples, 4), which a replay fills.
    """

    rows: slice
    programs: np.ndarray
    constants: np.ndarray
    starts: np.ndarray
    states: np.ndarray
    steps: np.ndarray
    out: np.ndarray


Replay = Callable[[Batch], None]
"""Replays the units of one run with every variant."""


def simulate_joint(
    problem: Laid, variants: Sequence[Mapping[str, float]], step: float | None, replay: Replay
) -> np.ndarray:
    """Replay every unit with every variant of the nominal models.

    Args:
        problem: the units.
        variants: parameters by path, each set on the nominal joint of every run.
        step: largest step [s], where :func:`sealegs.gap.replay.steps.largest_step` allows it; default: the problem's.
        replay: of the units of one run.

    Returns:
        Channels (v, n, 4). A variant whose values make no chain is far from anything measured.
    """
    programs, constants, steps, valid = [], [], [], []
    first = _first_alike(problem.models)
    for values in variants:
        try:
            made = {k: problem.models[k].with_fitted(values) for k in set(first)}
        except ChainError:
            made = None
        valid.append(made is not None)
        made = made or {k: problem.models[k] for k in set(first)}
        program = {k: joint.chain.program() for k, joint in made.items()}
        programs.append([program[k] for k in first])
        rows = [made[k].constants(params, program[k]) for k, params in zip(first, problem.params, strict=True)]
        constants.append(rows)
        steps.append(min(step or problem.step, largest_step(made[first[0]].chain, problem.coarse)))
    out = np.empty((len(variants), len(problem.time), len(CHANNELS)))
    # The chain may differ between runs (a gain per run), so each run of a variant is a variant of its own for the
    # simulator.
    width = max(len(program) for per_run in programs for program in per_run)
    for run in sorted({unit.run for unit in problem.units}):
        chosen = [k for k, unit in enumerate(problem.units) if unit.run == run]
        lo, hi = problem.starts[chosen[0]], problem.starts[chosen[-1] + 1]
        table = np.zeros((len(variants), width))
        for v, per_run in enumerate(programs):
            table[v, : len(per_run[run])] = per_run[run]
        k = np.array([[rows[run]] * len(chosen) for rows in constants])
        part = np.empty((len(variants), hi - lo, len(CHANNELS)))
        starts = problem.starts[chosen[0] : chosen[-1] + 2] - lo
        replay(Batch(slice(lo, hi), table, k, starts, problem.states[chosen], np.array(steps), part))
        out[:, lo:hi] = part
    out[~np.array(valid)] = FAR
    return out


def _first_alike(models: Sequence[JointModel]) -> list[int]:
    """Of each run's model the first that is the same: most logs have one for all runs, which is made once."""
    return [models.index(model) for model in models]
