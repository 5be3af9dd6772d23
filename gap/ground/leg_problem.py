"""Stances of a legged log as a problem that the search understands: errors of whole-leg replays, in units of noise.

A replay starts from a measured state, which is known only so well, and an error of the start grows over the stance. So
errors are weighed by their covariance: noise of the columns, and what the start state's uncertainty makes of them (to
first order).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from ..log.parts import ENOUGH_RUNS, TEST, Unit, held_out
from ..log.types import MeasuredRun
from ..replay.problem import CALIBRATION
from ..replay.robust import robust_loss
from ..replay.selection import select
from .leg_model import LegModel
from .leg_replay import STEP, LegReplay
from .stances import COLUMNS, Stance, columns

FLOOR = 0.8  # squared error over that of the noise that a right model reaches: the noise is known with a margin
CONTACT_ERROR = 0.1  # relative, of friction, stiffness and damping: assumed, about what an independent leg showed
FIRST = 0.015  # [s] of a piece that is not judged: the start state was fitted to it
MODEL = np.array([1.5e-4, 2e-4, 1e-3, 1e-3])
"""What two right models of hard contact differ by over a stance, in the judged columns [m, m, rad, rad]: assumed, from
replays of an independent leg on rigid ground. Errors this small say nothing about the ground."""


@dataclass(frozen=True, eq=False)
class LegProblem:
    """Stances as units; the judged columns as channels, the height of the hip first.

    It is a :class:`sealegs.gap.replay.problem.Problem`.

    Attributes:
        units: stances.
        time: of the samples of all stances since the start of their run, one behind the other (n,) [s].
        starts: first sample of each stance and the end of the last (u + 1,).
        measured: judged columns (n, 4), NaN where not logged.
        weight: one over the noise of each column (4,), 0 where it was not logged.
        judged: samples that count (n,).
        models: the leg as believed, the same for all runs.
        replayer: the engine, with all stances in it.
        rows: number of each unit's stance in the replayer.
        whitening: per unit, matrix that turns its errors, in parts of the noise, into independent ones (m, m).
        correction: per unit, matrix that takes from them what is the start state's (m, m).
    """

    units: tuple[Unit, ...]
    time: np.ndarray
    starts: np.ndarray
    measured: np.ndarray
    weight: np.ndarray
    judged: np.ndarray
    models: tuple[LegModel, ...]
    replayer: LegReplay
    rows: tuple[int, ...]
    whitening: tuple[np.ndarray, ...]
    correction: tuple[np.ndarray, ...]

    @property
    def joint(self) -> None:
        """None: a leg has several."""
        return None

    @property
    def free_joint(self) -> None:
        """None, likewise."""
        return None

    @property
    def open_loop(self) -> bool:
        """Goals hold its joints."""
        return False

    @property
    def sampled(self) -> tuple[int, ...]:
        """All columns are compared sample by sample."""
        return tuple(range(len(COLUMNS)))

    @property
    def groups(self) -> int:
        """None are averaged."""
        return 0

    @property
    def step(self) -> float:
        """Step of the engine [s]."""
        return STEP

    @property
    def temperature_range(self) -> float:
        """None: contact depends on no temperature [K]."""
        return 0.0

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the judged columns."""
        return COLUMNS

    @property
    def signal(self) -> tuple[str, str]:
        """The column that the gap is told in, and its unit."""
        return COLUMNS[0], "m"

    @property
    def noise(self) -> float:
        """Noise floor of the hip's height [m]."""
        return 1.0 / float(self.weight[0])

    def covariates(self, simulated: np.ndarray) -> dict[str, np.ndarray]:
        """None: errors are independent here, so that their structure needs no learner."""
        del simulated
        return {}

    def left_over(self, simulated: np.ndarray) -> float | None:
        """Mean squared error beyond the noise, in parts of it; errors are independent here, so it needs no learner."""
        return max(float(np.mean(self.residual(simulated[None])[0] ** 2)) - FLOOR, 0.0)

    def excess_loss(self, simulated: np.ndarray) -> float | None:
        """Loss per judged value beyond that of noise, whose size is known with a margin."""
        return float(robust_loss(self.residual(simulated[None])[0]).mean()) - FLOOR

    def chain(self, values: Mapping[str, float]) -> None:
        """None: a leg on the ground has a chain for each of its joints."""
        del values

    def mjcf(self, values: Mapping[str, float]) -> str:
        """The whole leg, its joints as diagnosed, on the ground that was found."""
        return self.models[0].with_fitted(values).drivetrain().spec.to_xml()

    def picture(self, named: str) -> str:
        """A stance, whatever the cause."""
        del named
        return "stance"

    def systematic_error(self, path: str) -> float:
        """Two right models of contact agree on the slope, and only roughly on what the ground does with a force."""
        return CALIBRATION if path == "contact.slope" else CONTACT_ERROR

    def part(self, *parts: int) -> Self:
        """The problem that has only the stances of these parts."""
        kept = select(self.units, self.starts, parts)
        return replace(
            self,
            units=kept.units,
            starts=kept.starts,
            time=self.time[kept.rows],
            measured=self.measured[kept.rows],
            judged=self.judged[kept.rows],
            rows=tuple(self.rows[k] for k in kept.numbers),
            whitening=tuple(self.whitening[k] for k in kept.numbers),
            correction=tuple(self.correction[k] for k in kept.numbers),
        )

    def with_step_factor(self, factor: float) -> Self:
        """The problem itself: the engine's step is the same whatever plays or switches."""
        del factor
        return self

    def weighed(self, values: Mapping[str, float]) -> LegProblem:
        """The problem with the uncertainty of the start states carried through another ground.

        Where the ground is far from what was believed, so is what an error of the start makes of a stance.
        """
        leg = self.models[0].with_fitted(values)
        whitening, correction = _weigh(self.replayer, leg, self.rows, self.weight, self.judged, self.starts)
        return replace(self, whitening=whitening, correction=correction)

    def simulate(self, variants: Sequence[Mapping[str, float]], step: float | None = None) -> np.ndarray:
        """Replay every stance on the ground of every variant: judged columns (v, n, 4)."""
        del step
        legs = [self.models[0].with_fitted(values) for values in variants]
        return np.concatenate(self.replayer.simulate(legs, self.rows), axis=1)

    def residual(self, simulated: np.ndarray, every: int = 1) -> np.ndarray:
        """Independent errors (v, m) of simulated columns (v, n, 4), in parts of the noise, of all judged samples."""
        del every  # whitening mixes the samples of a stance
        return np.concatenate(
            [
                np.clip(errors.reshape(len(simulated), -1) @ matrix.T, -1e6, 1e6)
                for errors, matrix in zip(self._errors(simulated), self.whitening, strict=True)
            ],
            axis=1,
        )

    def _errors(self, simulated: np.ndarray) -> list[np.ndarray]:
        """Errors of each unit at its judged samples in parts of the noise (v, samples, logged columns)."""
        used = self.weight > 0.0
        scaled = np.nan_to_num((simulated - self.measured)[..., used] * self.weight[used])
        return [scaled[:, a:b][:, self.judged[a:b]] for a, b in zip(self.starts[:-1], self.starts[1:], strict=True)]

    def blocks(self) -> tuple[np.ndarray, np.ndarray]:
        """Block of each entry of :meth:`residual`: its stance; and entries per block."""
        counts = np.array([len(matrix) for matrix in self.whitening])
        return np.repeat(np.arange(len(counts)), counts), counts

    def block_errors(self, simulated: np.ndarray) -> np.ndarray:
        """Sum of the losses of independent errors per stance (u,), of one variant (n, 4)."""
        return np.bincount(self.blocks()[0], robust_loss(self.residual(simulated[None])[0]))

    def position_error(self, simulated: np.ndarray) -> np.ndarray:
        """Errors of the hip's height [m] of one variant (n, 4), less what the start state's uncertainty explains."""
        return self.errors(simulated)[self.judged, 0]

    def errors(self, simulated: np.ndarray) -> np.ndarray:
        """Errors of one variant (n, 4) as :meth:`position_error`, in the columns' units, NaN where not judged."""
        out = np.full(simulated.shape, np.nan)
        used = np.flatnonzero(self.weight > 0.0)
        units = zip(self._errors(simulated[None]), self.correction, self.starts[:-1], self.starts[1:], strict=True)
        for errors, matrix, a, b in units:
            rows = np.arange(a, b)[self.judged[a:b]]
            out[np.ix_(rows, used)] = (matrix @ errors[0].ravel()).reshape(-1, len(used)) / self.weight[used]
        return out


