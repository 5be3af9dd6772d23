"""Printed figures and statements of the hopper's paper beside ours, each with its mark."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.signal import find_peaks

from ...actuators import Chain, load_chain
from ...common.errors import SealegsError
from ..published import Mark, Otherwise, Row
from . import choices, paper
from .paper import CHAINS, CONTROL_STEP, PRINTED, Figures, Hops, Legs, by_period, flexions, measure
from .servo_rows import bench_rows, constant_as_friction, input_rows, servo

REAL, IDEAL = CHAINS
HARDWARE = "hardware"
NEARLY = ((0.096, 0.084), (0.104, 0.084), (0.104, 0.088))  # [m] next best lengths on the leg without actuator
LONGER = ((0.112, 0.092), (0.116, 0.096))  # [m] lengths that fit all four figures better, at the edge of a gait
HARDWARE_GAIN = 55.0  # K_P of the hardware, IV-B
USED = 0.8  # [N.m] the largest torque of the paper's use case, section III-B
STANDS = 0.1  # rad/s below which a motor stands
PLAYS = (0.0175, 0.035)  # [rad] of gears that have one
REGULAR = 0.02  # spread of a period over its mean
SLIPPERY = (0.8, 0.5)
"""Frictions of the ground below the simulation's 1.0; that of the hardware is not printed."""
DAMPINGS = (0.0, 0.25, 0.45)  # [N.m.s/rad] of the gear, beside the printed 0.35
TENTH = "assumed: a tenth; the paper's own simulation is off its hardware by 14 % and 20 %"
BLIND = (*choices.BLIND, *choices.MODEL)
CHOSEN = (*choices.LENGTHS, *choices.MODEL)


def lengths(pair: tuple[float, float]) -> dict[str, float]:
    """Numbers of the robot with these lengths of upper and lower link [m]."""
    return {"upper_length": pair[0], "lower_length": pair[1]}


def flexion(hops: Hops) -> float:
    """Largest angle between both links, mean over the hops [rad]."""
    bend = by_period(hops, hops.link[:, 1] - hops.link[:, 0])
    return float(bend.max(axis=1).mean())


def before_flexion(hops: Hops, values: np.ndarray) -> float:
    """Mean of ``values`` (n,) in the last tenth of each period, before the greatest flexion."""
    found = by_period(hops, values)
    return float(found[:, int(0.9 * found.shape[1]) :].mean())


def creep(hops: Hops) -> float:
    """Mean speed of the hip's motor before the greatest flexion [rad/s]."""
    return before_flexion(hops, np.abs(hops.motor_speed[:, 0]))


def at_its_limit(hops: Hops, chain: Chain) -> float:
    """Share of the time before the greatest flexion in which the hip's servo has its full duty."""
    duty = chain.value("position_p.gain") * np.abs(hops.goal[:, 0] - hops.motor[:, 0])
    return before_flexion(hops, (duty >= chain.value("duty_limit.limit")).astype(float))


def peaks_in_flight(hops: Hops) -> float:
    """Peaks of the speed of the hip's motor while the foot is in the air, a hop."""
    starts = flexions(hops)
    peaks = find_peaks(np.abs(hops.motor_speed[:, 0]), prominence=paper.PEAK)[0]
    peaks = peaks[(peaks >= starts[0]) & (peaks < starts[-1])]
    return float((hops.clearance[peaks] > 1e-4).sum()) / (len(starts) - 1)


def trigger(hops: Hops) -> float:
    """Time from touchdown to the control signal, mean over the hops [s]."""
    floor = hops.clearance <= 1e-4
    signal = np.abs(hops.goal[:, 1] - hops.goal[0, 1]) > 1e-6
    flight = round(0.03 / CONTROL_STEP)  # samples in the air that make a touchdown
    later = [k for k in np.flatnonzero(floor & (hops.time > paper.SETTLING)) if not floor[k - flight : k].any()]
    delays = [np.argmax(signal[k:]) for k in later if signal[k:].any()]
    return float(np.mean(delays)) * CONTROL_STEP


