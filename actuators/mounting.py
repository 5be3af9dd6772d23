"""The native half of a chain: what MuJoCo simulates itself becomes part of the model, before it is compiled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ..common.errors import SealegsError, nearest
from .chain import Chain
from .stages import ChainError

# Chosen by measurement: docs/numerics.md, reproduced by `python -m benchmarks.numerics`.
# Dry friction must creep no faster than an encoder can see; the default lets a held pendulum sink visibly.
# The engine raises the time constant to twice the step (refsafe): a short one means as stiff as the step allows.
FRICTION_SOLREF = (0.001, 1.0)
FRICTION_SOLIMP = (0.9999, 0.9999, 0.001, 0.5, 2.0)
# Beside stiffness and damping per inertia (a negative solref) a low impedance makes a spring, which adds to all other
# torques; a high one would replace them.
SPRING_SOLIMP = (0.001, 0.001, 0.001, 0.5, 2.0)
# Stops of a play as stiff as gear teeth; the defaults let them overlap by more than the play is wide.
TOOTH_SOLREF = (0.004, 1.0)
TOOTH_SOLIMP = (0.99, 0.999, 0.0001, 0.5, 2.0)
# A spring's hard stop: inelastic within two steps, as one whose damper outweighs the pulley that meets it.
STOP_SOLREF = (0.002, 1.0)
STOP_SOLIMP = (0.99, 0.999, 0.001, 0.5, 2.0)
SPRING_TRAVEL = 1e3  # [rad] no stop on the other side
# What is added to a user's model starts from these: otherwise it takes gears, force limits, friction, springs and stops
# from the default classes of the file.
EMPTY = mujoco.MjSpec()
ENGINE_DEFAULTS = EMPTY.default
MASSLESS = 1e-6  # [kg] and [kg.m2/100]: what the engine needs to accept a body whose inertia is the joint's armature


@dataclass(frozen=True)
class DrivenCoordinate:
    """What one actuator moves: a joint, or a belt over several.

    Attributes:
        name: of the coordinate; chains, goals and logs use it.
        terms: ``(joint, coefficient)``, the coordinate being the sum of coefficient times joint angle.
        motor_body: body that carries the motor; default: the parent of the first joint's body.
        rotor_mass: of the motor's rotating parts [kg], where it becomes a body of its own.
        pressed_by: coordinate whose contact load presses on this one's transmission and sets its load dependent
            friction, and that load per contact torque of the coordinate; default: the torque through the transmission.
        rotor: body of the model that turns with the motor, with all its inertia: a jointless child of the first joint's
            body, where it stays while motor and link are one. Behind a spring or play it turns on its own, carried by
            ``motor_body``. The chain's armature counts from it on: what the body has about the axis is left out.
    """

    name: str
    terms: tuple[tuple[str, float], ...]
    motor_body: str | None = None
    rotor_mass: float = MASSLESS
    pressed_by: tuple[str, float] | None = None
    rotor: str | None = None

    @staticmethod
    def of_joint(joint: str) -> DrivenCoordinate:
        """The coordinate that is one joint."""
        return DrivenCoordinate(joint, ((joint, 1.0),))


@dataclass(frozen=True)
class OwnValues:
    """Armature [kg.m2], viscous friction [N.m.s/rad] and dry friction [N.m] of a joint before a chain was put on it.

    ``held`` [kg.m2] is what a rotor that is a body of its own has about the axis: the chain's armature counts it too.
    """

    armature: float = 0.0
    damping: float = 0.0
    frictionloss: float = 0.0
    held: float = 0.0

    def with_rotor(self, inertia: float) -> float:
        """Armature of the joint with a chain of so much inertia on it [kg.m2 or kg].

        A rotor has no less than nothing; the joint's own may be below 0, where its load was found to be less than its
        bodies are.
        """
        return min(self.armature, 0.0) + max(max(self.armature, 0.0) + inertia - self.held, 0.0)


@dataclass(frozen=True)
class Mounted:
    """Names of what a chain became in the model.

    Attributes:
        motor_terms: joints and coefficients whose sum is the motor side's position.
        link_terms: those of the link side; the same where nothing gives way between the two.
        target: joint or tendon that the actuator acts on.
        on_tendon: whether that is a tendon.
        coupling: tendon that is the spring, compliance or play between motor and link.
        deflection: joint that is the deflection of a spring with an inertia of its own.
        own: what the model itself gives the driven joint, to which the chain's is added.
    """

    motor_terms: tuple[tuple[str, float], ...]
    link_terms: tuple[tuple[str, float], ...]
    target: str
    on_tendon: bool
    coupling: str | None = None
    own: OwnValues = OwnValues()
    deflection: str | None = None

    def friction_id(self, model: mujoco.MjModel) -> int:
        """What the engine's dry friction row of the coordinate is of: a degree of freedom or a tendon."""
        if self.on_tendon:
            return model.tendon(self.target).id
        return int(model.jnt_dofadr[model.joint(self.target).id])

    def native(self, model: mujoco.MjModel, chain: Chain) -> list[tuple[str, int, Any]]:
        """``(model field, index, value)`` of everything native about a chain."""
        friction = chain.find("friction")
        viscous = friction.viscous if friction else 0.0
        number, kind = self.friction_id(model), "tendon" if self.on_tendon else "dof"
        inertia = rotor_inertia(chain, self.motor_terms[0][0]) if self.coupling else chain.armature()
        rows: list[tuple[str, int, Any]] = [
            (f"{kind}_armature", number, self.own.with_rotor(inertia)),
            (f"{kind}_frictionloss", number, self.own.frictionloss + native_coulomb(chain)),
            (f"{kind}_damping", number, self.own.damping + viscous),
        ]
        if self.deflection is not None:
            spring, joint = chain.find("spring"), model.joint(self.deflection).id
            dof = int(model.jnt_dofadr[joint])
            rows += [("jnt_stiffness", joint, spring.stiffness), ("dof_damping", dof, spring.damping)]
            rows += [("dof_armature", dof, spring.inertia)]
        if self.coupling is None:
            return rows
        number = model.tendon(self.coupling).id
        element, play = coupling_element(chain), chain.find("backlash")
        half = play.width / 2.0 if play is not None else 0.0
        if element is not None:
            rows += [("tendon_stiffness", number, element.stiffness), ("tendon_damping", number, element.damping)]
            rows += [("tendon_lengthspring", number, (-half, half))]
        else:
            solref, solimp = TOOTH_SOLREF, TOOTH_SOLIMP
            if play is not None and play.tooth_stiffness > 0.0:
                mobility, step = float(model.tendon_invweight0[number]), model.opt.timestep
                solref, solimp = spring_constraint(play.tooth_stiffness, play.tooth_damping, mobility, step)
            rows += [("tendon_range", number, (-half, half))]
            rows += [("tendon_solref_lim", number, solref), ("tendon_solimp_lim", number, solimp)]
        return rows


