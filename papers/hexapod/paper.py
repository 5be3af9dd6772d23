"""The paper's experiments: motors at 0 V (paper 001, section 6), and the tripod gait (section 7)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from ...actuators import Chain, Drivetrain
from ...actuators.gravity import GRAVITY
from ...actuators.layout import S_CURRENT, S_LOAD, S_TORQUE, S_VOLTAGE
from ...actuators.stages.friction import Friction
from ...common.errors import SealegsError
from ...envs.hexapod.gait import PERIOD, Tripod
from ...envs.hexapod.kinematics import link_angles
from ...envs.hexapod.parameters import LEGS
from ...envs.hexapod.robot import (
    FRICTIONS,
    HEXAPOD,
    KINDS,
    VERTICAL,
    chains_of,
    coordinate,
    foot,
    loop_joints,
    penetration,
)

LIFTED = 0.04  # [m] of the feet that do not stand
SAMPLE = 0.002  # [s] between samples of the power, five in a period of the controllers
BREAKAWAY_AT_REST = 330.0  # [N] over Coulomb under 5 kg, assumed: table 8, used where the robot stands (5.4)
BREAKAWAY_WALKING, BAND = "vertical.friction.stribeck", "vertical.position_pi.band"
WALKING = {BREAKAWAY_WALKING: 700.0, BAND: 2e-5}
"""What the paper's walks have in place of the chains' own values, assumed: breakaway over Coulomb under 10 kg [N], of
table 9; error of vertical joints within which the integral runs out [m]. With the 5e-6 m of the chains they rarely stop
within it: the integral grows until they give way, at most speeds, however high the breakaway force.
"""


def chains_with(friction: str, changes: Mapping[str, float] | None = None) -> dict[str, Chain]:
    """The chains of one of :data:`FRICTIONS`, with changed values.

    Args:
        friction: of the joints.
        changes: new values by ``kind.stage.parameter``, such as ``vertical.friction.coulomb``, or of one leg as
            ``leg1_vertical.friction.coulomb``; those that are zero there, because this friction does not have them,
            stay so, except for a difference between directions.
    """
    chains = chains_of(FRICTIONS[friction])
    for path, value in (changes or {}).items():
        kind, stage, key = path.split(".")
        for name in chains:
            found = chains[name].find(stage)
            given = found is not None and (key == "asymmetry" or getattr(found, key) != 0.0)
            if name.endswith(kind) and given:
                chains[name] = chains[name].with_value(f"{stage}.{key}", value)
    return chains


@dataclass(frozen=True)
class Standing:
    """The robot with its motors at 0 V, every 10 ms from the moment that the ground carries it.

    Attributes:
        time: (n,) [s].
        height: of the body (n,) [m].
        friction: force at the vertical joint of leg 0 (n,) [N].
        load: that this force would have to be to hold the joint: of everything else, motor included, reversed (n,) [N].
        speed: of that joint (n,) [m/s].
        position: of all joints (n, 18) [rad, m].
    """

    time: np.ndarray
    height: np.ndarray
    friction: np.ndarray
    load: np.ndarray
    speed: np.ndarray
    position: np.ndarray

    @property
    def sinking(self) -> float:
        """How far the body sinks [m]."""
        return float(self.height[0] - self.height[-1])

    @property
    def transient(self) -> float:
        """Time after which friction balances the load within 1 % for good [s]."""
        off = np.abs(self.friction / self.load - 1.0) > 0.01
        return float(self.time[np.flatnonzero(off)[-1]]) if off.any() else 0.0

    def moved(self, kind: str, after: float = 0.5) -> float:
        """Largest motion of a joint of this kind from a time [s] on [rad, m]."""
        settled = self.position[self.time >= after, KINDS.index(kind) :: len(KINDS)]
        return float(np.ptp(settled, axis=0).max())


@dataclass(frozen=True)
class Walk:
    """A recording of the gait, every 10 ms. Coordinates are in the robot's order, 3 for each leg.

    Attributes:
        gait: reference controller.
        time: (n,) [s].
        place: of the body (n, 3) [m].
        goal, position: (n, 18) [rad, m].
        current: of the motors, mean over the period (n, 18) [A].
        voltage: (n, 18) [V].
        power: that each motor draws, mean over the period (n, 18) [W]; none flows back.
        contact: normal force at each foot (n, 6) [N].
        feet: place of the feet on the ground (n, 6, 2) [m].
        weight: of the robot [N].
    """

    gait: Tripod
    time: np.ndarray
    place: np.ndarray
    goal: np.ndarray
    position: np.ndarray
    current: np.ndarray
    voltage: np.ndarray
    power: np.ndarray
    contact: np.ndarray
    feet: np.ndarray
    weight: float

    def cycle(self, number: int) -> slice:
        """Samples of a step cycle, counted from 0; a negative number counts from the end."""
        length = round(self.gait.cycle / PERIOD)
        start = number * length if number >= 0 else len(self.time) + number * length
        return slice(start, start + length)

    def resistance(self, number: int = -1) -> float:
        """Specific resistance of a cycle: equation (35)."""
        return float(sum(sum(parts) for parts in self.shares(number).values()))

    def shares(self, number: int = -1) -> dict[str, tuple[float, float]]:
        """What each kind of joint adds to the specific resistance of a cycle, in transfer and in support."""
        start = self.cycle(number).start
        last = min(self.cycle(number).stop, len(self.time) - 1)
        work = self.weight * abs(self.place[last, 0] - self.place[start, 0])
        spent = PERIOD * self.power[start:last] / work
        air = np.stack([self.gait.in_transfer(leg, self.time[start:last]) for leg in range(LEGS)], axis=1)
        return {
            kind: (float(spent[:, k::3][air].sum()), float(spent[:, k::3][~air].sum())) for k, kind in enumerate(KINDS)
        }

    def speed(self, number: int = -1) -> float:
        """Mean heading velocity of a cycle [m/s]."""
        cycle = self.cycle(number)
        last = min(cycle.stop, len(self.time) - 1)
        return float((self.place[last, 0] - self.place[cycle.start, 0]) / (self.time[last] - self.time[cycle.start]))

    def quantity(self, values: np.ndarray, kind: str, leg: int = 0) -> np.ndarray:
        """The column of one joint."""
        return values[:, 3 * leg + KINDS.index(kind)]


class Machine:
    """The hexapod with one kind of joint friction."""

    def __init__(
        self,
        friction: str,
        changes: Mapping[str, float] | None = None,
        params: Mapping[str, float] | None = None,
        timestep: float | None = None,
    ) -> None:
        """Build the model.

        Args:
            friction: one of :data:`FRICTIONS`.
            changes: see :func:`chains_with`.
            params: numbers of the robot other than its own.
            timestep: other than the robot's own [s].

        Raises:
            SealegsError: a wrong friction, change or parameter.
        """
        if friction not in FRICTIONS:
            raise SealegsError(f"there is no joint friction '{friction}'; there are {', '.join(FRICTIONS)}.")
        self.values = HEXAPOD.parameters(params)
        spec = HEXAPOD.build_spec(params)
        if timestep is not None:
            spec.option.timestep = timestep
        self.drivetrain = Drivetrain(spec, chains_with(friction, changes), HEXAPOD.coordinates)
        self.model = self.drivetrain.model
        self.data = mujoco.MjData(self.model)
        names = [item.name for item in self.drivetrain.coordinates]
        self._qpos = [int(self.model.joint(name).qposadr[0]) for name in names]
        self._current, self._voltage = (
            [self.drivetrain.state_addresses[name] + slot for name in names] for slot in (S_CURRENT, S_VOLTAGE)
        )
        self._loops = [[int(self.model.joint(name).qposadr[0]) for name in loop_joints(leg)] for leg in range(LEGS)]
        self.weight = float(self.model.body_mass.sum()) * GRAVITY

    def place(self, goals: np.ndarray, supports: int = LEGS) -> None:
        """Stand at these joint positions (18,), sunk into the ground as deep as it carries the robot."""
        data = self.data
        mujoco.mj_resetData(self.model, data)
        data.qpos[self._qpos] = goals
        data.ctrl[:] = goals
        for leg, joints in enumerate(self._loops):
            rise, bend = link_angles(self.values, goals[3 * leg + 1], goals[3 * leg + 2])
            data.qpos[joints] = rise, np.pi - bend, np.pi - bend
        data.qpos[2] = self.values["stance_height"] - float(
            penetration(self.values, self.weight / supports, self.weight)
        )

    def stand(self, seconds: float) -> Standing:
        """Stand on six legs with motors at 0 V; their duty limit must be zero."""
        self.place(self.stance())
        vertical = coordinate(0, VERTICAL)
        dof = int(self.model.joint(vertical).dofadr[0])
        loads = [self.drivetrain.state_addresses[vertical] + slot for slot in (S_LOAD, S_TORQUE)]
        count = round(seconds / PERIOD)
        rows, position = np.empty((count + 1, 5)), np.empty((count + 1, 3 * LEGS))
        mujoco.mj_forward(self.model, self.data)
        for k in range(count + 1):
            if k:
                mujoco.mj_step(self.model, self.data, round(PERIOD / self.model.opt.timestep))
            load = -float(self.data.userdata[loads].sum())
            speed = float(self.data.qvel[dof])
            rows[k] = self.data.time, self.data.qpos[2], self.friction_force(dof), load, speed
            position[k] = self.data.qpos[self._qpos]
        self._check()
        time, height, friction, loads, speeds = rows.T
        return Standing(time, height, friction, loads, speeds, position)

    def stance(self) -> np.ndarray:
        """Joint positions in the middle of the work space (18,) [rad, m]."""
        limits = HEXAPOD.goal_limits(self.values)
        return np.array([0.5 * sum(limits[item.name]) for item in self.drivetrain.coordinates])

    def friction_force(self, dof: int) -> float:
        """Dry friction or bristle force on a joint in the latest step [N], without its viscous part."""
        data = self.data
        for row in range(data.ne, data.ne + data.nf):
            if data.efc_id[row] == dof:
                return float(data.efc_force[row])
        return 0.0

    def contact_forces(self) -> np.ndarray:
        """Normal force at each foot (6,) [N]."""
        forces, wrench = np.zeros(LEGS), np.zeros(6)
        feet = {self.model.geom(foot(leg)).id: leg for leg in range(LEGS)}
        for number in range(self.data.ncon):
            mujoco.mj_contactForce(self.model, self.data, number, wrench)
            for geom in self.data.contact[number].geom:
                if geom in feet:
                    forces[feet[geom]] += wrench[0]
        return forces

    def walk(self, gait: Tripod, cycles: float = 2.0) -> Walk:
        """Walk and record.

        Raises:
            SealegsError: the simulation became unstable.
        """
        count = round(cycles * gait.cycle / PERIOD)
        times = PERIOD * np.arange(count)
        goals = gait.goals(self.values, times)
        self.place(goals[0])
        data, samples = self.data, round(PERIOD / SAMPLE)
        nstep = round(SAMPLE / self.model.opt.timestep)
        place, contact, feet = np.empty((count, 3)), np.empty((count, LEGS)), np.empty((count, LEGS, 2))
        soles = [self.model.geom(foot(leg)).id for leg in range(LEGS)]
        position, current, voltage, power = (np.empty((count, 3 * LEGS)) for _ in range(4))
        for k in range(count):
            place[k], position[k], feet[k] = data.qpos[:3], data.qpos[self._qpos], data.geom_xpos[soles, :2]
            data.ctrl[:] = goals[k]
            mean, drawn = np.zeros(3 * LEGS), np.zeros(3 * LEGS)
            for _ in range(samples):
                mujoco.mj_step(self.model, data, nstep)
                amperes, volts = data.userdata[self._current], data.userdata[self._voltage]
                mean += amperes / samples
                drawn += np.maximum(amperes * volts, 0.0) / samples
            current[k], power[k], contact[k] = mean, drawn, self.contact_forces()
            voltage[k] = data.userdata[self._voltage]
        self._check()
        return Walk(
            gait,
            time=times,
            place=place,
            goal=goals,
            position=position,
            current=current,
            voltage=voltage,
            power=power,
            contact=contact,
            feet=feet,
            weight=self.weight,
        )

    def _check(self) -> None:
        if any(warning.number for warning in self.data.warning[int(mujoco.mjtWarning.mjWARN_BADQPOS) :]):
            raise SealegsError("the simulation of the hexapod became unstable; take a smaller step.")


def walk(
    friction: str,
    gait: Tripod | None = None,
    cycles: float = 1.25,
    changes: Mapping[str, float] | None = None,
    params: Mapping[str, float] | None = None,
) -> Walk:
    """Section 7: the gait with the numbers of :data:`WALKING`; arguments as :class:`Machine` has them."""
    return Machine(friction, {**WALKING, **(changes or {})}, params).walk(gait or Tripod(), cycles)


def friction_at_rest() -> Friction:
    """LuGre friction of the vertical joints of a robot that stands on six legs.

    Raises:
        SealegsError: their chain has none.
    """
    chain = chains_with("LuGre", {"vertical.friction.stribeck": BREAKAWAY_AT_REST})[coordinate(0, VERTICAL)]
    found = chain.find("friction")
    if not isinstance(found, Friction):
        raise SealegsError(f"{chain.label} has no friction.")
    return found


def limit_by_speed(friction: Friction, speed: np.ndarray) -> np.ndarray:
    """What bristles hold at most, on the side that the joint moves to (n,) [N]: g of (28), times their stiffness.

    Args:
        friction: of the joint.
        speed: of it (n,) [m/s].
    """
    fall = np.exp(-(np.abs(speed / friction.stribeck_velocity) ** friction.stribeck_exponent))
    return np.where(speed < 0.0, -1.0, 1.0) * (friction.coulomb + friction.stribeck * fall)


def stand_unpowered(
    friction: str,
    seconds: float = 10.0,
    changes: Mapping[str, float] | None = None,
    params: Mapping[str, float] | None = None,
    timestep: float | None = None,
) -> Standing:
    """Section 6: all motors at 0 V, with the breakaway force of a robot on its six legs."""
    off = {f"{kind}.duty_limit.limit": 0.0 for kind in KINDS}
    rest = {"vertical.friction.stribeck": BREAKAWAY_AT_REST}  # only LuGre has one
    return Machine(friction, {**rest, **off, **(changes or {})}, params, timestep).stand(seconds)


def penetration_on(legs: int, seconds: float = 1.5) -> float:
    """How deep the feet sink in while the robot stands on 3 or 6 legs, mean over those [m]."""
    machine = Machine("LuGre")
    limits = HEXAPOD.goal_limits(machine.values)
    middle = np.array([0.5 * sum(limits[item.name]) for item in machine.drivetrain.coordinates])
    standing = [leg for leg in range(LEGS) if leg % (LEGS // legs) == 0]
    goals = middle.copy()
    for leg in range(LEGS):
        if leg not in standing:
            goals[3 * leg + 1] -= LIFTED / (machine.values["ratio"] - 1.0)
    machine.place(goals, legs)
    mujoco.mj_step(machine.model, machine.data, round(seconds / machine.model.opt.timestep))
    radius = machine.values["foot_radius"]
    return float(np.mean([radius - machine.data.geom(foot(leg)).xpos[2] for leg in standing]))
