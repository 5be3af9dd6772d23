"""What a task is: pure functions over a batch from motion to observation, reward, failure and new starts."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from ...actuators import Drivetrain
from ...common.errors import SealegsError
from .robot import Robot
from .turns import projected_gravity
from .world import AVERAGED, NO_WORLD, World


@dataclass(slots=True)
class Motion:
    """What happened to n simulations of k coordinates in one control step; not to be written to.

    Attributes:
        qpos: true positions (n, nq), joints in the order of the model.
        qvel: true speeds (n, nv).
        link: link encoder (n, k) [rad].
        link_speed: its difference over the control step (n, k) [rad/s].
        reading: motor encoder as the host receives it: late, quantised, with its offset (n, k) [rad].
        reading_speed: its difference over the control step (n, k) [rad/s].
        torque: motor torque on the coordinate, dry friction excluded (n, k) [N.m].
        motor_speed: true speed of the motor side (n, k) [rad/s].
        action: of this step (n, k), within [-1, 1].
        previous_action: of the step before (n, k).
        command: what the episode asks for (n, c), as the task drew it at the start, or every ``command_interval``.
        time: since the episode started (n,) [s].
        numbers: of the robot, by name.
        memory: of the generator (n, task.memory), where actions modulate one.
        power: mean over the control step of :meth:`ModulatedTask.power` (n,) [W], likewise.
        qpos_rate: mean rate of the true positions over the control step (n, nq), likewise.
        duty: share of the supply that the drive gives the motor, -1 to 1 (n, k); 0 of chains without one.
        world: contacts, bodies, sites and sensors, of those words that the task has in ``sees``; not for observations.
        base: where the free joint that carries the robot begins in ``qpos`` and ``qvel``; None: the base is fixed.
        switches: 1 where a contact switch is closed, else 0 (n, s), in the order of ``robot.imu.switches``.

    What a task observes of the turn of the base (``qpos``, ``qvel``, ``gravity``, ``turn_rate``, ``orientation``) and
    of ``switches`` is as the robot's IMU measures it, where it has one; rewards and failures are judged by the truth.
    """

    qpos: np.ndarray
    qvel: np.ndarray
    link: np.ndarray
    link_speed: np.ndarray
    reading: np.ndarray
    reading_speed: np.ndarray
    torque: np.ndarray
    motor_speed: np.ndarray
    action: np.ndarray
    previous_action: np.ndarray
    command: np.ndarray
    time: np.ndarray
    numbers: Mapping[str, float]
    memory: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    power: np.ndarray = field(default_factory=lambda: np.empty(0))
    qpos_rate: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    duty: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    world: World = NO_WORLD
    base: tuple[int, int] | None = None
    switches: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))

    @property
    def orientation(self) -> np.ndarray:
        """Of the base in the world, a quaternion, w first (n, 4)."""
        at = self._base()[0]
        return self.qpos[:, at + 3 : at + 7]

    @property
    def gravity(self) -> np.ndarray:
        """Direction of gravity in the axes of the base (n, 3): (0, 0, -1) where it stands upright."""
        return projected_gravity(self.orientation)

    @property
    def turn_rate(self) -> np.ndarray:
        """Of the base about its own axes (n, 3) [rad/s]."""
        at = self._base()[1]
        return self.qvel[:, at + 3 : at + 6]

    def _base(self) -> tuple[int, int]:
        if self.base is None:
            raise SealegsError("the robot's base is fixed: gravity, turn_rate and orientation are of a free one.")
        return self.base


def option(default: Any, doc: str, unit: str = "") -> Any:
    """A number of a task with what it means, as the documentation of its environment has it.

    A number without one has that of the task that this one is derived from; weights are those of terms of the reward.

    Args:
        default: value where none is given; None: it follows from robot and chains (:meth:`Task.fitted`).
        doc: in a few words.
        unit: as ``m/s``.
    """
    return field(default=default, metadata={"doc": doc, "unit": unit})


def drawn(span: float | Sequence[float], random: np.ndarray) -> np.ndarray:
    """A number of a task, drawn from its range: uniform numbers in [0, 1) (any shape) in, numbers of that shape out."""
    low, high = span if isinstance(span, Sequence) else (span, span)
    return low + random * (high - low)


@dataclass(slots=True)
class Step:
    """Outcome of one control step of n simulations; arrays are the caller's to keep.

    Attributes:
        observation: (n, size), float32; of the new episode where ``done``, if the engine resets by itself.
        reward: (n,).
        terminated: (n,), the episode failed.
        truncated: (n,), it reached its time limit.
        terms: of the reward by name, (n,) each.
        flags: what an engineer wants to know, (n,) each: ``net_out_of_range``, ``unstable``.
        servo: how hard the servos were driven, by :data:`~sealegs.envs.engine.servo_use.MEASURES`, (n,) each.
        errors: from what was asked for, by :meth:`Task.errors`, (n,) each.
        done: numbers of the simulations whose episode ended.
        final_observation: (len(done), size), the last of those episodes.
    """

    observation: np.ndarray
    reward: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray
    terms: dict[str, np.ndarray]
    flags: dict[str, np.ndarray]
    servo: dict[str, np.ndarray]
    errors: dict[str, np.ndarray]
    done: np.ndarray
    final_observation: np.ndarray


@dataclass(frozen=True)
class Task(ABC):
    """A robot and what it is asked to do. Subclasses are frozen dataclasses of numbers, which are the options of their
    environment (:func:`option`); their methods know no single simulation.

    Attributes:
        robot: that the task is for.
        draws: uniform random numbers that one start needs.
        ranges: arguments that may be a pair, low and high, instead of one number.
        command_interval: after which a new command is drawn [s]; 0: an episode has one. A task may make a number of it.
        control_rate: actions per second [Hz], where nothing else is asked for.
        any_robot: whether its environment takes a ``robot``; :class:`sealegs.envs.any_robot.task.AnyRobotTask` does.
        takes_speeds: whether goals of wheels, whose chains are told speeds, are speeds to it; others refuse them.
        episode_steps: control steps of an episode of a task in a user's own file.
        sees: words of :data:`sealegs.envs.engine.world.SEES`: what it finds in :attr:`Motion.world`.
    """

    robot: ClassVar[Robot]
    draws: ClassVar[int]
    ranges: ClassVar[tuple[str, ...]] = ()
    command_interval = 0.0
    control_rate: ClassVar[float] = 50.0
    any_robot: ClassVar[bool] = False
    takes_speeds: ClassVar[bool] = False
    episode_steps: ClassVar[int] = 500
    sees: ClassVar[tuple[str, ...]] = ()

    @classmethod
    def on(cls, robot: Robot | str | Path) -> type[Self]:
        """The same task on another robot, which may be given by its name or its file.

        Raises:
            SealegsError: it is for a robot of its own.
        """
        raise SealegsError(f"{cls.__name__} is for robot '{cls.robot.name}', and takes no other ({robot}).")

    def action_names(self) -> tuple[str, ...]:
        """What the elements of an action mean: the goals of the robot's coordinates, where nothing else is said."""
        return tuple(item.name for item in self.robot.coordinates)

    @abstractmethod
    def observation_names(self) -> tuple[str, ...]:
        """Name and unit of each element of the observation, in order."""

    @abstractmethod
    def commands(self, random: np.ndarray) -> np.ndarray:
        """What m new episodes ask for (m, c), from uniform numbers in [0, 1), (m, draws)."""

    # What a person asks for in the place of those draws, while the policy runs. Nothing of it is needed to train.

    def asked_names(self) -> tuple[str, ...]:
        """Name and unit of each number that a person asks for; without more, of each number of the command."""
        return tuple(f"command {k + 1}" for k in range(self.commands(np.zeros((1, self.draws))).shape[1]))

    def asked_range(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest of these numbers in training (m,): what a policy does beyond, nobody has seen."""
        draws = np.random.default_rng(0).random((4096, self.draws))
        draws[:2048] = np.round(draws[:2048])  # corners, where values are largest and smallest
        draws[:2] = [[0.0], [1.0]]
        drawn = self.commands(draws)
        return drawn.min(axis=0), drawn.max(axis=0)

    def command_at(self, time: float, asked: Callable[[float], np.ndarray]) -> np.ndarray:
        """The command (c,) with which the task asks at ``time`` [s] for what a person asks for over time.

        Args:
            time: since the start [s].
            asked: numbers (m,) in the order of :meth:`asked_names` at a time [s].
        """
        return asked(time)

    def asked_start(self, command: np.ndarray) -> np.ndarray | None:
        """Goals (k,) to begin with where such a command (c,) is asked for [rad or m]; None: as in training."""
        del command
        return None

    @abstractmethod
    def place(
        self,
        drivetrain: Drivetrain,
        numbers: Mapping[str, float],
        random: np.ndarray,
        qpos: np.ndarray,
        qvel: np.ndarray,
    ) -> np.ndarray:
        """Write m starts into ``qpos`` (m, nq) and ``qvel`` (m, nv), which hold the model's defaults.

        Args:
            drivetrain: robot with its actuators.
            numbers: of the robot, by name.
            random: the same uniform numbers, (m, draws).
            qpos: to edit.
            qvel: to edit.

        Returns:
            The goals that the actuators hold at the start (m, k) [rad].
        """

    def reference(
        self, time: np.ndarray, command: np.ndarray, numbers: Mapping[str, float]
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Goals that actions correct, and how far they do; None: actions of -1 and 1 are the limits of the goals.

        Args:
            time: since the episodes started (n,) [s].
            command: what they ask for (n, c).
            numbers: of the robot, by name.

        Returns:
            Goals at action 0 (n, k) [rad], and the change of the goal per unit of action (k,) [rad].
        """
        del time, command, numbers
        return None

    def averaged(self) -> float:
        """Over how long the mean speeds of ``motion.world`` are taken [s]."""
        return AVERAGED

    def fitted(self, trial: Callable[[Self, int], Any]) -> Self:
        """The task with numbers that were left None and follow from robot and chains; called when an engine is built.

        Args:
            trial: makes a :class:`~sealegs.envs.engine.batch.BatchEngine` of as many simulations of a task on the same
                robot, to try it.
        """
        del trial
        return self

    def on_joints(self, time: np.ndarray, action: np.ndarray) -> np.ndarray:
        """Actions on the driven coordinates (n, k), of what the policy gave (n, k): another one only where the policy
        sees the robot otherwise than it stands, such as mirrored. At time 0 nothing may differ.

        Args:
            time: since the episodes started (n,) [s].
            action: of the policy, as :class:`Motion` and the contract keep it.
        """
        del time
        return action

    @abstractmethod
    def observe(self, motion: Motion) -> tuple[np.ndarray, ...]:
        """Parts of the observation, (n,) or (n, j) each, in the order of :meth:`observation_names`."""

    @abstractmethod
    def rewards(self, motion: Motion) -> dict[str, np.ndarray]:
        """Terms of the reward by name, (n,) each; the reward is their sum."""

    def errors(self, motion: Motion) -> dict[str, np.ndarray]:
        """How far the simulated robot is from what it is asked for, (n,) each, by a name with its unit in brackets.

        Means over episodes are told beside the reward, which nobody reads as metres or radians.
        """
        del motion
        return {}

    @abstractmethod
    def failed(self, motion: Motion) -> np.ndarray:
        """Whether the episode ends here for good, (n,)."""


class ModulatedTask(Task):
    """A task whose actions modulate a generator, which gives goals more often than there are actions.

    Such a task has :meth:`action_names` of its own; 0 is the middle of each. The generator's memory is an array that
    the engine keeps, a row per simulation.

    Attributes:
        memory: numbers that the generator remembers of a simulation.
        goal_period: between goals [s]; a control step holds a whole number of them.
        sample_period: between samples of the power [s]; a goal's period holds a whole number of them.
    """

    memory: ClassVar[int]
    goal_period: ClassVar[float]
    sample_period: ClassVar[float]

    @abstractmethod
    def begin(
        self, numbers: Mapping[str, float], random: np.ndarray, goals: np.ndarray, command: np.ndarray
    ) -> np.ndarray:
        """The generator's memory at m starts (m, memory).

        Args:
            numbers: of the robot, by name.
            random: as in :meth:`place`.
            goals: that the actuators hold at the start (m, k) [rad].
            command: what the episodes ask for (m, c).
        """

    @abstractmethod
    def generate(
        self, numbers: Mapping[str, float], action: np.ndarray, command: np.ndarray, memory: np.ndarray
    ) -> np.ndarray:
        """Goals of the next :attr:`goal_period` (n, k) [rad], after ``memory`` (n, memory) moved on by it in place."""

    @abstractmethod
    def power(self, numbers: Mapping[str, float], torque: np.ndarray, motor_speed: np.ndarray) -> np.ndarray:
        """Electrical power that the motors draw at a moment (n,) [W], from torque and speed (n, k) as in
        :class:`Motion`."""


# --- what a task gives, checked --------------------------------------------------------------------------------------


ROW_WORDS = "one number per simulation (motion.link.shape[0] of them)"


def check_step(task: Task, terms: Any, failed: Any, count: int) -> None:
    """Refuse rewards and failures that are no arrays (n,).

    Raises:
        SealegsError: the task gives something else; says what, and how it is written.
    """
    name = type(task).__name__
    if not isinstance(terms, Mapping):
        raise SealegsError(f"{name}.rewards gives {_what(terms)}; it gives a dict of terms by name, {ROW_WORDS} each.")
    for term, values in terms.items():
        if not _is_row(values, count):
            raise SealegsError(
                f"{name}.rewards gives {_what(values)} as '{term}'; give an array with {ROW_WORDS}, such as "
                f"np.full({count}, 1.0)."
            )
    if not _is_row(failed, count):
        raise SealegsError(f"{name}.failed gives {_what(failed)}; give an array of bool with {ROW_WORDS}.")


def check_observation(task: Task, parts: Any, count: int, size: int) -> None:
    """Refuse observations whose parts are no arrays (n,) or (n, m), or that are not as wide as their names say.

    Raises:
        SealegsError: the task gives something else.
    """
    name = type(task).__name__
    if not isinstance(parts, Sequence):
        raise SealegsError(f"{name}.observe gives {_what(parts)}; give a list of arrays, with {ROW_WORDS} each.")
    for place, part in enumerate(parts):
        if not isinstance(part, np.ndarray) or part.ndim not in (1, 2) or len(part) != count:
            raise SealegsError(f"{name}.observe gives {_what(part)} as part {place}; give arrays with {ROW_WORDS}.")
    wide = sum(1 if part.ndim == 1 else part.shape[1] for part in parts)
    if wide != size:
        raise SealegsError(f"{name}.observe gives {wide} numbers, and observation_names names {size}; make them agree.")


def _is_row(values: Any, count: int) -> bool:
    return isinstance(values, np.ndarray) and values.shape == (count,)


def _what(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of the shape {value.shape}"
    return f"{value!r}" if isinstance(value, int | float | bool) else f"a {type(value).__name__}"
