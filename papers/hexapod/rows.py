"""Statements of the hexapod's paper beside ours, each with its mark."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import takewhile
from typing import Any

import numpy as np

from ...common.errors import SealegsError
from ...envs.hexapod.gait import SPEED, Tripod
from ...envs.hexapod.parameters import LEGS, NUMBERS
from ...envs.hexapod.robot import FRICTIONS, HORIZONTAL, KINDS, ROTATION, VERTICAL, coordinate, total_mass
from ..published import Mark, Otherwise, Row, half_digit
from . import choices, friction_bench
from .measures import AT_REST, STRIBECK, at_rest, breaking_loose, motors, reversals, slow, tracking
from .paper import BREAKAWAY_AT_REST, Machine, Standing, Walk, penetration_on, stand_unpowered

UNPOWERED = ("none", "dry/viscous", "LuGre")  # Fig. 8
SPEEDS = (0.01, 0.03)  # [m/s] of Fig. 12, beside the gait's own; the printed ones are not at hand
FASTER = (0.03, 0.04, 0.05, 0.06)  # [m/s] at which the motors' voltages are looked at
SETTLING = 0.25  # share of a cycle before the one that is measured
COASTS = 0.25  # [s] in which the robot falls with open circuits
OPEN = 1e4  # [ohm]
WEAK_LEGS = (1, 3)  # 5.4: their breakaway force is that under 5 kg while the robot walks
NO_LOAD, LOAD = "dry/viscous", "dry/viscous 2"
ALIKE = 0.1
CHANGED: tuple[tuple[str, dict[str, float], dict[str, float]], ...] = (
    ("the chosen numbers, at 3 cm/s as all below", {}, {}),
    ("a stance 15 % lower", {}, {"stance_height": 0.85 * NUMBERS["stance_height"].value}),
    ("links with centres 20 % further out", {}, {"link_centre": 1.2 * NUMBERS["link_centre"].value}),
    ("floor friction times 0.6", {}, {"floor_friction": 0.6 * NUMBERS["floor_friction"].value}),
    ("gain of the vertical motors doubled", {"vertical.position_pi.gain": 2500.0}, {}),
)
"""Assumed numbers and other values of them: label, changes of the chains, changes of the robot."""
_JOINT = friction_bench.planted({}, control=True)
SCREW, MOTOR = _JOINT.value("gear.ratio"), _JOINT.value("dc_motor.motor_constant")
WALKING_BREAKAWAY = friction_bench.planted({}, control=True).value("friction.stribeck")  # [N] over Coulomb
GEARS: tuple[tuple[str, dict[str, float]], ...] = (
    ("screw gears times 0.7", {f"{kind}.gear.ratio": 0.7 * SCREW for kind in (VERTICAL, HORIZONTAL)}),
    ("screw gears times 1.4", {f"{kind}.gear.ratio": 1.4 * SCREW for kind in (VERTICAL, HORIZONTAL)}),
    ("motors with 0.8 of their constant", {f"{kind}.dc_motor.motor_constant": 0.8 * MOTOR for kind in KINDS}),
)
"""Assumed gears and motors: label, changes of the chains."""
P_ALONE, P_SMOOTH, NO_BAND, WIDE = (
    "P alone",
    "P alone, no friction",
    "no anti-windup",
    "ten times the Stribeck velocity",
)
OTHERWISE: dict[str, tuple[str, dict[str, float]]] = {
    P_ALONE: ("LuGre", {f"{kind}.position_pi.integral": 0.0 for kind in KINDS}),
    P_SMOOTH: ("none", {f"{kind}.position_pi.integral": 0.0 for kind in KINDS}),
    NO_BAND: ("LuGre", {f"{kind}.position_pi.band": 0.0 for kind in KINDS}),
    WIDE: ("LuGre", {"vertical.friction.stribeck_velocity": 10.0 * STRIBECK}),
}
"""Walks with other controllers or friction: joint friction, and changes of the chains."""
INPUTS: Mark = "follows from the inputs"


def by_leg(at_rest: bool = False) -> dict[str, float]:
    """Changes that give each vertical joint a friction of its own, by direction, as tables 4, 8 and 9 have.

    Args:
        at_rest: with the breakaway forces under 5 kg in all legs, which legs 1 and 3 have always.
    """
    changes = {}
    for leg in range(LEGS):
        friction = friction_bench.of_leg(leg)
        if at_rest or leg in WEAK_LEGS:
            friction["stribeck"] *= BREAKAWAY_AT_REST / WALKING_BREAKAWAY
        changes |= {f"{coordinate(leg, VERTICAL)}.friction.{key}": value for key, value in friction.items()}
    return changes


@dataclass(frozen=True)
class Results:
    """What the experiments found.

    Attributes:
        seconds: that the robot stood [s].
        depth: of the feet in the ground on three legs [m].
        standing: with motors at 0 V, by joint friction.
        by_leg_standing: likewise with LuGre friction by leg and direction.
        coasting: sinking in :data:`COASTS` without friction, motors at 0 V and with open circuits [m].
        walks: at the gait's own speed, by joint friction.
        by_leg_walks: likewise, with friction by leg and direction; legs 1 and 3 cannot hold 10 kg.
        resistance: specific resistance by joint friction and speed [m/s].
        fastest: speed at which no motor asks for more than its supply [m/s].
        others: sensitivities, by the quantity.
        identified: friction of six vertical joints.
        otherwise: walks by what is changed in :data:`OTHERWISE`.
    """

    seconds: float
    depth: float
    standing: Mapping[str, Standing]
    by_leg_standing: Standing
    coasting: tuple[float, float]
    walks: Mapping[str, Walk]
    by_leg_walks: Mapping[str, Walk]
    resistance: Mapping[str, Mapping[float, float]]
    fastest: float
    others: Mapping[str, tuple[Otherwise, ...]]
    identified: friction_bench.Identified
    otherwise: Mapping[str, Walk]


def run(seconds: float, say: Callable[[str], None]) -> Results:
    """Run the paper's experiments; the robot stands for so long [s] with its motors at 0 V."""
    standing: dict[str, Standing] = {}
    for name in UNPOWERED:
        say(f"standing {seconds:g} s with motors at 0 V, joint friction: {name}")
        standing[name] = stand_unpowered(name, seconds)
    by_leg_standing = stand_unpowered("LuGre", seconds, by_leg(at_rest=True))
    closed, opened = (
        stand_unpowered("none", COASTS, changes).sinking for changes in ({}, {"vertical.dc_motor.resistance": OPEN})
    )
    walks, by_leg_walks = {}, {}
    for name in FRICTIONS:
        say(f"walking at {100 * SPEED:g} cm/s, joint friction: {name}")
        walks[name] = Machine(name).walk(Tripod(), 2.0)
        if name in (NO_LOAD, "LuGre"):
            by_leg_walks[name] = Machine(name, by_leg()).walk(Tripod(), 1.0 + SETTLING)
    resistance = sweep(walks, say)
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
        by_leg_standing=by_leg_standing,
        coasting=(closed, opened),
        walks=walks,
        by_leg_walks=by_leg_walks,
        resistance=resistance,
        fastest=fastest,
        others=others,
        identified=friction_bench.identify(),
        otherwise={label: Machine(*what).walk(Tripod(), 2.0) for label, what in OTHERWISE.items()},
    )


