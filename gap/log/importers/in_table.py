"""What the name of a column says beside the names of the others: axes of a motor's field, drives that count turns."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from .actions import only_action
from .column import Column, plain
from .name_words import MODELLED, PLANNED, SUPPLY
from .names import Said, said, words_of
from .series import joints_together
from .unit_words import measures
from .units import POSITION

AXIS = re.compile(
    r"(?<![a-z])(?:(?P<before>[qd])[\W_]*current(?![a-z])|current[\W_]*(?P<after>[qd])(?![a-z]))", re.IGNORECASE
)
"""``q_current``: the current that makes torque, or an angle q as it is now; ``d_current``: or that of a motor d."""
TURNS = {"position": "turn", "goal": "turn", "velocity": "turn/s", "goal_velocity": "turn/s"}
"""Units of moteus."""
OF_SUPPLY = SUPPLY | {"in", "input", "bus"}
"""Words of a current that is not the motor's."""


def said_together(names: Iterable[str]) -> dict[str, Said]:
    """Read the names of a table's columns."""
    alone = {name: said(name) for name in names}
    together = {name: _axis(name, alone) or spoken for name, spoken in alone.items()}
    if _is_moteus(together):
        together = {name: _in_turns(spoken) for name, spoken in together.items()}
    together = joints_together(together)
    goals = any(spoken.signal == "goal" for spoken in together.values())
    return {
        name: replace(spoken, signal="torque that a controller computed beside a goal, and that no drive is told")
        if goals and spoken.signal == "torque_command" and _modelled(name)
        else spoken
        for name, spoken in together.items()
    }


def ranked(signal: str, columns: Sequence[Column]) -> list[Column]:
    """Columns of one signal, the best first: what the format says, not processed, in a unit that is said.

    A position is none whose name says a unit of something else; of currents the one that makes torque comes first, and
    that of the supply last; of goals what was sent to the drive comes before the plan, or the action of a policy,
    that it was made of.
    """

    def late(column: Column) -> tuple[bool, bool]:
        words = {word.lower() for word in words_of(column.name)}
        return bool(OF_SUPPLY & words), "q" not in words and "iq" not in words

    return sorted(
        columns,
        key=lambda c: (
            signal == "position" and c.unit not in ("", "?", "tick", "%") and not measures(c.unit, *POSITION),
            not c.by_format,
            c.said.filtered,
            c.unit in ("tick", "%"),
            signal == "goal" and only_action(c.name),
            signal == "goal" and bool(PLANNED & {word.lower() for word in words_of(c.name)}),
            *(late(c) if signal == "current" else ()),
            len(c.name),
        ),
    )


def _axis(name: str, alone: Mapping[str, Said]) -> Said | None:
    """What a current of a motor's field says, where the table shows that it is one."""
    letter = _letter(name)
    if not letter:
        return None
    axis = said(AXIS.sub(f" {letter} axis current ", name))
    other = any(_letter(one) == {"q": "d", "d": "q"}[letter] for one in alone)
    positions = (
        one for one, spoken in alone.items() if spoken.signal == "position" and not _letter(one) and "axis" not in one
    )
    twice = letter == "q" and any(plain(alone[one].joint) == plain(axis.joint) for one in positions)
    return axis if other or twice else None


def _letter(name: str) -> str:
    match = AXIS.search(name)
    return (match["before"] or match["after"]).lower() if match else ""


def _is_moteus(together: Mapping[str, Said]) -> bool:
    """Whether the registers of a moteus drive are there, which its tools call so."""
    plain_names = ["_" + "_".join(word.lower() for word in words_of(name) if not word.isdigit()) for name in together]

    def has(*endings: str) -> bool:
        return all(any(name.endswith(f"_{ending}") for name in plain_names) for ending in endings)

    return has("mode", "fault", "position") and (has("control_position") or has("q_current", "d_current"))


def _in_turns(spoken: Said) -> Said:
    unit = TURNS.get(spoken.signal, "")
    return replace(spoken, unit=unit, by="a header as of moteus") if unit and not spoken.unit else spoken


def _modelled(name: str) -> bool:
    """Whether a torque is of a controller's model: UR calls it ``target_moment``, simulators call it computed."""
    words = {word.lower() for word in words_of(name)}
    return MODELLED in words or {"target", "moment"} <= words
