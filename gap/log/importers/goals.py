"""Goals: their unit, and what speaks against them: a position that moves before one, against it, or not after it."""

from __future__ import annotations

import math

import numpy as np

from ..types import MIN_CHANGES, READING_SHARE, Array
from .expression import names_in, quoted
from .lines import ASK, LIKELY, POSITION, SURE, Line, in_unit
from .motion import LONGEST_LAG, Relation, move_apart, span
from .names import Claim
from .units import measures

COMPARED_FIT, FOLLOWED_FIT = 0.3, 0.5
"""Shares of a motion that a goal explains, from which their sizes are compared, and its delay tells something."""
ANOTHER_UNIT = 5.0
"""Factor from which a goal may be in another unit than its position: rad and turns, the nearest two, are 6.3 apart."""
LONGEST_SHARE = 0.95
"""Share of the longest delay that is looked at from which the best one is at its end."""
SCALED_ACTIONS, ACTION_OFFSET = 1.5, 0.3
"""Times as far as the actions from which a joint follows scaled ones; share of a joint's range by which it stands
beside them."""
UNFOLLOWED = (
    "is this the goal of the position beside it? The position does not move as it does. Keep the line if the joint "
    "hardly follows it, or is moved by its load; else give another column, or remove it"
)
ACTIONS = (
    "by which factor, and from which angle, do actions become goals? Positions do not move as far as the actions, or "
    "stand elsewhere, as behind a policy whose actions are scaled and added to default angles: write <default angle> + "
    "<factor>*<column> as the controller has them, or keep the column if it is the goal"
)


def goal_line(claim: Claim, unit: str, by: str, base: Line, goes: Relation) -> Line:
    """A goal or a second position; asked about where the position moves as in another unit.

    Args:
        claim: on its column.
        unit: that somebody says; empty: in that of the position.
        by: who says it.
        base: how the position is read.
        goes: of the position behind it, both as in the file.
    """
    own, known = measures(unit, *POSITION), measures(base.unit, *POSITION)
    if unit and not own and unit != base.unit:
        why = f"{by} says {unit}, which is no unit of an angle or a way"
        return in_unit(claim.column, unit, ASK, why, base.ask)
    if own:
        line = in_unit(claim.column, unit, SURE, f"{by} says {unit}")
    else:
        of_position = next((quoted(name) for name in names_in(base.text) if name != "pi"), "")
        text, trust = base.text.replace(of_position, quoted(claim.column)), ASK if base.trust == ASK else LIKELY
        line = Line(text, base.unit, trust, f"in the unit of the position, {base.unit}", base.ask)
    compared = base.trust != ASK and (not own or base.open or by == "unit=")
    if not (compared and known and goes.fit > COMPARED_FIT and goes.scale):
        return line
    times = f"the position moves {abs(goes.scale):.2g} times as far in the numbers of the file"
    line = line.but(why=f"{line.why}; {times}")
    if abs(math.log(abs(goes.scale) * (known.factor / own.factor if own else 1.0))) < math.log(ANOTHER_UNIT):
        return line
    ask = (
        f"in which unit is {quoted(claim.column)}? {times[0].upper()}{times[1:]}; keep {line.unit} if the joint hardly "
    )
    return line.but(trust=ASK, ask=f"{ask}follows it, or is held and moved by its load")


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
    if goes.fit < COMPARED_FIT and move_apart(clock, goal, position, COMPARED_FIT):
        return line.asking("the position does not follow it", UNFOLLOWED, base)
    if (ahead := _reading(goal, position)) >= 0:
        why = f"it is the position{' of the next row' * ahead} in nearly all rows in motion, as no servo follows a goal"
        ask = f"is this what was sent to the servo? {why}: log what was sent as the goal"
        return line.but(trust=ASK, why=why, ask=ask)
    if goes.fit <= FOLLOWED_FIT:
        return line
    if goes.scale < 0.0:
        ask = f"the position moves against this goal. If it counts the other way round, write -{line.text}"
        return line.asking("the position moves against it", ask, base)
    if time is None or (line.ask == ACTIONS and goes.lag >= 0.0):
        return line
    if goes.lag < 0.0:
        why = f"the position moves {late} before it: are goal and position exchanged?"
        return line.but(trust=ASK, why=why, ask=why)
    if goes.lag > LONGEST_SHARE * LONGEST_LAG:
        why = f"the position follows it best after {late}, the longest delay that is looked at"
        return line.asking(why, f"is this the goal of the position beside it? {why[0].upper()}{why[1:]}", base)
    return line.but(why=f"{line.why}; the position follows it by {late}")


def _reading(goal: Array, position: Array) -> int:
    """How many rows ahead a goal is the reading itself, 0 or 1; -1 where it is none."""
    changes = np.flatnonzero(np.diff(position) != 0.0)
    shares = [float(np.mean(goal[changes] == position[changes + ahead])) for ahead in (0, 1)]
    return shares.index(max(shares)) if len(changes) >= MIN_CHANGES and max(shares) >= READING_SHARE else -1


def action_line(line: Line, goes: Relation, values: Array, position: Array, base: Line) -> Line:
    """An action of a policy as a goal, in question where the position does not go as far or stands elsewhere.

    Args:
        line: the column as a goal.
        goes: of the position behind it.
        values, position: of the column and of the position, as logged.
        base: how the position is read.
    """
    goal, known = (measures(one.unit, *POSITION) for one in (line, base))
    if not (goal and known) or goes.scale <= 0.0 or goes.fit < FOLLOWED_FIT or base.trust == ASK:
        return line
    factor = goal.factor / known.factor
    offset = abs(float(np.nanmean(position) - factor * np.nanmean(values)))
    scaled = abs(math.log(goes.scale / factor)) >= math.log(SCALED_ACTIONS)
    if scaled or offset > ACTION_OFFSET * max(span(position), factor * span(values)):
        why = f"the position moves {goes.scale:.2g} times as far as the action, and stands {offset:.2g} from it"
        return line.but(trust=ASK, why=why, ask=ACTIONS)
    return line
