"""What a simulation step costs in accuracy: ``python -m benchmarks.numerics``. Here the engine's constants were chosen.

Writes ``benchmarks/results/numerics.json`` and the tables of ``docs/numerics.md``.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, astuple, dataclass, replace
from typing import Any

import mujoco
import numba
import numpy as np
from sealegs.actuators import Drivetrain, mounting
from sealegs.actuators.chain import names as chains
from sealegs.common.markdown import table

from benchmarks.kept import CHECKOUT, command, study, write

HOLD = 0.01  # [s] between commands and samples
DEFAULT = {"solref": (0.02, 1.0), "solimp": (0.9, 0.95, 0.001, 0.5, 2.0)}  # MuJoCo's own
TOOTH = 2000.0  # [N.m/rad] of the exact joint's teeth: 0.1 mrad under 0.2 N.m
STEPS = (0.00025, 0.0005, 0.001, 0.002, 0.0025, 0.004, 0.005)  # [s]
INTEGRATORS = ("Euler", "implicitfast", "RK4")
MODEL = """<mujoco><option timestep="{step}" integrator="{integrator}" gravity="0 0 -9.81"/><worldbody><body>
<joint name="shaft" axis="0 1 0"/><inertial pos="0 0 -{length}" mass="{mass}" diaginertia="1e-9 1e-9 1e-9"/></body>
</worldbody></mujoco>"""

TEMPLATE = """# Numerics: what a simulation step costs

How large the discretisation error of a simulation is, since it looks like a physical cause. The reference is an exact
integration at 2 us, in which friction holds a joint exactly at rest (`benchmarks/numerics.py`). At 20 us the same
integration differs by {exact_20us:.2f} mrad. The joint is a position servo with 0.5 kg at 0.12 m and 0.06 N.m of
Coulomb friction. It follows 24 s of chirp, steps, slow triangle and multisine, with a new goal every 10 ms. Noise
and ticks of a real encoder are {noise_floor:g} mrad rms.

Written by `python -m benchmarks.numerics`; do not edit.

## Position error

"This project" means dry friction with `solref {friction_solref}`, `solimp {friction_solimp}` (`actuators/mounting.py`).
MuJoCo raises the time constant to twice the step, so friction is as stiff as the step allows.

{stiff}

Euler and implicitfast evaluate the law once a step, and its velocity terms late by half a step: which acts as an extra
delay. RK4 evaluates it in every stage.

With RK4 at 1 ms, transmissions have these errors:

- a compliance of 50 N.m/rad as a tendon spring: {compliance:.2f} mrad;
- 12 mrad of play as a limited tendon (whose whole effect is {play_effect:.1f} mrad): {play_ours:.2f} mrad with
  `solreflimit {tooth_solref}`, `solimplimit {tooth_solimp}`, and {play_default:.2f} mrad with the defaults.

The exact teeth are a spring of 2000 N.m/rad; the stiffness of real teeth is a parameter to identify.

## Creep

A pendulum with 0.55 N.m of gravity, held by 0.7 N.m of dry friction, sinks at

{creep}

## Largest step

A law reads the speed at the start of a step (or of a Runge-Kutta stage), so back-EMF and the controller's damping are
explicit. With a damping `b` [N.m.s/rad] on an inertia `I` [kg.m2], a step `h` is stable while `b h / I` < 2 (Euler,
implicitfast) or 2.8 (RK4). For a DC motor `b = k^2 / R` at the joint, so a light rotor with a strong motor needs the
shortest step. The table has the largest step [ms] of those tried (0.25 to {largest:g}) at which each chain
comes to rest after a step of its goal. *Light* is a link of 20 g at 5 cm, *heavy* the pendulum above.

