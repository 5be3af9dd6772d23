"""Driven replay of one joint: its link moves as measured, whatever holds it, and only its actuator is judged.

So a leg that touches the ground is diagnosed joint by joint, without a model of the ground. What it cannot show is
listed in a finding: everything about the load, and what needs a column that the log lacks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, Self

import numpy as np

from ...actuators import Chain
from ..checks.signal import derivatives, typical_noise
from ..log.parts import Unit
from ..log.types import LogError, MeasuredRun
from .comparison import Comparison, Groups
from .driven_simulator import CHANNELS, replay_driven_many
from .joint_model import JointModel
from .layout import covariates, lay_out, moved
from .problem import CALIBRATION
from .selection import select
from .variants import simulate_joint

UNITS = {"position": "rad", "torque": "N.m", "duty": "1", "current": "A"}
SAMPLED, AVERAGED = (0,), (1, 2, 3)  # channels compared sample by sample, and as means over groups of samples
RIGID_SIGNALS = ("torque", "current", "duty")  # what judges a motor that is rigid with its link, the best first


@dataclass(frozen=True, eq=False)
class DrivenProblem:
    """Units of one joint whose link moves as measured; a :class:`sealegs.gap.replay.problem.JointProblem`.

    Attributes:
        units, params, time, goal, on, temperature, starts, states, judged, block, group: as
            :class:`sealegs.gap.replay.layout.Layout`.
        measured: channels (n, 4) as :data:`sealegs.gap.replay.driven_simulator.CHANNELS`, the judged one first; NaN
            where not logged.
        weight: one over the noise of each channel (4,), 0 where it does not count.
        trust: factor on the weight of averaged channels (n, 4), the same for all samples of a group
            (:mod:`sealegs.gap.search.channels`).
        models: nominal joint of each run.
        link: position, speed and acceleration of the link (n, 3) [rad, rad/s, rad/s2].
        first: which of :data:`sealegs.gap.replay.driven_simulator.CHANNELS` is judged sample by sample; it comes first
            in ``measured`` and in what is simulated, in exchange with the position.
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
    link: np.ndarray
    first: int = 0
    step: float = 1e-3
    coarse: float = 1.0

    @property
    def kind(self) -> Literal["driven"]:
        """How it is replayed."""
        return "driven"

    @property
    def sampled(self) -> tuple[int, ...]:
        """Channels that are compared sample by sample."""
        return SAMPLED

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels, the judged one first."""
        return tuple(CHANNELS[c] for c in _exchanged(self.first))

    @property
    def signal(self) -> tuple[str, str]:
        """The channel that is judged sample by sample, and its unit."""
        return CHANNELS[self.first], UNITS[CHANNELS[self.first]]

    @property
    def noise(self) -> float:
        """Noise floor of the judged channel, in its unit."""
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
            link=self.link[rows],
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
        replay_driven_many(
            programs, constants, time, goal, on, temperature, self.link[rows], starts, states, steps, out
        )
        if self.first:
            out[...] = out[..., _exchanged(self.first)]

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
        """Errors of the judged channel of one variant (n, 4) at the judged samples, in its unit."""
        return self._compared.sample_errors(simulated)

    def covariates(self, simulated: np.ndarray) -> dict[str, np.ndarray]:
        """Motion, command, duty and temperature of a model (n, 4); a rigid motor moves as its link was measured to."""
        motion = self.link if self.first else moved(self.time, self.starts, simulated[:, 0])
        duty = simulated[:, self.channels.index("duty")]
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


def _exchanged(first: int) -> list[int]:
    order = list(range(len(CHANNELS)))
    order[0], order[first] = order[first], order[0]
    return order


def driven_problem(
    runs: Sequence[MeasuredRun], joint: str, models: Sequence[JointModel], units: Sequence[Unit], noise: float
) -> DrivenProblem:
    """Lay the runs of one joint out for driven replay.

    Args:
        runs, units: of :func:`sealegs.gap.log.parts.cut`.
        models: nominal joint of each run.
        noise: of a position sample [rad].

    Raises:
        LogError: the log lacks what would be judged: the link behind a spring, or, where motor and link are one, any
            of torque, current and duty.
    """
    plain = lay_out(runs, joint, units)
    logs = [run.joints[joint] for run in runs]
    elastic = any(is_elastic(model) for model in models)
    if elastic and any(log.link_position is None for log in logs):
        raise LogError(
            f"joint '{joint}' has a spring or play between motor and link, and '{joint}.link_position' was not logged: "
            "without it nothing says what the actuator works against; record it."
        )
    link = np.concatenate([_link(runs[unit.run], joint)[unit.start : unit.stop] for unit in plain.units])
    measured = plain.measured.copy()
    measured[:, 1] = np.concatenate(
        [
            np.full(unit.stop - unit.start, np.nan) if (torque := logs[unit.run].torque) is None
            else torque[unit.start : unit.stop]
            for unit in plain.units
        ]
    )  # fmt: skip
    first, weight = 0, np.zeros(len(CHANNELS))
    weight[0] = 1.0 / noise
    if not elastic and logs[0].link_position is None:
        signal = next((s for s in RIGID_SIGNALS if all(getattr(log, s) is not None for log in logs)), None)
        if signal is None:
            raise LogError(
                f"joint '{joint}': motor and link are one, so its position says nothing about its actuator unless the "
                f"load is known; log '{joint}.duty', '{joint}.current' or '{joint}.torque' as well."
            )
        first = CHANNELS.index(signal)
        measured = measured[:, _exchanged(first)]
        weight[0] = 1.0 / typical_noise(plain.time, measured[:, 0], plain.starts)
    return DrivenProblem(
        units=plain.units,
        params=plain.params,
        time=plain.time,
        goal=plain.goal,
        on=plain.on,
        temperature=plain.temperature,
        starts=plain.starts,
        states=plain.states,
        measured=measured,
        weight=weight,
        judged=plain.judged & np.isfinite(measured[:, 0]),  # torque, current and duty may have empty cells
        block=plain.block,
        group=plain.group,
        trust=np.ones(measured.shape),
        models=tuple(models),
        link=link,
        first=first,
    )


def is_elastic(model: JointModel) -> bool:
    """Whether motor and link of a joint move apart."""
    return any(model.chain.find(stage) is not None for stage in ("spring", "compliance", "backlash"))


def _link(run: MeasuredRun, joint: str) -> np.ndarray:
    """Motion of the link (n, 3): as logged, and its derivatives from local parabolas."""
    log = run.joints[joint]
    position = log.position if log.link_position is None else log.link_position
    good = np.isfinite(position)
    position = np.interp(run.time, run.time[good], position[good])
    _, speed, acceleration = derivatives(run.time, position)
    return np.stack([position, speed, acceleration], axis=1)
