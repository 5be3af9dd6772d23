"""Printed figures and statements of the hopper's paper beside ours, each with its mark."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...actuators import Chain, load_chain
from ...actuators.brake_bench import Noise, Protocol
from ...actuators.brake_bench import measure as measure_bench
from ...actuators.gear_train import SV1270TG_ROTOR, SV1270TG_STAGES, output_inertia, total_ratio
from ...actuators.regression_fit import EQUATION_3, RPM, fit_regression, misses, usable
from ...envs.hopper.parameters import NUMBERS
from ..published import Mark, Otherwise, Row, half_digit
from . import choices
from .paper import CHAINS, CONTROL_STEP, PRINTED, SETTLING, Figures, Hops, Legs, by_period, measure

REAL, IDEAL = CHAINS
NEARLY = ((0.096, 0.084), (0.104, 0.084), (0.104, 0.088))  # [m] next best lengths on the leg without actuator
USED = 0.8  # [N.m] the largest torque of the paper's use case, section III-B
STANDS = 0.1  # rad/s below which a motor stands
REGULAR = 0.02  # spread of a period over its mean
SPANNED = 0.2  # [N.m] of torque at a PWM, four steps of the load: less is mostly noise
SPURIOUS = (0.005, 0.01)  # shares of measurements that are wrong altogether
LINEAR, MOTOR = "sv1270tg_bench", "sv1270tg_motor"
"""Chains on the bench: equation (3) itself, and a motor whose torque is no line of PWM and speed."""
INPUTS: Mark = "follows from the inputs"
SLIPPERY = (0.8, 0.5)
"""Frictions of the ground below the simulation's 1.0; that of the hardware is not printed."""
OWN_SCATTER = {"frequency": 0.14, "height": 0.2}
"""How far the paper's simulation with actuator is off its own hardware: 2.5 for 2.9 Hz, 12 for 10 cm."""
BLIND = (*choices.BLIND, *choices.MODEL)
CHOSEN = (*choices.LENGTHS, *choices.MODEL)


def lengths(pair: tuple[float, float]) -> dict[str, float]:
    """Numbers of the robot with these lengths of upper and lower link [m]."""
    return {"upper_length": pair[0], "lower_length": pair[1]}


def constant_as_friction(chain: Chain) -> Chain:
    """A servo of equation (3) with its constant as friction: against the motion in both directions."""
    stages = chain.with_value("regression.constant", 0.0).to_list()
    friction = next((stage["friction"] for stage in stages if "friction" in stage), None)
    if friction is None:
        stages.append({"friction": {"coulomb": -EQUATION_3.constant}})
    else:
        friction["coulomb"] = -EQUATION_3.constant
    return load_chain(stages)


def flexion(hops: Hops) -> float:
    """Largest angle between both links, mean over the hops [rad]."""
    bend = by_period(hops, hops.link[:, 1] - hops.link[:, 0])
    return float(bend.max(axis=1).mean())


def creep(hops: Hops) -> float:
    """Mean speed of the hip's motor in the last tenth before the greatest flexion [rad/s]."""
    speed = by_period(hops, hops.motor_speed[:, 0])
    return float(np.abs(speed[:, int(0.9 * speed.shape[1]) :]).mean())


def trigger(hops: Hops) -> float:
    """Time from touchdown to the control signal, mean over the hops [s]."""
    floor = hops.clearance <= 1e-4
    signal = np.abs(hops.goal[:, 1] - hops.goal[0, 1]) > 1e-6
    flight = round(0.03 / CONTROL_STEP)  # samples in the air that make a touchdown
    later = [k for k in np.flatnonzero(floor & (hops.time > SETTLING)) if not floor[k - flight : k].any()]
    delays = [np.argmax(signal[k:]) for k in later if signal[k:].any()]
    return float(np.mean(delays)) * CONTROL_STEP


@dataclass(frozen=True)
class Blind:
    """Hopping with link lengths that know nothing of the servo: they fit the two figures without actuator.

    Attributes:
        hops: both cases.
        figures: of both.
        others: with actuator, with the next best lengths or another servo, by their names.
    """

    hops: Mapping[str, Hops]
    figures: Mapping[str, Figures]
    others: Mapping[str, Hops]


def hop_blind(seconds: float) -> Blind:
    """Hop for so long [s] in each case."""
    own = lengths(choices.BLIND_LENGTHS)
    hops = {name: Legs(chain, params=own).hop(seconds) for name, chain in CHAINS.items()}
    servo = load_chain(CHAINS[REAL])
    others = {
        f"links of {pair[0]:g} and {pair[1]:g} m": Legs(servo, params=lengths(pair)).hop(seconds) for pair in NEARLY
    }
    others["the constant of (3) as friction"] = Legs(constant_as_friction(servo), params=own).hop(seconds)
    others["K_P = 55, as on the hardware"] = Legs(servo.with_value("position_p.gain", 55.0), params=own).hop(seconds)
    return Blind(hops, {name: measure(found) for name, found in hops.items()}, others)