def _fastest(changes: Mapping[str, float]) -> float:
    """The last of :data:`FASTER` before a motor asks for more than its supply [m/s]; 0: the first one does."""
    return max(takewhile(lambda speed: _within_supply(speed, changes), FASTER), default=0.0)


def _within_supply(speed: float, changes: Mapping[str, float]) -> bool:
    machine = Machine("LuGre", changes)
    walk = machine.walk(Tripod(speed), 1.0 + SETTLING)
    volts = machine.drivetrain.chains[coordinate(0, VERTICAL)].value("supply.volts")
    return bool(np.abs(walk.voltage[walk.cycle(-1)]).max() < 0.999 * volts)


def sweep(walks: Mapping[str, Walk], say: Callable[[str], None]) -> dict[str, dict[float, float]]:
    """Specific resistance by joint friction and heading velocity [m/s]; ``walks`` are those at the gait's own."""
    resistance: dict[str, dict[float, float]] = {}
    for name, walk in walks.items():
        say(f"specific resistance, joint friction: {name}")
        values = {SPEED: walk.resistance()}
        for speed in SPEEDS:
            values[speed] = Machine(name).walk(Tripod(speed), 1.0 + SETTLING).resistance()
        resistance[name] = dict(sorted(values.items()))
    return resistance


def changed(say: Callable[[str], None]) -> dict[str, tuple[Otherwise, ...]]:
    """What the statements on load and on LuGre become with other assumed numbers, by the quantity; all at 3 cm/s."""
    fast = Tripod(max(SPEEDS))
    found: dict[str, list[Otherwise]] = {"resistance": [], "current": []}
    for label, chains, params in CHANGED:
        say(f"walking at {100 * fast.speed:g} cm/s with {label}")
        walks = {name: Machine(name, chains, params).walk(fast, 1.0 + SETTLING) for name in (NO_LOAD, "LuGre", LOAD)}
        found["resistance"].append(Otherwise(label, walks["LuGre"].resistance() / walks[NO_LOAD].resistance()))
        along = {name: motors(walks[name])["horizontal current"]["support rms"] for name in (NO_LOAD, LOAD)}
        found["current"].append(Otherwise(label, f"{along[LOAD]:.2f} A over {along[NO_LOAD]:.2f} A"))
    return {name: tuple(values) for name, values in found.items()}


