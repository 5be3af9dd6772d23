"""Rows on what the paper validates: amplifier biases, both coordinates of a leg at once, the hop as a return map."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np

from ...envs.biped.drive import ANGLE, DRIVES, PULLEYS, SHAPE
from ...envs.biped.parameters import SIDES
from ...envs.biped.robot import BIPED, coordinate
from ..published import Mark, Otherwise, Row
from .controller import Gait
from .hopping import Hopping
from .identification import bias_by_arx
from .legs_together import Together, both_segments, fit_both
from .return_map import HOPS, OFF, Healing, healing, settled
from .rig import drift_record, legs_record

PLANTED: Mark = "planted and recovered"
INPUTS: Mark = "follows from the inputs"
LEANS = (math.radians(4.0),)  # of the torso, beside the one chosen: how far what hops hand on hangs on it


def pulley_inertia(name: str, combination: int) -> float:
    """Pulleys and cables of one motor at the motor [kg.m2]: (10) solved for it, with tables III, IV and VIII."""
    drive = DRIVES[name]
    return drive.lumped_inertia[combination] / drive.motor_constant - drive.inertia_factor * drive.rotor_inertia


def legs_together(side: str, rng: np.random.Generator) -> Together:
    """V-C on the virtual machine: both coordinates of a leg at once, with what is printed of each."""
    drives = [DRIVES[coordinate(side, kind)] for kind in (ANGLE, SHAPE)]
    return fit_both(
        legs_record(side, rng),
        both_segments(BIPED.parameters()),
        [drive.ratio for drive in drives],
        [drive.motor_constant for drive in drives],
        [drive.inertia_factor * drive.rotor_inertia + PULLEYS[drive.kind][2] for drive in drives],
        [drive.leg_friction for drive in drives],
        [drive.bias for drive in drives],
    )


def soles_off(hopping: Hopping, clearance: float = 0.0) -> float:
    """Share of the time after the first touchdown in which both soles are off the floor by more than that [m]."""
    from ...envs.biped.task import soles  # its task is of learning

    later = hopping.hop >= 1
    heights = soles(BIPED.parameters(), hopping.hip[:, 1], hopping.pitch, hopping.link)[later]
    return float((heights > clearance).all(axis=1).mean()) if later.any() else 0.0


def validate(
    stretched: Hopping, rng: np.random.Generator, say: Callable[[str], None]
) -> tuple[list[Row], dict[str, Any]]:
    """Rows, and what they rest on as JSON has it.

    Args:
        stretched: recording of the hops.
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
        *_pulleys(),
        *_biases(biases),
        *leg_rows(together),
        *heal_rows(heals, others),
        *_way(stretched),
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


def _pulleys() -> list[Row]:
    worst = min(DRIVES, key=lambda name: pulley_inertia(name, 0))
    least = pulley_inertia(worst, 0)
    sides = ", ".join(f"{1e4 * pulley_inertia(coordinate(side, SHAPE), 0):.2f}" for side in SIDES)
    return [
        Row(
            "inertia of every combination of pulleys by (10)", "tables III, IV, VIII", "positive",
            f"{worst.replace('_', ' ')}, i = 1: {1e4 * least:.3f}e-4 kg.m2", INPUTS, agrees=least > 0.0,
            note=f"leg shape, i = 1, left and right: {sides}e-4 kg.m2, of equal pulleys; the model takes the mean, "
            "which hides that the right one is below zero",
        )
    ]  # fmt: skip


def _biases(found: dict[str, float]) -> list[Row]:
    return [
        Row(
            f"{name.replace('_', ' ')}: b by ARX (31) to (33)", "table IV", 1e3 * DRIVES[name].bias, 1e3 * value,
            PLANTED, "1e-3 N.m", agrees=abs(value - DRIVES[name].bias) < 1e-3,
        )
        for name, value in found.items()
    ]  # fmt: skip


