"""Lists that name no joints, beside joints that the format names: whose each of their places is."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linear_sum_assignment

from ..types import TOLD, Array
from .column import Column
from .evidence import as_derivative, drives, following
from .expression import quoted
from .groups import Groups
from .names import said
from .pairs import FOLLOWS, PAIRED, at_the_end, matched
from .recording import Recording

PLACE = re.compile(r"(.+)\[(\d+)\]")
STILL = 0.02
"""Share of the largest motion that a joint at rest may move."""
NEAR = 1e-3
"""Distance of a joint from its goal, as a share of the power of its motion, that tells no order from another."""
TIMES = 2.0
"""Times the distance of the nearest order up to which the order of the joints is as near."""


@dataclass
class Lists:
    """Lists of a recording, and what became of them.

    Attributes:
        columns: by the list's name, in order, each with its place in brackets.
        by_motion: columns that no name puts to a joint, and motion does.
        asked: the question, by column whose joint is open.
        unused: why a column is left out.
    """

    columns: dict[str, list[str]]
    by_motion: set[str] = field(default_factory=set)
    asked: dict[str, str] = field(default_factory=dict)
    unused: dict[str, str] = field(default_factory=dict)

    def put(self, groups: Groups, run: Recording, time: Array) -> None:
        """Put places of lists to joints that the format names, as far as motion tells.

        Args:
            groups: to which columns are added.
            run: the recording.
            time: of its samples [s].
        """
        moving = sorted(self.columns, key=lambda name: all(np.ptp(run.columns[one]) == 0.0 for one in self[name]))
        for name in moving:
            self._put(name, groups, run, time)

    def __getitem__(self, name: str) -> list[str]:
        return self.columns[name]

    def _put(self, name: str, groups: Groups, run: Recording, time: Array) -> None:
        columns, signal = self[name], said(self[name][0]).signal
        placed = {joint: own["position"][0].name for joint, own in groups.items() if own.get("position")}
        free = {joint: column for joint, column in placed.items() if not groups[joint].get(signal)}
        found = _named(name, columns, free) or {}
        if not found and free:
            near = _beside(name, len(columns), free)
            found = self._told(signal, columns, near, run, time)
        for column in columns:
            if column in found:
                unit = run.units.get(column, "") or said(column).unit
                groups[found[column]].setdefault(signal, []).append(
                    Column(column, said(column), unit, "the name", False)
                )
            elif not free:
                self.unused[column] = f"{signal} of a list that names no joints, which all have one"
            else:
                self.unused[column] = (
                    f"{signal} of a list that names no joints, and motion does not tell whose: write "
                    f"<joint>.{signal}: {quoted(column)} where you know it"
                )

    def _told(
        self, signal: str, columns: Sequence[str], joints: Mapping[str, str], run: Recording, time: Array
    ) -> dict[str, str]:
        """The joint by column, in the order of the joints where that goes with their motion."""
        names, n = list(joints), len(columns)
        if n == len(names) == 1:
            return {columns[0]: names[0]}
        apart, unexplained, power = _compared(signal, columns, list(joints.values()), run, time)
        nearest = dict(zip(*linear_sum_assignment(apart), strict=True))
        least = (TIMES if signal == "goal" else 1.0) * sum(apart[k, j] for k, j in nearest.items()) + NEAR * n
        near = [s for s in range(len(names) - n + 1) if sum(apart[k, s + k] for k in range(n)) <= least]
        if len(near) == 1:
            own = range(near[0], near[0] + n)
            left = float(sum(unexplained[k, j] for k, j in enumerate(own)))
            if left < (1.0 - (FOLLOWS if signal == "goal" else PAIRED)) * float(power[own].sum()):
                self.by_motion |= set(columns)
                return {column: names[j] for column, j in zip(columns, own, strict=True)}
        found: dict[str, str] = {}
        if signal == "goal":
            by_position = {position: joint for joint, position in joints.items()}
            pairs = matched(columns, by_position, lambda a, b: following(time, run.columns[a], run.columns[b]))
            found = {column: by_position[position] for column, position in pairs.items()}
            self.by_motion |= set(found)
        if n != len(names) or signal not in TOLD:
            return found
        open_columns = [column for column in columns if column not in found]
        others = [joint for joint in names if joint not in found.values()]
        proposed = found | dict(zip(open_columns, others, strict=True))
        left = float(sum(unexplained[k, names.index(proposed[column])] for k, column in enumerate(columns)))
        if signal == "goal" and np.ptp(power) > 0.0 and left > (1.0 - FOLLOWS) * float(power.sum()):
            return found  # motion speaks against it
        ask = (
            f"whose are the places of {quoted(columns[0])} and of the columns beside it? The list names no joints, and "
            "motion does not tell. The lines have them in the order of the positions: exchange columns where its "
            "controller has another order"
        )
        self.asked |= dict.fromkeys(open_columns, ask)
        return proposed


def lists_of(run: Recording, signals: frozenset[str]) -> Lists:
    """Lists of a recording whose format names the joints of other columns.

    Args:
        run: the recording.
        signals: that a log has.
    """
    found: dict[str, dict[int, str]] = {}
    named = any(role.endswith(".position") for role in run.roles.values())
    for name in run.columns if named else ():
        match = PLACE.fullmatch(name)
        if match and name not in run.roles and said(name).signal in signals:
            found.setdefault(match[1], {})[int(match[2])] = name
    whole = {stem: own for stem, own in found.items() if sorted(own) == list(range(len(own)))}
    return Lists({stem: [own[k] for k in sorted(own)] for stem, own in whole.items()})


def _named(name: str, columns: Sequence[str], joints: Mapping[str, str]) -> dict[str, str]:
    """The joint of a list of one place that is called as it, as the controller of one joint."""
    if len(columns) > 1:
        return {}
    called = said(name).joint
    ends = [joint for joint in joints if called == joint or called.endswith(f"_{joint}")]
    return {columns[0]: max(ends, key=len)} if ends else {}


def _beside(name: str, count: int, joints: Mapping[str, str]) -> dict[str, str]:
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
    if len(alike) == 1:
        return alike[0]
    return {joint: column for one in near for joint, column in one.items()}


def _compared(
    signal: str, columns: Sequence[str], positions: Sequence[str], run: Recording, time: Array
) -> tuple[Array, Array, Array]:
    """How far each position is from each column, what of its motion this leaves, and its motion.

    All in the power of the joint's motion, so that each joint that moves counts alike; joints at rest hardly do.
    """
    spread = np.array([float(np.nanvar(run.columns[name])) for name in positions])
    floor = STILL**2 * float(spread.max(initial=0.0)) or 1.0
    weight = 1.0 / (spread + floor)
    apart, left = np.zeros((2, len(columns), len(positions)))
    for k, column in enumerate(columns):
        for j, position in enumerate(positions):
            first, second = run.columns[column], run.columns[position]
            if signal == "goal":
                apart[k, j], left[k, j] = _errors(time, first, second)
            else:
                share = drives(time, second, first) if signal in ("torque", "torque_command") else 0.0
                if signal in ("velocity", "goal_velocity"):
                    share = as_derivative(time, second, first).fit
                apart[k, j] = left[k, j] = (1.0 - share) * spread[j]
    return apart * weight, left * weight, spread * weight


def _errors(time: Array, goal: Array, position: Array) -> tuple[float, float]:
    """Mean square by which a position misses a goal as late as it follows it, and the same without an offset."""
    goes = following(time, goal, position)
    late = goes.lag if goes.fit > FOLLOWS and goes.lag > 0.0 and not at_the_end(goes) else 0.0
    error = position - np.interp(time - late, time, goal)
    error = error[np.isfinite(error)]
    return (float(np.mean(error**2)), float(error.var())) if len(error) else (np.inf, np.inf)
