"""A robot as the host sees it: which servo is which joint, where its zero is, which way it counts, how far it goes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...actuators import Chain, SealegsError, load_chain
from ...actuators.chain import LIBRARY, names
from ...configs.check import checked
from ...envs.contract import Contract, ContractError, chain_hash, robot_hash
from ...envs.described.robot_imu import with_imu
from ...envs.engine.base import BaseLayout
from ...envs.engine.imu import GIVES, PREFIX
from ...envs.engine.robot import Robot, check_position_goals, torque_driven
from ...envs.extended import read_extended
from ...envs.robots import ROBOTS, get_robot
from ..bus.imu import ImuSample
from ..bus.registers import ServoModel, load_model
from ..bus.servo_state import ServoState
from .calibration_file import read_joints
from .joints import (
    BaseTurn,
    Joint,
    Reading,
    Sensor,
    check_gears,
    check_joints,
    checked_gears,
    nominal_joints,
    read_lines,
    read_sensors,
    table,
)


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
        measures_links: whether the far side of each joint's spring has an encoder of its own (k,).
        registers: counts that the servos were set up with, by name.
        sensors: encoders that drive nothing; of the base in the order of the simulation's coordinates.
        all_ids: of the servos, and behind them of the sensors.
        names: of the joints.
        model_names: what the robot's model calls them; of a belt over several joints its own name.
        low, high: range of each joint (k,) [rad or m]; of a wheel that of its goals [rad/s].
        turning: whether each joint is told speeds (k,).
        turning_ids: of the servos of those.
        resolution: how far what a servo of ``all_ids`` measures goes in a step of its encoder [rad or m].
        units: of the joints, rad or m.
        imu: on its free base; None: it has none.
        log_base: columns ``base.*`` of its logs.
        lines: buses that its servos are on, the first one first.
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
        port: str | None = None,
    ) -> None:
        """Put the parts together.

        ``port`` is the path of the first bus, for what a person is to type; None: not known.

        Raises:
            CalibrationError: two joints have one id, or a joint has a range that its servo or the robot cannot reach.
            RobotError: a chain takes torques, which no servo is sent, or other goals than the robot's file says.
        """
        self.robot, self.params, self.servo, self.joints = robot, dict(params), servo, tuple(joints)
        self.belief, self.registers = dict(belief), dict(registers or {})
        self.chains: dict[str, Chain] = {name: load_chain(source) for name, source in belief.items()}
        check_position_goals(robot, self.chains, "a servo takes")
        check_joints(self.joints, robot, servo, self.params, port)
        self.turning = np.array([joint.turning for joint in self.joints], bool)
        self.ids = [joint.address for joint in self.joints]
        self.turning_ids = [joint.address for joint in self.joints if joint.turning]
        self.sensors = tuple(sensors)
        self.all_ids = [*self.ids, *(sensor.address for sensor in self.sensors)]
        used = {item.line.number: item.line for item in (*self.joints, *self.sensors)}
        self.lines = tuple(used[number] for number in sorted(used))
        self.names = [joint.name for joint in self.joints]
        self.model_names = [c.terms[0][0] if len(c.terms) == 1 else c.name for c in robot.coordinates]
        links = {sensor.name: k for k, sensor in enumerate(self.sensors, len(self.joints))}
        self._links = [links.get(f"{name}.link", k) for k, name in enumerate(self.names)]
        self.measures_links = np.array([f"{name}.link" in links for name in self.names], bool)
        self.base_names = [sensor.name for sensor in self.sensors if not sensor.name.endswith(".link")]
        self._base = [k for k, sensor in enumerate(self.sensors, len(self.joints)) if sensor.name in self.base_names]
        self.low = np.array([joint.low for joint in self.joints])
        self.high = np.array([joint.high for joint in self.joints])
        mounted = [*self.joints, *self.sensors]
        models = [item.line.model(servo) for item in mounted]
        self._zeros = np.array([(item.zero - m.centre) * m.step for item, m in zip(mounted, models, strict=True)])
        self._scales = np.array(
            [*(j.direction * j.per_radian for j in self.joints), *(s.per_radian for s in self.sensors)]
        )
        self.resolution = np.abs(self._scales) * [model.step for model in models]
        self._signs = np.array([float(joint.direction) for joint in self.joints])
        units = BaseLayout(robot, self.params).units
        self.units = [units[item.terms[0][0]] for item in robot.coordinates]
        self.imu = robot.imu
        self.log_base = [*self.base_names, *(robot.imu.columns if robot.imu is not None else ())]

    # --- units -------------------------------------------------------------------------------------------------

    def reading(self, state: ServoState, last: Reading | None = None, sample: ImuSample | None = None) -> Reading:
        """What the bus read of ``all_ids``, as angles of the joints.

        Args:
            state: as read.
            last: the reading before; turns are counted on from it. Speeds of the base are differences between two
                times that it was read, and stay as they are where a reply is missing.
            sample: the newest of the IMU; None: there is none.
        """
        k, now = len(self.joints), 0.5 * (state.before + state.after)
        before = np.full(len(self.all_ids), now if last is None else last.time)
        before = before if last is None or last.taken is None else last.taken
        taken = np.where([servo in state.missing for servo in self.all_ids], before, now)
        place = self._scales * (state.position - self._zeros)
        if last is not None and self.turning.any():  # wheels count on over the seam of their turn
            around = np.abs(2.0 * np.pi * self._scales[:k])
            counted = place[:k] + around * np.round((last.position - place[:k]) / around)
            place[:k] = np.where(self.turning, counted, place[:k])
        side, sign = self._scales[:k], self._signs
        base = place[self._base]
        speed = np.zeros(len(base))
        if last is not None and len(base):
            turn = np.abs(2.0 * np.pi * self._scales[self._base])
            base = base + turn * np.round((last.base_position - base) / turn)
            speed = (base - last.base_position) / np.maximum((taken - before)[self._base], 1e-6)
            speed = np.where(taken[self._base] < now, last.base_velocity, speed)
        return Reading(
            before=state.before,
            after=state.after,
            position=place[:k],
            velocity=side * state.velocity[:k],
            duty=sign * state.duty[:k],
            current=sign * state.current[:k],
            voltage=state.voltage[:k],
            temperature=state.temperature[:k],
            link=place[self._links],
            base_position=base,
            base_velocity=speed,
            state=state,
            taken=taken,
            imu=self._base_turn(sample, None if last is None else last.imu),
        )

    def _base_turn(self, sample: ImuSample | None, last: BaseTurn | None) -> BaseTurn | None:
        if self.imu is None or sample is None:
            return None
        fresh = last is None or sample.time > last.time
        return BaseTurn(sample.time, *self.imu.of_base(sample.orientation, sample.turn_rate), fresh, sample.switches)

    def fresh(self, reading: Reading) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Which joints (k,), far sides of springs (k,) and quantities of the base (b,) were read at its time."""
        fresh = np.ones(len(self.all_ids), bool) if reading.taken is None else reading.taken >= reading.time
        return fresh[: len(self.joints)], fresh[self._links], fresh[self._base]

    def to_servo(self, position: np.ndarray) -> np.ndarray:
        """Goals of the servos' shafts (k,) from goals of the joints (k,): angles [rad], of wheels speeds [rad/s]."""
        k = len(self.joints)
        return position / self._scales[:k] + np.where(self.turning, 0.0, self._zeros[:k])

    def staying(self, position: np.ndarray) -> np.ndarray:
        """Goals with which joints stay where they are (k,): their positions within their ranges, of wheels 0."""
        return np.where(self.turning, 0.0, np.clip(position, self.low, self.high))

    # --- contract ----------------------------------------------------------------------------------------------

    def check_contract(self, contract: Contract, rate: float | None = None, chains: bool = True) -> None:
        """Make sure that a policy is for this robot.

        Args:
            contract: of the policy.
            rate: at which the loop is to run [Hz]; None: the policy's own.
            chains: whether it must be for this robot's chains, too.

        Raises:
            ContractError: it is not; the message names the field.
        """
        try:
            self._check_contract(contract, rate, chains)
        except ContractError as error:
            trained, file = contract.env.get("robot"), self.robot.file
            if file is None or trained is None or Path(str(trained)).name == file.path.name:
                raise
            raise ContractError(
                f"{str(error).rstrip('.')}. It was trained with robot={trained}, and here it is {file.path.name}: give "
                "that file."
            ) from None

    def _check_contract(self, contract: Contract, rate: float | None, chains: bool) -> None:

        def refuse(field: str, policy: object, here: object, remedy: str) -> None:
            raise ContractError(
                f"the policy does not fit the robot: its '{field}' is {policy}, and here it is {here}; {remedy}."
            )

        robot = self.robot
        if contract.robot != robot.name:
            theirs = contract.robot if contract.robot in ROBOTS else f"<the file of {contract.robot}>"
            refuse("robot", contract.robot, robot.name, f"give robot={theirs}, or another policy")
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
        if driven := torque_driven(contract.chains):
            raise ContractError(
                f"the policy does not fit the robot: it was trained with torques as commands of {', '.join(driven)}, "
                "which a servo would take for positions; train it again, with a position controller in each chain."
            )
        mounted = [*(sensor.name for sensor in self.sensors), *(self.imu.gives if self.imu is not None else ())]
        if missing := [name for name in contract.sensors if name not in mounted]:
            raise ContractError(
                f"the policy does not fit the robot: it needs the sensors {', '.join(missing)}, which the robot lacks; "
                f"{self._mending(missing)}."
            )
        names = tuple(contract.task_on(robot)[0].observation_names())
        if contract.observation_names != names:
            first = next(
                (f"{a!r} for {b!r}" for a, b in zip(contract.observation_names, names, strict=False) if a != b),
                f"{len(contract.observation_names)} values for {len(names)}",
            )
            refuse("observation_names", len(contract.observation_names), len(names), f"{first}: train it again")
        if rate is not None and not any(math.isclose(rate, kept, rel_tol=1e-6) for kept in contract.rates):
            field = "control_rate" if contract.goals_per_action == 1 else "goal_rate"
            lower = ", ".join(f"{kept:g}" for kept in contract.rates[1:])
            remedy = "leave rate= out" + (f", or give one of {lower}" if lower else "")
            refuse(field, f"{contract.goal_rate:g} Hz", f"{rate:g} Hz", remedy)
        for joint, unit in zip(self.joints, self.units, strict=True):
            low, high = contract.goal_limits[joint.name]
            if high < joint.low or low > joint.high:
                refuse(
                    "goal_low",
                    f"{low:.3g} {unit} for {joint.name}, up to {high:.3g} {unit}",
                    f"{joint.low:.3g} to {joint.high:.3g} {unit}",
                    "calibrate the joint again",
                )
        if chains and contract.chain_hash != chain_hash(self.chains):
            trained = told_chains(contract.chains)
            here = told_chains({name: chain.to_list() for name, chain in self.chains.items()})
            here = here if here != trained else f"{here} with other numbers"
            raise ContractError(
                f"the policy does not fit the robot ('chain_hash'): it was trained with {trained}, and here it is "
                f"{here}; say which chain these servos are taken for by actuator=<name or path>."
            )

    def _mending(self, missing: Sequence[str]) -> str:
        """What gives the robot the sensors that it lacks."""
        if switches := [name.removeprefix(PREFIX) for name in missing if name.startswith(PREFIX)]:
            return f"name them in its file, such as imu: {{switches: {{{switches[0]}: {{body: <its foot>}}}}}}"
        turns = [name for name in missing if name.rpartition(".")[2] in GIVES]
        others = [name for name in missing if name not in turns]
        encoders = f"mount them and name them under sensors in its file, such as {missing[0]}: {{id: 9}}"
        if not turns or self.imu is not None:
            return encoders
        said = f"an IMU gives {', '.join(turns)}: name it in its file, such as imu: {{rate: 100}}"
        return said if not others else f"{said}; the others are encoders: name them under sensors"

    def _different_numbers(self, contract: Contract) -> str:
        params = contract.env.get("params") or {}
        ours, theirs, numbers = self.robot.parameters(self.params), self.robot.parameters(params), self.robot.numbers
        different = [key for key in ours if ours[key] != theirs[key] and not numbers[key].numerical]
        rows = [f"{key} {theirs[key]:g} and {ours[key]:g}" for key in different]
        return ", ".join(rows) or "its code changed since"