def fitted_rows(figures: Mapping[str, Figures], blind: Mapping[str, Figures]) -> list[Row]:
    """Frequency and height of both cases, which the lengths were searched for; and of the one that the others fit."""
    found: list[Row] = []
    for label, own, rests in (("", figures, CHOSEN), (", lengths from it", {IDEAL: blind[IDEAL]}, BLIND)):
        for name, value in own.items():
            for what, unit, factor in (("frequency", "Hz", 1.0), ("height", "cm", 100.0)):
                printed, ours = (factor * getattr(source, what) for source in (PRINTED[name], value))
                found.append(
                    Row(
                        f"{what} {name}{label}", "IV-E", printed, ours, "fitted", unit, OWN_SCATTER[what],
                        judged="how far the paper's simulation is off its hardware", rests=rests,
                    )
                )  # fmt: skip
    return found


def predicted_rows(blind: Blind) -> list[Row]:
    """What the leg without actuator says about the one with it: nothing with a servo took part in the choice."""
    found, real, ideal = [], blind.figures[REAL], blind.figures[IDEAL]
    others = {name: measure(hops) for name, hops in blind.others.items()}
    for target, label in (("hardware", "of the hardware"), (REAL, f"{REAL}, lengths from the leg without")):
        for what, unit, factor in (("frequency", "Hz", 1.0), ("height", "cm", 100.0)):
            found.append(
                Row(
                    f"{what} {label}", "IV-E", factor * getattr(PRINTED[target], what), factor * getattr(real, what),
                    "predicted", unit, 0.1, judged=f"the paper's scatter is {OWN_SCATTER[what]:.0%}; a tenth is asked",
                    sensitivity=tuple(Otherwise(name, factor * getattr(value, what)) for name, value in others.items()),
                    rests=BLIND, rival=Otherwise("ideal motors", factor * getattr(ideal, what)),
                )
            )  # fmt: skip
    bent, less = (flexion(blind.hops[name]) for name in CHAINS)
    late, early = (1e3 * trigger(blind.hops[name]) for name in CHAINS)
    spike, most = (float(np.abs(blind.hops[name].motor_speed[:, 0]).max()) for name in (IDEAL, REAL))
    return [
        *found,
        Row(
            "without actuator the leg flexes less", "IV-E", "less", f"{less:.2f} under {bent:.2f} rad", "predicted",
            agrees=less < bent, judged="less or not", rests=BLIND,
            sensitivity=tuple(
                Otherwise(name, f"{less:.2f} under {flexion(hops):.2f} rad") for name, hops in blind.others.items()
            ),
        ),
        Row(
            "without actuator the signal comes earlier", "IV-E", "earlier",
            f"{early:.0f} ms after touchdown, with it {late:.0f}", "predicted",
            agrees=early < late, judged="earlier or not", rests=BLIND,
            sensitivity=tuple(
                Otherwise(name, f"{early:.0f} ms after touchdown, with it {1e3 * trigger(hops):.0f}")
                for name, hops in blind.others.items()
            ),
        ),
        Row(
            "without actuator the motor's speed has spikes", "IV-E", "stated", f"{spike:.0f} over {most:.1f} rad/s",
            INPUTS, agrees=spike > most, judged="higher or not", rests=(), note="its position is the goal, which steps",
        ),
    ]  # fmt: skip


def use_rows(cases: Mapping[str, Hops], figures: Mapping[str, Figures], blind: Blind) -> list[Row]:
    """What else is said of hopping."""
    real, others = cases[REAL], {"lengths from the leg without": blind.hops[REAL], **blind.others}
    slope, torque = creep(real), figures[REAL].torque
    spread = [value.regularity for value in figures.values()]
    return [
        Row(
            choices.HOPS, "IV-E", "stated", ", ".join(f"{value:.2%}" for value in spread) + " of the period",
            "fitted", agrees=max(spread) < REGULAR, judged=f"assumed: under {REGULAR:.0%}", rests=CHOSEN,
        ),
        Row(
            "hip motor stands in the flexion: a plateau", "IV-E", "stands", f"{slope:.2f} rad/s", "predicted",
            agrees=slope < STANDS, judged=f"assumed: under {STANDS:g} rad/s", rests=CHOSEN,
            sensitivity=tuple(Otherwise(name, f"{creep(hops):.2f} rad/s") for name, hops in others.items()),
        ),
        Row(
            "torques of the use case, at most", "III-C", USED, torque, "predicted", "N.m", agrees=torque <= USED,
            judged="a bound", rests=CHOSEN, note="the landing drives the motor back at full duty",
            sensitivity=tuple(Otherwise(name, measure(hops).torque) for name, hops in others.items()),
        ),
    ]  # fmt: skip


