"""Lists of a bag that name no joints, beside joints that the format names: whose each of their places is.

A place goes to the joint that its topic is called after. Commands of as many places as joints are asked about, in the
order of the positions; other lists are left out.
"""

from __future__ import annotations

import re
from dataclasses import replace

from ..types import SIGNAL_UNITS, TOLD
from .claims import Claimed
from .expression import quoted
from .names import said
from .recording import Recording

PLACE = re.compile(r"(.+)\[(\d+)\]")


def lists_of(run: Recording) -> dict[str, list[str]]:
    """Columns of lists whose format names the joints of other columns, by the list's name, in order."""
    found: dict[str, dict[int, str]] = {}
    named = any(role.endswith(".position") for role in run.roles.values())
    for name in run.columns if named else ():
        match = PLACE.fullmatch(name)
        if match and name not in run.roles and said(name).signal in (*SIGNAL_UNITS, "load"):
            found.setdefault(match[1], {})[int(match[2])] = name
    return {stem: [own[k] for k in sorted(own)] for stem, own in found.items() if sorted(own) == list(range(len(own)))}


def put_lists(lists: dict[str, list[str]], out: Claimed, run: Recording) -> None:
    """Put the places of lists to joints that the format names.

    Args:
        lists: columns by name.
        out: claims, to which these are added.
        run: the recording.
    """
    for name, columns in lists.items():
        signal = said(columns[0]).signal
        measured = {joint: own["position"][0].column for joint, own in out.groups.items() if own.get("position")}
        free = [joint for joint in measured if not out.groups[joint].get(signal)]
        joints, ask = _joints(name, signal, columns, {joint: measured[joint] for joint in free})
        for joint, column in zip(joints, columns, strict=False):
            unit = run.units.get(column, "") or said(column).unit
            out.groups[joint].setdefault(signal, []).append(replace(said(column), ask=ask, unit=unit))
        for column in columns if not joints else ():
            why = f"and nothing tells whose: write <joint>.{signal}: {quoted(column)} where you know it"
            out.aside[column] = f"{signal} of a list that names no joints, {why if free else 'which all have one'}"


def _joints(name: str, signal: str, columns: list[str], free: dict[str, str]) -> tuple[list[str], str]:
    """The joint of each place, and the question about it; no joints where nothing speaks for some."""
    called = said(name).joint
    ends = [joint for joint in free if called == joint or called.endswith(f"_{joint}")]
    if len(columns) == 1 and (ends or len(free) == 1):
        return [max(ends or free, key=len)], ""
    robot = name.split(".")[0]  # of several robots the one whose name the list begins with
    near = [joint for joint, column in free.items() if column.split(".")[0] == robot] or [*free]
    if len(columns) != len(near) or signal not in TOLD:
        return [], ""
    return near, (
        f"whose are the places of {quoted(columns[0])} and of the columns beside it? The list names no joints. The "
        "lines have them in the order of the positions: exchange columns where its controller has another order"
    )
