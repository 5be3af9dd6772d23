"""What a policy and the robot that it runs on must agree on, as data that travels inside the policy's file."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import MISSING, asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, get_type_hints

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import load_env_creator

from ..actuators import Chain, load_chain
from ..common.documents import parse_json
from ..common.errors import SealegsError
from ..configs.check import Count, Natural, NotNegative, Positive, checked
from . import known_id
from .engine.arguments import TaskShell, task_arguments
from .engine.base import BaseLayout
from .engine.robot import Robot, check_position_goals
from .engine.task import ModulatedTask, Motion, Task

VERSION = 2
KEY = "sealegs.contract"
"""Name of the metadata entry of an ONNX file that holds the contract."""
SPRUNG = ("compliance", "spring", "backlash")
"""Stages behind which the link is elsewhere than the motor."""


class ContractError(SealegsError):
    """A policy that does not fit the robot, or whose contract cannot be read; the message names the field."""


@dataclass(frozen=True)
class Contract:
    """Everything that a policy takes for granted about the robot around it.

    Attributes:
        env: id and arguments of the environment it was trained in, the actuator left out.
        robot: name of the robot.
        robot_hash: of its numbers and driven coordinates.
        joints: driven coordinates in the order of goals.
        units: of their goals, rad or m.
        start: goals that the robot holds before the first action.
        goal_low, goal_high: between which all goals lie.
        actions: what the elements of an action mean.
        control_rate: actions per second [Hz].
        goals_per_action: goals in the time of an action: the policy is asked ``control_rate`` times this often.
        delay: from a reading to the goal that follows from it, fixed [s].
        observation_names: name and unit of each element of the observation, in order.
        sensors: what the observation needs beside the servos' encoders: ``<joint>.link``, quantities of
            :mod:`sealegs.envs.engine.base`, or contact switches, ``switch.<name>``.
        history: observations that the policy sees at once, the newest last; an earlier action is an element of its own.
        commands: numbers that the task asks for.
        state: of the policy at the start: goals given so far, the latest action and the one before, the memory of the
            generator whose gait it modulates, and what the policy itself remembers.
        chains: stages of the chain on each joint, as the policy was trained with.
        chain_hash: of these chains, with the contents of their nets.
        policy_memory: elements of the state, its last ones, that are the policy's own: earlier observations, and the
            state of a recurrent network.
        asked: name and unit of each number that a person asks for while it runs, in order.
    """

    env: dict[str, Any]
    robot: str
    robot_hash: str
    joints: tuple[str, ...]
    units: tuple[str, ...]
    start: tuple[float, ...]
    goal_low: tuple[float, ...]
    goal_high: tuple[float, ...]
    actions: tuple[str, ...]
    control_rate: Positive
    goals_per_action: Count
    delay: NotNegative
    observation_names: tuple[str, ...]
    sensors: tuple[str, ...]
    history: Count
    commands: Natural
    state: tuple[float, ...]
    chains: dict[str, list[dict[str, Any]]]
    chain_hash: str
    policy_memory: Natural = 0
    asked: tuple[str, ...] = ()

    @property
    def goal_rate(self) -> float:
        """Goals per second [Hz]: how often the policy is asked."""
        return self.control_rate * self.goals_per_action

    @property
    def rates(self) -> tuple[float, ...]:
        """Cycles per second at which a loop may run it, the highest first [Hz]: of goals between two actions the loop
        may leave out some, evenly, and hold the others; actions come at their own rate always."""
        count = self.goals_per_action
        return tuple(self.goal_rate / held for held in range(1, count + 1) if count % held == 0)

    @property
    def goal_limits(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest goal that the policy can give each joint [rad or m]."""
        return {name: (low, high) for name, low, high in zip(self.joints, self.goal_low, self.goal_high, strict=True)}

    def task_on(self, robot: Robot) -> tuple[Task, dict[str, Any]]:
        """The task, and the engine's arguments, on the robot at hand; the file that the contract names is not read.

        Raises:
            SealegsError: as :func:`task_of`.
        """
        try:
            return task_of({**self.env, "robot": robot} if "robot" in self.env else self.env)
        except SealegsError as error:
            raise ContractError(f"the environment in the policy's contract: {error}") from None

    def to_json(self) -> str:
        """The contract as text."""
        return json.dumps({"version": VERSION, **asdict(self)})

    @classmethod
    def from_json(cls, text: str, where: str) -> Contract:
        """Read a contract.

        Args:
            text: as :meth:`to_json` writes it.
            where: file it was found in, for the message.

        Raises:
            ContractError: it is damaged, or of another version.
        """
        try:
            document = parse_json(text, "it")
            if document["version"] != VERSION:
                raise ContractError(
                    f"{where}: its contract has version {document['version']}, and this program reads version "
                    f"{VERSION}; export the policy again."
                )
            types = get_type_hints(cls, include_extras=True)
            known = [item for item in fields(cls) if item.default is MISSING or item.name in document]
            values = {item.name: checked(item.name, document[item.name], types[item.name]) for item in known}
            contract = cls(**values)
            contract._check_sizes()
        except (ValueError, LookupError, TypeError) as error:
            if isinstance(error, ContractError):
                raise
            raise ContractError(f"{where}: its contract cannot be read ({error}); export the policy again.") from None
        return contract

    def _check_sizes(self) -> None:
        for name in ("units", "start", "goal_low", "goal_high"):
            if len(getattr(self, name)) != len(self.joints):
                raise ValueError(f"{name} has {len(getattr(self, name))} entries for {len(self.joints)} joints")
        least, most = (self.history - 1) * len(self.observation_names), len(self.state) - 1 - 2 * len(self.actions)
        if not least <= self.policy_memory <= most:
            raise ValueError(f"policy_memory is {self.policy_memory}, and must be from {least} to {most}")
        if not isinstance(self.env.get("id"), str):
            raise ValueError("env has no id")
        if self.delay * self.goal_rate >= 1.0:  # as in training; the loop waits for so long within a cycle
            raise ValueError(
                f"delay is {self.delay:g} s, and must be less than the {1.0 / self.goal_rate:g} s of a goal"
            )
        for key, value in checked("env.params", self.env.get("params") or {}, dict[str, float]).items():
            checked(f"env.params.{key}", value, float)
        for joint, stages in self.chains.items():
            checked(f"chains.{joint}", stages, list[dict[str, Any]])


