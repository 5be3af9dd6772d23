"""Gears, shaft and series spring."""

from __future__ import annotations

from ...actuators.mounting import coupling_element
from ..replay.joint_model import JointModel
from ..replay.parameters import Parameter, factor
from .cause import Cause, Limit, Needs, Variant, entry, has, lacks, stall_torque

APART = Needs(free_motor=True)  # from a motor that is moved as its link was, nothing between them shows


@entry("transmission.backlash")
def backlash(nominal: JointModel) -> Cause:
    small, large = (Parameter("backlash.width", "rad", 0.0, 0.5, start, 0.01) for start in (0.02, 0.08))
    variants: list[Variant] = [(small,), (large,)]
    if (top := stall_torque(nominal)) > 0.0 and coupling_element(nominal.chain) is None:
        # how teeth bounce shows in a play that is wide enough for them to leave each other
        stiffness = Parameter(
            "backlash.tooth_stiffness", "N.m/rad", 30.0 * top, 3e3 * top, 300.0 * top, 0.3, logarithmic=True, shape=True
        )
        damping = Parameter(
            "backlash.tooth_damping", "N.m.s/rad", 0.01 * top, 3.0 * top, 0.3 * top, 0.3, logarithmic=True, shape=True
        )
        variants.append((large, stiffness, damping))
    return Cause(
        sentence="There is play between motor and link.",
        signature="play",
        picture="hysteresis",
        variants=tuple(variants),
        needs=APART,
        degenerates_to=Limit("transmission.compliance", "the load never lets the teeth part"),
    )


@entry("transmission.compliance", lacks("spring"))
def compliance(nominal: JointModel) -> Cause:
    top = stall_torque(nominal)
    damping = Parameter("compliance.damping", "N.m.s/rad", 0.0, 0.5 * top, 0.005 * top, 0.01 * top, shape=True)
    springs = [
        Parameter("compliance.stiffness", "N.m/rad", 0.3 * top, 400.0 * top, start * top, 0.3, logarithmic=True)
        for start in (6.0, 25.0)
    ]
    return Cause(
        sentence="Gears or shaft give way under load.",
        picture="hysteresis",
        variants=tuple((stiffness, damping) for stiffness in springs),
        needs=APART,
    )


@entry("transmission.gear_ratio", has("dc_motor"))
def gear_ratio(nominal: JointModel) -> Cause:
    del nominal
    ratio = Parameter("gear_ratio.factor", "1", 0.2, 5.0, 1.0, 0.1, logarithmic=True)
    return Cause(
        sentence="The reduction differs: torque scales with it, reflected inertia with its square.",
        picture="response",
        against="motor torque",
        variants=((ratio,),),
        error=True,
        degenerates_to=Limit("drive.motor_constant", "the joint accelerates little"),
    )


@entry("spring.stiffness", has("spring"))
def spring_stiffness(nominal: JointModel) -> Cause:
    del nominal
    return Cause(
        sentence="The series spring is softer or stiffer than believed.",
        picture="hysteresis",
        variants=((factor("spring.stiffness", 0.05, 20.0),),),
        error=True,
    )
