"""The machine behind the virtual bus: a robot of ``envs``, an actuation chain on each joint, stepped to any time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ...actuators import Chain, load_chain
from ...actuators.engine import install
from ...actuators.law import host_reading
from ...actuators.layout import S_CURRENT, S_DUTY, S_READY, S_TORQUE
from ...actuators.stages import build_stage
from ...common.documents import DocumentError, read_yaml
from ...common.errors import SealegsError, nearest
from ...envs.engine.base import BaseLayout
from ...envs.engine.imu import Switches
from ...envs.engine.model_poses import Loops, in_turn, place_followers
from ...envs.engine.robot import ChainSource, Robot, check_position_goals
from .imu import VirtualImu, hidden_imu

NOMINAL_VOLTAGE = 7.4  # [V] that a chain without a supply stage is taken to run on; assumed
UNSTABLE = tuple(
    int(kind)
    for kind in (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
)
SHORTEST_STEP = 1e-7  # [s]
TRIAL = 0.1  # [s] that a machine is tried for before it is shown to anybody


@dataclass(frozen=True)
class Drive:
    """What a servo's firmware lets its motor do.

    Attributes:
        connected: whether the bridge drives the motor; False: the output turns freely but for its friction.
        duty: share of the chain's largest duty that is allowed; 0 with ``connected`` brakes the motor.
        gain: share of the chain's controller gain.
        damping: share of its damping, where it has one.
        startup: share of its minimum duty, where it has one.
        dead_zone: share of its dead band, where it has one.
        speed_gain, speed_integral: shares of the gains of its speed loop, where it has one.
        volts: supply voltage in place of the chain's [V]; None: the chain's.
    """

    connected: bool = True
    duty: float = 1.0
    gain: float = 1.0
    damping: float = 1.0
    startup: float = 1.0
    dead_zone: float = 1.0
    speed_gain: float = 1.0
    speed_integral: float = 1.0
    volts: float | None = None


class Machine:
    """A simulated robot whose joints are driven by chains.

    Attributes:
        names: of the driven coordinates.
        encoders: of these, and behind them of the encoders that drive nothing.
        drivetrain: robot and chains.
        model, data: MuJoCo's.
        imu: on its free base; None: it has none.
    """

    def __init__(
        self,
        robot: Robot,
        actuator: ChainSource | Mapping[str, ChainSource] | None = None,
        hidden: str | None = None,
        params: Mapping[str, float] | None = None,
        sensors: Mapping[str, float] | None = None,
        pose: Mapping[str, float] | None = None,
        seed: int = 0,
    ) -> None:
        """Build the robot and place it in ``pose``, or at the middle of its goals' ranges.

        Args:
            robot: of ``sealegs.envs.robots``.
            actuator: chain of all coordinates, or chains by coordinate; None: the robot's own.
            hidden: file of what the machine really is, see :mod:`hw.virtual.hidden`.
            params: numbers of the robot other than its own.
            sensors: encoders that drive nothing: ``<coordinate>.link``, on the far side of a spring, or a joint of the
                model; and how far what they measure moves per radian of theirs [rad or m].
            pose: quantities of the model's joints, see :mod:`sealegs.envs.engine.base`.
            seed: of the noise of its IMU.

        Raises:
            SealegsError: one of them does not fit the robot.
        """
        chains, params = hide(robot, robot.chains_for(actuator), dict(params or {}), hidden)
        check_position_goals(robot, chains, "a servo takes")
        self._base = {name: _switchable(chain) for name, chain in chains.items()}
        self.drivetrain = robot.drivetrain(dict(self._base), params)
        self.model = self.drivetrain.model
        self.data = mujoco.MjData(self.model)
        self.names = [item.name for item in self.drivetrain.coordinates]
        self.limits = robot.goal_limits(robot.parameters(params))
        self._step = self.model.opt.timestep
        count = len(self.names)
        self.layout = BaseLayout(robot, params)
        self._weights = np.stack([self.drivetrain.position(name, np.eye(self.model.nq)) for name in self.names])
        self._sensors = [self._sensed(name, per_radian) for name, per_radian in (sensors or {}).items()]
        self.encoders = [*self.names, *(sensors or {})]
        self._drives = [Drive()] * count
        self._broken = False
        supplies = [self._base[name].find("supply") for name in self.names]
        self._supplies = [(item.volts, item.resistance) if item else (NOMINAL_VOLTAGE, 0.0) for item in supplies]
        self._actuators = [self.drivetrain.actuator_ids[name] for name in self.names]
        self._programs, self._states = [], []
        for name, actuator_id in zip(self.names, self._actuators, strict=True):
            program = self.drivetrain.program(name)
            start = self.drivetrain.state_addresses[name]
            self._programs.append(self.model.actuator_user[actuator_id][: len(program)])
            self._states.append(self.data.userdata[start : start + int(program[2])])
        for name in self.names:
            low, high = self.limits[name]
            middle = np.asarray(0.5 * (low + high))
            self.drivetrain.set_position(name, self.data.qpos, middle)
            self.data.ctrl[self.drivetrain.actuator_ids[name]] = middle
        if pose:
            self._place(pose)
        place_followers(self.model, in_turn(self.model), self.data.qpos)
        if (loops := Loops.of(self.drivetrain)) is not None:
            loops.close(self.data.qpos)
            for name in [name for name in self.names if self._base[name].command == "goal"]:
                at = self.drivetrain.position(name, self.data.qpos, "link")
                self.data.ctrl[self.drivetrain.actuator_ids[name]] = at
        install()
        mujoco.mj_forward(self.model, self.data)
        self._check_stands(robot.name)
        self.imu: VirtualImu | None = None
        self._free = self.layout.base_in(self.model)
        if robot.imu is not None:
            found = hidden_imu(robot.imu, of_imu(hidden), str(hidden))
            switches = Switches(self.model, found.switches)
            self.imu = VirtualImu(found, self.base_turn, seed, lambda: switches.closed(self.data.sensordata))

    def _place(self, pose: Mapping[str, float]) -> None:
        for name in pose:
            if name not in self.layout.names:
                known = self.layout.names
                raise SealegsError(f"pose: there is no '{name}'{nearest(name, known)}; there are {', '.join(known)}.")
        self.layout.place(self.model, self.data.qpos, pose)
        for item in self.drivetrain.coordinates:
            angle = self.drivetrain.position(item.name, self.data.qpos, "link")
            self.drivetrain.set_position(item.name, self.data.qpos, np.asarray(angle))
            if self._base[item.name].command == "goal":
                self.data.ctrl[self.drivetrain.actuator_ids[item.name]] = angle

    def _check_stands(self, robot: str) -> None:
        """Refuse, before anybody relies on it, a machine that cannot even be simulated where it stands.

        Raises:
            SealegsError: the simulation becomes unstable.
        """
        trial = mujoco.MjData(self.model)
        mujoco.mj_copyState(self.model, self.data, trial, int(mujoco.mjtState.mjSTATE_INTEGRATION))
        mujoco.set_mju_user_warning(lambda _: None)  # the sentence below says it
        try:
            mujoco.mj_step(self.model, trial, round(TRIAL / self._step))
        finally:
            mujoco.set_mju_user_warning(None)
        if _unstable(trial):
            raise SealegsError(
                f"what drives {', '.join(self.names)} cannot be simulated on robot '{robot}': the machine becomes "
                "unstable while it stands still; give another chain, or other numbers of what it hides."
            )

    @property
    def time(self) -> float:
        """Of the simulation [s]."""
        return self.data.time

    def advance(self, time: float) -> None:
        """Simulate up to ``time`` [s]; the last step is as short as it must be.

        Raises:
            SealegsError: the simulation became unstable; from then on the machine stands still.
        """
        if self._broken:
            self.data.time = time
            return
        whole = int((time - self.data.time) / self._step + 1e-9)
        if whole > 0:
            mujoco.mj_step(self.model, self.data, whole)
        rest = time - self.data.time
        if rest > SHORTEST_STEP:
            self.model.opt.timestep = rest
            mujoco.mj_step(self.model, self.data)
            self.model.opt.timestep = self._step
        if _unstable(self.data):
            self._broken, self.data.time = True, time
            raise SealegsError(
                f"the virtual machine became unstable at {time:.3f} s; its chains, or what it hides, do not "
                "fit the robot."
            )

    def set_goal(self, joint: int, angle: float) -> None:
        """Goal of a joint's chain [rad; of a wheel rad/s]; an encoder that drives nothing takes none."""
        if joint >= len(self.names):
            return
        self.data.ctrl[self._actuators[joint]] = angle

    def set_drive(self, joint: int, drive: Drive) -> None:
        """What the firmware lets the motor do from now on."""
        if joint >= len(self.names):
            return
        before = self._drives[joint]
        if drive == before:
            return
        self._drives[joint] = drive
        name = self.names[joint]
        self.drivetrain.set_chain(self.model, name, _driven(self._base[name], drive))
        if drive.connected and not before.connected:  # the controller starts afresh, where the joint is
            actuator = self._actuators[joint]
            goal = self.data.ctrl[actuator]
            self._states[joint][S_READY] = 0.0
            self.data.ctrl[actuator] = 0.0 if self.by_speed(joint) else self.reading(joint)
            mujoco.mj_forward(self.model, self.data)
            self.data.ctrl[actuator] = goal

    def by_speed(self, joint: int) -> bool:
        """Whether a joint's chain is told speeds."""
        return joint < len(self.names) and self._base[self.names[joint]].command == "goal_velocity"

    def position(self, joint: int) -> float:
        """Position of a joint's motor side, or of an encoder that drives nothing [rad], true."""
        if joint >= len(self.names):
            return self._sensors[joint - len(self.names)](self.data.qpos)
        return float(self._weights[joint] @ self.data.qpos)

    def reading(self, joint: int) -> float:
        """Position as the encoder of the chain gives it to the host [rad]."""
        if joint >= len(self.names):
            return self.position(joint)
        return float(host_reading(self._programs[joint], self._states[joint], self.data.time, self.position(joint)))

    def link(self, joint: int) -> float:
        """Position of a joint behind its spring, if any [rad or m], true."""
        return float(self.drivetrain.position(self.names[joint], self.data.qpos, "link"))

    def velocity(self, joint: int) -> float:
        """Speed of a joint's motor side [rad/s or m/s], true."""
        return float(self.drivetrain.speed(self.names[joint], self.data.qvel))

    def torque(self, joint: int) -> float:
        """Motor torque on a joint, dry friction excluded [N.m or N], true."""
        return float(self._states[joint][S_TORQUE])

    def base(self) -> tuple[dict[str, float], dict[str, float]]:
        """True quantities of :mod:`sealegs.envs.engine.base` and their rates; a free joint's turn rates are 0."""
        return self.layout.values_of(self.model, self.data.qpos), self.layout.rates_of(self.model, self.data.qvel)

    def base_turn(self) -> tuple[np.ndarray, np.ndarray]:
        """Orientation of the free base (4,), a quaternion, and its turn rate about its axes (3,) [rad/s], true."""
        assert self._free is not None  # who has an IMU has a free base
        at, dof = self._free
        return np.array(self.data.qpos[at + 3 : at + 7]), np.array(self.data.qvel[dof + 3 : dof + 6])

    def duty(self, joint: int) -> float:
        """Duty of the bridge [-1..1]; 0 for chains without one, and while the motor is disconnected."""
        return float(self._states[joint][S_DUTY]) if self._connected(joint) else 0.0

    def current(self, joint: int) -> float:
        """Motor current [A]; 0 for chains without one, and while the motor is disconnected."""
        return float(self._states[joint][S_CURRENT]) if self._connected(joint) else 0.0

    def voltage(self, joint: int) -> float:
        """Supply voltage at the servo [V], sag included."""
        if joint >= len(self.names):
            return NOMINAL_VOLTAGE
        nominal, resistance = self._supplies[joint]
        drawn = max(self.duty(joint) * self.current(joint), 0.0)
        volts = self._drives[joint].volts
        return (nominal if volts is None else volts) - resistance * drawn

    def resistance(self, joint: int) -> float:
        """Winding resistance of the joint's motor [ohm]; 0 where the chain has none."""
        motor = self._base[self.names[joint]].find("dc_motor") if joint < len(self.names) else None
        return motor.resistance if motor is not None else 0.0

    def _connected(self, joint: int) -> bool:
        return joint < len(self.names) and self._drives[joint].connected

    def _sensed(self, name: str, per_radian: float) -> Callable[[np.ndarray], float]:
        """What an encoder measures [rad of its own], from ``qpos``."""
        coordinate, _, side = name.rpartition(".")
        if side == "link" and coordinate in self.names:
            weights = self.drivetrain.position(coordinate, np.eye(self.model.nq), "link")
            return lambda qpos: float(weights @ qpos) / per_radian
        if name not in self.layout.names:
            known = [*self.layout.names, *(f"{coordinate}.link" for coordinate in self.names)]
            raise SealegsError(f"sensors: there is no '{name}'{nearest(name, known)}; there are {', '.join(known)}.")
        measure = self.layout.measure(self.model, name)
        return lambda qpos: measure(qpos) / per_radian


