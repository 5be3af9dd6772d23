"""Rows on what the paper validates: amplifier biases, both coordinates of a leg at once, the hop as a return map."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from ...envs.biped.drive import ANGLE, DRIVES, PULLEYS, SHAPE, SPRING_RATIO, Drive
from ...envs.biped.parameters import SIDES
from ...envs.biped.robot import BIPED, coordinate
from ..published import Mark, Otherwise, Row, half_digit
from . import choices
from .controller import Gait
from .ground import land
from .hopping import Hopping
from .identification import bias_by_arx
from .legs_together import Together, both_segments, fit_both
from .paper import NO_UPDATE, Change, said
from .return_map import HOPS, OFF, Healing, healing, settled
from .rig import drift_record, legs_record

PLANTED: Mark = "planted and recovered"
INPUTS: Mark = "follows from the inputs"
STIFFER = 100.0  # times the printed stiffness of the cables, which is rigid
ARX: dict[str, Any] = {"judged": "assumed: 1 %, the encoder's noise", "rests": choices.RIG}
OPEN = ("boom_length", "foot_radius", "gains K_d", "gains K_p", "torque limits", "lean eta_Tor0", "travel delta_phi_d")
LEANS = (math.radians(4.0),)  # of the torso, beside the one chosen: how far what hops hand on hangs on it


def pulley_inertia(name: str, combination: int) -> float:
    """Pulleys and cables of one motor at the motor [kg.m2]: (10) solved for it, with tables III, IV and VIII."""
    drive = DRIVES[name]
    return drive.lumped_inertia[combination] / drive.motor_constant - drive.inertia_factor * drive.rotor_inertia


def legs_together(side: str, rng: np.random.Generator, stiffer: float = 1.0) -> Together:
    """V-C on the virtual machine: both coordinates of a leg at once, with what is printed of each.

    Args:
        side: of the leg.
        rng: of encoders' noise.
        stiffer: how many times as stiff as printed the cables are.
    """
    drives = [DRIVES[coordinate(side, kind)] for kind in (ANGLE, SHAPE)]
    return fit_both(
        legs_record(side, rng, stiffer),
        both_segments(BIPED.parameters()),
        [drive.ratio for drive in drives],
        [drive.motor_constant for drive in drives],
        [drive.inertia_factor * drive.rotor_inertia + PULLEYS[drive.kind][2] for drive in drives],
        [drive.leg_friction for drive in drives],
        [drive.bias for drive in drives],
    )


def soles_off(hopping: Hopping, clearance: float = 0.0) -> float:
    """Share of the time after the first touchdown in which both soles are off the floor by more than that [m]."""
    from ...envs.biped.env import soles  # its task is of learning

    later = hopping.hop >= 1
    heights = soles(BIPED.parameters(), hopping.hip[:, 1], hopping.pitch, hopping.link)[later]
    return float((heights > clearance).all(axis=1).mean()) if later.any() else 0.0


def validate(
    stretched: Hopping, changes: Sequence[Change], rng: np.random.Generator, say: Callable[[str], None]
) -> tuple[list[Row], dict[str, Any]]:
    """Rows, and what they rest on as JSON has it.

    Args:
        stretched: recording of the hops.
        changes: what other values of assumed numbers do.
        rng: of encoders' noise.
        say: prints a line.
    """
    say("amplifier biases, and both coordinates of each leg at once")
    biases = {name: bias_by_arx(drift_record(name, rng)) for name in DRIVES}
    together = {side: legs_together(side, rng) for side in SIDES}
    say("what becomes of a hop that is off")
    heals = both_ways(None)
    others = {f"lean {math.degrees(lean):.0f} deg": both_ways(Gait(torso=lean)) for lean in LEANS}
    rows = [
        *_inputs(),
        *_biases(biases),
        *leg_rows(together, {side: legs_together(side, rng, STIFFER).bias for side in SIDES}),
        *heal_rows(heals, others, "; ".join(said(item.figures) for item in changes if item.name == NO_UPDATE)),
        _ground(),
        *_way(stretched, changes),
        _flight(stretched),
    ]
    document = {
        "bias_by_arx": biases,
        "legs_together": {side: asdict(found) for side, found in together.items()},
        "healing": {
            label: {"with update": found[0].pitch.tolist(), "without": found[1].pitch.tolist()}
            for label, found in {"as chosen": heals, **others}.items()
            if not any(item.fell for item in found)
        },
        "soles_off": soles_off(stretched),
    }
    return rows, document


def both_ways(gait: Gait | None) -> tuple[Healing, Healing]:
    """What becomes of a hop that is off, with and without the update of the lean (44)."""
    apex = settled(gait)
    return healing(apex, True), healing(apex, False)


def _inputs() -> list[Row]:
    """Arithmetic of tables III, IV, V, VII and VIII."""
    worst = min(DRIVES, key=lambda name: pulley_inertia(name, 0))
    least = pulley_inertia(worst, 0)
    sides = ", ".join(f"{1e4 * pulley_inertia(coordinate(side, SHAPE), 0):.2f}" for side in SIDES)
    values = BIPED.parameters()
    mass = values["torso_mass"] + 2.0 * sum(values[f"{link}_mass"] for link in LINKS)
    grows = [friction_with_leg(drive, drive.motor_constant) for drive in DRIVES.values()]
    as_it_stands = [friction_with_leg(DRIVES[name], constant) for name, constant in TABLE_IV.items()]
    left, right = (DRIVES[coordinate(side, ANGLE)].motor_constant for side in SIDES)
    alpha = {kind: [DRIVES[coordinate(side, kind)].inertia_factor for side in SIDES] for kind in (ANGLE, SHAPE)}
    apart = max(abs(pair[1] / pair[0] - 1.0) for pair in alpha.values())
    biases = {name: abs(drive.bias) / WALKING[drive.kind] for name, drive in DRIVES.items()}
    largest = max(biases, key=lambda name: biases[name])
    springs = [DRIVES[coordinate(side, SHAPE)].spring_stiffness for side in SIDES]
    return [
        Row(
            "mass without the boom", "I", 60.0, mass, INPUTS, "kg", half_digit(60.0, 0), judged="half a digit",
            rests=(), note="the sum of table VII",
        ),
        Row(
            "inertia of every combination of pulleys by (10)", "tables III, IV, VIII", "positive",
            f"{worst.replace('_', ' ')}, i = 1: {1e4 * least:.3f}e-4 kg.m2", INPUTS, agrees=least > 0.0,
            judged="positive or not", rests=(),
            note=f"leg shape, i = 1, left and right: {sides}e-4 kg.m2, of equal pulleys; the model takes the mean, "
            "which hides that the right one is below zero",
        ),
        Row(
            "rotor inertia factors alpha, left and right", "IV-C, table IV", "very close",
            ", ".join(f"{kind.replace('_', ' ')} {pair[0]} and {pair[1]}" for kind, pair in alpha.items()), INPUTS,
            agrees=apart < 0.05, judged="assumed: a twentieth", rests=(), note=f"at most {apart:.1%} apart",
        ),
        Row(
            "biases beside torques of walking, 2 and 8 N.m", "IV-C, table IV", "very small",
            f"{largest.replace('_', ' ')}: {biases[largest]:.1%}", INPUTS, agrees=biases[largest] < 0.05,
            judged="assumed: a twentieth", rests=(), note="the largest of four",
        ),
        Row(
            "factor of (23), half of the ratio in (6)", "(23)", 2.590617, 0.5 * SPRING_RATIO, INPUTS, "",
            half_digit(SPRING_RATIO, 2), judged="half a digit of the ratio", rests=(),
        ),
        Row(
            "the springs' constants, right over left", "VII-A, Fig. 19", "consistent", f"{springs[1] / springs[0]:.3f}",
            INPUTS, agrees=abs(springs[1] / springs[0] - 1.0) < 0.05, judged="assumed: a twentieth", rests=(),
            note="the torques at no deflection are not consistent: 2.214 and 5.377 N.m",
        ),
        Row(
            choices.ALIKE, "IV-C, table IV", 1.0, right / left, "fitted", "", 0.1, judged="assumed: nearly is a tenth",
            rests=("order_of_table_IV",),
        ),
        Row(
            "friction with the legs on over that without, the least of four", "V-C, table V", "larger",
            f"{min(grows):.3f}", "predicted", agrees=min(grows) > 1.0, judged="larger or not",
            rests=("order_of_table_IV",),
            rival=Otherwise(
                "motor constants in the order of table IV", f"{min(as_it_stands):.3f}", min(as_it_stands) > 1.0
            ),
        ),
        Row(
            "friction with the legs on over that without, the most of four", "V-C, table V", "not greatly different",
            f"{max(grows):.3f}", "predicted", agrees=max(grows) < 1.5, judged="assumed: by less than half",
            rests=("order_of_table_IV",),
            sensitivity=(Otherwise("motor constants in the order of table IV", f"{max(as_it_stands):.3f}"),),
        ),
    ]  # fmt: skip


WALKING = {ANGLE: 2.0, SHAPE: 8.0}
"""Torques of walking that IV-C compares biases with [N.m]."""
LINKS = ("spring_carrier", "shin_carrier", "thigh", "shin")
TABLE_IV = {"left_leg_angle": 1.332, "right_leg_shape": 1.087}
"""Motor constants that are exchanged here, as table IV has them."""


def friction_with_leg(drive: Drive, constant: float) -> float:
    """Friction of table V over that of all pulleys in table III, brought to the motor by a motor constant."""
    return drive.leg_friction / (drive.lumped_friction[2] / constant)


def _biases(found: dict[str, float]) -> list[Row]:
    return [
        Row(
            f"{name.replace('_', ' ')}: b by ARX (31) to (33)", "table IV", 1e3 * DRIVES[name].bias, 1e3 * value,
            PLANTED, "1e-3 N.m", 0.01, **ARX,
        )
        for name, value in found.items()
    ]  # fmt: skip


def leg_rows(together: Mapping[str, Together], stiff: Mapping[str, tuple[float, float]]) -> list[Row]:
    """Biases, motion and what small errors of the bias do, of both coordinates at once, by side.

    Args:
        together: what was found.
        stiff: the biases, had the cables not stretched.
    """
    rows = []
    rests = (*choices.RIG, "right_cable")
    for side, found in together.items():
        for k, kind in enumerate((ANGLE, SHAPE)):
            printed = DRIVES[coordinate(side, kind)].leg_bias
            share = found.residual[k] / found.spread[k]
            rows += [
                Row(
                    f"{side} {kind.replace('_', ' ')}: b, both at once (20)", "table V", 1e3 * printed,
                    1e3 * found.bias[k], PLANTED, "1e-3 N.m", 0.1, judged="assumed", rests=rests,
                    sensitivity=(Otherwise("cables 100 times as stiff", 1e3 * stiff[side][k]),),
                ),
                Row(
                    f"{side} {kind.replace('_', ' ')}: simulated beside measured, both at once", "Fig. 16",
                    "match very closely", f"{math.degrees(found.residual[k]):.2f} deg rms, {share:.1%} of the motion",
                    PLANTED, agrees=share < 0.1, judged="assumed: a tenth of the motion", rests=rests,
                ),
            ]  # fmt: skip
        off = [math.degrees(value) for value in found.unadjusted]
        rows.append(
            Row(
                f"{side} leg, both at once: small errors of the bias, large deviations above all of the shape", "V-C",
                "stated", f"with the biases of table IV: {off[0]:.1f} deg of the angle, {off[1]:.1f} deg of the shape",
                "predicted", agrees=off[1] > off[0] and off[1] > 10.0 * math.degrees(found.residual[1]),
                judged="larger in the shape; assumed: ten times what (20) leaves", rests=rests,
            )
        )  # fmt: skip
    return rows


def heal_rows(
    heals: tuple[Healing, Healing], others: Mapping[str, tuple[Healing, Healing]], falls: str = ""
) -> list[Row]:
    """What becomes of a hop that is off, with the update of the lean and without.

    Args:
        heals: with and without.
        others: likewise, by what is assumed otherwise.
        falls: what becomes of hopping without the update, started with the chosen lean.
    """

    def said(found: Healing) -> str:
        return "falls" if found.fell else f"{1e3 * found.left:.2f} mrad, {found.multiplier:.2f} times a hop"

    found = [tuple(Otherwise(label, said(pair[k])) for label, pair in others.items()) for k in range(2)]
    rests = (*choices.HOPPING, "return_map")
    start = (Otherwise("started with the chosen lean", falls),) if falls else ()
    return [
        Row(
            choices.HEALS, "VIII-D", "stable", said(heals[0]), "fitted", agrees=heals[0].multiplier < 1.0,
            judged=f"smaller after {HOPS} hops or not", rests=rests, sensitivity=found[0],
            note="gains and lean were searched for hopping that lasts; with another lean it does not heal",
        ),
        Row(
            f"{1e3 * OFF:g} mrad of pitch grows without the update", "VIII-D", "unstable", said(heals[1]), "predicted",
            agrees=heals[1].multiplier >= 1.0, judged=f"larger after {HOPS} hops or not", rests=rests,
            sensitivity=(*found[1], *start),
            note="about the hop that the update has settled on, whose lean is kept",
        ),
    ]  # fmt: skip


def _ground() -> Row:
    landing = land()
    share = landing.misfit / float(landing.force.max())
    return Row(
        choices.LANDING,
        "table VI",
        "printed law",
        f"off by {share:.1%} of its largest force, rms",
        "fitted",
        agrees=share < 0.05,
        judged="assumed: under 5 %",
        rests=choices.ROBOT,
    )


def _way(stretched: Hopping, changes: Sequence[Change]) -> list[Row]:
    """How far a hop goes, how far the knees straighten and the cables stretch: what the search did not look at."""
    boom = 100.0 * BIPED.parameters()["boom_length"]
    asked = -boom * Gait().travel
    later = stretched.hop >= 1
    forward = stretched.hip[later, 0]
    found = 100.0 * float(forward[0] - forward[-1]) / max(stretched.hops - 1, 1)
    least = [math.degrees(float(stretched.link[later, column].min())) for column in (1, 3)]
    stretch = math.degrees(float(np.abs(stretched.stretch[later]).max()))

    def told(way: float) -> str:
        return f"{math.degrees(-way / boom):.2f} deg, {way:.1f} cm"

    return [
        Row(
            "turn of the boom in a hop, and the hip's way backwards", "(46)", "-69 deg", told(found), "predicted",
            agrees=abs(found / asked - 1.0) <= 0.1, judged="assumed: a tenth of delta_phi_d as read",
            rests=choices.HOPPING,
            note=f"the paper prints no way; its -69 is read as {math.degrees(Gait().travel):.2f} deg, {asked:.1f} cm "
            "on the assumed boom. The update (44) acts on the lean and does not reach it with these gains",
            sensitivity=tuple(
                Otherwise(
                    f"{change.name} {change.value}",
                    said(change.figures) if change.figures.fell else told(-100.0 * change.figures.travel),
                )
                for change in changes
                if change.name in OPEN
            ),
        ),
        Row(
            "least leg shape, left and right; 0 is a straight knee", "I", "not below 0",
            f"{least[0]:.1f} and {least[1]:.1f} deg", "predicted", agrees=min(least) >= 0.0, judged="a bound",
            note="the model has no stop in the knee", rests=choices.HOPPING,
        ),
        Row(
            "significant stretch of the cables", "VIII-D", "stated", f"up to {stretch:.0f} deg at the motor",
            "predicted", agrees=stretch > 10.0, judged="assumed: over 10 deg", rests=choices.HOPPING,
            note="rigid cables are no other model here: they stretch by nothing, whatever they carry",
        ),
    ]  # fmt: skip


def _flight(stretched: Hopping) -> Row:
    return Row(
        choices.SOLES, "VIII-D", "hops", f"{soles_off(stretched):.1%}", "fitted", agrees=soles_off(stretched) > 0.0,
        judged="more than none", rests=choices.HOPPING,
        note="the controller's phases of flight and retraction last longer: flight ends when both feet have touched",
    )  # fmt: skip
