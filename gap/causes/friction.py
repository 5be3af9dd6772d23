"""Friction of motor and gearbox."""

from __future__ import annotations

from dataclasses import replace

from ..replay.joint_model import JointModel
from ..replay.parameters import Parameter
from .cause import Cause, Limit, Needs, alone, entry, number, stall_torque

SHOWN = Needs(torque=True)  # along a prescribed motion, friction is in the torque alone
RIPPLE_COUNTS = (2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 14, 16, 18, 20, 24)
BRISTLE = "friction.bristle_stiffness"


@entry("friction.coulomb")
def coulomb(nominal: JointModel) -> Cause:
    top = stall_torque(nominal)
    dry = number(nominal, "friction.coulomb", "N.m", 1e-4 * top, top, 0.05 * top, 0.02 * top)
    return Cause(
        sentence="Dry friction differs from what the model has.",
        picture="friction_against_speed",
        variants=((dry,),),
        error=True,
        signature="reversal",
        needs=SHOWN,
    )


@entry("friction.viscous")
def viscous(nominal: JointModel) -> Cause:
    top = stall_torque(nominal)
    slope = number(nominal, "friction.viscous", "N.m.s/rad", 1e-5 * top, top, 0.02 * top, 0.02 * top)
    return Cause(
        sentence="Friction that grows with speed differs from what the model has.",
        picture="friction_against_speed",
        variants=((slope,),),
        error=True,
        signature="speed",
        needs=SHOWN,
    )


@entry("friction.drag")
def drag(nominal: JointModel) -> Cause:
    top = stall_torque(nominal)
    square = Parameter("friction.drag", "N.m.s2/rad2", 0.0, 0.3 * top, 0.002 * top, 0.001 * top)
    return Cause(
        sentence="Friction grows with the square of the speed, as in air or oil.",
        picture="friction_against_speed",
        variants=((square,),),
        signature="speed",
        needs=SHOWN,
        degenerates_to=Limit("friction.viscous", "all motion is about as fast"),
    )


@entry("friction.stribeck")
def stribeck(nominal: JointModel) -> Cause:
    top = stall_torque(nominal)
    extra = Parameter("friction.stribeck", "N.m", 0.0, top, 0.05 * top, 0.03 * top)
    speed = Parameter("friction.stribeck_velocity", "rad/s", 0.02, 3.0, 0.2, 0.5, logarithmic=True, shape=True)
    return Cause(
        sentence="Friction is larger at rest and at low speed than while moving.",
        picture="friction_against_speed",
        variants=((extra, speed),),
        signature="reversal",
        needs=SHOWN,
        degenerates_to=Limit("friction.coulomb", "all motion is slow", "friction.stribeck_velocity", by_speed=True),
    )


@entry("friction.asymmetric")
def asymmetric(nominal: JointModel) -> Cause:
    """A model without dry friction gets it with its asymmetry: alone, that would be friction in one direction only."""
    top = stall_torque(nominal)
    half = Parameter("friction.asymmetry", "N.m", -0.5 * top, 0.5 * top, 0.0, 0.02 * top)
    slope = Parameter("friction.viscous_asymmetry", "N.m.s/rad", -0.5 * top, 0.5 * top, 0.0, 0.02 * top)
    dry = () if nominal.value("friction.coulomb") > 0.0 else coulomb(nominal).variants[0]
    return Cause(
        sentence="Friction differs between the two directions, by a constant or with the speed.",
        picture="friction_against_speed",
        variants=((half, *dry), (slope, *dry)),
        needs=SHOWN,
        degenerates_to=Limit("drive.offset", "the joint holds a load and hardly moves"),
    )


@entry("friction.load_dependent")
def load_dependent(nominal: JointModel) -> Cause:
    top = stall_torque(nominal)
    share = Parameter("friction.load", "1", 0.0, 1.5, 0.08, 0.05)
    at_rest = Parameter("friction.load_stribeck", "1", 0.0, 1.5, 0.08, 0.05)
    speed = Parameter("friction.stribeck_velocity", "rad/s", 0.02, 5.0, 0.3, 0.5, logarithmic=True, shape=True)
    quadratic = Parameter("friction.load_quadratic", "1/(N.m)", 0.0, 3.0 / top, 0.1 / top, 0.1 / top)
    return Cause(
        sentence="Dry friction grows with the torque that passes through the gearbox.",
        picture="residual_against_load",
        variants=((share,), (quadratic, share), (share, at_rest, speed), (quadratic, at_rest, speed)),
        needs=SHOWN,
        degenerates_to=Limit("friction.coulomb", "the load hardly changes"),
    )


@entry("friction.presliding")
def presliding(nominal: JointModel) -> Cause:
    top = stall_torque(nominal)
    bristles = Parameter(BRISTLE, "N.m/rad", 0.05 * top, 50.0 * top, top, 0.3, logarithmic=True, rigid_at_zero=True)
    return Cause(
        sentence="A joint that sticks gives way like a spring before it slips.",
        picture="error_since_reversal",
        variants=alone(bristles, 0.4 * top, 2.0 * top, 8.0 * top),
        signature="reversal",
        needs=SHOWN,
        degenerates_to=Limit("friction.coulomb", "the joint never rests", BRISTLE),
    )


@entry("friction.position_dependent")
def position_dependent(nominal: JointModel) -> Cause:
    top = stall_torque(nominal)
    amplitude = Parameter("friction.ripple", "N.m", 0.0, 0.5 * top, 0.02 * top, 0.02 * top)
    phase = Parameter("friction.ripple_phase", "rad", -9.0, 9.0, 0.0, 0.5, phase=True)
    # The period is found by trying whole numbers of teeth; a descent would stick in the nearest of many minima.
    counts = [
        Parameter("friction.ripple_count", "1/turn", n - 0.5, n + 0.5, float(n), 0.3, shape=True) for n in RIPPLE_COUNTS
    ]
    return Cause(
        sentence="Friction changes with the angle, as teeth mesh.",
        picture="residual_against_position",
        variants=tuple((amplitude, count, phase) for count in counts),
        needs=replace(SHOWN, dry_friction=True),
        degenerates_to=Limit(
            "friction.coulomb", "the joint moves by much less than a period", "friction.ripple_count", by_range=True
        ),
    )
