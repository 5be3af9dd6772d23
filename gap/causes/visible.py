"""What a joint that moves as measured can show, driven by its commands or judged by its torque."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..checks.drive import EFFORTS
from ..checks.recording import before_goal_note
from ..log.finding import Finding
from ..log.torque_side import side_note
from ..replay.driven import DrivenProblem, efforts_of, not_predicted
from ..replay.joint_model import JointModel
from ..replay.torque import TorqueProblem, acts
from .catalogue import catalogue, checked
from .cause import Cause, View, visible
from .sensor import of_torque_column

JUDGED = {
    "position": "the motor's position against the measured link",
    "torque": "its torque along the measured motion",
    "current": "its current along the measured motion",
    "duty": "its duty along the measured motion",
}
"""What is judged, by the channel that is judged sample by sample."""


def view_of(problem: DrivenProblem, nominal: JointModel) -> View:
    """What a driven replay can show: its link is prescribed, and so is a motor that is rigid with it."""
    columns = _logged(problem) & {"position", *efforts_of(problem.models)}
    if problem.torque_side == "drive":  # which says no more of friction than current and duty do
        columns -= {"torque"}
    moves = problem.signal[0] == "position" or nominal.chain.gives()
    return View(free_link=False, free_motor=moves, columns=frozenset(columns))


def shown(problem: DrivenProblem, nominal: JointModel, causes: Sequence[Cause]) -> tuple[list[Cause], list[str]]:
    """Causes that the driven replay can show, and names of those that it cannot."""
    return visible(causes, view_of(problem, nominal))


def shown_by_torque(problem: TorqueProblem, nominal: JointModel, names: Sequence[str] | None) -> list[Cause]:
    """Causes that the torque along a measured motion can show: those of load and friction, and of the column itself.

    Args:
        problem: the torque.
        nominal: the joint.
        names: of the causes to consider; default: all of them.
    """
    found = []
    for cause in catalogue(nominal, names):
        variants = tuple(variant for variant in cause.variants if all(acts(p.number) for p in variant))
        if variants and not cause.name.startswith("sensor."):
            found.append(replace(cause, variants=variants))
    size = float(np.sqrt(np.mean(problem.measured[:, 0] ** 2)))
    faults = of_torque_column(-problem.shift.seconds, problem.reach, max(size, 1e-6))
    return [*found, *(cause for cause in faults if cause.name in checked(names))]


def limits(problem: DrivenProblem, joint: str, hidden: Sequence[str]) -> tuple[Finding, ...]:
    """What the driven replay of a joint cannot show, and what its torque was taken as, for people."""
    blind = f"; this cannot show {', '.join(hidden)}" if hidden else ""
    beyond = Finding(
        "replay.driven", "note", joint, None,
        f"The link of '{joint}' was moved as measured, and {JUDGED[problem.signal[0]]} was judged, so no model of load "
        f"and contact was needed{blind}.",
    )  # fmt: skip
    found = (beyond, *_set_aside(problem, joint))
    if "torque" in _logged(problem):
        found = (*found, side_note(joint, problem.torque_side, problem.side_reason))
    if problem.read_early:
        found = (*found, before_goal_note(joint, problem.signal[0], float(np.median(np.diff(problem.time)))))
    return found


def _set_aside(problem: DrivenProblem, joint: str) -> tuple[Finding, ...]:
    """That columns of effort are not judged, which the chain of a joint does not predict; unless they are zero."""
    moving = {name for c, name in enumerate(problem.channels) if np.nan_to_num(problem.measured[:, c]).any()}
    idle = [name for name in EFFORTS if name in moving and name not in efforts_of(problem.models)]
    if not idle:
        return ()
    return (Finding("replay.no_motor", "note", joint, None, f"{not_predicted(joint, idle)} '{joint}.torque'."),)


def _logged(problem: DrivenProblem) -> set[str]:
    """Channels of which the log holds anything."""
    return {name for c, name in enumerate(problem.channels) if np.isfinite(problem.measured[:, c]).any()}
