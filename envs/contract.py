"""What a policy and the robot that it runs on must agree on, as data that travels inside the policy's file."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import load_env_creator

from ..actuators import Chain, load_chain
from ..actuators.errors import SealegsError
from . import registered_id
from .arguments import task_arguments
from .robot import Robot
from .task import ModulatedTask, Task

VERSION = 1
KEY = "sealegs.contract"
"""Name of the metadata entry of an ONNX file that holds the contract."""


class ContractError(SealegsError):
    """A policy that does not fit the robot, or whose contract cannot be read; the message names the field."""


@dataclass(frozen=True)
class Contract:
    """Everything that a policy takes for granted about the robot around it.

    Attributes:
        env: id and arguments of the environment it was trained in, the actuator left out.
        robot: name of the robot.
        robot_hash: of its numbers and driven coordinates.
        joints: driven coordinates in the order of actions and goals.
        goal_at_zero: goal of each joint at action 0 [rad].
        goal_per_action: change of the goal per unit of action [rad].
        control_rate: actions per second [Hz].
        observation_names: name and unit of each element of the observation, in order.
        history: observations that the policy sees at once, the newest last; an earlier action is an element of its own.
        chains: stages of the chain on each joint, as the policy was trained with.
        chain_hash: of these chains, with the contents of their nets.
    """

    env: dict[str, Any]
    robot: str
    robot_hash: str
    joints: tuple[str, ...]
    goal_at_zero: tuple[float, ...]
    goal_per_action: tuple[float, ...]
    control_rate: float
    observation_names: tuple[str, ...]
    history: int
    chains: dict[str, list]
    chain_hash: str

    @property
    def goal_limits(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest goal that the policy can give each joint [rad]."""
        reach = zip(self.joints, self.goal_at_zero, self.goal_per_action, strict=True)
        return {name: (zero - abs(per), zero + abs(per)) for name, zero, per in reach}

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
            document = json.loads(text)
            if document["version"] != VERSION:
                raise ContractError(
                    f"{where}: its contract has version {document['version']}, and this program reads version "
                    f"{VERSION}; export the policy again."
                )
            values: dict[str, Any] = {field.name: document[field.name] for field in fields(cls)}
        except (ValueError, LookupError, TypeError) as error:
            if isinstance(error, ContractError):
                raise
            raise ContractError(f"{where}: its contract cannot be read ({error}); export the policy again.") from None
        lists: dict[str, Any] = {name: tuple(value) for name, value in values.items() if isinstance(value, list)}
        return cls(**{**values, **lists})


def task_of(env: Mapping[str, Any]) -> tuple[Task, dict[str, Any]]:
    """The task of an environment and the engine's arguments, from the environment's id and arguments.

    Raises:
        SealegsError: there is no such environment, or an argument is wrong.
    """
    name = registered_id(str(env["id"]))
    entry = gym.spec(name).vector_entry_point
    creator: Any = load_env_creator(entry) if isinstance(entry, str) else entry
    return task_arguments(creator.task, {key: value for key, value in env.items() if key != "id"})


def robot_hash(robot: Robot, params: Mapping[str, float] | None = None) -> str:
    """Hash of what makes a robot this robot: its numbers and its driven coordinates."""
    coordinates = [[item.name, [list(term) for term in item.terms]] for item in robot.coordinates]
    numbers = {
        name: value
        for name, value in robot.parameters(params).items()
        if not (robot.numbers[name].neutral and value == robot.numbers[name].value)
    }
    described = [] if robot.file is None else [robot.file.digest]
    return _hash([robot.name, numbers, coordinates, *described])


def chain_hash(chains: Mapping[str, Chain]) -> str:
    """Hash of chains by joint; a net counts by what its file holds."""
    return _hash({name: [_contents(stage) for stage in chain.to_list()] for name, chain in chains.items()})


def make_contract(env: Mapping[str, Any], chains: Mapping[str, list], control_rate: float) -> Contract:
    """Contract of a policy that was trained in ``env`` with ``chains``.

    Args:
        env: id and arguments of the environment.
        chains: stages by joint.
        control_rate: actions per second [Hz].

    Raises:
        ContractError: the task's actions correct goals that change with time, which a contract does not hold.
        SealegsError: as :func:`task_of`, or a chain that is none.
    """
    task, engine = task_of(env)
    params = engine.get("params")
    robot = task.robot
    numbers = robot.parameters(params)
    limits = robot.goal_limits(numbers)
    start = np.zeros(1), task.commands(np.zeros((1, task.draws))), numbers
    if isinstance(task, ModulatedTask) or task.reference(*start) is not None:
        raise ContractError(
            f"actions of {env['id']} with these arguments modulate or correct a gait, and a contract holds no "
            "goals that change with time."
        )
    names = tuple(item.name for item in robot.coordinates)
    kept = {key: value for key, value in env.items() if key != "actuator"}
    return Contract(
        env=json.loads(json.dumps(kept)),
        robot=robot.name,
        robot_hash=robot_hash(robot, params),
        joints=names,
        goal_at_zero=tuple(0.5 * (limits[name][0] + limits[name][1]) for name in names),
        goal_per_action=tuple(0.5 * (limits[name][1] - limits[name][0]) for name in names),
        control_rate=float(control_rate),
        observation_names=tuple(task.observation_names()),
        history=1,
        chains={name: list(chains[name]) for name in names},
        chain_hash=chain_hash({name: load_chain(list(chains[name])) for name in names}),
    )


def _contents(stage: dict[str, Any]) -> dict[str, Any]:
    if "net" not in stage:
        return stage
    file = Path(str(stage["net"]["file"]))
    return {"net": {**stage["net"], "file": hashlib.sha256(file.read_bytes()).hexdigest()}}


def _hash(document: Any) -> str:
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()[:16]
