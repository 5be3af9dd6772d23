"""What a search asks of logged data that a model can replay, whatever moves there: a joint, or a leg on the ground."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import Field
from typing import Any, ClassVar, Protocol, Self

import numpy as np

from ...actuators import Chain
from ..log.parts import Unit
from .joint_model import JointModel

CALIBRATION = 0.01
"""Relative error that columns and simulation share in all data of a joint: assumed."""

OF_A_ROBOT = 0.02
"""The same of a joint of a robot, whose file and whose other joints have errors of their own: assumed."""

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


class Problem(Protocol):
    """Pieces of runs (units) one behind the other, n samples in all, and a replay of them with any model.

    Channels are columns of what is measured and simulated (n, 4). A residual is weighted: one is the noise. Its entries
    fall into blocks, within which they are not independent. A changed one is made by :func:`dataclasses.replace`.
    """

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    @property
    def joint(self) -> JointProblem | None:
        """Itself with what only one joint has: goals, bench parameters and a chain; None of several joints."""
        ...

    @property
    def free_joint(self) -> JointProblem | None:
        """The same, where its link moves as the torques on it say, so that other motions can be foreseen; else None."""
        ...

    @property
    def open_loop(self) -> bool:
        """Whether nothing holds a replay near what was measured, so that its small errors add up."""
        ...

    @property
    def units(self) -> tuple[Unit, ...]:
        """Pieces of runs, each in one part of the data."""
        ...

    @property
    def models(self) -> Sequence[Nominal]:
        """What is believed; of a joint one model for each run."""
        ...

    @property
    def time(self) -> np.ndarray:
        """Time since the start of the run (n,) [s]."""
        ...

    @property
    def starts(self) -> np.ndarray:
        """First sample of each unit and the end of the last (u + 1,)."""
        ...

    @property
    def measured(self) -> np.ndarray:
        """Channels as logged (n, 4), NaN where they were not."""
        ...

    @property
    def weight(self) -> np.ndarray:
        """One over the noise of each channel (4,), 0 where it does not count."""
        ...

    @property
    def judged(self) -> np.ndarray:
        """Samples that count (n,)."""
        ...

    @property
    def step(self) -> float:
        """Largest step of the replay [s]."""
        ...

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels."""
        ...

    @property
    def sampled(self) -> tuple[int, ...]:
        """Channels that are compared sample by sample."""
        ...

    @property
    def groups(self) -> int:
        """How many groups of samples the other channels are averaged over before they are compared."""
        ...

    @property
    def signal(self) -> tuple[str, str]:
        """The channel that the gap is told in, which comes first, and its unit."""
        ...

    @property
    def noise(self) -> float:
        """Noise floor of that channel, in its unit."""
        ...

    @property
    def temperature_range(self) -> float:
        """By how much the logged temperature of a motor varies [K]; 0 where nothing that is replayed depends on it."""
        ...

    def part(self, *parts: int) -> Self:
        """The problem that has only the units of these parts: what is not in it cannot be seen by accident."""
        ...

    def with_step_factor(self, factor: float) -> Self:
        """The problem with so many times longer a step of what plays and switches, where the replay has such a step."""
        ...

    def simulate(self, variants: Sequence[Mapping[str, float]], step: float | None = None) -> np.ndarray:
        """Channels (v, n, 4) of the models with each variant of their numbers, by path.

        A variant that makes no model is far from anything measured.
        """
        ...

    def residual(self, simulated: np.ndarray, every: int = 1) -> np.ndarray:
        """Weighted errors (v, m) of simulated channels (v, n, 4), of every so many of what is judged."""
        ...

    def blocks(self) -> tuple[np.ndarray, np.ndarray]:
        """Block number of each entry of :meth:`residual` (m,), counted from zero, and entries per block (b,)."""
        ...

    def block_errors(self, simulated: np.ndarray) -> np.ndarray:
        """Sum of the losses of weighted errors per block (b,), of one variant (n, 4); see :mod:`gap.replay.robust`."""
        ...

    def position_error(self, simulated: np.ndarray) -> np.ndarray:
        """Errors of one variant (n, 4) at the judged samples in the unit of :attr:`signal`."""
        ...

    def errors(self, simulated: np.ndarray) -> np.ndarray:
        """Errors of one variant (n, 4) in the units of the channels, NaN where they are not judged."""
        ...

    def covariates(self, simulated: np.ndarray) -> dict[str, np.ndarray]:
        """Signals (n,) that errors of a model (n, 4) may depend on, by name; none where one joint alone has none."""
        ...

    def left_over(self, simulated: np.ndarray) -> float | None:
        """Mean squared error of a model (n, 4) beyond the noise, in parts of it, where the problem itself can tell."""
        ...

    def excess_loss(self, simulated: np.ndarray) -> float | None:
        """Loss per judged value of a model (n, 4) beyond that of noise, where the problem itself can tell."""
        ...

    def chain(self, values: Mapping[str, float]) -> Chain | None:
        """The chain of the first run with fitted values; None where the problem is not that of one joint."""
        ...

    def mjcf(self, values: Mapping[str, float]) -> str | None:
        """The whole machine with fitted values, where it is more than a chain and what hangs on it; else None."""
        ...

    def picture(self, named: str) -> str:
        """Which picture shows a cause in this replay that names one; empty where none does."""
        ...

    def systematic_error(self, path: str) -> float:
        """Relative error of a number that columns and simulation share in all data."""
        ...


