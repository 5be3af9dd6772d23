"""The runs behind the rows: the robot stands without power, and walks with other frictions, speeds and numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import count, takewhile
from typing import Any

import numpy as np

from ...envs.hexapod.gait import SPEED, Tripod
from ...envs.hexapod.parameters import LEGS, NUMBERS
from ...envs.hexapod.robot import FRICTIONS, HORIZONTAL, KINDS, VERTICAL, coordinate
from ..published import Otherwise
from . import friction_bench, leg_model
from .measures import STRIBECK, drawing, heaviest, motors
from .paper import (
    BAND,
    BREAKAWAY_AT_REST,
    BREAKAWAY_WALKING,
    WALKING,
    Standing,
    Walk,
    penetration_on,
    stand_unpowered,
    walk,
)

UNPOWERED = ("none", "dry/viscous", "LuGre")  # Fig. 8
SPEEDS = (0.01, 0.03)  # [m/s] of Fig. 12, beside the gait's own; the printed ones are not at hand
CYCLES = 5.0  # 7.1: five steps are performed, and one cycle is analysed
STEADY = 2.25  # cycles where many walks are compared; the last one is measured
COASTS = 0.25  # [s] in which the robot falls with open circuits
OPEN = 1e4  # [ohm]
SOFT = 1e7  # [N/m] of bristles, a hundredth
WEAK_LEGS = (1, 3)  # 5.4: their breakaway force is that under 5 kg while the robot walks
GIVES_WAY = 0.05  # share of a settled support with current from which on a joint does not hold
NO_LOAD, LOAD = "dry/viscous", "dry/viscous 2"
CHANGED: tuple[tuple[str, dict[str, float], dict[str, float]], ...] = (
    ("the chosen numbers, at 3 cm/s as all below", {}, {}),
    ("a stance 15 % lower", {}, {"stance_height": 0.85 * NUMBERS["stance_height"].value}),
    ("links with centres 20 % further out", {}, {"link_centre": 1.2 * NUMBERS["link_centre"].value}),
    ("floor friction times 0.6", {}, {"floor_friction": 0.6 * NUMBERS["floor_friction"].value}),
    ("gain of the vertical motors doubled", {"vertical.position_pi.gain": 2500.0}, {}),
)
"""Assumed numbers and other values of them: label, changes of the chains, changes of the robot."""
JOINT = friction_bench.planted({}, control=True)
SCREW, MOTOR, COULOMB = (JOINT.value(key) for key in ("gear.ratio", "dc_motor.motor_constant", "friction.coulomb"))
AT_REST_FORCE, WALKING_FORCE = (COULOMB + over for over in (BREAKAWAY_AT_REST, WALKING[BREAKAWAY_WALKING]))
FORCES = (AT_REST_FORCE, 610.0, WALKING_FORCE, 890.0, 1010.0, 1510.0)  # [N] breakaway of the vertical joints
STRONG = 1010.0  # [N] more than any load asks for
GEARS: tuple[tuple[str, dict[str, float]], ...] = (
    ("screw gears times 0.7", {f"{kind}.gear.ratio": 0.7 * SCREW for kind in (VERTICAL, HORIZONTAL)}),
    ("screw gears times 1.4", {f"{kind}.gear.ratio": 1.4 * SCREW for kind in (VERTICAL, HORIZONTAL)}),
    ("motors with 0.8 of their constant", {f"{kind}.dc_motor.motor_constant": 0.8 * MOTOR for kind in KINDS}),
)
"""Assumed gears and motors: label, changes of the chains."""
NO_INTEGRAL = {f"{kind}.position_pi.integral": 0.0 for kind in KINDS}
P_ALONE, P_SMOOTH, NO_BAND, WIDE, CHAIN_BAND, ABRUPT, STEADY_LIFT, FAST = (
    "P alone",
    "P alone, no friction",
    "no anti-windup",
    "ten times the Stribeck velocity",
    "the integral running out within 5e-6 m, as in the chains",
    "no double stance",
    "a foot that rises and sinks all the way",
    "3 cm/s",
)
OTHERWISE: dict[str, tuple[str, Tripod, dict[str, float]]] = {
    P_ALONE: ("LuGre", Tripod(), NO_INTEGRAL),
    P_SMOOTH: ("none", Tripod(), NO_INTEGRAL),
    NO_BAND: ("LuGre", Tripod(), {f"{kind}.position_pi.band": 0.0 for kind in KINDS}),
    WIDE: ("LuGre", Tripod(), {"vertical.friction.stribeck_velocity": 10.0 * STRIBECK}),
    CHAIN_BAND: ("LuGre", Tripod(), {BAND: JOINT.value("position_pi.band")}),
    ABRUPT: ("LuGre", Tripod(double_stance=1e-3), {}),
    STEADY_LIFT: ("LuGre", Tripod(lifting=0.5), {}),
    FAST: ("LuGre", Tripod(max(SPEEDS)), {}),
}
"""Walks with other controllers, friction or gaits: joint friction, gait, and changes of the chains."""
LUGRE, STICKS, REGULARISED = "LuGre", "dry friction that sticks", "dry/viscous of (34)"


def laws(force: float) -> dict[str, tuple[str, dict[str, float]]]:
    """Laws of friction for the vertical joint that all hold this force at most [N]: joint friction, and changes."""
    dry = {"vertical.friction.coulomb": force}
    return {
        LUGRE: ("LuGre", {BREAKAWAY_WALKING: force - COULOMB}),
        STICKS: (NO_LOAD, {**dry, "vertical.friction.slip_speed": 0.0}),
        REGULARISED: (NO_LOAD, dry),
    }


def by_leg(at_rest: bool = False) -> dict[str, float]:
    """Changes that give each joint a friction of its own, by direction, as tables 4 to 6, 8 and 9 have.

    Args:
        at_rest: with the breakaway forces under 5 kg in all legs, which legs 1 and 3 have always.
    """
    changes = {}
    for leg in range(LEGS):
        for kind in KINDS:
            friction = friction_bench.of_leg(leg, kind)
            weak = at_rest or leg in WEAK_LEGS
            over = BREAKAWAY_AT_REST if weak else WALKING[BREAKAWAY_WALKING]
            friction["stribeck"] *= over / JOINT.value("friction.stribeck")
            changes |= {f"{coordinate(leg, kind)}.friction.{key}": value for key, value in friction.items()}
    return changes


@dataclass(frozen=True)
class Held:
    """How vertical joints hold in support, for a speed [m/s] and a breakaway force [N].

    Attributes:
        speed, force: those.
        drawn: share of a settled support with current, by leg (6,).
        hunting: likewise with the integral running out within the band of the chains.
    """

    speed: float
    force: float
    drawn: tuple[float, ...]
    hunting: tuple[float, ...]

    @property
    def loose(self) -> int:
        """Legs that do not hold."""
        return sum(share > GIVES_WAY for share in self.drawn)


@dataclass(frozen=True)
class Results:
    """What the experiments found.

    Attributes:
        seconds: that the robot stood [s].
        depth: of the feet in the ground on three legs [m].
        standing: with motors at 0 V, by joint friction.
        by_leg_standing: likewise with LuGre friction by leg and direction.
        soft_standing: likewise with LuGre bristles of :data:`SOFT`.
        law_standing: likewise by law, all with the breakaway force at rest.
        coasting: sinking in :data:`COASTS` with dry friction, motors at 0 V and with open circuits [m].
        walks: at the gait's own speed, by joint friction.
        by_leg_walks: likewise, with friction by leg and direction; legs 1 and 3 cannot hold 10 kg.
        law_walks: likewise by law, all with :data:`STRONG`.
        held: by speed and breakaway force.
        load: largest force that a settled support asks of a vertical joint [N].
        resistance: specific resistance by joint friction and speed [m/s].
        fastest: speed at which no motor asks for more than its supply [m/s].
        others: sensitivities, by the quantity.
        identified: friction of six vertical joints.
        otherwise: walks by what is changed in :data:`OTHERWISE`.
        gravity: that the joints of a leg in the air hold [N.m, N, N].
        coupling: of the joints of a leg, with rotors and without.
    """

    seconds: float
    depth: float
    standing: Mapping[str, Standing]
    by_leg_standing: Standing
    soft_standing: Standing
    law_standing: Mapping[str, Standing]
    coasting: tuple[float, float]
    walks: Mapping[str, Walk]
    by_leg_walks: Mapping[str, Walk]
    law_walks: Mapping[str, Walk]
    held: tuple[Held, ...]
    load: float
    resistance: Mapping[str, Mapping[float, float]]
    fastest: float
    others: Mapping[str, tuple[Otherwise, ...]]
    identified: friction_bench.Identified
    otherwise: Mapping[str, Walk]
    gravity: tuple[float, float, float]
    coupling: tuple[float, float]


def run(seconds: float, say: Callable[[str], None]) -> Results:
    """Run the paper's experiments; the robot stands for so long [s] with its motors at 0 V."""
    say(f"standing {seconds:g} s with motors at 0 V")
    standing = {name: stand_unpowered(name, seconds) for name in UNPOWERED}
    opened = {"vertical.dc_motor.resistance": OPEN}
    walks, by_leg_walks = {}, {}
    for name in FRICTIONS:
        say(f"walking at {100 * SPEED:g} cm/s, joint friction: {name}")
        walks[name] = walk(name, cycles=CYCLES)
        if name in (NO_LOAD, "LuGre"):
            by_leg_walks[name] = walk(name, cycles=STEADY, changes=by_leg())
    load = heaviest(walks["LuGre"]) * (NUMBERS["ratio"].value - 1.0) - friction_bench.leg_weight()
    resistance = sweep(walks, say)
    say("walking with other breakaway forces")
    held = tuple(holding())
    say("walking faster")
    fastest = _fastest({})
    others = changed(say)
    others["fastest"] = tuple(Otherwise(label, 100.0 * _fastest(changes)) for label, changes in GEARS)
    others["sinking"] = tuple(
        Otherwise(label, f"{1e3 * stand_unpowered('none', 1.0, changes).sinking:.1f} mm in 1 s")
        for label, changes in GEARS
    )
    say("friction of six vertical joints from motor currents")
    return Results(
        seconds,
        depth=penetration_on(3),
        standing=standing,
        by_leg_standing=stand_unpowered("LuGre", seconds, by_leg(at_rest=True)),
        soft_standing=stand_unpowered("LuGre", seconds, {"vertical.friction.bristle_stiffness": SOFT}),
        law_standing={law: stand_unpowered(name, seconds, to) for law, (name, to) in laws(AT_REST_FORCE).items()},
        coasting=(stand_unpowered(NO_LOAD, COASTS).sinking, stand_unpowered(NO_LOAD, COASTS, opened).sinking),
        walks=walks,
        by_leg_walks=by_leg_walks,
        law_walks={law: walk(name, cycles=STEADY, changes=to) for law, (name, to) in laws(STRONG).items()},
        held=held,
        load=load,
        resistance=resistance,
        fastest=fastest,
        others=others,
        identified=friction_bench.identify(),
        otherwise={label: walk(name, gait, STEADY, to) for label, (name, gait, to) in OTHERWISE.items()},
        gravity=leg_model.gravity(),
        coupling=leg_model.coupling(),
    )


