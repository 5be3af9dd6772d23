"""A robot as the host sees it: which servo is which joint, where its zero is, which way it counts, how far it goes."""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ..actuators import Chain, load_chain
from ..actuators.errors import SealegsError, nearest
from ..configs.check import checked
from ..envs.base import BaseLayout
from ..envs.contract import Contract, ContractError, chain_hash, robot_hash
from ..envs.extended import read_extended
from ..envs.robot import Robot
from ..envs.robot_file import ServoEntry
from ..envs.robots import get_robot
from .registers import ServoModel, load_model
from .servo_state import ServoState

ENCODER_TURN = math.pi  # [rad] to either side of the centre that a one-turn encoder reaches
HIGHEST_ID = 252  # that the SDK addresses


class CalibrationError(SealegsError):
    """A calibration that is none, or does not fit the robot."""


@dataclass(frozen=True)
class Joint:
    """One joint and its servo.

    Attributes:
        name: as in the robot.
        id: of the servo.
        zero: step of the encoder at which the joint is at 0 rad.
        direction: 1 where growing steps are the joint's positive direction, -1 where they are its negative one.
        low, high: range of the joint [rad].
        homing_offset: of the servo as it was calibrated [step], which shifts its steps; None: not known.
        per_radian: how far the joint moves per radian of the servo's shaft, behind a gear or a screw [rad or m].
    """

    name: str
    id: int
    zero: int
    direction: int
    low: float
    high: float
    homing_offset: int | None = None
    per_radian: float = 1.0


@dataclass(frozen=True)
class Sensor:
    """An encoder on the bus that drives nothing: a servo without torque, or a board that speaks like one.

    Attributes:
        name: ``<joint>.link`` for the far side of a joint's spring, or a quantity of the base such as ``base_z`` or
            ``body.pitch`` (:mod:`sealegs.envs.base`).
        id: on the bus.
        zero: step at which what it measures is 0.
        per_radian: how far what it measures moves per radian of its own, with its sign [rad or m].
    """

    name: str
    id: int
    zero: int
    per_radian: float


@dataclass(frozen=True)
class Reading:
    """One reading of all joints, in the order of the robot.

    Attributes:
        before: host's monotonic clock as the request went out [s].
        after: the same once all replies had come in [s].
        position: (k,) [rad].
        velocity: (k,) [rad/s].
        duty: (k,), 1 = full.
        current: (k,) [A].
        voltage: (k,) [V].
        temperature: (k,) [degC].
        link: position on the far side of a series spring (k,) [rad]; where nothing measures it, ``position``.
        base_position, base_velocity: of the robot's base, as far as it is measured (b,) [m or rad], per second.
        state: as the bus gave it; None in simulation.
    """

    before: float
    after: float
    position: np.ndarray
    velocity: np.ndarray
    duty: np.ndarray
    current: np.ndarray
    voltage: np.ndarray
    temperature: np.ndarray
    link: np.ndarray
    base_position: np.ndarray
    base_velocity: np.ndarray
    state: ServoState | None

    @property
    def time(self) -> float:
        """Middle of the transaction [s]: when the servos looked at their sensors, as well as the host can tell."""
        return 0.5 * (self.before + self.after)


