"""The load of one joint of a robot: what the rest of the tree does to it while all other joints move as measured.

Joint j obeys ``M_jj q_j'' + sum over k of M_jk q_k'' + c_j(q, q') + g_j(q) = torque_j``. All but the first term and the
torque is known along a log, as is how it changes with the joint's own position and speed; MuJoCo's recursive
Newton-Euler algorithm gives the numbers, once per log. Only bodies behind the joint enter, so all of it is linear in
their masses.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from ..log.types import Array
from .load import Range
from .robot import KINDS
from .terms import E_BIAS, E_COUPLING, E_CURVE, T_COLUMNS, T_OWN, T_SIZE

NONE = int(mujoco.mjtSameFrame.mjSAMEFRAME_NONE)  # else the engine does not read where a centre of mass is
ANGLE = 0.02  # [rad] or [m] either side of the measured position at which the terms are taken for their derivatives
BIAS, CURVE, COUPLING = E_BIAS - T_OWN, E_CURVE - T_OWN, E_COUPLING - T_OWN  # columns of a block
SHARES = 50  # of a body's mass in which it is tried how much of it may be missing at its tip
SHIFT = 0.01  # [m] of a centre of mass, either way: its effect is quadratic, so any does


@dataclass(frozen=True)
class TreeLoad:
    """What hangs behind a joint of a robot, as a change of what its model file says.

    Attributes:
        mass_factor: true over believed mass of all that hangs behind the joint.
        payload: at the end of the robot, believed to carry nothing [kg].
        extra_inertia: about the joint, beyond that of the bodies [kg.m2].
        centre_shift: of the joint's own body's centre of mass, away from the joint [m].
        stop_angle, lower_stop: beyond and below which something blocks the link [rad].
        typical_inertia: in the middle of the log [kg.m2].
        typical_gravity: largest change of the torque with the angle [N.m/rad].
        least_payload: the least that leaves a body at the end of the robot [kg], below zero.
    """

    mass_factor: float = 1.0
    payload: float = 0.0
    extra_inertia: float = 0.0
    centre_shift: float = 0.0
    stop_angle: float = math.inf
    lower_stop: float = -math.inf
    typical_inertia: float = 0.0
    typical_gravity: float = 0.0
    least_payload: float = 0.0

    @property
    def mass_keys(self) -> tuple[str, ...]:
        """All that hangs behind the joint, or something at the end of it."""
        return ("mass_factor", "payload")

    @property
    def tunable(self) -> tuple[str, ...]:
        """Masses of bodies that somebody weighed or computed."""
        return ("mass_factor",)

    @property
    def pull_back(self) -> float:
        """As it was along the log."""
        return self.typical_gravity * self.mass_factor

    @property
    def predictable(self) -> bool:
        """It depends on how the other joints move."""
        return False

    @property
    def pose_known(self) -> bool:
        """The model file says it."""
        return True

    def known(self, params: Mapping[str, float]) -> bool:
        """Whether the load is known; it is, or there would be none of these."""
        del params
        return True

    def inertia(self, params: Mapping[str, float]) -> float:
        """Typical inertia about the joint [kg.m2]."""
        del params
        return self.typical_inertia * self.mass_factor + self.extra_inertia

    def gravity_torque(self, params: Mapping[str, float]) -> float:
        """Largest torque of gravity [N.m]."""
        del params
        return self.typical_gravity * self.mass_factor

    def planned_gravity(self, params: Mapping[str, float]) -> float:
        """None: a planned motion of a robot goes where it went before [N.m]."""
        del params
        return 0.0

    def stops(self, params: Mapping[str, float]) -> tuple[float, float]:
        """Angles below and beyond which something blocks the link [rad]."""
        del params
        return self.lower_stop, self.stop_angle

    def numbers(self, params: Mapping[str, float]) -> dict[str, float]:
        """Numbers of a bench with this load: none, a robot's stand in its model file."""
        return dict(params)

    def stop_ranges(self, middle: float, half: float, start: float) -> tuple[Range, Range]:
        """About the middle of its motion, which need not be at zero; what it reached is less than it would have."""
        away = 1.05 * start * half
        upper = Range(middle - 0.25 * half, middle + 2.0 * half, middle + away, 0.03)
        return upper, Range(middle - 2.0 * half, middle + 0.25 * half, middle - away, 0.03)

    def inertia_range(self, armature: float) -> Range:
        """Down to a tenth of what the file gives [kg.m2]."""
        whole = self.typical_inertia + armature
        return Range(-0.9 * self.typical_inertia, 20.0 * whole, 0.1 * whole, 0.1 * whole)

    def unknown_ranges(self, armature: float) -> dict[str, Range]:
        """About what the file gives: what hangs behind the joint by a factor, and more inertia."""
        whole = self.inertia({}) + armature
        more = Range(-0.9 * self.inertia({}), 20.0 * whole, 0.0, 0.1 * whole)
        return {"mass_factor": Range(0.05, 20.0, 1.0, 0.3), "extra_inertia": more}

    def along_log(self, slide: bool) -> dict[str, float]:
        """What a fit changes of the terms."""
        return {
            "inertia": self.extra_inertia,
            "gravity": 0.0,
            "tree": 2.0 if slide else 1.0,
            "mass": self.mass_factor,
            "payload": self.payload,
            "shift": self.centre_shift,
        }

    def value(self, key: str) -> float:
        """A number that a fit may turn."""
        return getattr(self, key)

    def with_values(self, values: Mapping[str, float]) -> TreeLoad:
        """The load with some of these numbers set."""
        return dataclasses.replace(self, **values)


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
    """The end of the robot behind a joint: the furthest body in the tree, at its site or else its centre of mass.

    Args:
        model: of a robot.
        joint: its number.
    """
    first = int(model.jnt_bodyid[joint])
    depth = {first: 0}
    for body in range(first + 1, model.nbody):
        if (parent := int(model.body_parentid[body])) in depth:
            depth[body] = depth[parent] + 1
    body = max(depth, key=lambda b: (depth[b], -b))
    sites = [s for s in range(model.nsite) if int(model.site_bodyid[s]) in depth]
    if sites:  # the last one of the body that is furthest down the tree, as a tool's frame usually is
        site = max(sites, key=lambda s: (depth[int(model.site_bodyid[s])], s))
        return Tip(int(model.site_bodyid[site]), np.array(model.site_pos[site]))
    return Tip(body, np.array(model.body_ipos[body]))