def task_of(env: Mapping[str, Any]) -> tuple[Task, dict[str, Any]]:
    """The task of an environment and the engine's arguments, from the environment's id and arguments.

    No file of a task is run here: who is told of one by a person runs it before (:mod:`sealegs.envs.any_robot.user`).

    Raises:
        SealegsError: there is no such environment, or an argument is wrong.
    """
    name = known_id(str(env["id"]))
    entry = gym.spec(name).vector_entry_point
    creator: Any = load_env_creator(entry) if isinstance(entry, str) else entry
    if not (isinstance(creator, type) and issubclass(creator, TaskShell)):
        raise SealegsError(f"environment '{name}' is none of this project's, and has no task of a robot.")
    given = {key: value for key, value in env.items() if key != "id"}
    return task_arguments(creator.task, {**gym.spec(name).kwargs, **given})


def robot_hash(robot: Robot, params: Mapping[str, float] | None = None) -> str:
    """Hash of what makes a robot this robot: its numbers and its driven coordinates."""
    coordinates = [[item.name, [list(term) for term in item.terms]] for item in robot.coordinates]
    numbers = {
        name: value
        for name, value in robot.parameters(params).items()
        if not robot.numbers[name].numerical
        and not (robot.numbers[name].neutral and value == robot.numbers[name].value)
    }
    described = [] if robot.file is None else [robot.file.digest]
    return _hash([robot.name, numbers, coordinates, *described])


