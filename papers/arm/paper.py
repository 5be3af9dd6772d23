"""The experiments of the paper (paper 002, section 5), and what they leave open."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from ...envs.arm.parameters import without_rotors
from ...envs.arm.tables import DAMPING, JOINTS, STIFFNESS
from ...envs.arm.trajectory import Line
from .axes import SIMPLE_HINGES, SIMPLE_TORQUES, tilt
from .control import Robust, closed_loop, mass_matrices
from .dynamics import (
    FINAL_MODEL,
    PERFECT,
    Joints,
    Motion,
    Three,
    Torques,
    ideal_torques,
    open_loop,
    spinning_torques,
)
from .readings import Outcome, outcome, readings, referred

MARKS = (1.0, 30.0)  # [mm] of section 5.1
STATOR = np.logspace(-7.0, 1.0, 17)  # k_r between stator and rotor, alike in all joints [N.m/rad]
SPRING = np.logspace(-2.0, 3.0, 11)  # k_r between rotor and link, likewise
DAMPINGS = np.logspace(-5.0, 1.0, 13)  # c_r of one joint [N.m.s/rad]; the paper's range is not printed
BASES = (1e-4, 1e-3, 1e-2, 1e-1)  # c_r of two joints beside which the third's is changed
BESIDE = (0.0, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0)  # that third c_r
SOFTEST = 0.01  # of table X's softest spring: a real joint is stiffer, assumed
HIGHEST = 0.1  # [N.m.s/rad] the c_r1 for which c_r3 is drawn: the tool still follows the line
STEPS = (0.001, 0.0005)  # [s] of arms with springs, to see what the step does
SLOWER = 4.0  # times the paper's time of a slow motion
SMOOTHING = (5, 7, 9, 11)  # degrees of polynomials that smooth the torques; the paper's is not printed


@dataclass(frozen=True)
class Results:
    """Everything that is compared with the paper.

    Attributes:
        final: table X under the torques of the ideal arm.
        parts: table X's springs alone, and the same springs between stator and rotor.
        stator: largest deviation [mm] with each of :data:`STATOR`.
        spring: with each of :data:`SPRING`.
        damping: motions with each of :data:`DAMPINGS` in one joint, by joint.
        third: motions by c_r1, each of :data:`DAMPINGS`, and c_r3, each of :data:`BESIDE`.
        changed: motions by joint, by c_r of the two other joints, each of :data:`BASES`, and by its own c_r.
        crossing: motions with each of :data:`BESIDE` in joint 3 alone.
        outcomes: of all readings of the final model.
        steps: table X's deviation [mm] by step of the simulation [ms].
        ideal: largest deviation of the ideal arm under its own torques [mm].
        tilted_torque: largest deviation of the ideal arm where the torque of joint 2 acts on table VII's axis [mm].
        varied: table X's deviation, its dampers' and its springs' [mm] with other assumptions.
        smoothed: largest deviation of the ideal arm [mm] by degree of the polynomials that smooth its torques.
        spinning: largest deviation of the ideal arm [mm] under the torques of rotors that only spin, by time of the
            motion [s].
        least_inertia: least eigenvalue of the mass matrix along the line [kg.m2].
        controlled: largest error [mm] by arm and controller.
    """

    final: Motion
    parts: dict[str, Motion]
    stator: np.ndarray
    spring: np.ndarray
    damping: dict[str, list[Motion]]
    third: dict[float, dict[float, Motion]]
    changed: dict[str, dict[float, dict[float, Motion]]]
    crossing: dict[float, Motion]
    outcomes: dict[str, Outcome]
    steps: dict[str, float]
    ideal: float
    tilted_torque: float
    varied: dict[str, tuple[float, float, float]]
    smoothed: dict[int, float]
    spinning: dict[float, float]
    least_inertia: float
    controlled: dict[str, dict[str, float]]


def with_damper(joint: int, value: float, others: float = 0.0) -> Joints:
    """A damper between stator and rotor of one joint, and of the others."""
    first, second, third = (value if k == joint else others for k in range(3))
    return Joints((first, second, third))


def alike(value: float) -> tuple[float, float, float]:
    """The same value in all joints."""
    return (value, value, value)


def changes() -> dict[str, dict[str, float]]:
    """Assumptions of the model and other values of them."""
    return {
        "products of inertia of the other sign": {"products": -1.0},
        "I_yz of rotor 1 of -1.12E-4": {"rotor1_iyz": -1.12e-4},
    }


def run(say: Callable[[str], None]) -> Results:
    """All experiments."""
    say("torques of the ideal robot on perfect, damped and sprung joints")
    damping, third, changed = parametric_study()
    ideal, held, *stator = open_loop(
        [
            PERFECT,
            Joints(stator_stiffness=STIFFNESS),
            *(Joints(stator_stiffness=alike(float(k))) for k in STATOR),
        ]
    )
    say("springs between rotors and links")
    sprung = Joints(link_stiffness=STIFFNESS)
    final, springs, *soft = open_loop(
        [FINAL_MODEL, sprung, *(Joints(link_stiffness=alike(float(value))) for value in SPRING)]
    )
    say("readings of the final model")
    outcomes = {name: outcome(reading) for name, reading in readings().items()}
    say("other assumptions")
    varied = {}
    for name, params in changes().items():
        only = open_loop([Joints(DAMPING)], params=params)[0].largest
        whole, alone = (motion.largest for motion in open_loop([FINAL_MODEL, sprung], params=params))
        varied[name] = (whole, only, alone)
    say("controllers")
    return Results(
        final=final,
        parts={"springs": springs, "springs at the stator": held},
        stator=_largest(stator),
        spring=_largest(soft),
        damping=damping,
        third=third,
        changed=changed,
        crossing=dict(zip(BESIDE, open_loop([with_damper(2, value) for value in BESIDE]), strict=True)),
        outcomes=outcomes,
        steps={f"{1e3 * step:g}": open_loop([FINAL_MODEL], elastic_step=step)[0].largest for step in STEPS},
        ideal=ideal.largest,
        tilted_torque=tilted_torque(),
        varied=varied,
        smoothed=smoothed(),
        spinning=spinning(),
        least_inertia=float(np.linalg.eigvalsh(mass_matrices(Line().joints(np.linspace(0.0, 5.0, 51))[0])).min()),
        controlled=controlled(),
    )


def parametric_study() -> tuple[
    dict[str, list[Motion]], dict[float, dict[float, Motion]], dict[str, dict[float, dict[float, Motion]]]
]:
    """Section 5.2: one damper alone by joint; c_r3 beside c_r1; and each damper beside two others."""
    dampings = [float(value) for value in DAMPINGS]
    cases = [with_damper(joint, value) for joint in range(3) for value in dampings]
    cases += [Joints((first, 0.0, value)) for first in dampings for value in BESIDE]
    cases += [with_damper(joint, value, base) for joint in range(3) for base in BASES for value in BESIDE]
    motions = iter(open_loop(cases))
    damping = {name: [next(motions) for _ in dampings] for name in JOINTS}
    third = {first: {value: next(motions) for value in BESIDE} for first in dampings}
    changed = {name: {base: {value: next(motions) for value in BESIDE} for base in BASES} for name in JOINTS}
    return damping, third, changed


def _largest(motions: Sequence[Motion]) -> np.ndarray:
    return np.array([motion.largest for motion in motions])


def tilted_torque() -> float:
    """Largest deviation of the ideal arm [mm] where the torque of joint 2 acts on table VII's axis, which leans."""
    points, hinge = SIMPLE_TORQUES[1], SIMPLE_HINGES[1]
    lean = np.radians(tilt(np.subtract(points[1], points[0]), np.subtract(hinge.on_first[1], hinge.on_first[0])))
    simple = without_rotors()
    whole = ideal_torques(Line(), simple)
    share = np.array([1.0, np.cos(lean), 1.0])
    return open_loop([PERFECT], params=simple, torques=lambda time: whole(time) * share)[0].largest


