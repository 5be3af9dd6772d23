"""What speaks against a goal: a position that moves before it, against it, or not after it, and actions of a policy."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from ..types import Array
from .expression import names_in, quoted
from .lines import ASK, POSITION, Line, told
from .mapping import Question
from .motion import LONGEST_LAG, Relation, span
from .names import Claim
from .recording import Recording
from .units import measures

FOLLOWED = 0.5
"""Share of a motion that a goal explains, from which its delay tells something."""
LONGEST = 0.95
"""Share of the longest delay that is looked at from which the best one is at its end."""
NEARLY_ALL, FEWEST_CHANGES = 0.98, 40
"""Share of the samples in motion in which a goal that was never one is the reading itself, and how many tell it."""
ONE_TO_ONE, SCALED, OFFSET = 0.8, 1.5, 0.3
"""Share of a motion that an action explains, from which it may be scaled; times as far as the actions from which they
are;
share of a joint's range by which it stands beside them."""
MOVED_ALIKE, TICKED_ALIKE = {180.0 / math.pi: "deg and rad", 1e3: "mm and m"}, {1e3: "ms and s", 1e6: "us and s"}
"""Two units by their ratio."""
ACTIONS = (
    "by which factor, and from which angle, do actions become goals? Positions do not move as far as the actions, or "
    "stand elsewhere, as behind a policy whose actions are scaled and added to default angles. Numbers in lines are "
    "guesses from the motion: write <default angle> + <factor>*<column> as the controller has them, or the column "
    "itself if it is the goal"
)


def doubted(line: Line, goes: Relation, base: Line, timed: bool) -> Line:
    """A goal's line with how late its position comes, in question where it comes before it or moves against it."""
    if goes.fit <= FOLLOWED:
        return line
    if goes.scale < 0.0:
        ask = f"the position moves against this goal. If it counts the other way round, write -{line.text}"
        return line.asking("the position moves against it", ask, base)
    if not timed or (line.ask == ACTIONS and goes.lag >= 0.0):
        return line
    if goes.lag < 0.0:
        why = f"the position moves {-1e3 * goes.lag:.0f} ms before it: are goal and position exchanged?"
        return line.but(trust=ASK, why=why, ask=why)
    late = f"{1e3 * goes.lag:.0f} ms"
    if goes.lag > LONGEST * LONGEST_LAG:
        why = f"the position follows it best after {late}, the longest delay that is looked at"
        return line.asking(why, f"is this the goal of the position beside it? {why[0].upper()}{why[1:]}", base)
    return line.but(why=f"{line.why}; the position follows it by {late}")


def no_reading(line: Line, goal: tuple[str, Array], position: tuple[str, Array]) -> Line:
    """A goal's line, in question where it is the reading itself, of the same row or of the next.

    Args:
        line: how the column becomes a goal.
        goal, position: name and values (n,) of the two columns, as logged.
    """
    changes = np.flatnonzero(np.diff(position[1]) != 0.0)
    for ahead in (0, 1) if len(changes) >= FEWEST_CHANGES else ():
        share = float(np.mean(goal[1][changes] == position[1][changes + ahead]))
        if share >= NEARLY_ALL:
            why = f"It is {quoted(position[0])}{' of the next row' * ahead} in {share:.0%} of the rows in motion"
            why += ", as no servo follows a goal"
            return line.but(
                trust=ASK,
                why=why,
                ask=f"is {quoted(goal[0])} what was sent to the servo? {why}: log what was sent as the goal",
            )
    return line


def action_line(line: Line, goes: Relation, values: Array, position: Array, base: Line) -> Line:
    """How an action becomes a goal by the motion, in question where it is none as it stands.

    Args:
        line: the column as a goal.
        goes: of the position behind it.
        values, position: of the column and of the position, as logged.
        base: how the position is read.
    """
    goal, known = (measures(one.unit, *POSITION) for one in (line, base))
    if goal is None or known is None or goes.scale <= 0.0 or goes.fit < FOLLOWED or base.trust == ASK:
        return line
    scaled = goes.fit >= ONE_TO_ONE and abs(math.log(goes.scale * known.factor / goal.factor)) >= math.log(SCALED)
    factor = goes.scale if scaled else goal.factor / known.factor
    offset = float(np.nanmean(position) - factor * np.nanmean(values))
    apart = abs(offset) > OFFSET * max(span(position), factor * span(values))
    if not (scaled or apart):
        return line
    text = quoted(names_in(line.text)[0]) + f"*{factor:.2g}" * (abs(math.log(factor)) > 0.005)
    text = f"({offset:.2g} + {text})" if apart and known.behind else f"{offset:.2g} + {text}" if apart else text
    why = f"the position moves {goes.scale:.2g} times as far as the action, and stands {offset:.2g} from it"
    return Line(text + known.behind, base.unit, ASK, why, ACTIONS)


def differing_units(
    recordings: Sequence[Recording], columns: Mapping[str, Line], claims: Mapping[str, Claim]
) -> list[Question]:
    """Questions on columns that look to be in another unit in one run than in another."""
    found = []
    for name, line in columns.items() if len(recordings) > 1 else ():
        source = next((one for one in names_in(line.text) if one in recordings[0].columns), "")
        clock = name == "time"
        if not source or not (
            clock or (name.endswith(".position") and source in claims and not told(claims[source].unit))
        ):
            continue
        sizes = sorted((size, run.name) for run in recordings if (size := _size(run.columns[source], clock)) > 0.0)
        ratio = sizes[-1][0] / sizes[0][0] if sizes else 1.0
        pairs, near = (TICKED_ALIKE, 1.3) if clock else (MOVED_ALIKE, 1.8)
        if pair := next((pair for factor, pair in pairs.items() if abs(math.log(ratio / factor)) < math.log(near)), ""):
            (low, low_run), (high, high_run) = sizes[0], sizes[-1]
            ask = (
                f"{source} {'has a sample each' if clock else 'moves by'} {high:.4g} in {high_run} and {low:.4g} "
                f"in {low_run}: "
                f"are these in {pair}? If so, import them one at a time, each in its unit; else remove this question"
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
