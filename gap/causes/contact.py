"""What the link meets on its way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..checks.stops import Stop
from ..replay.joint_model import JointModel
from ..replay.parameters import Parameter
from .cause import Cause, Needs, Variant
from .registry import entry

STOPS = {"load.stop_angle": 1.0, "load.lower_stop": -1.0}
"""Numbers of a joint's stops, and on which side of it they are."""


@entry("contact.blocked")
def blocked(nominal: JointModel) -> Cause:
    axis = nominal.axis  # which scales the ranges back to what it goes through
    middle, half = (0.5 * length / axis.reach for length in (axis.low + axis.high, axis.high - axis.low))
    variants: list[Variant] = []
    for start in (0.9, 0.5, 0.25):
        above, below = nominal.load.stop_ranges(middle, half, start)
        upper, lower = Parameter("load.stop_angle", "rad", *above), Parameter("load.lower_stop", "rad", *below)
        variants += [(upper,), (lower,), (upper, lower)]
    return Cause(
        sentence="Something stops the link at an angle.",
        picture="response",
        against="position",
        variants=tuple(variants),
        needs=Needs(free_link=True),
        at_stops=True,
    )


def with_stops(causes: Sequence[Cause], stops: Sequence[Stop], nominal: JointModel) -> list[Cause]:
    """Causes with the stops that were read off a log as the first form of what blocks a joint."""
    if not stops:
        return list(causes)
    reach = nominal.axis.reach
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
