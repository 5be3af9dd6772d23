"""What hangs on the joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ..checks.stops import Stop
from ..replay.joint_model import JointModel
from ..replay.parameters import Parameter, absolute, factor
from ..replay.problem import Nominal
from .cause import Cause, Limit, Needs, Variant, entry

CLAIMED = Needs(free_link=True, claimed_load=True)
MASSES = {
    "mass_factor": Parameter("load.mass_factor", "1", 0.2, 6.0, 1.0, 0.1, logarithmic=True),
    "payload": Parameter("load.payload", "kg", 0.0, 20.0, 0.0, 0.05),  # and below, as far as its body allows
}
"""Numbers of a load that a wrong mass may be, by key."""


@entry("load.mass")
def mass(nominal: JointModel) -> Cause:
    numbers = MASSES | {"payload": replace(MASSES["payload"], low=nominal.load.least_payload)}
    return Cause(
        sentence="The load is lighter or heavier than believed.",
        picture="residual_against_position",
        variants=tuple((numbers[key],) for key in nominal.load.mass_keys),
        error=True,
        needs=CLAIMED,
        degenerates_to=Limit("load.centre_of_mass", "one load hangs on one arm and moves slowly"),
    )


@entry("load.inertia")
def inertia(nominal: JointModel) -> Cause:
    ranges, rotor = nominal.load.inertia_ranges(nominal.chain.armature()), nominal.chain.rotor()
    return Cause(
        sentence="The load, or a rotor that turns with it, has another inertia than the model says.",
        picture="response",
        against="acceleration",
        variants=tuple((Parameter(f"load.{key}", "kg.m2", *ends),) for key, ends in ranges.items()),
        at_motor=(factor(rotor, 0.1, 10.0),) if rotor else None,
        error=True,
        needs=CLAIMED,
    )


@entry("load.centre_of_mass")
def centre_of_mass(nominal: JointModel) -> Cause:
    del nominal
    shift = Parameter("load.centre_shift", "m", -0.08, 0.3, 0.0, 0.005)
    return Cause(
        sentence="The load's centre of mass sits at another distance.",
        picture="residual_against_position",
        variants=((shift,),),
        error=True,
        needs=CLAIMED,
        degenerates_to=Limit("load.mass", "one load hangs on one arm and moves slowly"),
    )


# --- what the link meets on its way ----------------------------------------------------------------------------------

STOPS = {"load.stop_angle": 1.0, "load.lower_stop": -1.0}
"""Numbers of a joint's stops, and on which side of it they are."""
STOP_STIFFNESS_RANGE = (0.04, 20.0)  # times the usual stiffness, between which that of a stop is sought


def _stiffness(nominal: JointModel) -> Variant:
    """How hard what blocks a hinge is: a wall whose stiffness is wrong looks like a compliance of the joint."""
    if nominal.axis.slide:
        return ()
    number, usual = "load.stop_stiffness", nominal.value("load.stop_stiffness")
    low, high = (share * usual for share in STOP_STIFFNESS_RANGE)
    hard = Parameter(number, "N.m/rad", low, high, usual, 0.3, logarithmic=True, shape=True)
    return (hard,)


@entry("contact.blocked")
def blocked(nominal: JointModel) -> Cause:
    axis = nominal.axis  # which scales the ranges back to what it goes through
    middle, half = (0.5 * length / axis.reach for length in (axis.low + axis.high, axis.high - axis.low))
    variants: list[Variant] = []
    hard = _stiffness(nominal)
    for start in (0.9, 0.5, 0.25):
        above, below = nominal.load.stop_ranges(middle, half, start)
        upper, lower = Parameter("load.stop_angle", "rad", *above), Parameter("load.lower_stop", "rad", *below)
        variants += [(upper, *hard), (lower, *hard), (upper, lower, *hard)]
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
    read: list[Variant] = [(*at.values(), *_stiffness(nominal))]
    return [
        replace(cause, variants=(*read, *cause.variants), seen=True) if cause.at_stops else cause for cause in causes
    ]


def as_logged(angle: float, fitted: Mapping[str, float], nominal: Nominal) -> float:
    """An angle of the link as the log reads it, with offset and scale of encoder and host as they were fitted.

    Args:
        angle: of the link [rad].
        fitted: numbers of the fit, by path.
        nominal: the joint as believed.
    """
    found = absolute(fitted, nominal)

    def number(path: str) -> float:
        return found[path] if path in found else nominal.value(path)

    read = number("encoder.scale") * angle + number("encoder.offset")
    return float(number("host.scale") * read + number("host.offset"))