def apart(one: Hops, other: Hops) -> float:
    """Difference of the hip's link over the period, rms over the range of the first."""
    first, second = (by_period(hops, hops.link[:, 0]).mean(axis=0) for hops in (one, other))
    return float(np.sqrt(np.mean((first - second) ** 2)) / np.ptp(first))


def captured(one: Hops, other: Hops) -> float:
    """Share of the variance of the first hip's link over the period that the other's has."""
    first, second = (by_period(hops, hops.link[:, 0]).mean(axis=0) for hops in (one, other))
    return 1.0 - float(np.mean((first - second) ** 2) / np.var(first))


@dataclass(frozen=True)
class Found:
    """What the rows are made of.

    Attributes:
        cases: both cases of the paper, with the lengths that fit all of its figures.
        longer: likewise, with longer ones.
        blind: likewise with the lengths that fit those without actuator, which know nothing of the servo; and with the
            hardware's K_P.
        others: the latter with something else assumed otherwise, by its name.
        signals: without actuator, under other control parameters.
        damped: with actuator, by damping of the gear [N.m.s/rad]; lengths as of ``blind``.
        slippery: with actuator, by friction of the ground; likewise.
        fitted_slippery: likewise, with lengths as of ``cases``.
        speed: simulated time over the time that it takes, by case and number of legs.
    """

    cases: Mapping[str, Hops]
    longer: Mapping[str, Mapping[str, Hops]]
    blind: Mapping[str, Hops]
    others: Mapping[str, Mapping[str, Hops]]
    signals: Mapping[str, Hops]
    damped: Mapping[float, Hops]
    slippery: Mapping[float, Hops]
    fitted_slippery: Mapping[float, Hops]
    speed: Mapping[str, Mapping[str, float]]


def run(seconds: float, say: Callable[[str], None], timed: float = 2.0) -> Found:
    """Hop for so long [s] in each case; measure the cost in simulations of ``timed`` [s]."""
    own = lengths(choices.BLIND_LENGTHS)

    def hop(params: Mapping[str, float], changed: Callable[[Chain], Chain] = lambda chain: chain) -> dict[str, Hops]:
        """Without actuator, with it, and with the hardware's K_P."""
        chains = {
            REAL: changed(load_chain(CHAINS[REAL])), IDEAL: CHAINS[IDEAL], HARDWARE: changed(servo(HARDWARE_GAIN))
        }  # fmt: skip
        return {name: Legs(chain, params=params).hop(seconds) for name, chain in chains.items()}

    say(f"hopping {seconds:g} s with and without actuator")
    cases = {name: Legs(source).hop(seconds) for name, source in CHAINS.items()}
    say("hopping with link lengths that know nothing of the servo")
    others = {f"links of {a:g} and {b:g} m": hop(lengths((a, b))) for a, b in NEARLY}
    others["the constant of (3) as friction"] = hop(own, constant_as_friction)
    for play in PLAYS:
        others[f"a play of {np.degrees(play):.0f} deg"] = hop(own, partial(with_play, width=play))
    return Found(
        cases,
        longer={f"links of {a:g} and {b:g} m": hop(lengths((a, b))) for a, b in LONGER},
        blind=hop(own),
        others=others,
        signals={
            f"amplitude {a:g} rad, threshold {t:g} N.m": under(own, a, t).hop(seconds) for a, t in choices.SIGNALS
        },
        damped={d: Legs(servo().with_value("friction.viscous", d), params=own).hop(seconds) for d in DAMPINGS},
        slippery={mu: Legs(CHAINS[REAL], params={**own, "floor_friction": mu}).hop(seconds) for mu in SLIPPERY},
        fitted_slippery={mu: Legs(CHAINS[REAL], params={"floor_friction": mu}).hop(seconds) for mu in SLIPPERY},
        speed={
            name: {str(count): Legs(source, count).real_time_factor(timed) for count in (1, 4)}
            for name, source in CHAINS.items()
        },
    )


def with_play(chain: Chain, width: float) -> Chain:
    """A servo whose gear has a play [rad]."""
    return load_chain([*chain.to_list(), {"backlash": {"width": width}}])