def input_rows() -> list[Row]:
    """Masses of table 10, and what each foot carries of them."""
    values = {name: number.value for name, number in NUMBERS.items()}
    mass, rotor = total_mass(values), values["rotor_mass"]
    body = values["body_mass"] + 3 * LEGS * rotor
    rows = (
        ("mass of the robot", "2.1", 34.0, mass, 0, ""),
        (
            "mass of the main body, with its rotors", "2.1", 11.2, body, 1,
            f"with 16 of the 18 rotors {values['body_mass'] + 16 * rotor:.2f} kg; here they ride in the leg chassis",
        ),
        ("load on a foot, on six legs", "5.4", 5.0, mass / 6.0, 0, "the paper says approximately"),
        ("load on a foot, on three legs", "5.4", 10.0, mass / 3.0, 0, "the paper says approximately"),
    )  # fmt: skip
    return [
        Row(
            name, where, printed, ours, INPUTS, "kg", half_digit(printed, digits), note=note, judged="half a digit",
            rests=(),
        )
        for name, where, printed, ours, digits, note in rows
    ]  # fmt: skip


def _said(name: str, where: str, ours: str, agrees: bool, mark: Mark, judged: str, **more: Any) -> Row:
    """One statement of the paper, which is its own name, beside what the simulation says."""
    return Row(name, where, "stated", ours, mark, agrees=bool(agrees), judged=judged, **more)


def standing_rows(found: Results) -> list[Row]:
    """Section 6: motors at 0 V; and how deep the feet sink in."""
    sinking = {name: 1e3 * row.sinking for name, row in found.standing.items()}
    enough, time = found.seconds, f"in {found.seconds:g} s"
    settled, spread = found.standing["LuGre"], found.by_leg_standing
    coasts, falls = (1e3 * value for value in found.coasting)
    return [
        Row(
            "penetration of the feet on three legs", "4.2.1", 2.3, 1e3 * found.depth, "planted and recovered", "mm",
            half_digit(2.3, 1), judged="half a digit", rests=("ground_damping", "foot_radius"),
        ),
        _said(
            choices.ALTITUDE, "6", f"{sinking['LuGre']:.2f} mm {time}", sinking["LuGre"] < 1.0, "fitted",
            "assumed: under 1 mm", rests=choices.STANDS,
            sensitivity=(Otherwise("friction by leg and direction", f"{1e3 * spread.sinking:.2f} mm {time}"),),
        ),
        _said(
            choices.DRY_SINKS, "6", f"{sinking['dry/viscous']:.1f} mm {time}", sinking["dry/viscous"] > enough,
            "fitted", "assumed: over 1 mm/s", rests=choices.STANDS,
        ),
        _said(
            "nor without friction", "6", f"{sinking['none']:.1f} mm {time}", sinking["none"] > enough, "predicted",
            "assumed: over 1 mm/s", rests=(*choices.ROBOT, "motor"), sensitivity=found.others["sinking"],
        ),
        _said(
            "motors at 0 V brake the sinking by their back-EMF", "6",
            f"{coasts:.2f} mm in {COASTS:g} s without friction", coasts < 0.1 * falls, "predicted",
            "assumed: a tenth of what open circuits let it sink",
            rests=(*choices.ROBOT, "motor"), sensitivity=(Otherwise("open circuits", f"{falls:.1f} mm"),),
            note="decides nothing: a motor without back-EMF could not brake at all",
        ),
        Row(
            choices.BALANCE, "6", 1.0, float(settled.friction[-1] / settled.load[-1]), "fitted", "", 0.01,
            judged="assumed", rests=choices.STANDS, note=f"{settled.friction[-1]:.0f} N at leg 0",
        ),
    ]  # fmt: skip


