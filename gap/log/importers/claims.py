"""Whose and what the columns of a recording are: its format says it, else a dialect, else their names, read together.

Names bring columns of one joint together only where no signal comes twice: two positions are two joints.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from ..types import COMMANDS, OTHER, SIGNAL_UNITS, TOLD
from .dialects import Dialect, claimed
from .expression import quoted
from .names import Claim, is_a, said
from .recording import Recording
from .units import measure, measures, unit_of

ONLY_JOINT = "joint"
"""What a joint is called that nothing names, and a number without a name is of."""
MOVES = ("position", "goal", "velocity")
ANGLES = ("position", "goal")
OF_A_MOTOR = frozenset(["torque", "torque_command", "current", "voltage", "temperature", "duty", "load", "enabled"])
"""Signals of a motor that are of its joint, too; a motor's angle and speed are before a gear."""
ARM = re.compile(r"(?:(.*)_)?(?:(leader|master)|(follower|puppet|slave))_?(.*)", re.IGNORECASE)
"""Arms of which one is led by hand and the other follows it."""
BEFORE = re.compile(r"(?<![A-Za-z0-9.])(?P<number>\d+(?:_\d+)?)(?P<unit>[A-Za-zµμ°]{2,})(?![A-Za-z0-9])")
"""``current_5mA``: a unit with its number, or of joint 5."""

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
        renamed: words that logs reserve, by the joint's name here.
    """

    groups: Groups = field(default_factory=dict)
    nobodys: list[str] = field(default_factory=list)
    aside: dict[str, str] = field(default_factory=dict)
    claims: dict[str, Claim] = field(default_factory=dict)
    renamed: dict[str, str] = field(default_factory=dict)


def plain(joint: str) -> str:
    """A joint's name without words that name none."""
    return "" if is_a("vague", joint) else joint


def claims_of(recording: Recording, known: Sequence[Dialect]) -> dict[str, Claim]:
    """What the format, dialects and names say of each column, the first that says something."""
    of_dialect = claimed(recording, known)
    out: dict[str, Claim] = {}
    for column in recording.columns:
        joint, name = recording.parts.get(column, ("", column))
        claim = of_dialect.get(column) or replace(said(name), column=column)
        if joint:
            claim = replace(claim, joint=joint, sure=True)
        if role := recording.roles.get(column, ""):
            joint, _, signal = role.rpartition(".")
            claim = replace(claim, signal=signal, joint=joint, aside="", by="the format", sure=True, how="")
        if unit := recording.units.get(column, ""):
            by = "the format" if role else "the file"
            claim = replace(claim, unit=unit, by=by)
        out[column] = claim
    return _derivatives(_led(out))


def _led(claims: dict[str, Claim]) -> dict[str, Claim]:
    """An arm that is led by hand is the goal of the one that follows it, where that has no other."""
    arms = {column: match for column, claim in claims.items() if (match := ARM.fullmatch(claim.joint))}
    joints = {column: beside(match) for column, match in arms.items()}
    led = {joints[column] for column, match in arms.items() if match[2]}
    led &= {joints[column] for column, match in arms.items() if match[3]}
    follows = [(joints[column], claims[column].signal) for column, match in arms.items() if match[3]]
    out = dict(claims)
    for column, match in arms.items():
        claim, joint = claims[column], joints[column]
        if joint not in led:
            continue
        signal, aside = claim.signal, claim.aside
        if match[2]:
            leads = signal in ("", "position") and (joint, "goal") not in follows
            aside = "" if leads else f"{signal or 'position'} of the arm that leads".replace("_", " ")
            signal = "goal" if leads else ""
        elif not signal and not {(joint, "goal"), (joint, "position")} & set(follows):
            signal = "position"
        out[column] = replace(claim, signal=signal, joint=joint, aside=aside, how=claim.how or match[2] or match[3])
    return out


def beside(match: re.Match[str]) -> str:
    """The joint's name without the arm's."""
    rest = "_".join(part for part in (match[1], match[4]) if part)
    return f"{ONLY_JOINT}{rest}" if rest.isdigit() else rest


def _derivatives(claims: dict[str, Claim]) -> dict[str, Claim]:
    """``qd`` is the wanted angle beside a velocity, the velocity beside a goal, and else a question."""
    open_ones = [claim for claim in claims.values() if claim.how == "qd" and claim.signal == "position"]
    for claim in open_ones:
        own = {
            other.signal
            for other in claims.values()
            if plain(other.joint) == plain(claim.joint) and other not in open_ones
        }
        signal, ask = "goal", ""
        if own & {"goal", "torque_command"} and "velocity" not in own:
            signal = "velocity"
        elif "velocity" not in own:
            ask = (
                "is this the wanted angle, or the derivative of the position? The line has it as the goal; the "
                "derivative is <joint>.velocity"
            )
        claims[claim.column] = replace(claim, signal=signal, ask=ask)
    return claims


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
    _unnamed_positions(out)
    _join_names(out)
    return out


