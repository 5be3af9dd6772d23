"""A servo on a stand with a pendulum on its shaft: the bench on which servos are measured."""

from __future__ import annotations

import math
from collections.abc import Mapping

import mujoco

from ...actuators import DrivenCoordinate, Drivetrain
from ..engine.numbers import Effect, Number
from ..engine.robot import Robot
from ..engine.scene import CAMERA, add_scene, add_sun
from ..engine.stops import set_stop
from .stops import STOP_DAMPING, STOP_STIFFNESS

JOINT = "joint"
TIMESTEP = 0.001  # [s] with RK4: 0.1 mrad rms from an exact stick-slip integration (docs/numerics.md)
POINT = 1e-9  # [kg.m2] inertia of a point mass: the engine wants more than none
NOTHING = 1e-9  # [kg] mass of an empty shaft, likewise
FREE = 100.0  # [rad] a stop as far away as this is none

NUMBERS = {
    "mass": Number(0.5, "kg", "assumed: as in the loads of Duclusaud et al., ICRA 2025"),
    "arm_mass": Number(0.03, "kg", "assumed: a printed arm"),
    "length": Number(0.12, "m", "assumed: as the load", 1e-3),
    "centre_shift": Number(0.0, "m", "assumed: the mass sits at the end", -10.0, 10.0, neutral=True),
    "extra_inertia": Number(0.0, "kg.m2", "assumed: a point mass on a rod", neutral=True),
    "lower_stop": Number(-FREE, "rad", "assumed: nothing stops the pendulum", -FREE, FREE, neutral=True),
    "upper_stop": Number(FREE, "rad", "assumed: nothing stops the pendulum", -FREE, FREE, neutral=True),
    "stop_stiffness": Number(STOP_STIFFNESS, "N.m/rad", "assumed", 1e-3, neutral=True),
}
BARE = {"arm_mass": 0.0}
"""What has no arm by definition: an empty shaft, and a point mass that stands for a load that nobody knows."""


def pendulum(values: Mapping[str, float]) -> tuple[float, float, float]:
    """Total mass [kg], distance of its centre from the shaft [m], and inertia about that centre [kg.m2].

    The load is a point mass on a uniform rod; ``centre_shift`` moves it from the rod's end, and ``extra_inertia`` comes
    on top.
    """
    mass, arm_mass, length = values["mass"], values["arm_mass"], values["length"]
    reach = length + values["centre_shift"]
    total = max(mass + arm_mass, NOTHING)
    centre = (mass * reach + 0.5 * arm_mass * length) / total
    return total, centre, max(inertia(values) - total * centre**2, POINT)


def inertia(values: Mapping[str, float]) -> float:
    """Inertia about the shaft [kg.m2]."""
    length = values["length"]
    point = values["mass"] * (length + values["centre_shift"]) ** 2
    return point + values["arm_mass"] * length**2 / 3.0 + values["extra_inertia"]


def build(values: Mapping[str, float]) -> mujoco.MjSpec:
    """The bench; 0 rad hangs, positive turns counter-clockwise for a viewer who has x to the right."""
    spec = mujoco.MjSpec()
    spec.modelname = "bench"
    spec.option.timestep = TIMESTEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.compiler.degree = False
    length = values["length"]
    height = 1.35 * length + 0.05
    add_scene(spec, tile=0.05, reach=4.0 * length)
    stand = spec.worldbody.add_body(name="stand", pos=(0.0, 0.0, height))
    add_sun(stand, 4.0 * length)
    box = mujoco.mjtGeom.mjGEOM_BOX
    shown = {"contype": 0, "conaffinity": 0}
    stand.add_geom(
        type=box, size=(0.012, 0.018, 0.5 * height), pos=(0.0, 0.045, -0.5 * height), rgba=(0.3, 0.32, 0.35, 1), **shown
    )
    stand.add_geom(type=box, size=(0.02, 0.017, 0.02), pos=(0.0, 0.02, 0.0), rgba=(0.13, 0.14, 0.16, 1), **shown)
    total, centre, about_centre = pendulum(values)
    arm = stand.add_body(
        name="pendulum",
        mass=total,
        ipos=(0.0, 0.0, -centre),
        inertia=(about_centre, about_centre, POINT),
        explicitinertial=True,
    )
    arm.add_joint(name=JOINT, type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0.0, -1.0, 0.0))
    rod = {"type": mujoco.mjtGeom.mjGEOM_CAPSULE, "fromto": (0.0, -0.01, 0.0, 0.0, -0.01, -length)}
    arm.add_geom(size=(0.005, 0.0, 0.0), rgba=(0.75, 0.77, 0.80, 1), **rod, **shown)
    reach = length + values["centre_shift"]
    weight = {"type": mujoco.mjtGeom.mjGEOM_CYLINDER, "fromto": (0.0, -0.025, -reach, 0.0, 0.005, -reach)}
    arm.add_geom(size=(0.018, 0.0, 0.0), rgba=(0.85, 0.42, 0.16, 1), **weight, **shown)
    # the rotor of a chain with a series spring is a body of its own; on the bench it hides inside the servo
    spec.worldbody.add_camera(name=CAMERA, pos=(0.0, -6.0 * length, height), xyaxes=(1, 0, 0, 0, 0, 1), fovy=35.0)
    return spec


def block(drivetrain: Drivetrain, values: Mapping[str, float]) -> None:
    """Put what stops the pendulum into model and specification: a joint limit as stiff as diagnoses take it to be."""
    lower, upper = values["lower_stop"], values["upper_stop"]
    if lower <= -FREE and upper >= FREE:
        return
    model = drivetrain.model
    drivetrain.spec.joint(JOINT).range = lower, upper
    moved = inertia(values) + (drivetrain.chains[JOINT].armature() if model.njnt == 1 else 0.0)
    set_stop(drivetrain, JOINT, (lower, upper), moved, (values["stop_stiffness"], STOP_DAMPING))


BENCH = Robot(
    name="bench",
    numbers=NUMBERS,
    coordinates=(DrivenCoordinate.of_joint(JOINT),),
    goal_limits=lambda _: {JOINT: (-math.pi, math.pi)},
    chains={JOINT: "sts3215"},
    build=build,
    effects={
        "load.mass_factor": Effect("mass", "times"),
        "load.centre_shift": Effect("centre_shift", "plus"),
        "load.extra_inertia": Effect("extra_inertia", "plus"),
        "load.stop_angle": Effect("upper_stop", "most"),
        "load.lower_stop": Effect("lower_stop", "least"),
        "load.stop_stiffness": Effect("stop_stiffness", "set"),
    },
    finish=block,
)
