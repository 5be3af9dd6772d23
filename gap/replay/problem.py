"""The data of one joint laid out for the simulator, and the residual of any model on any part of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Literal

import numpy as np

from ...actuators import Chain
from ...actuators.stages.base import ChainError
from ...actuators.stages.motor import Thermal
from ..load.pendulum import bench_parameters
from ..log.parts import Unit
from ..log.types import LogError, MeasuredRun
from .joint_model import JointModel
from .robust import robust_loss
from .simulator import CHANNELS, ELASTIC_STEP, EVENT_STEP, SWITCHING, replay_many

BLOCK = 1.0  # [s] errors closer than this are taken as one observation, since they are not independent
GROUP = (
    0.025  # [s] duty and current are compared as means over this long: a command that arrives a sample early is no gap
)
CALIBRATION = 0.01  # relative error that columns and simulation share in all data
ROOM = Thermal.temperature  # [degC] of a motor whose temperature was not logged
FLAT = (
    "time",
    "goal",
    "on",
    "temperature",
    "measured",
    "judged",
    "block",
    "group",
    "trust",
)  # fields with one entry per sample


@dataclass(frozen=True, eq=False)
class Problem:
    """Units of one joint as flat arrays.

    Attributes:
        units: pieces of runs.
        params: bench parameters of each run; empty where the link is driven.
        time, goal, on, temperature: samples of all units one behind the other (n,).
        starts: first sample of each unit and the end of the last (u + 1,).
        states: of the units at their start (u, 2).
        measured: channels as :data:`sealegs.gap.replay.simulator.CHANNELS` (n, 4), NaN where not logged.
        weight: one over the noise of each channel (4,), 0 where it does not count.
        judged: samples that count (n,).
        block: number of the block each sample belongs to (n,).
        group: number of the group of samples over which duty and current are averaged (n,), -1 where they do not count.
        trust: factor on the weight of duty and current (n, 4), the same for all samples of a group
        (:mod:`sealegs.gap.search.channels`).
        models: nominal joint of each run (they may differ, for example in their gain).
        step: largest step of the simulator [s], see :func:`converged`.
        coarse: how many times longer the step of play and of firmware that switches is than :func:`largest_step`.
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

    kind: ClassVar[Literal["free", "driven", "ground"]] = "free"  # how it is replayed, and so drawn and written
    sampled: ClassVar[tuple[int, ...]] = (0, 1)  # channels compared sample by sample
    averaged: ClassVar[tuple[int, ...]] = (2, 3)  # and as means over groups of samples
    flat: ClassVar[tuple[str, ...]] = FLAT

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels that are replayed."""
        return CHANNELS

    @property
    def signal(self) -> tuple[str, str]:
        """The first channel, which is judged sample by sample, and its unit."""
        return "position", "rad"

    def motion(self, simulated: np.ndarray) -> np.ndarray:
        """Position, speed and acceleration (n, 3) [rad, rad/s, rad/s2] of the joint in a model (n, 4)."""
        out = np.empty((len(self.time), 3))
        for a, b in zip(self.starts[:-1], self.starts[1:], strict=True):
            time, position = self.time[a:b], simulated[a:b, 0]
            speed = np.gradient(position, time)
            out[a:b] = np.stack([position, speed, np.gradient(speed, time)], axis=1)
        return out

    def left_over(self, simulated: np.ndarray) -> float | None:
        """Mean squared error of a model (n, 4) beyond the noise, in parts of it, where the problem itself can tell."""
        del simulated
        return None

    def beyond_noise(self, simulated: np.ndarray) -> float | None:
        """Loss per judged value of a model (n, 4) beyond that of noise, where the problem itself can tell."""
        del simulated
        return None

    def chain(self, values: Mapping[str, float]) -> Chain | None:
        """The chain of the first run with fitted values; None where the problem is not that of one joint."""
        return self.models[0].with_fitted(values).chain

    def doubt(self, path: str) -> float:
        """Relative error of a number that columns and simulation share in all data."""
        del path
        return CALIBRATION

    @property
    def noise(self) -> float:
        """Noise floor of the position [rad]."""
        return 1.0 / float(self.weight[0])

    def part(self, *parts: int) -> Problem:
        """The problem that has only the units of these parts: what is not in it cannot be seen by accident."""
        chosen = [k for k, unit in enumerate(self.units) if unit.part in parts]
        if not chosen:
            raise LogError(
                "the logs are too short to keep some for choosing and testing; record more runs or longer ones."
            )
        rows = np.concatenate([np.arange(self.starts[k], self.starts[k + 1]) for k in chosen])
        sizes = [self.starts[k + 1] - self.starts[k] for k in chosen]
        flat = {key: getattr(self, key)[rows] for key in self.flat}
        return replace(
            self,
            units=tuple(self.units[k] for k in chosen),
            starts=np.concatenate([[0], np.cumsum(sizes)]).astype(int),
            states=self.states[chosen],
            **flat,
        )

    def simulate(self, variants: Sequence[Mapping[str, float]], step: float | None = None) -> np.ndarray:
        """Replay every unit with every variant of the nominal models.

        Args:
            variants: parameters by path, each set on the nominal joint of every run.
            step: largest step [s], where :func:`largest_step` allows it; default: the problem's.

        Returns:
            Channels (v, n, 4). A variant whose values make no chain is far from anything measured.
        """
        programs, constants, steps, valid = [], [], [], []
        for values in variants:
            try:
                joints = [model.with_fitted(values) for model in self.models]
            except ChainError:
                joints = None
            valid.append(joints is not None)
            joints = joints or list(self.models)
            per_run = [joint.chain.program() for joint in joints]
            programs.append(per_run)
            rows = [
                joint.constants(params, program)
                for joint, params, program in zip(joints, self.params, per_run, strict=True)
            ]
            constants.append(rows)
            steps.append(min(step or self.step, largest_step(joints[0].chain, self.coarse)))
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
            self._replay(slice(lo, hi), table, k, starts, self.states[chosen], np.array(steps), part)
            out[:, lo:hi] = part
        out[~np.array(valid)] = 1e3
        return out

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
        """Replay the units in ``rows`` into ``out``, as :func:`sealegs.gap.replay.simulator.replay_many`."""
        time, goal, on, temperature = self.time[rows], self.goal[rows], self.on[rows], self.temperature[rows]
        replay_many(programs, constants, time, goal, on, temperature, starts, states, steps, out)

    @cached_property
    def _groups(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Samples that are averaged, where each group starts among them, and how many samples it has."""
        rows = np.flatnonzero(self.group >= 0)
        starts = np.flatnonzero(np.diff(self.group[rows], prepend=-1))
        return rows, starts, np.diff(np.append(starts, len(rows)))

    @property
    def groups(self) -> int:
        """How many groups of samples are averaged."""
        return len(self._groups[1])

    def means(self, signal: np.ndarray) -> np.ndarray:
        """Means (..., g) of a signal (..., n) over the groups of samples; NaN where one of them is missing."""
        rows, starts, sizes = self._groups
        return np.add.reduceat(signal[..., rows], starts, axis=-1) / sizes if len(rows) else signal[..., rows]

    def residual(self, simulated: np.ndarray, every: int = 1) -> np.ndarray:
        """Weighted errors (v, m) of simulated channels (v, n, 4).

        Of (every so many of) the judged samples, then of the groups of samples.

        What was not logged is zero.
        """
        rows = np.flatnonzero(self.judged)[::every]
        errors = [
            (simulated[:, rows, c] - self.measured[rows, c]) * self.weight[c]
            for c in self.sampled
            if self.weight[c] > 0.0
        ]
        first = self._groups[0][self._groups[1]]
        errors += [
            (self.means(simulated[:, :, c] - self.measured[:, c]) * (self.weight[c] * self.trust[first, c]))[:, ::every]
            for c in self.averaged
            if self.weight[c] > 0.0
        ]
        error = np.concatenate(errors, axis=1)
        return np.clip(np.where(np.isfinite(error), error, 0.0), -1e6, 1e6)

    @cached_property
    def _blocks(self) -> tuple[np.ndarray, np.ndarray]:
        rows, starts, _ = self._groups
        parts = [self.block[self.judged] for c in self.sampled if self.weight[c] > 0.0]
        parts += [self.block[rows[starts]] for c in self.averaged if self.weight[c] > 0.0]
        _, number = np.unique(np.concatenate(parts), return_inverse=True)
        return number, np.bincount(number)

    def blocks(self) -> tuple[np.ndarray, np.ndarray]:
        """Block number of each entry of :meth:`residual` (m,), counted from zero, and entries per block (b,)."""
        return self._blocks

    def block_errors(self, simulated: np.ndarray) -> np.ndarray:
        """Sum of the losses of weighted errors per block (b,), of one variant (n, 4); see :mod:`gap.replay.robust`."""
        return np.bincount(self.blocks()[0], robust_loss(self.residual(simulated[None])[0]))

    def position_error(self, simulated: np.ndarray) -> np.ndarray:
        """Position errors [rad] of one variant (n, 4) at the judged samples."""
        return (simulated[:, 0] - self.measured[:, 0])[self.judged]