class ServoRobot:
    """A robot of ``envs`` with a servo on each joint.

    Attributes:
        robot: without its actuators.
        params: its numbers, where they are not the robot's own.
        servo: model of the servos.
        joints: in the order of goals.
        chains: chain that each servo is believed to be.
        belief: the same as a log's sidecar names it: a name, or stages.
        ids: of the servos, in the order of joints.
        measures_links: whether the far sides of springs have encoders of their own.
        registers: counts that the servos were set up with, by name.
        sensors: encoders that drive nothing; of the base in the order of the simulation's coordinates.
        all_ids: of the servos, and behind them of the sensors.
        low, high: range of each joint (k,) [rad or m].
        units: of the joints, rad or m.
    """

    def __init__(
        self,
        robot: Robot,
        params: Mapping[str, float],
        servo: ServoModel,
        joints: Sequence[Joint],
        belief: Mapping[str, Any],
        sensors: Sequence[Sensor] = (),
        registers: Mapping[str, int] | None = None,
    ) -> None:
        """Put the parts together.

        Raises:
            CalibrationError: two joints have one id, or a joint has a range that its servo or the robot cannot reach.
        """
        self.robot, self.params, self.servo, self.joints = robot, dict(params), servo, tuple(joints)
        self.belief, self.registers = dict(belief), dict(registers or {})
        self.chains: dict[str, Chain] = {name: load_chain(source) for name, source in belief.items()}
        check_joints(self.joints, robot, servo, self.params)
        self.ids = [joint.id for joint in self.joints]
        self.sensors = tuple(sensors)
        self.all_ids = [*self.ids, *(sensor.id for sensor in self.sensors)]
        self.names = [joint.name for joint in self.joints]
        links = {sensor.name: k for k, sensor in enumerate(self.sensors, len(self.joints))}
        self._links = [links.get(f"{name}.link") for name in self.names]
        self.measures_links = all(at is not None for at in self._links)
        self.base_names = [sensor.name for sensor in self.sensors if not sensor.name.endswith(".link")]
        self._base = [k for k, sensor in enumerate(self.sensors, len(self.joints)) if sensor.name in self.base_names]
        self.low = np.array([joint.low for joint in self.joints])
        self.high = np.array([joint.high for joint in self.joints])
        step = 2.0 * math.pi / servo.resolution
        mounted = [*self.joints, *self.sensors]
        self._zeros = np.array([(item.zero - servo.centre) * step for item in mounted])
        self._scales = np.array(
            [*(j.direction * j.per_radian for j in self.joints), *(s.per_radian for s in self.sensors)]
        )
        self._signs = np.array([float(joint.direction) for joint in self.joints])
        units = BaseLayout(robot, self.params).units
        self.units = [units[item.terms[0][0]] for item in robot.coordinates]

    # --- units -------------------------------------------------------------------------------------------------

    def reading(self, state: ServoState, last: Reading | None = None) -> Reading:
        """What the bus read of ``all_ids``, as angles of the joints.

        Args:
            state: as read.
            last: the reading before; speeds of the base are differences from it, and turns are counted on from it.
        """
        k = len(self.joints)
        place = self._scales * (state.position - self._zeros)
        side, sign = self._scales[:k], self._signs
        base = place[self._base]
        speed = np.zeros(len(base))
        if last is not None and len(base):
            turn = np.abs(2.0 * math.pi * self._scales[self._base])
            base = base + turn * np.round((last.base_position - base) / turn)
            speed = (base - last.base_position) / max(0.5 * (state.before + state.after) - last.time, 1e-6)
        position = place[:k]
        link = np.array([place[at] if at is not None else position[n] for n, at in enumerate(self._links)])
        return Reading(
            before=state.before,
            after=state.after,
            position=position,
            velocity=side * state.velocity[:k],
            duty=sign * state.duty[:k],
            current=sign * state.current[:k],
            voltage=state.voltage[:k],
            temperature=state.temperature[:k],
            link=link,
            base_position=base,
            base_velocity=speed,
            state=state,
        )

    def to_servo(self, position: np.ndarray) -> np.ndarray:
        """Angles of the servos' shafts (k,) [rad] from angles of the joints (k,) [rad]."""
        k = len(self.joints)
        return position / self._scales[:k] + self._zeros[:k]

    # --- contract ----------------------------------------------------------------------------------------------

    def check_contract(self, contract: Contract, rate: float | None = None) -> None:
        """Make sure that a policy is for this robot.

        Args:
            contract: of the policy.
            rate: at which the loop is to run [Hz]; None: the policy's own.

        Raises:
            ContractError: it is not; the message names the field.
        """
        from ..envs.contract import task_of

        def refuse(field: str, policy: object, here: object, remedy: str) -> None:
            raise ContractError(
                f"the policy does not fit the robot: its '{field}' is {policy}, and here it is {here}; {remedy}."
            )

        robot = self.robot
        if contract.robot != robot.name:
            refuse("robot", contract.robot, robot.name, f"give robot={contract.robot}, or another policy")
        if list(contract.joints) != self.names:
            refuse("joints", ", ".join(contract.joints), ", ".join(self.names), "train it again")
        if contract.robot_hash != (here := robot_hash(robot, self.params)):
            different = self._different_numbers(contract)
            refuse(
                "robot_hash",
                contract.robot_hash,
                here,
                f"the robot's numbers differ ({different}): correct robot.params, give the diagnosis that it was "
                "trained on as extended=<folder>, or train it for this robot",
            )
        if contract.history != 1:
            refuse("history", contract.history, 1, "train it on single observations")
        env = {**contract.env, "robot": robot} if "robot" in contract.env else contract.env  # its file may have moved
        names = tuple(task_of(env)[0].observation_names())
        if contract.observation_names != names:
            first = next(
                (f"{a!r} for {b!r}" for a, b in zip(contract.observation_names, names, strict=False) if a != b),
                f"{len(contract.observation_names)} values for {len(names)}",
            )
            refuse("observation_names", len(contract.observation_names), len(names), f"{first}: train it again")
        if rate is not None and abs(rate - contract.goal_rate) > 1e-6 * rate:
            field = "control_rate" if contract.goals_per_action == 1 else "goal_rate"
            refuse(field, f"{contract.goal_rate:g} Hz", f"{rate:g} Hz", "leave rate= out")
        mounted = [sensor.name for sensor in self.sensors]
        if missing := [name for name in contract.sensors if name not in mounted]:
            raise ContractError(
                f"the policy does not fit the robot: it needs the sensors {', '.join(missing)}, which the robot lacks; "
                f"mount them and name them under sensors in its file, such as {missing[0]}: {{id: 9}} (docs/deploy.md)."
            )
        for joint, unit in zip(self.joints, self.units, strict=True):
            low, high = contract.goal_limits[joint.name]
            if high < joint.low or low > joint.high:
                refuse(
                    "goal_low",
                    f"{low:.3g} {unit} for {joint.name}, up to {high:.3g} {unit}",
                    f"{joint.low:.3g} to {joint.high:.3g} {unit}",
                    "calibrate the joint again",
                )
        if contract.chain_hash != (here := chain_hash(self.chains)):
            trained = ", ".join(f"{name}: {_said(chain)}" for name, chain in contract.chains.items())
            believed = ", ".join(f"{name}: {_said(chain.to_list())}" for name, chain in self.chains.items())
            refuse(
                "chain_hash",
                f"{contract.chain_hash} ({trained})",
                f"{here} ({believed})",
                "say which chain these servos are taken for by actuator=<name or path>",
            )

    def _different_numbers(self, contract: Contract) -> str:
        params = contract.env.get("params") or {}
        ours, theirs, numbers = self.robot.parameters(self.params), self.robot.parameters(params), self.robot.numbers
        different = [key for key in ours if ours[key] != theirs[key] and not numbers[key].numerical]
        rows = [f"{key} {theirs[key]:g} and {ours[key]:g}" for key in different]
        return ", ".join(rows) or "its code changed since"