{stable}
"""


@dataclass(frozen=True)
class ExactJoint:
    """A position servo with a pendulum on it; everything at the output shaft.

    It shares no code with :mod:`actuators`: a plain loop at 20 us or less in which a joint that stops is held at rest
    until the torque exceeds the friction, instead of a friction force smeared over small speeds.
    """

    gain: float = 5.3  # duty per radian [1/rad]
    volts: float = 7.4  # [V]
    motor_constant: float = 0.78  # [N.m/A]
    resistance: float = 2.0  # [ohm]
    armature: float = 0.006  # [kg.m2]
    viscous: float = 0.03  # [N.m.s/rad]
    coulomb: float = 0.06  # [N.m]
    mass: float = 0.5  # [kg]
    length: float = 0.12  # [m]
    stiffness: float = 0.0  # between motor and link [N.m/rad]; 0: one rigid body
    damping: float = 0.0  # of that spring [N.m.s/rad]
    play: float = 0.0  # whole play between motor and link [rad]

    def simulate(self, goal: np.ndarray, hold: float, step: float = 20e-6) -> np.ndarray:
        """Motor and link position at the start of every hold, shape (n, 2) [rad].

        Args:
            goal: commands (n,) [rad], each held for ``hold`` [s].
            hold: time between two commands [s].
            step: of the integration [s].
        """
        return _simulate(np.array(astuple(self)), np.asarray(goal, float), round(hold / step), step)


@numba.njit(cache=True)
def _simulate(parameters, goal, steps, h):  # type: ignore[no-untyped-def]
    gain, volts, kt, ohm, rotor, viscous, coulomb, mass, length, stiffness, damping, play = parameters
    link = mass * length**2
    out = np.empty((len(goal), 2))
    q, w, lq, lw = goal[0], 0.0, goal[0], 0.0
    for n in range(len(goal)):
        out[n, 0], out[n, 1] = q, lq
        for _ in range(steps):
            duty = min(max(gain * (goal[n] - q), -1.0), 1.0)
            push = kt * (volts * duty - kt * w) / ohm - viscous * w
            if stiffness == 0.0:
                inertia = rotor + link
                push -= mass * 9.81 * length * math.sin(lq)
            else:
                inertia = rotor
                twist = q - lq
                free = max(abs(twist) - 0.5 * play, 0.0)
                pull = math.copysign(stiffness * free, twist)
                if free > 0.0 or play == 0.0:
                    pull += damping * (w - lw)
                push -= pull
                lw += h * (pull - mass * 9.81 * length * math.sin(lq)) / link
                lq += h * lw
            if w == 0.0 and abs(push) <= coulomb:
                pass
            else:
                way = math.copysign(1.0, w if w != 0.0 else push)
                new = w + h * (push - way * coulomb) / inertia
                w = 0.0 if w * new < 0.0 else new  # it stops before it can turn around
                q += h * w
            if stiffness == 0.0:
                lq = q
    return out


def excitation(seconds: float = 24.0, hold: float = 0.01) -> np.ndarray:
    """Goals [rad] of a log: a chirp, steps, a slow triangle and a multisine, a quarter of the time each."""
    quarter = round(seconds / 4.0 / hold)
    t = np.arange(quarter) * hold
    span = t[-1] + hold
    chirp = 0.6 * np.sin(2.0 * np.pi * (0.2 * t + (3.0 - 0.2) * t**2 / (2.0 * span)))
    steps = 0.8 * np.array([0.0, 1.0, -0.5, 0.3, -1.0, 0.1])[np.minimum((t / 1.0).astype(int), 5)]
    triangle = 0.5 * np.abs((t / 3.0 + 0.5) % 2.0 - 1.0) - 0.25
    tones = ((0.3, 0.25), (0.7, 0.2), (1.3, 0.12), (2.1, 0.08))
    multisine = np.sum([a * np.sin(2.0 * np.pi * f * t + k) for k, (f, a) in enumerate(tones)], axis=0)
    return np.concatenate([chirp, steps, triangle, multisine])


@dataclass(frozen=True)
class Constants:
    """Solver constants of dry friction rows and of gear teeth; None: those of :mod:`mounting`."""

    friction_solref: tuple[float, ...] | None = None
    friction_solimp: tuple[float, ...] | None = None
    tooth_solref: tuple[float, ...] | None = None
    tooth_solimp: tuple[float, ...] | None = None


def chain_of(joint: ExactJoint) -> list[dict[str, Any]]:
    """The chain that describes an exact joint."""
    stages: list[dict[str, Any]] = [
        {"position_p": {"gain": joint.gain}},
        {"duty_limit": {"limit": 1.0}},
        {"supply": {"volts": joint.volts}},
        {
            "dc_motor": {
                "motor_constant": joint.motor_constant,
                "resistance": joint.resistance,
                "armature": joint.armature,
            }
        },
        {"friction": {"coulomb": joint.coulomb, "viscous": joint.viscous}},
    ]
    if 0.0 < joint.stiffness < TOOTH:
        stages.append({"compliance": {"stiffness": joint.stiffness, "damping": joint.damping}})
    if joint.play > 0.0:
        stages.append({"backlash": {"width": joint.play}})
    return stages


@contextmanager
def _constants(chosen: Constants) -> Iterator[None]:
    """Mount chains with other solver constants for a while."""
    kept = {}
    for name, value in asdict(chosen).items():
        if value is not None:
            kept[name.upper()] = getattr(mounting, name.upper())
            setattr(mounting, name.upper(), value)
    try:
        yield
    finally:
        for name, value in kept.items():
            setattr(mounting, name, value)


def engine(joint: ExactJoint, goal: np.ndarray, step: float, integrator: str, constants: Constants) -> np.ndarray:
    """Motor and link position at the start of every hold, shape (n, 2) [rad], simulated by MuJoCo."""
    xml = MODEL.format(step=step, integrator=integrator, length=joint.length, mass=joint.mass)
    with _constants(constants):
        drivetrain = Drivetrain(mujoco.MjSpec.from_string(xml), {"shaft": chain_of(joint)})
    data = mujoco.MjData(drivetrain.model)
    drivetrain.set_position("shaft", data.qpos, float(goal[0]))
    out = np.empty((len(goal), 2))
    for n, asked in enumerate(goal):
        out[n] = [drivetrain.position("shaft", data.qpos, side) for side in ("motor", "link")]
        data.ctrl[0] = asked
        mujoco.mj_step(drivetrain.model, data, round(HOLD / step))
    return out


def error(joint: ExactJoint, reference: np.ndarray, step: float, integrator: str, constants: Constants) -> float:
    """RMS of the link position against ``reference`` [mrad]."""
    simulated = engine(joint, excitation(), step, integrator, constants)
    return float(1e3 * np.sqrt(np.mean((simulated[:, 1] - reference[:, 1]) ** 2)))


def creep(step: float, integrator: str, constants: Constants) -> float:
    """Speed at which a pendulum sinks that dry friction holds [mrad/s]."""
    joint = ExactJoint(coulomb=0.7)
    xml = MODEL.format(step=step, integrator=integrator, length=joint.length, mass=joint.mass)
    chain = [{"ideal": {"stiffness": 0.0, "armature": joint.armature}}, {"friction": {"coulomb": joint.coulomb}}]
    with _constants(constants):
        drivetrain = Drivetrain(mujoco.MjSpec.from_string(xml), {"shaft": chain})
    data = mujoco.MjData(drivetrain.model)
    data.qpos[0] = 1.2
    mujoco.mj_step(drivetrain.model, data, round(0.5 / step))
    start = float(data.qpos[0])
    mujoco.mj_step(drivetrain.model, data, round(1.0 / step))
    return 1e3 * abs(float(data.qpos[0]) - start)


def largest_stable_step(name: str, integrator: str, loaded: bool) -> float:
    """Largest of :data:`STEPS` at which a named chain comes to rest after a step of its goal [s]."""
    stable = 0.0
    for step in STEPS:
        length, mass = (0.12, 0.5) if loaded else (0.05, 0.02)
        xml = MODEL.format(step=step, integrator=integrator, length=length, mass=mass)
        drivetrain = Drivetrain(mujoco.MjSpec.from_string(xml), {"shaft": name})
        data = mujoco.MjData(drivetrain.model)
        data.ctrl[0] = 0.2
        mujoco.mj_step(drivetrain.model, data, round(3.0 / step))
        speeds = []
        for _ in range(round(0.2 / step)):
            mujoco.mj_step(drivetrain.model, data)
            speeds.append(abs(float(drivetrain.speed("shaft", data.qvel))))
        if max(speeds) > 0.05 or not np.isfinite(data.qpos).all():
            break
        stable = step
    return stable


def measure() -> dict[str, Any]:
    """Every figure of ``docs/numerics.md``."""
    goal = excitation()
    ours, theirs = Constants(), Constants(*([DEFAULT["solref"], DEFAULT["solimp"]] * 2))
    stiff, springy = ExactJoint(), ExactJoint(stiffness=50.0, damping=0.02)
    toothed = ExactJoint(stiffness=TOOTH, damping=1.0, play=0.012)
    exact = {joint: joint.simulate(goal, HOLD, 2e-6) for joint in (stiff, springy, toothed, replace(toothed, play=0.0))}
    rows = [
        {
            "integrator": integrator,
            "step": step,
            "ours": error(stiff, exact[stiff], step, integrator, ours),
            "default": error(stiff, exact[stiff], step, integrator, theirs),
        }
        for integrator in INTEGRATORS
        for step in (0.0025, 0.001, 0.0005, 0.00025)
    ]
    coarse = stiff.simulate(goal, HOLD, 20e-6)
    play = exact[toothed][:, 1] - exact[replace(toothed, play=0.0)][:, 1]
    return {
        "noise_floor": 0.59,
        "exact_20us": float(1e3 * np.sqrt(np.mean((coarse - exact[stiff]) ** 2))),
        "stiff": rows,
        "compliance": error(springy, exact[springy], 0.001, "RK4", ours),
        "play_effect": float(1e3 * np.sqrt(np.mean(play**2))),
        "play": {
            "ours": error(toothed, exact[toothed], 0.001, "RK4", ours),
            "default": error(toothed, exact[toothed], 0.001, "RK4", theirs),
        },
        "creep": [
            {
                "integrator": integrator,
                "step": step,
                "ours": creep(step, integrator, ours),
                "default": creep(step, integrator, theirs),
            }
            for integrator in ("implicitfast", "RK4")
            for step in (0.0025, 0.001)
        ],
        "stable": [
            {
                "chain": name,
                **{
                    f"{integrator} {load}": largest_stable_step(name, integrator, load == "heavy")
                    for integrator in ("implicitfast", "RK4")
                    for load in ("light", "heavy")
                },
            }
            for name in chains()
        ],
    }


def page(figures: dict[str, Any]) -> str:
    """The text of ``docs/numerics.md``."""
    ours, default = "this project [mrad{}]", "MuJoCo's default{} [mrad{}]"
    columns = [key for key in figures["stable"][0] if key != "chain"]
    return TEMPLATE.format(
        stiff=table(
            ("integrator", "step [ms]", ours.format(" rms"), default.format(" friction row", " rms")),
            ((row["integrator"], f"{1e3 * row['step']:g}", f"{row['ours']:.2f}", f"{row['default']:.2f}")
             for row in figures["stiff"]),
        ),
        creep=table(
            ("integrator", "step [ms]", ours.format("/s"), default.format("", "/s")),
            ((row["integrator"], f"{1e3 * row['step']:g}", f"{row['ours']:.4f}", f"{row['default']:.2f}")
             for row in figures["creep"]),
        ),
        stable=table(
            ("chain", *columns),
            ((row["chain"], *(f"{1e3 * row[key]:g}" for key in columns)) for row in figures["stable"]),
        ),
        friction_solref=mounting.FRICTION_SOLREF,
        friction_solimp=mounting.FRICTION_SOLIMP,
        tooth_solref=mounting.TOOTH_SOLREF,
        tooth_solimp=mounting.TOOTH_SOLIMP,
        largest=1e3 * max(STEPS),
        **{key: figures[key] for key in ("noise_floor", "exact_20us", "compliance", "play_effect")},
        play_ours=figures["play"]["ours"],
        play_default=figures["play"]["default"],
    )  # fmt: skip


@study
def main() -> None:
    """Measure and write."""
    command(__doc__).parse_args()
    figures = measure()
    write("numerics", None, figures)
    write(CHECKOUT / "docs" / "numerics", page(figures))
    print(page(figures))


if __name__ == "__main__":
    sys.exit(main())
