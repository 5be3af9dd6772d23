"""Puts chains on the coordinates of a MuJoCo model: what the engine knows natively goes into the model, the rest into the law."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from actuators.chain import Chain, ChainError, load_chain
from actuators.engine import install
from actuators.errors import SealegsError, nearest
from actuators.layout import (
    P_COEFFICIENT,
    P_DOF,
    P_FRICTION_ID,
    P_FRICTION_KIND,
    P_LATENCY,
    P_OFFSET,
    P_QPOS,
    P_SCALE,
    P_STATE_ADDRESS,
    P_STATE_SIZE,
    P_TERMS,
    P_TICKS,
)

# A dry friction row that creeps no faster than the noise of an encoder: the default impedance lets a held pendulum sink visibly.
FRICTION_SOLREF = (0.004, 1.0)
FRICTION_SOLIMP = (0.995, 0.9999, 0.001, 0.5, 2.0)
# Stops of a play as stiff as gear teeth; the defaults let them overlap by more than the play is wide (table in docs/numerics.md).
TOOTH_SOLREF = (0.004, 1.0)
TOOTH_SOLIMP = (0.99, 0.999, 0.0001, 0.5, 2.0)
MASSLESS = 1e-6  # [kg] and [kg.m2/100]: what the engine needs to accept a body whose inertia is the joint's armature


@dataclass(frozen=True)
class DrivenCoordinate:
    """What one actuator moves: a joint, or a belt over several.

    Attributes:
        name: of the coordinate; chains, goals and logs use it.
        terms: ``(joint, coefficient)``, the coordinate being the sum of coefficient times joint angle.
        motor_body: body that carries the motor; default: the parent of the first joint's body.
        rotor_mass: of the motor's rotating parts [kg], where it becomes a body of its own.
    """

    name: str
    terms: tuple[tuple[str, float], ...]
    motor_body: str | None = None
    rotor_mass: float = MASSLESS

    @staticmethod
    def of_joint(joint: str) -> DrivenCoordinate:
        """The coordinate that is one joint."""
        return DrivenCoordinate(joint, ((joint, 1.0),))


class Drivetrain:
    """A compiled model with chains on its coordinates.

    Attributes:
        model: the compiled model; step it in any way MuJoCo offers.
        spec: the specification it was compiled from.
        coordinates: the driven coordinates, in the order of ``ctrl``.
        chains: chain of each coordinate by name.
    """

    def __init__(
        self,
        spec: mujoco.MjSpec,
        chains: Mapping[str, str | Path | list | Chain],
        coordinates: Sequence[DrivenCoordinate] | None = None,
    ) -> None:
        """Edit ``spec`` (it is changed) and compile it.

        Args:
            spec: model without actuators on the driven coordinates.
            chains: chain of each coordinate by name.
            coordinates: default: the joints named in ``chains``.

        Raises:
            ChainError: a chain is wrong or stands for a coordinate that does not exist.
            SealegsError: the model does not compile with the chains on it.
        """
        if coordinates is None:
            coordinates = [DrivenCoordinate.of_joint(name) for name in chains]
        known = {item.name for item in coordinates}
        for name in chains:
            if name not in known:
                raise ChainError(f"there is no driven joint '{name}'{nearest(name, known)}; the robot has {', '.join(sorted(known))}.")
        self.coordinates = tuple(item for item in coordinates if item.name in chains)
        self.chains = {item.name: load_chain(chains[item.name]) for item in self.coordinates}
        self.spec = spec
        self._programs = {name: chain.program() for name, chain in self.chains.items()}
        self._sides = {item.name: _mount(spec, item, self.chains[item.name]) for item in self.coordinates}
        for item in self.coordinates:
            self._add_actuator(item.name)
        sizes = [int(self._programs[item.name][P_STATE_SIZE]) for item in self.coordinates]
        self._own_userdata = max(spec.nuserdata, 0)
        spec.nuserdata = self._own_userdata + sum(sizes)
        try:
            self.model = spec.compile()
        except ValueError as error:
            raise SealegsError(f"the model does not compile with its actuators: {error}.") from None
        self._address()
        install()

    # --- building ----------------------------------------------------------------------------------------------

    def _add_actuator(self, name: str) -> None:
        target, kind = self._sides[name].motor_target
        actuator = self.spec.add_actuator(name=name, target=target, trntype=kind)
        actuator.gaintype = mujoco.mjtGain.mjGAIN_FIXED
        actuator.gainprm[0] = 0.0
        actuator.biastype = mujoco.mjtBias.mjBIAS_USER
        actuator.userdata = self._programs[name]

    def _address(self) -> None:
        """Write addresses, known only after compiling, into the programs of model and specification."""
        model, address = self.model, self._own_userdata
        self.actuator_ids, self.state_addresses = {}, {}
        for item in self.coordinates:
            side = self._sides[item.name]
            program = self._programs[item.name]
            program[P_STATE_ADDRESS] = address
            program[P_TERMS] = len(side.motor_terms)
            for k, (joint, coefficient) in enumerate(side.motor_terms):
                number = model.joint(joint).id
                program[P_QPOS + k] = model.jnt_qposadr[number]
                program[P_DOF + k] = model.jnt_dofadr[number]
                program[P_COEFFICIENT + k] = coefficient
            if program[P_FRICTION_KIND] > 0.0:
                on_tendon = len(side.motor_terms) > 1
                program[P_FRICTION_KIND] = 2.0 if on_tendon else 1.0
                target = side.motor_target[0]
                program[P_FRICTION_ID] = model.tendon(target).id if on_tendon else model.jnt_dofadr[model.joint(target).id]
            actuator = model.actuator(item.name).id
            model.actuator_user[actuator] = 0.0
            model.actuator_user[actuator, : len(program)] = program
            self.spec.actuator(item.name).userdata = program
            self.actuator_ids[item.name] = actuator
            self.state_addresses[item.name] = address
            address += int(program[P_STATE_SIZE])

    # --- reading -----------------------------------------------------------------------------------------------

    def program(self, name: str) -> np.ndarray:
        """A copy of a coordinate's program with its addresses."""
        return self._programs[name].copy()

    def position(self, name: str, qpos: np.ndarray, side: str = "motor") -> np.ndarray:
        """True position of the motor or link side [rad], shape ``qpos.shape[:-1]``, from ``qpos`` (..., nq)."""
        return sum(c * qpos[..., self.model.jnt_qposadr[self.model.joint(j).id]] for j, c in self._terms(name, side))  # type: ignore[return-value]

    def speed(self, name: str, qvel: np.ndarray, side: str = "motor") -> np.ndarray:
        """True speed of the motor or link side [rad/s], shape ``qvel.shape[:-1]``, from ``qvel`` (..., nv)."""
        return sum(c * qvel[..., self.model.jnt_dofadr[self.model.joint(j).id]] for j, c in self._terms(name, side))  # type: ignore[return-value]

    def _terms(self, name: str, side: str) -> tuple[tuple[str, float], ...]:
        sides = self._sides[name]
        return sides.motor_terms if side == "motor" else sides.link_terms

    def set_position(self, name: str, qpos: np.ndarray, motor: float | np.ndarray, link: float | np.ndarray | None = None) -> None:
        """Place a coordinate in ``qpos`` (..., nq): its last joint takes up the difference; motor and link side together by default."""
        for side, value in (("link", motor if link is None else link), ("motor", motor)):
            *before, (joint, coefficient) = self._terms(name, side)
            rest = sum((c * qpos[..., self.model.jnt_qposadr[self.model.joint(j).id]] for j, c in before), np.zeros(qpos.shape[:-1]))
            qpos[..., self.model.jnt_qposadr[self.model.joint(joint).id]] = (value - rest) / coefficient

    def state(self, name: str, userdata: np.ndarray, slot: int) -> np.ndarray:
        """One slot (``actuators.layout.S_*``) of a coordinate's law, from ``userdata`` (..., nuserdata)."""
        return userdata[..., self.state_addresses[name] + slot]

    def reading(self, name: str, qpos: np.ndarray, userdata: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Position as the host receives it [rad], shape (n,), from batch arrays (n, nq), (n, nuserdata), (n,)."""
        program = self._programs[name]
        position = self.position(name, qpos)
        if program[P_LATENCY] > 0.0:
            start = self.state_addresses[name]
            position = _late(program, userdata[:, start : start + int(program[P_STATE_SIZE])], time, position)
        value = program[P_SCALE] * position + program[P_OFFSET]
        if program[P_TICKS] > 0.0:
            step = 2.0 * np.pi / program[P_TICKS]
            value = np.floor(value / step + 0.5) * step
        return value

    # --- changing ----------------------------------------------------------------------------------------------

    def set_value(self, target: Any, name: str, path: str, values: float | np.ndarray) -> None:
        """Change a chain parameter in a model, or per simulation in a batch.

        Args:
            target: ``mujoco.MjModel`` of this drivetrain, or a ``mujoco.batch.Batch`` of it.
            name: coordinate.
            path: ``stage.parameter`` of its chain.
            values: one value, or one per simulation of a batch (nsim,).
        """
        batch = not isinstance(target, mujoco.MjModel)
        values = np.broadcast_to(np.asarray(values, float), (target.nsim,)) if batch else np.atleast_1d(np.asarray(values, float))
        rows = target.expand("actuator_user") if batch else target.actuator_user[None]
        for k, value in enumerate(values):
            chain = self.chains[name].with_value(path, float(value))
            program = chain.program()
            if len(program) != len(self._programs[name]) or program[P_STATE_SIZE] != self._programs[name][P_STATE_SIZE]:
                raise ChainError(f"{path} = {value:g} changes the memory of the chain; build another Drivetrain for it.")
            program[P_STATE_ADDRESS : P_FRICTION_ID + 1] = self._programs[name][P_STATE_ADDRESS : P_FRICTION_ID + 1]
            rows[k, self.actuator_ids[name], : len(program)] = program
            self._set_native(target, batch, k, name, chain)

    def _set_native(self, target: Any, batch: bool, k: int, name: str, chain: Chain) -> None:
        for field, number, value in self._sides[name].native(self.model, chain):
            old = getattr(self.model, field)[number]
            if np.allclose(old, value) and not (batch and target.expanded(field) is not None):
                continue
            (target.expand(field)[k] if batch else getattr(target, field))[number] = value


@dataclass(frozen=True)
class _Side:
    """Names of what a chain became in the model."""

    motor_terms: tuple[tuple[str, float], ...]
    link_terms: tuple[tuple[str, float], ...]
    motor_target: tuple[str, Any]
    coupling: str | None  # tendon of spring, compliance or play

    def native(self, model: mujoco.MjModel, chain: Chain) -> list[tuple[str, int, Any]]:
        """``(model field, index, value)`` of the native half of a chain."""
        friction = chain.find("friction")
        coulomb, viscous = (_native_coulomb(chain), friction.viscous) if friction else (0.0, 0.0)
        target, kind = self.motor_target
        rows: list[tuple[str, int, Any]] = []
        if kind == mujoco.mjtTrn.mjTRN_TENDON:
            number = model.tendon(target).id
            rows += [("tendon_armature", number, chain.armature()), ("tendon_frictionloss", number, coulomb)]
            rows += [("tendon_damping", number, viscous)]
        else:
            number = int(model.jnt_dofadr[model.joint(target).id])
            inertia = max(chain.armature(), MASSLESS) if self.coupling else chain.armature()
            rows += [("dof_armature", number, inertia), ("dof_frictionloss", number, coulomb), ("dof_damping", number, viscous)]
        element = chain.find("spring") or chain.find("compliance")
        if self.coupling and element:
            number = model.tendon(self.coupling).id
            rows += [("tendon_stiffness", number, element.stiffness), ("tendon_damping", number, element.damping)]
        return rows


def _native_coulomb(chain: Chain) -> float:
    """Native dry friction; never quite zero where a law sets the limit, because the engine makes no row for zero."""
    friction = chain.find("friction")
    coulomb = friction.coulomb if friction else 0.0
    return max(coulomb, 1e-6) if chain.friction_needs_law() else coulomb


def _mount(spec: mujoco.MjSpec, item: DrivenCoordinate, chain: Chain) -> _Side:
    """Add motor body, tendon, friction and armature of one coordinate to a specification."""
    for joint, _ in item.terms:
        if spec.joint(joint) is None:
            names = [other.name for other in spec.joints]
            raise SealegsError(f"the model has no joint '{joint}'{nearest(joint, names)} to put an actuator on.")
    friction = chain.find("friction")
    viscous = friction.viscous if friction else 0.0
    element, play = chain.find("spring") or chain.find("compliance"), chain.find("backlash")
    if element is None and play is None:
        if len(item.terms) == 1:
            target = spec.joint(item.terms[0][0])
            target.armature += chain.armature()
            kind, motor = mujoco.mjtTrn.mjTRN_JOINT, (item.terms[0][0], 1.0)
            terms: tuple[tuple[str, float], ...] = (motor,)
        else:
            target = _tendon(spec, f"{item.name}_belt", item.terms)
            target.armature = chain.armature()
            kind, terms = mujoco.mjtTrn.mjTRN_TENDON, item.terms
        _dissipate(target, viscous, _native_coulomb(chain))
        return _Side(terms, item.terms, (target.name, kind), None)
    body = spec.body(item.motor_body) if item.motor_body else spec.joint(item.terms[0][0]).parent.parent
    rotor = body.add_body(name=f"{item.name}_rotor", mass=item.rotor_mass, inertia=[item.rotor_mass / 100.0] * 3, explicitinertial=True)
    motor_joint = f"{item.name}_motor"
    rotor.add_joint(name=motor_joint, type=mujoco.mjtJoint.mjJNT_HINGE, axis=spec.joint(item.terms[0][0]).axis)
    joint = spec.joint(motor_joint)
    joint.armature = max(chain.armature(), MASSLESS)
    _dissipate(joint, viscous, _native_coulomb(chain))
    tendon = _tendon(spec, f"{item.name}_coupling", ((motor_joint, 1.0), *((name, -c) for name, c in item.terms)))
    half = play.width / 2.0 if play is not None else 0.0
    if element is not None:
        tendon.stiffness = [element.stiffness, 0.0, 0.0] if np.size(tendon.stiffness) > 1 else element.stiffness
        tendon.damping = [element.damping, 0.0, 0.0] if np.size(tendon.damping) > 1 else element.damping
        tendon.springlength = [-half, half]
    else:
        tendon.limited = True
        tendon.range = [-half, half]
        tendon.solref_limit, tendon.solimp_limit = TOOTH_SOLREF, TOOTH_SOLIMP
    return _Side(((motor_joint, 1.0),), item.terms, (motor_joint, mujoco.mjtTrn.mjTRN_JOINT), tendon.name)


def _tendon(spec: mujoco.MjSpec, name: str, terms: Sequence[tuple[str, float]]) -> Any:
    tendon = spec.add_tendon(name=name)
    for joint, coefficient in terms:
        tendon.wrap_joint(joint, coefficient)
    return tendon


def _dissipate(target: Any, viscous: float, coulomb: float) -> None:
    """Native viscous and dry friction of a joint or tendon."""
    target.damping = [viscous, 0.0, 0.0] if np.size(target.damping) > 1 else viscous
    target.frictionloss = coulomb
    target.solref_friction, target.solimp_friction = FRICTION_SOLREF, FRICTION_SOLIMP


def _late(program: np.ndarray, states: np.ndarray, time: np.ndarray, position: np.ndarray) -> np.ndarray:
    from actuators.stages.sensor import late_position

    return np.array([late_position(program, states[k], time[k], position[k]) for k in range(len(position))])


