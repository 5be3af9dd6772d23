"""The hopper's servo: what its paper prints of its parts and its brake bench beside ours (paper 004, II to IV-C)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...actuators import Chain, load_chain
from ...actuators.brake_bench import BenchTable, Noise, Protocol
from ...actuators.brake_bench import measure as measure_bench
from ...actuators.regression_fit import EQUATION_3, RPM, fit_regression, misses, usable
from ...envs.hopper.parameters import NUMBERS
from ..published import Mark, Otherwise, Row, half_digit
from . import choices
from .paper import CHAINS


@dataclass(frozen=True)
class GearStage:
    """A pinion that drives a wheel.

    Attributes:
        pinion_teeth, wheel_teeth: teeth counts.
        pinion, wheel: their inertias [kg.m2].
        shaft: inertia of what else turns with the wheel, such as a connector or the output shaft [kg.m2].
    """

    pinion_teeth: int
    wheel_teeth: int
    pinion: float
    wheel: float
    shaft: float = 0.0

    @property
    def ratio(self) -> float:
        """Turns of the pinion per turn of the wheel."""
        return self.wheel_teeth / self.pinion_teeth


def disk_inertia(mass: float, diameter: float) -> float:
    """Inertia of a disk of ``mass`` [kg] and ``diameter`` [m] about its axis [kg.m2]."""
    return mass * diameter**2 / 8.0


def total_ratio(stages: Sequence[GearStage]) -> float:
    """Turns of the rotor per turn of the output shaft."""
    ratio = 1.0
    for stage in stages:
        ratio *= stage.ratio
    return ratio


def output_inertia(rotor: float, stages: Sequence[GearStage]) -> float:
    """Inertia of all rotating parts at the output shaft [kg.m2]: each times the square of its turns per output turn.

    Args:
        rotor: inertia of the motor's rotor [kg.m2].
        stages: from the motor to the output.
    """
    ratio = total_ratio(stages)
    total = rotor * ratio**2
    for stage in stages:
        total += stage.pinion * ratio**2
        ratio /= stage.ratio
        total += (stage.wheel + stage.shaft) * ratio**2
    return total


G_MM2 = 1e-9  # [kg.m2]
SV1270TG_ROTOR = 114.69 * G_MM2
SV1270TG_STAGES = (
    GearStage(12, 59, 0.31 * G_MM2, 12.86 * G_MM2),
    GearStage(11, 48, 0.35 * G_MM2, 41.11 * G_MM2, shaft=20.02 * G_MM2),  # the connector
    GearStage(12, 48, 1.07 * G_MM2, 8.94 * G_MM2),
    GearStage(17, 57, 6.42 * G_MM2, 473.74 * G_MM2, shaft=7.42 * G_MM2),
)
"""Table I; its totals are 287.74 and 9578657.94 g.mm2."""

SPANNED = 0.2  # [N.m] of torque at a PWM, four steps of the load: less is mostly noise
SPURIOUS = (0.005, 0.01)  # shares of measurements that are wrong altogether
LINEAR, MOTOR = "sv1270tg_bench", "sv1270tg_motor"
"""Chains on the bench: equation (3) itself, and a motor whose torque is no line of PWM and speed."""
INPUTS: Mark = "follows from the inputs"
BENCH = ("bench_motor", "bench_noise", "spurious")
"""Names of the chosen numbers that a motor's bench rests on."""


def servo(gain: float | None = None) -> Chain:
    """The printed servo, perhaps with another K_P."""
    chain = load_chain(CHAINS["with actuator"])
    return chain if gain is None else chain.with_value("position_p.gain", gain)


def constant_as_friction(chain: Chain) -> Chain:
    """A servo of equation (3) with its constant as friction: against the motion in both directions."""
    stages = chain.with_value("regression.constant", 0.0).to_list()
    friction = next((stage["friction"] for stage in stages if "friction" in stage), None)
    if friction is None:
        stages.append({"friction": {"coulomb": -EQUATION_3.constant}})
    else:
        friction["coulomb"] = -EQUATION_3.constant
    return load_chain(stages)


