"""Where goals come from: a policy, a recorded or computed trajectory, or a robot's reference controller."""

from __future__ import annotations

import csv
import math
import shlex
import statistics
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ...common.errors import SealegsError, nearest
from ...configs.check import checked
from ...envs.bench.robot import BENCH
from ...envs.contract import goal_scale, start_pose
from ...envs.hopper.controller import BangBang, spring_stiffness
from ..machine.robot import Reading, ServoRobot
from .asked import Asked
from .observer import Observer, Seen
from .policy import Policy

if TYPE_CHECKING:
    from ...gap.log.sidecar import Sidecar

REHEARSED = 12  # calls of a policy before torque comes on, of which the median counts
REHEARSAL = 1.0  # [s] after which no further one begins
MAKING_UP = 0.5  # share of the time since the goals before that calls for goals of missed periods may take
GOAL = "goal"
"""Column of goals that may stand without a joint where the robot has one joint only."""


class Commands(Protocol):
    """A source of goals.

    Attributes:
        name: one word, for names of logs.
        rate: cycles per second that it is made for [Hz]; None: any.
        duration: after which it has nothing more to say [s]; infinite where it always has.
        description: what a log says about it.
    """

    @property
    def name(self) -> str: ...
    @property
    def rate(self) -> float | None: ...
    @property
    def duration(self) -> float: ...
    @property
    def description(self) -> dict: ...

    def start(self) -> np.ndarray | None:
        """Where the robot should be when it begins (k,) [rad]; None: wherever it is."""
        ...

    def goals(self, time: float, reading: Reading) -> np.ndarray:
        """Goals (k,) [rad] at ``time`` [s] since the start."""
        ...


