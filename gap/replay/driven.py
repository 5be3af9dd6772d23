"""Driven replay of one joint: its link moves as measured, whatever holds it, and only its actuator is judged.

So a leg that touches the ground is diagnosed joint by joint, without a model of the ground. What it cannot show is
listed in a finding: everything about the load, and what needs a column that the log lacks.

A row's columns were read once the goal of the row acts, or before, under the goal of the row before. Most loops read
their drives and then write the goals, so that a column answers to the goal of the row before. That looks like a slow
drive and is none. Along a measured motion nothing else tells of the true delay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ..checks.drive import EFFORTS, predicted
from ..checks.recording import DRIVE_LOOP_PERIOD, a_moment_tells
from ..checks.signal import derivatives, typical_noise
from ..log.parts import Unit
from ..log.torque_side import SIDES, SURE_DEVIATIONS, Reason, TorqueSide, numbers_and_spread, said_side, side_by_drive
from ..log.types import Array, JointLog, LogError, MeasuredRun
from .constants import K
from .driven_simulator import CHANNELS, replay_driven_many
from .joint_model import JointModel
from .layout import lay_out
from .problem import Batch, JointProblem

# of a hinge
UNITS = {"position": "rad", "torque": "N.m", "duty": "1", "current": "A"}
LEAST_TORQUES = 50  # samples of a torque column that can tell what it is of
MOST_LATE = 0.1  # [s] by which its goals may act later than believed
MOST_DELAYS = 40  # delays that are tried up to there
LEAST_READ = 200  # samples from which it can be told
HALF_A_ROW = 0.5  # of a row, within which the age of a goal must be one


@dataclass(frozen=True, eq=False, kw_only=True)
class DrivenProblem(JointProblem):
    """Units of one joint whose link moves as measured.

    Attributes:
        link: its position, speed and acceleration (n, 3) [rad, rad/s, rad/s2].
        told: what was logged of the judged channel where it is not judged, else NaN (n,): an integral begins with it.
        first: which of :data:`sealegs.gap.replay.driven_simulator.CHANNELS` is judged sample by sample; it comes first
            in ``measured`` and in what is simulated, in exchange with the position.
        torque_side: what a logged torque is of, :mod:`sealegs.gap.log.torque_side`.
        side_reason: why it is taken as that.
        read_early: whether it shows itself that its columns were read before the goals of their rows acted.
    """

    link: np.ndarray
    told: np.ndarray
    first: int = 0
    torque_side: TorqueSide = "shaft"
    side_reason: Reason = "assumed"
    read_early: bool = False

    by_sample: ClassVar[tuple[int, ...]] = (0,)
    by_group: ClassVar[tuple[int, ...]] = (1, 2, 3)
    per_sample: ClassVar[tuple[str, ...]] = (*JointProblem.per_sample, "told")

    def picture(self, named: str) -> str:
        """The response; of a spring the torque that it passes on. The pictures show motion, which may be given."""
        if self.signal[0] != "position":
            return ""
        return "passed_torque" if named == "hysteresis" and self.models[0].chain.gives() else "response"

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels, the judged one first."""
        return tuple(CHANNELS[c] for c in _exchanged(self.first))

    @property
    def signal(self) -> tuple[str, str]:
        """The channel that is judged sample by sample, and its unit, of a slide or of a hinge."""
        return CHANNELS[self.first], self.models[0].axis.unit(UNITS[CHANNELS[self.first]])

    def motion(self, simulated: np.ndarray) -> np.ndarray:
        """Position, speed and acceleration (n, 3); a rigid motor moves as its link was measured to."""
        return self.link if self.first else super().motion(simulated)

    def replay(self, batch: Batch) -> None:
        """Along the measured motion of the link."""
        signals = (*self.driven_by(batch.rows), self.link[batch.rows], self.told[batch.rows])
        k = batch.constants
        k[..., K.judged] = self.first
        if self.first:
            k[..., K.per_duty] = {"torque": k[..., K.duty_torque], "duty": 1.0, "current": k[..., K.duty_current]}[
                self.signal[0]
            ]
        k[..., K.at_drive] = float(self.torque_side == "drive")
        replay_driven_many(batch.programs, k, *signals, batch.starts, batch.states, batch.steps, batch.out)
        if self.first:
            batch.out[...] = batch.out[..., _exchanged(self.first)]


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
    plain = lay_out(runs, joint, units, models[0].command)
    logs = [run.joints[joint] for run in runs]
    elastic = any(model.chain.gives() for model in models)
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
        signal = next((s for s in efforts_of(models) if all(getattr(log, s) is not None for log in logs)), None)
        if signal is None:
            raise LogError(_unjudged(joint, logs, efforts_of(models)))
        first = CHANNELS.index(signal)
        measured = measured[:, _exchanged(first)]
        weight[0] = 1.0 / typical_noise(plain.time, measured[:, 0], plain.starts)
    said = said_side(runs, joint)
    return with_shown_side(DrivenProblem(**{
        **vars(plain),
        "measured": measured,
        "judged": plain.judged & np.isfinite(measured[:, 0]),  # torque, current and duty may have empty cells
        "weight": weight,
        "models": tuple(models),
        "terms": None,
        "link": link,
        "told": np.where(plain.judged, np.nan, measured[:, 0]),
        "first": first,
        "torque_side": said or "shaft",
        "side_reason": "said" if said else "assumed",
    }))  # fmt: skip


def with_shown_side(problem: DrivenProblem) -> DrivenProblem:
    """The problem whose torque column is of the side that its nominal replays show, unless the log says of which."""
    if problem.side_reason == "said":
        return problem
    shown = _shown_side(problem)
    return replace(problem, torque_side=shown or "shaft", side_reason="shown" if shown else "assumed")


