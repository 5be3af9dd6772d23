"""The experiments of the paper (paper 002, section 5), and what they leave open."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from ...envs.arm.parameters import without_rotors
from ...envs.arm.tables import DAMPING, JOINTS, STIFFNESS
from ...envs.arm.trajectory import Line
from .control import Robust, closed_loop
from .dynamics import FINAL_MODEL, PERFECT, Joints, Motion, Three, Torques, ideal_torques, open_loop

MARKS = (1.0, 30.0)  # [mm] of section 5.1
STATOR = np.logspace(-7.0, 1.0, 17)  # k_r between stator and rotor, alike in all joints [N.m/rad]
SPRING = np.logspace(-2.0, 3.0, 11)  # k_r between rotor and link, likewise
DAMPINGS = np.logspace(-5.0, 1.0, 13)  # c_r of one joint [N.m.s/rad]; the paper's range is not printed
HIGHEST = 0.1  # [N.m.s/rad] the highest c_r1 beside which c_r3 is changed: the tool still follows the line
BESIDE = (0.0, 1e-4, 1e-3, 1e-2, 1e-1, 1.0)  # c_r3 beside it
LATE = 0.75  # share of the time after which the vertical motion is compared: the wanted one still rises
SMOOTHING = (5, 7, 9, 11)  # degrees of polynomials that smooth the torques; the paper's is not printed


@dataclass(frozen=True)
class Results:
    """Everything that is compared with the paper.

    Attributes:
        perfect: the ideal arm under its own torques.
        final: table X under them.
        parts: table X's dampers alone, and its springs alone.
        stator: largest deviation [mm] with each of :data:`STATOR`.
        spring: with each of :data:`SPRING`.
        damping: with each of :data:`DAMPINGS` in one joint, by joint.
        beside: motions with :data:`HIGHEST` in joint 1 and each of :data:`BESIDE` in joint 3.
        crossing: motions with each of :data:`BESIDE` in joint 3 alone.
        mixed: motions of the arm of table VIII under the torques of table II, by what else is changed.
        varied: table X's deviation, its dampers' and its springs' [mm] with other assumptions.
        smoothed: largest deviation of the ideal arm [mm] by degree of the polynomials that smooth its torques.
        controlled: largest error [mm] by arm and controller.
    """

    perfect: Motion
    final: Motion
    parts: dict[str, Motion]
    stator: np.ndarray
    spring: np.ndarray
    damping: dict[str, np.ndarray]
    beside: dict[float, Motion]
    crossing: dict[float, Motion]
    mixed: dict[str, Motion]
    varied: dict[str, tuple[float, float, float]]
    smoothed: dict[int, float]
    controlled: dict[str, dict[str, float]]


def one(joint: int, value: float) -> Joints:
    """A damper between stator and rotor of one joint alone."""
    damping = [0.0, 0.0, 0.0]
    damping[joint] = value
    return Joints((damping[0], damping[1], damping[2]))


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
    cases: list[Joints] = [PERFECT, Joints(DAMPING)]
    cases += [Joints(stator_stiffness=alike(float(value))) for value in STATOR]
    cases += [one(joint, float(value)) for joint in range(3) for value in DAMPINGS]
    cases += [Joints((HIGHEST, 0.0, value)) for value in BESIDE]
    cases += [one(2, value) for value in BESIDE]
    rigid = open_loop(cases)
    at = 2 + len(STATOR)
    grid = {name: rigid[at + k * len(DAMPINGS) : at + (k + 1) * len(DAMPINGS)] for k, name in enumerate(JOINTS)}
    at += 3 * len(DAMPINGS)
    say("springs between rotors and links")
    sprung = Joints(link_stiffness=STIFFNESS)
    elastic = open_loop([FINAL_MODEL, sprung, *(Joints(link_stiffness=alike(float(value))) for value in SPRING)])
    say("torques of tables II and III on the arm of tables VIII and IX")
    mixed = mixed_tables()
    say("other assumptions")
    varied = {}
    for name, params in changes().items():
        damped = open_loop([Joints(DAMPING)], params=params)[0].largest
        whole, springs = (motion.largest for motion in open_loop([FINAL_MODEL, sprung], params=params))
        varied[name] = (whole, damped, springs)
    say("controllers")
    return Results(
        perfect=rigid[0],
        final=elastic[0],
        parts={"dampers": rigid[1], "springs": elastic[1]},
        stator=_largest(rigid[2 : 2 + len(STATOR)]),
        spring=_largest(elastic[2:]),
        damping={name: _largest(motions) for name, motions in grid.items()},
        beside=dict(zip(BESIDE, rigid[at : at + len(BESIDE)], strict=True)),
        crossing=dict(zip(BESIDE, rigid[at + len(BESIDE) :], strict=True)),
        mixed=mixed,
        varied=varied,
        smoothed=smoothed(),
        controlled=controlled(),
    )


def _largest(motions: Sequence[Motion]) -> np.ndarray:
    return np.array([motion.largest for motion in motions])


def mixed_tables() -> dict[str, Motion]:
    """The arm of table VIII under the torques that the robotics approach gives with table II, by what is changed."""
    line, simple = Line(), without_rotors()
    other = changes()["products of inertia of the other sign"]
    arms: dict[str, tuple[Joints, dict[str, float] | None, dict[str, float]]] = {
        "": (PERFECT, None, simple),
        "table X's dampers": (Joints(DAMPING), None, simple),
        "products of inertia of the other sign": (PERFECT, other, simple | other),
    }
    return {
        name: open_loop([joints], params=params, torques=ideal_torques(line, believed))[0]
        for name, (joints, params, believed) in arms.items()
    }


def smoothed() -> dict[int, float]:
    """Largest deviation [mm] of the ideal arm under torques smoothed by polynomials, by their degree."""
    line, found = Line(), {}
    moments = np.linspace(0.0, line.seconds, 400)
    exact = ideal_torques(line)(moments)
    for degree in SMOOTHING:
        found[degree] = open_loop([PERFECT], torques=_polynomial(moments, exact, degree, line.seconds))[0].largest
    return found


def _polynomial(moments: np.ndarray, torques: np.ndarray, degree: int, seconds: float) -> Torques:
    fitted = chebyshev.chebfit(2.0 * moments / seconds - 1.0, torques, degree)
    return lambda time: chebyshev.chebval(2.0 * np.asarray(time) / seconds - 1.0, fitted).T


def controlled() -> dict[str, dict[str, float]]:
    """Largest error of the tool [mm] by arm and controller, which believes table VIII, or II where that is said."""
    damped = Joints(times(DAMPING, 100.0), link_stiffness=STIFFNESS)
    softer = Joints(DAMPING, link_stiffness=times(STIFFNESS, 0.1))
    arms: dict[str, tuple[Joints, Mapping[str, float] | None, Mapping[str, float] | None]] = {
        "table X": (FINAL_MODEL, None, None),
        "100 times the damping": (damped, None, None),
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


def late_rise(motion: Motion) -> tuple[float, float]:
    """How far the tool rises in the last quarter of the time, and how far it should [mm]."""
    start = int(LATE * (len(motion.time) - 1))
    found, wanted = (1e3 * float(place[-1, 2] - place[start, 2]) for place in (motion.tool, motion.wanted))
    return found, wanted


def crossings(motions: Mapping[float, Motion]) -> int:
    """How many pairs of curves of the deviation over time cross by more than a tenth of a millimetre to both sides."""
    curves = [1e3 * motion.deviation for value, motion in motions.items() if value > 0.0]
    count = 0
    for k, first in enumerate(curves):
        for second in curves[k + 1 :]:
            gap = first - second
            count += bool(gap.max() > 0.1 and gap.min() < -0.1)
    return count
