"""What an impedance drive (MIT mode) is told beside its goal: a goal velocity, and the gains that its chain takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..types import BESIDE_GOAL, Array
from .column import Column, span, without_doubt
from .evidence import as_derivative
from .expression import names_in, quoted
from .names import DAMPING, STIFFNESS, said
from .proposed import Proposal
from .recording import Recording
from .units import ASK
from .velocities import read_goal_velocity

USUAL = 0.7
"""Share of the rows from which a gain is the drive's; the other rows are left out."""
PLAIN = ("rad", "m", "rad/s", "m/s", "N.m", "N")
"""Units of columns in which gains are in N.m/rad and N.m.s/rad."""


def place_goal_velocity(
    out: Proposal, joint: str, chosen: Mapping[str, Column], columns: Mapping[str, Array], time: Array | None
) -> None:
    """Put a joint's commanded velocity beside its goal; where that cannot be, say why it is left out.

    Args:
        out: what is proposed.
        joint: its name.
        chosen: its columns by signal.
        columns, time: of the recording in which it moves most, (n,) each; None where no time is known.
    """
    column, goal = chosen.get("goal_velocity"), out.columns.get(f"{joint}.goal")
    if column is None:
        return
    values = columns[column.name]
    if goal is None or "goal" not in chosen:
        out.unused[column.name] = "a commanded velocity beside no goal"
    elif span(values) == 0.0 and not values[np.isfinite(values)].any():
        out.unused[column.name] = "a commanded velocity of zero"
    else:
        slope = None if time is None else as_derivative(time, columns[chosen["goal"].name], values)
        read = read_goal_velocity(column.name, without_doubt(column.unit), column.how, slope, goal)
        if read.trust == ASK:
            out.unused[column.name] = f"a commanded velocity in a unit that is not known: {read.why}"
        else:
            out.columns[f"{joint}.goal_velocity"] = read


def impedance_chains(
    recordings: Sequence[Recording], out: Proposal, limits: Mapping[str, float] | None = None
) -> dict[str, list[dict[str, Any]]]:
    """Chains of joints that are told more than a goal, with stiffness and damping as the recordings have them.

    Rows with other ones are left out where these are few, as at a start. A joint whose gains change more has no chain:
    then only the whole torque says what its drive was told. Nor has one whose columns are in degrees or turns: nobody
    says whether its gains are, too.

    Args:
        recordings: of one kind.
        out: what is proposed.
        limits: largest torque of a joint [N.m], as a robot's file has it.
    """
    first, chains = recordings[0], {}
    for joint in out.joints:
        goal = out.columns.get(f"{joint}.goal")
        beside = [out.columns[name] for signal in BESIDE_GOAL if (name := f"{joint}.{signal}") in out.columns]
        if goal is None or not beside or not all(read.unit in PLAIN for read in (goal, *beside)):
            continue
        owners = {said(name).joint for name in names_in(goal.text) if name in first.columns}
        stiffness, damping = (_gain(recordings, owners, words) for words in (STIFFNESS, DAMPING))
        if stiffness is None or damping is None:
            continue
        for gain, what in ((stiffness, "stiffness"), (damping, "damping")):
            out.unused[gain.column] = f"the {what} of {joint}'s chain"
        changing = [gain for gain in (stiffness, damping) if gain.share < 1.0]
        if stiffness.value <= 0.0 or any(gain.share < USUAL for gain in changing):
            for gain in changing or (stiffness,):
                out.unused[gain.column] = (
                    f"it is {gain.value:g} in {gain.share:.0%} of the rows, so no chain holds for {joint}: compute the "
                    f"torque that its drive was told and give it as {joint}.torque_command, without the goal"
                )
            continue
        for gain in changing:  # as at a start, when a host holds its motors soft
            out.unused[gain.column] += f"; rows in which it is not {gain.value:g} are left out"
            same = f"max(1-abs(sign({quoted(gain.column)}-{gain.value!r})), 0)"
            out.keep.setdefault(joint, []).append(same)
        limit = {"torque_limit": limits[joint]} if limits and joint in limits else {}
        drive = {"stiffness": stiffness.value, "damping": damping.value, **limit, "feedforward": 1}
        chains[joint] = [{"ideal": drive}]
    return chains


@dataclass(frozen=True)
class _Gain:
    """A gain: its column, its usual value and the share of rows that have it."""

    column: str
    value: float
    share: float


def _gain(recordings: Sequence[Recording], owners: set[str], words: tuple[str, ...]) -> _Gain | None:
    """A gain of one of these joints; None where no column, or more than one, is it."""
    names = [
        name
        for name in recordings[0].columns
        if (spoken := said(name)).joint in owners and spoken.signal.partition(" ")[0] in words
    ]
    if len(names) != 1:
        return None
    values = np.concatenate([run.columns[names[0]] for run in recordings])
    each, counts = np.unique(values[np.isfinite(values)], return_counts=True)
    return _Gain(names[0], float(each[np.argmax(counts)]), float(counts.max() / len(values))) if len(each) else None