def _unstable(data: mujoco.MjData) -> bool:
    return any(data.warning[kind].number for kind in UNSTABLE)


def _switchable(chain: Chain) -> Chain:
    """The chain with the stages by which firmware limits it, at values that change nothing."""
    if chain.find("duty_limit") is None and (chain.find("supply") or chain.find("regression")):
        chain = chain.with_stage(build_stage("duty_limit", {"limit": 1.0}, "virtual bus"))
    if chain.find("torque_limit") is None:
        chain = chain.with_stage(build_stage("torque_limit", {"limit": 1e6}, "virtual bus"))
    return chain


def _driven(chain: Chain, drive: Drive) -> Chain:
    if not drive.connected:
        chain = chain.with_value("torque_limit.limit", 0.0)
    if chain.find("duty_limit") is not None:
        chain = chain.with_value("duty_limit.limit", chain.value("duty_limit.limit") * drive.duty)
    for path, share in (
        *((f"{stage}.gain", drive.gain) for stage in ("position_p", "position_pd", "position_pi")),
        ("position_pd.damping", drive.damping),
        ("velocity_pi.gain", drive.speed_gain),
        ("velocity_pi.integral", drive.speed_integral),
        ("minimum_duty.value", drive.startup),
        ("dead_band.width", drive.dead_zone),
    ):
        if share != 1.0 and chain.find(path.partition(".")[0]) is not None:
            chain = chain.with_value(path, chain.value(path) * share)
    if drive.volts is not None and chain.find("supply") is not None:
        chain = chain.with_value("supply.volts", drive.volts)
    return chain