def smoothed() -> dict[int, float]:
    """Largest deviation [mm] of the ideal arm under torques smoothed by polynomials, by their degree."""
    line, found = Line(), {}
    moments = np.linspace(0.0, line.seconds, 400)
    exact = ideal_torques(line)(moments)
    for degree in SMOOTHING:
        found[degree] = open_loop([PERFECT], torques=_polynomial(moments, exact, degree, line.seconds))[0].largest
    return found


def spinning() -> dict[float, float]:
    """Largest deviation of the ideal arm [mm] under the torques of rotors that only spin, by time of the motion [s]."""
    lines = [Line(), Line(seconds=SLOWER * Line().seconds)]
    return {line.seconds: open_loop([PERFECT], line, torques=spinning_torques(line))[0].largest for line in lines}


def _polynomial(moments: np.ndarray, torques: np.ndarray, degree: int, seconds: float) -> Torques:
    fitted = chebyshev.chebfit(2.0 * moments / seconds - 1.0, torques, degree)
    return lambda time: chebyshev.chebval(2.0 * np.asarray(time) / seconds - 1.0, fitted).T


def controlled() -> dict[str, dict[str, float]]:
    """Largest error of the tool [mm] by arm and controller, which believes table VIII, or II where that is said."""
    damped = Joints(referred(3), link_stiffness=STIFFNESS)
    softer = Joints(DAMPING, link_stiffness=times(STIFFNESS, 0.1))
    arms: dict[str, tuple[Joints, Mapping[str, float] | None, Mapping[str, float] | None]] = {
        "table X": (FINAL_MODEL, None, None),
        "table X, motor referred": (damped, None, None),
        "a tenth of the stiffness": (softer, None, None),
        "0.1 kg at the tool": (FINAL_MODEL, {"payload_mass": 0.1}, None),
        "torques of table II": (FINAL_MODEL, None, without_rotors()),
    }
    controllers = {"computed torque": Robust(sliding=False), "robust": Robust()}
    found = {}
    for arm, (joints, params, believed) in arms.items():
        alone = open_loop([joints], params=params, torques=ideal_torques(Line(), believed))[0].largest
        found[arm] = {"open loop": alone} | {
            name: closed_loop(item, joints, params, believed).largest for name, item in controllers.items()
        }
    return found


def times(values: Three, factor: float) -> Three:
    """Each value times a factor."""
    return (factor * values[0], factor * values[1], factor * values[2])


def mark(values: np.ndarray, deviations: np.ndarray, level: float) -> float:
    """Where the deviation passes ``level`` [mm] for the first time, between the values on a log scale; nan: nowhere."""
    above = deviations > level
    passes = np.flatnonzero(above[1:] != above[:-1])
    if not len(passes):
        return float("nan")
    k = int(passes[0])
    x, y = np.log(values[k : k + 2]), np.log(np.maximum(deviations[k : k + 2], 1e-12))
    return float(np.exp(x[0] + (np.log(level) - y[0]) / (y[1] - y[0]) * (x[1] - x[0])))


def crossing_pairs(motions: Mapping[float, Motion]) -> list[tuple[float, float]]:
    """Dampings whose curves of the deviation over time cross by more than a tenth of a millimetre to both sides."""
    curves = [(value, 1e3 * motion.deviation) for value, motion in motions.items() if value > 0.0]
    found = []
    for k, (low, first) in enumerate(curves):
        for high, second in curves[k + 1 :]:
            gap = first - second
            if gap.max() > 0.1 and gap.min() < -0.1:
                found.append((low, high))
    return found