def efforts_of(models: Sequence[JointModel]) -> tuple[str, ...]:
    """What judges a motor that is rigid with its link, the best first: what the chain of each run predicts."""
    return tuple(effort for effort in EFFORTS if all(effort in predicted(model.chain) for model in models))


def not_predicted(joint: str, columns: Sequence[str]) -> str:
    """That columns of effort are set aside, since the chain of a joint predicts none of them, and what to do."""
    names = " and ".join(f"'{joint}.{column}'" for column in columns)
    return f"{names} cannot be judged, since the chain of '{joint}' has no motor; name a chain with a motor, or log"


def _unjudged(joint: str, logs: Sequence[JointLog], efforts: Sequence[str]) -> str:
    """Why nothing of a rigid joint can be judged, and which columns would tell."""
    names = [f"'{joint}.{effort}'" for effort in reversed(efforts)]
    wanted = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} or {names[-1]}"
    start = (
        f"joint '{joint}': motor and link are one, so its position says nothing about its actuator unless the load is "
        "known"
    )
    idle = [
        effort for effort in EFFORTS if effort not in efforts and any(getattr(log, effort) is not None for log in logs)
    ]
    if idle:
        return f"{start}; {not_predicted(joint, idle)} {wanted}."
    return f"{start}; log {wanted} as well."


def _shown_side(problem: DrivenProblem) -> TorqueSide | None:
    """What the torque column was taken of, by the nominal model; None where it cannot tell.

    A goal that acts late makes an error that looks like armature and friction, so the delay is the one that fits best.
    """
    where = problem.channels.index("torque")
    torque = problem.measured[:, where]
    good = problem.judged & np.isfinite(torque)
    if good.sum() < LEAST_TORQUES:
        return None
    believed, period = problem.models[0].value("delay.seconds"), float(np.median(np.diff(problem.time)))
    late = np.arange(0.0, MOST_LATE, max(period, MOST_LATE / MOST_DELAYS))
    delays = [{}, *({"delay.seconds": believed + seconds} for seconds in late[1:])]
    shaft, drive = (replace(problem, torque_side=side).simulate(delays)[:, good, where] for side in SIDES)
    return side_by_drive(torque[good], drive, drive - shaft, problem.link[good, 1], problem.block[good])


def _link(run: MeasuredRun, joint: str) -> np.ndarray:
    """Motion of the link (n, 3): as logged, and its derivatives from local parabolas."""
    log = run.joints[joint]
    position = log.position if log.link_position is None else log.link_position
    good = np.isfinite(position)
    position = np.interp(run.time, run.time[good], position[good])
    _, speed, acceleration = derivatives(run.time, position)
    return np.stack([position, speed, acceleration], axis=1)


def as_read(problem: DrivenProblem, *, told: bool) -> DrivenProblem:
    """The problem whose goals act as late as its columns were read early, if they were.

    Args:
        problem: with the goals as logged.
        told: whether the checks of the log say so already.
    """
    if not told and not read_before_goal(problem):
        return problem
    # what a torque is of is shown by replays, which must have the goals in force
    return with_shown_side(replace(_with_goals_before(problem), read_early=not told))


def read_before_goal(problem: DrivenProblem) -> bool:
    """Whether what is judged answers to the goal of the row before, by nominal replays with either.

    Their difference is what a goal's age of one row changes, so its share in the column is that age in rows. Gains,
    damping, the part of an integral, and what is inside or outside of a torque may be wrong beside it.
    """
    good = problem.judged & problem.on & np.isfinite(problem.measured[:, 0])
    if not problem.first or good.sum() < LEAST_READ or not _shows(problem):
        return False
    now = problem.simulate([{}])[0, good, 0]
    change = _with_goals_before(problem).simulate([{}])[0, good, 0] - now
    if np.ptp(change) == 0.0:
        return False
    motion = problem.link[good]
    free = [now, change, motion, np.sign(motion[:, 1])]
    if any(model.chain.find("position_pi") is not None for model in problem.models):
        free.append(now - problem.simulate([{"position_pi.integral": 0.0}])[0, good, 0])
    unit = np.repeat(np.arange(len(problem.units)), np.diff(problem.starts))[good]
    table = _about_means(np.column_stack([problem.measured[good, 0], *free]), unit)
    numbers, spread = numbers_and_spread(table[:, 1:], table[:, 0], problem.block[good])
    scale = abs(float(numbers[0]))
    if scale <= SURE_DEVIATIONS * spread[0]:
        return False
    rows = float(numbers[1] / numbers[0])
    return abs(rows - 1.0) + SURE_DEVIATIONS * float(spread[1]) / scale < HALF_A_ROW


def _about_means(table: Array, unit: np.ndarray) -> Array:
    """Columns (n, k) less their means in each unit (n,): every piece of a log may have offsets of its own."""
    rows = np.maximum(np.bincount(unit), 1)
    means = np.stack([np.bincount(unit, column) / rows for column in table.T], axis=1)
    return table - means[unit]


def _shows(problem: DrivenProblem) -> bool:
    """Whether a moment makes a goal one row older, in every unit."""
    return all(
        a_moment_tells(problem.time[a:b], problem.models[unit.run].value("delay.seconds"))
        for unit, a, b in zip(problem.units, problem.starts, problem.starts[1:], strict=False)
    )


def _with_goals_before(problem: DrivenProblem) -> DrivenProblem:
    """The problem whose columns are read a moment before the goals of their rows act."""
    late = [
        model.with_values({"delay.seconds": model.value("delay.seconds") + DRIVE_LOOP_PERIOD})
        for model in problem.models
    ]
    return replace(problem, models=tuple(late))