# --- what a virtual machine hides: how its chains and its robot differ from what everybody believes ------------------
#
# The file is YAML, in one of three forms:
#
# - a list: the chain that is really on every joint, such as the ``extended.yaml`` of a diagnosis;
# - a mapping with keys ``stage.parameter``, which change or add a stage on every joint, ``robot.number``, which change
#   a number of the robot, and ``imu.delay`` and the like (:mod:`sealegs.hw.virtual.imu`);
# - under the name of a joint, either of the two for that joint alone.

IMU = "imu."
"""Before the keys of an IMU."""


def hide(
    robot: Robot, chains: Mapping[str, Any], params: dict[str, float], path: str | None
) -> tuple[dict[str, Chain], dict[str, float]]:
    """Chains and numbers as the machine really has them.

    Args:
        robot: what they belong to.
        chains: chain of each joint, as believed.
        params: numbers of the robot, as believed.
        path: of the file; None: nothing is hidden.

    Raises:
        SealegsError: the file cannot be read, or names what robot or chain do not have.
    """
    believed = {name: load_chain(chain) for name, chain in chains.items()}
    if path is None:
        return believed, params
    content = _content(path)
    if isinstance(content, list):
        return {name: load_chain(path) for name in believed}, params
    if not isinstance(content, dict):
        raise SealegsError(f"{path} holds neither a chain nor changes such as 'delay.seconds: 0.025'.")
    numbers = dict(params)
    for key, value in content.items():
        key = str(key)
        if key in believed:
            if isinstance(value, list):
                believed[key] = load_chain(value)
            elif isinstance(value, dict):
                for inner, number in value.items():
                    believed[key] = changed(believed[key], str(inner), number, path)
            else:
                raise SealegsError(f"{path}: under '{key}' stands neither a chain nor changes of one.")
        elif key.startswith(IMU):
            if robot.imu is None:
                raise SealegsError(f"{path}: {key} is of an IMU, and robot '{robot.name}' has none.")
        elif key.startswith("robot."):
            numbers[key.removeprefix("robot.")] = value
        elif "." in key:
            believed = {name: changed(chain, key, value, path) for name, chain in believed.items()}
        else:
            raise SealegsError(
                f"{path}: '{key}' is no joint of {robot.name}{nearest(key, believed)}, and no path such as "
                "'delay.seconds' or 'robot.mass'."
            )
    return believed, numbers


def of_imu(path: str | None) -> dict[str, Any]:
    """What a file of hidden effects says of the IMU, by key after ``imu.``.

    Raises:
        SealegsError: the file cannot be read.
    """
    content = None if path is None else _content(path)
    rows = content.items() if isinstance(content, dict) else ()
    return {str(key).removeprefix(IMU): value for key, value in rows if str(key).startswith(IMU)}


def _content(path: str) -> Any:
    try:
        return read_yaml(path, f"the file of hidden effects {path}")
    except DocumentError as error:
        raise SealegsError(f"{error}.") from None


def changed(chain: Chain, path: str, value: Any, where: str) -> Chain:
    """The chain with one parameter changed; a stage that it lacks is added, its other parameters at their defaults."""
    stage, _, key = path.partition(".")
    if chain.find(stage) is None:
        return chain.with_stage(build_stage(stage, {key: value}, where))
    return chain.with_value(path, value)