class PolicyCommands:
    """Goals of a policy.

    It is asked for the goal of the moment. Of periods that were left out, a policy without a generator's memory is
    asked for nothing: its clock goes on to the moment. A generator makes their steps up for as long as that takes at
    most half of the time that they lasted; the rest it stands still, as the servos did. So the time that the policy
    takes never adds up.

    Attributes:
        observer: that makes its observations.
        history: every control step so far as the policy saw it.
        delay: from a reading to the goals that follow from it, fixed [s]; 0: as soon as they are known.
    """

    def __init__(
        self,
        policy: Policy,
        robot: ServoRobot,
        command: np.ndarray | None = None,
        segment: float = math.inf,
        asked: Asked | None = None,
    ) -> None:
        """Prepare, and try the policy once.

        Args:
            policy: for this robot.
            robot: that it runs on.
            command: what the task is asked for (c,), or one after the other (m, c); None: the middle of what it draws.
            segment: time that each of several commands holds [s].
            asked: what it is asked for over time, in the place of ``command``.

        Raises:
            SealegsError: the command is none of the task, or the policy fails, or gives what is not finite.
        """
        self._schedule = None if command is None else np.atleast_2d(command)
        self._segment, self._robot, self.asked = segment, robot, asked
        self.observer = Observer(policy.contract, robot, None if self._schedule is None else self._schedule[0])
        self._policy = policy
        self.name, self.rate, self.duration = "policy", policy.contract.goal_rate, math.inf
        self.delay = policy.contract.delay
        self._start: Sequence[float] = policy.contract.start
        if asked is not None:
            self.observer.command = self.observer.task.command_at(0.0, asked)
            self._begin_at(self.observer.task.asked_start(self.observer.command))
        told = self.observer.command.tolist() if asked is None else asked.description
        self.description = {"policy": str(policy.path), "command": told}
        self.history: list[Seen] = []
        contract = policy.contract
        # what the policy itself remembers moves on with its actions, of which none is made up for
        generator = len(contract.state) - contract.policy_memory - 1 - 2 * len(contract.actions)
        self._goal, self._remembers = self.start(), generator > 0
        self._last, self._asked_at, self._took, self._now = -1, 0.0, 0.0, monotonic
        self._observation = np.zeros(len(policy.contract.observation_names), np.float32)
        policy.act(self._observation[None], self.observer.command[None], self.observer.state[None])

    @cached_property
    def pose(self) -> dict[str, float]:
        """The whole robot at the start, by joint [rad or m]: how a person holds it up."""
        pose = start_pose(self._policy.contract, self._robot.robot)
        if self._start is self._policy.contract.start:
            return pose
        own = dict(zip(self._robot.names, self._start, strict=True))
        return {name: float(own.get(name, value)) for name, value in pose.items()}

    def start(self) -> np.ndarray:
        return np.asarray(self._start)

    def _begin_at(self, goals: np.ndarray | None) -> None:
        """Begin with these goals (k,) in the place of the contract's, with the action that gives them."""
        if goals is None:
            return
        observer = self.observer
        zero, per_action = goal_scale(observer.task, observer.numbers, np.zeros(1), observer.command[None])
        low, high = (np.asarray(end) for end in (self._policy.contract.goal_low, self._policy.contract.goal_high))
        start = np.clip(goals, low, high)
        for _ in range(2):  # the latest action, and the one before
            observer.acted(((start - zero) / per_action).reshape(-1))
        self._start = start.tolist()

    def rehearse(self, reading: Reading, period: float, now: Callable[[], float]) -> float:
        """Ask for some goals that nobody sends; the run begins as if it had not been.

        Args:
            reading: of the robot as it is.
            period: of the loop [s].
            now: its clock [s].

        Returns:
            Time that the goals of a cycle take, observation and all [s].

        Raises:
            PolicyError: as :meth:`Policy.act`.
        """
        self._now = now
        asked = None if self.asked is None else self.asked.still()
        rehearsal = PolicyCommands(self._policy, self._robot, self._schedule, self._segment, asked)
        times = list[float]()
        rehearsal._now = now
        first = now()
        for cycle in range(1 + REHEARSED):
            begun = now()
            rehearsal.goals(cycle * period, reading)
            times.append(now() - begun)
            if now() - first > REHEARSAL:
                break
        return statistics.median(times[1:] or times)  # the first one finds nothing in the caches

    def slower(self, rate: float) -> str:
        """What to do where no more than ``rate`` cycles a second are possible [Hz]."""
        contract = self._policy.contract
        if kept := next((item for item in contract.rates if item <= rate), None):
            held = f"{contract.goal_rate / kept:.0f} periods of its own"
            return f"give rate={kept:g}, at which each goal is held for {held}, as it was not trained"
        slow = (contract.control_rate / parts for parts in range(2, 1000))
        found = next(
            (item for item in slow if item <= rate and math.isclose(float(f"{item:g}"), item, rel_tol=1e-9)), None
        )
        if found is None:
            return "train a policy that acts less often"
        also = f" and give rate={found:g}" if contract.goals_per_action > 1 else ""
        return f"train it again with env.control_rate={found:g}{also}, since a policy keeps the rate that it learnt at"

    def goals(self, time: float, reading: Reading) -> np.ndarray:
        if self._schedule is not None:
            row = int((time + 1e-6) / self._segment) if math.isfinite(self._segment) else 0
            self.observer.command = self._schedule[min(row, len(self._schedule) - 1)]
        observer, contract = self.observer, self._policy.contract
        if self.asked is not None:
            observer.command = observer.task.command_at(
                round(time * contract.goal_rate) / contract.goal_rate, self.asked
            )
        due = round(time * contract.goal_rate)  # goals belong to the policy's own grid of periods, from 0
        acts = due - due % contract.goals_per_action  # the latest that an action belongs to
        observer.glance(reading)
        if acts > self._last:
            seen = observer.see(reading)
            self.history.append(seen)
            self._observation = seen.observation
        needed = acts if acts > self._last else due
        until = self._now() + MAKING_UP * (time - self._asked_at)
        for goal in range(self._last + 1 if self._remembers else max(needed, self._last + 1), due + 1):
            begun = self._now()  # how long a call takes is known when it has ended: the next one may take longer
            if goal != needed and (not self._remembers or begun + self._took > until):
                continue
            observer.state[0] = goal
            _, goals, state = self._policy.act(self._observation[None], observer.command[None], observer.state[None])
            self._goal, observer.state = goals[0], state[0]
            self._last, self._took, self._asked_at = goal, self._now() - begun, time
        return self._goal


class Trajectory:
    """Goals over time, each held until the next: an excitation, or the goals of a log."""

    def __init__(self, name: str, time: np.ndarray, goals: np.ndarray, description: dict | None = None) -> None:
        """Prepare.

        Args:
            name: one word.
            time: (n,) [s], from 0.
            goals: (n, k) [rad], joints in the order of the robot.
            description: what a log says about it.
        """
        self.name, self.rate = name, None
        self._time, self._goals = time, goals
        self.duration = float(time[-1] + (time[-1] - time[0]) / max(len(time) - 1, 1))
        self.description = description or {}

    def start(self) -> np.ndarray:
        return self._goals[0]

    def goals(self, time: float, reading: Reading) -> np.ndarray:
        del reading
        row = int(np.searchsorted(self._time, time + 1e-6, side="right")) - 1
        return self._goals[min(max(row, 0), len(self._goals) - 1)]


