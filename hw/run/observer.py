"""What a task knows of a robot on servos: motion put together from readings, as the simulation does from its state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...common.errors import SealegsError
from ...envs.contract import Contract, goal_scale
from ...envs.engine.base import BaseLayout, euler, quaternion
from ...envs.engine.task import ModulatedTask, Motion, Task
from ...envs.engine.turns import inverse, multiply
from ..machine.joints import BaseTurn
from ..machine.robot import Reading, ServoRobot


@dataclass(frozen=True)
class Seen:
    """One control step as the task sees it.

    Attributes:
        time: of its reading [s].
        observation: (size,), float32.
        rewards: terms of the reward by name, from measured signals alone; NaN where one that it needs is not measured.
        failed: whether the task counts the robot as fallen.
    """

    time: float
    observation: np.ndarray
    rewards: dict[str, float]
    failed: bool


class Observer:
    """Observations of a task out of readings, of a robot or of anything that is read like one.

    Speeds of joints are differences over control steps, as in the environment, and the task itself puts the observation
    together. Speeds of a base are such differences too, where the environment has those of the moment: they are half a
    control step late. An IMU has the turn rate of the moment; its heading counts from where it begins. What was not
    read in a control step keeps its speed (:class:`_Speeds`). Torque is the motor constant times the measured current,
    0 for chains without a motor.

    Attributes:
        task: of the policy.
        command: what is asked of the robot (c,), as in the task.
        base_names: quantities of the base that readings hold, in their order.
        state: of the policy (s,), see :class:`sealegs.envs.contract.Contract`.
    """

    def __init__(self, contract: Contract, robot: ServoRobot, command: np.ndarray | None = None) -> None:
        """Prepare.

        Args:
            contract: of the policy.
            robot: that it runs on.
            command: what is asked (c,); None: the middle of what the task draws.

        Raises:
            SealegsError: the command has another size, or is beyond those that the policy was trained on.
        """
        self.task: Task = contract.task_on(robot.robot)[0]
        middle = self.task.commands(np.full((1, self.task.draws), 0.5))[0]
        self.command = middle if command is None else np.asarray(command, float)
        if self.command.shape != middle.shape:
            raise SealegsError(f"the task takes {len(middle)} command value(s), not {len(self.command)}.")
        if command is not None:
            _check_range(self.task, self.command)
        self.numbers = robot.robot.parameters(robot.params)
        self._base, self.base_names = BaseLayout(robot.robot, robot.params), robot.base_names
        self._dt, self._count = 1.0 / contract.control_rate, len(contract.actions)
        self._constants = np.array([_motor_constant(robot, name) for name in robot.names])
        self.state = np.array(contract.state)
        self._joint_speeds, self._link_speeds, self._rates = (_Speeds(self._dt) for _ in range(3))
        self._begun: float | None = None
        self._ahead: np.ndarray | None = None
        self._fresh = robot.fresh
        self._drawn: list[float] = []
        self._switches = np.zeros((1, 0 if robot.robot.imu is None else len(robot.robot.imu.switches)))

    @property
    def action(self) -> np.ndarray:
        """The latest (a,), within [-1, 1]."""
        return self.state[1 : 1 + self._count]

    def acted(self, action: np.ndarray) -> None:
        """Note the action that was just commanded (a,), where no policy's own state says it."""
        self.state[1 + self._count : 1 + 2 * self._count] = self.action
        self.state[1 : 1 + self._count] = np.clip(action, -1.0, 1.0)

    def glance(self, reading: Reading, torque: np.ndarray | None = None) -> None:
        """Note the power drawn at a reading between two control steps; arguments as in :meth:`see`."""
        if isinstance(self.task, ModulatedTask):
            torque = self._constants * reading.current if torque is None else torque
            self._drawn.append(float(self.task.power(self.numbers, torque[None], reading.velocity[None])[0]))

    def see(self, reading: Reading, torque: np.ndarray | None = None) -> Seen:
        """The control step that ends with ``reading``.

        Args:
            reading: of servos and sensors.
            torque: of the joints (k,) [N.m or N]; None: as the currents say.
        """
        torque = self._constants * reading.current if torque is None else torque
        position, link = reading.position, reading.link
        measured = dict(zip(self.base_names, reading.base_position.tolist(), strict=True))
        rates = dict(zip(self.base_names, reading.base_velocity.tolist(), strict=True))
        qpos, qvel = self._base.qpos(measured), self._base.qvel(measured, rates)
        self._turned(reading.imu, qpos, qvel)
        if self._begun is None:
            self._start(position)
            self._begun = reading.time
        now = reading.time
        joints, links, base = self._fresh(reading)
        speed, link_speed = self._joint_speeds(position, joints, now), self._link_speeds(link, links, now)
        known = dict(zip(self.base_names, np.where(base, reading.base_position, np.nan), strict=True))
        # of a quaternion all four numbers are older where one of its angles is
        qpos_rate = self._rates(qpos, np.isnan(qpos) | ~np.isnan(self._base.qpos(known)), now)
        count = self._count
        motion = Motion(
            qpos=qpos,
            qvel=qvel,
            link=link[None],
            link_speed=link_speed[None],
            reading=position[None],
            reading_speed=speed[None],
            torque=torque[None],
            motor_speed=speed[None],
            action=self.action[None],
            previous_action=self.state[None, 1 + count : 1 + 2 * count],
            command=self.command[None],
            time=np.array([self._dt * round((now - self._begun) / self._dt)]),
            numbers=self.numbers,
            memory=self.state[None, 1 + 2 * count :],
            power=np.array([np.mean(self._drawn) if self._drawn else 0.0]),
            qpos_rate=qpos_rate,
            base=self._base.base,
            switches=self._switches if reading.imu is None else reading.imu.switches[None],
        )
        self._drawn.clear()
        with np.errstate(invalid="ignore"):
            parts = [np.atleast_1d(np.asarray(part[0], np.float32)) for part in self.task.observe(motion)]
            rewards = {name: float(term[0]) for name, term in self.task.rewards(motion).items()}
            failed = bool(self.task.failed(motion)[0])
        return Seen(reading.time, np.concatenate(parts), rewards, failed)

    def _turned(self, turn: BaseTurn | None, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Write how the base turns into positions (1, nq) and speeds (1, nv), as an IMU says it."""
        if turn is None or self._base.base is None:
            return
        at, dof = self._base.base
        if self._ahead is None:
            self._ahead = inverse(quaternion(0.0, 0.0, euler(turn.orientation)[2]))
        qpos[0, at + 3 : at + 7] = multiply(self._ahead, turn.orientation)
        qvel[0, dof + 3 : dof + 6] = turn.turn_rate

    def _start(self, position: np.ndarray) -> None:
        """The action that stands for where the robot is, as an episode starts at rest."""
        if isinstance(self.task, ModulatedTask):
            return
        zero, per_action = goal_scale(self.task, self.numbers, np.zeros(1), self.command[None])
        action = np.clip((position - np.reshape(zero, -1)) / per_action, -1.0, 1.0)
        self.state[1 : 1 + 2 * self._count] = np.tile(action, 2)


def _check_range(task: Task, command: np.ndarray) -> None:
    """Refuse a command (c,) that the task does not draw: what a policy does then, nobody has seen.

    Raises:
        SealegsError: it is beyond the range of one of its values.
    """
    low, high = Task.asked_range(task)  # of the command's own numbers
    slack = 1e-6 + 0.01 * (high - low)  # the corners are not all of them
    for k in np.flatnonzero((command < low - slack) | (command > high + slack)):
        span = f"{low[k]:.4g}" if low[k] == high[k] else f"{low[k]:.4g} to {high[k]:.4g}"
        raise SealegsError(
            f"value {k + 1} of command= is {command[k]:.4g}, but the policy was trained with {span}; give a value of "
            "that, or train it for more."
        )


class _Speeds:
    """Speeds of several quantities, as differences over whole control steps.

    A control step without a reading is no standstill: the quantity keeps its speed. The next reading tells the speed
    over all steps since the last one.
    """

    def __init__(self, dt: float) -> None:
        self._dt = dt
        self._last: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None  # place, time and speed of each

    def __call__(self, place: np.ndarray, fresh: np.ndarray, time: float) -> np.ndarray:
        """Speeds at ``time`` [s] at the places, of which those that are ``fresh`` were read in this control step."""
        before, since, speed = self._last or (place, np.full(place.shape, time), np.zeros(place.shape))
        steps = np.maximum(np.round((time - since) / self._dt), 1.0)  # more than one where periods were left out
        speed = np.where(fresh, (place - before) / (self._dt * steps), speed)
        self._last = np.where(fresh, place, before), np.where(fresh, time, since), speed
        return speed


def _motor_constant(robot: ServoRobot, name: str) -> float:
    """Torque or force of the joint per ampere."""
    motor = robot.chains[name].find("dc_motor")
    return float(motor.motor_constant) * robot.chains[name].gear_ratio() if motor is not None else 0.0