def chain_hash(chains: Mapping[str, Chain]) -> str:
    """Hash of chains by joint; a net counts by what its file holds."""
    return _hash({name: [_contents(stage) for stage in chain.to_list()] for name, chain in chains.items()})


def make_contract(
    env: Mapping[str, Any], chains: Mapping[str, list], control_rate: float, history: int = 1, recurrent: int = 0
) -> Contract:
    """Contract of a policy that was trained in ``env`` with ``chains``.

    Args:
        env: id and arguments of the environment.
        chains: stages by joint.
        control_rate: actions per second [Hz].
        history: observations that the policy sees at once.
        recurrent: numbers that its network remembers from action to action.

    Raises:
        SealegsError: as :func:`task_of`, or a chain that is none.
    """
    task, engine = task_of(env)
    params = engine.get("params")
    robot = task.robot
    numbers = robot.parameters(params)
    limits = robot.goal_limits(numbers)
    names = tuple(item.name for item in robot.coordinates)
    kept = {key: value for key, value in env.items() if key != "actuator"}
    loaded = {name: load_chain(list(chains[name])) for name in names}
    check_position_goals(robot, loaded, "a policy gives")
    units = BaseLayout(robot, params).units
    start, state = start_of(task, numbers)
    remembered = (history - 1) * len(task.observation_names()) + recurrent
    return Contract(
        env=json.loads(json.dumps(kept)),
        robot=robot.name,
        robot_hash=robot_hash(robot, params),
        joints=names,
        units=tuple(units[item.terms[0][0]] for item in robot.coordinates),
        start=tuple(start.tolist()),
        goal_low=tuple(float(limits[name][0]) for name in names),
        goal_high=tuple(float(limits[name][1]) for name in names),
        actions=tuple(task.action_names()),
        control_rate=float(control_rate),
        goals_per_action=goals_per_action(task, control_rate),
        delay=float(engine.get("action_delay") or 0.0),
        observation_names=tuple(task.observation_names()),
        sensors=needed_sensors(task, numbers, loaded),
        history=history,
        commands=task.commands(np.zeros((1, task.draws))).shape[1],
        state=(*state.tolist(), *[0.0] * remembered),
        chains={name: list(chains[name]) for name in names},
        chain_hash=chain_hash(loaded),
        policy_memory=remembered,
        asked=tuple(task.asked_names()),
    )


def start_pose(contract: Contract, robot: Robot | None = None) -> dict[str, float]:
    """Every joint of the robot at an undisturbed start, by quantity of :mod:`sealegs.envs.engine.base` [rad or m].

    Args:
        contract: of the policy.
        robot: at hand; None: the one that the contract names, whose file is read where it has one.
    """
    task, engine = task_of(contract.env) if robot is None else contract.task_on(robot)
    params = engine.get("params")
    numbers = task.robot.parameters(params)
    drivetrain = task.robot.drivetrain(None, numbers)
    qpos = np.array(drivetrain.model.qpos0)[None].copy()
    task.place(drivetrain, numbers, np.full((1, task.draws), 0.5), qpos, np.zeros((1, drivetrain.model.nv)))
    return BaseLayout(task.robot, params).values_of(drivetrain.model, qpos[0])


def goals_per_action(task: Task, control_rate: float) -> int:
    """Goals that a task gives in the time of an action."""
    return round(1.0 / (control_rate * task.goal_period)) if isinstance(task, ModulatedTask) else 1