class Reference:
    """The reference controller of the hopper's paper; its springs are felt through motor and link encoders."""

    def __init__(self, robot: ServoRobot) -> None:
        """Prepare.

        Raises:
            SealegsError: the robot has no reference controller, no spring to feel, or nothing that measures springs.
        """
        if robot.robot.source != "hopper":  # a file may have that name too
            raise SealegsError(
                f"robot '{robot.robot.source}' has no reference controller; robot=hopper has one. A gait of any robot "
                "on legs is reference=walk, a trajectory reference=track."
            )
        if not robot.measures_links.all():  # motor and link would read the same, and the goals never change
            missing = [f"{name}.link" for name, has in zip(robot.names, robot.measures_links, strict=True) if not has]
            raise SealegsError(
                f"the reference controller feels springs by encoders behind them, but robot.sensors lacks "
                f"{', '.join(missing)}; mount them and name them there, such as {missing[0]}: {{id: 9}}."
            )
        numbers = robot.robot.parameters(robot.params)
        stiffness = spring_stiffness(robot.chains[robot.names[0]])
        self._law = BangBang(rest=(numbers["hip_rest"], numbers["knee_rest"]), stiffness=stiffness)
        self.name, self.rate, self.duration = "reference", None, math.inf
        self.description = {"controller": "sealegs.envs.hopper.controller.BangBang"}

    def start(self) -> np.ndarray:
        return np.asarray(self._law.rest)

    def goals(self, time: float, reading: Reading) -> np.ndarray:
        del time
        return self._law.goals(reading.position, reading.link)


def read_excitation(path: Path, robot: ServoRobot, others: np.ndarray | None = None) -> Trajectory:
    """Goals of a CSV file with the columns ``time`` [s] and ``<joint>.goal`` [rad], such as a diagnosis proposes.

    A joint without a column is brought to its goal in ``others`` (k,) and held there; None: the middle of its range.
    On a robot of one joint the column may be called ``goal``; the servo of a bench has any name where a sidecar says
    that the goals are of the bench. Goals whose sidecar has ``frames`` are of another machine's zeros and directions,
    and are turned into the model's.

    Raises:
        SealegsError: the file cannot be read, its sidecar names another robot or load, it names other joints, or its
            goals are beyond a joint's range.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.reader(file))
        header, values = rows[0], np.array([[float(cell) for cell in row] for row in rows[1:] if row], float)
    except OSError as error:
        raise SealegsError(f"the excitation {path} cannot be read: {error.strerror}.") from None
    except (ValueError, IndexError, UnicodeDecodeError, csv.Error) as error:
        raise SealegsError(f"the excitation {path} is no table of numbers with a header: {error}.") from None
    names = [name.strip() for name in header]
    if twice := next((name for name in names if name and names.count(name) > 1), None):
        raise SealegsError(f"the excitation {path} has two columns '{twice}'; keep one.")
    if values.ndim == 2 and values.shape[1] != len(names):
        raise SealegsError(
            f"the excitation {path} has {len(names)} columns in its header and {values.shape[1]} in its rows; give "
            "each column a name, and end no line with a comma."
        )
    columns = {name: values[:, k] for k, name in enumerate(names)} if values.ndim == 2 else {}
    goals = {name.removesuffix(".goal"): column for name, column in columns.items() if name.endswith(".goal")}
    if GOAL in columns and not goals and len(robot.joints) == 1:
        goals = {robot.names[0]: columns[GOAL]}
    if "time" not in columns or not goals:
        raise SealegsError(
            f"the excitation {path} needs the columns time and <joint>.goal; it has {', '.join(header)}."
        )
    said = _check_beside(path, robot)
    goals = _in_model_frame(goals, None if said is None else said.meta.get("frames"), path)
    return _trajectory("excitation", path, columns["time"], goals, robot, said is not None, others)


def robot_beside(path: Path) -> str | None:
    """The robot that the sidecar of an excitation names: a word, or the path of a file; None without a sidecar.

    Raises:
        SealegsError: the sidecar cannot be read.
    """
    from ...gap.log.sidecar import read_sidecar

    return read_sidecar(path).robot if _beside(path) is not None else None


def park_motion(park: Any, robot: ServoRobot) -> Trajectory:
    """The motion along which a robot sits down, from ``park`` of its file; NaN for joints that it leaves out.

    Args:
        park: a pose, joint by joint [rad], or a CSV file as :func:`read_excitation` reads it.
        robot: that sits down.

    Raises:
        SealegsError: there is none, or it does not fit the robot.
    """
    stay = np.full(len(robot.joints), np.nan)
    if isinstance(park, str):
        return read_excitation(Path(park), robot, stay)
    if not isinstance(park, Mapping) or not park:
        raise SealegsError(
            "rest=sit needs robot.park: a pose such as robot.park={hip: -0.6, knee: 1.1} [rad], or the CSV file of a "
            "motion."
        )
    time = np.array([0.0, 0.5])
    goals = {str(name): np.full(2, checked(f"robot.park.{name}", value, float)) for name, value in park.items()}
    return _trajectory("park", Path("robot.park"), time, goals, robot, others=stay)


def _in_model_frame(goals: Mapping[str, np.ndarray], said: Any, path: Path) -> dict[str, np.ndarray]:
    """Goals by joint (n,), in the model's zeros and directions; unturned they would send a machine anywhere."""
    from ...gap.load.robot import Frame, frames_said

    frames = frames_said(said or {}, str(path))
    return {name: frames.get(name, Frame()).to_model(values) for name, values in goals.items()}


