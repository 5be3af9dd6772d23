"""The arm's motion as differential equations: torques of the ideal robot, and what flexible joints make of them.

Without a controller an arm adds up every error: of its torques, of its joints, and of a step of the simulation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.polynomial import chebyshev

from ...actuators import Drivetrain, load_chain
from ...common.errors import SealegsError
from ...envs.arm.parameters import rotors_at_rest
from ...envs.arm.robot import ARM
from ...envs.arm.tables import DAMPING, FLEXIBLE, JOINTS, STIFFNESS
from ...envs.arm.trajectory import Line
from .axes import TABLE_I, Axes

NODES, DEGREE = 160, 100  # of the torques as polynomials of time
STEP = 0.001  # [s] by Runge-Kutta: an ideal arm keeps within 0.4 um of where it should be
ELASTIC_STEP = 0.001  # [s]; 0.3 % of the final model's deviation, see docs/results/arm.md
SAMPLE = 0.01  # [s] between looks at the tool
RIGID_BESIDE = mujoco.mjtIntegrator.mjINT_DISCRETE
Three = tuple[float, float, float]
Torques = Callable[[np.ndarray], np.ndarray]
NONE: Three = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Joints:
    """Two spring-damper sets of each joint (Fig. 1): a between stator and rotor, b between rotor and link.

    Attributes:
        stator_damping: c_ra [N.m.s/rad].
        stator_stiffness: k_ra [N.m/rad].
        link_stiffness: k_rb [N.m/rad]; None: rotor and link are one.
        link_damping: c_rb [N.m.s/rad].
    """

    stator_damping: Three = NONE
    stator_stiffness: Three = NONE
    link_stiffness: Three | None = None
    link_damping: Three = NONE


PERFECT = Joints()
FINAL_MODEL = Joints(stator_damping=DAMPING, link_stiffness=STIFFNESS)
"""Table X."""


@dataclass(frozen=True)
class Motion:
    """The arm under torques without a controller.

    Attributes:
        time: (n,) [s].
        links: joint angles of the links (n, 3) [rad].
        tool: (n, 3) [m].
        wanted: of the ideal robot (n, 3) [m].
    """

    time: np.ndarray
    links: np.ndarray
    tool: np.ndarray
    wanted: np.ndarray

    @property
    def deviation(self) -> np.ndarray:
        """Distance of the tool from where the ideal robot has it (n,) [m]."""
        return np.linalg.norm(self.tool - self.wanted, axis=1)

    @property
    def largest(self) -> float:
        """Largest deviation [mm]."""
        return 1e3 * float(self.deviation.max())


def model_of(joints: Joints, params: Mapping[str, float] | None = None, axes: Axes = TABLE_I) -> mujoco.MjModel:
    """The arm with these joints on these axes, driven by torques on its rotors."""
    chains = {}
    for k, name in enumerate(JOINTS):
        stages: list[dict[str, object]] = [{"torque_command": {"armature": rotor_inertia(k)}}]
        if joints.link_stiffness is not None:
            spring = {"stiffness": joints.link_stiffness[k], "damping": joints.link_damping[k]}
            stages.append({"spring": spring})
        chains[name] = load_chain(stages)
    spec = ARM.build_spec(params)
    model = Drivetrain(spec, chains, ARM.coordinates).model
    for k, name in enumerate(JOINTS):
        joint = model.joint(f"{name}_motor" if joints.link_stiffness is not None else name)
        model.dof_damping[joint.dofadr[0]] = joints.stator_damping[k]
        model.jnt_stiffness[joint.id] = joints.stator_stiffness[k]
    if axes != TABLE_I:
        _move_axes(model, axes)
    return model


def _move_axes(model: mujoco.MjModel, axes: Axes) -> None:
    """Let links and rotors turn about these axes; at zero angles, all bodies stay where they are."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for joint in (model.joint(k) for k in range(model.njnt)):
        axis = axes.joints[JOINTS.index(joint.name.removesuffix("_motor"))]
        model.jnt_axis[joint.id] = axis.direction
        model.jnt_pos[joint.id] = axis.point - data.xpos[joint.bodyid[0]]


def rotor_inertia(joint: int) -> float:
    """Inertia of a rotor of table VIII about its joint's axis [kg.m2]."""
    body, line = FLEXIBLE[f"rotor{joint + 1}"], TABLE_I.joints[joint]
    axis = np.array(line.direction)
    aside = np.cross(axis, np.subtract(body.centre, line.point))
    return float(axis @ body.tensor() @ axis + body.mass * (aside @ aside))


def ideal_torques(line: Line, params: Mapping[str, float] | None = None, axes: Axes = TABLE_I) -> Torques:
    """Torques (n, 3) [N.m] of the ideal robot on the line, by time (n,) [s]: its inverse dynamics, as polynomials.

    Args:
        line: that the tool follows.
        params: numbers of the robot that the torques are computed for.
        axes: of its joints.
    """
    half = 0.5 * line.seconds
    times = half * (1.0 + chebyshev.chebpts1(NODES))
    fitted = chebyshev.chebfit(times / half - 1.0, inverse(line, times, params, axes), DEGREE)
    return lambda time: chebyshev.chebval(np.asarray(time) / half - 1.0, fitted).T


