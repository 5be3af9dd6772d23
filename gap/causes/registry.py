"""Where the families put their causes, and what their entries share."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from ...common.errors import SealegsError
from ..replay.joint_model import JointModel
from ..replay.parameters import Parameter, address, factor
from .cause import Cause, Variant

Applies = Callable[[JointModel], bool]
Make = Callable[[JointModel], Cause]


@dataclass(frozen=True)
class Entry:
    """One entry: the name of the cause, which joints can have it, and the cause of such a joint."""

    name: str
    applies: Applies
    make: Make

    def cause(self, nominal: JointModel) -> Cause:
        """The cause of a joint that can have it."""
        cause, axis = self.make(nominal), nominal.axis
        variants = tuple(tuple(axis.scaled(parameter) for parameter in variant) for variant in cause.variants)
        return replace(cause, name=self.name, variants=variants)


ENTRIES: dict[str, Entry] = {}
"""Causes of a joint by name, in the order of the catalogue."""
GROUND = ("contact.friction", "contact.stiffness", "contact.slope")
"""Names of the causes of the ground under a leg (:mod:`sealegs.gap.ground.causes`)."""
ROBOT = ("load.tilt",)
"""Names of the causes that only a whole robot has (:mod:`sealegs.gap.robot.search`)."""


def always(nominal: JointModel) -> bool:
    """Any joint can have it."""
    del nominal
    return True


def entry(name: str, applies: Applies = always) -> Callable[[Make], Make]:
    """Function decorator: add a cause to the catalogue.

    Args:
        name: of the cause, which the function leaves out.
        applies: whether a nominal joint can have it.

    Raises:
        SealegsError: another function has entered that name.
    """

    def add(make: Make) -> Make:
        other = ENTRIES[name].make if name in ENTRIES else make
        if (other.__module__, other.__qualname__) != (make.__module__, make.__qualname__):
            raise SealegsError(
                f"the catalogue has a cause '{name}' already, in {other.__module__}; give the one in {make.__module__} "
                "another name."
            )
        ENTRIES[name] = Entry(name, applies, make)
        return make

    return add


def has(*stages: str) -> Applies:
    """The chain has all of these stages."""
    return lambda nominal: all(nominal.chain.find(stage) is not None for stage in stages)


def has_any(*stages: str) -> Applies:
    """The chain has one of these stages."""
    return lambda nominal: any(nominal.chain.find(stage) is not None for stage in stages)


def lacks(*stages: str) -> Applies:
    """The chain has none of these stages."""
    return lambda nominal: not has_any(*stages)(nominal)


def impedance(nominal: JointModel) -> bool:
    """The drive is told a velocity and a torque beside its goal, and gains that its host knows."""
    return nominal.chain.impedance_drive() is not None


def follows_goals(nominal: JointModel) -> bool:
    """What the drive is told is a goal, which something may shape."""
    return not impedance(nominal) and lacks("torque_command")(nominal)


def follows_positions(nominal: JointModel) -> bool:
    """What the drive is told is a position, to which a profile may lead."""
    return follows_goals(nominal) and nominal.command == "goal"


def both(*conditions: Applies) -> Applies:
    """All of these conditions hold."""
    return lambda nominal: all(condition(nominal) for condition in conditions)


def number(nominal: JointModel, path: str, unit: str, low: float, high: float, start: float, scale: float) -> Parameter:
    """A parameter as a factor where the nominal model has it, else as a value."""
    known = nominal.chain.find(address(path).owner) is not None and nominal.value(path) > 0.0
    value = nominal.value(path) if known else 0.0
    if known and low < value < high:
        return factor(path, max(low / value, 0.02), min(high / value, 50.0), 0.15)
    return Parameter(path, unit, low, high, start, scale)


def alone(parameter: Parameter, *starts: float) -> tuple[Variant, ...]:
    """Ways in which a parameter acts alone, from each of several starts."""
    return tuple((replace(parameter, start=start),) for start in starts)


def stall_torque(nominal: JointModel) -> float:
    """Stall torque of the joint [N.m], or the largest that was commanded: the yardstick for starts and bounds."""
    chain = nominal.chain
    motor, supply = chain.find("dc_motor"), chain.find("supply")
    if motor is not None and supply is not None:
        return chain.gear_ratio() * motor.motor_constant * supply.volts / motor.resistance
    if (regression := chain.find("regression")) is not None:
        return abs(regression.duty_torque) * chain.gear_ratio()
    if (ideal := chain.find("ideal")) is not None:
        if impedance(nominal) and nominal.axis.effort:
            return nominal.axis.effort
        return min(ideal.torque_limit, ideal.stiffness * nominal.axis.reach * math.pi / 4)
    return nominal.axis.effort or 1.0
