"""What the link meets on its way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..checks.stops import Stop
from ..replay.joint_model import JointModel
from ..replay.parameters import Parameter
from .cause import Cause, Needs, Variant
from .registry import entry


@entry("contact.blocked")
def blocked(nominal: JointModel) -> Cause:
    variants: list[Variant] = []
    for start in (0.9, 0.5, 0.25):
        if nominal.load.tree:  # the middle of its motion need not be at zero
            axis = nominal.axis
            middle, half = 0.5 * (axis.low + axis.high), 0.5 * (axis.high - axis.low) / axis.reach
            away = 1.05 * start * half  # of what it reached, which is less than it would have
            upper = _end("load.stop_angle", middle, axis.reach, -0.25 * half, 2.0 * half, away)
            lower = _end("load.lower_stop", middle, axis.reach, -2.0 * half, 0.25 * half, -away)
        else:
            upper = Parameter("load.stop_angle", "rad", -0.5, 2.0, start, 0.03)
            lower = Parameter("load.lower_stop", "rad", -2.0, 0.5, -start, 0.03)
        variants += [(upper,), (lower,), (upper, lower)]
    return Cause(
        sentence="Something stops the link at an angle.",
        picture="response",
        against="position",
        variants=tuple(variants),
        needs=Needs(free_link=True),
        at_stops=True,
    )


def _end(number: str, middle: float, reach: float, low: float, high: float, start: float) -> Parameter:
    """A stop by its distance from the middle of the motion, in parts of the reach (which scales it back)."""
    shift = middle / reach
    return Parameter(number, "rad", shift + low, shift + high, shift + start, 0.03)


def with_stops(causes: Sequence[Cause], stops: Sequence[Stop], nominal: JointModel) -> list[Cause]:
    """Causes with the stops that were read off a log as the first form of what blocks a joint."""
    if not stops:
        return list(causes)
    reach = nominal.axis.reach if nominal.load.tree else 1.0
    at = {
        stop.side: Parameter(
            "load.stop_angle" if stop.side > 0 else "load.lower_stop", nominal.axis.unit("rad"),
            stop.angle - 0.5 * reach, stop.angle + 0.5 * reach, stop.angle, 0.03 * reach,
        )
        for stop in stops
    }  # fmt: skip
    read: list[Variant] = [tuple(at.values())]
    return [
        replace(cause, variants=(*read, *cause.variants), seen=True) if cause.at_stops else cause for cause in causes
    ]
