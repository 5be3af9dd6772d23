"""Pieces of a legged log as a problem that the search understands: errors of whole-robot replays, in units of noise.

A replay starts from a measured state, which is known only so well, and an error of the start grows over the stance. So
errors are weighed by their covariance: noise of the columns, and what the start state's uncertainty makes of them (to
first order).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from ..causes.catalogue import checked
from ..causes.cause import Cause, alone
from ..log.finding import Finding
from ..log.parts import ENOUGH_RUNS, FIT_A, FIT_B, PARTS, TEST, Unit, held_out
from ..log.types import MeasuredRun
from ..replay.comparison import robust_loss
from ..replay.parameters import Parameter
from ..replay.problem import CALIBRATION, Problem
from .pieces import ENGINE_STEP, Grounded, Piece, Replayer

RIGHT_MODEL_LOSS = 0.8
"""Squared error over that of the noise that a right model reaches: the noise is known with a margin."""
CONTACT_ERROR = 0.1  # relative, of friction, stiffness and damping: assumed, about what an independent leg showed


@dataclass(frozen=True)
class Judged:
    """What is compared: columns of the log, in one order everywhere.

    Attributes:
        names: of the columns.
        units: m or rad, of each.
        model_error: what two right models of contact differ by over a piece, in each [m or rad].
        noise: rms error of a sample of each [m or rad], NaN where it was not logged.
        first: time of a piece that is not judged [s]: the start state was fitted to it.
        law_error: relative, of what the ground does with a force, between two right models of contact.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    model_error: np.ndarray
    noise: np.ndarray
    first: float
    law_error: float = CONTACT_ERROR

    @property
    def weight(self) -> np.ndarray:
        """One over the noise of each column, 0 where it was not logged."""
        total = np.hypot(self.noise, self.model_error)
        return np.where(np.isfinite(total), 1.0 / np.where(np.isfinite(total), total, 1.0), 0.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class GroundProblem(Problem):
    """Pieces as units; the judged columns as channels.

    Attributes:
        columns: what is judged.
        models: the robot as believed, the same for all runs.
        replayer: the engine, with all pieces in it.
        rows: number of each unit's piece in the replayer.
        whitening: per unit, matrix that turns its errors, in parts of the noise, into independent ones (m, m).
        correction: per unit, matrix that takes from them what is the start state's (m, m).
    """

    columns: Judged
    models: tuple[Grounded, ...]
    replayer: Replayer[Any]
    rows: tuple[int, ...]
    whitening: tuple[np.ndarray, ...]
    correction: tuple[np.ndarray, ...]

    per_unit: ClassVar[tuple[str, ...]] = ("rows", "whitening", "correction")

    @property
    def sampled(self) -> tuple[int, ...]:
        """All columns are compared sample by sample."""
        return tuple(range(len(self.columns.names)))

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the judged columns."""
        return self.columns.names

    @property
    def signal(self) -> tuple[str, str]:
        """The column that the gap is told in, and its unit."""
        return self.columns.names[self.told_in], self.columns.units[self.told_in]

    def left_over(self, simulated: np.ndarray) -> float | None:
        """Mean squared error beyond the noise, in parts of it; errors are independent here, so it needs no learner."""
        return max(float(np.mean(self.residual(simulated[None])[0] ** 2)) - RIGHT_MODEL_LOSS, 0.0)

    def excess_loss(self, simulated: np.ndarray) -> float | None:
        """Loss per judged value beyond that of noise, whose size is known with a margin."""
        return float(robust_loss(self.residual(simulated[None])[0]).mean()) - RIGHT_MODEL_LOSS

    def mjcf(self, values: Mapping[str, float]) -> str:
        """The whole robot, its joints as diagnosed, on the ground that was found."""
        return self.models[0].with_fitted(values).mjcf()

    def picture(self, named: str) -> str:
        """A stance, whatever the cause."""
        del named
        return "stance"

    def systematic_error(self, path: str) -> float:
        """Two right models of contact agree on the slope, and only roughly on what the ground does with a force."""
        return CALIBRATION if path.startswith("contact.slope") else self.columns.law_error

    def weighed(self, values: Mapping[str, float]) -> Self:
        """The problem with the uncertainty of the start states carried through another ground.

        Where the ground is far from what was believed, so is what an error of the start makes of a stance.
        """
        robot = self.models[0].with_fitted(values)
        whitening, correction = _weigh(self.replayer, robot, self.rows, self.weight, self.judged, self.starts)
        return replace(self, whitening=whitening, correction=correction)

    def simulate(self, variants: Sequence[Mapping[str, float]], step: float | None = None) -> np.ndarray:
        """Replay every stance on the ground of every variant: judged columns (v, n, c)."""
        del step
        robots = [self.models[0].with_fitted(values) for values in variants]
        return np.concatenate(self.replayer.simulate(robots, self.rows), axis=1)

    def residual(self, simulated: np.ndarray, every: int = 1) -> np.ndarray:
        """Independent errors (v, m) of simulated columns (v, n, c), in parts of the noise, of all judged samples."""
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

    def position_error(self, simulated: np.ndarray) -> np.ndarray:
        """Errors of the column that the gap is told in, of one variant (n, c) [m or rad], less what
        the start state's uncertainty explains.
        """
        return self.errors(simulated)[self.judged, self.told_in]

    def errors(self, simulated: np.ndarray) -> np.ndarray:
        """Errors of one variant (n, c) as :meth:`position_error`, in the columns' units, NaN where not judged."""
        out = np.full(simulated.shape, np.nan)
        used = np.flatnonzero(self.weight > 0.0)
        units = zip(self._errors(simulated[None]), self.correction, self.starts[:-1], self.starts[1:], strict=True)
        for errors, matrix, a, b in units:
            rows = np.arange(a, b)[self.judged[a:b]]
            out[np.ix_(rows, used)] = (matrix @ errors[0].ravel()).reshape(-1, len(used)) / self.weight[used]
        return out


def ground_problem(
    runs: Sequence[MeasuredRun],
    model: Grounded,
    replayer: Replayer[Any],
    columns: Judged,
    values: Sequence[np.ndarray],
    test_group: str | None = None,
) -> GroundProblem:
    """Lay pieces out; they are dealt to the parts in turn, by runs where there are enough of them.

    With a test group, its pieces are the test part, and the others are dealt to the two parts that are fitted.

    Args:
        runs: of one machine.
        model: nominal, with its joints as diagnosed.
        replayer: with the pieces in it.
        columns: that are judged.
        values: of them in each run (n, c), NaN where not logged.
        test_group: group of runs to keep for the test.

    Raises:
        LogError: the test group does not exist, or nothing is left to fit on.
    """
    pieces = replayer.pieces
    parts = _dealt(pieces, held_out(runs, test_group))
    units, times, measured, starts = [], [], [], [0]
    for k, piece in enumerate(pieces):
        part = slice(piece.start, piece.stop)
        time = runs[piece.run].time[part]
        first = int(np.searchsorted(time, time[0] + columns.first))
        speed = float(piece.state[len(piece.state) // 2])
        units.append(Unit(piece.run, parts[k], piece.start, piece.stop, first, (float(piece.state[0]), speed)))
        times.append(time - runs[piece.run].time[0])
        measured.append(values[piece.run][part])
        starts.append(starts[-1] + len(time))
    weight = columns.weight
    judged = np.concatenate([np.arange(unit.stop - unit.start) >= unit.judged for unit in units])
    rows, bounds = tuple(range(len(pieces))), np.array(starts)
    whitening, correction = _weigh(replayer, model, rows, weight, judged, bounds)
    return GroundProblem(
        units=tuple(units),
        time=np.concatenate(times),
        starts=bounds,
        columns=columns,
        measured=np.concatenate(measured),
        weight=weight,
        judged=judged,
        models=(model,),
        step=ENGINE_STEP,
        replayer=replayer,
        rows=rows,
        whitening=whitening,
        correction=correction,
    )


def _dealt(stances: Sequence[Piece], held: frozenset[int]) -> list[int]:
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
    replayer: Replayer[Any],
    robot: Grounded,
    rows: Sequence[int],
    weight: np.ndarray,
    judged: np.ndarray,
    starts: np.ndarray,
) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
    """Whitening and correction of every piece, from the robot's answer to its start state."""
    pieces = [replayer.pieces[row] for row in rows]
    size = len(pieces[0].state)
    moved = [np.array([piece.state for piece in pieces])]
    moved += [np.array([piece.state + piece.spread * (np.arange(size) == k) for piece in pieces]) for k in range(size)]
    paths = replayer.simulate([robot] * (size + 1), rows, np.stack(moved))
    whitening, correction = [], []
    for path, a, b in zip(paths, starts[:-1], starts[1:], strict=True):
        change = ((path[1:] - path[0]) * weight)[..., weight > 0.0][:, judged[a:b]].reshape(size, -1).T
        left, sizes, _ = np.linalg.svd(change, full_matrices=False)
        one = np.eye(len(change))
        whitening.append(one - (left * (1.0 - 1.0 / np.sqrt(1.0 + sizes**2))) @ left.T)
        correction.append(one - (left * (sizes**2 / (1.0 + sizes**2))) @ left.T)
    return tuple(whitening), tuple(correction)


# --- A legged log laid out for a search of its ground, whatever the robot, and what that ground may be ---------------

CONTACT_TIME_FACTOR = 3.0
"""Factor on the time constant of the engine's contact that fits may take: it stands for no number of the machine."""
MIN_PIECES = 3 * len(PARTS)  # pieces, three for each part of the data


@dataclass(frozen=True, eq=False)
class Laid:
    """Pieces of a log, and what is sought in them.

    Attributes:
        problem: the pieces.
        causes: the catalogue, or those of the names that are given.
        tuned: numbers of the ground that every fit tunes, and refits.
        pieces: what they are called.
        advice: what would show what they do not.
        findings: about the log.
        needs_joints: whether drives take part in a replay, so that their errors may look like the ground's.
        by_worst: whether the gap is told in the column where the nominal robot is most wrong; else in the first.
    """

    problem: GroundProblem
    causes: Callable[[Sequence[str] | None], list[Cause]]
    tuned: tuple[Parameter, ...]
    pieces: str
    advice: str
    findings: tuple[Finding, ...] = ()
    needs_joints: bool = False
    by_worst: bool = False

    def told(self, problem: GroundProblem) -> GroundProblem:
        """The problem with its gap told in the column where that is to be."""
        if not self.by_worst:
            return problem
        fitted = problem.part(FIT_A, FIT_B)
        errors = fitted.errors(fitted.simulate([{}])[0]) * fitted.weight
        used = fitted.weight > 0.0
        size = np.where(used, np.nan_to_num(np.nanmean(np.where(used, errors, 0.0) ** 2, axis=0)), -1.0)
        return replace(problem, told_in=int(np.argmax(size)))


def too_few(count: int, tested: int, held: bool, group: str | None, pieces: str) -> str | None:
    """Why pieces are too few for three parts of the data, in a sentence; None where they are enough.

    Args:
        count: of all pieces.
        tested: of them in the group that is kept for the test.
        held: whether there is one.
        group: its name.
        pieces: what they are called.
    """
    if held and (tested < MIN_PIECES // 3 or count - tested < MIN_PIECES - MIN_PIECES // 3):
        return (
            f"of {count} {pieces} {tested} are in the group '{group}'; {MIN_PIECES // 3} are needed there to "
            f"test on and {MIN_PIECES - MIN_PIECES // 3} in the others to fit on."
        )
    return None


def ground_causes(
    stiffness: Sequence[float],
    stiffest: float,
    soft: float,
    shown: Mapping[str, str],
    slopes: Sequence[str] = ("contact.slope",),
    names: Sequence[str] | None = None,
    *,
    damped: bool = True,
) -> list[Cause]:
    """The catalogue of the ground under a robot.

    Args:
        stiffness: from which fits of soft ground start [N/m].
        stiffest: ground that still counts as soft [N/m].
        soft: ground that is plausible [N/m].
        shown: column that shows each cause best, by its name.
        slopes: numbers of the ground's slope; those that the robot can feel.
        names: of the causes to consider; default: all of them.
        damped: whether the damping of soft ground is fitted with it; else it is tuned in every fit.
    """
    friction = Parameter("contact.friction", "1", 0.05, 4.0, 0.4, 0.2, logarithmic=True, factor=True)
    damping = Parameter("contact.damping", "N.s/m", 1.0, 300.0, 20.0, 0.4, logarithmic=True, shape=True)
    soft_ground = Parameter("contact.stiffness", "N/m", 200.0, stiffest, stiffness[0], 0.3, logarithmic=True)
    gives = [(*variant, damping) if damped else variant for variant in alone(soft_ground, *stiffness)]
    slope = tuple(Parameter(name, "rad", -0.4, 0.4, 0.0, 0.01) for name in slopes)
    every = [
        Cause(
            name="contact.friction",
            sentence="The foot slides on less, or holds on more, friction than the model has.",
            picture="stance",
            against=shown["contact.friction"],
            plausible={"contact.friction*": 0.5},
            variants=alone(friction, 0.4, 0.8),
            error=True,
        ),
        Cause(
            name="contact.stiffness",
            sentence="The ground gives way under the foot.",
            picture="stance",
            against=shown["contact.stiffness"],
            plausible={"contact.stiffness": soft},
            variants=tuple(gives),
        ),
        Cause(
            name="contact.slope",
            sentence="The ground is not level.",
            picture="stance",
            against=shown["contact.slope"],
            plausible={slopes[0]: 0.02},
            variants=(slope,),
        ),
    ]
    return [cause for cause in every if cause.name in checked(names)]
