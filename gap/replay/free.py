"""Free replay of one joint: its load is known, and the simulator moves both from where each unit starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, Self

import numpy as np

from ...actuators import Chain
from ..log.parts import Unit
from ..log.types import MeasuredRun
from .comparison import Comparison, Groups
from .joint_model import JointModel
from .layout import covariates, lay_out, moved
from .problem import CALIBRATION
from .selection import select
from .simulator import CHANNELS, replay_many
from .variants import simulate_joint

SAMPLED, AVERAGED = (0, 1), (2, 3)  # channels compared sample by sample, and as means over groups of samples


@dataclass(frozen=True, eq=False)
class FreeProblem:
    """Units of one joint whose load is known; a :class:`sealegs.gap.replay.problem.JointProblem`.

    Attributes:
        units, params, time, goal, on, temperature, starts, states, judged, block, group: as
            :class:`sealegs.gap.replay.layout.Layout`.
        measured: channels as :data:`sealegs.gap.replay.simulator.CHANNELS` (n, 4), NaN where not logged.
        weight: one over the noise of each channel (4,), 0 where it does not count.
        trust: factor on the weight of duty and current (n, 4), the same for all samples of a group
            (:mod:`sealegs.gap.search.channels`).
        models: nominal joint of each run (they may differ, for example in their gain).
        step: largest step of the simulator [s], see :func:`sealegs.gap.replay.steps.converged`.
        coarse: how many times longer the step of play and of firmware that switches is than
            :func:`sealegs.gap.replay.steps.largest_step`.
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
    trust: np.ndarray
    models: tuple[JointModel, ...]
    step: float = 1e-3
    coarse: float = 1.0

    @property
    def kind(self) -> Literal["free"]:
        """How it is replayed."""
        return "free"

    @property
    def sampled(self) -> tuple[int, ...]:
        """Channels that are compared sample by sample."""
        return SAMPLED

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels that are replayed."""
        return CHANNELS

    @property
    def signal(self) -> tuple[str, str]:
        """The first channel, which is judged sample by sample, and its unit."""
        return "position", "rad"

    @property
    def noise(self) -> float:
        """Noise floor of the position [rad]."""
        return 1.0 / float(self.weight[0])

    @property
    def warming(self) -> float:
        """By how much the motor's temperature varies [K]."""
        return float(np.ptp(self.temperature))

    def part(self, *parts: int) -> Self:
        """The problem that has only the units of these parts."""
        kept = select(self.units, self.starts, parts)
        rows = kept.rows
        return replace(
            self,
            units=kept.units,
            starts=kept.starts,
            states=self.states[list(kept.numbers)],
            time=self.time[rows],
            goal=self.goal[rows],
            on=self.on[rows],
            temperature=self.temperature[rows],
            measured=self.measured[rows],
            judged=self.judged[rows],
            block=self.block[rows],
            group=self.group[rows],
            trust=self.trust[rows],
        )

    def coarsened(self, factor: float) -> Self:
        """The problem with so many times longer a step of what plays and switches."""
        return replace(self, coarse=factor)

    def simulate(self, variants: Sequence[Mapping[str, float]], step: float | None = None) -> np.ndarray:
        """Channels (v, n, 4) of every variant; see :func:`sealegs.gap.replay.variants.simulate_joint`."""
        return simulate_joint(self, variants, step, self._replay)

    def _replay(
        self,
        rows: slice,
        programs: np.ndarray,
        constants: np.ndarray,
        starts: np.ndarray,
        states: np.ndarray,
        steps: np.ndarray,
        out: np.ndarray,
    ) -> None:
        time, goal, on, temperature = self.time[rows], self.goal[rows], self.on[rows], self.temperature[rows]
        replay_many(programs, constants, time, goal, on, temperature, starts, states, steps, out)

    @cached_property
    def _compared(self) -> Comparison:
        return Comparison(
            sampled=SAMPLED,
            averaged=AVERAGED,
            measured=self.measured,
            weight=self.weight,
            trust=self.trust,
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
        """Position errors [rad] of one variant (n, 4) at the judged samples."""
        return self._compared.sample_errors(simulated)

    def covariates(self, simulated: np.ndarray) -> dict[str, np.ndarray]:
        """Motion, command, duty and temperature of a model (n, 4)."""
        motion, duty = moved(self.time, self.starts, simulated[:, 0]), simulated[:, self.channels.index("duty")]
        return covariates(motion, self.goal, duty, self.temperature)

    def left_over(self, simulated: np.ndarray) -> None:
        """None: the noise of a log is known with a margin only."""
        del simulated

    def beyond_noise(self, simulated: np.ndarray) -> None:
        """None: the noise of a log is known with a margin only."""
        del simulated

    def chain(self, values: Mapping[str, float]) -> Chain:
        """The chain of the first run with fitted values."""
        return self.models[0].with_fitted(values).chain

    def doubt(self, path: str) -> float:
        """Relative error of a number that columns and simulation share in all data."""
        del path
        return CALIBRATION


def free_problem(
    runs: Sequence[MeasuredRun],
    joint: str,
    models: Sequence[JointModel],
    units: Sequence[Unit],
    weight: Mapping[str, float],
) -> FreeProblem:
    """Lay the runs of one joint out for free replay.

    Args:
        runs, units: of :func:`sealegs.gap.log.parts.cut`.
        models: nominal joint of each run.
        weight: one over the noise, by channel; channels without one do not count.

    Raises:
        LogError: the joint has no commands.
    """
    laid = lay_out(runs, joint, units)
    return FreeProblem(
        units=laid.units,
        params=laid.params,
        time=laid.time,
        goal=laid.goal,
        on=laid.on,
        temperature=laid.temperature,
        starts=laid.starts,
        states=laid.states,
        measured=laid.measured,
        weight=np.array([weight.get(channel, 0.0) for channel in CHANNELS]),
        judged=laid.judged,
        block=laid.block,
        group=laid.group,
        trust=np.ones((len(laid.time), len(CHANNELS))),
        models=tuple(models),
    )
