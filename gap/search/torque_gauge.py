"""What a log of commands and motion leaves open: all torques and inertias of a joint may be larger by one factor.

Nothing in such a log is a torque that was measured. A torque-driven joint moves alike where drive, friction, mass and
inertia are all a few percent more, and so does one behind an ideal position loop, or behind a DC motor with a lower
resistance: torque per volt and back-EMF per speed go with its inverse alike. Only what is believed of drive and mass,
each within its tolerance, says how large they are; a profile to first order about one optimum misses most of it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from ...actuators.stages import stage_of
from ..replay.joint_model import JointModel
from ..replay.parameters import TIGHT, Parameter, address
from ..replay.problem import Problem

MASS = "load.mass_factor"
LOADS = (MASS, "load.payload", "load.extra_inertia", "load.rotor_inertia")
DRIVES = (("scale.factor",), ("ideal.stiffness", "ideal.strength"))
"""Numbers of drives whose product says what a command is worth."""
RESISTANCE = "dc_motor.resistance"
"""What its inverse says of, where no current is judged."""


def room(problem: Problem, parameters: Sequence[Parameter], values: Mapping[str, float]) -> tuple[float, float]:
    """The least and the largest factor on all torques at once that what is believed of drive and mass allows.

    Args:
        problem: of which the parameters are.
        parameters: that were fitted.
        values: of them, by path.

    Returns:
        1 and 1 where something else fixes the factor, as a mass that was weighed, or nothing holds it.
    """
    by_number = {p.number: p for p in parameters}
    joint = problem.joint
    if joint is None or joint.free_joint is None or MASS not in by_number:
        return 1.0, 1.0
    motor = by_number.get(RESISTANCE) if unmeasured_motor(joint, joint.models[0]) else None
    if motor is not None and motor.high > 1.0 + TIGHT:  # refitted or a cause: rotor and friction hold the factor
        motor = None
    if motor is None and not is_open(joint.models[0]):
        return 1.0, 1.0
    least, most = 0.0, math.inf
    for anchor in ((MASS,), *DRIVES):
        held = [by_number[number] for number in anchor if number in by_number]
        if held:
            least = max(least, math.prod(p.low / values[p.path] for p in held))
            most = min(most, math.prod(p.high / values[p.path] for p in held))
    if motor is not None:
        least, most = max(least, values[motor.path] / motor.high), min(most, values[motor.path] / motor.low)
    if least == 0.0 or most == math.inf:
        return 1.0, 1.0
    return min(least, 1.0), max(most, 1.0)


def is_open(model: JointModel) -> bool:
    """Whether a joint's log leaves the factor open: torques or an ideal loop drive it, and no spring is behind."""
    return not model.elastic and (model.by_torque or model.chain.find("ideal") is not None)


def unmeasured_motor(problem: Problem, model: JointModel) -> bool:
    """Whether a DC motor drives a joint whose current and torque are not judged, and no spring is behind."""
    judged = {channel for channel, weight in zip(problem.channels, problem.weight, strict=True) if weight > 0.0}
    return not model.elastic and model.chain.find("dc_motor") is not None and not judged & {"current", "torque"}


def is_torque(parameter: Parameter) -> bool:
    """Whether a number grows with all torques."""
    at = address(parameter.number)
    if parameter.number in (*LOADS, "scale.factor", "ideal.strength"):
        return True
    stage = stage_of(at.owner)
    unit = parameter.unit if stage is None or at.owner == "offset" else stage.unit_of(at.key)
    return unit.startswith(("N.m", "kg.m2"))
