"""What an impedance drive (MIT mode) is told beside its goal: a goal velocity, and the gains that its chain takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..types import Array
from .column import Column, span, without_doubt
from .evidence import as_derivative
from .expression import names_in
from .names import DAMPING, STIFFNESS, said
from .proposed import Proposal
from .recording import Recording
from .units import ASK, read_goal_velocity

BESIDE = ("goal_velocity", "torque_command")


def place_goal_velocity(
    out: Proposal, joint: str, chosen: Mapping[str, Column], columns: Mapping[str, Array], time: Array
) -> None:
    """Put a joint's commanded velocity beside its goal; where that cannot be, say why it is left out.

    Args:
        out: what is proposed.
        joint: its name.
        chosen: its columns by signal.
        columns, time: of the recording in which it moves most, (n,) each.
    """
    column, goal = chosen.get("goal_velocity"), out.columns.get(f"{joint}.goal")
    if column is None:
        return
    values = columns[column.name]
    if goal is None or "goal" not in chosen:
        out.unused[column.name] = "a commanded velocity beside no goal"
    elif span(values) == 0.0:
        out.unused[column.name] = "a commanded velocity that never changes"
    else:
        slope = as_derivative(time, columns[chosen["goal"].name], values)
        read = read_goal_velocity(column.name, without_doubt(column.unit), column.how, slope, goal)
        if read.trust == ASK:
            out.unused[column.name] = f"a commanded velocity in a unit that is not known: {read.why}"
        else:
            out.columns[f"{joint}.goal_velocity"] = read


def impedance_chains(recordings: Sequence[Recording], out: Proposal) -> dict[str, list[dict[str, Any]]]:
    """Chains of joints that are told more than a goal, with stiffness and damping as the recordings have them.

    A joint whose gains change has none: then only the whole torque says what its drive was told.
    """
    first, chains = recordings[0], {}
    for joint in out.joints:
        goal = out.columns.get(f"{joint}.goal")
        if goal is None or not any(f"{joint}.{signal}" in out.columns for signal in BESIDE):
            continue
        owners = {said(name).joint for name in names_in(goal.text) if name in first.columns}
        gains = {name: _gain(recordings, owners, words) for name, words in
                 (("stiffness", STIFFNESS), ("damping", DAMPING))}  # fmt: skip
        if gains["stiffness"] and gains["damping"] is not None:
            chains[joint] = [{"ideal": {**gains, "feedforward": 1}}]
    return chains


def _gain(recordings: Sequence[Recording], owners: set[str], words: tuple[str, ...]) -> float | None:
    """A gain that all recordings have for one of these joints, and that is the same throughout; else None."""
    names = [
        name
        for name in recordings[0].columns
        if (spoken := said(name)).joint in owners and spoken.signal.partition(" ")[0] in words
    ]
    if len(names) != 1:
        return None
    values = np.concatenate([run.columns[names[0]] for run in recordings if names[0] in run.columns])
    values = values[np.isfinite(values)]
    return float(values[0]) if len(values) and np.ptp(values) == 0.0 else None