def spring_constraint(
    stiffness: float, damping: float, mobility: float, step: float
) -> tuple[tuple[float, float], tuple[float, ...]]:
    """``solref`` and ``solimp`` that make a limit of the engine a spring with a damper.

    The engine takes both per inertia. They are at most what is stable at the step.

    Args:
        stiffness: [N.m/rad].
        damping: [N.m.s/rad].
        mobility: one over the inertia that the engine sees (``invweight0``) [1/(kg.m2)].
        step: of the simulation [s].
    """
    return (-min(stiffness * mobility, 1.0 / step**2), -min(damping * mobility, 1.0 / step)), SPRING_SOLIMP


def coupling_element(chain: Chain) -> Any:
    """The spring or compliance that lies between the motor's joint and the link, or None."""
    spring = chain.find("spring")
    return chain.find("compliance") if spring is None or spring.has_coordinate else spring


def rotor_inertia(chain: Chain, name: str) -> float:
    """Inertia of a motor that is a body of its own [kg.m2].

    Raises:
        ChainError: the chain gives none, so that any torque would make its speed infinite.
    """
    if (inertia := chain.armature()) <= 0.0:
        raise ChainError(
            f"{chain.label}: the motor '{name}' has a spring or play between itself and its link, but no inertia; "
            "give its motor ('dc_motor', 'regression', 'ideal' or 'net') an 'armature'."
        )
    return inertia


def native_coulomb(chain: Chain) -> float:
    """Native dry friction; never quite zero where a law sets the limit, because the engine makes no row for zero."""
    friction, meshing = chain.find("friction"), chain.find("meshing")
    coulomb = friction.coulomb if friction else 0.0
    coulomb += meshing.coulomb(chain) if meshing else 0.0
    return max(coulomb, 1e-6) if chain.friction_needs_law() else coulomb