def spinning_torques(line: Line) -> Torques:
    """Torques of the ideal robot if its rotors only spin [1, 2]: else they are parts of the bodies that they stand on.

    Their energy is that of their own rotation; that the links before them turn them, too, is left out.
    """
    whole, spin = ideal_torques(line, rotors_at_rest()), np.array([rotor_inertia(k) for k in range(len(JOINTS))])
    return lambda time: whole(time) + spin * line.joints(np.asarray(time))[2]


def inverse(
    line: Line, times: np.ndarray, params: Mapping[str, float] | None = None, axes: Axes = TABLE_I
) -> np.ndarray:
    """Torques (n, 3) [N.m] of the ideal robot at times (n,) [s]."""
    model = model_of(PERFECT, params, axes)
    data, torques = mujoco.MjData(model), np.empty((len(times), 3))
    for k, (place, speed, acceleration) in enumerate(zip(*line.joints(times), strict=True)):
        data.qpos[:], data.qvel[:], data.qacc[:] = place, speed, acceleration
        mujoco.mj_inverse(model, data)
        torques[k] = data.qfrc_inverse
    return torques


def open_loop(
    cases: Sequence[Joints],
    line: Line | None = None,
    params: Mapping[str, float] | None = None,
    torques: Torques | None = None,
    elastic_step: float = ELASTIC_STEP,
    axes: Axes = TABLE_I,
) -> list[Motion]:
    """Torques of the ideal robot on the rotors of arms with these joints, and no controller.

    Arms whose rotors are one with their links are integrated by Runge-Kutta, others by the engine's discrete
    integrator, which takes springs implicitly and is of first order. An ideal arm that is integrated with them says
    where the tool would be, so that most of the error of a step falls out.

    Args:
        cases: joints, one arm each.
        line: that the torques are for; default: the paper's, septic.
        params: numbers of the arms.
        torques: by time; default: those of the ideal robot with the same numbers, on the axes of table I.
        elastic_step: of arms with springs between rotor and link [s].
        axes: of the arms' joints.

    Raises:
        SealegsError: an arm became unstable.
    """
    line = line or Line()
    own = _default_torques(line, tuple(sorted((params or {}).items())))
    drive = torques or own
    found: dict[int, Motion] = {}
    for elastic, step in ((False, STEP), (True, elastic_step)):
        chosen = [k for k, item in enumerate(cases) if (item.link_stiffness is not None) is elastic]
        if not chosen:
            continue
        times, angles = _integrate([cases[k] for k in chosen], line.seconds, step, params, drive, axes)
        wanted = line.tool(times)
        if elastic:
            _, ideal = _integrate([PERFECT], line.seconds, step, params, own, TABLE_I, RIGID_BESIDE)
            wanted = TABLE_I.place(ideal[0])
        for k, links in zip(chosen, angles, strict=True):
            found[k] = Motion(times, links, axes.place(links), wanted)
    return [found[k] for k in range(len(cases))]


def _integrate(
    cases: Sequence[Joints],
    seconds: float,
    step: float,
    params: Mapping[str, float] | None,
    drive: Torques,
    axes: Axes,
    integrator: mujoco.mjtIntegrator | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) [s] and angles of the links (cases, n, 3) [rad], side by side in one batch."""
    first = cases[0]
    elastic = first.link_stiffness is not None
    model = model_of(first, params, axes)
    model.opt.timestep = step
    model.opt.integrator = integrator or (RIGID_BESIDE if elastic else mujoco.mjtIntegrator.mjINT_RK4)
    batch = Batch(model, len(cases), 0)
    damping, stiffness = batch.expand("dof_damping"), batch.expand("jnt_stiffness")
    for k, name in enumerate(JOINTS):
        joint = model.joint(f"{name}_motor" if elastic else name)
        damping[:, joint.dofadr[0]] = [item.stator_damping[k] for item in cases]
        _first(stiffness)[:, joint.id] = [item.stator_stiffness[k] for item in cases]
    if elastic:
        springs, dampers = batch.expand("tendon_stiffness"), batch.expand("tendon_damping")
        for k, name in enumerate(JOINTS):
            tendon = model.tendon(f"{name}_coupling").id
            _first(springs)[:, tendon] = [(item.link_stiffness or NONE)[k] for item in cases]
            _first(dampers)[:, tendon] = [item.link_damping[k] for item in cases]
    batch.reset()
    places, torque = batch.bind("qpos"), batch.bind("ctrl")
    links = [int(model.joint(name).qposadr[0]) for name in JOINTS]
    count, every = round(seconds / step), max(round(SAMPLE / step), 1)
    inputs = drive((np.arange(count) + 0.5) * step)
    angles = np.empty((len(cases), count // every + 1, 3))
    angles[:, 0] = places[:, links]
    for k in range(count):
        torque[:] = inputs[k]
        batch.step(nstep=1)
        if (k + 1) % every == 0:
            angles[:, (k + 1) // every] = places[:, links]
    if not np.isfinite(angles).all() or batch.warning[:, int(mujoco.mjtWarning.mjWARN_BADQPOS) :, 1].any():
        raise SealegsError("the simulation of the arm became unstable; take a smaller step.")
    return SAMPLE * np.arange(angles.shape[1]), angles


def _first(values: np.ndarray) -> np.ndarray:
    """The linear coefficient (n, k), where the engine keeps a polynomial (n, k, j)."""
    return values[..., 0] if values.ndim == 3 else values


@cache
def _default_torques(line: Line, params: tuple[tuple[str, float], ...]) -> Torques:
    return ideal_torques(line, dict(params))
