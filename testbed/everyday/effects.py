"""What an everyday machine hides: what the finder should name, how large it is drawn, and what it changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .machines import SERVO
from .physics import Servos


@dataclass(frozen=True)
class Hidden:
    """One effect.

    Attributes:
        cause: names that the catalogue has for it, the usual one first; none of a stranger.
        number: ends of the numbers that carry its size.
        sizes: least and largest.
        field: of the servos that it changes.
        change: the value of the field and the size to the value with the effect.
        shared: whether all joints have it.
        factor: whether its number is told as a factor on the nominal one, too.
    """

    cause: tuple[str, ...]
    number: tuple[str, ...]
    sizes: tuple[float, float]
    field: str
    change: Callable[[float, float], float]
    shared: bool = False
    factor: bool = False


def _add(value: float, size: float) -> float:
    return value + size


def _times(value: float, size: float) -> float:
    return value * size


def _is(value: float, size: float) -> float:
    del value
    return size


PAYLOAD = "payload"
"""More mass at the tip, as a factor on what is believed to be there; it is of the links, not of the servos."""
PAYLOAD_SIZES = (1.5, 3.0)

SHARED = {
    "latency": Hidden(("drive.delay",), ("delay.seconds",), (0.006, 0.02), "latency", _add, shared=True),
    "sag": Hidden(("drive.supply_sag",), ("supply.resistance",), (0.3, 0.9), "source", _is, shared=True),
}
"""Of the bus and of the supply; with these goes :data:`PAYLOAD`."""

EFFECTS = {
    "load_friction": Hidden(("friction.load_dependent",), ("friction.load",), (0.05, 0.2), "load", _is),
    "stribeck": Hidden(("friction.stribeck",), ("friction.stribeck",), (0.06, 0.2), "stribeck", _is),
    "viscous": Hidden(("friction.viscous",), ("friction.viscous",), (1.6, 3.0), "viscous", _times, factor=True),
    "coulomb": Hidden(("friction.coulomb",), ("friction.coulomb",), (1.8, 4.0), "coulomb", _times, factor=True),
    "play": Hidden(("transmission.backlash",), ("backlash.width",), (0.03, 0.09), "play", _is),
    "motor_constant": Hidden(
        ("drive.motor_constant",), ("dc_motor.motor_constant",), (0.75, 0.88), "motor_constant", _times, factor=True
    ),
    "resistance": Hidden(
        ("drive.resistance",), ("dc_motor.resistance",), (1.25, 1.7), "resistance", _times, factor=True
    ),
    "armature": Hidden(
        ("load.inertia",),
        ("dc_motor.armature", "load.extra_inertia", "load.rotor_inertia"),
        (1.4, 2.2),
        "armature",
        _times,
        factor=True,
    ),
    "thermal": Hidden(("drive.thermal",), ("thermal.loss",), (0.004, 0.01), "loss", _is),
    "gain": Hidden(("drive.gain",), ("position_p.gain",), (0.6, 0.85), "gain", _times, factor=True),
    "offset": Hidden(("drive.offset",), ("offset.value",), (0.015, 0.05), "goal_offset", _is),
    "stop": Hidden(("contact.blocked",), ("load.stop_angle",), (0.45, 0.75), "stop", _is),
}
"""Of single joints. The size of a stop is the share of the joint's upward motion that it leaves."""

STRANGERS = {
    "trip": Hidden((), (), (0.3, 0.5), "trip", _is),
    "play_in_loop": Hidden((), (), (0.03, 0.08), "play", _is),
    "cable": Hidden((), (), (0.3, 0.8), "cable", _is),
}
"""What the catalogue lacks: an overload that trips (threshold as a share of the stall torque), play in front of an
encoder that the loop is closed over, a cable that relaxes.
"""


def with_effect(servos: Servos, name: str, joint: int, size: float) -> Servos:
    """The servos with an effect at a joint; at all of them where it is shared.

    Args:
        servos: of the machine.
        name: of :data:`SHARED`, :data:`EFFECTS` or :data:`STRANGERS`.
        joint: number of the joint.
        size: of the effect, in the number's own unit.
    """
    hidden = (SHARED | EFFECTS | STRANGERS)[name]
    value = getattr(servos, hidden.field)
    if np.ndim(value) == 0:
        return servos._replace(**{hidden.field: hidden.change(float(value), size)})
    value = value.copy()
    value[joint] = hidden.change(float(value[joint]), size)
    servos = servos._replace(**{hidden.field: value})
    if name == "play_in_loop":
        side = servos.output_side.copy()
        side[joint] = 1.0
        servos = servos._replace(output_side=side)
    return servos


def true_number(servos: Servos, name: str, joint: int) -> tuple[float, ...]:
    """What the number of an effect is in a machine: as it is, and as a factor or a difference where it is told so."""
    hidden = (SHARED | EFFECTS | STRANGERS)[name]
    field = getattr(servos, hidden.field)
    value = float(field[joint] if np.ndim(field) else field)
    if not hidden.factor:
        return (value,)
    believed = SERVO[hidden.field]
    return value, value / believed, value - believed
