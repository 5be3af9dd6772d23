"""Whose and what the columns of a recording are: its format says it, else a dialect, else their names, read together.

Names bring columns of one joint together only where no signal comes twice: two positions are two joints.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from ..types import SIGNAL_UNITS
from .dialects import Dialect, claimed
from .expression import measures, unit_of
from .names import Claim, is_a, said
from .recording import Recording

ONLY_JOINT = "joint"
"""What a joint is called that nothing names, and a number without a name is of."""
MOVES = ("position", "goal", "velocity")
ANGLES = ("position", "goal")
OF_A_MOTOR = frozenset(["torque", "torque_command", "current", "voltage", "temperature", "duty", "load", "enabled"])
"""Signals of a motor that are of its joint, too; a motor's angle and speed are before a gear."""
BEFORE = re.compile(r"(?<![A-Za-z0-9.])\d+(?:_\d+)?(?P<unit>[A-Za-zµμ°]{2,})(?![A-Za-z0-9])")
"""``current_5mA``: a unit with its number, or of joint 5."""

AS_A_LOG = re.compile(rf"([^.]+)\.({'|'.join(SIGNAL_UNITS)})")
"""A column as a log calls it: ``<joint>.<signal>``."""

Groups = dict[str, dict[str, list[Claim]]]
"""Claims by joint and signal."""


@dataclass
class Claimed:
    """The columns of a recording.

    Attributes:
        groups: claims by joint and signal.
        nobodys: columns that nobody claims.
        aside: why a column is none of a log.
        claims: of all columns, by name.
    """

    groups: Groups = field(default_factory=dict)
    nobodys: list[str] = field(default_factory=list)
    aside: dict[str, str] = field(default_factory=dict)
    claims: dict[str, Claim] = field(default_factory=dict)


def plain(joint: str) -> str:
    """A joint's name without words that name none."""
    return "" if is_a("vague", joint) else joint


def claims_of(recording: Recording, known: Sequence[Dialect]) -> dict[str, Claim]:
    """What the format, dialects and names say of each column, the first that says something."""
    of_dialect = claimed(recording, known)
    out: dict[str, Claim] = {}
    for column in recording.columns:
        claim = of_dialect.get(column) or replace(said(column), column=column)
        if not claim.sure and (match := AS_A_LOG.fullmatch(column)) and match[2] == claim.signal:
            claim = replace(claim, joint=match[1], sure=True)
        if role := recording.roles.get(column, ""):
            joint, _, signal = role.rpartition(".")
            claim = replace(claim, signal=signal, joint=joint, aside="", by="the format", sure=True, how="")
        if unit := recording.units.get(column, ""):
            by = "the format" if role else "the file"
            claim = replace(claim, unit=unit, by=by)
        if ask := recording.asks.get(column, ""):
            claim = replace(claim, ask=ask if role else "", aside="" if role else ask)
        out[column] = claim
    return out


def placed(recording: Recording, known: Sequence[Dialect], skipped: Iterable[str]) -> Claimed:
    """The columns of a recording by joint and signal.

    Args:
        recording: one run.
        known: dialects.
        skipped: columns that are the time, or no signal.
    """
    out = Claimed(claims=claims_of(recording, known))
    found: list[Claim] = []
    skipped, goals = set(skipped), any(claim.signal == "goal" for claim in out.claims.values())
    for claim in out.claims.values():
        if claim.column in skipped:
            continue
        if goals and claim.signal == "torque_command" and "computed" in claim.words:
            claim = replace(claim, aside="torque that a controller computed beside a goal, and that no drive is told")
        if claim.aside:
            out.aside[claim.column] = claim.aside
        elif claim.signal in SIGNAL_UNITS or claim.signal == "load":
            found.append(claim)
        elif claim.signal == "time":
            out.aside[claim.column] = "another clock"
        else:
            out.nobodys.append(claim.column)
    for claim in _with_joints(_factors(found)):
        out.groups.setdefault(claim.joint, {}).setdefault(claim.signal, []).append(claim)
    _join_names(out)
    return out


def _factors(found: list[Claim]) -> list[Claim]:
    """A number at a unit that no position has as its joint's, or the power of ten of the only joint, may be a factor:
    such a unit is asked about."""
    moving = {claim.joint for claim in found if claim.signal in ANGLES}
    power = re.fullmatch(rf"{ONLY_JOINT}10+|e\d+", next(iter(moving))) if len(moving) == 1 else None
    alike = power and all(claim.unit for claim in found if claim.joint == power[0])
    out = []
    for claim in found:
        match = BEFORE.search(claim.column)
        if not claim.sure and match and claim.joint not in moving and unit_of(match["unit"]) == claim.unit:
            claim = replace(claim, joint="", unit=match[0])
        elif power and alike and claim.joint == power[0] and not claim.sure:
            claim = replace(claim, joint="", unit=f"{claim.unit} {power[0].removeprefix(ONLY_JOINT)}")
        out.append(claim)
    return out


