"""Gears, springs and play between motor and link: the engine knows them natively."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from .base import ChainError, Quantity, Stage, parameter, register
from .parity import EVEN, ODD


@register
@dataclass(frozen=True, kw_only=True)
class Gear(Stage):
    """Reduction between the motor and the joint.

    The motor's constants are carried to the joint side (torque times ratio, inertia times its square). The loss is a
    dry friction of ``1 - efficiency`` times the transmitted torque, so a gear that is hard to drive backwards holds.
    """

    name: ClassVar[str] = "gear"
    after: ClassVar[str] = "torque_limit"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.TORQUE,)

    ratio: float = parameter(None, "-", 1e-3, 1e5, "motor turns per joint turn", parity=EVEN)
    efficiency: float = parameter(1.0, "-", 0.05, 1.0, "share of the transmitted power that arrives", parity=EVEN)

    def shapes_dry_friction(self) -> bool:
        return self.efficiency < 1.0


@register
@dataclass(frozen=True, kw_only=True)
class Spring(Stage):
    """Series spring between the motor (behind its gears) and the link, which become two bodies in the engine.

    With an ``inertia`` its deflection, link minus motor, is a coordinate of its own, as that of a pulley in a
    differential that winds a spring. Only then may it be ``unilateral``, and a ``compliance`` follow in series.
    """

    name: ClassVar[str] = "spring"
    after: ClassVar[str] = "friction"
    at_end: ClassVar[bool] = True
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.TORQUE,)

    stiffness: float = parameter(None, "N.m/rad", 1e-3, 1e6, "torque per deflection", parity=EVEN)
    damping: float = parameter(0.0, "N.m.s/rad", 0.0, 1e4, "torque per deflection speed", parity=EVEN)
    inertia: float = parameter(
        0.0, "kg.m2", 0.0, 1e3, "of what turns with the deflection; 0: nothing does", parity=EVEN
    )
    unilateral: float = parameter(
        0.0,
        "-",
        -1.0,
        1.0,
        "1: a hard stop keeps the link from falling behind the motor; -1: from getting ahead of it",
        parity=ODD,
    )

    @property
    def has_coordinate(self) -> bool:
        """Whether the deflection is a coordinate of its own."""
        return self.inertia > 0.0

    def check(self, chain: Any) -> None:
        if abs(self.unilateral) > 0.5 and not self.has_coordinate:
            raise ChainError(f"{chain.label}: a unilateral 'spring' needs an inertia that meets its stop.")


@register
@dataclass(frozen=True, kw_only=True)
class Compliance(Stage):
    """Gear train and shaft give way under load: a stiff spring between motor and link."""

    name: ClassVar[str] = "compliance"
    after: ClassVar[str] = "spring"
    at_end: ClassVar[bool] = True
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.TORQUE,)

    stiffness: float = parameter(None, "N.m/rad", 1e-3, 1e6, "torque per deflection", parity=EVEN, neutral=1e5)
    damping: float = parameter(0.0, "N.m.s/rad", 0.0, 1e4, "torque per deflection speed", parity=EVEN)


@register
@dataclass(frozen=True, kw_only=True)
class Backlash(Stage):
    """Play between motor and link.

    With the damping of a spring or compliance, that damping acts inside the play too: the engine's springs know a gap,
    its dampers do not. Where that matters, leave the damping at zero. The teeth of a play alone have stiffness
    and damping of their own, by default such that they hardly bounce. A contact stiffness and a damping say how much
    they bounce when they meet, as far as a time step resolves it. Beside a spring or compliance these are not used.
    """

    name: ClassVar[str] = "backlash"
    after: ClassVar[str] = "compliance"
    at_end: ClassVar[bool] = True
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.TORQUE,)

    width: float = parameter(
        None, "rad", 0.0, 1.0, "whole play of the link with the motor held", parity=EVEN, neutral=0.0
    )
    tooth_stiffness: float = parameter(
        0.0, "N.m/rad", 0.0, 1e6, "of teeth that meet; 0: stiff, hardly bouncing", parity=EVEN
    )
    tooth_damping: float = parameter(
        0.0, "N.m.s/rad", 0.0, 1e4, "of teeth that meet, beside a tooth_stiffness", parity=EVEN
    )