def largest_step(chain: Chain, coarse: float = 1.0) -> float:
    """The largest step that resolves what lies between motor and link, and firmware that switches [s].

    ``coarse`` is how many times longer that of teeth and switches may be.
    """
    play = chain.find("backlash")
    if (play is not None and play.width > 0.0) or any(chain.find(stage) is not None for stage in SWITCHING):
        return EVENT_STEP * coarse
    return ELASTIC_STEP if chain.find("spring") is not None or chain.find("compliance") is not None else np.inf


STEPS = (2.5e-3, 1.7e-3, 1e-3, 5e-4, 2.5e-4, 1e-4)  # [s]


def converged(problem: Problem) -> Problem:
    """The problem with the largest step that is not a gap of its own.

    Halving it changes the replay by less than a tenth of the noise; :func:`largest_step` bounds it where that is less.

    A quarter would be invisible in the error, but not to a search that looks for structure in it.
    """
    for step in STEPS:
        whole, halved = (problem.position_error(problem.simulate([{}], s)[0]) for s in (step, step / 2.0))
        if np.sqrt(np.mean((whole - halved) ** 2)) < 0.1 * problem.noise:
            break
    return replace(problem, step=step)


def lay_out(
    runs: Sequence[MeasuredRun],
    joint: str,
    models: Sequence[JointModel],
    units: Sequence[Unit],
    weight: Mapping[str, float],
) -> Problem:
    """Lay the runs of one joint out.

    Args:
        runs, units: of :func:`sealegs.gap.log.parts.cut`.
        models: nominal joint of each run.
        weight: one over the noise, by channel; channels without one do not count.

    Raises:
        LogError: the joint has no commands.
    """
    units = sorted(units, key=lambda unit: (unit.run, unit.start))
    columns: dict[str, list[np.ndarray]] = {key: [] for key in FLAT if key not in ("measured", "trust")}
    measured, starts, blocks, groups = [], [0], 0, 0
    for unit in units:
        log, time = runs[unit.run].joints[joint], runs[unit.run].time
        if log.goal is None:
            raise LogError(f"{runs[unit.run].name}: joint '{joint}' has no goal to replay.")
        part = slice(unit.start, unit.stop)
        count = unit.stop - unit.start
        columns["time"].append(time[part] - time[0])
        columns["goal"].append(log.goal[part])
        columns["on"].append(np.ones(count, bool) if log.enabled is None else log.enabled[part] > 0.5)
        warm = np.full(count, ROOM) if log.temperature is None else log.temperature[part]
        columns["temperature"].append(_without_gaps(time[part], warm))
        columns["judged"].append(np.arange(count) >= unit.judged)
        block = ((time[part] - time[unit.start]) / BLOCK).astype(int)
        columns["block"].append(block + blocks)
        blocks += int(block[-1]) + 1
        group = ((time[part] - time[unit.start]) / GROUP).astype(int)
        counts = (np.arange(count) >= unit.judged) & columns["on"][-1]
        columns["group"].append(np.where(counts, group + groups, -1))
        groups += int(group[-1]) + 1
        missing = np.full(count, np.nan)
        signals = [getattr(log, channel) for channel in CHANNELS]
        measured.append(np.stack([missing if signal is None else signal[part] for signal in signals], axis=1))
        starts.append(starts[-1] + count)
    flat: dict[str, Any] = {key: np.concatenate(value) for key, value in columns.items()}
    return Problem(
        units=tuple(units),
        params=tuple(bench_parameters(run.robot_params, run.name) if run.robot == "bench" else {} for run in runs),
        starts=np.array(starts),
        states=np.array([unit.state for unit in units]),
        measured=np.concatenate(measured),
        trust=np.ones((starts[-1], len(CHANNELS))),
        weight=np.array([weight.get(channel, 0.0) for channel in CHANNELS]),
        models=tuple(models),
        **flat,
    )


def _without_gaps(time: np.ndarray, temperature: np.ndarray) -> np.ndarray:
    """A temperature (n,) without the steps of its resolution; what was polled less often than the rest lies between."""
    read = np.isfinite(temperature)
    if not read.any():
        return np.full(len(time), ROOM)
    return between_steps(time, np.interp(time, time[read], temperature[read]))


def between_steps(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """A slow signal (n,) without the steps of its resolution: straight lines between the middles of its changes."""
    change = np.flatnonzero(np.diff(values))
    if len(change) == 0 or len(change) > len(values) // 10:
        return values
    middle = 0.5 * (values[change] + values[change + 1])
    return np.interp(time, 0.5 * (time[change] + time[change + 1]), middle)