def under(params: Mapping[str, float], amplitude: float, threshold: float) -> Legs:
    """A leg without actuator under other control parameters."""
    legs = Legs(CHAINS[IDEAL], params=params)
    legs.controller = replace(legs.controller, amplitude=amplitude, threshold=threshold)
    return legs


def hopped(hops: Hops) -> list[Figures]:
    """Its figures; none where the leg does not hop."""
    try:
        return [measure(hops)]
    except SealegsError:
        return []


def told(figures: Figures) -> str:
    """Frequency and height in words."""
    return f"{figures.frequency:.2f} Hz, {100.0 * figures.height:.1f} cm"


def figure_rows(
    label: str, case: str, hops: Hops, mark: Mark, rests: tuple[str, ...],
    others: Mapping[str, Hops] | None = None, rival: Hops | None = None, note: str = "",
) -> list[Row]:  # fmt: skip
    """Frequency and height of a case, called ``label``, beside the printed ones."""
    figures, found = measure(hops), []
    for what, unit, factor in (("frequency", "Hz", 1.0), ("height", "cm", 100.0)):

        def of(hops: Hops, what: str = what, factor: float = factor) -> float:
            return factor * getattr(measure(hops), what)

        readings = (
            Otherwise("height from standing", 100.0 * figures.rise),
            Otherwise("height as the foot's clearance", 100.0 * figures.clearance),
        )
        found.append(
            Row(
                f"{what} {label}", "IV-E", factor * getattr(PRINTED[case], what), of(hops), mark, unit, 0.1,
                judged=TENTH, rests=rests if what == "frequency" else (*rests, "height_of_a_jump"), note=note,
                sensitivity=(
                    *(Otherwise(name, of(other)) for name, other in (others or {}).items()),
                    *(readings if what == "height" else ()),
                ),
                rival=None if rival is None else Otherwise("ideal motors", of(rival)),
            )
        )  # fmt: skip
    return found


def hopping_rows(found: Found) -> list[Row]:
    """Frequencies and heights: fitted, and what the leg without actuator says about the one with it."""
    rows: list[Row] = []
    for name, hops in found.cases.items():
        longer = {label: pair[name] for label, pair in found.longer.items()}
        rows += figure_rows(name, name, hops, "fitted", CHOSEN, longer)
    rows += figure_rows(f"{IDEAL}, lengths from it", IDEAL, found.blind[IDEAL], "fitted", BLIND)
    others = {label: hops[HARDWARE] for label, hops in found.others.items()}
    with_75 = {"K_P = 75, as in the simulation": found.blind[REAL]}
    rows += figure_rows(
        "of the hardware", HARDWARE, found.blind[HARDWARE], "predicted", BLIND, others={**others, **with_75},
        rival=found.blind[IDEAL],
        note=f"with the hardware's K_P = {HARDWARE_GAIN:g}; the wear of its gears is not printed",
    )  # fmt: skip
    rows += figure_rows(
        f"{REAL}, lengths from the leg without", REAL, found.blind[REAL], "predicted", BLIND,
        {f"K_P = {HARDWARE_GAIN:g}, as on the hardware": found.blind[HARDWARE]}, found.blind[IDEAL],
    )  # fmt: skip
    hardware = PRINTED["hardware"]
    tried = {name: figures for name, hops in found.signals.items() for figures in hopped(hops)}

    def off(figures: Figures) -> float:
        return max(abs(figures.frequency / hardware.frequency - 1.0), abs(figures.height / hardware.height - 1.0))

    best, *next_best = sorted(tried, key=lambda name: off(tried[name]))[:3]
    return [
        *rows,
        Row(
            choices.UNSUITED, "V-A", "likely", f"{best}: {told(tried[best])}", "fitted",
            agrees=off(tried[best]) < off(measure(found.blind[IDEAL])),
            judged="others come nearer to the hardware, or not", rests=(*BLIND, "height_of_a_jump", "other_signals"),
            sensitivity=tuple(Otherwise(name, told(tried[name])) for name in next_best),
            note=f"with the printed ones {told(measure(found.blind[IDEAL]))}; the hardware has "
            f"{hardware.frequency:g} Hz, {100.0 * hardware.height:g} cm",
        ),
    ]  # fmt: skip