def input_rows() -> list[Row]:
    """Arithmetic of table I, III-D, IV-A and IV-C."""
    spring, ratio = servo(), total_ratio(SV1270TG_STAGES)
    inertia = 1e9 * output_inertia(SV1270TG_ROTOR, SV1270TG_STAGES)
    mass, damping = NUMBERS["total_mass"].value, spring.value("spring.damping")

    def row(name: str, where: str, printed: float, ours: float, unit: str, within: float, digits: str = "half a digit",
            note: str = "") -> Row:  # fmt: skip
        return Row(name, where, printed, ours, INPUTS, unit, within, judged=digits, rests=(), note=note)

    return [
        row(
            "inertia of all rotating parts", "table I", 9578657.94, inertia, "g.mm2", half_digit(114.69, 2),
            "half a digit of the rotor's inertia",
        ),
        row("gear ratio", "table I", 287.74, ratio, "", half_digit(287.74, 2)),
        row(
            "inertia of a simulated servo", "IV-C", 0.010, 1e-9 * inertia, "kg.m2", half_digit(0.010, 3),
            note="the simulations take the printed 0.010",
        ),
        row(
            "rotating mass of a simulated servo", "IV-C, III-D", 0.015, 0.0143, "kg", half_digit(0.015, 3),
            note="III-D prints 14.3 g, and the simulated mass is said to be that",
        ),
        row("simulated mass: 4.5 % more for the boom", "IV-A", mass, 0.562 * 1.045, "kg", half_digit(mass, 3)),
        row(
            "damping of a spring: 1 % of its stiffness", "IV-C", damping, 0.01 * spring.value("spring.stiffness"),
            "N.m.s/rad", half_digit(damping, 4),
            note="of the printed k = 2 N.m/rad; the simulations take the printed damping",
        ),
    ]  # fmt: skip


def bench_rows() -> list[Row]:
    """The brake bench: equation (3) found again, how many points remain, and a motor that is no line."""
    quiet, printed = Noise(spurious=0.0), EQUATION_3
    chains = (load_chain(LINEAR), constant_as_friction(load_chain(LINEAR)))
    line, friction = (fit_regression(measure_bench(chain, Protocol(), quiet, 0)) for chain in chains)
    spurious = {
        f"{share:.1%} of the measurements wrong by {quiet.spurious_torque:g} N.m": fit_regression(
            measure_bench(chains[1], Protocol(), Noise(spurious=share), 0)
        )
        for share in SPURIOUS
    }
    motor = load_chain(MOTOR)
    table = measure_bench(motor, Protocol(), Noise(), 0)
    of_motor = fit_regression(table)
    outside = 0.0455  # share of normal errors beyond two standard deviations
    scatter = 2.0 * float(np.sqrt(printed.points * outside * (1.0 - outside))) / printed.points
    found = [
        Row(
            choices.POINTS, "III-C", float(printed.points), float(friction.points), "fitted", "", scatter,
            judged="two deviations of the number of outliers",
            rests=("bench_noise", "spurious", "constant_on_the_bench"),
            sensitivity=(
                Otherwise("the constant of (3) in one direction, as it stands", float(line.points)),
                *(Otherwise(label, float(fit.points)) for label, fit in spurious.items()),
            ),
            note=f"of {len(Protocol().points(np.random.default_rng(0)))}; the others stall or are outliers. The "
            "reading of the constant and the share of wrong measurements were chosen; with others the number differs, "
            "so it decides nothing",
        )
    ]  # fmt: skip
    for what, of in (
        ("per PWM", lambda fit: fit.duty_torque),
        ("per rpm", lambda fit: fit.speed_torque * RPM),
        ("constant", lambda fit: fit.constant),
    ):
        found += [
            Row(
                f"torque {what} of its own bench", "(3)", 1e3 * of(printed), 1e3 * of(line), "planted and recovered",
                "N.mm", 0.01, judged="assumed: the bench's noise", rests=("bench_noise", "spurious"),
            ),
            Row(
                f"torque {what} of a motor's bench", "(3)", 1e3 * of(printed), 1e3 * of(of_motor),
                "predicted" if what == "constant" else "fitted", "N.mm", 0.1, judged="assumed", rests=BENCH,
                note="friction that is alike in both directions leaves no constant" if what == "constant" else "",
            ),
        ]  # fmt: skip
    return [*found, *motor_rows(motor, table)]


