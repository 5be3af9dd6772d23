"""Gears, friction, springs and play between motor and link."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from actuators.compiled import compiled
from actuators.layout import S_LIMIT, S_TIME
from actuators.stages.base import ChainError, Quantity, Stage, parameter, register

REST_SPEED = 1e-3  # [rad/s] below this a joint counts as at rest and friction opposes the torque, not the motion


@register
@dataclass(frozen=True, kw_only=True)
class Gear(Stage):
    """Reduction between the motor and the joint.

    The motor's constants are carried to the joint side (torque times ratio, inertia times its square); the loss is a
    dry friction of ``1 - efficiency`` times the transmitted torque, so that a gear that is hard to drive backwards
    really holds.
    """

    name: ClassVar[str] = "gear"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.TORQUE,)

    ratio: float = parameter(None, "-", 1e-3, 1e5, "motor turns per joint turn")
    efficiency: float = parameter(1.0, "-", 0.05, 1.0, "share of the transmitted power that arrives")


@register
@dataclass(frozen=True, kw_only=True)
class Friction(Stage):
    """Friction of motor and gearbox at the joint.

    Viscous friction is a torque; the rest is a limit on a dry friction torque that holds a joint at rest:

        limit = coulomb +- asymmetry + load |m - e| + load_quadratic (m - e)^2
                + S (stribeck + load_stribeck |m - e|) + ripple cos(ripple_count q + ripple_phase)
        S = exp(-|w / stribeck_velocity|^stribeck_exponent)

    with the motor torque ``m`` and the external torque ``e`` on the gearbox (Duclusaud et al., ICRA 2025, M1 to M6;
    ripple: gear meshing, seed 000 equation (16)).
    """

    name: ClassVar[str] = "friction"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.TORQUE,)
    opcode: ClassVar[int] = 41

    coulomb: float = parameter(0.0, "N.m", 0.0, 1e4, "dry friction while moving")
    viscous: float = parameter(0.0, "N.m.s/rad", 0.0, 1e4, "friction per speed")
    stribeck: float = parameter(0.0, "N.m", 0.0, 1e4, "dry friction at rest above that while moving")
    stribeck_velocity: float = parameter(0.1, "rad/s", 1e-4, 1e3, "speed at which it has fallen to 1/e")
    stribeck_exponent: float = parameter(1.0, "-", 0.2, 5.0, "how sharply it falls")
    asymmetry: float = parameter(
        0.0, "N.m", -1e3, 1e3, "dry friction more in positive than in negative direction, halved"
    )
    load: float = parameter(0.0, "-", 0.0, 2.0, "dry friction per torque through the gearbox")
    load_quadratic: float = parameter(0.0, "1/(N.m)", 0.0, 1e3, "dry friction per torque squared")
    load_stribeck: float = parameter(0.0, "-", 0.0, 2.0, "load dependent friction at rest above that while moving")
    ripple: float = parameter(0.0, "N.m", 0.0, 1e3, "amplitude of friction over position")
    ripple_count: float = parameter(1.0, "1/turn", 0.0, 1e4, "periods per turn")
    ripple_phase: float = parameter(0.0, "rad", -10.0, 10.0, "phase of the ripple")
    bristle_stiffness: float = parameter(
        0.0, "N.m/rad", 0.0, 1e6, "of the contact before it slips (presliding); 0: sticking is rigid"
    )

    def law_parameters(self, chain: Any) -> list[float]:
        values = self.parameters()
        del values["viscous"], values["bristle_stiffness"]
        loss = 1.0 - (gear.efficiency if (gear := chain.find("gear")) else 1.0)
        return [*values.values(), loss, self.bristle_stiffness]

    def memory_size(self) -> int:
        return 3


@compiled()
def friction_limit(p, i, q, w, motor, external):
    """Dry friction torque at most [N.m], for the direction in which the joint moves or is pushed."""
    load = abs(motor - external)
    speed = abs(w)
    limit = p[i] + p[i + 5] * load + p[i + 6] * load * load + p[i + 11] * max(abs(motor), abs(external))
    extra = p[i + 1] + p[i + 7] * load
    if extra > 0.0:
        x = speed / p[i + 2]
        limit += extra * math.exp(-(x if p[i + 3] == 1.0 else x ** p[i + 3]))
    if p[i + 4] != 0.0:
        push = w if speed > REST_SPEED else motor + external
        limit += p[i + 4] if push > 0.0 else -p[i + 4]
    if p[i + 8] > 0.0:
        limit += p[i + 8] * math.cos(p[i + 9] * q + p[i + 10])
    return max(limit, 0.0)


@compiled()
def bristle_torque(p, i, s, m, time, w):
    """Friction torque of elastic sticking [N.m]: a spring that slips at the dry friction limit, which it replaces.

    Memory is [deflection, speed and limit at the latest evaluation]; the deflection is of the step's start.
    """
    s[m + 1], s[m + 2] = w, s[S_LIMIT]
    most = s[S_LIMIT] / p[i + 12]
    s[S_LIMIT] = 0.0
    return p[i + 12] * min(max(s[m] + w * (time - s[S_TIME]), -most), most)


@compiled()
def advance_bristle(p, i, s, m, time):
    """Carry the deflection over the step that has passed."""
    most = s[m + 2] / p[i + 12]
    s[m] = min(max(s[m] + s[m + 1] * (time - s[S_TIME]), -most), most)


@register
@dataclass(frozen=True, kw_only=True)
class Spring(Stage):
    """Series spring between the motor (behind its gears) and the link, which become two bodies in the engine.

    With an ``inertia`` its deflection, link minus motor, is a coordinate of its own, as that of a pulley in a
    differential that winds a spring; only then may it be ``unilateral``, and a ``compliance`` follow in series.
    """

    name: ClassVar[str] = "spring"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.TORQUE,)

    stiffness: float = parameter(None, "N.m/rad", 1e-3, 1e6, "torque per deflection")
    damping: float = parameter(0.0, "N.m.s/rad", 0.0, 1e4, "torque per deflection speed")
    inertia: float = parameter(0.0, "kg.m2", 0.0, 1e3, "of what turns with the deflection; 0: nothing does")
    unilateral: float = parameter(0.0, "-", 0.0, 1.0, "1: a hard stop keeps the link from falling behind the motor")

    @property
    def has_coordinate(self) -> bool:
        """Whether the deflection is a coordinate of its own."""
        return self.inertia > 0.0

    def law_parameters(self, chain: Any) -> list[float]:
        if self.unilateral > 0.5 and not self.has_coordinate:
            raise ChainError(f"{chain.label}: a unilateral 'spring' needs an inertia that meets its stop.")
        return super().law_parameters(chain)


@register
@dataclass(frozen=True, kw_only=True)
class Compliance(Stage):
    """Gear train and shaft give way under load: a stiff spring between motor and link."""

    name: ClassVar[str] = "compliance"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.TORQUE,)

    stiffness: float = parameter(None, "N.m/rad", 1e-3, 1e6, "torque per deflection")
    damping: float = parameter(0.0, "N.m.s/rad", 0.0, 1e4, "torque per deflection speed")


@register
@dataclass(frozen=True, kw_only=True)
class Backlash(Stage):
    """Play between motor and link.

    With the damping of a spring or compliance, that damping acts inside the play too: the engine's springs know a gap,
    its dampers do not. Where that matters, leave the damping at zero; the teeth of a play alone have their own.
    """

    name: ClassVar[str] = "backlash"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.TORQUE,)

    width: float = parameter(None, "rad", 0.0, 1.0, "whole play of the link with the motor held")
