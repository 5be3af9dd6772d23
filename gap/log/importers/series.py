"""Joints that are one by the names of all columns: numbered series of several messages, ``joint_A1`` and ``A1``, arms.

Names are only put together where no signal comes twice: two positions are two joints.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations

from .names import Said

NAMELESS = "joint"
NUMBERED = re.compile(r"(.*?)_?(\d+)")
MESSAGE = re.compile(r"[a-z]*(states?|status|feedback|cmds?|commands?|ctrl|control|msgs?)", re.IGNORECASE)
"""Words that say which message a column was in, as ``armstate`` and ``armcmd``."""
DRIVING = frozenset(["motor", "servo", "actuator", "drive"])
"""Words for what drives a joint."""
OF_A_MOTOR = frozenset(["torque", "torque_command", "current", "voltage", "temperature", "duty", "load", "enabled"])
"""Signals of a motor that are of its joint, too; a motor's angle and speed are before a gear."""
ARM = re.compile(r"(?:(.*)_)?(?:(leader|master)|(follower|puppet|slave))_?(.*)", re.IGNORECASE)
"""Arms of which one is led by hand and the other follows it."""

Signals = dict[str, set[str]]
"""Signals by joint."""


def joints_together(found: Mapping[str, Said]) -> dict[str, Said]:
    """Columns with the joints that they are of by all names of the table.

    Args:
        found: what each name says on its own.
    """
    out = _led(found)
    for rename in (_messages, _motors, _without_joint):
        names = rename(_signals(out))
        out = {name: replace(spoken, joint=names.get(spoken.joint, spoken.joint)) for name, spoken in out.items()}
    return out


def _signals(found: Mapping[str, Said]) -> Signals:
    out: Signals = {}
    for spoken in found.values():
        if spoken.joint and spoken.signal:
            out.setdefault(spoken.joint, set()).add(spoken.signal)
    return out


def _series(signals: Signals) -> dict[str, dict[int, str]]:
    """Joints with a number at their end, by their stem and number; of a joint alone there is no series."""
    out: dict[str, dict[int, str]] = {}
    for joint in signals:
        if match := NUMBERED.fullmatch(joint):
            out.setdefault(match[1], {})[int(match[2])] = joint
    return {stem: own for stem, own in out.items() if len(own) > 1}


def _free(signals: Signals, *series: Mapping[int, str]) -> bool:
    """Whether series have the same numbers, and no signal of a joint comes twice."""
    return all(
        first.keys() == second.keys() and not any(signals[first[k]] & signals[second[k]] for k in first)
        for first, second in combinations(series, 2)
    )


def _messages(signals: Signals) -> dict[str, str]:
    """``armstate_motor0`` and ``armcmd_motor0`` are the state and the command of one joint."""
    alike: dict[str, list[dict[int, str]]] = {}
    for stem, own in _series(signals).items():
        words = [word for word in stem.split("_") if not MESSAGE.fullmatch(word)]
        alike.setdefault("_".join(words) or NAMELESS, []).append(own)
    return {
        joint: f"{stem}{k}"
        for stem, several in alike.items()
        if len(several) > 1 and _free(signals, *several)
        for own in several
        for k, joint in own.items()
    }


def _motors(signals: Signals) -> dict[str, str]:
    """``motor0`` drives ``joint0``, where there are as many motors as joints."""
    series = _series(signals)
    joints = series.get(NAMELESS, {})
    names: dict[str, str] = {}
    for stem, own in series.items():
        drives = stem.lower() in DRIVING and all(signals[joint] <= OF_A_MOTOR for joint in own.values())
        if drives and any("position" in signals[joint] for joint in joints.values()) and _free(signals, own, joints):
            names |= {joint: joints[k] for k, joint in own.items()}
    return names


def _without_joint(signals: Signals) -> dict[str, str]:
    """``Joint_A1`` of ``JointPosition_A1`` is ``A1``, where another column calls it so; so is ``Axis_A1``."""
    names = {
        joint: rest
        for joint in signals
        if (before := joint.partition("_")[0]).lower() in (NAMELESS, "axis") and before != joint
        and (rest := joint[len(before) + 1 :]) in signals
    }  # fmt: skip
    return names if not any(signals[joint] & signals[rest] for joint, rest in names.items()) else {}


def _led(found: Mapping[str, Said]) -> dict[str, Said]:
    """Columns in which an arm that is led by hand is the goal of the one that follows it."""
    arms = {name: match for name, spoken in found.items() if (match := ARM.fullmatch(spoken.joint))}
    joints = {name: beside(match) for name, match in arms.items()}
    leads = {joints[name] for name, match in arms.items() if match[2]}
    follows = {joints[name] for name, match in arms.items() if match[3]}
    told = {joints[name] for name, match in arms.items() if match[3] and found[name].signal in ("goal", "position")}
    goals = {joints[name] for name, match in arms.items() if match[3] and found[name].signal == "goal"}
    out = dict(found)
    for name, match in arms.items():
        spoken, joint = found[name], joints[name]
        if joint not in leads & follows:
            continue
        signal = spoken.signal
        if match[2]:
            leading = signal in ("", "position") and joint not in goals
            signal = "goal" if leading else f"{signal or 'position'} of the arm that leads".replace("_", " ")
        elif not signal and joint not in told:
            signal = "position"
        out[name] = replace(spoken, signal=signal, joint=joint, how=spoken.how or match[2] or match[3])
    return out


def beside(match: re.Match[str]) -> str:
    """The joint's name without the arm's."""
    rest = "_".join(part for part in (match[1], match[4]) if part)
    return f"{NAMELESS}{rest}" if rest.isdigit() else rest
