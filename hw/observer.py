"""What a task knows of a robot on servos: motion put together from readings, as the simulation does from its state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..actuators.errors import SealegsError
from ..envs.base import BaseLayout
from ..envs.contract import Contract, goal_scale, task_of
from ..envs.task import ModulatedTask, Motion, Task
from .robot import Reading, ServoRobot


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
    control step late. Torque is the motor constant times the measured current, 0 for chains without a motor.

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
            SealegsError: the command has another size.
        """
        self.task: Task = task_of(contract.env)[0]
        middle = self.task.commands(np.full((1, self.task.draws), 0.5))[0]
        self.command = middle if command is None else np.asarray(command, float)
        if self.command.shape != middle.shape:
            raise SealegsError(f"the task takes {len(middle)} command value(s), not {len(self.command)}.")
        self.numbers = robot.robot.parameters(robot.params)
        self._base, self.base_names = BaseLayout(robot.robot, robot.params), robot.base_names
        self._dt, self._count = 1.0 / contract.control_rate, len(contract.actions)
        self._constants = np.array([_motor_constant(robot, name) for name in robot.names])
        self.state = np.array(contract.state)
        self._last: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
        self._begun = self._seen = 0.0
        self._drawn: list[float] = []

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
        qpos = self._base.qpos(measured)
        if self._last is None:
            self._start(position)
            self._last = position, link, qpos
            self._begun = self._seen = reading.time
        # whole control steps: more than one where readings were missed or periods left out
        span = self._dt * max(round((reading.time - self._seen) / self._dt), 1)
        speed, link_speed = (position - self._last[0]) / span, (link - self._last[1]) / span
        qpos_rate = (qpos - self._last[2]) / span
        self._last, self._seen = (position, link, qpos), reading.time
        count = self._count
        motion = Motion(
            qpos=qpos,
            qvel=self._base.qvel(measured, rates),
            link=link[None],
            link_speed=link_speed[None],
            reading=position[None],
            reading_speed=speed[None],
            torque=torque[None],
            motor_speed=speed[None],
            action=self.action[None],
            previous_action=self.state[None, 1 + count : 1 + 2 * count],
            command=self.command[None],
            time=np.array([self._dt * round((reading.time - self._begun) / self._dt)]),
            numbers=self.numbers,
            memory=self.state[None, 1 + 2 * count :],
            power=np.array([np.mean(self._drawn) if self._drawn else 0.0]),
            qpos_rate=qpos_rate,
        )
        self._drawn.clear()
        with np.errstate(invalid="ignore"):
            parts = [np.atleast_1d(np.asarray(part[0], np.float32)) for part in self.task.observe(motion)]
            rewards = {name: float(term[0]) for name, term in self.task.rewards(motion).items()}
            failed = bool(self.task.failed(motion)[0])
        return Seen(reading.time, np.concatenate(parts), rewards, failed)

    def _start(self, position: np.ndarray) -> None:
        """The action that stands for where the robot is, as an episode starts at rest."""
        if isinstance(self.task, ModulatedTask):
            return
        zero, per_action = goal_scale(self.task, self.numbers, np.zeros(1), self.command[None])
        action = np.clip((position - np.reshape(zero, -1)) / per_action, -1.0, 1.0)
        self.state[1 : 1 + 2 * self._count] = np.tile(action, 2)


def _motor_constant(robot: ServoRobot, name: str) -> float:
    """Torque or force of the joint per ampere."""
    motor = robot.chains[name].find("dc_motor")
    return float(motor.motor_constant) * robot.chains[name].gear_ratio() if motor is not None else 0.0