def leg_problem(
    runs: Sequence[MeasuredRun],
    leg: LegModel,
    stances: Sequence[Stance],
    noise: np.ndarray,
    test_group: str | None = None,
) -> LegProblem:
    """Lay stances out; they are dealt to the parts in turn, by runs where there are enough of them.

    With a test group, its stances are the test part, and the others are dealt to the two parts that are fitted.

    Args:
        runs: of one machine.
        leg: nominal, with its joints as diagnosed.
        stances: of :func:`sealegs.gap.ground.stances.find_stances`.
        noise: rms error of a sample of each judged column (4,), NaN where it was not logged.
        test_group: group of runs to keep for the test.

    Raises:
        LogError: the test group does not exist, or nothing is left to fit on.
    """
    parts = _dealt(stances, held_out(runs, test_group))
    replayer = LegReplay(leg, runs, stances, STEP)
    units, times, measured, starts = [], [], [], [0]
    for k, stance in enumerate(stances):
        run, part = runs[stance.run], slice(stance.start, stance.stop)
        time = run.time[part]
        first = int(np.searchsorted(time, time[0] + FIRST))
        units.append(
            Unit(stance.run, parts[k], stance.start, stance.stop, first,
                 (float(stance.state[0]), float(stance.state[4])))
        )  # fmt: skip
        times.append(time - run.time[0])
        measured.append(columns(run)[part])
        starts.append(starts[-1] + len(time))
    total = np.hypot(noise, MODEL)
    weight = np.where(np.isfinite(total), 1.0 / np.where(np.isfinite(total), total, 1.0), 0.0)
    judged = np.concatenate([np.arange(unit.stop - unit.start) >= unit.judged for unit in units])
    rows, bounds = tuple(range(len(stances))), np.array(starts)
    whitening, correction = _weigh(replayer, leg, rows, weight, judged, bounds)
    return LegProblem(
        units=tuple(units),
        time=np.concatenate(times),
        starts=bounds,
        measured=np.concatenate(measured),
        weight=weight,
        judged=judged,
        models=(leg,),
        replayer=replayer,
        rows=rows,
        whitening=whitening,
        correction=correction,
    )