def check_joints(joints: Sequence[Joint], robot: Robot, servo: ServoModel, params: Mapping[str, float]) -> None:
    """Refuse joints that cannot be.

    Raises:
        CalibrationError: a joint is missing, unknown or doubled, two have one id, or a range cannot be reached.
    """
    wanted = [item.name for item in robot.coordinates]
    for joint in joints:
        if joint.name not in wanted:
            raise CalibrationError(f"robot '{robot.name}' has no joint '{joint.name}'{nearest(joint.name, wanted)}.")
    if (missing := [name for name in wanted if name not in [joint.name for joint in joints]]) or [
        joint.name for joint in joints
    ] != wanted:
        raise CalibrationError(
            f"robot '{robot.name}' has the joints {', '.join(wanted)}; "
            + (f"{', '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing." if missing else "order them so.")
        )
    users: dict[int, str] = {}
    limits = robot.goal_limits(robot.parameters(params))
    step = 2.0 * math.pi / servo.resolution
    for joint in joints:
        if not 0 <= joint.id <= HIGHEST_ID:
            raise CalibrationError(f"joint {joint.name} has the id {joint.id}; ids are 0 to {HIGHEST_ID}.")
        if joint.id in users:
            raise CalibrationError(
                f"joints {users[joint.id]} and {joint.name} both have the servo with id {joint.id}; "
                "give each servo an id of its own (bus.change_id)."
            )
        users[joint.id] = joint.name
        if joint.direction not in (-1, 1):
            raise CalibrationError(f"joint {joint.name} has the direction {joint.direction}; it is 1 or -1.")
        if not (math.isfinite(joint.low) and math.isfinite(joint.high) and joint.low < joint.high):
            raise CalibrationError(f"joint {joint.name} has the range {joint.low} to {joint.high} rad, which is none.")
        for angle in (joint.low, joint.high):
            place = joint.zero + joint.direction * angle / (joint.per_radian * step)
            if not -0.5 <= place <= servo.resolution - 0.5:
                raise CalibrationError(
                    f"joint {joint.name} cannot reach {angle:.3f} rad: its encoder ends at step 0 and "
                    f"{servo.resolution - 1}, and that is step {place:.0f}; mount the horn so that the range keeps "
                    "clear of the encoder's seam, or give a smaller range."
                )
        low, high = limits[joint.name]
        if joint.high <= low or joint.low >= high:
            raise CalibrationError(
                f"joint {joint.name} has the range {joint.low:.2f} to {joint.high:.2f} rad, but robot '{robot.name}' "
                f"works between {low:.2f} and {high:.2f} rad; zero or direction is wrong: calibrate it again."
            )


