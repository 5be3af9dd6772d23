"""The catalogue: every physical cause that a gap of a joint can be named for.

A new cause is one function in the file of its family, and one test; one from outside is a plugin
(:mod:`sealegs.common.plugins`).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

from ...common import plugins
from ...common.errors import SealegsError, nearest
from ..replay.joint_model import JointModel
from ..replay.parameters import TIGHT, Parameter, Target, factor
from . import drive, friction, load, sensor, transmission
from .cause import ENTRIES, GROUND, ROBOT, Cause, impedance

FAMILIES = (friction, drive, transmission, load, sensor)
"""Importing a family enters its causes, in this order."""


def catalogue(nominal: JointModel, names: Sequence[str] | None = None) -> list[Cause]:
    """The causes that a joint can have; what nobody measured (:mod:`sealegs.gap.causes.unknown`) cannot be wrong.

    Args:
        nominal: the joint.
        names: of the causes to consider; default: all of them.

    Raises:
        SealegsError: as :func:`checked`.
    """
    unknown = {parameter.number for parameter in nominal.unknown}
    unknown_load = any(parameter.target is Target.LOAD for parameter in nominal.unknown)
    wanted = checked(names)
    every = [entry.cause(nominal) for entry in ENTRIES.values() if entry.name in wanted and entry.applies(nominal)]
    return [
        cause
        for cause in every
        if not (cause.error and any(variant[0].number in unknown for variant in cause.variants))
        and not (cause.needs.claimed_load and unknown_load)
    ]


def checked(names: Sequence[str] | None) -> Collection[str]:
    """Names of causes; all of the catalogue's where none are given.

    Raises:
        SealegsError: a name is of no cause, or a plugin cannot be loaded.
    """
    plugins.load("causes")
    known = [*ENTRIES, *GROUND, *ROBOT]
    for name in names or ():
        if name not in known:
            kin = [cause for cause in known if cause.startswith(f"{name}.")]
            hint = f"; there are {', '.join(kin)}" if kin else nearest(name, known)
            raise SealegsError(f"causes: the catalogue has no cause '{name}'{hint}.")
    return known if names is None else names


def adjustable(nominal: JointModel, width: float = TIGHT) -> list[Parameter]:
    """Numbers that the nominal model has and that nobody knows exactly, as factors within ``1 +- width``, and those
    that nobody measured, within their own bounds.
    """
    low, high = 1.0 / (1.0 + width), 1.0 + width
    unknown = {parameter.number for parameter in nominal.unknown}
    found = []
    for stage, keys in ADJUSTABLE.items():
        if stage == "ideal" and impedance(nominal):  # its host sends stiffness and damping
            keys = ("armature",)
        if nominal.chain.find(stage) is not None:
            found += [
                factor(path, *_tolerance(nominal, path, width), 0.05, DIFFERENCES.get(path, 0.4))
                for path in (f"{stage}.{key}" for key in keys)
                if nominal.value(path) > 0.0 and path not in unknown
            ]
    if nominal.by_torque or nominal.chain.find("ideal") is not None:
        # a log tells torque per mass alone: with scale or mass far open, neither they nor friction have a size
        low, high = 1.0 / (1.0 + TIGHT), 1.0 + TIGHT
        if (apart := 2.0 * TIGHT * nominal.load.own_lever) > 0.0:  # one body's mass too large, another's too small
            found.append(Parameter("load.centre_shift", "m", -apart, apart, 0.0, 0.2 * apart))
        if (more := 2.0 * TIGHT * nominal.load.tip_mass) > 0.0:
            less = max(-more, nominal.load.least_payload)
            found.append(Parameter("load.payload", "kg", less, more, 0.0, 0.2 * more))
    elif nominal.of_robot:
        # nor do they with a motor that is refitted too; masses of a file are not off because a chain is another motor's
        low, high = 1.0 / (1.0 + TIGHT), 1.0 + TIGHT
    if impedance(nominal):
        found.append(factor("ideal.strength", low, high, 0.05, 0.4))
    if nominal.by_torque:
        found.append(Parameter("scale.factor", "1", low, high, 1.0, 0.05, logarithmic=True))
        effort, believed = nominal.axis.effort or 1.0, nominal.value("offset.value")
        # where nothing holds it, the bias of an amplifier adds up to more than friction
        if nominal.load.pull_back * nominal.axis.reach < TIGHT * effort:
            bias = min(width, WIDEST_BIAS) * effort
            found.append(Parameter("offset.value", "N.m", believed - bias, believed + bias, believed, 0.2 * bias))
    found += [Parameter(f"load.{key}", "1", low, high, 1.0, 0.05, logarithmic=True) for key in nominal.load.tunable]
    return [*found, *nominal.unknown]


def _tolerance(nominal: JointModel, path: str, width: float) -> tuple[float, float]:
    """Ends of the factor on a number within ``1 +- width``; the delay of a robot's joint is known to half a turn of a
    servo's loop at best, or to half of it.
    """
    if path == "delay.seconds" and nominal.of_robot:
        turn = min(HALF_A_TURN / nominal.value(path), 0.5)
        if turn > width:
            return 1.0 - turn, 1.0 + turn
    return 1.0 / (1.0 + width), 1.0 + width


HALF_A_TURN = 5e-4  # [s] of a servo's loop at 1 kHz, within which a command waits for its turn: assumed
WIDEST_BIAS = 0.5  # of an amplifier, in parts of the largest command
ADJUSTABLE: dict[str, tuple[str, ...]] = {
    "delay": ("seconds",),
    "dc_motor": ("motor_constant", "resistance", "armature"),
    "regression": ("armature",),
    "ideal": ("stiffness", "damping", "armature"),
    "torque_command": ("armature",),
    "friction": ("coulomb", "viscous", "stribeck", "load"),
    "spring": ("damping",),
}
"""Numbers that data sheets and older fits give only roughly; gains, ticks and limits are set by people and known."""


DIFFERENCES = {"delay.seconds": 1.5}
"""Finite-difference steps in parts of the scale, where the response has steps of its own (a command is early or
late by a whole sample).
"""
