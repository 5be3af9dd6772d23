"""The load of one joint of a robot: what the rest of the tree does to it while all other joints move as measured.

Joint j obeys ``M_jj q_j'' + sum over k of M_jk q_k'' + c_j(q, q') + g_j(q) = torque_j``. All but the first term and the
torque is known along a log, as is how it changes with the joint's own position and speed; MuJoCo gives the numbers,
once per log (:mod:`sealegs.gap.load.dynamics`). Only bodies behind the joint enter, so all of it is linear in their
masses.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from ...envs.described.model_file import tip_of
from ..log.types import Array
from .dynamics import Dynamics, single_joints
from .load import Load, Range
from .robot import Turned, moved_by
from .terms import E_BIAS, E_COUPLING, E_CURVE, E_DRAG, E_INERTIA, T_DRAWN, T_OWN, T_SIZE

NO_SAME_FRAME = int(mujoco.mjtSameFrame.mjSAMEFRAME_NONE)  # else the engine does not read where a centre of mass is
DERIVATIVE_STEP = 0.02  # [rad] or [m], and a second, either side of what was measured, at which derivatives are taken
# columns of a block
INERTIA, BIAS, CURVE = E_INERTIA - T_OWN, E_BIAS - T_OWN, E_CURVE - T_OWN
DRAG, COUPLING = E_DRAG - T_OWN, E_COUPLING - T_OWN
PAYLOAD_SHARES = 50  # of a body's mass in which it is tried how much of it may be missing at its tip
NO_LEVER = 1e-6  # [m] from a joint to a centre of mass that lies in its axis
NEGLIGIBLE_SIZE = 1e-9  # [kg, N, N.m or rad] that count as nothing


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion of all coordinates of a robot, of all its samples (n, nv): those that never move are zero.

    Attributes:
        position, speed, acceleration: in the frame of the model [rad, rad/s, rad/s2] or [m, m/s, m/s2].
    """

    position: Array
    speed: Array
    acceleration: Array


@dataclass(frozen=True, eq=False)
class Tip:
    """Where a payload would be.

    Attributes:
        body: number of the body.
        point: in its frame (3,) [m].
    """

    body: int
    point: Array


def tip_behind(model: mujoco.MjModel, joint: int) -> Tip:
    """The end of the robot behind a joint: the body with a site that is furthest down the tree, at its last one, or
    else the furthest body, at its centre of mass. Without a name, a body is none that could be changed.

    Args:
        model: of a robot.
        joint: its number.
    """
    first = int(model.jnt_bodyid[joint])
    depth = {first: 0}
    for body in range(first + 1, model.nbody):
        if (parent := int(model.body_parentid[body])) in depth:
            depth[body] = depth[parent] + 1
    sites = [s for s in range(model.nsite) if int(model.site_bodyid[s]) in depth]
    if sites:  # as a tool's frame usually is
        body = int(model.site_bodyid[max(sites, key=lambda s: (depth[int(model.site_bodyid[s])], s))])
    else:
        named = [b for b in depth if model.body(b).name] or list(depth)
        body = max(named, key=lambda b: (depth[b], -b))
    return Tip(body, tip_of(model, body))


def carries(model: mujoco.MjModel, joint: int, body: int) -> bool:
    """Whether a joint moves a body: another one's mass it does not feel, along a motion that is given."""
    owned = {int(model.jnt_bodyid[number]) for number in moved_by(model, joint)}
    while body > 0 and body not in owned:
        body = int(model.body_parentid[body])
    return body > 0


def least_payload(model: mujoco.MjModel, tip: Tip) -> float:
    """The least payload that leaves a body with a mass and an inertia [kg], below zero: a body that is lighter at its
    tip than believed. Zero at a frame without a mass of its own, such as that of a tool: what is welded to it may be
    lighter, but is another body.
    """
    mass, centre = float(model.body_mass[tip.body]), np.array(model.body_ipos[tip.body])
    if mass <= 0.0:
        return 0.0
    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, model.body_iquat[tip.body])
    inertia = axes.reshape(3, 3) @ np.diag(model.body_inertia[tip.body]) @ axes.reshape(3, 3).T
    away = tip.point - centre
    across = away @ away * np.eye(3) - np.outer(away, away)
    least = 0.0
    for taken in np.linspace(0.0, 1.0, PAYLOAD_SHARES + 1)[1:-1] * mass:
        # of two points of masses m and -p, about their common centre
        left = np.linalg.eigvalsh(inertia - across * mass * taken / (mass - taken))
        if left[0] <= 0.0 or left[0] + left[1] < left[2]:  # no body has such an inertia, and the engine takes none
            break
        least = -float(taken)
    return least


