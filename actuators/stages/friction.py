"""Friction of motor and gearbox at the joint."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from ..compiled import compiled
from ..layout import (
    P_LOAD_FACTOR,
    P_VISCOUS,
    S_LIMIT,
    S_PRESSED,
    S_ROW_ACCELERATION,
    S_ROW_INERTIA,
    S_STEP,
    S_TIME,
)
from .base import ChainError, Law, Quantity, Stage, parameter, register
from .parity import EVEN, ODD, Phase

REST_SPEED = 1e-3  # [rad/s] below this a joint counts as at rest and friction opposes the torque, not the motion


@register
@dataclass(frozen=True, kw_only=True)
class Friction(Stage):
    """Friction of motor and gearbox at the joint.

    Viscous friction is a torque; the rest is a limit on a friction torque that holds a joint at rest:

        limit = coulomb +- (asymmetry + viscous_asymmetry |w|) + load |m - e| + load_quadratic (m - e)^2
                + S (stribeck + load_stribeck |m - e|) + ripple cos(ripple_count q + ripple_phase) + drag w^2
        S = exp(-|w / stribeck_velocity|^stribeck_exponent)

    with the motor torque ``m`` and the external torque ``e`` on the gearbox: gravity, springs, contacts and what speeds
    cause, without what accelerations need (Duclusaud et al., ICRA 2025, M1 to M4;
    ripple: gear meshing, paper 000 equation (16)). Where another coordinate's load presses on the transmission, it
    stands in place of ``|m - e|``.

    A gearbox that is driven and one that is driven back lose differently (M5). With ``load_external``, ``load |m - e|``
    is ``|load m - (load + load_external) e|``; ``load_stribeck_external`` does likewise at rest. M6
    adds ``S`` times ``quadratic_external e^2`` while the motor lifts against the load (``m`` and ``e`` opposed,
    ``|m| > |e|``) and ``quadratic_motor m^2`` while the load drives it (``|m| < |e|``).

    What the limit does near rest is one of four. Sticking is rigid, or elastic (``bristle_stiffness``). With ``lugre``
    bristles yield gradually and are stable at any stiffness (paper 001, equations (26) to (28)). With ``slip_speed``
    nothing sticks, and the dry friction grows in a line up to that speed (paper 001, equation (34)).
    """

    name: ClassVar[str] = "friction"
    after: ClassVar[str] = "thermal"
    at_end: ClassVar[bool] = True
    takes: ClassVar[tuple[Quantity, ...]] = (Quantity.TORQUE,)
    derived: ClassVar[tuple[str, ...]] = ("loss",)  # of the gear, by its efficiency

    coulomb: float = parameter(0.0, "N.m", 0.0, 1e4, "dry friction while moving", parity=EVEN)
    viscous: float = parameter(0.0, "N.m.s/rad", 0.0, 1e4, "friction per speed", parity=EVEN, in_law=False)
    stribeck: float = parameter(0.0, "N.m", 0.0, 1e4, "dry friction at rest above that while moving", parity=EVEN)
    stribeck_velocity: float = parameter(0.1, "rad/s", 1e-4, 1e3, "speed at which it has fallen to 1/e", parity=EVEN)
    stribeck_exponent: float = parameter(1.0, "-", 0.2, 20.0, "how sharply it falls", parity=EVEN)
    asymmetry: float = parameter(
        0.0, "N.m", -1e3, 1e3, "dry friction more in positive than in negative direction, halved", parity=ODD
    )
    viscous_asymmetry: float = parameter(
        0.0,
        "N.m.s/rad",
        -1e4,
        1e4,
        "friction per speed more in positive than in negative direction, halved; dry friction gives what it takes away",
        parity=ODD,
    )
    load: float = parameter(
        0.0, "-", 0.0, 1e2, "dry friction per torque through the gearbox, or per load that presses on it", parity=EVEN
    )
    load_quadratic: float = parameter(0.0, "1/(N.m)", 0.0, 1e3, "dry friction per torque squared", parity=EVEN)
    load_stribeck: float = parameter(
        0.0, "-", 0.0, 2.0, "load dependent friction at rest above that while moving", parity=EVEN
    )
    ripple: float = parameter(0.0, "N.m", 0.0, 1e3, "amplitude of friction over position", parity=EVEN)
    ripple_count: float = parameter(1.0, "1/turn", 0.0, 1e4, "periods per turn", parity=EVEN)
    ripple_phase: float = parameter(0.0, "rad", -10.0, 10.0, "phase of the ripple", parity=Phase("ripple_count"))
    bristle_stiffness: float = parameter(
        0.0, "N.m/rad", 0.0, 1e12, "of the contact before it slips (presliding); 0: sticking is rigid", parity=EVEN
    )
    bristle_damping: float = parameter(0.0, "N.m.s/rad", 0.0, 1e6, "of LuGre bristles", parity=EVEN)
    lugre: float = parameter(
        0.0, "-", 0.0, 1.0, "1: bristles yield gradually; 0: they hold up to the limit", parity=EVEN
    )
    slip_speed: float = parameter(
        0.0, "rad/s", 0.0, 1e3, "at which dry friction is whole; 0: it is so at rest", parity=EVEN
    )
    drag: float = parameter(0.0, "N.m.s2/rad2", 0.0, 1e4, "friction per speed squared, of air or oil", parity=EVEN)
    load_external: float = parameter(
        0.0, "-", -1e2, 1e2, "dry friction per external torque beyond that per motor torque", parity=EVEN
    )
    load_stribeck_external: float = parameter(0.0, "-", -2.0, 2.0, "the same of what is more at rest", parity=EVEN)
    quadratic_motor: float = parameter(
        0.0, "1/(N.m)", 0.0, 1e3, "at rest, per motor torque squared while the load drives the motor back", parity=EVEN
    )
    quadratic_external: float = parameter(
        0.0, "1/(N.m)", 0.0, 1e3, "at rest, per external torque squared while the motor drives the load", parity=EVEN
    )

    def check(self, chain: Any) -> None:
        if self.lugre > 0.5 and self.bristle_stiffness == 0.0:
            raise ChainError(f"{chain.label}: a LuGre 'friction' needs a bristle_stiffness.")
        if self.bristle_damping > 0.0 and self.lugre < 0.5:
            raise ChainError(
                f"{chain.label}: 'friction' has a bristle_damping, which only LuGre bristles have; add lugre: 1."
            )
        if self.slip_speed > 0.0 and self.bristle_stiffness > 0.0:
            raise ChainError(f"{chain.label}: 'friction' has bristles and a slip_speed, which exclude each other.")

    def law_values(self, chain: Any) -> dict[str, float]:
        efficiency = gear.efficiency if (gear := chain.find("gear")) else 1.0
        return {**super().law_values(chain), "loss": 1.0 - efficiency}

    def header(self, memory: int) -> dict[int, float]:
        del memory
        return {P_VISCOUS: self.viscous}

    def shapes_dry_friction(self) -> bool:
        return any(getattr(self, key) != 0.0 for key in SHAPES)

    def memory_size(self) -> int:
        return 6 if self.lugre > 0.5 else 3


SHAPES = (
    "stribeck",
    "asymmetry",
    "viscous_asymmetry",
    "load",
    "load_quadratic",
    "load_stribeck",
    "ripple",
    "bristle_stiffness",
    "slip_speed",
    "drag",
    "load_external",
    "load_stribeck_external",
    "quadratic_motor",
    "quadratic_external",
)
"""Parameters that make dry friction more than a constant."""

FRICTION = Friction.offsets()


@compiled()
def friction_limit(p, i, q, w, motor, external):
    """Dry friction torque at most [N.m], for the direction in which the joint moves or is pushed."""
    load = abs(motor - external)
    moving = p[i + FRICTION.load] * load + p[i + FRICTION.load_quadratic] * load * load
    resting = p[i + FRICTION.load_stribeck] * load
    if p[i + FRICTION.load_external] != 0.0:
        one, other = p[i + FRICTION.load], p[i + FRICTION.load] + p[i + FRICTION.load_external]
        moving += abs(one * motor - other * external) - one * load
    if p[i + FRICTION.load_stribeck_external] != 0.0:
        one, other = (
            p[i + FRICTION.load_stribeck],
            p[i + FRICTION.load_stribeck] + p[i + FRICTION.load_stribeck_external],
        )
        resting = abs(one * motor - other * external)
    if motor * external < 0.0:
        if abs(motor) > abs(external):
            resting += p[i + FRICTION.quadratic_external] * external * external
        else:
            resting += p[i + FRICTION.quadratic_motor] * motor * motor
    return limit_under(p, i, q, w, motor, external, moving, resting=resting)


@compiled()
def pressed_limit(p, i, q, w, motor, external, load):
    """:func:`friction_limit` under a load that is given."""
    moving = p[i + FRICTION.load] * load + p[i + FRICTION.load_quadratic] * load * load
    return limit_under(p, i, q, w, motor, external, moving, resting=p[i + FRICTION.load_stribeck] * load)


@compiled()
def limit_under(p, i, q, w, motor, external, moving, resting):
    """:func:`friction_limit` of what the load adds while moving, and beyond that at rest [N.m]."""
    speed = abs(w)
    limit = p[i + FRICTION.coulomb] + moving
    limit += p[i + FRICTION.loss] * max(abs(motor), abs(external))
    extra = p[i + FRICTION.stribeck] + resting
    if extra > 0.0:
        x = speed / p[i + FRICTION.stribeck_velocity]
        exponent = p[i + FRICTION.stribeck_exponent]
        limit += extra * math.exp(-(x if exponent == 1.0 else x**exponent))
    more = p[i + FRICTION.asymmetry] + p[i + FRICTION.viscous_asymmetry] * speed
    if more != 0.0:
        push = w if speed > REST_SPEED else motor + external
        limit += more if push > 0.0 else -more
    if p[i + FRICTION.ripple] > 0.0:
        limit += p[i + FRICTION.ripple] * math.cos(p[i + FRICTION.ripple_count] * q + p[i + FRICTION.ripple_phase])
    return max(limit, 0.0) + p[i + FRICTION.drag] * w * w


@compiled()
def bristle_torque(p, i, s, m, time, w):
    """Friction torque of elastic sticking [N.m]: a spring that slips at the dry friction limit, which it replaces.

    Memory is [deflection, speed and limit at the latest evaluation]; the deflection is of the step's start.
    """
    s[m + 1], s[m + 2] = w, s[S_LIMIT]
    most = s[S_LIMIT] / p[i + FRICTION.bristle_stiffness]
    s[S_LIMIT] = 0.0
    return p[i + FRICTION.bristle_stiffness] * min(max(s[m] + w * (time - s[S_TIME]), -most), most)


@compiled()
def advance_bristle(p, i, s, m, time):
    """Carry the deflection of elastic sticking over the step that has passed; LuGre bristles advance in their row."""
    if p[i + FRICTION.bristle_stiffness] > 0.0 and p[i + FRICTION.lugre] == 0.0:
        most = s[m + 2] / p[i + FRICTION.bristle_stiffness]
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
    stiffness, damping = p[i + FRICTION.bristle_stiffness], p[i + FRICTION.bristle_damping]
    bound = limit / stiffness
    x = abs(w) * h / bound
    kept = math.exp(-x)
    gain = h * (-math.expm1(-x) / x if x > 1e-9 else 1.0)
    if first:
        s[m + 1], s[m + 2], s[m + 3] = kept * s[m], gain, bound
    whole = stiffness + damping / h
    s[S_ROW_INERTIA] = whole * gain * h
    s[S_ROW_ACCELERATION] = -(whole * (kept * s[m] + gain * w) - damping * s[m] / h) / s[S_ROW_INERTIA]


@compiled()
def smooth_row(p, i, s, w):
    """Make the engine's friction row grow in a line up to ``slip_speed`` (paper 001, equation (34)).

    It takes the speed that the step ends with, so no slope is too steep for the step.
    """
    if s[S_STEP] > 0.0:
        s[S_ROW_INERTIA] = max(s[S_LIMIT], 1e-9) / p[i + FRICTION.slip_speed] * s[S_STEP]
        s[S_ROW_ACCELERATION] = -w / s[S_STEP]


@compiled()
def dry_friction(p, i, s, m, time, value, q, w, external, first):
    """Leave the limit of dry friction in the state, or take from ``value`` what elastic sticking holds [N.m]."""
    s[S_ROW_INERTIA] = 0.0
    if p[P_LOAD_FACTOR] != 0.0:
        s[S_LIMIT] = pressed_limit(p, i, q, w, value, external, s[S_PRESSED])
    else:
        s[S_LIMIT] = friction_limit(p, i, q, w, value, external)
    if p[i + FRICTION.lugre] > 0.0:
        lugre_row(p, i, s, m, time, w, first)
    elif p[i + FRICTION.slip_speed] > 0.0:
        smooth_row(p, i, s, w)
    elif p[i + FRICTION.bristle_stiffness] > 0.0:
        value -= bristle_torque(p, i, s, m, time, w)
    return value


@compiled()
def undriven_friction(p, i, s, q, w, external):
    """Leave the limit of dry friction in the state where no motor torque presses on the gearbox."""
    s[S_LIMIT] = friction_limit(p, i, q, w, 0.0, external)
    return 0.0


Friction.law = Law(advance=advance_bristle, act=dry_friction, idle=undriven_friction)