def leg_rows(together: dict[str, Together]) -> list[Row]:
    """Biases, motion and what small errors of the bias do, of both coordinates at once, by side."""
    rows = []
    for side, found in together.items():
        for k, kind in enumerate((ANGLE, SHAPE)):
            printed = DRIVES[coordinate(side, kind)].leg_bias
            share = found.residual[k] / found.spread[k]
            rows += [
                Row(
                    f"{side} {kind.replace('_', ' ')}: b, both at once (20)", "table V", 1e3 * printed,
                    1e3 * found.bias[k], PLANTED, "1e-3 N.m", agrees=abs(found.bias[k] - printed) < 5e-3,
                ),
                Row(
                    f"{side} {kind.replace('_', ' ')}: simulated beside measured, both at once", "Fig. 16",
                    "match very closely", f"{math.degrees(found.residual[k]):.2f} deg rms, {share:.1%} of the motion",
                    PLANTED, agrees=share < 0.1,
                ),
            ]  # fmt: skip
        off = [math.degrees(value) for value in found.unadjusted]
        rows.append(
            Row(
                f"{side} leg, both at once: small errors of the bias, large deviations above all of the shape", "V-C",
                "stated", f"with the biases of table IV: {off[0]:.1f} deg of the angle, {off[1]:.1f} deg of the shape",
                "predicted", agrees=off[1] > off[0] and off[1] > 10.0 * math.degrees(found.residual[1]),
            )
        )  # fmt: skip
    return rows


def heal_rows(heals: tuple[Healing, Healing], others: dict[str, tuple[Healing, Healing]]) -> list[Row]:
    """What becomes of a hop that is off, with the update of the lean and without.

    Args:
        heals: with and without.
        others: likewise, by what is assumed otherwise.
    """

    def said(found: Healing) -> str:
        return "falls" if found.fell else f"{1e3 * found.left:.2f} mrad, {found.multiplier:.2f} times a hop"

    rows = []
    for k, (word, printed) in enumerate((("with", "stable"), ("without", "unstable"))):
        holds = heals[k].multiplier < 1.0
        rows.append(
            Row(
                f"{1e3 * OFF:g} mrad of pitch, {HOPS} hops later, {word} the update (44)", "VIII-D", printed,
                said(heals[k]), "predicted", agrees=holds == (k == 0),
                sensitivity=tuple(Otherwise(label, said(found[k])) for label, found in others.items()),
                note="gains and lean are not printed" if k == 0 else "about the hop that the update has settled on, "
                "whose lean is kept; started with the chosen lean it falls, as the row before says",
            )
        )  # fmt: skip
    return rows


def _way(stretched: Hopping) -> list[Row]:
    """How far a hop goes, and how far the knees straighten: what the search for gains did not look at."""
    asked = 100.0 * Gait().travel * BIPED.parameters()["boom_length"]
    later = stretched.hop >= 1
    found = 100.0 * float(np.ptp(stretched.hip[later, 0])) / max(stretched.hops - 1, 1)
    least = [math.degrees(float(stretched.link[later, column].min())) for column in (1, 3)]
    return [
        Row(
            "way of a hop, backwards", "(46)", -asked, found, "predicted", "cm", within=0.3,
            note="delta_phi_d times the boom: the update (44) acts on the lean and does not reach it with these gains",
        ),
        Row(
            "least leg shape, left and right; 0 is a straight knee", "I", "not below 0",
            f"{least[0]:.1f} and {least[1]:.1f} deg", "predicted", agrees=min(least) >= 0.0,
            note="the model has no stop in the knee",
        ),
    ]  # fmt: skip


def _flight(stretched: Hopping) -> Row:
    return Row(
        "both soles off the floor, share of the time", "VIII-D", "hops", f"{soles_off(stretched):.1%}", "fitted",
        agrees=soles_off(stretched) > 0.0,
        note="the controller's phases of flight and retraction last longer: flight ends when both feet have touched",
    )  # fmt: skip
