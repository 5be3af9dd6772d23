"""What a search asks of logged data that a model can replay, whatever moves there: the base of all kinds of problems.

A joint is free, driven by its measured motion, or judged by its torque; a robot stands on a ground; joints share
numbers of their robot. Each kind says how it is simulated and compared. What none of them does otherwise is here, and
what free and driven joints have in common: their runs lie one sample behind the other, and variants of their models are
replayed together.
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Protocol, Self, TypeVar

import numpy as np

from ...actuators import Chain
from ...actuators.stages.base import ChainError
from ..log.parts import Unit
from ..log.types import LogError
from .comparison import Comparison, Groups, robust_loss
from .joint_model import JointModel
from .layout import covariates, moved
from .simulator import CHANNELS, DIVERGED, ELASTIC_STEP, EVENT_STEP

CALIBRATION = 0.01
"""Relative error that columns and simulation share in all data of a joint: assumed."""

OF_A_ROBOT = 0.02
"""The same of a joint of a robot, whose file and whose other joints have errors of their own: assumed."""

CLOCK = 0.03
"""What time stamps, and one column beside another, are late or early by, in sample periods."""

NOISE_FLOORS = "noise floors"
"""Unit of errors of joints whose own units differ: each in parts of its joint's noise."""
ROBOT_STEP = 5e-3  # [s] tried first at joints of robots, whose logs are coarser and longer than those of benches
STEPS = (2.5e-3, 1.7e-3, 1e-3, 5e-4, 2.5e-4, 1e-4)  # [s]
UNNOTICED = 0.1  # noise floors that a replay may change by as its steps are halved: a quarter makes a structure
FAR = 1e3  # [rad] where a variant is said to be whose values make no chain


class Nominal(Protocol):
    """A model whose numbers are believed, and that a fit changes."""

    def value(self, path: str, /) -> float:
        """A number by ``owner.key``."""
        ...

    def unit(self, path: str, /) -> str:
        """Its unit."""
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class Problem(ABC):
    """Pieces of runs (units) one behind the other, n samples in all, and a replay of them with any model.

    Channels are columns of what is measured and simulated (n, c). A residual is weighted: one is the noise. Its entries
    fall into blocks, within which they are not independent. A changed one is made by :func:`dataclasses.replace`.

    Attributes:
        units: pieces of runs, each in one part of the data.
        time: of the samples since the start of their run (n,) [s].
        starts: first sample of each unit and the end of the last (u + 1,).
        measured: channels as logged (n, c), NaN where they were not.
        weight: one over the noise of each channel (c,), 0 where it does not count.
        judged: samples that count (n,).
        models: what is believed; of a joint one model for each run.
        step: largest step of the replay [s].
        told_in: number of the channel that the gap is told in.
        per_sample, per_unit: names of the attributes with one entry per sample, and per unit.
    """

    units: tuple[Unit, ...]
    time: np.ndarray
    starts: np.ndarray
    measured: np.ndarray
    weight: np.ndarray
    judged: np.ndarray
    models: tuple[Nominal, ...]
    step: float = 1e-3
    told_in: int = 0

    per_sample: ClassVar[tuple[str, ...]] = ("time", "measured", "judged")
    per_unit: ClassVar[tuple[str, ...]] = ()

    # --- what each kind says ---------------------------------------------------------------------------------------

    @property
    @abstractmethod
    def channels(self) -> tuple[str, ...]:
        """Names of the channels."""

    @property
    @abstractmethod
    def sampled(self) -> tuple[int, ...]:
        """Channels that are compared sample by sample."""

    @property
    @abstractmethod
    def signal(self) -> tuple[str, str]:
        """The channel that the gap is told in, and its unit."""

    @abstractmethod
    def simulate(self, variants: Sequence[Mapping[str, float]], step: float | None = None) -> np.ndarray:
        """Channels (v, n, c) of the models with each variant of their numbers, by path.

        A variant that makes no model is far from anything measured.
        """

    @abstractmethod
    def residual(self, simulated: np.ndarray, every: int = 1) -> np.ndarray:
        """Weighted errors (v, m) of simulated channels (v, n, c), of every so many of what is judged."""

    @abstractmethod
    def blocks(self) -> tuple[np.ndarray, np.ndarray]:
        """Block number of each entry of :meth:`residual` (m,), counted from zero, and entries per block (b,)."""

    # --- what most kinds have in common ----------------------------------------------------------------------------

    @property
    def joint(self) -> JointProblem | None:
        """Itself with what only one joint has: goals, bench parameters and a chain; None of several joints."""
        return None

    @property
    def free_joint(self) -> JointProblem | None:
        """The same, where its link moves as the torques on it say, so that other motions can be foreseen; else None."""
        return None

    @property
    def machines(self) -> tuple[tuple[JointModel, Mapping[str, float]], ...]:
        """Nominal joint and bench parameters of each run, where fitted values make an extended chain of it."""
        return ()

    @property
    def open_loop(self) -> bool:
        """Whether nothing holds a replay near what was measured, so that its small errors add up."""
        return False

    @property
    def groups(self) -> int:
        """How many groups of samples are averaged before the channels that are not sampled are compared."""
        return 0

    @property
    def noise(self) -> float:
        """Noise floor of the channel that the gap is told in, in its unit."""
        return 1.0 / float(self.weight[self.told_in])

    @property
    def temperature_range(self) -> float:
        """By how much the logged temperature of a motor varies [K]; 0 where nothing that is replayed depends on it."""
        return 0.0

    def part(self, *parts: int) -> Self:
        """The problem that has only the units of these parts: what is not in it cannot be seen by accident.

        Raises:
            LogError: there is none.
        """
        chosen, rows, starts = rows_of(self, parts)
        kept = {name: values[rows] for name in self.per_sample if (values := getattr(self, name)) is not None}
        kept |= {name: _chosen(getattr(self, name), chosen) for name in ("units", *self.per_unit)}
        return replace(self, starts=starts, **kept)

    def with_step_factor(self, factor: float) -> Self:
        """The problem with so many times longer a step of what plays and switches, where the replay has such a step."""
        del factor
        return self

    def block_errors(self, simulated: np.ndarray) -> np.ndarray:
        """Sum of the losses of weighted errors per block (b,), of one variant (n, c)."""
        numbers, sizes = self.blocks()
        return np.bincount(numbers, robust_loss(self.residual(simulated[None])[0]), len(sizes))

    def position_error(self, simulated: np.ndarray) -> np.ndarray:
        """Errors of one variant (n, c) at the judged samples in the unit of :attr:`signal`."""
        return (simulated[:, self.told_in] - self.measured[:, self.told_in])[self.judged]

    def errors(self, simulated: np.ndarray) -> np.ndarray:
        """Errors of one variant (n, c) in the units of the channels, NaN where they are not judged."""
        return np.where(self.judged[:, None], simulated - self.measured, np.nan)

    def covariates(self, simulated: np.ndarray) -> dict[str, np.ndarray]:
        """Signals (n,) that errors of a model (n, c) may depend on, by name; none where one joint alone has none."""
        del simulated
        return {}

    def left_over(self, simulated: np.ndarray) -> float | None:
        """Mean squared error of a model (n, c) beyond the noise, in parts of it, where the problem itself can tell."""
        del simulated
        return None

    def excess_loss(self, simulated: np.ndarray) -> float | None:
        """Loss per judged value of a model (n, c) beyond that of noise, where the problem itself can tell."""
        del simulated
        return None

    def chain(self, values: Mapping[str, float]) -> Chain | None:
        """The chain of the first run with fitted values; None where the problem is not that of one joint."""
        del values
        return None

    def mjcf(self, values: Mapping[str, float]) -> str | None:
        """The whole machine with fitted values, where it is more than a chain and what hangs on it; else None."""
        del values
        return None

    def picture(self, named: str) -> str:
        """Which picture shows a cause in this replay that names one; empty where none does."""
        del named
        return ""

    @property
    def clock(self) -> float:
        """What all times of the data are late or early by [s]."""
        return CLOCK * max(periods_of(self))

    def systematic_error(self, path: str) -> float:
        """Relative error of a number that columns and simulation share in all data."""
        del path
        return CALIBRATION