def mount(spec: mujoco.MjSpec, item: DrivenCoordinate, chain: Chain) -> Mounted:
    """Add motor body, tendon, friction and armature of one coordinate to a specification.

    Raises:
        SealegsError: the model lacks a joint or body of the coordinate.
    """
    if not 1 <= len(item.terms) <= 2:
        raise SealegsError(f"'{item.name}' is driven over {len(item.terms)} joints; a belt runs over one or two.")
    for joint, _ in item.terms:
        if spec.joint(joint) is None:
            names = [other.name for other in spec.joints]
            raise SealegsError(f"the model has no joint '{joint}'{nearest(joint, names)} to put an actuator on.")
    friction = chain.find("friction")
    viscous = friction.viscous if friction else 0.0
    element, play, deflection = coupling_element(chain), chain.find("backlash"), None
    if (spring := chain.find("spring")) is not None and spring.has_coordinate:
        deflection = _mount_deflection(spec, item, spring)
    axis, turning, held = spec.joint(item.terms[0][0]).axis, None, 0.0
    if item.rotor is not None:
        turning = rotor_body(spec, item.rotor, item.terms[0][0])
        held = inertia_about(turning, axis)
    if element is None and play is None:
        return _mount_stiff(spec, item, chain, viscous, deflection, held)
    carrier = _carrier(spec, item)
    rotor = _massless(carrier, item, f"{item.name}_rotor") if turning is None else release(spec, turning, carrier)
    motor_joint = f"{item.name}_motor"
    joint = rotor.add_joint(default=ENGINE_DEFAULTS, name=motor_joint, type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis)
    joint.armature = max(rotor_inertia(chain, item.name) - held, 0.0)
    _dissipate(joint, viscous, native_coulomb(chain))
    between = ((motor_joint, 1.0), *((name, -c) for name, c in item.terms))
    if deflection is not None:
        between += ((deflection, 1.0),)
    tendon = _tendon(spec, f"{item.name}_coupling", between)
    half = play.width / 2.0 if play is not None else 0.0
    if element is not None:
        tendon.stiffness = _polynomial(tendon.stiffness, element.stiffness)
        tendon.damping = _polynomial(tendon.damping, element.damping)
        tendon.springlength = [-half, half]
    else:
        if play is not None and play.tooth_damping > 0.0 and play.tooth_stiffness == 0.0:
            raise ChainError(
                f"{chain.label}: 'backlash' has a tooth_damping but no tooth_stiffness; give both or neither."
            )
        tendon.limited = True
        tendon.range = [-half, half]
        tendon.solref_limit, tendon.solimp_limit = TOOTH_SOLREF, TOOTH_SOLIMP
    own = OwnValues(held=held)
    return Mounted(((motor_joint, 1.0),), item.terms, motor_joint, False, tendon.name, own, deflection)


def _carrier(spec: mujoco.MjSpec, item: DrivenCoordinate) -> mujoco.MjsBody:
    """The body that carries the motor."""
    body = spec.body(item.motor_body) if item.motor_body else spec.joint(item.terms[0][0]).parent.parent
    if body is None:
        names = [other.name for other in spec.bodies]
        raise SealegsError(
            f"the model has no body '{item.motor_body}'{nearest(str(item.motor_body), names)} for a motor."
        )
    return body


def _massless(carrier: mujoco.MjsBody, item: DrivenCoordinate, name: str) -> mujoco.MjsBody:
    """A body for a turning part whose inertia is its joint's armature."""
    return carrier.add_body(
        name=name,
        mass=item.rotor_mass,
        ipos=[0.0, 0.0, 0.0],  # without it, MuJoCo writes no inertia at all into XML
        inertia=[item.rotor_mass / 100.0] * 3,
        explicitinertial=True,
    )


def _mount_deflection(spec: mujoco.MjSpec, item: DrivenCoordinate, spring: Any) -> str:
    """The joint that is the deflection of a spring which turns an inertia, against its stop where it has one."""
    pulley = _massless(_carrier(spec, item), item, f"{item.name}_pulley")
    name = f"{item.name}_spring"
    axis = spec.joint(item.terms[0][0]).axis
    joint = pulley.add_joint(default=ENGINE_DEFAULTS, name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis)
    joint.armature = spring.inertia
    joint.stiffness = _polynomial(joint.stiffness, spring.stiffness)
    joint.damping = _polynomial(joint.damping, spring.damping)
    if abs(spring.unilateral) > 0.5:
        travel = np.degrees(SPRING_TRAVEL) if joint.compiler.degree else SPRING_TRAVEL
        joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        joint.range = (0.0, travel) if spring.unilateral > 0.0 else (-travel, 0.0)
        joint.solref_limit, joint.solimp_limit = STOP_SOLREF, STOP_SOLIMP
    return name


