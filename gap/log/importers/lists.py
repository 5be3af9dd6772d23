"""Lists of a bag that name no joints, beside joints that the format names: whose each of their places is.

They are claimed in the order of the joints where each joint follows its own place; else they are asked about.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from ..types import SIGNAL_UNITS, TOLD, Array
from .claims import Claimed, Groups
from .expression import quoted
from .motion import LONGEST_LAG, following
from .names import Claim, said
from .recording import Recording

PLACE = re.compile(r"(.+)\[(\d+)\]")
STILL = 0.02
"""Share of the largest motion that a joint at rest may move."""
NEAR_GOAL = 1e-3
"""Distance of a joint from its goal, as a share of the power of its motion, that tells no order from another."""
SAME_ORDER = 2.0
"""Times the distance of the nearest order up to which the order of the joints is as near."""
FOLLOWED = 0.5
"""Share of its motion that its place must explain of each joint."""


def lists_of(run: Recording) -> dict[str, list[str]]:
    """Columns of lists whose format names the joints of other columns, by the list's name, in order."""
    found: dict[str, dict[int, str]] = {}
    named = any(role.endswith(".position") for role in run.roles.values())
    for name in run.columns if named else ():
        match = PLACE.fullmatch(name)
        if match and name not in run.roles and said(name).signal in (*SIGNAL_UNITS, "load"):
            found.setdefault(match[1], {})[int(match[2])] = name
    return {stem: [own[k] for k in sorted(own)] for stem, own in found.items() if sorted(own) == list(range(len(own)))}


def put_lists(lists: dict[str, list[str]], out: Claimed, run: Recording, time: Array) -> None:
    """Put the places of lists to joints that the format names.

    Args:
        lists: columns by name.
        out: claims, to which these are added.
        run: the recording.
        time: of its samples [s].
    """
    for name in sorted(lists, key=lambda name: all(np.ptp(run.columns[one]) == 0.0 for one in lists[name])):
        columns, signal = lists[name], said(lists[name][0]).signal
        placed = {joint: own["position"][0].column for joint, own in out.groups.items() if own.get("position")}
        free = {joint: column for joint, column in placed.items() if not out.groups[joint].get(signal)}
        found, ask = _joints(name, signal, columns, free, run, time)
        for column in columns:
            claim = replace(said(column), ask=ask, unit=run.units.get(column, "") or said(column).unit)
            if column in found:
                _put(out.groups, found[column], signal, claim)
            elif not free:
                out.aside[column] = f"{signal} of a list that names no joints, which all have one"
            else:
                out.aside[column] = (
                    f"{signal} of a list that names no joints, and nothing tells whose: write "
                    f"<joint>.{signal}: {quoted(column)} where you know it"
                )


def _put(groups: Groups, joint: str, signal: str, claim: Claim) -> None:
    groups[joint].setdefault(signal, []).append(claim)


def _joints(
    name: str, signal: str, columns: Sequence[str], free: dict[str, str], run: Recording, time: Array
) -> tuple[dict[str, str], str]:
    """The joint of each column, and the question about it; no joints where nothing speaks for some."""
    called = said(name).joint
    ends = [joint for joint in free if called == joint or called.endswith(f"_{joint}")]
    if len(columns) == 1 and (ends or len(free) == 1):
        return {columns[0]: max(ends or free, key=len)}, ""
    near = _beside(name, len(columns), free)
    joints, n = list(near), len(columns)
    windows = [joints[k : k + n] for k in range(len(joints) - n + 1)] if signal == "goal" else []
    fitting = [
        own for own in windows if _followed(columns, list(near.values()), [joints.index(j) for j in own], run, time)
    ]
    if len(fitting) == 1:
        return dict(zip(columns, fitting[0], strict=True)), ""
    if n != len(joints) or signal not in TOLD:
        return {}, ""
    ask = (
        f"whose are the places of {quoted(columns[0])} and of the columns beside it? The list names no joints. The "
        f"lines "
        "have them in the order of the positions, which motion does not confirm: exchange columns where its "
        "controller has "
        "another order"
    )
    return dict(zip(columns, joints, strict=True)), ask


def _beside(name: str, count: int, joints: dict[str, str]) -> dict[str, str]:
    """Joints whose positions have a name that begins as that of the list, as of one robot among several."""
    groups: dict[tuple[str, ...], dict[str, str]] = {}
    for joint, column in joints.items():
        groups.setdefault(tuple(column.split(".")[:-2]), {})[joint] = column
    own = name.split(".")
    shared = {
        parts: next((k for k, (a, b) in enumerate(zip(parts, own, strict=False)) if a != b), len(parts))
        for parts in groups
    }
    near = [groups[parts] for parts in groups if shared[parts] == max(shared.values())]
    alike = [one for one in near if len(one) == count]
    return alike[0] if len(alike) == 1 else {joint: column for one in near for joint, column in one.items()}


def _followed(
    columns: Sequence[str], positions: Sequence[str], own: Sequence[int], run: Recording, time: Array
) -> bool:
    """Whether joints follow places in this order, and no other is clearly nearer."""
    spread = np.array([float(np.nanvar(run.columns[name])) for name in positions])
    weight = 1.0 / (spread + (STILL**2 * float(spread.max(initial=0.0)) or 1.0))
    errors = np.array([[_errors(time, run.columns[one], run.columns[two]) for two in positions] for one in columns])
    apart, left = errors[..., 0] * weight, errors[..., 1] * weight
    rows = np.arange(len(columns))
    nearest = float(apart[linear_sum_assignment(apart)].sum())
    near = float(apart[rows, own].sum()) <= SAME_ORDER * nearest + NEAR_GOAL * len(columns)
    return near and float(left[rows, own].sum()) < (1.0 - FOLLOWED) * float((spread * weight)[own].sum())


def _errors(time: Array, goal: Array, position: Array) -> tuple[float, float]:
    """Mean square by which a position misses a goal as late as it follows it, and the same without an offset."""
    goes = following(time, goal, position)
    late = goes.lag if goes.fit > FOLLOWED and 0.0 < goes.lag < 0.95 * LONGEST_LAG else 0.0
    error = position - np.interp(time - late, time, goal)
    error = error[np.isfinite(error)]
    return (float(np.mean(error**2)), float(error.var())) if len(error) else (np.inf, np.inf)
