"""What speaks against a goal: a position that moves before it, against it, or not after it, and actions of a policy."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from ..types import Array
from .expression import names_in
from .lines import ASK, POSITION, TOLD_FIT, Line, told
from .mapping import Question
from .motion import LONGEST_LAG, Relation, move_apart, span
from .names import Claim
from .recording import Recording
from .units import measures

FOLLOWED = 0.5
"""Share of a motion that a goal explains, from which its delay tells something."""
LONGEST = 0.95
"""Share of the longest delay that is looked at from which the best one is at its end."""
NEARLY_ALL, FEWEST_CHANGES = 0.98, 40
"""Share of the samples in motion in which a goal that was never one is the reading itself, and how many tell it."""
SCALED, OFFSET = 1.5, 0.3
"""Times as far as the actions from which a joint follows scaled ones; share of a joint's range by which it stands
beside them."""
ALIKE = {"deg and rad": 180.0 / math.pi, "mm and m": 1e3}, {"ms and s": 1e3, "us and s": 1e6}
"""Two units by their ratio, of angles and of clocks."""
UNFOLLOWED = (
    "is this the goal of the position beside it? The position does not move as it does. Keep the line if the joint "
    "hardly follows it, or is moved by its load; else give another column, or remove it"
)
ACTIONS = (
    "by which factor, and from which angle, do actions become goals? Positions do not move as far as the actions, or "
    "stand elsewhere, as behind a policy whose actions are scaled and added to default angles: write <default angle> + "
    "<factor>*<column> as the controller has them, or keep the column if it is the goal"
)


def doubted(line: Line, base: Line, goes: Relation, time: Array | None, goal: Array, position: Array) -> Line:
    """A goal's line with how late its position comes, in question where it does not come after it.

    Args:
        line: how the column becomes a goal.
        base: how the position is read.
        goes: of the position behind the goal.
        time: of the samples [s], None where it is not known.
        goal, position: their columns as logged (n,).
    """
    clock = np.arange(len(goal), dtype=np.float64) * 0.01 if time is None else time
    late = f"{1e3 * abs(goes.lag):.0f} ms"
    if goes.fit < TOLD_FIT and move_apart(clock, goal, position, TOLD_FIT):
        return line.asking("the position does not follow it", UNFOLLOWED, base)
    if (ahead := _reading(goal, position)) >= 0:
        why = f"it is the position{' of the next row' * ahead} in nearly all rows in motion, as no servo follows a goal"
        return line.but(
            trust=ASK, why=why, ask=f"is this what was sent to the servo? {why}: log what was sent as the goal"
        )
    if goes.fit <= FOLLOWED:
        return line
    if goes.scale < 0.0:
        ask = f"the position moves against this goal. If it counts the other way round, write -{line.text}"
        return line.asking("the position moves against it", ask, base)
    if time is None or (line.ask == ACTIONS and goes.lag >= 0.0):
        return line
    if goes.lag < 0.0:
        why = f"the position moves {late} before it: are goal and position exchanged?"
        return line.but(trust=ASK, why=why, ask=why)
    if goes.lag > LONGEST * LONGEST_LAG:
        why = f"the position follows it best after {late}, the longest delay that is looked at"
        return line.asking(why, f"is this the goal of the position beside it? {why[0].upper()}{why[1:]}", base)
    return line.but(why=f"{line.why}; the position follows it by {late}")


def _reading(goal: Array, position: Array) -> int:
    """How many rows ahead a goal is the reading itself, 0 or 1; -1 where it is none."""
    changes = np.flatnonzero(np.diff(position) != 0.0)
    shares = [float(np.mean(goal[changes] == position[changes + ahead])) for ahead in (0, 1)]
    return shares.index(max(shares)) if len(changes) >= FEWEST_CHANGES and max(shares) >= NEARLY_ALL else -1


def action_line(line: Line, goes: Relation, values: Array, position: Array, base: Line) -> Line:
    """An action of a policy as a goal, in question where the position does not go as far or stands elsewhere.

    Args:
        line: the column as a goal.
        goes: of the position behind it.
        values, position: of the column and of the position, as logged.
        base: how the position is read.
    """
    goal, known = (measures(one.unit, *POSITION) for one in (line, base))
    if not (goal and known) or goes.scale <= 0.0 or goes.fit < FOLLOWED or base.trust == ASK:
        return line
    factor = goal.factor / known.factor
    offset = abs(float(np.nanmean(position) - factor * np.nanmean(values)))
    scaled = abs(math.log(goes.scale / factor)) >= math.log(SCALED)
    if scaled or offset > OFFSET * max(span(position), factor * span(values)):
        why = f"the position moves {goes.scale:.2g} times as far as the action, and stands {offset:.2g} from it"
        return line.but(trust=ASK, why=why, ask=ACTIONS)
    return line


def differing_units(
    recordings: Sequence[Recording], columns: Mapping[str, Line], claims: Mapping[str, Claim]
) -> list[Question]:
    """Questions on columns that look to be in another unit in one run than in another."""
    found = []
    for name, line in columns.items() if len(recordings) > 1 else ():
        source = next((one for one in names_in(line.text) if one in recordings[0].columns), "")
        clock = name == "time"
        angle = name.endswith(".position") and source in claims and not told(claims[source].unit)
        if not source or not (clock or angle):
            continue
        sizes = sorted((size, run.name) for run in recordings if (size := _size(run.columns[source], clock)) > 0.0)
        ratio, near = sizes[-1][0] / sizes[0][0] if sizes else 1.0, 1.3 if clock else 1.8
        pairs = [pair for pair, factor in ALIKE[clock].items() if abs(math.log(ratio / factor)) < math.log(near)]
        if pairs:
            (low, low_run), (high, high_run) = sizes[0], sizes[-1]
            ask = (
                f"{source} {'has a sample each' if clock else 'moves by'} {high:.4g} in {high_run} and {low:.4g} in "
                f"{low_run}: are these in {pairs[0]}? If so, import them one at a time, each in its unit; else remove "
                "this question"
            )
            goal = f"{name.rpartition('.')[0]}.goal"
            found.append(Question((name, goal) if goal in columns else (name,), ask))
    return found


def _size(values: Array, clock: bool) -> float:
    """Sample period of a clock, or how far a column moves; 0 where it does not."""
    known = values[np.isfinite(values)]
    if clock:
        return float(np.median(np.diff(known))) if len(known) > 1 else 0.0
    return span(values) if len(np.unique(known)) > 10 else 0.0