def nominal_joints(
    robot: Robot, servo: ServoModel, params: Mapping[str, float], gears: Mapping[str, float] | None = None
) -> list[Joint]:
    """Joints of a machine built as drawn, or as the robot's file says.

    As drawn: ids 1, 2, ..., zero at the encoder's centre, range of the robot's goals.

    Args:
        robot: that has them.
        servo: on each.
        params: numbers of the robot other than its own.
        gears: how far a joint moves per radian of its servo, by pattern of names; 1 where none fits. The middle of
            such a joint's range is at the encoder's centre, unless the robot's file says where its zero is.
    """
    step = 2.0 * math.pi / servo.resolution
    limits = robot.goal_limits(robot.parameters(params))
    said = {} if robot.file is None else {item.name: item.servo for item in robot.file.joints}
    found = []
    for number, item in enumerate(robot.coordinates, 1):
        mounted, goals = said.get(item.name) or ServoEntry(number), limits[item.name]
        geared = [value for key, value in (gears or {}).items() if fnmatch.fnmatch(item.name, key)]
        scale = mounted.direction * (geared[0] if geared else 1.0) * step
        zero = servo.centre if not geared else round(servo.centre - 0.5 * (goals[0] + goals[1]) / scale)
        zero = zero if mounted.zero is None else mounted.zero
        low, high = sorted(scale * (at - zero) for at in (0, servo.resolution - 1))
        low, high = max(goals[0], low), min(goals[1], high)
        found.append(Joint(item.name, mounted.id, zero, mounted.direction, low, high, None, abs(scale) / step))
    return found


def read_joints(path: Path, robot: Robot) -> list[Joint]:
    """Joints from a calibration file.

    Raises:
        CalibrationError: the file cannot be read, or is of another robot.
    """
    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
        if document["robot"] != robot.name:
            raise CalibrationError(f"{path} is the calibration of robot '{document['robot']}', not of '{robot.name}'.")
        return [
            Joint(
                str(name),
                int(row["id"]),
                int(row["zero"]),
                int(row["direction"]),
                float(row["range"][0]),
                float(row["range"][1]),
                None if row.get("homing_offset") is None else int(row["homing_offset"]),
                float(row.get("per_radian", 1.0)),
            )
            for name, row in document["joints"].items()
        ]
    except CalibrationError:
        raise
    except OSError as error:
        raise CalibrationError(f"the calibration {path} cannot be read: {error.strerror}.") from None
    except (yaml.YAMLError, UnicodeDecodeError, LookupError, TypeError, ValueError, AttributeError) as error:
        raise CalibrationError(f"{path} is no calibration ({' '.join(str(error).split())}); calibrate again.") from None