def other_rows(figures: Figures, seconds: float) -> list[Row]:
    """What the paper says of numbers that it did not change: damping of the gear and friction of the ground."""
    chain = load_chain(CHAINS[REAL])
    damped = {
        f"{value:g} N.m.s/rad": measure(Legs(chain.with_value("friction.viscous", value)).hop(seconds))
        for value in (0.25, 0.45)
    }
    slippery = [measure(Legs(chain, params={"floor_friction": mu}).hop(seconds)) for mu in SLIPPERY]

    def told(value: Figures) -> str:
        return f"{value.frequency:.3f} Hz, {100.0 * value.height:.2f} cm"

    most = max(
        abs(getattr(value, what) / getattr(figures, what) - 1.0)
        for value in damped.values()
        for what in ("frequency", "height")
    )
    return [
        Row(
            "a rough damping of the gear suffices", "V-B", "likely",
            f"{most:.0%} of frequency or height for 30 % of it", "predicted", agrees=most < 0.1,
            judged="assumed: under 10 %", rests=CHOSEN,
            sensitivity=tuple(
                Otherwise(name, f"{value.frequency:.2f} Hz, {100.0 * value.height:.1f} cm")
                for name, value in damped.items()
            ),
        ),
        Row(
            "on a ground with less friction it jumps lower and faster", "V-A", "likely",
            f"mu = 1: {told(figures)}", "predicted",
            agrees=all(
                value.height < figures.height and value.frequency > figures.frequency for value in slippery
            ),
            judged=f"lower and faster at mu = {' and '.join(f'{mu:g}' for mu in SLIPPERY)}, or not", rests=CHOSEN,
            sensitivity=tuple(
                Otherwise(f"mu = {mu:g}", told(value)) for mu, value in zip(SLIPPERY, slippery, strict=True)
            ),
            note="the hardware's friction is not printed",
        ),
    ]  # fmt: skip


def cost_rows(speed: Mapping[str, Mapping[str, float]]) -> list[Row]:
    """Time that the simulation takes, by case and number of legs, over real time."""
    one = [speed[name]["1"] / CONTROL_STEP / 1e3 for name in CHAINS]
    return [
        Row(
            "updates of one leg, with and without actuator", "IV-E", "more than 3 kHz",
            f"{one[0]:.0f} and {one[1]:.0f} kHz", "predicted", rests=CHOSEN, timed=True,
            note="not judged: it measures this computer and its load, and another engine",
        ),
        Row(
            "four legs with actuators over real time", "IV-E", "0.9", f"{speed[REAL]['4']:.0f}", "predicted",
            rests=(*CHOSEN, "leg_distance"), timed=True, note="not judged, likewise",
        ),
    ]  # fmt: skip


def input_rows() -> list[Row]:
    """Arithmetic of table I and IV-A."""
    digits = half_digit(114.69, 2)
    mass = NUMBERS["total_mass"].value
    spring = load_chain(CHAINS[REAL])
    damping = spring.value("spring.damping")
    return [
        Row(
            "inertia of all rotating parts", "table I", 9578657.94,
            1e9 * output_inertia(SV1270TG_ROTOR, SV1270TG_STAGES), INPUTS, "g.mm2", digits,
            judged="half a digit of the rotor's inertia", rests=(),
        ),
        Row(
            "gear ratio", "table I", 287.74, total_ratio(SV1270TG_STAGES), INPUTS, "", half_digit(287.74, 2),
            judged="half a digit", rests=(),
        ),
        Row(
            "simulated mass: 4.5 % more for the boom", "IV-A", mass, 0.562 * 1.045, INPUTS, "kg", half_digit(mass, 3),
            judged="half a digit", rests=(),
        ),
        Row(
            "damping of a spring: 1 % of its stiffness", "IV-C", damping, 0.01 * spring.value("spring.stiffness"),
            INPUTS, "N.m.s/rad", half_digit(damping, 4), judged="half a digit", rests=(),
            note="of the printed k = 2 N.m/rad; the simulations take the printed damping",
        ),
    ]  # fmt: skip