def carries(model: mujoco.MjModel, joint: int, body: int) -> bool:
    """Whether a joint moves a body: another one's mass it does not feel, along a motion that is given."""
    while body > 0 and body != int(model.jnt_bodyid[joint]):
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
    for taken in np.linspace(0.0, 1.0, SHARES + 1)[1:-1] * mass:
        # of two points of masses m and -p, about their common centre
        left = np.linalg.eigvalsh(inertia - across * mass * taken / (mass - taken))
        if left[0] <= 0.0 or left[0] + left[1] < left[2]:  # no body has such an inertia, and the engine takes none
            break
        least = -float(taken)
    return least


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
    own = _block(model, dof, motion)
    rows = [motion.position[:, [dof]], sign * motion.speed[:, [dof]], own]
    passive = passive_block(model, dof, motion)
    if changes:
        here = own + passive
        further, nearer = (_whole_block(_shifted(model, joint, way * SHIFT), dof, motion) for way in (1.0, -1.0))
        rows.append(_block(_payload(model, tip_behind(model, joint)), dof, motion))
        rows += [(further - nearer) / (2.0 * SHIFT), (further + nearer - 2.0 * here) / (2.0 * SHIFT**2)]
    else:
        rows += [np.zeros_like(own)] * 3
    rows.append(passive)
    table = np.concatenate(rows, axis=1)
    if sign < 0.0:
        for first in range(T_OWN, T_COLUMNS, T_SIZE):
            _reverse(table[:, first : first + T_SIZE])
    return table


def block_along(model: mujoco.MjModel, joint: int, motion: Motion, sign: float = 1.0) -> Array:
    """All that a joint works against with the bodies as they are (n, T_SIZE)."""
    table = _whole_block(model, int(model.jnt_dofadr[joint]), motion)
    if sign < 0.0:
        _reverse(table)
    return table


def _reverse(block: Array) -> None:
    """Turn a block of a joint that a log counts the other way round, in place: inertia, slope and drag are of torque
    over motion and stay.
    """
    block[:, [BIAS, CURVE, COUPLING]] *= -1.0


def _whole_block(model: mujoco.MjModel, dof: int, motion: Motion) -> Array:
    return _block(model, dof, motion) + passive_block(model, dof, motion)


def is_passive(model: mujoco.MjModel) -> bool:
    """Whether joints of a robot's file have springs, or bodies a compensation of their weight."""
    springs = np.any(model.jnt_stiffness) or np.any(model.jnt_stiffnesspoly)
    return bool(springs or np.any(model.body_gravcomp))


