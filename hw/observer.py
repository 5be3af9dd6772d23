"""What a task knows of a robot on servos: motion put together from readings, as the simulation does from its state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..actuators.errors import SealegsError
from ..envs.contract import Contract, task_of
from ..envs.task import Motion, Task
from .robot import Reading, ServoRobot


@dataclass(frozen=True)
class Seen:
    """One control step as the task sees it.

    Attributes:
        observation: (size,), float32.
        rewards: terms of the reward by name, from measured signals alone.
        failed: whether the task counts the robot as fallen.
    """

    observation: np.ndarray
    rewards: dict[str, float]
    failed: bool


class Observer:
    """Observations of a task out of readings, of a robot or of anything that is read like one.

    The arithmetic is the environment's own: speeds are differences over control steps, and the task itself puts the
    observation together. Torque is the motor constant times the measured current, 0 for chains without a motor.

    Attributes:
        task: of the policy.
        command: what is asked of the robot (c,), as in the task.
        action: of the cycle before (k,), within [-1, 1].
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
        self._dt = 1.0 / contract.control_rate
        zero, per = np.asarray(contract.goal_at_zero), np.asarray(contract.goal_per_action)
        self._zero, self._per = zero, per
        self._constants = np.array([_motor_constant(robot, name) for name in robot.names])
        self.action = self._previous_action = np.zeros(len(robot.names))
        self._last: tuple[np.ndarray, np.ndarray] | None = None
        self._begun = self._seen = 0.0

    def acted(self, action: np.ndarray) -> None:
        """Note the action that was just commanded (k,)."""
        self._previous_action, self.action = self.action, np.clip(action, -1.0, 1.0)

    def see(self, reading: Reading) -> Seen:
        """The control step that ends with ``reading``."""
        position, link = reading.position, reading.link
        if self._last is None:  # at rest, holding where it stands, as an episode starts
            self._last = position, link
            self._begun = self._seen = reading.time
            self.action = self._previous_action = np.clip((position - self._zero) / self._per, -1.0, 1.0)
        # whole control steps: more than one where readings were missed or periods left out
        span = self._dt * max(round((reading.time - self._seen) / self._dt), 1)
        speed, link_speed = (position - self._last[0]) / span, (link - self._last[1]) / span
        self._last, self._seen = (position, link), reading.time
        motion = Motion(
            qpos=reading.base_position[None],
            qvel=reading.base_velocity[None],
            link=link[None],
            link_speed=link_speed[None],
            reading=position[None],
            reading_speed=speed[None],
            torque=(self._constants * reading.current)[None],
            motor_speed=speed[None],
            action=self.action[None],
            previous_action=self._previous_action[None],
            command=self.command[None],
            time=np.array([self._dt * round((reading.time - self._begun) / self._dt)]),
            numbers=self.numbers,
        )
        parts = [np.atleast_1d(np.asarray(part[0], np.float32)) for part in self.task.observe(motion)]
        rewards = {name: float(term[0]) for name, term in self.task.rewards(motion).items()}
        return Seen(np.concatenate(parts), rewards, bool(self.task.failed(motion)[0]))


def _motor_constant(robot: ServoRobot, name: str) -> float:
    motor = robot.chains[name].find("dc_motor")
    return float(motor.motor_constant) if motor is not None else 0.0
