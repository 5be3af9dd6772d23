"""What a robot is: a MuJoCo specification built from numbers, and the coordinates that actuators drive."""

from __future__ import annotations

import fnmatch
import functools
import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import mujoco

from ...actuators import Chain, DrivenCoordinate, Drivetrain, load_chain, load_chain_set
from ...common.errors import nearest
from .imu import Imu, add_switches
from .model_poses import Pose
from .numbers import Effect, Number, RobotError

if TYPE_CHECKING:
    from ..described.robot_described import RobotFile
from collections.abc import Sequence
from typing import Any

LOGGER = logging.getLogger("sealegs")
ChainSource = str | Path | list | Chain
"""What :func:`actuators.load_chain` reads: a name, a path, a list of stages, or a chain."""


def _as_compiled(drivetrain: Drivetrain, values: Mapping[str, float]) -> None:
    del drivetrain, values


@dataclass(frozen=True)
class Robot:
    """A robot without its actuators.

    Attributes:
        name: as in ``get_robot`` and in the sidecar of a measured log.
        numbers: every number of the model by name; ``build_spec`` takes other values for any of them.
        coordinates: what actuators drive, in the order of goals.
        goal_limits: lowest and highest goal of each coordinate [rad], from a value for every number.
        chains: chain that drives each coordinate unless another is asked for.
        build: makes the specification from a value for every number.
        words: what a word such as ``ideal`` stands for on this robot, by coordinate, where the chain of that name in
            ``configs/actuator`` is made for robots of another size.
        effects: what paths of a diagnosis that are not of a chain, such as ``load.mass_factor``, do to numbers.
        finish: sets in the compiled robot what depends on robot and chains together.
        start: where episodes of tasks that any robot has start [rad or m]; where none is given, mid-range.
        pose: where episodes of such tasks start joints that nothing drives, a free base too, if that is not where the
            model has them.
        units: of coordinates that are no angles.
        file: that describes it; None for the robots that Python builds.
        imu: on its free base; None: it has none.
    """

    name: str
    numbers: Mapping[str, Number]
    coordinates: tuple[DrivenCoordinate, ...]
    goal_limits: Callable[[Mapping[str, float]], Mapping[str, tuple[float, float]]]
    chains: Mapping[str, ChainSource]
    build: Callable[[Mapping[str, float]], mujoco.MjSpec]
    words: Mapping[str, Mapping[str, ChainSource]] = field(default_factory=dict)
    effects: Mapping[str, Effect] = field(default_factory=dict)
    finish: Callable[[Drivetrain, Mapping[str, float]], None] = _as_compiled
    start: Mapping[str, float] = field(default_factory=dict)
    pose: Pose = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    file: RobotFile | None = None
    imu: Imu | None = None

    def unit(self, coordinate: str) -> str:
        """Of the position of a coordinate: rad, or m of a slide."""
        return self.units.get(coordinate, "rad")

    @property
    def source(self) -> str:
        """The word by which :func:`sealegs.envs.robots.get_robot` finds it: its name, or the path of its file."""
        return self.name if self.file is None else str(self.file.path)

    def is_called(self, word: str) -> bool:
        """Whether a log or a diagnosis means this robot by ``word``: its name, or the path of its file or model."""
        if self.file is None or "." not in word:
            return word == self.name
        names = {path.name for path in (self.file.path, self.file.model.path)}
        return Path(word).absolute() == self.file.path or Path(word).name in names

    @functools.cached_property
    def limits(self) -> Mapping[str, tuple[float, float]]:
        """Lowest and highest goal of each coordinate [rad] with the robot's own numbers."""
        return self.goal_limits(self.parameters())

    def parameters(self, params: Mapping[str, float] | None = None) -> dict[str, float]:
        """A value for every number of the robot: ``params`` where given, the default elsewhere.

        Raises:
            RobotError: a name that the robot does not have, or a value that is no number within its bounds.
        """
        values = {name: number.value for name, number in self.numbers.items()}
        for name, value in (params or {}).items():
            if name not in self.numbers:
                known = ", ".join(self.numbers)
                hint = nearest(name, self.numbers)
                raise RobotError(f"robot '{self.name}' has no parameter '{name}'{hint}; it has {known}.")
            number = self.numbers[name]
            if isinstance(value, bool) or not isinstance(value, int | float) or not number.takes(value):
                bounds = f"between {number.low:g} and {number.high:g} {number.unit}"
                raise RobotError(f"robot '{self.name}': {name} is {value!r}; it must be a number {bounds}.")
            values[name] = float(value)
        return values

    def build_spec(self, params: Mapping[str, float] | None = None) -> mujoco.MjSpec:
        """The robot's specification, without actuators.

        Raises:
            RobotError: as :meth:`parameters`.
        """
        return self.build(self.parameters(params))

    def chains_for(self, actuator: ChainSource | Mapping[str, ChainSource] | None) -> dict[str, ChainSource]:
        """A chain for every coordinate.

        Args:
            actuator: one chain for all, a word of the robot's own, chains by coordinate or a YAML file of them, the
                others keeping the robot's own; None: the robot's own for all.

        Raises:
            RobotError: a coordinate that the robot does not have.
        """
        names = [item.name for item in self.coordinates]
        if actuator is None:
            actuator = dict(self.chains)
        by_name = isinstance(actuator, str | Path)
        if isinstance(actuator, str | Path) and actuator not in self.words and (several := load_chain_set(actuator)):
            actuator = self._spread(several)
        if not isinstance(actuator, Mapping):
            actuator = dict.fromkeys(names, actuator)
        for name in actuator:
            if name not in names:
                hint = nearest(name, names)
                raise RobotError(f"robot '{self.name}' drives no '{name}'{hint}; it drives {', '.join(names)}.")
        given = {name: actuator.get(name, self.chains[name]) for name in names}
        if self.file is not None:  # stages are of a diagnosis or a log, whose numbers nobody doubts
            named = {name: item for name, item in given.items() if by_name or isinstance(item, str | Path)}
            for sentence in self.file.whose({name: load_chain(item) for name, item in named.items()}):
                _tell(sentence)
        return {name: self._meant(item, name) for name, item in given.items()}

    def _spread(self, chains: Mapping[str, Chain]) -> dict[str, ChainSource]:
        """Chains by coordinate from those by pattern; a pattern that fits none stays, to be told of."""
        found: dict[str, ChainSource] = {}
        for pattern, chain in chains.items():
            found |= dict.fromkeys(
                fnmatch.filter([item.name for item in self.coordinates], pattern) or [pattern], chain
            )
        return found

    def _meant(self, actuator: ChainSource, coordinate: str) -> ChainSource:
        """What stands for ``actuator`` on this robot: of its words, or with what its file adds to a chain."""
        if isinstance(actuator, str) and actuator in self.words:
            return self.words[actuator][coordinate]
        return actuator if self.file is None else self.file.joint(coordinate).carried(load_chain(actuator))

    def drivetrain(
        self,
        actuator: ChainSource | Mapping[str, ChainSource] | None = None,
        params: Mapping[str, float] | None = None,
    ) -> Drivetrain:
        """The robot with chains on its coordinates, compiled.

        Raises:
            SealegsError: a wrong parameter or chain.
        """
        values = self.parameters(params)
        spec = self.build(values)
        add_switches(spec, () if self.imu is None else self.imu.switches)
        drivetrain = Drivetrain(spec, self.chains_for(actuator), self.coordinates)
        self.finish(drivetrain, values)
        return drivetrain