def tip_mass(model: mujoco.MjModel, joint: int, tip: Tip) -> float:
    """What at the tip weighs as much as the last body about its joint [kg]; 0 where that is the joint's own."""
    away = float(np.linalg.norm(tip.point))
    if tip.body == model.jnt_bodyid[joint] or away < NO_LEVER or not model.body(tip.body).name:
        return 0.0
    return float(model.body_mass[tip.body]) * min(float(np.linalg.norm(model.body_ipos[tip.body])) / away, 1.0)


def terms_along(model: mujoco.MjModel, joint: int, motion: Motion, sign: float = 1.0, *, changes: bool = True) -> Array:
    """What a joint works against along a motion (n, T_COLUMNS), columns as :mod:`sealegs.gap.load.terms` lists them.

    Args:
        model: of a robot of hinges and slides whose joints have no friction, damping, armature or actuator.
        joint: number of the joint.
        motion: of the robot.
        sign: of the joint's angle in the log against that of the model: torques are turned with it. The first column is
            left in the model's frame.
        changes: whether also what other numbers of the robot would add; else those blocks are zero.
    """
    dof = int(model.jnt_dofadr[joint])
    own = _block(model, joint, motion)
    rows = [motion.position[:, [dof]], sign * motion.speed[:, [dof]], own]
    if changes:  # of bodies alone: what compensates their weight stays as it was computed
        further, nearer = (_block(_shifted(model, joint, way * DERIVATIVE_STEP), joint, motion) for way in (1.0, -1.0))
        rows.append(_block(_payload(model, tip_behind(model, joint)), joint, motion))
        rows += [
            (further - nearer) / (2.0 * DERIVATIVE_STEP),
            (further + nearer - 2.0 * own) / (2.0 * DERIVATIVE_STEP**2),
        ]
        rows.append(spin_block(model, joint, motion))
    else:
        rows += [np.zeros_like(own)] * 4
    rows += [passive_block(model, joint, motion), np.zeros((len(own), 2))]  # what others draw is no matter of bodies
    table = np.concatenate(rows, axis=1)
    if sign < 0.0:
        for first in range(T_OWN, T_DRAWN, T_SIZE):
            _reverse(table[:, first : first + T_SIZE])
    return table


def block_along(model: mujoco.MjModel, joint: int, motion: Motion, sign: float = 1.0) -> Array:
    """All that a joint works against with the bodies as they are (n, T_SIZE)."""
    table = _block(model, joint, motion) + passive_block(model, joint, motion)
    if sign < 0.0:
        _reverse(table)
    return table


def _reverse(block: Array) -> None:
    """Turn a block of a joint that a log counts the other way round, in place: inertia, slope and drag are of torque
    over motion and stay.
    """
    block[:, [BIAS, CURVE, COUPLING]] *= -1.0


def is_passive(model: mujoco.MjModel) -> bool:
    """Whether joints of a robot's file have springs, or its bodies a compensation of their weight or a fluid."""
    springs = np.any(model.jnt_stiffness) or np.any(model.jnt_stiffnesspoly)
    return bool(springs or np.any(model.body_gravcomp) or in_fluid(model))


def in_fluid(model: mujoco.MjModel) -> bool:
    """Whether a robot's file has a fluid, which brakes bodies that move through it."""
    return bool(model.opt.density or model.opt.viscosity)


