"""Lists of a bag that name no joints, beside joints that the format names: whose each of their places is.

They are claimed in the order of the joints where each joint follows its own place; else they are asked about.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np

from ..types import SIGNAL_UNITS, TOLD, Array
from .claims import Claimed
from .expression import quoted
from .motion import following, span
from .names import said
from .recording import Recording

PLACE = re.compile(r"(.+)\[(\d+)\]")
STILL = 0.02
"""Share of the largest motion that a joint at rest may move."""
FOLLOWED, NEAR = 0.5, 0.25
"""Share of its motion that its place must explain of each joint, and how much better, or nearer in size, another may go
with that place."""


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
        joints, ask = _joints(name, signal, columns, free, run, time)
        for k, column in enumerate(columns):
            if joints:
                claim = replace(said(column), ask=ask, unit=run.units.get(column, "") or said(column).unit)
                out.groups[joints[k]].setdefault(signal, []).append(claim)
                continue
            out.aside[column] = f"{signal} of a list that names no joints, " + (
                f"and nothing tells whose: write <joint>.{signal}: {quoted(column)} where you know it" if free else
                "which all have one"
            )  # fmt: skip


def _joints(
    name: str, signal: str, columns: list[str], free: dict[str, str], run: Recording, time: Array
) -> tuple[list[str], str]:
    """The joint of each place, and the question about it; no joints where nothing speaks for some."""
    called, n = said(name).joint, len(columns)
    ends = [joint for joint in free if called == joint or called.endswith(f"_{joint}")]
    if n == 1 and (ends or len(free) == 1):
        return [max(ends or free, key=len)], ""
    near = _beside(name, n, free)
    windows = [near[k : k + n] for k in range(len(near) - n + 1)] if signal == "goal" else []
    fitting = [own for own in windows if _in_order(columns, [free[j] for j in own], [free[j] for j in near], run, time)]
    if len(fitting) == 1:
        return fitting[0], ""
    if n != len(near) or signal not in TOLD:
        return [], ""
    return near, (
        f"whose are the places of {quoted(columns[0])} and of the columns beside it? The list names no joints. The "
        "lines have them in the order of the positions, which motion does not confirm: exchange columns where its "
        "controller has another order"
    )


def _beside(name: str, count: int, joints: dict[str, str]) -> list[str]:
    """Joints whose positions have a name that begins as that of the list, as of one robot among several."""
    groups: dict[tuple[str, ...], list[str]] = {}
    for joint, column in joints.items():
        groups.setdefault(tuple(column.split(".")[:-2]), []).append(joint)
    own = name.split(".")
    shared = {above: [*(a == b for a, b in zip(above, own, strict=False)), False].index(False) for above in groups}
    near = [groups[above] for above in groups if shared[above] == max(shared.values())]
    alike = [one for one in near if len(one) == count]
    return alike[0] if len(alike) == 1 else [joint for one in near for joint in one]


def _in_order(columns: list[str], own: list[str], positions: list[str], run: Recording, time: Array) -> bool:
    """Whether each joint that moves follows its own place, and no joint follows that place better, or as far."""
    most = max(span(run.columns[name]) for name in positions)
    for column, position in zip(columns, own, strict=True):
        if span(run.columns[position]) <= STILL * most and span(run.columns[column]) <= STILL * most:
            continue
        missed = {}
        for other in positions:
            goes = following(time, run.columns[column], run.columns[other])
            follows = goes.scale > 0.0 and goes.lag >= 0.0 and goes.fit > FOLLOWED
            missed[other] = 1.0 - goes.fit + abs(math.log(goes.scale)) if follows else math.inf
        if missed[position] > min(missed.values()) + NEAR or math.isinf(missed[position]):
            return False
    return True
