"""Printed figures and statements of the hopper's paper beside ours, each with its mark."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...actuators import Chain, load_chain
from ...actuators.brake_bench import Noise, Protocol
from ...actuators.brake_bench import measure as measure_bench
from ...actuators.regression_fit import fit_regression, misses
from ..published import Otherwise, Row
from .paper import CHAINS, PRINTED, Figures, Hops, Legs, by_period, measure

BLIND = (0.100, 0.084)  # [m] upper and lower link: of the search, best on the figures of the leg without actuator
NEARLY = ((0.096, 0.084), (0.104, 0.084), (0.104, 0.088))  # [m] next best on the same
USED = 0.8  # [N.m] the largest torque of the paper's use case, section III-B
STANDS = 0.1  # rad/s below which a motor stands
LENGTHS = "link lengths were searched for these four figures (docs/results/hopper.md)"


def lengths(pair: tuple[float, float]) -> dict[str, float]:
    """Numbers of the robot with these lengths of upper and lower link [m]."""
    return {"upper_length": pair[0], "lower_length": pair[1]}


def blind(seconds: float) -> list[Row]:
    """What the leg without actuator says about the one with it: frequency and height.

    The link lengths are those that fit the two figures without actuator. Nothing with a servo took part in the choice.
    """
    found = measure(Legs(CHAINS["with actuator"], params=lengths(BLIND)).hop(seconds))
    others = {
        f"links of {upper:g} and {lower:g} m": measure(
            Legs(CHAINS["with actuator"], params=lengths((upper, lower))).hop(seconds)
        )
        for upper, lower in NEARLY
    }
    printed = PRINTED["with actuator"]
    return [
        Row(
            "frequency with actuator, lengths from the leg without",
            "IV-E",
            printed.frequency,
            found.frequency,
            "predicted",
            "Hz",
            within=0.2,
            sensitivity=tuple(Otherwise(name, value.frequency) for name, value in others.items()),
        ),
        Row(
            "jump height with actuator, lengths from the leg without",
            "IV-E",
            100.0 * printed.height,
            100.0 * found.height,
            "predicted",
            "cm",
            within=0.2,
            sensitivity=tuple(Otherwise(name, 100.0 * value.height) for name, value in others.items()),
            note="the paper does not say from where it measures; here from the lowest to the highest point of the hip",
        ),
    ]


def flexion(hops: Hops) -> float:
    """Largest angle between both links, mean over the hops [rad]."""
    bend = by_period(hops, hops.link[:, 1] - hops.link[:, 0])
    return float(bend.max(axis=1).mean())


def creep(hops: Hops) -> float:
    """Mean speed of the hip's motor in the last tenth before the greatest flexion [rad/s]."""
    speed = by_period(hops, hops.motor_speed[:, 0])
    return float(np.abs(speed[:, int(0.9 * speed.shape[1]) :]).mean())


LINEAR = "sv1270tg_motor"
"""Chain on the bench whose torque is no line of PWM and speed, which is what is fitted to it."""


def line_misses() -> Row:
    """Where a line misses a bench whose servo is none: the paper sees it at high PWM and low speed (III-C)."""
    motor = load_chain(LINEAR)
    others = {
        "a supply that does not sag": motor.with_value("supply.resistance", 0.0),
        "a gear that loses the same under load": motor.with_value("friction.load", 0.0),
        "friction that does not fall with speed": motor.with_value("friction.stribeck", 0.0),
    }

    def found(chain: Chain) -> dict[str, float]:
        table = measure_bench(chain, Protocol(repeats=1), Noise(), 0)
        return misses(table, fit_regression(table))

    def said(off: dict[str, float]) -> str:
        return ", ".join(f"{name}: {1e3 * value:.0f}" for name, value in off.items())

    off = found(motor)
    corner, small, large = off.values()
    return Row(
        "the line misses at high PWM and low speed, not below 0.8 N.m", "III-C", "stated", said(off), "predicted",
        "N.mm rms", agrees=corner > 1.3 * small and large > 1.3 * small,
        sensitivity=tuple(Otherwise(label, said(found(chain))) for label, chain in others.items()),
        note=f"of {LINEAR}, a motor with a supply that sags and a gear that loses under load, not of a line",
    )  # fmt: skip


def rows(cases: Mapping[str, Hops], figures: Mapping[str, Figures], seconds: float) -> list[Row]:
    """All rows, from the recordings and figures of both cases; the predictions hop again, for ``seconds`` each."""
    found: list[Row] = []
    for name, value in figures.items():
        printed = PRINTED[name]
        found += [
            Row(
                f"hopping frequency {name}", "IV-E", printed.frequency, value.frequency, "fitted", "Hz", 0.2,
                note=LENGTHS if name == "with actuator" else "",
            ),
            Row(f"jump height {name}", "IV-E", 100.0 * printed.height, 100.0 * value.height, "fitted", "cm", 0.2),
        ]  # fmt: skip
    real, ideal = (cases[name] for name in CHAINS)
    bent, less = flexion(real), flexion(ideal)
    slope, torque = creep(real), figures["with actuator"].torque
    return [
        *found,
        *blind(seconds),
        line_misses(),
        Row(
            "without actuator the leg flexes less", "IV-E", "less", f"{less:.2f} under {bent:.2f} rad", "predicted",
            agrees=less < bent,
        ),
        Row(
            "hip motor stands in the flexion: a plateau", "IV-E", "stands", f"{slope:.2f} rad/s", "predicted",
            agrees=slope < STANDS,
        ),
        Row(
            "torques of the use case, at most", "III-B", USED, torque, "predicted", "N.m", agrees=torque <= USED,
            note="the landing drives the motor back at full duty",
        ),
    ]  # fmt: skip