def current_rows(found: Results) -> list[Row]:
    """Section 7.2.1: what the motors of leg 0 draw."""
    measured = {name: motors(walk) for name, walk in found.walks.items()}
    up = {name: row["vertical current"]["support median"] for name, row in measured.items()}
    along = {name: row["horizontal current"]["support rms"] for name, row in measured.items()}
    share, largest, heavier = breaking_loose(found.walks["LuGre"])
    spread = {name: motors(walk)["vertical current"]["support median"] for name, walk in found.by_leg_walks.items()}
    loose = breaking_loose(found.by_leg_walks["LuGre"])
    weak = [motors(found.by_leg_walks["LuGre"], leg)["vertical current"]["support median"] for leg in WEAK_LEGS]
    other = "friction by leg and direction, legs 1 and 3 weak"

    def loosened(part: float, most: float, times: float) -> str:
        return f"in {part:.0%} of it, at {times:.1f} times the load, {most:.2f} A" if part else "never"

    def support(values: Mapping[str, float], name: str) -> str:
        return f"median {1e3 * values[name]:.0f} mA"

    rows = [
        _said(
            choices.NO_CURRENT, "7.2.1", support(up, "LuGre"), up["LuGre"] < AT_REST, "fitted",
            f"assumed: under {1e3 * AT_REST:g} mA", rests=choices.WALKS,
            sensitivity=(
                Otherwise(other, support(spread, "LuGre")),
                Otherwise("legs 1 and 3 there", " and ".join(f"{1e3 * value:.0f}" for value in weak) + " mA"),
            ),
        ),
        _said(
            choices.REGULATION, "7.2.1", support(up, NO_LOAD), up[NO_LOAD] > AT_REST, "fitted",
            f"assumed: over {1e3 * AT_REST:g} mA", rests=choices.WALKS,
            sensitivity=(Otherwise(other, support(spread, NO_LOAD)),),
        ),
        _said(
            choices.BREAKS_LOOSE, "7.2.1", loosened(share, largest, heavier), 0.0 < share < 0.5 and heavier > 1.0,
            "fitted", "at a higher load than in the rest", rests=choices.WALKS,
            sensitivity=(Otherwise(other, loosened(*loose)),),
            note="here it gives way as the other tripod lands and the load on leg 0 falls",
        ),
        _said(
            choices.HORIZONTAL_CURRENT, "7.2.1", f"{along[LOAD]:.2f} A over {along[NO_LOAD]:.2f} A",
            along[LOAD] > along[NO_LOAD], "fitted", "higher or not", rests=choices.WALKS,
            sensitivity=found.others["current"],
        ),
    ]  # fmt: skip
    for kind in KINDS:
        leg = 1 if kind == ROTATION else 0  # the rotation of leg 0, which points ahead, stands still
        swing = [motors(found.walks[name], leg)[f"{kind} current"]["transfer rms"] for name in (NO_LOAD, "LuGre", LOAD)]
        mark, rests, note = INPUTS, (), "in the air the three laws are the same, so this cannot come out otherwise"
        if kind == VERTICAL:
            mark, rests, note = "predicted", choices.WALKS, "LuGre has a breakaway force to pass as the foot lifts off"
        rows.append(
            Row(
                f"{kind} current in transfer of leg {leg}, largest of three joint frictions over the smallest",
                "7.2.1", 1.0, max(swing) / min(swing), mark, "", ALIKE, judged="assumed: a tenth is alike", rests=rests,
                note=f"{', '.join(f'{value:.2f}' for value in swing)} A with dry/viscous, LuGre, dry/viscous 2; {note}",
            )
        )  # fmt: skip
    return rows


