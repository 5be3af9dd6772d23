"""Puts chains on the coordinates of a MuJoCo model: what is native goes into the model, the rest into the law."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ..common.errors import SealegsError, nearest
from .chain import Chain, ChainError, load_chain
from .engine import install
from .layout import (
    P_COEFFICIENT,
    P_DOF,
    P_FRICTION_ID,
    P_FRICTION_KIND,
    P_LATENCY,
    P_LOAD_FACTOR,
    P_LOAD_STATE,
    P_OFFSET,
    P_OWN_FRICTION,
    P_QPOS,
    P_SCALE,
    P_STATE_ADDRESS,
    P_STATE_SIZE,
    P_SUPPLY,
    P_SUPPLY_NEXT,
    P_TERMS,
    P_TICKS,
)
from .mounting import ENGINE_DEFAULTS, DrivenCoordinate, Mounted, mount
from .stability import check_step
from .stages.sensor import late_positions


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
        *,
        checked: bool = True,
    ) -> None:
        """Edit ``spec`` (it is changed) and compile it.

        Args:
            spec: model without actuators on the driven coordinates.
            chains: chain of each coordinate by name.
            coordinates: default: the joints named in ``chains``.
            checked: whether chains are refused that the step of the model makes unstable.

        Raises:
            ChainError: a chain is wrong or stands for a coordinate that does not exist.
            SealegsError: the model does not compile with the chains on it.
        """
        if coordinates is None:
            coordinates = [DrivenCoordinate.of_joint(name) for name in chains]
        known = {item.name for item in coordinates}
        for name in chains:
            if name not in known:
                raise ChainError(
                    f"there is no driven joint '{name}'{nearest(name, known)}; "
                    f"the robot has {', '.join(sorted(known))}."
                )
        self.coordinates = tuple(item for item in coordinates if item.name in chains)
        self.chains = {item.name: load_chain(chains[item.name]) for item in self.coordinates}
        self.spec = spec
        self._programs = {name: chain.program() for name, chain in self.chains.items()}
        self._sides: dict[str, Mounted] = {
            item.name: mount(spec, item, self.chains[item.name]) for item in self.coordinates
        }
        for item in self.coordinates:
            self._add_actuator(item.name)
        sizes = [int(self._programs[item.name][P_STATE_SIZE]) for item in self.coordinates]
        self._own_userdata = max(spec.nuserdata, 0)
        spec.nuserdata = self._own_userdata + sum(sizes)
        spec.nuser_actuator = -1  # as many as the programs need: a number that the file gives would be too small
        if checked:
            self._check_rates()
        install()  # before compiling, which evaluates actuators too
        try:
            self.model = spec.compile()
        except ValueError as error:
            raise SealegsError(f"the model does not compile with its actuators: {error}.") from None
        if checked:
            self._check_steps()
        self.set_teeth()
        self._address()
        if self.model.ntree == 1:  # one tree is one island: looking for others costs 5 % of a step
            flag = int(mujoco.mjtDisableBit.mjDSBL_ISLAND)
            self.model.opt.disableflags |= flag
            spec.option.disableflags |= flag

    # --- building ----------------------------------------------------------------------------------------------

    def _check_rates(self) -> None:
        step = self.spec.option.timestep
        for name, chain in self.chains.items():
            net = chain.find("net")
            if net is not None and step > 1.001 * (period := net.period()):
                raise ChainError(
                    f"the actuator net on '{name}' works at {1 / period:g} Hz, but the simulation steps at "
                    f"{1 / step:g} Hz; make its time step {period:g} s or shorter."
                )

    def _check_steps(self) -> None:
        for name, (inertia, coupled) in self.inertias().items():
            if inertia < np.inf:
                check_step(name, self.chains[name], inertia, coupled, self.model.opt)

    def inertias(self) -> dict[str, tuple[float, bool]]:
        """Inertia that each motor feels [kg.m2 or kg], and whether a spring or play lies between it and the link."""
        model, found = self.model, {}
        for item in self.coordinates:
            side = self._sides[item.name]
            weights = model.tendon_invweight0 if side.on_tendon else model.dof_invweight0
            mobility = float(weights[side.friction_id(model)])
            coupled = side.coupling is not None or side.deflection is not None
            found[item.name] = (1.0 / mobility if mobility > 0.0 else np.inf), coupled
        return found

    def set_teeth(self) -> None:
        """How hard teeth are goes into model and specification: again where step or inertias have changed.

        The engine takes it per inertia.
        """
        for item in self.coordinates:
            side = self._sides[item.name]
            if side.coupling is None:
                continue
            tendon = self.spec.tendon(side.coupling)
            for field, number, value in side.native(self.model, self.chains[item.name]):
                if field == "tendon_solref_lim":
                    self.model.tendon_solref_lim[number] = tendon.solref_limit = value
                elif field == "tendon_solimp_lim":
                    self.model.tendon_solimp_lim[number] = tendon.solimp_limit = value

    def _add_actuator(self, name: str) -> None:
        side = self._sides[name]
        kind = mujoco.mjtTrn.mjTRN_TENDON if side.on_tendon else mujoco.mjtTrn.mjTRN_JOINT
        actuator = self.spec.add_actuator(default=ENGINE_DEFAULTS, name=name, target=side.target, trntype=kind)
        actuator.gaintype = mujoco.mjtGain.mjGAIN_FIXED
        actuator.gainprm[0] = 0.0
        actuator.biastype = mujoco.mjtBias.mjBIAS_USER
        actuator.userdata = self._programs[name]

    def _address(self) -> None:
        """Write addresses, known only after compiling, into the programs of model and specification."""
        model, address = self.model, self._own_userdata
        joints = [model.joint(number) for number in range(model.njnt)]
        self._qpos_addresses = {joint.name: int(joint.qposadr[0]) for joint in joints}
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
                program[P_FRICTION_KIND] = 2.0 if side.on_tendon else 1.0
                program[P_FRICTION_ID] = side.friction_id(model)
                program[P_OWN_FRICTION] = side.own.frictionloss
            actuator = model.actuator(item.name).id
            model.actuator_user[actuator] = 0.0
            self.actuator_ids[item.name] = actuator
            self.state_addresses[item.name] = address
            address += int(program[P_STATE_SIZE])
        drawing = [item.name for item in self.coordinates if self.chains[item.name].shares_supply()]
        for name, following in zip(drawing, [*drawing[1:], *drawing[:1]], strict=True):
            self._programs[name][P_SUPPLY] = self.chains[name].address("supply.resistance")
            self._programs[name][P_SUPPLY_NEXT] = self.actuator_ids[following]
        for item in self.coordinates:
            if item.pressed_by is not None and item.pressed_by[0] in self.state_addresses:
                program = self._programs[item.name]
                program[P_LOAD_STATE] = self.state_addresses[item.pressed_by[0]]
                program[P_LOAD_FACTOR] = item.pressed_by[1]
        for name, program in self._programs.items():
            model.actuator_user[self.actuator_ids[name], : len(program)] = program
            self.spec.actuator(name).userdata = program

    # --- reading -----------------------------------------------------------------------------------------------

    def program(self, name: str) -> np.ndarray:
        """A copy of a coordinate's program with its addresses."""
        return self._programs[name].copy()

    def position(self, name: str, qpos: np.ndarray, side: str = "motor") -> np.ndarray:
        """True position of the motor or link side [rad], shape ``qpos.shape[:-1]``, from ``qpos`` (..., nq)."""
        terms = self.terms(name, side)
        return np.sum([c * qpos[..., self._qpos_address(joint)] for joint, c in terms], axis=0)

    def speed(self, name: str, qvel: np.ndarray, side: str = "motor") -> np.ndarray:
        """True speed of the motor or link side [rad/s], shape ``qvel.shape[:-1]``, from ``qvel`` (..., nv)."""
        terms = self.terms(name, side)
        return np.sum([c * qvel[..., self.model.jnt_dofadr[self.model.joint(joint).id]] for joint, c in terms], axis=0)

    def terms(self, name: str, side: str = "motor") -> tuple[tuple[str, float], ...]:
        """Joints of the model and coefficients whose sum is the position of a coordinate's motor or link side."""
        sides = self._sides[name]
        return sides.motor_terms if side == "motor" else sides.link_terms

    def _qpos_address(self, joint: str) -> int:
        return self._qpos_addresses[joint]

    def set_position(
        self, name: str, qpos: np.ndarray, motor: float | np.ndarray, link: float | np.ndarray | None = None
    ) -> None:
        """Place a coordinate in ``qpos`` (..., nq): its last joint takes up the difference.

        ``link`` [rad] is where ``motor`` is by default.
        """
        for side, value in (("link", motor if link is None else link), ("motor", motor)):
            *before, (joint, coefficient) = self.terms(name, side)
            rest = np.zeros(qpos.shape[:-1])
            for other, c in before:
                rest = rest + c * qpos[..., self._qpos_address(other)]
            qpos[..., self._qpos_address(joint)] = (value - rest) / coefficient

    def set_speed(self, name: str, qvel: np.ndarray, value: float) -> None:
        """Let motor and link of a coordinate that is one joint move alike [rad/s] in ``qvel`` (nv,)."""
        for side in ("link", "motor"):
            joint, coefficient = self.terms(name, side)[-1]
            qvel[self.model.jnt_dofadr[self.model.joint(joint).id]] = value / coefficient

    def state(self, name: str, userdata: np.ndarray, slot: int) -> np.ndarray:
        """One slot (``sealegs.actuators.layout.S_*``) of a coordinate's law, from ``userdata`` (..., nuserdata)."""
        return userdata[..., self.state_addresses[name] + slot]

    def reading(
        self,
        name: str,
        qpos: np.ndarray,
        userdata: np.ndarray,
        time: np.ndarray,
        programs: np.ndarray | None = None,
        *,
        ticks: bool = True,
    ) -> np.ndarray:
        """Position as the host receives it [rad], shape (n,), from batch arrays (n, nq), (n, nuserdata), (n,).

        ``programs`` is the batch's ``actuator_user`` (n, nu, nuser), where encoders differ between simulations; without
        ``ticks`` it is what an encoder rounds, to which its noise is added first.
        """
        program = self._programs[name][None] if programs is None else programs[:, self.actuator_ids[name]]
        position = self.position(name, qpos)
        if program[:, P_LATENCY].any():
            start = self.state_addresses[name]
            states = userdata[:, start : start + int(self._programs[name][P_STATE_SIZE])]
            position = late_positions(np.broadcast_to(program, (len(qpos), program.shape[1])), states, time, position)
        value = program[:, P_SCALE] * position + program[:, P_OFFSET]
        count = program[:, P_TICKS]
        if ticks and count.any():
            step = 2.0 * np.pi / np.where(count > 0.0, count, 1.0)
            value = np.where(count > 0.0, np.floor(value / step + 0.5) * step, value)
        return value

    # --- changing ----------------------------------------------------------------------------------------------

    def set_value(self, target: Any, name: str, path: str, values: float | np.ndarray) -> None:
        """Change one chain parameter in a model, or per simulation in a batch; its others are as the chain was built.

        Args:
            target: ``mujoco.MjModel`` of this drivetrain, or a ``mujoco.batch.Batch`` of it.
            name: coordinate.
            path: ``stage.parameter`` of its chain.
            values: one value, or one per simulation of a batch (nsim,).
        """
        count = 1 if isinstance(target, mujoco.MjModel) else target.nsim
        values = np.broadcast_to(np.asarray(values, float), (count,))
        for k, value in enumerate(values):
            self.set_chain(target, name, self.chains[name].with_value(path, float(value)), k)

    def set_chain(self, target: Any, name: str, chain: Chain, simulation: int = 0) -> None:
        """Put a chain of other parameter values on a coordinate of a model, or of one simulation of a batch.

        Raises:
            ChainError: the chain has other stages or other memory than the one the drivetrain was built with.
        """
        batch = not isinstance(target, mujoco.MjModel)
        if chain.friction_needs_law() and not self.chains[name].friction_needs_law():
            raise ChainError(
                f"{chain.label} has a kind of friction that the chain on '{name}' was built without; "
                "build another Drivetrain for it."
            )
        rows = target.expand("actuator_user") if batch else target.actuator_user[None]
        built, program = self._programs[name], chain.program()
        if len(program) != len(built) or program[P_STATE_SIZE] != built[P_STATE_SIZE]:
            raise ChainError(
                f"{chain.label} has other stages or memory than the chain on '{name}'; build another Drivetrain for it."
            )
        program[P_STATE_ADDRESS : P_FRICTION_ID + 1] = built[P_STATE_ADDRESS : P_FRICTION_ID + 1]
        for slot in (P_OWN_FRICTION, P_LOAD_STATE, P_LOAD_FACTOR, P_SUPPLY, P_SUPPLY_NEXT):
            program[slot] = built[slot]
        rows[simulation, self.actuator_ids[name], : len(program)] = program
        self._set_native(target, batch, simulation, name, chain)

    def _set_native(self, target: Any, batch: bool, k: int, name: str, chain: Chain) -> None:
        for field, number, value in self._sides[name].native(self.model, chain):
            old = getattr(self.model, field)[number]
            expanded = batch and target.expanded(field) is not None
            if batch and not expanded and np.allclose(old, value, rtol=1e-12, atol=0.0):
                continue
            (target.expand(field)[k] if batch else getattr(target, field))[number] = value