# --- joints ----------------------------------------------------------------------------------------------------------


def _with_joints(found: list[Claim]) -> Iterable[Claim]:
    """Claims with the joint that the rest of their names means."""
    sure = list(dict.fromkeys(claim.joint for claim in found if claim.sure and claim.joint))
    moving = list(dict.fromkeys(claim.joint for claim in found if claim.signal in MOVES))
    single = len({plain(joint) for joint in moving}) <= 1
    named = next((joint for joint in moving if plain(joint)), ONLY_JOINT)
    for claim in found:
        joint, rest = claim.joint, claim.rest
        if not claim.sure and single:
            joint = sure[0] if len(sure) == 1 else named
            rest = rest or (claim.joint if plain(claim.joint).isalpha() and claim.joint != joint else "")
        elif not claim.sure and joint not in moving:
            ends = [known for known in (*sure, *moving) if known and joint.endswith(f"_{known}")]
            joint = max(ends, key=len, default=joint)
        elif claim.sure and not joint:
            joint = named if single else joint
        yield replace(claim, joint=joint, rest=rest)


def _join_names(out: Claimed) -> None:
    """Joints that are one by their names under one, and a name for the one that has none beside others."""
    out.groups = renamed(out.groups, _owners(out.groups))
    alone = len(out.groups) > 1 and "position" in out.groups.get("", {}) and ONLY_JOINT not in out.groups
    out.groups = renamed(out.groups, {"": ONLY_JOINT} if alone else {})


def renamed(groups: Groups, names: Mapping[str, str]) -> Groups:
    """Columns of joints that are one together, under its name."""
    out: Groups = {}
    for joint, signals in groups.items():
        own = out.setdefault(names.get(joint, joint), {})
        for signal, claims in signals.items():
            own.setdefault(signal, []).extend(claims)
    return out


def _owners(groups: Groups) -> dict[str, str]:
    """What has no position goes to the only joint with one whose name ends as its own; new name by old one.

    Words such as ``joint`` and ``motor`` name none: ``torques[0]`` is of ``leg0``, ``elbow_cmd`` of ``joint_elbow``. A
    motor's speed is before a gear, and stays.
    """
    names: dict[str, str] = {}
    measured = {joint: _words_of(joint) for joint, own in groups.items() if own.get("position")}
    for joint, own in groups.items():
        words = _words_of(joint)
        homes = [home for home, its in measured.items() if its[len(its) - len(words) :] == words]
        exact = [home for home in homes if measured[home] == words]
        homes = exact if len(exact) == 1 else homes
        of_motor = "motor" not in joint.lower() or not own.keys() - OF_A_MOTOR
        if joint in measured or len(homes) != 1 or not of_motor or own.keys() & groups[homes[0]].keys():
            continue
        plainly = joint != homes[0] and plain(joint) and [joint] == homes[0].split("_")[1:]  # A1 beside Joint_A1
        names |= {joint: joint if plainly else homes[0]} | ({homes[0]: joint} if plainly else {})
    return names


def _words_of(joint: str) -> list[str]:
    """Words and numbers of a joint's name without those that name none."""
    return [word for word in re.findall(r"[^\W\d_]+|\d+", joint.lower()) if not is_a("joint", word)]


# --- one of several --------------------------------------------------------------------------------------------------


def ranked(signal: str, claims: Sequence[Claim]) -> list[Claim]:
    """Columns of one signal, the best first: what the format says, not processed, in a unit that is said.

    A position is none whose name says a unit of something else; of currents the one that makes torque comes first, and
    that of the supply last; of goals what was sent to the drive comes before the plan, or the action of a policy,
    that it was made of.
    """

    return sorted(claims, key=lambda claim: (*_rank(signal, claim), len(claim.column)))


def first_of(signal: str, claims: Sequence[Claim]) -> list[Claim]:
    """The best of them, shortest name first: more than one where names do not tell which it is."""
    best, *others = ranked(signal, claims)
    return [best, *(one for one in others if _rank(signal, one) == _rank(signal, best))]


def _rank(signal: str, claim: Claim) -> tuple[object, ...]:
    words = claim.words
    supply = words & {"in", "input", "bus"} or is_a("supply", *words)
    return (
        signal == "position" and not (claim.unit in ("", "?", "tick", "%") or measures(claim.unit, "angle", "way")),
        not claim.sure, is_a("filtered", *words), claim.unit in ("tick", "%"),
        bool(claim.ask), signal == "goal" and is_action(claim),
        signal == "goal" and bool(words & {"planned", "interpolated", "ipo"}),
        signal == "current" and bool(supply), signal == "current" and not words & {"q", "iq"},
    )  # fmt: skip


def is_action(claim: Claim) -> bool:
    """Whether a name says the action of a policy, and no goal."""
    actions = {"action", "actions"}
    return bool(claim.words & actions) and not is_a("commanded", *(claim.words - actions))