def _dealt(stances: Sequence[Stance], held: frozenset[int]) -> list[int]:
    """The part of each stance: test for those of the runs held out, the others in turn or by runs."""
    others = [k for k, stance in enumerate(stances) if stance.run not in held]
    used = sorted({stances[k].run for k in others})
    by_run = len(used) >= ENOUGH_RUNS
    count = 2 if held else 3  # FIT_A and FIT_B, and TEST where no group is held out for it
    parts = [TEST] * len(stances)
    for n, k in enumerate(others):
        parts[k] = (used.index(stances[k].run) if by_run else n) % count
    return parts


def _weigh(
    replayer: LegReplay,
    leg: LegModel,
    rows: Sequence[int],
    weight: np.ndarray,
    judged: np.ndarray,
    starts: np.ndarray,
) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
    """Whitening and correction of every stance, from the leg's answer to its start state."""
    stances = [replayer.stances[row] for row in rows]
    moved = [np.array([stance.state for stance in stances])]
    moved += [np.array([stance.state + stance.spread * (np.arange(8) == k) for stance in stances]) for k in range(8)]
    paths = replayer.simulate([leg] * 9, rows, np.stack(moved))
    whitening, correction = [], []
    for path, a, b in zip(paths, starts[:-1], starts[1:], strict=True):
        change = ((path[1:] - path[0]) * weight)[..., weight > 0.0][:, judged[a:b]].reshape(8, -1).T
        left, size, _ = np.linalg.svd(change, full_matrices=False)
        one = np.eye(len(change))
        whitening.append(one - (left * (1.0 - 1.0 / np.sqrt(1.0 + size**2))) @ left.T)
        correction.append(one - (left * (size**2 / (1.0 + size**2))) @ left.T)
    return tuple(whitening), tuple(correction)