def build_robot(
    config: Mapping[str, Any], actuator: Any = None, calibration: Path | None = None, port: str | None = None
) -> ServoRobot:
    """The robot of a ``configs/robot`` file.

    Args:
        config: ``name``, ``params``, ``servo``, ``actuator``, ``gears``, ``sensors``, ``buses``, ``imu``.
        actuator: chain that the servos are taken for, in place of the file's.
        calibration: file; None: a machine built as drawn.
        port: path of the first bus, for what a person is to type; None: not known.

    Raises:
        SealegsError: an unknown robot, servo or chain, or a calibration that does not fit.
    """
    robot, servo = get_robot(config["name"]), load_model(config["servo"])
    robot = with_imu(robot, table(config, "imu") or None)
    params = {str(key): value for key, value in table(config, "params").items()}
    belief = actuator if actuator is not None else config.get("actuator")
    gears = checked_gears(table(config, "gears"), robot)
    sensed = table(config, "sensors")
    lines = read_lines(table(config, "buses"), [*(item.name for item in robot.coordinates), *sensed])
    if calibration is None:
        joints = nominal_joints(robot, servo, params, gears, lines)
    else:
        joints = read_joints(calibration, robot, servo, lines)
        check_gears(joints, gears, calibration)
    chains = {name: _plain(chain) for name, chain in robot.chains_for(belief).items()}
    quantities = BaseLayout(robot, params).names if sensed else ()
    sensors = read_sensors(sensed, joints, servo, lines, quantities)
    registers = set_up(table(config, "registers"), servo)
    return ServoRobot(robot, params, servo, joints, chains, sensors, registers, port=port)


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


