"""Columns of one joint that names alone do not bring together: endings of names, and what follows what."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace

from ..types import COMMANDS
from .evidence import Relation
from .units import ASK, LIKELY, Read

FOLLOWS = 0.5
"""Share of a motion that another one explains, from which the two are goal and position."""
PAIRED = 0.8
"""Share of a motion that another one explains, from which two columns without names may be goal and position."""
MOST = 8
"""Columns without names that are looked at."""
CLEARER = 0.1
"""Share of the motion by which the joint of a goal without a name is ahead of the next one."""


def same_joint(groups: Mapping[str, Mapping[str, object]], same_motion: Callable[[str, str], bool]) -> dict[str, str]:
    """Joints that are one by their names: commands of ``elbow`` go with ``joint_elbow``, and the shorter name stays.

    Args:
        groups: columns by joint and signal.
        same_motion: whether two joints have the same position.

    Returns:
        New name by old one, of both.
    """
    commanded = {joint for joint, signals in groups.items() if signals.keys() & {*COMMANDS}}
    measured = {joint for joint, signals in groups.items() if "position" in signals and joint not in commanded}
    without = {joint for joint in commanded if "position" not in groups[joint]}
    names: dict[str, str] = {}
    for joint in measured:
        near = [other for other in without if _ends(joint, other) or _ends(other, joint)]
        near += [other for other in commanded - without if (_ends(joint, other) or _ends(other, joint))
                 and same_motion(joint, other)]  # fmt: skip
        if len(near) != 1 or near[0] in names:
            continue
        rivals = [other for other in measured if _ends(other, near[0]) or _ends(near[0], other)]
        if len(rivals) == 1:
            names[joint] = names[near[0]] = min(joint, near[0], key=len)
    return names


def _ends(joint: str, ending: str) -> bool:
    return bool(ending) and joint.endswith(f"_{ending}")


def best_pair(
    names: Iterable[str], follows: Callable[[str, str], Relation], goal: str | None = None
) -> tuple[str, str, Relation] | None:
    """Goal and position among columns whose names say neither: the second moves as the first, and later."""
    looked = list(names)[:MOST]
    found = [
        (first, second, goes)
        for first in ([goal] if goal else looked)
        for second in looked
        if first != second and (goes := follows(first, second)).fit > PAIRED and goes.lag > 0.0
        and 0.2 < goes.scale < 5.0
    ]  # fmt: skip
    return max(found, key=lambda one: (round(one[2].fit, 2), -one[2].lag), default=None)


def matched(goals: Iterable[str], positions: Iterable[str], follows: Callable[[str, str], Relation]) -> dict[str, str]:
    """Which position follows which goal, where names do not tell and motions tell clearly, either way round."""
    goals, positions = list(goals), list(positions)
    fits = {
        (goal, position): goes.fit if goes.lag >= 0.0 and 0.2 < goes.scale < 5.0 else 0.0
        for goal in goals
        for position in positions
        for goes in [follows(goal, position)]
    }

    def clear(goal: str, position: str) -> bool:
        fit = fits[goal, position]
        others = [own for (one, other), own in fits.items() if (one == goal) != (other == position)]
        return fit > PAIRED and all(own < fit - CLEARER for own in others)

    return {goal: position for goal, position in fits if clear(goal, position)}


def in_order(read: Read, goes: Relation, by_motion: bool) -> Read:
    """A goal's column with how late its position comes, in question where it comes before it.

    Args:
        read: how the column becomes a goal.
        goes: of the position behind it.
        by_motion: whether motion alone says whose goal it is.
    """
    if by_motion:
        read = replace(read, trust=LIKELY, why=f"no name says whose goal it is; {read.why}")
    if goes.fit > FOLLOWS and goes.lag < 0.0:
        why = f"the position moves {-1e3 * goes.lag:.0f} ms before it: are goal and position exchanged?"
        return replace(read, trust=ASK, why=why, ask=why)
    if goes.fit > FOLLOWS:
        return replace(read, why=f"{read.why}; the position follows it by {1e3 * goes.lag:.0f} ms")
    return read