def passive_torques(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """What springs, weight compensation and fluid of a robot's file take from the joints where it was placed, at the
    speeds that it was given there (nv,).
    """
    mujoco.mj_passive(model, data)
    return -(data.qfrc_spring + data.qfrc_gravcomp + data.qfrc_fluid)


def passive_block(model: mujoco.MjModel, joint: int, motion: Motion) -> Array:
    """The same columns of springs, of weight compensation, of a fluid, and of what tied joints have of their own
    (n, T_SIZE).
    """
    out = np.zeros((len(motion.position), T_SIZE))
    _add_ties(model, joint, motion, out)
    if not is_passive(model):
        return out
    data = mujoco.MjData(model)
    dofs, address = single_joints(model)
    turned, braked = Turned(model, joint), in_fluid(model)

    def placed(row: Array, speed: Array, way: float, faster: float = 0.0) -> float:
        turned.place(data, row, way)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        if braked:  # springs know no speed
            data.qvel[:] = speed
            data.qvel[turned.dofs] += faster * turned.ratios
            mujoco.mj_comVel(model, data)
        return turned.of(passive_torques(model, data))

    torques = np.empty((len(motion.position), 3))
    for k, (row, speed) in enumerate(zip(motion.position, motion.speed, strict=True)):
        data.qpos[address] = row[dofs]
        torques[k] = [placed(row, speed, way) for way in (DERIVATIVE_STEP, 0.0, -DERIVATIVE_STEP)]
        if braked:
            above, below = (placed(row, speed, 0.0, faster) for faster in (DERIVATIVE_STEP, -DERIVATIVE_STEP))
            out[k, DRAG] += (above - below) / (2.0 * DERIVATIVE_STEP)
    above, here, below = torques.T
    out[:, BIAS] += here
    out[:, BIAS + 1], out[:, CURVE] = _derivatives(model, joint, above, here, below)
    return out


def _add_ties(model: mujoco.MjModel, joint: int, motion: Motion, out: Array) -> None:
    """Add armature and damping of the joints that an equality moves with one."""
    for other, ratio in list(moved_by(model, joint).items())[1:]:
        dof = int(model.jnt_dofadr[other])
        damping = ratio**2 * float(model.dof_damping[dof])
        out[:, INERTIA] += ratio**2 * float(model.dof_armature[dof])
        out[:, DRAG] += damping
        out[:, BIAS] += damping * motion.speed[:, int(model.jnt_dofadr[joint])]


def _derivatives(model: mujoco.MjModel, joint: int, above: Array, here: Array, below: Array) -> tuple[Array, Array]:
    """Slope and curve of torques (n,) from those either side; of a hinge as of a + b sin(away) + c (1 - cos(away))."""
    if int(model.jnt_type[joint]) != int(mujoco.mjtJoint.mjJNT_HINGE):
        return (above - below) / (2.0 * DERIVATIVE_STEP), np.zeros_like(here)
    return (above - below) / (2.0 * math.sin(DERIVATIVE_STEP)), (above + below - 2.0 * here) / (
        2.0 * (1.0 - math.cos(DERIVATIVE_STEP))
    )


def _block(model: mujoco.MjModel, joint: int, motion: Motion) -> Array:
    """Inertia, bias, slope, curve, drag and coupling (n, T_SIZE) of one joint and of what an equality moves with it."""
    turned = Turned(model, joint)
    dynamics = Dynamics(model, turned.dofs, turned.ratios, len(motion.position))
    own = int(model.jnt_dofadr[joint])
    together = np.zeros(model.nv)
    together[turned.dofs] = turned.ratios
    out = np.empty((len(motion.position), T_SIZE))
    for first in range(0, len(out), dynamics.size):
        part = slice(first, first + dynamics.size)
        position, speed = motion.position[part], motion.speed[part]
        others = motion.acceleration[part] - np.outer(motion.acceleration[part][:, own], together)
        above, below = (
            _needed(*dynamics.at(position + way * together, speed), others)
            for way in (DERIVATIVE_STEP, -DERIVATIVE_STEP)
        )
        row, still = dynamics.at(position, speed)
        here = _needed(row, still, others)
        slope, curve = _derivatives(model, joint, above, here, below)
        # linear in the speed of one joint, which turns no body about two axes; of tied ones quadratic
        faster = dynamics.bias(position, speed + together)
        drag = faster - still if turned.alone else 0.5 * (faster - dynamics.bias(position, speed - together))
        out[part] = np.stack([row @ together, here, slope, curve, drag, here - still], axis=1)
    return out


def _needed(row: Array, bias: Array, acceleration: Array) -> Array:
    """Torque (n,) for accelerations (n, nv), with a row of the mass matrix (n, nv) and a bias (n,)."""
    return np.einsum("nk,nk->n", row, acceleration) + bias


def _payload(model: mujoco.MjModel, tip: Tip) -> mujoco.MjModel:
    """The robot without any mass but a kilogram at its tip."""
    other = without_mass(model)
    other.body_mass[tip.body] = 1.0
    other.body_ipos[tip.body] = tip.point
    body = tip.body
    while body > 0:
        other.body_subtreemass[body] = 1.0
        body = int(other.body_parentid[body])
    other.body_subtreemass[0] = 1.0
    return other


def spin_block(model: mujoco.MjModel, joint: int, motion: Motion) -> Array:
    """What a kg.m2 more of a hinge's own body about its axis adds (n, T_SIZE); nothing of a slide.

    It acts on the whole angular acceleration of the body about that axis, also on what joints above give it.
    """
    block = np.zeros((len(motion.position), T_SIZE))
    if int(model.jnt_type[joint]) != int(mujoco.mjtJoint.mjJNT_HINGE):
        return block
    if turns_alone(model, joint):
        block[:, INERTIA] = 1.0
        return block
    other, body = without_mass(model), int(model.jnt_bodyid[joint])
    other.body_inertia[body] = (0.0, 0.0, 1.0)
    mujoco.mju_quatZ2Vec(other.body_iquat[body], np.array(model.jnt_axis[joint]))
    return _block(other, joint, motion)


def turns_alone(model: mujoco.MjModel, joint: int) -> bool:
    """Whether no other joint turns a joint's own body."""
    body = int(model.jnt_bodyid[joint])
    dof = int(model.body_dofadr[body] + model.body_dofnum[body]) - 1
    while dof >= 0:
        number = int(model.dof_jntid[dof])
        if number != joint and int(model.jnt_type[number]) != int(mujoco.mjtJoint.mjJNT_SLIDE):
            return False
        dof = int(model.dof_parentid[dof])
    return True


def without_mass(model: mujoco.MjModel) -> mujoco.MjModel:
    """The robot without any mass, whose centres of mass may be set."""
    other = model.__copy__()
    other.body_mass[:] = 0.0
    other.body_inertia[:] = 0.0
    other.body_subtreemass[:] = 0.0
    other.body_sameframe[:] = NO_SAME_FRAME
    return other


def _shifted(model: mujoco.MjModel, joint: int, way: float) -> mujoco.MjModel:
    """The robot with the centre of mass of a joint's own body further from the joint [m]."""
    other = model.__copy__()
    body, arm = int(model.jnt_bodyid[joint]), arm_of(model, joint)
    size = float(np.linalg.norm(arm))
    if size > NO_LEVER:
        other.body_ipos[body] = np.array(model.body_ipos[body]) + way * arm / size
        other.body_sameframe[body] = NO_SAME_FRAME
    return other


def arm_of(model: mujoco.MjModel, joint: int) -> Array:
    """From a joint to the centre of mass of its own body (3,), for a hinge square to its axis [m]."""
    arm = np.array(model.body_ipos[model.jnt_bodyid[joint]]) - model.jnt_pos[joint]
    axis = np.array(model.jnt_axis[joint])
    if int(model.jnt_type[joint]) == int(mujoco.mjtJoint.mjJNT_HINGE):
        arm = arm - axis * (arm @ axis)
    return arm


def own_lever(model: mujoco.MjModel, joint: int) -> float:
    """Length of that where other bodies with a mass hang behind the joint [m]; 0 where its own is all of it.

    Also 0 of a slide, whose load no centre of mass changes, and of a body without a name, which cannot be changed.
    """
    body, size = int(model.jnt_bodyid[joint]), float(np.linalg.norm(arm_of(model, joint)))
    alone = (
        model.body_subtreemass[body] - model.body_mass[body] <= NEGLIGIBLE_SIZE
        or model.body_mass[body] <= NEGLIGIBLE_SIZE
    )
    slides = int(model.jnt_type[joint]) != int(mujoco.mjtJoint.mjJNT_HINGE)
    return 0.0 if alone or slides or size < NO_LEVER or not model.body(body).name else size


# --- what hangs behind a joint of a robot as a load that a search may change -----------------------------------------


@dataclass(frozen=True)
class TreeLoad(Load):
    """What hangs behind a joint of a robot, as a change of what its model file says.

    ``extra_inertia`` is of the joint's own body about the joint's axis; of a slide, mass that gravity does not feel
    [kg]. ``centre_shift`` is of that body's centre of mass, ``typical_inertia`` is in the middle of the log. Its masses
    were weighed or computed by somebody, and the file says its pose; how it moves depends on the other joints.

    Attributes:
        payload: at the end of the robot, believed to carry nothing [kg].
        rotor_inertia: inertia beyond the chain's, of what turns only as the joint does against its parent, as a rotor
            behind a gear [kg.m2].
        typical_gravity: largest change of the torque with the angle [N.m/rad].
        carried: whether joints above turned the joint's own body about the joint's axis in the log.
    """

    mass_keys: ClassVar[tuple[str, ...]] = ("mass_factor", "payload")
    tunable: ClassVar[tuple[str, ...]] = ("mass_factor",)
    predictable: ClassVar[bool] = False
    pose_known: ClassVar[bool] = True

    payload: float = 0.0
    rotor_inertia: float = 0.0
    typical_gravity: float = 0.0
    carried: bool = False

    @property
    def pull_back(self) -> float:
        """As it was along the log."""
        return self.typical_gravity * self.mass_factor

    def known(self, params: Mapping[str, float]) -> bool:
        """Whether the load is known; it is, or there would be none of these."""
        del params
        return True

    def inertia(self, params: Mapping[str, float]) -> float:
        """Typical inertia about the joint [kg.m2]."""
        del params
        return self.typical_inertia * self.mass_factor + self.extra_inertia + self.rotor_inertia

    def gravity_torque(self, params: Mapping[str, float]) -> float:
        """Largest torque of gravity [N.m]."""
        del params
        return self.typical_gravity * self.mass_factor

    def planned_gravity(self, params: Mapping[str, float]) -> float:
        """None: a planned motion of a robot goes where it went before [N.m]."""
        del params
        return 0.0

    def stop_ranges(self, middle: float, half: float, start: float) -> tuple[Range, Range]:
        """About the middle of its motion, which need not be at zero; what it reached is less than it would have."""
        away = 1.05 * start * half
        upper = Range(middle - 0.25 * half, middle + 2.0 * half, middle + away, 0.03)
        return upper, Range(middle - 2.0 * half, middle + 0.25 * half, middle - away, 0.03)

    def inertia_ranges(self, armature: float) -> dict[str, Range]:
        """Down to a tenth of file and chain [kg.m2]. Where nothing above turns the link, a rotor is the same.

        The rotor comes first: nobody states it, where a link's inertia is reckoned from its shape.
        """
        whole = self.typical_inertia + armature
        link = {"extra_inertia": Range(-0.9 * self.typical_inertia, 20.0 * whole, 0.1 * whole, 0.1 * whole)}
        rotor = {"rotor_inertia": Range(-0.9 * armature, 20.0 * whole, 0.1 * whole, 0.1 * whole)}
        return {**rotor, **link} if self.carried else link

    def unknown_ranges(self, armature: float) -> dict[str, Range]:
        """About what the file gives: what hangs behind the joint by a factor, and more inertia."""
        whole = self.inertia({}) + armature
        more = Range(-0.9 * self.inertia({}), 20.0 * whole, 0.0, 0.1 * whole)
        return {"mass_factor": Range(0.05, 20.0, 1.0, 0.3), "extra_inertia": more}

    def along_log(self, slide: bool) -> dict[str, float]:
        """What a fit changes of the terms."""
        return {
            "inertia": self.rotor_inertia + (self.extra_inertia if slide else 0.0),
            "spin": 0.0 if slide else self.extra_inertia,
            "gravity": 0.0,
            "tree": 2.0 if slide else 1.0,
            "mass": self.mass_factor,
            "payload": self.payload,
            "shift": self.centre_shift,
        }