def extended_robot(
    config: Mapping[str, Any], extended: str | Path, calibration: Path | None = None, port: str | None = None
) -> ServoRobot:
    """The robot of a ``configs/robot`` file as a diagnosis found it: chains and numbers.

    Args:
        config: as in :func:`build_robot`; its ``params`` are what is believed.
        extended: folder of the diagnosis.
        calibration, port: as there.

    Raises:
        SealegsError: as :func:`build_robot`, or the robot cannot take what was found.
    """
    machine, robot = read_extended(extended), get_robot(config["name"])
    machine.check_log()
    params = {str(key): value for key, value in (config.get("params") or {}).items()}
    found = {**config, "params": machine.params_on(robot, params)}
    return build_robot(found, machine.chains_on(robot), calibration, port)


def _plain(chain: Any) -> str | list:
    """A chain as a log's sidecar takes it: a name of the library, or its stages."""
    if isinstance(chain, str) and not chain.endswith((".yaml", ".yml")):
        return chain
    return load_chain(chain).to_list()


# --- chains in a sentence --------------------------------------------------------------------------------------------


def told_chains(chains: Mapping[str, Sequence[Mapping[str, Any]]]) -> str:
    """``sts3215``, or ``hip: sts3215, knee: delay+position_p`` where joints differ; stages where no name is known.

    Args:
        chains: stages by joint.
    """
    known = {chain_hash({"": load_chain(name)}): name for name in names()}
    told = {joint: _told(stages, known) for joint, stages in chains.items()}
    if len(set(told.values())) == 1:
        return next(iter(told.values()))
    return ", ".join(f"{joint}: {chain}" for joint, chain in told.items())