# --- what stands beside a unit ---------------------------------------------------------------------------------------


def _factors(found: list[Claim]) -> list[Claim]:
    """A number at a unit is no joint's where no position has it, and may be a factor where all have the same one."""
    moving = {claim.joint for claim in found if claim.signal in ANGLES}
    only = next(iter(moving)) if len(moving) == 1 else ""
    power = re.fullmatch(rf"{ONLY_JOINT}(10+)|(e\d+)", only)
    alike = bool(power) and all(claim.unit for claim in found if claim.joint == only)
    out = []
    for claim in found:
        match = BEFORE.search(claim.column)
        if not claim.sure and match and claim.joint not in moving and unit_of(match["unit"]) == claim.unit:
            whole = f"{match['number']} {claim.unit}"
            claim = replace(claim, joint="", unit=whole if measure(whole) else match[0])
        elif power and alike and claim.joint == only and not claim.sure:
            claim = replace(claim, joint="", unit=f"{claim.unit} {power[1] or power[2]}")
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


def _unnamed_positions(out: Claimed) -> None:
    """A column that is called as a joint with a command, and no more, is its position."""
    for joint, signals in out.groups.items():
        called = [name for name in out.nobodys if joint and out.claims[name].joint == joint]
        if "position" not in signals and called and signals.keys() & {*COMMANDS}:
            out.nobodys.remove(called[0])
            signals["position"] = [replace(out.claims[called[0]], signal="position")]


def _join_names(out: Claimed) -> None:
    """Joints that are one by their names under one, and a name for the one that has none beside others."""
    out.groups = renamed(out.groups, _owners(out.groups))
    names = {}
    if len(out.groups) > 1 and "position" in out.groups.get("", {}) and ONLY_JOINT not in out.groups:
        names[""] = ONLY_JOINT
    out.renamed = {f"{joint}_{ONLY_JOINT}": joint for joint in OTHER if joint in out.groups}
    out.groups = renamed(out.groups, names | {joint: name for name, joint in out.renamed.items()})


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

    def rank(claim: Claim) -> tuple[object, ...]:
        words = claim.words
        supply = words & {"in", "input", "bus"} or is_a("supply", *words)
        return (
            signal == "position" and not (claim.unit in ("", "?", "tick", "%") or measures(claim.unit, "angle", "way")),
            not claim.sure, is_a("filtered", *words), claim.unit in ("tick", "%"),
            signal == "goal" and is_action(claim),
            signal == "goal" and bool(words & {"planned", "interpolated", "ipo"}),
            signal == "current" and bool(supply), signal == "current" and not words & {"q", "iq"},
            len(claim.column),
        )  # fmt: skip

    return sorted(claims, key=rank)


def is_action(claim: Claim) -> bool:
    """Whether a name says the action of a policy, and no goal."""
    actions = {"action", "actions"}
    return bool(claim.words & actions) and not is_a("commanded", *(claim.words - actions))


# --- lists of a bag that name no joints, beside joints that the format names: whose each of their places is ----------


PLACE = re.compile(r"(.+)\[(\d+)\]")
LIST_ORDER = (
    "whose are the places of {} and of the columns beside it? The list names no joints. The lines have them in the "
    "order of the positions: exchange columns where its controller has another order"
)


def lists_of(run: Recording) -> dict[str, list[str]]:
    """Columns of lists whose format names the joints of other columns, by the list's name, in order."""
    found: dict[str, dict[int, str]] = {}
    named = any(role.endswith(".position") for role in run.roles.values())
    for name in run.columns if named else ():
        match = PLACE.fullmatch(name)
        if match and name not in run.roles and said(name).signal in (*SIGNAL_UNITS, "load"):
            found.setdefault(match[1], {})[int(match[2])] = name
    return {stem: [own[k] for k in sorted(own)] for stem, own in found.items() if sorted(own) == list(range(len(own)))}


def put_lists(lists: dict[str, list[str]], out: Claimed, run: Recording) -> None:
    """Put lists of commands that have as many places as joints lack one to these joints, in their order, which is asked
    about; others are left out.

    Args:
        lists: columns by name.
        out: claims, to which these are added.
        run: the recording.
    """
    for columns in lists.values():
        signal = said(columns[0]).signal
        free = [joint for joint, own in out.groups.items() if own.get("position") and not own.get(signal)]
        if len(columns) == len(free) and signal in TOLD:
            for joint, column in zip(free, columns, strict=True):
                unit, ask = run.units.get(column, "") or said(column).unit, LIST_ORDER.format(quoted(columns[0]))
                out.groups[joint][signal] = [replace(said(column), ask=ask, unit=unit)]
            continue
        for column in columns:
            why = f"and nothing tells whose: write <joint>.{signal}: {quoted(column)} where you know it"
            out.aside[column] = f"{signal} of a list that names no joints, {why if free else 'which all have one'}"
