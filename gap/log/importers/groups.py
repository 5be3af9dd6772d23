"""Columns by joint and signal: renamed, put where their motion says, and the best of several of one signal."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from ..types import COMMANDS
from .column import Column
from .evidence import Relation, multiple
from .in_table import ranked
from .pairs import matched
from .recording import Recording

Signals = dict[str, list[Column]]
"""Columns of one joint by signal."""
Groups = dict[str, Signals]
"""Columns by joint and signal."""


def renamed(groups: Groups, names: Mapping[str, str]) -> Groups:
    """Columns of joints that are one together, under its name.

    Args:
        groups: columns by joint and signal.
        names: new name by old one.
    """
    out: Groups = {}
    for joint, signals in groups.items():
        own = out.setdefault(names.get(joint, joint), {})
        for signal, columns in signals.items():
            own.setdefault(signal, []).extend(columns)
    return out


def match_goals(groups: Groups, relation: Callable[[str, str], Relation]) -> set[str]:
    """Put goals that no name puts to a joint to the joint that follows them; the columns of these.

    Args:
        groups: that are changed.
        relation: how much later than one column another one moves.
    """
    goals = {signals["goal"][0].name: joint for joint, signals in groups.items()
             if "goal" in signals and "position" not in signals}  # fmt: skip
    free = {signals["position"][0].name: joint for joint, signals in groups.items()
            if "position" in signals and not signals.keys() & {*COMMANDS}}  # fmt: skip
    found = matched(goals, free, relation)
    for goal, position in found.items():
        groups[free[position]]["goal"] = groups[goals[goal]].pop("goal")
    return set(found)


def untwist(signals: Signals, slope: Callable[[str], Relation]) -> None:
    """Tell of ``qd`` whether it is the derivative or the wanted one, by the numbers.

    Args:
        signals: of a joint, which are changed.
        slope: how a column goes with the derivative of the position.
    """
    for column in list(signals.get("goal", [])):
        by_name = column.by_format or column.said.how not in ("qd", "xd", "thetad", "phid")
        if not by_name and slope(column.name).fit > 0.9:
            signals["goal"].remove(column)
            signals.setdefault("velocity", []).append(column)


def best_of(signal: str, columns: Sequence[Column], run: Recording) -> tuple[Column, dict[str, str]]:
    """One of several columns of the same signal, and why the others are left out."""
    best, *others = ranked(signal, columns)
    left: dict[str, str] = {}
    for other in others:
        ratio = multiple(run.columns[best.name], run.columns[other.name])
        what = f"{ratio:.6g} times {best.name}" if ratio else f"{signal} as well"
        left[other.name] = f"{what}{', filtered' if other.said.filtered else ''}; {best.name} is taken"
    return best, left
