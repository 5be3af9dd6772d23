"""Whether goals and start of a joint, as a robot's YAML has them, can be meant in the unit of its model's range."""

from __future__ import annotations

import math
from collections.abc import Sequence

from .model_file import UNITS, ModelFile
from .robot import RobotError
from .robot_assumed import RADIANS, joint_stops
from .robot_entries import JointEntry

TURN = 2.0 * math.pi  # [rad] beyond a hinge's range is no goal
TIMES = 10.0  # of the farther end of a range: degrees for rad are 57 of it, mm for m are 1000; assumed
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
