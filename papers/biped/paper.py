"""The experiments of the paper on the virtual MABEL: identification, spring, hopping, and how far choices matter."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...actuators import Chain
from ...envs.biped.drive import DRIVES, PULLEYS, SPRING_RATIO, torque_chain
from ...envs.biped.robot import BIPED
from .choices import TUNED_ON_RIGID
from .controller import Gait
from .hopping import SETTLED, Hopping, HoppingExperiment, flight_share, hop_times, rigid_cables
from .identification import (
    Cable,
    Leg,
    Motor,
    Pulleys,
    Spring,
    fit_cable,
    fit_leg,
    fit_motor,
    fit_pulleys,
    fit_spring,
)
from .rig import cable_record, leg_load, leg_record, noise_of, pulleys_record, spring_postures
from .tables import TABLE_IV, pulley_inertia

HOPS = 92  # VIII-D
SHOWN = (31, 32)  # hops of Fig. 21 to 23
SUBSTEPS = 4  # of the engine in a millisecond of the controller; convergence in docs/results/biped.md
CHOSEN, NO_UPDATE, NO_BIAS = "as chosen", "K_Tor (printed)", "amplifier biases"
TORSO = ("torso_mass", "torso_inertia")
PRINTED_SPRING_DAMPING = 15.0  # [N.m.s/rad] K_dB as table VI reads
AS_PRINTED = f"K_dB {PRINTED_SPRING_DAMPING:g}, as printed"
ON_RIGID = "gains tuned on rigid cables"
TUNED, RIGID, STRETCHING = "the machine of the search", "rigid", "stretching"
STIFFER = 100.0  # times the printed stiffness, which is rigid


@dataclass(frozen=True)
class Identified:
    """What the stages found of one drive.

    Attributes:
        pulleys: for each combination, tables III and, by the bias, IV.
        motor: table IV.
        leg: table V.
        stiff: likewise, had its cables been :data:`STIFFER` times as stiff.
        cable: table VI.
    """

    pulleys: tuple[Pulleys, ...]
    motor: Motor
    leg: Leg
    stiff: Leg
    cable: Cable


def identify(name: str, hopping: Hopping) -> Identified:
    """Take one drive through all stages, each on what the ones before found."""
    rng = noise_of(name)
    drive, values = DRIVES[name], BIPED.parameters()
    pulleys = tuple(fit_pulleys(pulleys_record(name, step, rng)) for step in range(3))
    drawn = [pulley_inertia(name, step) for step in range(3)]
    motor = fit_motor([item.inertia for item in pulleys], drawn, drive.rotor_inertia)
    inertia = motor.factor * drive.rotor_inertia + PULLEYS[drive.kind][2]
    leg, stiff = (
        fit_leg(leg_record(name, rng, times), leg_load(values, drive.kind), drive.ratio, motor.constant, inertia)
        for times in (1.0, STIFFER)
    )
    record, stretch = cable_record(hopping, name, rng)
    cable = fit_cable(record, stretch, motor.constant, inertia, leg.friction, leg.bias)
    return Identified(pulleys, motor, leg, stiff, cable)


@dataclass(frozen=True)
class SpringTest:
    """Fig. 19 of one side: loads and deflections, and the line through them.

    Attributes:
        torque: W sin(q_LS) / 5.18 (n,) [N.m].
        deflection: (n,) [rad].
        spring: the line.
        stretch: of the cable (n,) [rad at the motor].
    """

    torque: np.ndarray
    deflection: np.ndarray
    spring: Spring
    stretch: np.ndarray


def spring_test(side: str) -> SpringTest:
    """Stand on one leg in several shapes and fit the spring."""
    weight, shape, deflection, stretch = spring_postures(side, noise_of(f"{side} spring"))
    spring = fit_spring(weight, shape, deflection, SPRING_RATIO)
    return SpringTest(weight * np.sin(shape) / SPRING_RATIO, deflection, spring, stretch)


@dataclass(frozen=True)
class Figures:
    """Of a run of hopping.

    Attributes:
        hops: touchdowns, the end or a fall after them not counted.
        fell: whether it ended in a fall.
        period: of a hop [s], mean after the first eight; nan where there are too few.
        spread: its standard deviation over its mean.
        flight: share of the time in the air.
        travel: forward per hop [m].
    """

    hops: int
    fell: bool
    period: float
    spread: float
    flight: float
    travel: float


def measure(hopping: Hopping) -> Figures:
    """Figures of a recording."""
    times = hop_times(hopping)
    periods = np.diff(times)[SETTLED:]
    mean = float(periods.mean()) if len(periods) else math.nan
    travel = float(hopping.hip[-1, 0] / max(hopping.hops, 1))
    spread = float(periods.std() / mean) if len(periods) > 1 else math.nan
    return Figures(max(hopping.hops - 1, 0), hopping.fell, mean, spread, flight_share(hopping), travel)


def hop(hops: int) -> tuple[Hopping, Hopping]:
    """The experiment with stretching cables, and its two shown hops again on rigid ones from the same state.

    Returns:
        The whole recording, and that of the rigid cables from the touchdown of hop 31 on until two hops later or the
        fall; empty where the first one fell before.
    """
    experiment = HoppingExperiment(substeps=SUBSTEPS)
    before = experiment.run(SHOWN[0] - 1)
    if before.fell:
        return before, before.rows(slice(0, 0))
    rigid = HoppingExperiment(chains=rigid_cables, substeps=SUBSTEPS)
    rigid.start_from(experiment)
    after = experiment.run(hops)
    return before.then(after), rigid.run(SHOWN[1], seconds=3.0)


def said(figures: Figures) -> str:
    """How hopping went, in words."""
    return f"{figures.hops} hops{', then a fall' if figures.fell else ''}"


@dataclass(frozen=True)
class Change:
    """One assumed number, another value, and what it does.

    Attributes:
        name: of the number.
        value: as text.
        figures: of hopping with it.
    """

    name: str
    value: str
    figures: Figures


def changes() -> list[tuple[str, str, dict[str, Any]]]:
    """Name, value and arguments of every run that shows how far an assumed number matters."""
    gait, values = Gait(), BIPED.parameters()
    rows: list[tuple[str, str, dict[str, Any]]] = [(CHOSEN, "", {})]
    for name, other in (("boom_length", 2.6), ("boom_length", 3.1), ("foot_radius", 0.01), ("foot_radius", 0.03)):
        rows.append((name, f"{other:g} m", {"params": {name: other}}))
    contact = {name: values[f"contact_{name}"] for name in ("time", "damping", "low", "high", "width")}
    for factor, word in ((0.7, "harder"), (1.4, "softer")):
        rows.append(
            ("contact_time", f"{factor:g} times: {word}", {"params": {"contact_time": factor * contact["time"]}})
        )
    rows.append(("contact_damping", "1", {"params": {"contact_damping": 1.0}}))
    rows += [("floor_friction", f"{mu:g}", {"params": {"floor_friction": mu}}) for mu in (0.6, 1.0)]
    rows += [("encoders of joints and boom", f"2^{k} a turn", {"joint_ticks": 2**k}) for k in (14, 20)]
    for factor in (0.8, 1.25):
        gains, dampings = (tuple(factor * value for value in pair) for pair in (gait.gains, gait.dampings))
        rows.append(("gains K_p", f"{factor:g} times", {"gait": replace(gait, gains=gains)}))
        rows.append(("gains K_d", f"{factor:g} times", {"gait": replace(gait, dampings=dampings)}))
        limits = tuple(factor * value for value in gait.limits)
        rows.append(("torque limits", f"{factor:g} times", {"gait": replace(gait, limits=limits)}))
    for degrees in (4.0, 12.0):
        rows.append(("lean eta_Tor0", f"{degrees:g} deg", {"gait": replace(gait, torso=math.radians(degrees))}))
    rows.append(("travel delta_phi_d", "0", {"gait": replace(gait, travel=0.0)}))
    rows.append(("travel delta_phi_d", "-6.9 deg", {"gait": replace(gait, travel=math.radians(-6.9))}))
    rows.append((NO_UPDATE, "0: no update", {"gait": replace(gait, torso_gain=0.0)}))
    for factor in (0.85, 1.09):
        rows.append(("cable of right leg angle", f"K_C {3.5 * factor:.2f} N.m/rad", {"chains": _right_cable(factor)}))
    rows.append((NO_BIAS, "0", {"chains": lambda name: torque_chain(name).without_stage("offset")}))
    rows += [(name, f"{f:g} times", {"params": {name: f * values[name]}}) for name in TORSO for f in (0.9, 1.1)]
    rows.append(("damping of the springs", AS_PRINTED, {"chains": springs_as_printed}))
    rows.append(("motor constants", "as table IV stands", {"chains": _constants_as_printed}))
    rows.append(("cables", RIGID, {"chains": rigid_cables}))
    # on machines that the search did not see: what was kept because it lasted there may not last anywhere else
    others: tuple[dict[str, Any], ...] = ({"params": {"foot_radius": 0.021}}, {"joint_ticks": 2**19})
    for tuned in TUNED_ON_RIGID:
        own = {"gait": tuned, "substeps": SUBSTEPS}
        rows.append((ON_RIGID, TUNED, {**own, "chains": rigid_cables}))
        rows += [
            (ON_RIGID, cables, {**own, **other, "chains": chains})
            for other in others
            for cables, chains in ((RIGID, rigid_cables), (STRETCHING, torque_chain))
        ]
    return rows


def _right_cable(factor: float) -> Callable[[str], Any]:
    def chains(name: str) -> Any:
        chain, path = torque_chain(name), "compliance.stiffness"
        return chain.with_value(path, factor * chain.value(path)) if name == "right_leg_angle" else chain

    return chains


def _constants_as_printed(name: str) -> Any:
    chain = torque_chain(name)
    return chain.with_value("scale.factor", 1.0 / TABLE_IV[name]) if name in TABLE_IV else chain


def springs_as_printed(name: str) -> Chain:
    """The drive with K_dB of its spring as table VI reads."""
    chain, path = torque_chain(name), "spring.damping"
    return chain.with_value(path, PRINTED_SPRING_DAMPING * SPRING_RATIO**2) if chain.find("spring") else chain


def sensitivity(seconds: float, say: Callable[[str], None]) -> list[Change]:
    """Hop for ``seconds`` with each of :func:`changes`."""
    results = []
    for name, value, arguments in changes():
        figures = measure(HoppingExperiment(**{"substeps": 2, **arguments}).run(10_000, seconds))
        results.append(Change(name, value, figures))
        say(f"  {name} {value}: {figures.hops} hops{', fell' if figures.fell else ''}")
    return results