def _told(stages: Sequence[Mapping[str, Any]], known: Mapping[str, str]) -> str:
    joined = "+".join(next(iter(stage)) for stage in stages)
    nets = [Path(str(stage["net"]["file"])) for stage in stages if "net" in stage]
    if any(net.parent != LIBRARY for net in nets):  # which no known chain has, and a contract's path is not opened
        return joined
    try:
        return known.get(chain_hash({"": load_chain(list(stages))}), joined)
    except SealegsError:  # the file of its net is elsewhere
        return joined


# --- the sign of a current that a servo reports as a magnitude -------------------------------------------------------
#
# Whether present_current has a sign differs by servo and firmware, and no register tells. A servo that has ever
# reported a negative count has one. Of another one the current has the sign of what drives it: duty times voltage
# less back-EMF.

SURE = 10  # readings against the drive after which a servo counts as one that reports magnitudes


class CurrentSign:
    """Gives the readings of one run their signs."""

    def __init__(self, robot: ServoRobot) -> None:
        """Prepare for the servos of ``robot``."""
        self._ids = robot.ids
        self._constants = np.zeros(len(robot.ids))  # back-EMF [V.s/rad]
        for k, name in enumerate(robot.names):
            chain = robot.chains[name]
            if chain.find("dc_motor") is not None:
                self._constants[k] = chain.value("dc_motor.motor_constant") * chain.gear_ratio()
        self._signed = np.zeros(len(robot.ids), bool)
        self._against = np.zeros(len(robot.ids), int)

    def mended(self, reading: Reading) -> Reading:
        """The reading, its currents signed."""
        if reading.state is None:
            return reading
        raw = reading.state.raw["present_current"][: len(self._ids)]
        drive = reading.duty * reading.voltage - self._constants * reading.velocity
        wanted = np.where(drive < 0.0, -1.0, 1.0)
        self._signed |= raw < 0
        flip = ~self._signed & (raw > 0)
        signed = np.where(flip, wanted * np.abs(reading.current), reading.current)
        self._against += flip & (signed != reading.current)
        return replace(reading, current=signed)

    @property
    def magnitudes(self) -> list[int]:
        """Ids of the servos that report magnitudes."""
        found = ~self._signed & (self._against >= SURE)
        return [servo for servo, unsigned in zip(self._ids, found.tolist(), strict=True) if unsigned]