def start_of(task: Task, numbers: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Goals of an undisturbed start (k,), and the policy's state there (s,), see :class:`Contract`."""
    drivetrain = task.robot.drivetrain(None, numbers)
    random = np.full((1, task.draws), 0.5)
    qpos = np.array(drivetrain.model.qpos0)[None].copy()
    goals = task.place(drivetrain, numbers, random, qpos, np.zeros((1, drivetrain.model.nv)))
    command = task.commands(random)
    if isinstance(task, ModulatedTask):
        action, memory = np.zeros(len(task.action_names())), task.begin(numbers, random, goals, command)[0]
    else:
        zero, per_action = goal_scale(task, numbers, np.zeros(1), command)
        action, memory = np.clip((goals - zero) / per_action, -1.0, 1.0)[0], np.empty(0)
    return goals[0], np.concatenate([[0.0], action, action, memory])


def goal_scale(task: Task, numbers: Mapping[str, float], time: Any, command: Any) -> tuple[Any, Any]:
    """Goals at action 0 (n, k) or (k,), and their change per unit of action (k,) [rad or m]."""
    limits = np.array(list(task.robot.goal_limits(numbers).values()))
    corrected = task.reference(time, command, numbers)
    return corrected if corrected is not None else (limits.mean(axis=1), 0.5 * (limits[:, 1] - limits[:, 0]))


def needed_sensors(task: Task, numbers: Mapping[str, float], chains: Mapping[str, Chain]) -> tuple[str, ...]:
    """Encoders beside those of the servos on which the observation depends, see :class:`Contract`."""
    robot = task.robot
    layout = BaseLayout(robot, numbers)
    driven = [item.name for item in robot.coordinates]
    base = [
        name for name in layout.names if name not in {joint for item in robot.coordinates for joint, _ in item.terms}
    ]
    links = [f"{name}.link" for name in driven if any(chains[name].find(stage) for stage in SPRUNG)]
    switched = [switch.column for switch in (robot.imu.switches if robot.imu is not None else ())]

    def seen(moved: str | None) -> np.ndarray:
        random = np.random.default_rng(0)
        values = {name: random.normal(0.0, 0.3, 64) + 0.4 * (name == moved) for name in layout.names}
        rates = {name: random.normal(0.0, 0.3, 64) + 0.4 * (name == moved) for name in layout.names}
        motion = random_motion(task, numbers, random, 64)
        switches = motion.switches.copy()
        switches[:, [name == moved for name in switched]] += 0.4
        link = np.stack([motion.link[:, k] + 0.4 * (f"{name}.link" == moved) for k, name in enumerate(driven)], axis=1)
        speed = link - motion.link + motion.link_speed
        qpos, qvel = layout.qpos(values, 64), layout.qvel(values, rates, 64)
        with np.errstate(invalid="ignore"):
            parts = task.observe(replace(motion, qpos=qpos, qvel=qvel, link=link, link_speed=speed, switches=switches))
        return np.concatenate([np.reshape(part, (64, -1)) for part in parts], axis=1)

    before = seen(None)
    return tuple(name for name in (*links, *base, *switched) if not np.array_equal(seen(name), before, equal_nan=True))


def random_motion(task: Task, numbers: Mapping[str, float], random: np.random.Generator, rows: int) -> Motion:
    """Motion that means nothing, for finding out what depends on what."""
    k, actions = len(task.robot.coordinates), len(task.action_names())
    layout = BaseLayout(task.robot, numbers)
    memory = task.memory if isinstance(task, ModulatedTask) else 0

    def draw(*shape: int) -> np.ndarray:
        return random.normal(0.0, 0.3, (rows, *shape))

    return Motion(
        qpos=draw(layout.nq), qvel=draw(layout.nv), link=draw(k), link_speed=draw(k), reading=draw(k),
        reading_speed=draw(k), torque=draw(k), motor_speed=draw(k), action=draw(actions),
        previous_action=draw(actions), command=draw(task.commands(np.zeros((1, task.draws))).shape[1]), time=draw(),
        numbers=numbers, memory=draw(memory), power=draw(), qpos_rate=draw(layout.nq),
        base=layout.base, switches=draw(len(task.robot.imu.switches) if task.robot.imu is not None else 0),
    )  # fmt: skip


def _contents(stage: dict[str, Any]) -> dict[str, Any]:
    if "net" not in stage:
        return stage
    file = Path(str(stage["net"]["file"]))
    return {"net": {**stage["net"], "file": hashlib.sha256(file.read_bytes()).hexdigest()}}


def _hash(document: Any) -> str:
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()[:16]