def holding() -> Iterator[Held]:
    """Current in support by speed and breakaway force of the vertical joints."""
    chains = JOINT.value("position_pi.band")
    for speed in sorted((SPEED, *SPEEDS)):
        for force in FORCES:
            changes = {BREAKAWAY_WALKING: force - COULOMB}
            steady, hunting = (
                walk("LuGre", Tripod(speed), STEADY, {**changes, BAND: band}) for band in (WALKING[BAND], chains)
            )
            yield Held(speed, force, *(tuple(drawing(of, leg) for leg in range(LEGS)) for of in (steady, hunting)))


def _fastest(changes: Mapping[str, float]) -> float:
    """The last speed, in steps of 1 cm/s from 3 on, before a motor asks for more than its supply [m/s]; 0: none."""
    return max(takewhile(lambda speed: _within_supply(speed, changes), (0.01 * k for k in count(3))), default=0.0)


def _within_supply(speed: float, changes: Mapping[str, float]) -> bool:
    found = walk("LuGre", Tripod(speed), STEADY, changes)
    volts = JOINT.value("supply.volts")
    return bool(np.abs(found.voltage[found.cycle(-1)]).max() < 0.999 * volts)


def sweep(walks: Mapping[str, Walk], say: Callable[[str], None]) -> dict[str, dict[float, float]]:
    """Specific resistance by joint friction and heading velocity [m/s]; ``walks`` are those at the gait's own."""
    resistance: dict[str, dict[float, float]] = {}
    for name, own in walks.items():
        say(f"specific resistance, joint friction: {name}")
        values = {SPEED: own.resistance()}
        for speed in SPEEDS:
            values[speed] = walk(name, Tripod(speed), STEADY).resistance()
        resistance[name] = dict(sorted(values.items()))
    return resistance


