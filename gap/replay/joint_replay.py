"""What the free and the driven replay of one joint have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np

from ...actuators import Chain
from ..log.parts import Unit
from .comparison import Comparison, Groups
from .joint_model import JointModel
from .layout import covariates, moved
from .problem import CALIBRATION
from .selection import select
from .steps import STEPS
from .variants import Batch, simulate_joint


@dataclass(frozen=True, eq=False)
class JointReplay(ABC):
    """What free and driven units of one joint share; their class says which channels there are, and replays them.

    Attributes:
        units, params, time, goal, on, temperature, starts, states, judged, block, group: as
            :class:`sealegs.gap.replay.layout.Layout`.
        measured: channels (n, 4) in the order of :attr:`channels`, NaN where not logged.
        weight: one over the noise of each channel (4,), 0 where it does not count.
        reliability: factor on the weight of averaged channels (n, 4), the same for all samples of a group
            (:mod:`sealegs.gap.search.channels`).
        models: nominal joint of each run (they may differ, for example in their gain).
        step: largest step of the simulator [s], see :func:`sealegs.gap.replay.steps.converged`.
        coarse: how many times longer the step of play and of firmware that switches is than
            :func:`sealegs.gap.replay.steps.largest_step`.
        by_sample, by_group: channels compared sample by sample, and as means over groups of samples.
        per_sample: names of the attributes with one entry per sample.
    """

    units: tuple[Unit, ...]
    params: tuple[dict[str, float], ...]
    time: np.ndarray
    goal: np.ndarray
    on: np.ndarray
    temperature: np.ndarray
    starts: np.ndarray
    states: np.ndarray
    measured: np.ndarray
    weight: np.ndarray
    judged: np.ndarray
    block: np.ndarray
    group: np.ndarray
    reliability: np.ndarray
    models: tuple[JointModel, ...]
    step: float = 1e-3
    coarse: float = 1.0

    by_sample: ClassVar[tuple[int, ...]]
    by_group: ClassVar[tuple[int, ...]]
    per_sample: ClassVar[tuple[str, ...]] = (
        *("time", "goal", "on", "temperature", "measured", "judged", "block", "group", "reliability"),
    )

    @property
    def sampled(self) -> tuple[int, ...]:
        """Channels that are compared sample by sample."""
        return self.by_sample

    @property
    def steps(self) -> tuple[float, ...]:
        """Steps of the simulator to try, the longest first [s]."""
        return STEPS

    @property
    @abstractmethod
    def open_loop(self) -> bool:
        """Whether its small errors add up, see :class:`sealegs.gap.replay.problem.Problem`."""

    @property
    @abstractmethod
    def channels(self) -> tuple[str, ...]:
        """Names of the channels, the one that is judged sample by sample first."""

    @property
    @abstractmethod
    def signal(self) -> tuple[str, str]:
        """The first channel, and its unit."""

    @abstractmethod
    def replay(self, batch: Batch) -> None:
        """Replay the units of one run."""

    def driven_by(self, rows: slice) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Time, goal, whether the drive was on, and temperature at some samples."""
        return self.time[rows], self.goal[rows], self.on[rows], self.temperature[rows]

    def motion(self, simulated: np.ndarray) -> np.ndarray:
        """Position, speed and acceleration (n, 3) of the joint in a model (n, 4)."""
        return moved(self.time, self.starts, simulated[:, 0])

    @property
    def noise(self) -> float:
        """Noise floor of the first channel, in its unit."""
        return 1.0 / float(self.weight[0])

    @property
    def temperature_range(self) -> float:
        """By how much the motor's temperature varies [K]."""
        return float(np.ptp(self.temperature))

    def part(self, *parts: int) -> Self:
        """The problem that has only the units of these parts."""
        kept = select(self.units, self.starts, parts)
        return replace(
            self,
            units=kept.units,
            starts=kept.starts,
            states=self.states[list(kept.numbers)],
            **{name: values[kept.rows] for name in self.per_sample if (values := getattr(self, name)) is not None},
        )

    def with_step_factor(self, factor: float) -> Self:
        """The problem with so many times longer a step of what plays and switches."""
        return replace(self, coarse=factor)

    def simulate(self, variants: Sequence[Mapping[str, float]], step: float | None = None) -> np.ndarray:
        """Channels (v, n, 4) of every variant; see :func:`sealegs.gap.replay.variants.simulate_joint`."""
        return simulate_joint(self, variants, step, self.replay)

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
        """Means (..., g) of a signal (..., n) over the groups of samples."""
        return self._compared.groups.means(signal)

    def residual(self, simulated: np.ndarray, every: int = 1) -> np.ndarray:
        """Weighted errors (v, m) of simulated channels (v, n, 4)."""
        return self._compared.residual(simulated, every)

    def blocks(self) -> tuple[np.ndarray, np.ndarray]:
        """Block number of each entry of :meth:`residual` (m,), and entries per block (b,)."""
        return self._compared.blocks

    def block_errors(self, simulated: np.ndarray) -> np.ndarray:
        """Sum of the losses of weighted errors per block (b,), of one variant (n, 4)."""
        return self._compared.block_errors(simulated)

    def position_error(self, simulated: np.ndarray) -> np.ndarray:
        """Errors of the first channel of one variant (n, 4) at the judged samples, in its unit."""
        return self._compared.sample_errors(simulated)

    def errors(self, simulated: np.ndarray) -> np.ndarray:
        """Errors of one variant (n, 4) in the units of the channels, NaN where they are not judged."""
        return np.where(self.judged[:, None], simulated - self.measured, np.nan)

    def covariates(self, simulated: np.ndarray) -> dict[str, np.ndarray]:
        """Motion, command, duty and temperature of a model (n, 4)."""
        duty = simulated[:, self.channels.index("duty")]
        return covariates(self.motion(simulated), self.goal, duty, self.temperature)

    def left_over(self, simulated: np.ndarray) -> None:
        """None: the noise of a log is known with a margin only."""
        del simulated

    def excess_loss(self, simulated: np.ndarray) -> None:
        """None: the noise of a log is known with a margin only."""
        del simulated

    def chain(self, values: Mapping[str, float]) -> Chain:
        """The chain of the first run with fitted values."""
        return self.models[0].with_fitted(values).chain

    def mjcf(self, values: Mapping[str, float]) -> None:
        """None: its chain and what hangs on it say all."""
        del values

    def systematic_error(self, path: str) -> float:
        """Relative error of a number that columns and simulation share in all data."""
        del path
        return CALIBRATION