@functools.cache
def _tell(sentence: str) -> None:
    """Say something once: a command asks for the chains of a robot several times."""
    LOGGER.warning("%s", sentence)


# --- tasks and servos give position goals, and speeds to wheels: a chain of another command is refused there ---------


def check_position_goals(robot: Robot, chains: Mapping[str, Chain], there: str, speeds: bool = True) -> None:
    """Make sure that every chain of a robot takes position goals [rad or m], or speeds where these go as well.

    A ``torque_command`` passes its command on as N.m or N, so that a goal of 0.5 rad would act as 0.5 N.m, and a torque
    would be sent to a servo as an angle. Robots with such chains can be read and diagnosed all the same.

    Args:
        robot: that the chains drive.
        chains: by coordinate.
        there: what goes between host and chain, such as ``a task gives``.
        speeds: whether a chain may be told a speed.

    Raises:
        RobotError: a chain takes torques, speeds that are not given, or other goals than the one in the robot's file.
    """
    turning = [name for name, chain in chains.items() if chain.command == "goal_velocity"]
    if turning and not speeds:
        raise RobotError(
            f"robot '{robot.name}': {', '.join(turning)} {'are' if len(turning) > 1 else 'is'} told speeds, and "
            f"{there} position goals; robots on wheels drive with env=drive, or a task of your own that takes_speeds."
        )
    driven = [name for name, chain in chains.items() if chain.command == "torque_command"]
    if not driven:
        _check_wheels(robot, chains)
        return
    force = "force [N]" if robot.unit(driven[0]) == "m" else "torque [N.m]"
    which = f"the chains of joints {', '.join(driven)} take"
    if len(driven) == 1:
        which = f"the chain of joint '{driven[0]}' takes"
    raise RobotError(
        f"robot '{robot.name}': {which} a {force} as command (torque_command), and {there} position goals; name a "
        "chain with a position controller, such as ideal or a servo of the library, in the robot's file or as "
        "actuator=: what torques drive can be diagnosed, but not trained or deployed here."
    )


def _check_wheels(robot: Robot, chains: Mapping[str, Chain]) -> None:
    """Refuse speeds where the ranges of the robot's file are of positions, and the other way round."""
    for joint in () if robot.file is None else robot.file.joints:
        told = chains[joint.name].command == "goal_velocity"
        if told != joint.by_speed:
            here, there = ("speeds", "positions") if told else ("positions", "speeds")
            raise RobotError(
                f"robot '{robot.name}': the chain of joint {joint.name} is told {here}, and the one in the robot's "
                f"file {there}: change it there."
            )


def torque_driven(chains: Mapping[str, Sequence[Mapping[str, Any]]]) -> list[str]:
    """Coordinates whose command is a torque, from the stages of their chains."""
    return [name for name, stages in chains.items() if any("torque_command" in stage for stage in stages)]
