"""What a hidden arm can hide: what each effect changes, and how much is clear or moderate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .arm_physics import Links, Servos

MESHING_COUNT = 20.5  # periods per turn: the second sine of paper 000, table IV, behind its skew-axis gear


@dataclass(frozen=True)
class Hidden:
    """One effect: what it changes.

    Attributes:
        cause: name that the catalogue has for it; empty for a stranger.
        number: of the cause that carries its size.
        sizes: clear, moderate.
        apply: links, servos, joint and size to the arm with the effect.
        everywhere: whether all joints have it.
        field: of the servos that has the number as it is with the effect; its size where there is none.
    """

    cause: str
    number: str
    sizes: tuple[float, float]
    apply: Callable[[Links, Servos, int, float], tuple[Links, Servos]]
    everywhere: bool = False
    field: str = ""

    def true_number(self, servos: Servos, joint: int, size: float) -> float:
        """What :attr:`number` is in the arm with the effect."""
        if not self.field:
            return size
        value = getattr(servos, self.field)
        return float(value[joint] if np.ndim(value) else value)


def _turns(
    cause: str, number: str, sizes: tuple[float, float], field: str, change: Callable[[float, float], float]
) -> Hidden:
    """An effect that changes one number of the servo of its joint."""
    return Hidden(cause, number, sizes, _servo(field, change), field=field)


def _servo(field: str, change: Callable[[float, float], float]) -> Callable[..., tuple[Links, Servos]]:
    def apply(links: Links, servos: Servos, joint: int, size: float) -> tuple[Links, Servos]:
        values = getattr(servos, field).copy()
        values[joint] = change(values[joint], size)
        return links, servos._replace(**{field: values})

    return apply


def _delay(links: Links, servos: Servos, joint: int, size: float) -> tuple[Links, Servos]:
    return links, servos._replace(delay=servos.delay + size)


def _softer(links: Links, servos: Servos, joint: int, size: float) -> tuple[Links, Servos]:
    return links, servos._replace(soft=size, play_joint=joint)


def _meshing(links: Links, servos: Servos, joint: int, size: float) -> tuple[Links, Servos]:
    """Dry friction that rises and falls as teeth mesh."""
    ripple, count, phase = servos.ripple.copy(), servos.ripple_count.copy(), servos.ripple_phase.copy()
    ripple[joint], count[joint], phase[joint] = size, MESHING_COUNT, 0.7
    return links, servos._replace(ripple=ripple, ripple_count=count, ripple_phase=phase)


def _play(links: Links, servos: Servos, joint: int, size: float) -> tuple[Links, Servos]:
    return links, servos._replace(play=size, play_joint=joint)


def _payload(links: Links, servos: Servos, joint: int, size: float) -> tuple[Links, Servos]:
    """A point mass at the end of the arm, where the model file has its site."""
    last = len(links.mass) - 1
    mass, centre, inertia = links.mass.copy(), links.centre.copy(), links.inertia.copy()
    point = end_of(centre[last])
    total = mass[last] + size
    middle = (mass[last] * centre[last] + size * point) / total
    for part, at in ((mass[last], centre[last]), (size, point)):
        away = at - middle
        inertia[last] += part * (away @ away * np.eye(3) - np.outer(away, away))
    mass[last], centre[last] = total, middle
    return links._replace(mass=mass, centre=centre, inertia=inertia), servos


def _table(links: Links, servos: Servos, joint: int, size: float) -> tuple[Links, Servos]:
    """A table at this height [m], which the end of the arm cannot pass."""
    return links._replace(table=size), servos


def end_of(centre: np.ndarray) -> np.ndarray:
    """Where the last link ends: twice as far as its centre of mass (3,) [m]."""
    return 2.0 * centre


EFFECTS: dict[str, Hidden] = {
    "friction": _turns("friction.coulomb", "friction.coulomb", (0.12, 0.05), "coulomb", lambda v, s: v + s),
    "viscous": _turns("friction.viscous", "friction.viscous", (0.06, 0.025), "viscous", lambda v, s: v + s),
    "load_friction": _turns("friction.load_dependent", "friction.load", (0.25, 0.12), "load", lambda v, s: s),
    "delay": Hidden("drive.delay", "delay.seconds", (0.015, 0.006), _delay, everywhere=True, field="delay"),
    "play": Hidden("transmission.backlash", "backlash.width", (0.12, 0.06), _play),
    "payload": Hidden("load.mass", "load.payload", (0.15, 0.08), _payload, everywhere=True),
    "weak_motor": _turns(
        "drive.motor_constant", "dc_motor.motor_constant", (0.7, 0.85), "motor_constant", lambda v, s: v * s
    ),
    "stop": _turns("contact.blocked", "load.stop_angle", (0.4, 0.5), "upper_stop", lambda v, s: s),
    "encoder_scale": _turns("sensor.scale", "encoder.scale", (0.9, 0.95), "encoder_scale", lambda v, s: v * s),
}
FURTHER: dict[str, Hidden] = {
    "meshing": Hidden("friction.position_dependent", "friction.ripple", (0.5, 0.25), _meshing),
    "table": Hidden("", "", (0.0, 0.0), _table, everywhere=True),
    "softer": Hidden("transmission.compliance", "compliance.stiffness", (12.0, 20.0), _softer),
}
"""Effects of single machines, which the matrix of arms does not hide."""
STRANGERS: dict[str, Hidden] = {
    "cable": Hidden("", "", (0.6, 0.3), _servo("cable", lambda v, s: s)),
    "friction_drift": Hidden("", "", (0.01, 0.005), _servo("drift", lambda v, s: s)),
}
