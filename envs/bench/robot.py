"""A servo on a stand with a pendulum on its shaft: the bench on which servos are measured."""

from __future__ import annotations

import math
from collections.abc import Mapping

import mujoco

from ...actuators import DrivenCoordinate
from ..robot import Number, Robot
from ..scene import CAMERA, add_scene, add_sun

JOINT = "joint"
TIMESTEP = 0.001  # [s] with RK4: 0.1 mrad rms from an exact stick-slip integration (docs/numerics.md)
POINT = 1e-9  # [kg.m2] inertia of a point mass: the engine wants more than none

NUMBERS = {
    "mass": Number(0.5, "kg", "assumed: as in the loads of Duclusaud et al., ICRA 2025", 1e-6),
    "arm_mass": Number(0.03, "kg", "assumed: a printed arm"),
    "length": Number(0.12, "m", "assumed: as the load", 1e-3),
}


def pendulum(mass: float, arm_mass: float, length: float) -> tuple[float, float, float]:
    """Total mass [kg], distance of its centre from the shaft [m], and inertia about that centre [kg.m2].

    The load is a point mass at the end of a uniform rod.
    """
    total = mass + arm_mass
    centre = length * (mass + 0.5 * arm_mass) / total
    about_shaft = length**2 * (mass + arm_mass / 3.0)
    return total, centre, max(about_shaft - total * centre**2, POINT)


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
    total, centre, inertia = pendulum(values["mass"], values["arm_mass"], length)
    arm = stand.add_body(
        name="pendulum",
        mass=total,
        ipos=(0.0, 0.0, -centre),
        inertia=(inertia, inertia, POINT),
        explicitinertial=True,
    )
    arm.add_joint(name=JOINT, type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0.0, -1.0, 0.0))
    rod = {"type": mujoco.mjtGeom.mjGEOM_CAPSULE, "fromto": (0.0, -0.01, 0.0, 0.0, -0.01, -length)}
    arm.add_geom(size=(0.005, 0.0, 0.0), rgba=(0.75, 0.77, 0.80, 1), **rod, **shown)
    weight = {"type": mujoco.mjtGeom.mjGEOM_CYLINDER, "fromto": (0.0, -0.025, -length, 0.0, 0.005, -length)}
    arm.add_geom(size=(0.018, 0.0, 0.0), rgba=(0.85, 0.42, 0.16, 1), **weight, **shown)
    # the rotor of a chain with a series spring is a body of its own; on the bench it hides inside the servo
    spec.worldbody.add_camera(name=CAMERA, pos=(0.0, -6.0 * length, height), xyaxes=(1, 0, 0, 0, 0, 1), fovy=35.0)
    return spec


BENCH = Robot(
    name="bench",
    numbers=NUMBERS,
    coordinates=(DrivenCoordinate.of_joint(JOINT),),
    goal_limits=lambda _: {JOINT: (-math.pi, math.pi)},
    chains={JOINT: "sts3215"},
    build=build,
)