def bench_rows() -> list[Row]:
    """The brake bench: equation (3) found again, how many points remain, and where a line misses a motor."""
    quiet, printed = Noise(spurious=0.0), EQUATION_3
    chains = (load_chain(LINEAR), constant_as_friction(load_chain(LINEAR)))
    line, friction = (fit_regression(measure_bench(chain, Protocol(), quiet, 0)) for chain in chains)
    spurious = {
        f"{share:.1%} of the measurements wrong by 0.3 N.m": fit_regression(
            measure_bench(chains[1], Protocol(), Noise(spurious=share), 0)
        )
        for share in SPURIOUS
    }
    motor = fit_regression(measure_bench(load_chain(MOTOR), Protocol(), Noise(), 0))
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
    for k, (what, value, unit) in enumerate(
        (("per PWM", 1e3 * printed.duty_torque, "N.mm"), ("per rpm", 1e3 * printed.speed_torque * RPM, "N.mm"),
         ("constant", 1e3 * printed.constant, "N.mm"))
    ):  # fmt: skip
        of_line, of_motor = (
            (1e3 * fit.duty_torque, 1e3 * fit.speed_torque * RPM, 1e3 * fit.constant)[k] for fit in (line, motor)
        )
        found += [
            Row(
                f"torque {what} of its own bench", "(3)", value, of_line, "planted and recovered", unit, 0.01,
                judged="assumed: the bench's noise", rests=("bench_noise", "spurious"),
            ),
            Row(
                f"torque {what} of a motor's bench", "(3)", value, of_motor,
                "predicted" if what == "constant" else "fitted", unit, 0.1, judged="assumed",
                rests=("bench_motor", "bench_noise", "spurious"),
                note="friction that is alike in both directions leaves no constant" if what == "constant" else "",
            ),
        ]  # fmt: skip
    return [*found, linear_at_constant_duty(), line_misses()]


def linear_at_constant_duty() -> Row:
    """Speed over torque at each PWM of a motor's bench (Fig. 4A), as (2) has it."""

    def least(motor: Chain) -> float:
        table = measure_bench(motor, Protocol(), Noise(), 0)
        kept = table.where(usable(table))
        groups = [kept.where(kept.duty == duty) for duty in np.unique(kept.duty)]
        return min(float(np.corrcoef(g.torque, g.speed)[0, 1] ** 2) for g in groups if np.ptp(g.torque) > SPANNED)

    motor = load_chain(MOTOR)
    return Row(
        "at a constant PWM the speed is linear in the torque, least R2", "III-C, Fig. 4A", 1.0, least(motor),
        "predicted", "", 0.05, judged=f"assumed: over 0.95 at every PWM that spans more than {SPANNED:g} N.m",
        rests=("bench_motor", "bench_noise", "spurious"),
        sensitivity=tuple(Otherwise(label, least(other)) for label, other in other_motors(motor).items()),
    )  # fmt: skip


def other_motors(motor: Chain) -> dict[str, Chain]:
    """A motor's chain without what makes it no line, one effect at a time."""
    return {
        "a supply that does not sag": motor.with_value("supply.resistance", 0.0),
        "a gear that loses the same under load": motor.with_value("friction.load", 0.0),
        "friction that does not fall with speed": motor.with_value("friction.stribeck", 0.0),
    }


def line_misses() -> Row:
    """Where a line misses a bench whose servo is none: the paper sees it at high PWM and low speed (III-C)."""
    motor = load_chain(MOTOR)

    def found(chain: Chain) -> tuple[str, bool]:
        table = measure_bench(chain, Protocol(repeats=1), Noise(), 0)
        off = misses(table, fit_regression(table))
        corner, small, large = off.values()
        said = ", ".join(f"{name}: {1e3 * value:.0f}" for name, value in off.items())
        return said, corner > 1.1 * max(small, large)

    said, agrees = found(motor)
    return Row(
        "the line misses at high PWM and low speed, not below 0.8 N.m", "III-C", "stated", said, "predicted",
        "N.mm rms", agrees=agrees, judged="assumed: there by a tenth more than in either part of the rest",
        sensitivity=tuple(Otherwise(label, found(chain)[0]) for label, chain in other_motors(motor).items()),
        rests=("bench_motor", "bench_noise", "spurious", "parts_of_the_bench"),
        note=f"of {MOTOR}, a motor with a supply that sags and a gear that loses under load, not of a line",
    )  # fmt: skip


def rows(
    cases: Mapping[str, Hops],
    figures: Mapping[str, Figures],
    speed: Mapping[str, Mapping[str, float]],
    seconds: float,
) -> list[Row]:
    """All rows, from recordings, figures and cost of both cases; the predictions hop again, for ``seconds`` each."""
    blind = hop_blind(seconds)
    return [
        *input_rows(),
        *bench_rows(),
        *fitted_rows(figures, blind.figures),
        *predicted_rows(blind),
        *use_rows(cases, figures, blind),
        *other_rows(figures[REAL], seconds),
        *cost_rows(speed),
    ]