def rows_of(problem: Problem, parts: Sequence[int]) -> tuple[list[int], np.ndarray, np.ndarray]:
    """Numbers of the units of some parts, their samples (k,), and first of these of each and the end of the last.

    Raises:
        LogError: there is none.
    """
    starts = problem.starts
    chosen = [k for k, unit in enumerate(problem.units) if unit.part in parts]
    if not chosen:
        raise LogError("the logs are too short to keep some for choosing and testing; record more runs or longer ones.")
    rows = np.concatenate([np.arange(starts[k], starts[k + 1]) for k in chosen])
    sizes = [starts[k + 1] - starts[k] for k in chosen]
    return chosen, rows, np.concatenate([[0], np.cumsum(sizes)]).astype(int)


def _chosen(values: Any, numbers: Sequence[int]) -> Any:
    """Some entries of an array or a tuple, in the same kind."""
    return values[numbers] if isinstance(values, np.ndarray) else tuple(values[k] for k in numbers)


def periods_of(problem: Problem) -> list[float]:
    """Sample period of each unit [s]: runs of one machine may be logged at different rates."""
    times = (problem.time[a:b] for a, b in itertools.pairwise(problem.starts))
    return [float(np.median(np.diff(time))) if len(time) > 1 else np.inf for time in times]


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
    """
    step = problem.step
    # a chain with springs or switches is replayed in shorter steps whatever is tried, and says nothing of long ones
    bounded = largest_step(problem.models[0].chain) < np.inf
    for step in [length for length in problem.steps if not bounded or length <= STEPS[0]]:
        replays = [problem.simulate([{}], length)[0] for length in (step, step / 2.0)]
        if any(map(diverged, replays)):  # two that leave all bounds are alike
            continue
        whole, halved = map(problem.position_error, replays)
        if np.sqrt(np.mean((whole - halved) ** 2)) < UNNOTICED * problem.noise:
            break
    return replace(problem, step=step)


def diverged(simulated: np.ndarray) -> bool:
    """Whether a replay (n, 4) left all bounds: its steps are too long for what it simulates, or nothing holds it."""
    return bool((simulated == DIVERGED).all(axis=-1).any())
