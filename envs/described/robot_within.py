"""Whether numbers of a robot's YAML fit the range of its joints: goals, start, and limits of safety."""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ...common.errors import SealegsError
from ...configs.check import checked
from ..engine.numbers import RobotError
from .model_file import UNITS, ModelFile
from .robot_assumed import RADIANS, joint_stops
from .robot_described import FileJoint
from .robot_entries import JointEntry


def fits(name: str, pattern: str) -> bool:
    """Whether a pattern means a name; a name means itself, even where it has signs of patterns, such as ``j[0]``."""
    return name == pattern or fnmatch.fnmatchcase(name, pattern)


def fitting(names: Iterable[str], pattern: str) -> list[bool]:
    """Whether a pattern means each of the names."""
    return [fits(name, pattern) for name in names]


TURN = 2.0 * math.pi  # [rad] beyond a hinge's range is no goal
TIMES = 10.0  # of the farther end of a range: degrees for rad are 57 of it, mm for m are 1000; assumed
METRE = 1.0  # [m] a slide's limits may be as far where its range is less; assumed
POSITIONS = ("range_margin", "following_error")
"""Limits of safety that are positions; the others of joints are speeds."""
SHARE = 0.5  # of a range: no episode starts so far beyond its stops; assumed


def check_within(where: str, model: ModelFile, terms: Sequence[tuple[str, float]], entry: JointEntry) -> None:
    """Refuse a range of goals or a start that lies far outside what the stops of the model allow.

    Goals somewhat beyond a stop are allowed: a servo presses against it with them.

    Args:
        where: the joint stands in the YAML, for the message.
        model: as read.
        terms: joints and coefficients whose sum is driven.
        entry: what the YAML says of it.

    Raises:
        RobotError: one of the two does.
    """
    stops = joint_stops(model, terms)
    if stops is None or not stops[0] < stops[1]:
        return
    kind = model.joints[terms[-1][0]].kind
    far = TIMES * max(map(abs, stops))
    if kind == "hinge":
        far = min(far, TURN)
    width = stops[1] - stops[0]
    for key, given, most in (
        ("range", entry.range, far),
        ("start", None if entry.start is None else (entry.start,), min(far, SHARE * width)),
    ):
        if given is not None and max(stops[0] - min(given), max(given) - stops[1]) > most:
            raise RobotError(f"{where}.{key} is {_outside(given, stops, kind)} {model.path.name}{_hint(given, kind)}.")


def check_limits(path: Path, joints: Sequence[FileJoint], safety: Any) -> None:
    """Refuse limits of ``deploy: safety`` that are so far that they would never stop a joint.

    Args:
        path: of the YAML, for the message.
        joints: that are driven.
        safety: as it stands there; what is not a number is for deployment to refuse.

    Raises:
        RobotError: one is.
    """
    for key in POSITIONS if isinstance(safety, Mapping) else ():
        given = safety.get(key)
        by_pattern = given if isinstance(given, Mapping) else {"*": given}
        for joint in joints:
            names = (joint.name, joint.joint)
            patterns = (p for p in by_pattern if any(fits(name, str(p)) for name in names))
            try:
                limit = checked(key, by_pattern[next(patterns)], float)
            except (StopIteration, SealegsError):
                continue
            if reason := never_stops(limit, joint.range, joint.unit):
                raise RobotError(f"{path}: deploy.safety.{key} of joint {joint.name} {reason}")


def never_stops(limit: float, ends: tuple[float, float], unit: str, times: float = 1.0) -> str:
    """Why a limit of a joint's position would never stop it, as the end of a sentence; empty where it would.

    Args:
        limit: beyond its range, or behind its goal [rad or m].
        ends: of its range [rad or m].
        unit: of its position.
        times: the range, or a turn or a metre where that is more, from which it would not.
    """
    width = ends[1] - ends[0]
    if limit <= times * max(width, METRE if unit == "m" else TURN):
        return ""
    return (
        f"is {limit:.3g} {unit}, but the range of the joint is {width:.3g} {unit}: it would never stop it; give less, "
        "or leave it out."
    )


def _outside(given: Sequence[float], stops: Sequence[float], kind: str) -> str:
    unit = UNITS[kind][0]
    return f"{_to(given)} {unit}, far outside the range of its joint ({_to(stops)} {unit}) in"


def _hint(given: Sequence[float], kind: str) -> str:
    if kind == "slide":
        return "; positions of a slide are in metres"
    return (
        f"; angles in a robot's YAML are {RADIANS} ({_to(given)} degrees are {_to([math.radians(x) for x in given])})"
    )


def _to(ends: Sequence[float]) -> str:
    return " to ".join(f"{end:.4g}" for end in ends)