def gait_rows(found: Results) -> list[Row]:
    """Sections 5.2, 2.1 and 7.3: motion, the highest speed, specific resistance."""
    walk = found.walks["LuGre"]
    at = {name: row[SPEED] for name, row in found.resistance.items()}
    over = {v: found.resistance["LuGre"][v] / found.resistance[NO_LOAD][v] for v in found.resistance["LuGre"]}
    worst = max(over, key=lambda v: abs(over[v] - 1.0))
    better = {v: 1.0 - found.resistance[NO_LOAD][v] / found.resistance[LOAD][v] for v in over}
    spread = found.by_leg_walks["LuGre"].resistance() / found.by_leg_walks[NO_LOAD].resistance()
    vertical = sum(found.walks[NO_LOAD].shares()[VERTICAL]) / at[NO_LOAD]
    by_leg_walk = found.by_leg_walks["LuGre"]
    still, spread_still = ({kind: slow(of, kind) for kind in KINDS} for of in (walk, by_leg_walk))
    other = "friction by leg and direction"
    return [
        _said(
            "rotations and horizontal joints always move", "5.2",
            f"below 1e-4 for {still[ROTATION]:.1%} and {still[HORIZONTAL]:.1%} of a cycle",
            max(still[ROTATION], still[HORIZONTAL]) < 0.05, "predicted", "assumed: for less than 5 %",
            rests=choices.WALKS, note="rotations of the two legs that point along the way stand still",
            sensitivity=(Otherwise(other, f"{spread_still[ROTATION]:.1%} and {spread_still[HORIZONTAL]:.1%}"),),
        ),
        _said(
            choices.STILL, "5.2", f"below 1e-4 m/s for {at_rest(walk):.1%} of the support", at_rest(walk) > 0.95,
            "fitted", "assumed: for more than 95 %", rests=choices.WALKS,
            sensitivity=(Otherwise(other, f"{at_rest(by_leg_walk):.1%} of the support"),),
        ),
        Row(
            "highest speed on flat ground", "2.1", 3.0, 100.0 * found.fastest, "predicted", "cm/s", ALIKE,
            judged="assumed: about is a tenth", rests=choices.WALKS,
            note="the fastest of 3, 4, 5 and 6 cm/s at which no motor asks for more than its supply",
            sensitivity=found.others["fastest"],
        ),
        Row(
            "specific resistance of LuGre over that of dry/viscous", "7.3", 1.0, over[worst], "predicted", "", ALIKE,
            judged="assumed: identical in a figure is a tenth",
            sensitivity=(*found.others["resistance"], Otherwise("friction by leg and direction", spread)),
            note=f"the worst of three speeds, {100 * worst:g} cm/s. Only the vertical joint can differ, which has "
            f"{vertical:.0%} of it; the other laws are the same while they slide: the row cannot decide between LuGre "
            "and dry friction. It decides against ideal joints in place of the frictions: no number was chosen for "
            "this resistance, which friction could have filled much less",
            rests=choices.WALKS, rival=Otherwise("ideal joints, without friction", at["none"] / at[NO_LOAD]),
        ),
        _said(
            "friction is what degrades the performance", "7.3",
            f"{1.0 - at['none'] / at[NO_LOAD]:.0%} of the resistance",
            at["none"] < 0.5 * at[NO_LOAD], "predicted", "assumed: more than half", rests=choices.WALKS,
        ),
        Row(
            choices.BETTER, "7.3", 35.0, 100.0 * better[SPEED], "fitted", "%", half_digit(35.0, 0),
            judged="half a digit", rests=choices.WALKS,
            sensitivity=tuple(Otherwise(f"at {100 * v:g} cm/s", 100.0 * value) for v, value in better.items()),
        ),
    ]  # fmt: skip


def bench_rows(found: friction_bench.Identified) -> list[Row]:
    """What the procedures of 5.3 and 5.4 recover, and which load joints 1 and 3 cannot hold."""
    mark: Mark = "planted and recovered"
    sides = "six legs, both directions"
    coulomb, viscous, breakaway = (found.worst(name) for name in ("coulomb", "viscous", "breakaway"))
    weak, strong = (_holds(stribeck, 10.0) for stribeck in (BREAKAWAY_AT_REST, WALKING_BREAKAWAY))
    return [
        Row(
            f"Coulomb friction of the vertical joint, {sides}", "5.3", "tables 4 to 6 (missing)",
            f"within {coulomb:.2%} of what is planted", mark, agrees=coulomb < 0.01, judged="assumed: 1 %",
            rests=choices.BENCH,
        ),
        Row(
            "its viscous friction is hard to identify", "5.3", "stated", f"within {viscous:.1%}", mark,
            agrees=viscous > 10.0 * coulomb, judged="assumed: ten times as far off as Coulomb friction",
            rests=choices.BENCH,
        ),
        Row(
            f"breakaway force by (32) and (33), 5 kg on the foot, {sides}", "5.4", "table 8 (missing)",
            f"within {breakaway:.2%} of what is planted", mark, agrees=breakaway < 0.02, judged="assumed: 2 %",
            rests=choices.BENCH,
        ),
        Row(
            choices.OVERCOME, "5.4", "stated", "held" if weak else "overcome", "fitted", agrees=not weak,
            judged="overcome or not", rests=(*choices.BENCH, *choices.ROBOT, "breakaway_at_rest"),
            sensitivity=(Otherwise("the breakaway force under 10 kg", "held" if strong else "overcome"),),
        ),
    ]  # fmt: skip