def build_robot(config: Mapping[str, Any], actuator: Any = None, calibration: Path | None = None) -> ServoRobot:
    """The robot of a ``configs/robot`` file.

    Args:
        config: ``name``, ``params``, ``servo``, ``actuator``.
        actuator: chain that the servos are taken for, in place of the file's.
        calibration: file; None: a machine built as drawn.

    Raises:
        SealegsError: an unknown robot, servo or chain, or a calibration that does not fit.
    """
    robot, servo = get_robot(config["name"]), load_model(config["servo"])
    params = {str(key): value for key, value in (config.get("params") or {}).items()}
    belief = actuator if actuator is not None else config.get("actuator")
    gears = checked_gears(config.get("gears") or {}, robot)
    joints = nominal_joints(robot, servo, params, gears) if calibration is None else read_joints(calibration, robot)
    chains = {name: _plain(chain) for name, chain in robot.chains_for(belief).items()}
    sensors = read_sensors(config.get("sensors") or {}, joints, servo)
    registers = set_up(config.get("registers") or {}, servo)
    return ServoRobot(robot, params, servo, joints, chains, sensors, registers)


def set_up(registers: Mapping[str, Any], servo: ServoModel) -> dict[str, int]:
    """``registers`` of a robot's file, those that the servos have: another make has others.

    Raises:
        SealegsError: a name that no servo has, or a value that is no count.
    """
    known = load_model("sts3215").registers
    for name in registers:
        if name not in known:
            servo[str(name)]  # or it is named here
    counts = {str(name): checked(f"robot.registers.{name}", value, int) for name, value in registers.items()}
    return {name: count for name, count in counts.items() if name in servo.registers}


def checked_gears(gears: Mapping[str, Any], robot: Robot) -> dict[str, float]:
    """``gears`` of a robot's file: how far joints move per radian of their servos, by pattern of names.

    Raises:
        CalibrationError: a pattern fits no joint, or a value is none.
    """
    names = [item.name for item in robot.coordinates]
    found = {str(key): checked(f"robot.gears.{key}", value, float) for key, value in gears.items()}
    for key, value in found.items():
        if not fnmatch.filter(names, key):
            raise CalibrationError(f"robot.gears.{key} fits no joint of '{robot.name}'; it has {', '.join(names)}.")
        if value <= 0.0:
            raise CalibrationError(f"robot.gears.{key} is {value:g}; it must be above 0.")
    return found


def extended_robot(config: Mapping[str, Any], extended: str | Path, calibration: Path | None = None) -> ServoRobot:
    """The robot of a ``configs/robot`` file as a diagnosis found it: chains and numbers.

    Args:
        config: as in :func:`build_robot`; its ``params`` are what is believed.
        extended: folder of the diagnosis.
        calibration: file; None: a machine built as drawn.

    Raises:
        SealegsError: as :func:`build_robot`, or the robot cannot take what was found.
    """
    machine, robot = read_extended(extended), get_robot(config["name"])
    params = {str(key): value for key, value in (config.get("params") or {}).items()}
    found = {**config, "params": machine.params_on(robot, params)}
    return build_robot(found, machine.chains_on(robot), calibration)


def read_sensors(config: Mapping[str, Any], joints: Sequence[Joint], servo: ServoModel) -> list[Sensor]:
    """Sensors of a robot's file.

    Raises:
        CalibrationError: one has the id of a joint or of another one, or lacks something.
    """
    found: list[Sensor] = []
    users = {joint.id: joint.name for joint in joints}
    for name, row in config.items():
        try:
            per_radian = float(row.get("per_radian", 1.0))
            sensor = Sensor(str(name), int(row["id"]), int(row.get("zero", servo.centre)), per_radian)
        except (LookupError, TypeError, ValueError, AttributeError):
            raise CalibrationError(
                f"robot.sensors.{name} is {row!r}; it needs an id, and takes zero, per_radian."
            ) from None
        if sensor.id in users:
            raise CalibrationError(
                f"sensor {name} has the id {sensor.id}, and so has {users[sensor.id]}; ids are unique."
            )
        if per_radian == 0.0 or not math.isfinite(per_radian):
            raise CalibrationError(
                f"robot.sensors.{name}.per_radian is {per_radian:g}; it must be a number other than 0."
            )
        users[sensor.id] = sensor.name
        found.append(sensor)
    return found


def _plain(chain: Any) -> str | list:
    """A chain as a log's sidecar takes it: a name of the library, or its stages."""
    if isinstance(chain, str) and not chain.endswith((".yaml", ".yml")):
        return chain
    return load_chain(chain).to_list()


def _said(stages: Sequence[Mapping[str, Any]]) -> str:
    return "+".join(next(iter(stage)) for stage in stages)
