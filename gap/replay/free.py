"""Free replay of one joint: its load is known, and the simulator moves both from where each unit starts."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..load.terms import T_COLUMNS, T_DRAWN
from ..log.parts import Unit
from ..log.types import MeasuredRun
from .joint_model import JointModel
from .layout import lay_out
from .parameters import TIGHT, address
from .problem import OF_A_ROBOT, ROBOT_STEP, STEPS, Batch, JointProblem
from .simulator import CHANNELS, replay_many

PLACES = slice(0, 2)  # channels that are positions
ADRIFT = 2.0  # [s] within which a joint that is told speeds keeps its place; assumed
RESISTANCE = "supply.resistance"
"""Number of the supply under which all drives of a robot sag."""
NO_TERMS = np.zeros((0, T_COLUMNS))


@dataclass(frozen=True, eq=False, kw_only=True)
class FreeProblem(JointProblem):
    """Units of one joint whose load is known; the channels are :data:`sealegs.gap.replay.simulator.CHANNELS`."""

    by_sample: ClassVar[tuple[int, ...]] = (0, 1)
    by_group: ClassVar[tuple[int, ...]] = (2, 3)

    @property
    def free_joint(self) -> JointProblem:
        """Itself: any other motion can be simulated as this one is."""
        return self

    @property
    def steps(self) -> tuple[float, ...]:
        """A longer one first at a joint of a robot, whose log is coarser and longer than that of a bench [s]."""
        return STEPS if self.terms is None else (ROBOT_STEP, *STEPS)

    def systematic_error(self, path: str) -> float:
        """Relative error of a number that columns and simulation share in all data.

        A sag follows what the neighbours draw, too, and where this joint's current was not logged, theirs is taken to
        be as well known as their motors are.
        """
        if self.terms is None:
            return super().systematic_error(path)
        current = self.channels.index("current")
        guessed = not self.weight[current] and bool(self.terms[:, T_DRAWN].any())
        return math.hypot(OF_A_ROBOT, TIGHT) if guessed and address(path).number == RESISTANCE else OF_A_ROBOT

    def picture(self, named: str) -> str:
        """The one that the cause names."""
        return named

    @property
    def open_loop(self) -> bool:
        """A torque is commanded; a goal would hold the joint."""
        return self.models[0].by_torque

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels that are replayed."""
        return CHANNELS

    @property
    def signal(self) -> tuple[str, str]:
        """The first channel, which is judged sample by sample, and its unit."""
        return "position", self.models[0].axis.unit("rad")

    def replay(self, batch: Batch) -> None:
        """As the torques on the link say."""
        terms = NO_TERMS if self.terms is None else self.terms[batch.rows]
        signals = (terms, *self.driven_by(batch.rows))
        replay_many(batch.programs, batch.constants, *signals, batch.starts, batch.states, batch.steps, batch.out)
        if self.models[0].command == "goal_velocity":
            self._from_any_place(batch)

    def _from_any_place(self, batch: Batch) -> None:
        """Shift a joint that is told speeds to where it was measured, on average over :data:`ADRIFT`.

        Nothing brings such a joint back to a place. What its loop has added up before a unit begins, which no log
        tells, is a constant of its position from then on, and so is what a saturated loop loses.
        """
        measured, judged, time = self.measured[batch.rows, 0], self.judged[batch.rows], self.time[batch.rows]
        for first, end in itertools.pairwise(batch.starts):
            window = ((time[first:end] - time[first]) / ADRIFT).astype(int)
            for number in range(int(window[-1]) + 1):
                rows = first + np.flatnonzero(window == number)
                use = rows[judged[rows] & np.isfinite(measured[rows])]
                if len(use):
                    shift = (measured[use] - batch.out[:, use, 0]).mean(axis=1)
                    batch.out[:, rows, PLACES] += shift[:, None, None]


def free_problem(
    runs: Sequence[MeasuredRun],
    joint: str,
    models: Sequence[JointModel],
    units: Sequence[Unit],
    weight: Mapping[str, float],
    terms: Sequence[np.ndarray] | None = None,
) -> FreeProblem:
    """Lay the runs of one joint out for free replay.

    Args:
        runs, units: of :func:`sealegs.gap.log.parts.cut`.
        models: nominal joint of each run.
        weight: one over the noise, by channel; channels without one do not count.
        terms: of a joint of a robot, of each run (samples, T_COLUMNS).

    Raises:
        LogError: the joint has no commands.
    """
    laid = lay_out(runs, joint, units, models[0].command)
    return FreeProblem(
        **vars(laid),
        weight=np.array([weight.get(channel, 0.0) for channel in CHANNELS]),
        models=tuple(models),
        link=None,
        terms=None if terms is None else np.concatenate([terms[u.run][u.start : u.stop] for u in laid.units]),
    )