def controller_rows(found: Results) -> list[Row]:
    """Section 2.2: what the integral and its anti-windup do; 5.2: what the Stribeck velocity does."""
    walks = {"PI": found.walks["LuGre"], **found.otherwise}
    error = {label: tracking(walk)[HORIZONTAL] for label, walk in walks.items()}
    turns = {label: reversals(walk) for label, walk in walks.items()}
    left = error[P_SMOOTH] / error[P_ALONE]
    return [
        _said(
            "the tracking error is due principally to friction", "2.2",
            f"{left:.0%} of P control's in the horizontal joints is there without friction", left < 0.5, "predicted",
            "assumed: less than half", rests=choices.WALKS,
            note="the rest is of back-EMF and of the gains, which are assumed. "
            f"PI leaves {error['PI'] / error[P_ALONE]:.0%}",
        ),
        _said(
            choices.HUNTING, "2.2",
            f"{turns['PI']} reversals of the current in support, of all vertical motors; without it {turns[NO_BAND]}",
            turns["PI"] == 0 < turns[NO_BAND], "fitted", f"none; a current over {1e3 * AT_REST:g} mA counts",
            rests=choices.WALKS,
        ),
        Row(
            "specific resistance with ten times the Stribeck velocity, which is not critical", "5.2", 1.0,
            walks[WIDE].resistance() / walks["PI"].resistance(), "predicted", "", ALIKE,
            judged="assumed: a tenth", rests=choices.WALKS,
        ),
    ]  # fmt: skip


def arithmetic_rows() -> list[Row]:
    """Statements on assumed numbers that need no simulation: slip, bristles, viscous friction."""
    slip = NUMBERS["slip_speed"].value
    joint = {key: _JOINT.value(f"friction.{key}") for key in ("coulomb", "viscous", "stribeck", "bristle_damping")}
    bound = friction_bench.largest_bristle_damping(joint["coulomb"], joint["stribeck"], joint["viscous"])
    fastest = max(friction_bench.SPEEDS)
    viscous = joint["viscous"] * fastest / joint["coulomb"]
    return [
        _said(
            choices.SLIP, "4.2.1",
            f"at most {1e3 * slip:g} mm/s short of sliding, {slip / SPEED:.1%} of the gait's speed",
            slip < ALIKE * SPEED, "fitted", "assumed: a tenth of the speed", rests=("slip_speed",),
        ),
        _said(
            f"bristle damping of {joint['bristle_damping']:g} N.s/m is dissipative", "5.2",
            f"up to {bound:.0f} N.s/m in the vertical joint", joint["bristle_damping"] < bound, "predicted",
            "a bound: sigma_1 (F_s - F_c) < f_v F_c, derived in friction_bench.py",
            rests=("vertical_coulomb", "vertical_viscous", "breakaway_walking"),
            note="the horizontal joint and the rotation have no breakaway force, and so no bound",
        ),
        _said(
            "viscous friction is small beside dry friction", "5.3",
            f"{viscous:.0%} of it in the vertical joint at {1e3 * fastest:g} mm/s", viscous < ALIKE, "predicted",
            "assumed: under a tenth", rests=("vertical_coulomb", "vertical_viscous", "bench"),
        ),
    ]  # fmt: skip


def _holds(stribeck: float, load: float) -> bool:
    """Whether a vertical joint with this breakaway force over Coulomb [N] holds a load on its foot [kg]."""
    try:
        friction_bench.breakaway({"stribeck": stribeck}, load)
    except SealegsError:
        return False
    return True


def rows(found: Results) -> list[Row]:
    """All rows."""
    return [
        *input_rows(),
        *standing_rows(found),
        *current_rows(found),
        *gait_rows(found),
        *bench_rows(found.identified),
        *controller_rows(found),
        *arithmetic_rows(),
    ]
