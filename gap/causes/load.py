"""What hangs on the joint."""

from __future__ import annotations

from dataclasses import replace

from ..replay.joint_model import JointModel
from ..replay.parameters import Parameter, factor
from .cause import Cause, Limit, Needs
from .registry import entry

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