def _beside(path: Path) -> Path | None:
    """The sidecar of an excitation."""
    return next((file for ending in (".yaml", ".yml") if (file := path.with_suffix(ending)).is_file()), None)


def _check_beside(path: Path, robot: ServoRobot) -> Sidecar | None:
    """The sidecar of an excitation: its goals are one robot's, and with another load they tell nothing.

    Raises:
        SealegsError: it names another robot, or the robot is said to carry another load.
    """
    if (beside := _beside(path)) is None:
        return None
    from ...gap.log.sidecar import read_sidecar

    said = read_sidecar(path)
    if not robot.robot.is_called(said.robot):
        raise SealegsError(
            f"{beside} says that the goals are of robot '{said.robot}', not of '{robot.robot.name}': give "
            f"{shlex.quote(f'robot={said.robot}')}, or correct robot: in that file."
        )
    meant, believed = said.robot_params, robot.robot.parameters(robot.params)
    other = {
        name: value
        for name, value in meant.items()
        if not math.isclose(value, believed.get(name, value))
        and (value != 0.0 or name in robot.params)  # zero is also what a log says of an arm that nobody weighed
    }
    if other:
        load = ", ".join(f"{name} {value:g}" for name, value in other.items())
        words = " ".join(f"robot.params.{name}={value:g}" for name, value in other.items())
        raise SealegsError(f"{beside} asks for another load ({load}): mount it and say so, with {words}.")
    return said


def read_replay(path: Path, robot: ServoRobot) -> Trajectory:
    """Goals of a measured log, in the units of its robot's model.

    Raises:
        SealegsError: as :func:`read_excitation`, or the log is of another robot.
    """
    from ...gap.load.robot import robot_of
    from ...gap.load.units import run_in_model_units
    from ...gap.log import read_measured

    run = read_measured(path).runs[0]
    if not robot.robot.is_called(run.robot):
        raise SealegsError(f"{path} is a log of robot '{run.robot}', not of '{robot.robot.name}'.")
    run = run_in_model_units(run, robot_of(run))
    goals = {name: log.goal for name, log in run.joints.items() if log.goal is not None}
    goals = _in_model_frame(goals, run.meta.get("frames"), path)
    return _trajectory("replay", path, run.time, goals, robot, of_robot=True)


def _trajectory(
    kind: str,
    path: Path,
    time: np.ndarray,
    goals: Mapping[str, np.ndarray],
    robot: ServoRobot,
    of_robot: bool = False,
    others: np.ndarray | None = None,
) -> Trajectory:
    """Goals by joint (n,) as a trajectory.

    Args:
        kind: of the trajectory, a word of its name.
        path: that they are from.
        time: (n,) [s].
        goals: by joint.
        robot: that moves.
        of_robot: a sidecar says that they are of this robot.
        others: goals of joints that have none (k,); None: the middle of their ranges.
    """
    if len(time) < 2 or not (np.diff(time) > 0.0).all() or not np.isfinite(time).all():
        raise SealegsError(f"{path}: the column 'time' must grow from row to row, over two rows at least.")
    if of_robot and len(goals) == 1 and robot.robot.source == BENCH.name:
        goals = {robot.names[0]: next(iter(goals.values()))}  # logs of a bench call its servo as they like
    for name in goals:
        if name not in robot.names:
            known = robot.names
            raise SealegsError(
                f"{path}: the robot has no joint '{name}'{nearest(name, known)}; it has {', '.join(known)}: give goals "
                "of these, or the robot= that has it."
            )
    table = np.tile(0.5 * (robot.low + robot.high) if others is None else others, (len(time), 1))
    for k, joint in enumerate(robot.joints):
        if joint.name not in goals:
            continue
        table[:, k], unit = goals[joint.name], robot.units[k]
        bad = np.flatnonzero(~((table[:, k] >= joint.low) & (table[:, k] <= joint.high)))
        if len(bad):
            raise SealegsError(
                f"{path}: row {bad[0] + 2} asks joint {joint.name} for {table[bad[0], k]:.3f} {unit}, but its range is "
                f"{joint.low:.3f} to {joint.high:.3f} {unit}."
            )
    return Trajectory(f"{kind}-{path.stem}", time - time[0], table, {kind: path.name})