def passive_torques(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """What springs and weight compensation of a robot's file take from the joints where it was placed (nv,)."""
    mujoco.mj_passive(model, data)
    return -(data.qfrc_spring + data.qfrc_gravcomp)


def _single(model: mujoco.MjModel) -> tuple[Array, Array]:
    """Degrees of freedom of hinges and slides, and their coordinates; free and ball joints stay where they are."""
    found = [j for j in range(model.njnt) if int(model.jnt_type[j]) in KINDS]
    return model.jnt_dofadr[found], model.jnt_qposadr[found]


def passive_block(model: mujoco.MjModel, dof: int, motion: Motion) -> Array:
    """The same columns of springs and weight compensation (n, T_SIZE): they have no inertia and no drag."""
    out = np.zeros((len(motion.position), T_SIZE))
    if not is_passive(model):
        return out
    data = mujoco.MjData(model)
    dofs, address = _single(model)
    at = int(model.jnt_qposadr[model.dof_jntid[dof]])

    def placed(q: float) -> float:
        data.qpos[at] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        return float(passive_torques(model, data)[dof])

    for k, row in enumerate(motion.position):
        data.qpos[address] = row[dofs]
        above, here, below = (placed(row[dof] + way) for way in (ANGLE, 0.0, -ANGLE))
        out[k, BIAS : CURVE + 1] = here, *_derivatives(model, dof, above, here, below)
    return out


def _derivatives(model: mujoco.MjModel, dof: int, above: float, here: float, below: float) -> tuple[float, float]:
    """Slope and curve of a torque from its values either side; of a hinge as of a + b sin(away) + c (1 - cos(away))."""
    if int(model.jnt_type[model.dof_jntid[dof]]) != int(mujoco.mjtJoint.mjJNT_HINGE):
        return (above - below) / (2.0 * ANGLE), 0.0
    return (above - below) / (2.0 * math.sin(ANGLE)), (above + below - 2.0 * here) / (2.0 * (1.0 - math.cos(ANGLE)))


def _block(model: mujoco.MjModel, dof: int, motion: Motion) -> Array:
    """Inertia, bias, slope, curve, drag and coupling (n, T_SIZE) of one degree of freedom."""
    data = mujoco.MjData(model)
    result = np.zeros(model.nv)
    out = np.empty((len(motion.position), T_SIZE))
    dofs, address = _single(model)
    positions, speeds, accelerations = motion.position, motion.speed, motion.acceleration.copy()
    accelerations[:, dof] = 0.0

    def placed(q: float) -> float:
        data.qpos[at] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 1, result)
        return result[dof]

    at = int(model.jnt_qposadr[model.dof_jntid[dof]])
    for k in range(len(positions)):
        data.qpos[address] = positions[k][dofs]
        data.qvel[:] = speeds[k]
        data.qacc[:] = accelerations[k]
        q = positions[k, dof]
        above, below = placed(q + ANGLE), placed(q - ANGLE)
        here = placed(q)
        data.qacc[dof] = 1.0
        mujoco.mj_rne(model, data, 1, result)
        inertia = result[dof] - here
        data.qacc[:] = 0.0
        mujoco.mj_rne(model, data, 1, result)
        coupling = here - result[dof]
        data.qacc[:] = accelerations[k]
        data.qvel[dof] += 1.0  # the torque is linear in the own speed: it turns no body's inertia about its own axis
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 1, result)
        slope, curve = _derivatives(model, dof, above, here, below)
        out[k] = inertia, here, slope, curve, result[dof] - here, coupling
    return out


def _payload(model: mujoco.MjModel, tip: Tip) -> mujoco.MjModel:
    """The robot without any mass but a kilogram at its tip."""
    other = model.__copy__()
    other.body_mass[:] = 0.0
    other.body_inertia[:] = 0.0
    other.body_mass[tip.body] = 1.0
    other.body_ipos[tip.body] = tip.point
    other.body_sameframe[tip.body] = NONE
    other.body_subtreemass[:] = 0.0
    body = tip.body
    while body > 0:
        other.body_subtreemass[body] = 1.0
        body = int(other.body_parentid[body])
    other.body_subtreemass[0] = 1.0
    return other


def _shifted(model: mujoco.MjModel, joint: int, way: float) -> mujoco.MjModel:
    """The robot with the centre of mass of a joint's own body further from the joint [m]."""
    other = model.__copy__()
    body = int(model.jnt_bodyid[joint])
    arm = np.array(model.body_ipos[body]) - model.jnt_pos[joint]
    axis = np.array(model.jnt_axis[joint])
    if int(model.jnt_type[joint]) == int(mujoco.mjtJoint.mjJNT_HINGE):
        arm = arm - axis * (arm @ axis)
    size = float(np.linalg.norm(arm))
    if size > 1e-6:
        other.body_ipos[body] = np.array(model.body_ipos[body]) + way * arm / size
        other.body_sameframe[body] = NONE
    return other
