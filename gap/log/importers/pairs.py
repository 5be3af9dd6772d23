"""Columns of one joint that names alone do not bring together: endings of names, and what follows what."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace

import numpy as np

from ..types import COMMANDS, Array
from .evidence import LONGEST_LAG, Relation
from .expression import quoted
from .mapping import Question
from .units import ASK, LIKELY, Read

NAMELESS = "joint"
"""What a number without a name is of."""
NUMBERED = re.compile(r"(.*?)_?(\d+)")
FOLLOWS = 0.5
"""Share of a motion that another one explains, from which the two are goal and position."""
PAIRED = 0.8
"""Share of a motion that another one explains, from which two columns without names may be goal and position."""
MOST = 8
"""Columns without names that are looked at."""
END = 0.95
"""Share of the longest delay that is looked at from which the best one is at its end."""
CLEARER = 0.1
"""Share of the motion by which the joint of a goal without a name is ahead of the next one."""
NEARLY_ALL = 0.98
"""Share of the samples in motion in which a goal that was never one is the reading itself."""
FEWEST = 40
"""Samples in motion from which that is told."""


def same_joint(groups: Mapping[str, Mapping[str, object]], same_motion: Callable[[str, str], bool]) -> dict[str, str]:
    """Joints that are one by their names: commands of ``elbow`` go with ``joint_elbow``, and the shorter name stays.

    Args:
        groups: columns by joint and signal.
        same_motion: whether two joints have the same position.

    Returns:
        New name by old one, of both.
    """
    series = _one_series(groups)
    groups = {joint: signals for joint, signals in groups.items() if joint not in {*series, *series.values()}}
    commanded = {joint for joint, signals in groups.items() if signals.keys() & {*COMMANDS}}
    measured = {joint for joint, signals in groups.items() if "position" in signals and joint not in commanded}
    without = {joint for joint in commanded if "position" not in groups[joint]}
    names = series
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


def _one_series(groups: Mapping[str, Mapping[str, object]]) -> dict[str, str]:
    """Columns that only an index names, as ``torques[0]``, go to the only joints that are numbered alike."""
    series: dict[str, dict[int, str]] = {}
    for joint in groups:
        if match := NUMBERED.fullmatch(joint):
            series.setdefault(match[1], {})[int(match[2])] = joint
    own = series.pop(NAMELESS, {})
    alike = (one for one in series.values() if one.keys() == own.keys())
    placed = [one for one in alike if any("position" in groups[joint] for joint in one.values())]
    if len(placed) != 1:
        return {}
    names = {own[index]: joint for index, joint in placed[0].items()}
    return {} if any(groups[old].keys() & groups[new].keys() for old, new in names.items()) else names


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


def at_the_end(goes: Relation) -> bool:
    """Whether a delay is the longest one that is looked at, so that the best may be a longer one, or none."""
    return abs(goes.lag) > END * LONGEST_LAG


def in_order(
    read: Read, goes: Relation, by_motion: bool, position: Read, timed: bool, action: Read | None = None
) -> Read:
    """A goal's column with how late its position comes, in question where it comes before it or moves against it.

    Args:
        read: how the column becomes a goal.
        goes: of the position behind it.
        by_motion: whether motion alone says whose goal it is.
        position: how its position is read.
        timed: whether the time is known.
        action: how an action of a policy becomes a goal.
    """
    if by_motion:
        read = replace(read, trust=LIKELY, why=f"no name says whose goal it is; {read.why}")
    if goes.fit > FOLLOWS and goes.scale < 0.0:
        ask = f"the position moves against this goal. If it counts the other way round, write -{read.text}"
        return asked_too(read, position, "the position moves against it", ask)
    if timed and goes.fit > FOLLOWS and goes.lag < 0.0:
        why = f"the position moves {-1e3 * goes.lag:.0f} ms before it: are goal and position exchanged?"
        return replace(read, trust=ASK, why=why, ask=why)
    if action is not None and action.trust == ASK:
        return action
    if timed and goes.fit > FOLLOWS and at_the_end(goes):
        why = f"the position follows it best after {1e3 * goes.lag:.0f} ms, the longest delay that is looked at"
        return asked_too(read, position, why, f"is this the goal of the position beside it? {why[0].upper()}{why[1:]}")
    if timed and goes.fit > FOLLOWS:
        return replace(read, why=f"{read.why}; the position follows it by {1e3 * goes.lag:.0f} ms")
    return read


def unfollowed(read: Read, column: str, position: Read, follower: str) -> Read:
    """A goal's column that the position beside it does not follow, in question.

    Args:
        read: how the column becomes a goal.
        column: its name.
        position: how the position is read.
        follower: column of another position that follows it; empty where none does.
    """
    ask = (
        "is this the goal of the position beside it? The position does not move as it does. Keep the line if the joint "
        "hardly follows its goal, or is moved by its load; else give another column, or remove it"
    )
    if follower:
        ask = f"is {quoted(column)} the goal of {quoted(follower)}, which follows it? The position beside it does not"
    return asked_too(read, position, "the position does not follow it", ask)


def asked_too(read: Read, position: Read, why: str, ask: str) -> Read:
    """A column with one more question; that of its unit stays where the position does not ask it."""
    own = f"{read.ask or read.why}. And " if read.trust == ASK and read.ask != position.ask else ""
    return replace(read, trust=ASK, why=f"{read.why}; {why}", ask=f"{own}{ask}")


def who_moves(joint: str, pair: tuple[str, str, Relation]) -> Question:
    """Whether two columns without names are goal and position."""
    ask = (
        f"is {quoted(pair[1])} the position and {quoted(pair[0])} its goal? It moves as that does, "
        f"{1e3 * pair[2].lag:.0f} ms later"
    )
    return Question((f"{joint}.position", f"{joint}.goal"), ask)


def what_commands(joint: str, names: Iterable[str], pair: tuple[str, str, Relation] | None) -> Question:
    """What was commanded to a joint that nothing drives, with a hint at a column that it follows."""
    hint = f". {quoted(pair[0])} moves as it does, {1e3 * pair[2].lag:.0f} ms earlier: is it the goal?" if pair else ""
    return Question((f"{joint}.goal",), f"what was commanded to {joint}? It needs {' or '.join(names)}{hint}")


def no_reading(read: Read, goal: tuple[str, Array], position: tuple[str, Array]) -> Read:
    """A goal's column, in question where it is the reading itself, of the same row or of the next.

    Args:
        read: how the column becomes a goal.
        goal, position: name and values (n,) of the two columns, as logged.
    """
    changes = np.flatnonzero(np.diff(position[1]) != 0.0)
    if len(changes) < FEWEST:
        return read
    for ahead in (0, 1):
        share = float(np.mean(goal[1][changes] == position[1][changes + ahead]))
        if share >= NEARLY_ALL:
            ask = (
                f"is {quoted(goal[0])} what was sent to the servo? It is {quoted(position[0])}"
                f"{' of the next row' if ahead else ''} in {share:.0%} of the rows in motion, as no servo follows a "
                "goal: log what was sent as the goal"
            )
            return replace(read, trust=ASK, ask=ask, why=ask.partition("? ")[2].partition(":")[0])
    return read


def what_drives(joint: str, name: str, share: float, facts: Mapping[str, float | str]) -> tuple[Read, Question]:
    """How a column is read that goes with a joint's motion as a torque does, and the question about it.

    Args:
        joint: that moves.
        name: of the column.
        share: of the column that the motion explains.
        facts: numbers and words of the file.
    """
    factors = [key for key, value in facts.items() if not isinstance(value, str)]
    near = [key for key in factors if any(word in key.lower() for word in ("tau", "torque", "force", "kt", "gain"))]
    times = f"*{near[0]}" if near else ""
    among = f" The file has the numbers {', '.join(factors)}." if factors else ""
    ask = (
        f"is {quoted(name)} what drives {joint}? Motion explains {share:.0%} of it, as of a torque or force. If it "
        f"is its command, the line is {joint}.torque_command: {quoted(name)}{times} in N.m (slide: N).{among}"
    )
    read = Read(f"{quoted(name)}{times}", "?", ASK, "it goes with acceleration and speed as a torque or force does")
    return read, Question((f"{joint}.torque_command",), ask)
