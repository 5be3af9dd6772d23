"""Actions of a policy that are scaled, or measured from a default angle, on their way to a goal."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from ..types import Array
from .column import span
from .evidence import Relation
from .expression import names_in, quoted
from .name_words import COMMANDED
from .names import said, words_of
from .pairs import FOLLOWS, PAIRED
from .unit_words import measures
from .units import ASK, POSITION, Read

ACTIONS = frozenset(["action", "actions"])
"""Words for what a policy gives."""
SCALED = 1.5
"""Times as far as the actions, or as little, from which positions show that actions are scaled."""
OFFSET = 0.3
"""Share of a joint's range from which a position that stands beside its action shows a default angle."""
MOST = 0.5
"""Share of the actions from which what these show holds for all of them, for a policy gives one vector."""
QUESTION = (
    "by which factor, and from which angle, do actions become goals? Positions do not move as far as the actions, or "
    "stand elsewhere, as behind a policy whose actions are scaled and added to default angles. Numbers in lines are "
    "guesses from the motion: write <default angle> + <factor>*<column> as the controller has them, or the column "
    "itself if it is the goal"
)


def only_action(name: str) -> bool:
    """Whether a name says an action, and no goal."""
    words = {word.lower() for word in words_of(name)}
    return bool(words & ACTIONS) and not words & (COMMANDED - ACTIONS)


def read_action(read: Read, goes: Relation, values: Array, position: Array, base: Read) -> Read | None:
    """How an action becomes a goal by the motion, in question where it is none as it stands; None of other goals.

    Args:
        read: the column as a goal.
        goes: of the position behind it.
        values, position: of the column and of the position, as logged.
        base: how the position is read.
    """
    column = next(iter(names_in(read.text)), "")
    if said(column).how.lower() not in ACTIONS or read.trust == ASK:
        return None
    goal, known = (measures(one.unit, *POSITION) for one in (read, base))
    if goal is None or known is None or goes.scale <= 0.0 or goes.fit < FOLLOWS:
        return replace(read, ask=QUESTION)
    scaled = goes.fit >= PAIRED and abs(math.log(goes.scale * known.factor / goal.factor)) >= math.log(SCALED)
    factor = goes.scale if scaled else goal.factor / known.factor
    offset = float(np.nanmean(position) - factor * np.nanmean(values))
    beside = abs(offset) > OFFSET * max(span(position), factor * span(values))
    text = f"{quoted(column)}*{factor:.2g}" if abs(math.log(factor)) > 0.005 else quoted(column)
    if beside:
        text = f"({offset:.2g} + {text}){known.behind}" if known.behind else f"{offset:.2g} + {text}"
    else:
        text += known.behind
    moves, stands = f"moves {goes.scale:.2g} times as far as the action", f"stands {offset:.2g} from it"
    why = " and ".join(part for part, told in ((moves, scaled), (stands, beside)) if told)
    if not why:
        return replace(read, ask=QUESTION)
    return Read(text, base.unit, ASK, f"the position {why}", QUESTION)


def together(actions: Mapping[str, Read], columns: Mapping[str, Read]) -> Iterator[tuple[str, Read]]:
    """Actions that are in question because most of their vector are.

    Args:
        actions: as :func:`read_action` gave them, by the column of the log.
        columns: of the log, as they are read.
    """
    shown = sum(columns[name].trust == ASK for name in actions)
    if shown >= MOST * len(actions):
        for name, read in actions.items():
            if columns[name].trust != ASK:
                yield name, replace(read, trust=ASK, why=f"{read.why}; other actions are no goals as they stand")
