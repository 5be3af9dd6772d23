"""How the replays of a joint are compiled, and what they read beside the program of its chain."""

from __future__ import annotations

from typing import Any, NamedTuple

from ...actuators.compiled import Compiler
from ...actuators.compiled import pointer as _pointer
from ...envs.bench.stops import STOP_DAMPING, STOP_STIFFNESS

compiled = Compiler("the replay of a joint", "about a minute")
pointer: Any = _pointer  # a type checker sees two arguments, of which numba gives the first

__all__ = ["compiled", "pointer"]


class Constants(NamedTuple):
    """Numbers of one joint and run, in the order of the array that the compiled loops take."""

    inertia: float  # of the link [kg.m2]; of a joint of a robot, beyond that of its terms
    gravity: float  # torque at a quarter turn [N.m]
    motor_inertia: float  # armature [kg.m2]
    viscous: float  # [N.m.s/rad]
    coupled: float = 0.0  # 1: motor and link move apart
    stiffness: float = 0.0  # between them [N.m/rad]
    damping: float = 0.0  # [N.m.s/rad]
    half_play: float = 0.0  # [rad]
    host_offset: float = 0.0  # [rad]
    host_scale: float = 1.0
    stop: float = float("inf")  # angle beyond which something stops the link [rad]
    lower_stop: float = -float("inf")  # and below which [rad]
    delay: float = 0.0  # of commands [s]: where steps must end for a change of the goal to arrive at its time
    loss: float = 0.0  # share of the motor constant lost per kelvin [1/K]
    reference: float = 0.0  # temperature at which nothing is lost [degC]
    motor: float = 0.0  # where the motor constant stands in the program; 0: it does not change
    constant: float = 0.0  # motor constant at the reference [N.m/A]
    supply: float = 0.0  # where the volts of the supply stand in the program; 0: it has none, or a stiff one
    resistance: float = 0.0  # where its resistance stands in the program
    volts: float = 0.0  # of the supply while nothing is drawn [V]
    sag: float = 0.0  # its resistance [ohm]
    tree: float = 0.0  # 1: a hinge, 2: a slide of a robot whose other joints move as measured; its terms are given
    mass: float = 1.0  # factor on what hangs behind the joint
    payload: float = 0.0  # at its end [kg]
    spin: float = 0.0  # more inertia of the joint's own body about a hinge's axis [kg.m2]
    shift: float = 0.0  # of the centre of mass of the joint's own body, away from the joint [m]
    stop_stiffness: float = STOP_STIFFNESS  # [N.m/rad]
    stop_damping: float = STOP_DAMPING  # [N.m.s/rad]
    integral: float = 0.0  # where the integral of a position controller stands in the state; 0: it has none
    sampled: float = 0.0  # 1: that controller computes once a period
    duty_current: float = 0.0  # current that a whole duty drives at rest [A]
    duty_torque: float = 0.0  # and its torque at the joint [N.m]
    judged: float = 0.0  # number of the channel that is judged
    per_duty: float = 0.0  # what a whole duty makes of it; 0: no integral begins with what the log says of it
    at_drive: float = 0.0  # 1: a logged torque is the motor's, before armature and friction took theirs


K: Any = Constants(*range(len(Constants._fields)))
"""Where each stands in the array."""
