"""What blocks a joint: a limit of the engine, as hard as a diagnosis found it."""

from __future__ import annotations

from ...actuators import Drivetrain
from ...actuators.mounting import spring_constraint


def set_stop(
    drivetrain: Drivetrain, joint: str, ends: tuple[float, float], inertia: float, hardness: tuple[float, float]
) -> None:
    """Block a hinge below and beyond two angles, in model and specification.

    Args:
        drivetrain: the compiled robot.
        joint: name of the hinge.
        ends: of what it can reach [rad].
        inertia: that the engine takes it to have [kg.m2]; it scales what is hard by it.
        hardness: stiffness [N.m/rad] and damping [N.m.s/rad].
    """
    model, limit = drivetrain.model, drivetrain.spec.joint(joint)
    number = model.joint(joint).id
    solref, solimp = spring_constraint(*hardness, 1.0 / inertia, model.opt.timestep)
    limit.limited, limit.solref_limit, limit.solimp_limit = True, solref, solimp
    model.jnt_limited[number] = True
    model.jnt_range[number] = ends
    model.jnt_solref[number], model.jnt_solimp[number] = solref, solimp