def motor_rows(motor: Chain, table: BenchTable) -> list[Row]:
    """What the paper says of its servo (II, III-C), of the motor on our bench."""
    others = {
        "a supply that does not sag": motor.with_value("supply.resistance", 0.0),
        "a gear that loses the same under load": motor.with_value("friction.load", 0.0),
        "friction that does not fall with speed": motor.with_value("friction.stribeck", 0.0),
    }
    tables = {label: measure_bench(other, Protocol(), Noise(), 0) for label, other in others.items()}
    corner, small, large = misses(table, fit_regression(table)).values()
    again = measure_bench(motor, Protocol(), Noise(), 1)
    linear, bent = (missed(table, again, degree) for degree in (1, 3))

    def where(table: BenchTable) -> str:
        return ", ".join(f"{name}: {1e3 * value:.0f}" for name, value in misses(table, fit_regression(table)).items())

    return [
        Row(
            "at a constant PWM the speed is linear in the torque, least R2", "III-C, Fig. 4A", "stated",
            least_r2(table), "predicted", agrees=least_r2(table) > 0.95,
            judged=f"assumed: over 0.95 at every PWM that spans more than {SPANNED:g} N.m",
            rests=BENCH, sensitivity=tuple(Otherwise(label, least_r2(other)) for label, other in tables.items()),
        ),
        Row(
            "the line misses at high PWM and low speed, not below 0.8 N.m", "III-C", "stated", where(table),
            "predicted", "N.mm rms", agrees=corner > 1.1 * max(small, large),
            judged="assumed: there by a tenth more than in either part of the rest",
            sensitivity=tuple(Otherwise(label, where(other)) for label, other in tables.items()),
            rests=(*BENCH, "parts_of_the_bench"),
            note=f"of {MOTOR}, a motor with a supply that sags and a gear that loses under load, not of a line",
        ),
        Row(
            "a more complex fit misses the bench by less", "III-C, V-B", "stated",
            f"{1e3 * bent:.0f} for {1e3 * linear:.0f} N.mm rms", "predicted", agrees=bent < linear,
            judged="less on a second bench run, or not", rests=BENCH, note="a cubic polynomial of PWM and speed",
        ),
    ]  # fmt: skip


def least_r2(table: BenchTable) -> float:
    """Least R2 of speed over torque, over all PWMs that span some torque."""
    kept = table.where(usable(table))
    groups = [kept.where(kept.duty == duty) for duty in np.unique(kept.duty)]
    groups = [group for group in groups if np.ptp(group.torque) > SPANNED]
    return min(float(np.corrcoef(group.torque, group.speed)[0, 1] ** 2) for group in groups)


def missed(table: BenchTable, again: BenchTable, degree: int) -> float:
    """By how much a polynomial of PWM and speed, fitted to one bench run, misses another one [N.m rms]."""
    powers = [(a, b) for a in range(degree + 1) for b in range(degree + 1 - a)]

    def columns(rows: BenchTable) -> np.ndarray:
        return np.stack([rows.duty**a * (rows.speed / 10.0) ** b for a, b in powers], axis=1)

    fitted, other = (rows.where(usable(rows)) for rows in (table, again))
    found = np.linalg.lstsq(columns(fitted), fitted.torque, rcond=None)[0]
    return float(np.sqrt(np.mean((columns(other) @ found - other.torque) ** 2)))
