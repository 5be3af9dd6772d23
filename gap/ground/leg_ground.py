"""A hopper's log laid out for a search of its ground: stances, from the flight before each."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from ...actuators import Chain, load_chain
from ...common.errors import SealegsError
from ..causes.cause import Cause
from ..log.finding import Finding
from ..log.parts import held_out
from ..log.progress import Progress
from ..log.types import LogError, MeasuredRun
from ..replay.parameters import Parameter, factor
from .laid import CONTACT_TIME_FACTOR, MIN_PIECES, Laid, ground_causes, too_few
from .leg_model import LegModel
from .leg_replay import JOINTS, LegReplay
from .pieces import ENGINE_STEP, Piece
from .problem import GroundProblem, Judged, ground_problem
from .stances import COLUMNS, MODEL_ERRORS, UNITS, UNJUDGED_SECONDS, column_noise, columns, find_stances


def lay_leg(
    runs: Sequence[MeasuredRun], chains: Mapping[str, Chain], progress: Progress, test_group: str | None = None
) -> Laid | str:
    """The stances of a hopper; a sentence where the log has none to judge.

    Args:
        runs: of one machine.
        chains: of the joints that were diagnosed, as found.
        progress: is told what goes on.
        test_group: group of runs that no fit and no choice may see.

    Raises:
        SealegsError: the sidecar's numbers are none of the robot's, or the test group does not exist.
    """
    held = held_out(runs, test_group)
    absent = [name for name in JOINTS if any(name not in run.joints or name not in run.actuators for run in runs)]
    if absent:
        return f"{' and '.join(absent)} of the leg was not logged; record all of its joints."
    if not all(np.isfinite(run.base.get("z", np.nan)).any() for run in runs):
        return "the height of the base was not logged; record it as base.z (a boom encoder or a camera)."
    try:
        leg = LegModel.of(
            runs[0].robot_params, {name: chains.get(name) or load_chain(runs[0].actuators[name]) for name in JOINTS}
        )
    except SealegsError as error:
        raise LogError(f"{runs[0].name}: {error}") from None
    hidden = [
        name for name in JOINTS if leg.chains[name].gives() and any(r.joints[name].link_position is None for r in runs)
    ]
    if hidden:
        wanted = " and ".join(f"{name}.link_position" for name in hidden)
        return f"the links behind the springs were not logged; record {wanted}."
    progress("looking for stances")
    noise = column_noise(runs)
    stances = find_stances(runs, leg, noise)
    if len(stances) < MIN_PIECES:
        return (
            f"the leg left the ground {len(stances)} times for long enough, and {MIN_PIECES} stances are needed; "
            "let it hop for longer."
        )
    tested = sum(stance.run in held for stance in stances)
    if (why := too_few(len(stances), tested, bool(held), test_group, "stances")) is not None:
        return why
    return Laid(
        problem=leg_problem(runs, leg, stances, noise, test_group),
        causes=partial(contact_causes, leg),
        tuned=tuple(ground_numbers(leg)),
        pieces="stances",
        advice="the foot stays far from its limits. Hop higher, or push harder forward and back.",
        findings=() if np.isfinite(noise[1]) else (_unlogged(),),
        needs_joints=True,
    )


def leg_problem(
    runs: Sequence[MeasuredRun],
    leg: LegModel,
    stances: Sequence[Piece],
    noise: np.ndarray,
    test_group: str | None = None,
) -> GroundProblem:
    """Stances of a hopper as a problem, with the rms error of a sample of each judged column (4,)."""
    judged = Judged(COLUMNS, UNITS, np.array(MODEL_ERRORS), noise, UNJUDGED_SECONDS)
    replay = LegReplay(leg, runs, stances)
    return ground_problem(runs, leg, replay, judged, [columns(run) for run in runs], test_group)


def _unlogged() -> Finding:
    return Finding(
        "contact.columns", "note", "ground", "base.x",
        "base.x was not logged: friction and slope show through the links alone, and are less certain.",
    )  # fmt: skip


# --- contact causes, and numbers of the ground that nobody knows exactly ---------------------------------------------


HEIGHT_ZERO_TOLERANCE = 3e-3  # [m] how well the zero of the height is known
SHORTEST_TIME_CONSTANT = 2.0 * ENGINE_STEP  # [s] the engine takes no shorter time constant for a step
HARD_STIFFNESS = 2e4  # [N/m] below which that contact is not made by tuning: it would do a soft ground's work unnamed
SHOWN_IN = {"contact.friction": "base.x", "contact.stiffness": "base.z", "contact.slope": "base.x"}
STIFFNESS_STARTS, SOFT_STIFFNESS = (1500.0, 5000.0), 4000.0  # [N/m]


def contact_causes(nominal: LegModel, names: Sequence[str] | None = None) -> list[Cause]:
    """The catalogue of the ground under a leg.

    Args:
        nominal: the leg on the ground that is believed in.
        names: of the causes to consider; default: all of them.
    """
    return ground_causes(STIFFNESS_STARTS, nominal.softest_rigid(), SOFT_STIFFNESS, SHOWN_IN, names=names)


def ground_numbers(nominal: LegModel) -> list[Parameter]:
    """What every fit tunes: no finding, as long as it stays within these bounds."""
    shortest = SHORTEST_TIME_CONSTANT / nominal.value("contact.time")
    longest = min(max(math.sqrt(nominal.engine_stiffness() / HARD_STIFFNESS), 1.0), CONTACT_TIME_FACTOR)
    return [
        factor("contact.time", min(max(1.0 / CONTACT_TIME_FACTOR, shortest), 1.0), longest, 0.2),
        Parameter("contact.height", "m", -HEIGHT_ZERO_TOLERANCE, HEIGHT_ZERO_TOLERANCE, 0.0, 5e-4),
    ]