# --- servos that are set up otherwise than the factory or a robot's file says, in sentences --------------------------


def unlike_the_factory(registers: Mapping[str, Mapping[str, int]], servo: ServoModel) -> list[str]:
    """A sentence for each joint whose servo has been set up to move otherwise than it left the factory.

    Args:
        registers: counts by joint and name; a scan, which knows no joints, names the servo.
        servo: model of the servos.
    """
    found = []
    for joint, row in registers.items():
        changed = [
            f"{name} {row[name]} ({servo[name].default})"
            for name in servo.moves
            if row[name] != servo[name].default
            and not (name == servo.role("mark") and row[name] == servo[name].default - 1)  # the mark of an earlier run
        ]
        if changed:
            found.append(
                f"Joint {joint} moves otherwise than from the factory, which the chains of configs/actuator describe: "
                f"{', '.join(changed)}."
            )
    return found


def unlike_the_file(
    registers: Mapping[str, Mapping[str, int]], robot: ServoRobot, ports: Mapping[str, str]
) -> list[str]:
    """A sentence for each joint whose servo is not set up as the robot's file says, and what to type.

    Args:
        registers: counts by joint and name.
        robot: with what its file says.
        ports: paths by name of the bus.
    """
    found = []
    for joint in robot.joints:
        row = registers[joint.name]
        if other := [name for name, count in robot.registers.items() if row.get(name, count) != count]:
            counts = ", ".join(f"{name} {row[name]} ({robot.registers[name]})" for name in other)
            model, wanted = joint.line.model(robot.servo), {name: robot.registers[name] for name in other}
            mend = model.setting(joint.id, wanted, ports[joint.line.name])
            found.append(
                f"Joint {joint.name} is set up otherwise than the robot's file says: {counts}; {mend} mends it."
            )
    return found