def compared_rows(found: Found) -> list[Row]:
    """What differs without actuator, each with the hardware's lengths unknown."""

    def row(name: str, printed: str, of: Callable[[Hops, Hops], tuple[str, bool]], judged: str) -> Row:
        """A row of what is said with actuator and without, in this order."""
        ours, agrees = of(found.blind[REAL], found.blind[IDEAL])
        return Row(
            f"without actuator {name}", "IV-E", printed, ours, "predicted", agrees=agrees, judged=judged, rests=BLIND,
            sensitivity=tuple(
                Otherwise(label, of(hops[REAL], hops[IDEAL])[0]) for label, hops in found.others.items()
            ),
        )  # fmt: skip

    return [
        row(
            "the leg flexes less", "less",
            lambda real, ideal: (f"{flexion(ideal):.2f} under {flexion(real):.2f} rad", flexion(ideal) < flexion(real)),
            "less or not",
        ),
        row(
            "the signal comes earlier", "earlier",
            lambda real, ideal: (f"{1e3 * trigger(ideal):.0f} ms after touchdown, with it {1e3 * trigger(real):.0f}",
                                 trigger(ideal) < trigger(real)), "earlier or not",
        ),
        row(
            "the hip's link moves clearly otherwise over the period", "clearly",
            lambda real, ideal: (f"{apart(real, ideal):.0%} of its range, rms", apart(real, ideal) > 0.1),
            "assumed: over a tenth",
        ),
        row(
            "the hip's link moves roughly alike over the period", "roughly",
            lambda real, ideal: (f"{captured(real, ideal):.0%} of its variance", captured(real, ideal) > 0.5),
            "assumed: over half",
        ),
    ]  # fmt: skip


def use_rows(found: Found) -> list[Row]:
    """What else is said of hopping."""
    real = found.blind[REAL]
    fitted = {"lengths that fit all four figures": found.cases[REAL]}
    others = {**fitted, f"K_P = {HARDWARE_GAIN:g}": found.blind[HARDWARE]}
    plays = {name: hops[REAL] for name, hops in found.others.items() if "play" in name}
    spread = [measure(hops).regularity for hops in found.blind.values()]
    full, chain = at_its_limit(real, servo()), servo()
    reached = np.degrees(chain.value("duty_limit.limit") / chain.value("position_p.gain"))

    def row(name: str, where: str, printed: Any, of: Callable[[Hops], Any], agrees: bool, judged: str, note: str = "",
            changed: Mapping[str, Hops] = others, unit: str = "", rests: tuple[str, ...] = BLIND) -> Row:  # fmt: skip
        return Row(
            name, where, printed, of(real), "predicted", unit, agrees=agrees, judged=judged, rests=rests,
            sensitivity=tuple(Otherwise(label, of(hops)) for label, hops in changed.items()), note=note,
        )  # fmt: skip

    return [
        Row(
            choices.HOPS, "IV-B, IV-E", "stated", ", ".join(f"{value:.2%}" for value in spread) + " of the period",
            "fitted", agrees=max(spread) < REGULAR, judged=f"assumed: under {REGULAR:.0%}", rests=BLIND,
            note="the paper left out the D part because the gear damps enough",
        ),
        row(
            "hip motor stands in the flexion: a plateau", "IV-E", "stands", lambda hops: f"{creep(hops):.2f} rad/s",
            creep(real) < STANDS, f"assumed: under {STANDS:g} rad/s",
        ),
        Row(
            "the hip is overloaded in the flexion", "IV-E, V-A", "stated", f"full duty in {full:.0%} of its last tenth",
            "predicted", agrees=full > 0.5, judged="assumed: over half of it", rests=BLIND,
            sensitivity=tuple(Otherwise(label, f"{at_its_limit(hops, chain):.0%}") for label, hops in fitted.items()),
            note=f"full duty is reached {reached:.1f} deg off the goal, so that it hardly can fail. The servo turns "
            "on all the same; how much it may take is not printed",
        ),
        row(
            "peaks of the hip motor's speed in flight, a hop", "IV-E, V-A", "absent",
            lambda hops: f"{peaks_in_flight(hops):.1f}", peaks_in_flight(real) < 1.5,
            "assumed: none but the one of the goal", note="the motor swings about its goal; a play adds none to that",
            changed=plays, rests=(*BLIND, "peak"),
        ),
        row(
            "torques of the use case, at most", "III-C", USED, lambda hops: measure(hops).torque,
            measure(real).torque <= USED, "a bound", "the landing drives the motor back at full duty", unit="N.m",
        ),
    ]  # fmt: skip