def _mount_stiff(
    spec: mujoco.MjSpec,
    item: DrivenCoordinate,
    chain: Chain,
    viscous: float,
    deflection: str | None,
    held: float,
) -> Mounted:
    """Motor and link are one, but for the deflection of a spring that is a joint of its own: the chain acts on the
    joint itself, or on a tendon where the motor's position is a sum.
    """
    terms = item.terms if deflection is None else (*item.terms, (deflection, -1.0))
    if len(terms) > 2:
        raise ChainError(
            f"{chain.label}: behind a belt over two joints ('{item.name}'), a 'spring' with an inertia needs a "
            "'compliance' in series."
        )
    on_tendon = len(terms) > 1 or any(factor != 1.0 for _, factor in terms)
    own = OwnValues()
    if on_tendon:
        target = _tendon(spec, f"{item.name}_belt", terms)
        target.armature = chain.armature()
    else:
        target = spec.joint(item.terms[0][0])
        own = OwnValues(target.armature, float(np.ravel(target.damping)[0]), target.frictionloss, held)
        target.armature = own.with_rotor(chain.armature())
        terms = ((target.name, 1.0),)
    _dissipate(target, viscous, native_coulomb(chain))
    return Mounted(terms, item.terms, target.name, on_tendon, own=own, deflection=deflection)


def _tendon(spec: mujoco.MjSpec, name: str, terms: Sequence[tuple[str, float]]) -> Any:
    tendon = spec.add_tendon(default=ENGINE_DEFAULTS, name=name)
    for joint, coefficient in terms:
        tendon.wrap_joint(joint, coefficient)
    return tendon


def _polynomial(field: Any, value: float) -> Any:
    """``value`` as the linear coefficient where MuJoCo takes a polynomial, whose others stay."""
    return [value, *np.ravel(field)[1:]] if np.size(field) > 1 else value


def _dissipate(target: Any, viscous: float, coulomb: float) -> None:
    """Add native viscous and dry friction to a joint or tendon."""
    target.damping = _polynomial(target.damping, float(np.ravel(target.damping)[0]) + viscous)
    target.frictionloss += coulomb
    target.solref_friction, target.solimp_friction = FRICTION_SOLREF, FRICTION_SOLIMP


# --- A motor's turning parts as a full body of the model, with all six inertias, where a robot's numbers have them ---


COPIED = ("mass", "ipos", "iquat", "inertia", "fullinertia", "explicitinertial")
DRAWN = ("type", "size", "pos", "quat", "fromto", "rgba", "group", "contype", "conaffinity", "mass")
TOUCHED = ("friction", "condim", "priority", "solmix", "solref", "solimp", "margin", "gap")


def rotor_body(spec: mujoco.MjSpec, name: str, joint: str) -> mujoco.MjsBody:
    """The body of that name, which must be a jointless child of the joint's body, in its frame.

    Raises:
        SealegsError: there is no such body, or it is somewhere else.
    """
    body = spec.body(name)
    if body is None:
        names = [other.name for other in spec.bodies]
        raise SealegsError(f"the model has no body '{name}'{nearest(name, names)} to be a rotor.")
    placed = np.any(np.asarray(body.pos) != 0.0) or np.any(np.asarray(body.quat) != (1.0, 0.0, 0.0, 0.0))
    if body.parent.name != spec.joint(joint).parent.name or list(body.joints) or placed:
        raise SealegsError(
            f"the rotor '{name}' must be a child of the body of joint '{joint}', in its frame and unmoved."
        )
    return body


def inertia_about(body: mujoco.MjsBody, axis: np.ndarray) -> float:
    """Inertia of a body about an axis through its origin [kg.m2]."""
    along = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    full = np.asarray(body.fullinertia, dtype=float)
    if np.isfinite(full).all():
        xx, yy, zz, xy, xz, yz = full
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    else:
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, np.asarray(body.iquat, dtype=float))
        matrix = turn.reshape(3, 3)
        tensor = matrix @ np.diag(np.asarray(body.inertia, dtype=float)) @ matrix.T
    aside = np.cross(along, np.asarray(body.ipos, dtype=float))
    return float(along @ tensor @ along + body.mass * (aside @ aside))


def release(spec: mujoco.MjSpec, rotor: mujoco.MjsBody, carrier: mujoco.MjsBody) -> mujoco.MjsBody:
    """Take a rotor out of its link and put it, without a joint yet, on the body that carries the motor.

    Raises:
        SealegsError: ``carrier`` is not the parent of the rotor's link.
    """
    link, name = rotor.parent, rotor.name
    if link.parent.name != carrier.name:
        raise SealegsError(f"the rotor '{name}' needs its motor on '{link.parent.name}', which carries its link.")
    values = {field: np.copy(getattr(rotor, field)) for field in COPIED}
    shapes = [{field: np.copy(getattr(geom, field)) for field in (*DRAWN, *TOUCHED)} for geom in rotor.geoms]
    spec.delete(rotor)
    moved = carrier.add_body(name=name, pos=link.pos, quat=link.quat)
    for field, value in values.items():
        setattr(moved, field, value if value.ndim else value.item())
    for shape in shapes:
        geom = moved.add_geom()
        for field, value in shape.items():
            setattr(geom, field, value if value.ndim else value.item())
    return moved
