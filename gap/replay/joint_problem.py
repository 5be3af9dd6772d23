"""One joint as a problem: what its kinds, free, driven and judged by its torque, have in common.

Its runs lie one sample behind the other, and variants of its nominal models are replayed together.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self, TypeVar

import numpy as np

from ...actuators import Chain
from ...actuators.stages.base import ChainError
from .comparison import Comparison, Groups
from .joint_model import JointModel
from .layout import covariates, moved
from .problem import Problem
from .simulator import CHANNELS, DIVERGED, ELASTIC_STEP, EVENT_STEP

ROBOT_STEP = 5e-3  # [s] tried first at joints of robots, whose logs are coarser and longer than those of benches
STEPS = (2.5e-3, 1.7e-3, 1e-3, 5e-4, 2.5e-4, 1e-4)  # [s]
FAR = 1e3  # [rad] where a variant is said to be whose values make no chain


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


@dataclass(frozen=True, eq=False, kw_only=True)
class JointProblem(Problem):
    """Units of one joint; a kind says which channels there are, and replays them.

    Attributes:
        params: bench parameters of each run; empty where the link is driven.
        goal: what is commanded (n,) [rad], a torque [N.m] where the chain takes one.
        on: whether the drive was on (n,).
        temperature: of the motor (n,) [degC].
        states: position and speed of the units at their start (u, 2) [rad, rad/s].
        block: number of the block each sample belongs to (n,).
        group: number of the group of samples over which duty and current are averaged (n,), -1 where they do not count.
        reliability: factor on the weight of averaged channels (n, 4), the same for all samples of a group
            (:mod:`sealegs.gap.search.channels`).
        models: nominal joint of each run (they may differ, for example in their gain).
        step: largest step of the simulator [s], see :func:`converged`.
        coarse: how many times longer the step of play and of firmware that switches is than :func:`largest_step`.
        terms: what a joint of a robot works against at the samples (n, T_COLUMNS) (:mod:`sealegs.gap.load.terms`);
            None where the load's numbers say it.
        link: position, speed and acceleration of a link that moves as measured (n, 3) [rad, rad/s, rad/s2]; None where
            it is simulated.
        by_sample, by_group: channels compared sample by sample, and as means over groups of samples.
    """

    params: tuple[dict[str, float], ...]
    goal: np.ndarray
    on: np.ndarray
    temperature: np.ndarray
    states: np.ndarray
    block: np.ndarray
    group: np.ndarray
    reliability: np.ndarray
    models: tuple[JointModel, ...]
    coarse: float = 1.0
    terms: np.ndarray | None
    link: np.ndarray | None

    by_sample: ClassVar[tuple[int, ...]]
    by_group: ClassVar[tuple[int, ...]] = ()
    per_sample: ClassVar[tuple[str, ...]] = (
        *(*Problem.per_sample, "goal", "on", "temperature", "block", "group", "reliability", "terms", "link"),
    )
    per_unit: ClassVar[tuple[str, ...]] = ("states",)

    @abstractmethod
    def replay(self, batch: Batch) -> None:
        """Replay the units of one run."""

    @property
    def joint(self) -> JointProblem:
        """Itself."""
        return self

    @property
    def machines(self) -> tuple[tuple[JointModel, Mapping[str, float]], ...]:
        """Its models, each with the parameters of its run."""
        return tuple(zip(self.models, self.params, strict=True))

    @property
    def sampled(self) -> tuple[int, ...]:
        """Channels that are compared sample by sample."""
        return self.by_sample

    @property
    def steps(self) -> tuple[float, ...]:
        """Steps of the simulator to try, the longest first [s]."""
        return STEPS

    @property
    def temperature_range(self) -> float:
        """By how much the motor's temperature varies [K]."""
        return float(np.ptp(self.temperature))

    def driven_by(self, rows: slice) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Time, goal, whether the drive was on, and temperature at some samples."""
        return self.time[rows], self.goal[rows], self.on[rows], self.temperature[rows]

    def motion(self, simulated: np.ndarray) -> np.ndarray:
        """Position, speed and acceleration (n, 3) of the joint in a model (n, 4)."""
        return moved(self.time, self.starts, simulated[:, 0])

    def with_step_factor(self, factor: float) -> Self:
        """The problem with so many times longer a step of what plays and switches."""
        return replace(self, coarse=factor)

    def simulate(self, variants: Sequence[Mapping[str, float]], step: float | None = None) -> np.ndarray:
        """Channels (v, n, 4) of every variant of the nominal joints.

        Args:
            variants: parameters by path, each set on the nominal joint of every run.
            step: largest step [s], where :func:`largest_step` allows it; default: the problem's.

        Returns:
            A variant whose values make no chain is far from anything measured.
        """
        programs, constants, steps, valid = [], [], [], []
        first = [self.models.index(model) for model in self.models]  # most logs have one model, which is made once
        for values in variants:
            try:
                made = {k: self.models[k].with_fitted(values) for k in set(first)}
            except ChainError:
                made = None
            valid.append(made is not None)
            made = made or {k: self.models[k] for k in set(first)}
            program = {k: joint.chain.program() for k, joint in made.items()}
            programs.append([program[k] for k in first])
            rows = [made[k].constants(params, program[k]) for k, params in zip(first, self.params, strict=True)]
            constants.append(rows)
            steps.append(min(step or self.step, largest_step(made[first[0]].chain, self.coarse)))
        out = np.empty((len(variants), len(self.time), len(CHANNELS)))
        # The chain may differ between runs (a gain per run), so each run of a variant is a variant of its own for the
        # simulator.
        width = max(len(program) for per_run in programs for program in per_run)
        for run in sorted({unit.run for unit in self.units}):
            chosen = [k for k, unit in enumerate(self.units) if unit.run == run]
            lo, hi = self.starts[chosen[0]], self.starts[chosen[-1] + 1]
            table = np.zeros((len(variants), width))
            for v, per_run in enumerate(programs):
                table[v, : len(per_run[run])] = per_run[run]
            k = np.array([[rows[run]] * len(chosen) for rows in constants])
            part = np.empty((len(variants), hi - lo, len(CHANNELS)))
            starts = self.starts[chosen[0] : chosen[-1] + 2] - lo
            self.replay(Batch(slice(lo, hi), table, k, starts, self.states[chosen], np.array(steps), part))
            out[:, lo:hi] = part
        out[~np.array(valid)] = FAR
        return out

    @cached_property
    def _compared(self) -> Comparison:
        return Comparison(
            sampled=self.by_sample,
            averaged=self.by_group,
            measured=self.measured,
            weight=self.weight,
            reliability=self.reliability,
            judged=self.judged,
            block=self.block,
            groups=Groups.of(self.group),
        )

    @property
    def groups(self) -> int:
        """How many groups of samples are averaged."""
        return len(self._compared.groups)

    def means(self, signal: np.ndarray) -> np.ndarray:
        """Means (..., g) of a signal (..., n) over the groups of samples; NaN where one of them is missing."""
        return self._compared.groups.means(signal)

    def residual(self, simulated: np.ndarray, every: int = 1) -> np.ndarray:
        """Weighted errors (v, m) of simulated channels (v, n, 4)."""
        return self._compared.residual(simulated, every)

    def blocks(self) -> tuple[np.ndarray, np.ndarray]:
        """Block number of each entry of :meth:`residual` (m,), and entries per block (b,)."""
        return self._compared.blocks

    def covariates(self, simulated: np.ndarray) -> dict[str, np.ndarray]:
        """Motion, command, duty and temperature of a model (n, 4)."""
        duty = simulated[:, self.channels.index("duty")]
        return covariates(self.motion(simulated), self.goal, duty, self.temperature)

    def chain(self, values: Mapping[str, float]) -> Chain:
        """The chain of the first run with fitted values."""
        return self.models[0].with_fitted(values).chain


Joint = TypeVar("Joint", bound=JointProblem)


def largest_step(chain: Chain, coarse: float = 1.0) -> float:
    """The largest step that resolves what lies between motor and link, and firmware that switches [s].

    ``coarse`` is how many times longer that of teeth, switches and differences may be; teeth are springs, too. A push
    that a step of eight halves of its filter lumps together is still as large, within 5 %.
    """
    play = chain.find("backlash")
    teeth = play is not None and play.width > 0.0
    springs = teeth or chain.find("spring") or chain.find("compliance")
    differences = chain.find("derivative")
    push = 0.5 * differences.filter * min(coarse, 8.0) if differences else np.inf
    elastic = min(ELASTIC_STEP if springs else np.inf, push)
    switches = teeth or any(stage.switches for stage in chain.stages)
    return min(EVENT_STEP * coarse if switches else np.inf, elastic)


def converged(problem: Joint) -> Joint:
    """The problem with the largest step whose discretisation error is below a tenth of the noise.

    That is how much the replay changes as it is halved; :func:`largest_step` bounds it where that is less.

    A quarter would be invisible in the error, but not to a search that looks for structure in it.
    """
    step = problem.step
    # a chain with springs or switches is replayed in shorter steps whatever is tried, and says nothing of long ones
    bounded = largest_step(problem.models[0].chain) < np.inf
    for step in [length for length in problem.steps if not bounded or length <= STEPS[0]]:
        replays = [problem.simulate([{}], length)[0] for length in (step, step / 2.0)]
        if any(map(diverged, replays)):  # two that leave all bounds are alike
            continue
        whole, halved = map(problem.position_error, replays)
        if np.sqrt(np.mean((whole - halved) ** 2)) < 0.1 * problem.noise:
            break
    return replace(problem, step=step)


def diverged(simulated: np.ndarray) -> bool:
    """Whether a replay (n, 4) left all bounds: its steps are too long for what it simulates, or nothing holds it."""
    return bool((simulated == DIVERGED).all(axis=-1).any())
