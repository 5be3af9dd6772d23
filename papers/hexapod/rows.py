"""Statements of the hexapod's paper beside ours, each with its mark."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ...common.errors import SealegsError
from ...envs.hexapod.gait import SPEED
from ...envs.hexapod.parameters import LEGS, NUMBERS
from ...envs.hexapod.robot import HORIZONTAL, KINDS, ROTATION, VERTICAL, total_mass
from ..published import Mark, Otherwise, Row, half_digit
from . import choices, friction_bench
from .experiments import (
    ABRUPT,
    AT_REST_FORCE,
    CHAIN_BAND,
    COASTS,
    FAST,
    GIVES_WAY,
    JOINT,
    LOAD,
    NO_BAND,
    NO_LOAD,
    P_ALONE,
    P_SMOOTH,
    REGULARISED,
    SOFT,
    STEADY_LIFT,
    STICKS,
    STRONG,
    WALKING_FORCE,
    WEAK_LEGS,
    WIDE,
    Results,
)
from .measures import (
    APART,
    AT_REST,
    CARRIES,
    SETTLED,
    STRIBECK,
    at_rest,
    breaking_loose,
    drawing,
    landing,
    motors,
    near_stribeck,
    reversals,
    slip,
    slow,
    speeds,
    steepest,
    tracking,
)
from .paper import BREAKAWAY_AT_REST, BREAKAWAY_WALKING, PERIOD, WALKING, Walk, friction_at_rest, limit_by_speed

ALIKE = 0.1
LITTLE = 0.05
BY_LEG = "friction by leg and direction"
INPUTS: Mark = "follows from the inputs"


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
    by_law = {law: 1e3 * row.sinking for law, row in found.law_standing.items()}
    enough, time = found.seconds, f"in {found.seconds:g} s"
    settled = found.standing["LuGre"]
    coasts, falls = (1e3 * value for value in found.coasting)
    limits = limit_by_speed(friction_at_rest(), settled.speed)
    jump, step = 2.0 * float(np.abs(limits).min()), float(np.abs(np.diff(settled.friction[1:])).max())
    sides = int(np.count_nonzero(np.diff(np.sign(limits))))
    others = {kind: settled.moved(kind) for kind in (ROTATION, HORIZONTAL)}
    soft = 1e3 * found.soft_standing.sinking
    return [
        Row(
            "penetration of the feet on three legs", "4.2.1", 2.3, 1e3 * found.depth, "planted and recovered", "mm",
            half_digit(2.3, 1), judged="half a digit", rests=(*choices.ROBOT, *choices.MOTORS),
        ),
        _said(
            choices.ALTITUDE, "6", f"{sinking['LuGre']:.2f} mm {time}", sinking["LuGre"] < 1.0, "fitted",
            "assumed: under 1 mm", rests=choices.STANDS,
            sensitivity=(Otherwise(BY_LEG, f"{1e3 * found.by_leg_standing.sinking:.2f} mm {time}"),),
        ),
        _said(
            choices.DRY_SINKS, "6", f"{sinking['dry/viscous']:.1f} mm {time}", sinking["dry/viscous"] > enough,
            "fitted", "assumed: over 1 mm/s", rests=choices.STANDS,
        ),
        _said(
            "dry/viscous of (34) holds at no level: as high as LuGre's breakaway force, it sinks", "6",
            f"{by_law[REGULARISED]:.1f} mm {time} with {AT_REST_FORCE:.0f} N", by_law[REGULARISED] > 1.0, "predicted",
            "assumed: over 1 mm", rests=choices.STANDS,
            rival=Otherwise(
                f"{STICKS}, {AT_REST_FORCE:.0f} N", f"{by_law[STICKS]:.2f} mm {time}", by_law[STICKS] > 1.0
            ),
        ),
        _said(
            "nor does the robot hold without friction", "6", f"{sinking['none']:.1f} mm {time}",
            sinking["none"] > enough, "predicted", "assumed: over 1 mm/s", rests=(*choices.ROBOT, "motor"),
            sensitivity=found.others["sinking"],
        ),
        _said(
            "with dry/viscous, part of the damping is the motors' back-EMF", "6",
            f"{coasts:.2f} mm in {COASTS:g} s, with open circuits {falls:.1f} mm", falls > (1.0 + ALIKE) * coasts,
            "predicted", "assumed: open circuits let it sink a tenth more", rests=choices.STANDS,
            note="here it is nearly all of the damping",
        ),
        Row(
            choices.BALANCE, "6", 1.0, float(settled.friction[-1] / settled.load[-1]), "fitted", "", 0.01,
            judged="assumed", rests=choices.STANDS,
            note=f"{settled.friction[-1]:.0f} N at leg 0, within 1 % after {1e3 * settled.transient:.0f} ms",
        ),
        _said(
            "the limit of the bristles changes sides, which they smooth", "6, Fig. 10",
            f"{sides} changes by {jump:.0f} N or more, the friction by {step:.0f} N at most in 10 ms",
            sides > 0 and step < ALIKE * jump, "predicted", "assumed: by less than a tenth", rests=choices.STANDS,
        ),
        _said(
            "the stiffness of the bristles must be high enough", "5.2",
            f"with {SOFT:g} N/m the robot sinks {soft:.1f} mm {time}", soft > 1.0, "predicted", "assumed: over 1 mm",
            rests=choices.STANDS, note="a hundredth of the printed stiffness",
        ),
        _said(
            "rotations and horizontal joints are not reversible either", "5.4",
            f"at 0 V they move by {others[ROTATION]:.1e} rad and {1e3 * others[HORIZONTAL]:.1e} mm",
            max(others.values()) < STRIBECK, "predicted", "assumed: 1e-4 rad, 0.1 mm", rests=choices.STANDS,
            note="decides little: a robot that stands hardly loads them",
        ),
    ]  # fmt: skip


def leg_rows(found: Results) -> list[Row]:
    """One leg: what gravity asks of its joints, and how they are coupled."""
    _, vertical, horizontal = (abs(value) for value in found.gravity)
    with_rotors, without = found.coupling
    return [
        _said(
            "high gears decouple the dynamics of the leg parts", "1", f"mutual inertia {with_rotors:.2%} at most",
            with_rotors < ALIKE, "predicted", "assumed: under a tenth", rests=choices.ROBOT,
            sensitivity=(Otherwise("without the rotors behind their gears", f"{without:.0%}"),),
        ),
        _said(
            "gravity influences vertical joints, and less the horizontal ones", "5.3",
            f"{vertical:.0f} N and {horizontal:.0f} N", 0.0 < horizontal < vertical, "predicted", "less or not",
            rests=choices.ROBOT,
        ),
    ]  # fmt: skip


def current_rows(found: Results) -> list[Row]:
    """Section 7.2.1: what the motors draw."""
    walk, dry = found.walks["LuGre"], found.walks[NO_LOAD]
    spread = found.by_leg_walks["LuGre"]
    measured = {name: motors(of) for name, of in found.walks.items()}
    along = {name: row["horizontal current"]["support"] for name, row in measured.items()}
    swings = {kind: [motors(found.walks[name], 1 if kind == ROTATION else 0)[f"{kind} current"]["transfer"]
                     for name in (NO_LOAD, "LuGre", LOAD)] for kind in KINDS}  # fmt: skip
    apart = {kind: max(swing) / min(swing) for kind, swing in swings.items()}
    cycles = [breaking_loose(walk, number) for number in range(1, round(walk.time.size / (walk.cycle(0).stop)))]
    share, largest, load = np.array(cycles).T
    least = float(np.min(load, where=share > 0.0, initial=np.inf))
    weak = [f"{drawing(spread, leg):.0%}" for leg in WEAK_LEGS]
    strong_enough = min((row.force for row in found.held if row.speed == SPEED and row.loose == 0), default=np.nan)
    strong = {law: drawing(of) for law, of in found.law_walks.items()}

    def loose(speed: float) -> str:
        return ", ".join(f"{row.loose} at {row.force:.0f} N" for row in found.held if row.speed == speed)

    def share_of(of: Walk, after: float = SETTLED) -> str:
        legs = [drawing(of, leg, after=after) for leg in range(LEGS)]
        return f"for {legs[0]:.0%} of leg 0's, {max(legs):.0%} of the worst leg's"

    return [
        _said(
            choices.NO_CURRENT, "5, 7.2.1", share_of(walk),
            drawing(walk) < 0.5 and max(drawing(walk, leg) for leg in range(1, LEGS)) < ALIKE, "fitted",
            f"assumed: over {1e3 * AT_REST:g} mA for less than half in leg 0, where it is slight, a tenth elsewhere",
            rests=choices.DRAWS,
            note="with one breakaway force for all legs, either leg 0 gives way and so do others, or all hold, as with "
            f"{strong_enough:.0f} N",
            sensitivity=(
                *(Otherwise(f"{100 * row.speed:g} cm/s", f"for {row.drawn[0]:.0%} of leg 0's, {max(row.drawn):.0%} of "
                            "the worst leg's") for row in found.held if row.force == WALKING_FORCE),
                Otherwise("all but 0.5 s of a support looked at", share_of(walk, after=0.5)),
                Otherwise(CHAIN_BAND, share_of(found.otherwise[CHAIN_BAND])),
                Otherwise(f"{BY_LEG}, legs 1 and 3 weak", share_of(spread)),
                Otherwise("legs 1 and 3 there", " and ".join(weak)),
            ),
        ),
        _said(
            choices.REGULATION, "7.2.1", share_of(dry), min(drawing(dry, leg) for leg in range(LEGS)) > 0.5,
            "fitted", f"assumed: over {1e3 * AT_REST:g} mA for more than half", rests=choices.DRAWS,
            sensitivity=(Otherwise(BY_LEG, share_of(found.by_leg_walks[NO_LOAD])),),
        ),
        _said(
            "dry/viscous does not catch zero friction: as high as any load, the motor needs current", "7.2.1",
            f"for {strong[REGULARISED]:.0%} of leg 0's support with {STRONG:.0f} N", strong[REGULARISED] > 0.5,
            "predicted", "assumed: for more than half", rests=choices.DRAWS,
            rival=Otherwise(f"{STICKS}, {STRONG:.0f} N", f"for {strong[STICKS]:.0%}", strong[STICKS] > 0.5),
        ),
        _said(
            "the breakaway force defines whether a joint is reversible", "8",
            f"a load of {found.load:.0f} N; legs that give way: {loose(SPEED)}",
            all((row.loose > 0) == (row.force < found.load) for row in found.held if row.speed == SPEED),
            "predicted", "gives way below the load and not above it", rests=choices.DRAWS,
            sensitivity=tuple(
                Otherwise(f"{100 * speed:g} cm/s", loose(speed))
                for speed in sorted({row.speed for row in found.held} - {SPEED})
            ),
            rival=Otherwise(f"{REGULARISED}, {STRONG:.0f} N", f"current for {strong[REGULARISED]:.0%} of the support",
                            strong[REGULARISED] < GIVES_WAY),
            note=f"gives way: draws current for more than {GIVES_WAY:.0%} of a settled support",
        ),
        _said(
            choices.BREAKS_LOOSE, "7.2.1",
            f"in {share.max():.0%} of it at most, from {least:.2f} times the mean load on, "
            f"{largest.max():.2f} A",
            bool(share.min() > 0.0 and share.max() < 0.5 and least > 1.0), "fitted",
            "for less than half, and at more than the mean load", rests=choices.DRAWS,
            note=f"cycles 2 to {1 + len(cycles)}. Slight in time, not in size: the motor takes the load",
        ),
        _said(
            choices.HORIZONTAL_CURRENT, "7.2.1", f"{along[LOAD]:.2f} A over {along[NO_LOAD]:.2f} A",
            along[LOAD] > along[NO_LOAD], "fitted", "higher or not", rests=choices.DRAWS,
            sensitivity=found.others["current"],
        ),
        _said(
            "swing phases are alike, whatever the friction model", "7.2.1",
            "largest current over the smallest: " + ", ".join(f"{kind} {times:.2f}" for kind, times in apart.items()),
            max(apart.values()) < 1.0 + ALIKE, "predicted", "assumed: a tenth is alike", rests=choices.WALKS,
            note="; ".join(f"{kind} {', '.join(f'{value:.2f}' for value in swing)} A" for kind, swing in swings.items())
            + " with dry/viscous, LuGre, dry/viscous 2; rotation of leg 1, because that of leg 0 stands still. LuGre "
            "has a breakaway force to pass as the foot lifts off; the other joints have one law in the air",
        ),
    ]  # fmt: skip


def gait_rows(found: Results) -> list[Row]:
    """Sections 5.2, 2.1 and 7.3: motion, contact, the highest speed, specific resistance."""
    walk, spread = found.walks["LuGre"], found.by_leg_walks
    at = {name: row[SPEED] for name, row in found.resistance.items()}
    over = {v: found.resistance["LuGre"][v] / found.resistance[NO_LOAD][v] for v in found.resistance["LuGre"]}
    worst = max(over, key=lambda v: abs(over[v] - 1.0))
    better = {v: 1.0 - found.resistance[NO_LOAD][v] / found.resistance[LOAD][v] for v in over}
    by_leg_over = spread["LuGre"].resistance() / spread[NO_LOAD].resistance()
    vertical = sum(found.walks[NO_LOAD].shares()[VERTICAL]) / at[NO_LOAD]
    still, spread_still = ({kind: slow(of, kind) for kind in KINDS} for of in (walk, spread["LuGre"]))
    fast = {kind: float(np.median(speeds(walk, kind))) / STRIBECK for kind in (ROTATION, HORIZONTAL)}
    fast_walk = found.otherwise[FAST]
    slipped, lasts, sudden = slip(walk), landing(walk), landing(fast_walk)
    smooth, abrupt = steepest(walk), steepest(found.otherwise[ABRUPT])
    return [
        _said(
            "rotations and horizontal joints always move", "5.2, 7.2",
            f"below 1e-4 for {still[ROTATION]:.1%} and {still[HORIZONTAL]:.1%} of a cycle",
            max(still[ROTATION], still[HORIZONTAL]) < LITTLE, "predicted", "assumed: for less than 5 %",
            rests=choices.WALKS, note="rotations of the two legs that point along the way stand still",
            sensitivity=(Otherwise(BY_LEG, f"{spread_still[ROTATION]:.1%} and {spread_still[HORIZONTAL]:.1%}"),),
        ),
        _said(
            "their velocities are well above the Stribeck velocity", "5.2",
            f"median {fast[ROTATION]:.0f} and {fast[HORIZONTAL]:.0f} times 1e-4", min(fast.values()) > APART,
            "predicted", "assumed: ten times", rests=choices.WALKS,
        ),
        _said(
            choices.STILL, "5, 5.2, 7.2", f"below 1e-4 m/s for {at_rest(walk):.1%} of the support",
            at_rest(walk) > 1.0 - LITTLE, "fitted", "assumed: for more than 95 %", rests=choices.WALKS,
            sensitivity=(Otherwise(BY_LEG, f"{at_rest(spread['LuGre']):.1%} of the support"),),
        ),
        _said(
            "in swing, vertical joints always move", "5.4",
            f"below 1e-4 m/s for {at_rest(walk, air=True):.0%} of the transfer", at_rest(walk, air=True) < LITTLE,
            "predicted", "assumed: for less than 5 %", rests=choices.WALKS,
            sensitivity=(Otherwise(STEADY_LIFT, f"{at_rest(found.otherwise[STEADY_LIFT], air=True):.0%}"),),
            note="the assumed gait holds a lifted foot at its height",
        ),
        _said(
            "vertical joints stand, or move well above the Stribeck velocity", "5.2",
            f"from a tenth to ten times of it for {near_stribeck(walk):.1%} of a cycle", near_stribeck(walk) < LITTLE,
            "predicted", "assumed: for less than 5 %", rests=choices.WALKS,
        ),
        _said(
            choices.SLIP, "4.2.1", f"{1e3 * slipped:.2f} mm/s, {slipped / SPEED:.1%} of the gait's speed",
            slipped < ALIKE * SPEED, "fitted", "assumed: a tenth of the speed", rests=choices.DRAWS,
            sensitivity=(Otherwise(FAST, f"{slip(fast_walk) / fast_walk.gait.speed:.1%} of it"),),
        ),
        _said(
            "impact is quite long", "4.2.1", f"a foot carries {1e3 * lasts:.0f} ms after it touches",
            min(lasts, sudden) > PERIOD, "predicted", "assumed: over a period of the controllers, at both speeds",
            rests=choices.DRAWS, sensitivity=(Otherwise(FAST, f"{1e3 * sudden:.0f} ms"),),
            note=f"it carries with {CARRIES:.0%} of its mean load in support",
        ),
        _said(
            "with a double stance the load changes smoothly", "7.1",
            f"by {smooth:.0%} of the mean load in 0.1 s at most", smooth < abrupt, "predicted",
            "less than without or not", rests=choices.DRAWS, sensitivity=(Otherwise(ABRUPT, f"{abrupt:.0%}"),),
        ),
        Row(
            "highest speed on flat ground", "2.1", 3.0, 100.0 * found.fastest, "predicted", "cm/s", ALIKE,
            judged="assumed: about is a tenth", rests=choices.WALKS,
            note="the last in steps of 1 cm/s at which no motor asks for more than its supply",
            sensitivity=found.others["fastest"],
        ),
        Row(
            "specific resistance of LuGre over that of dry/viscous: irreversibility saves nothing", "7.3", 1.0,
            over[worst], "predicted", "", ALIKE, judged="assumed: identical in a figure is a tenth",
            sensitivity=(
                *(Otherwise(f"at {100 * v:g} cm/s", value) for v, value in over.items()),
                *found.others["resistance"], Otherwise(BY_LEG, by_leg_over),
            ),
            note=f"the worst of three speeds, {100 * worst:g} cm/s. Only the vertical joint can differ, which has "
            f"{vertical:.0%} of it at {100 * SPEED:g} cm/s; the other laws are the same while they slide: the row "
            "cannot decide between LuGre and dry friction",
            rests=choices.WALKS,
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
    weak, strong = (_holds(stribeck, 10.0) for stribeck in (BREAKAWAY_AT_REST, WALKING[BREAKAWAY_WALKING]))
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
            judged="overcome or not", rests=(*choices.BENCH, "breakaway_at_rest"),
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
            rests=choices.DRAWS,
        ),
        Row(
            "specific resistance with ten times the Stribeck velocity, which is not critical", "5.2", 1.0,
            walks[WIDE].resistance() / walks["PI"].resistance(), "predicted", "", ALIKE,
            judged="assumed: a tenth", rests=choices.WALKS,
        ),
    ]  # fmt: skip


def arithmetic_rows() -> list[Row]:
    """Statements on assumed numbers that need no simulation: bristles, viscous friction."""
    joint = {key: JOINT.value(f"friction.{key}") for key in ("coulomb", "viscous", "bristle_damping")}
    breakaway = WALKING[BREAKAWAY_WALKING]
    bound = friction_bench.largest_bristle_damping(joint["coulomb"], breakaway, joint["viscous"])
    fastest = max(friction_bench.SPEEDS)
    viscous = joint["viscous"] * fastest / joint["coulomb"]
    return [
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
    """All rows; a fitted one that misses says so."""
    return [
        replace(row, note="; ".join(filter(None, ("misses, though a number was chosen for it", row.note))))
        if row.mark == "fitted" and row.holds is False
        else row
        for row in (
            *input_rows(),
            *standing_rows(found),
            *leg_rows(found),
            *current_rows(found),
            *gait_rows(found),
            *bench_rows(found.identified),
            *controller_rows(found),
            *arithmetic_rows(),
        )
    ]