class JointProblem(Problem, Protocol):
    """One joint, its link free or driven."""

    @property
    def models(self) -> tuple[JointModel, ...]:
        """Nominal joint of each run (they may differ, for example in their gain)."""
        ...

    @property
    def params(self) -> tuple[dict[str, float], ...]:
        """Bench parameters of each run; empty where the link is driven."""
        ...

    @property
    def goal(self) -> np.ndarray:
        """Commanded position (n,) [rad]."""
        ...

    @property
    def on(self) -> np.ndarray:
        """Whether the drive was on (n,)."""
        ...

    @property
    def temperature(self) -> np.ndarray:
        """Of the motor (n,) [degC]."""
        ...

    @property
    def states(self) -> np.ndarray:
        """Position and speed of the units at their start (u, 2) [rad, rad/s]."""
        ...

    @property
    def group(self) -> np.ndarray:
        """Number of the group of samples over which duty and current are averaged (n,), -1 where they do not count."""
        ...

    @property
    def reliability(self) -> np.ndarray:
        """Factor on the weight of averaged channels (n, 4), the same for all samples of a group
        (:mod:`sealegs.gap.search.channels`).
        """
        ...

    @property
    def terms(self) -> np.ndarray | None:
        """What a joint of a robot works against at the samples (n, T_COLUMNS); None where the load's numbers say it."""
        ...

    @property
    def link(self) -> np.ndarray | None:
        """Position, speed and acceleration of a link that moves as measured (n, 3); None where it is simulated."""
        ...

    @property
    def steps(self) -> tuple[float, ...]:
        """Steps of the simulator to try, the longest first [s]."""
        ...

    @property
    def coarse(self) -> float:
        """How many times longer the step of play and of firmware that switches is than
        :func:`sealegs.gap.replay.steps.largest_step`.
        """
        ...

    def means(self, signal: np.ndarray) -> np.ndarray:
        """Means (..., g) of a signal (..., n) over the groups of samples; NaN where one of them is missing."""
        ...


def periods_of(problem: Problem) -> list[float]:
    """Sample period of each unit [s]: runs of one machine may be logged at different rates."""
    times = (problem.time[a:b] for a, b in itertools.pairwise(problem.starts))
    return [float(np.median(np.diff(time))) if len(time) > 1 else np.inf for time in times]