def changed(say: Callable[[str], None]) -> dict[str, tuple[Otherwise, ...]]:
    """What the statements on load and on LuGre become with other assumed numbers, by the quantity; all at 3 cm/s."""
    fast = Tripod(max(SPEEDS))
    found: dict[str, list[Otherwise]] = {"resistance": [], "current": []}
    for label, chains, params in CHANGED:
        say(f"walking at {100 * fast.speed:g} cm/s with {label}")
        walks = {name: walk(name, fast, STEADY, chains, params) for name in (NO_LOAD, "LuGre", LOAD)}
        found["resistance"].append(Otherwise(label, walks["LuGre"].resistance() / walks[NO_LOAD].resistance()))
        along = {name: motors(walks[name])["horizontal current"]["support"] for name in (NO_LOAD, LOAD)}
        found["current"].append(Otherwise(label, f"{along[LOAD]:.2f} A over {along[NO_LOAD]:.2f} A"))
    return {name: tuple(values) for name, values in found.items()}


def page_tables(found: Results) -> dict[str, Any]:
    """Tables of the page: how the vertical joints hold, by breakaway force and speed, and by law of friction."""

    def shares(values: tuple[float, ...]) -> str:
        return ", ".join(f"{100 * value:.0f}" for value in values)

    holds = [
        (f"{100 * row.speed:g}", f"{row.force:.0f}", shares(row.drawn), str(row.loose), shares(row.hunting))
        for row in found.held
    ]
    by_law = [
        (law, shares(tuple(drawing(of, leg) for leg in range(LEGS))), f"{1e3 * found.law_standing[law].sinking:.2f}")
        for law, of in found.law_walks.items()
    ]
    return {
        "holds": {
            "head": (
                "speed [cm/s]", "breakaway force [N]", "current in support of legs 0 to 5 [% of it]",
                "legs that give way", f"with {CHAIN_BAND} [% of it]",
            ),
            "rows": holds,
        },
        "laws": {
            "head": (
                "law of the vertical joints", f"current in support of legs 0 to 5, {STRONG:.0f} N [% of it]",
                f"the robot at 0 V sinks, {AT_REST_FORCE:.0f} N [mm in {found.seconds:g} s]",
            ),
            "rows": by_law,
        },
    }  # fmt: skip
