"""Gears, friction, springs and play between motor and link."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from ..compiled import compiled
from ..layout import S_LIMIT, S_ROW_ACCELERATION, S_ROW_INERTIA, S_STEP, S_TIME
from .base import ChainError, Quantity, Stage, parameter, register

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
    ripple: gear meshing, paper 000 equation (16)). Where another coordinate's load presses on the transmission, it
    stands in place of ``|m - e|``.

    What the limit does near rest is one of four: sticking is rigid; it is elastic (``bristle_stiffness``); bristles
    yield gradually and are stable at any stiffness (``lugre``: paper 001, equations (26) to (28)); or nothing sticks,
    and the dry friction grows in a line up to ``slip_speed`` (paper 001, equation (34)).
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
    load: float = parameter(
        0.0, "-", 0.0, 1e2, "dry friction per torque through the gearbox, or per load that presses on it"
    )
    load_quadratic: float = parameter(0.0, "1/(N.m)", 0.0, 1e3, "dry friction per torque squared")
    load_stribeck: float = parameter(0.0, "-", 0.0, 2.0, "load dependent friction at rest above that while moving")
    ripple: float = parameter(0.0, "N.m", 0.0, 1e3, "amplitude of friction over position")
    ripple_count: float = parameter(1.0, "1/turn", 0.0, 1e4, "periods per turn")
    ripple_phase: float = parameter(0.0, "rad", -10.0, 10.0, "phase of the ripple")
    bristle_stiffness: float = parameter(
        0.0, "N.m/rad", 0.0, 1e12, "of the contact before it slips (presliding); 0: sticking is rigid"
    )
    bristle_damping: float = parameter(0.0, "N.m.s/rad", 0.0, 1e6, "of LuGre bristles")
    lugre: float = parameter(0.0, "-", 0.0, 1.0, "1: bristles yield gradually; 0: they hold up to the limit")
    slip_speed: float = parameter(0.0, "rad/s", 0.0, 1e3, "at which dry friction is whole; 0: it is so at rest")

    def law_parameters(self, chain: Any) -> list[float]:
        if self.lugre > 0.5 and self.bristle_stiffness == 0.0:
            raise ChainError(f"{chain.label}: a LuGre 'friction' needs a bristle_stiffness.")
        if self.bristle_damping > 0.0 and self.lugre < 0.5:
            raise ChainError(
                f"{chain.label}: 'friction' has a bristle_damping, which only LuGre bristles have; add lugre: 1."
            )
        if self.slip_speed > 0.0 and self.bristle_stiffness > 0.0:
            raise ChainError(f"{chain.label}: 'friction' has bristles and a slip_speed, which exclude each other.")
        values = self.parameters()
        near_rest = [values.pop(key) for key in ("bristle_stiffness", "lugre", "bristle_damping", "slip_speed")]
        del values["viscous"]
        loss = 1.0 - (gear.efficiency if (gear := chain.find("gear")) else 1.0)
        return [*values.values(), loss, *near_rest]

    def memory_size(self) -> int:
        return 6 if self.lugre > 0.5 else 3


@compiled()
def friction_limit(p, i, q, w, motor, external):
    """Dry friction torque at most [N.m], for the direction in which the joint moves or is pushed."""
    return pressed_limit(p, i, q, w, motor, external, abs(motor - external))


@compiled()
def pressed_limit(p, i, q, w, motor, external, load):
    """:func:`friction_limit` under a load that is given."""
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


@compiled()
def lugre_row(p, i, s, m, time, w, first):
    """Make the engine's friction row LuGre bristles (paper 001, equations (26) to (28)).

    ``dz/dt = w - |w| z / g`` is solved exactly over a step ``h`` of constant ``|w|``, with the speed ``w + h a`` that
    the step ends with: ``z' = E z + h F (w + h a)``, ``E = exp(-x)``, ``F = (1 - E) / x``, ``x = |w| h / g``. The
    torque ``stiffness z' + damping (z' - z) / h`` is then linear in the acceleration ``a``, so the solver finds both
    together with contacts and all else, and no stiffness is too large for the step. The row's limit is ``g stiffness``.

    Memory: deflection at the step's start; what remains of it and its gain on the speed over the step; its bound; time.
    """
    h, limit = s[S_STEP], max(s[S_LIMIT], 1e-9)
    if h <= 0.0:
        return
    if first and time > s[m + 4] + 1e-12:
        s[m] = min(max(s[m + 1] + s[m + 2] * w, -s[m + 3]), s[m + 3])
        s[m + 4] = time
    bound = limit / p[i + 12]
    x = abs(w) * h / bound
    kept = math.exp(-x)
    gain = h * (-math.expm1(-x) / x if x > 1e-9 else 1.0)
    if first:
        s[m + 1], s[m + 2], s[m + 3] = kept * s[m], gain, bound
    whole = p[i + 12] + p[i + 14] / h
    s[S_ROW_INERTIA] = whole * gain * h
    s[S_ROW_ACCELERATION] = -(whole * (kept * s[m] + gain * w) - p[i + 14] * s[m] / h) / s[S_ROW_INERTIA]


@compiled()
def smooth_row(p, i, s, w):
    """Make the engine's friction row grow in a line up to ``slip_speed`` (paper 001, equation (34)).

    It takes the speed that the step ends with, so no slope is too steep for the step.
    """
    if s[S_STEP] > 0.0:
        s[S_ROW_INERTIA] = max(s[S_LIMIT], 1e-9) / p[i + 15] * s[S_STEP]
        s[S_ROW_ACCELERATION] = -w / s[S_STEP]


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
    its dampers do not. Where that matters, leave the damping at zero. The teeth of a play alone have their own: by
    default stiff ones that hardly bounce, else with a contact stiffness and a damping that say how much they bounce
    when they meet (as far as a time step resolves). Beside a spring or compliance these are not used.
    """

    name: ClassVar[str] = "backlash"
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.TORQUE,)

    width: float = parameter(None, "rad", 0.0, 1.0, "whole play of the link with the motor held")
    tooth_stiffness: float = parameter(0.0, "N.m/rad", 0.0, 1e6, "of teeth that meet; 0: stiff, hardly bouncing")
    tooth_damping: float = parameter(0.0, "N.m.s/rad", 0.0, 1e4, "of teeth that meet, beside a tooth_stiffness")