def other_rows(found: Found) -> list[Row]:
    """What the paper says of numbers that it did not change: damping of the gear and friction of the ground."""
    figures = measure(found.blind[REAL])
    damped = {value: measure(hops) for value, hops in found.damped.items()}
    slippery = {mu: measure(hops) for mu, hops in found.slippery.items()}

    fitted = {1.0: found.cases[REAL], **found.fitted_slippery}

    def closely(value: Figures) -> str:
        return f"{value.frequency:.3f} Hz, {100.0 * value.height:.2f} cm"

    def moved(value: Figures) -> float:
        return max(abs(value.frequency / figures.frequency - 1.0), abs(value.height / figures.height - 1.0))

    rough = [value for value in damped if value]
    most, without = max(moved(damped[value]) for value in rough), moved(damped[0.0])
    rests = (*BLIND, "height_of_a_jump")
    return [
        Row(
            "a rough damping of the gear suffices", "V-B", "likely",
            f"{most:.0%} of frequency or height for 30 % of it", "predicted", agrees=most < 0.1,
            judged="assumed: under 10 %", rests=rests,
            sensitivity=tuple(Otherwise(f"{value:g} N.m.s/rad", told(damped[value])) for value in rough),
        ),
        Row(
            "the damping of the gear is essential", "V-B", "stated",
            f"without it {without:.0%} of frequency or height: {told(damped[0.0])}", "predicted", agrees=without > 0.1,
            judged="assumed: over 10 %", rests=rests,
        ),
        Row(
            "on a ground with less friction it jumps lower and faster", "V-A", "likely",
            f"mu = 1: {closely(figures)}", "predicted",
            agrees=all(
                value.height < figures.height and value.frequency > figures.frequency for value in slippery.values()
            ),
            judged=f"lower and faster at mu = {' and '.join(f'{mu:g}' for mu in slippery)}, or not", rests=rests,
            sensitivity=(
                *(Otherwise(f"mu = {mu:g}", closely(value)) for mu, value in slippery.items()),
                Otherwise(
                    "lengths that fit all four figures",
                    "; ".join(f"mu = {mu:g}: {closely(measure(hops))}" for mu, hops in fitted.items()),
                ),
            ),
            note="the hardware's friction is not printed",
        ),
    ]  # fmt: skip


def cost_rows(speed: Mapping[str, Mapping[str, float]]) -> list[Row]:
    """Time that the simulation takes, by case and number of legs, over real time."""
    one = [speed[name]["1"] / CONTROL_STEP / 1e3 for name in CHAINS]
    note = "not judged: it measures this computer and its load, and another engine"
    slower = "more" if one[0] < one[1] else "not more"
    return [
        Row(
            "updates of one leg, with and without actuator", "IV-E", "more than 3 kHz",
            f"{one[0]:.0f} and {one[1]:.0f} kHz", "predicted", rests=CHOSEN, timed=True, note=note,
        ),
        Row(
            "computing time with actuator over that without", "abstract, V-B", "not more", f"{one[1] / one[0]:.2f}",
            "predicted", rests=CHOSEN, timed=True, note=f"it takes {slower}; {note}",
        ),
        Row(
            "four legs with actuators over real time", "IV-E", "0.9", f"{speed[REAL]['4']:.0f}", "predicted",
            rests=(*CHOSEN, "leg_distance"), timed=True, note=note,
        ),
    ]  # fmt: skip


def rows(found: Found) -> list[Row]:
    """All rows."""
    return [
        *input_rows(),
        *bench_rows(),
        *hopping_rows(found),
        *compared_rows(found),
        *use_rows(found),
        *other_rows(found),
        *cost_rows(found.speed),
    ]
