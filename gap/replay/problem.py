"""What a search asks of logged data that a model can replay, whatever moves there: the base of all kinds of problems.

A joint is free, driven by its measured motion, or judged by its torque; a robot stands on a ground; joints share
numbers of their robot. Each kind says how it is simulated and compared. What none of them does otherwise is here.
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self

import numpy as np

from ...actuators import Chain
from ..log.parts import Unit
from ..log.types import LogError
from .comparison import robust_loss

if TYPE_CHECKING:
    from .joint_model import JointModel
    from .joint_problem import JointProblem

CALIBRATION = 0.01
"""Relative error that columns and simulation share in all data of a joint: assumed."""

OF_A_ROBOT = 0.02
"""The same of a joint of a robot, whose file and whose other joints have errors of their own: assumed."""

CLOCK = 0.03
"""What time stamps, and one column beside another, are late or early by, in sample periods."""

NOISE_FLOORS = "noise floors"
"""Unit of errors of joints whose own units differ: each in parts of its joint's noise."""


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
