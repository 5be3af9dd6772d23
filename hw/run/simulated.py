"""A robot in the simulator, run like one on servos: the same bus, readings, commands, limits and records."""

from __future__ import annotations

import contextlib
import math
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from ...common.errors import SealegsError
from ...envs.engine.imu import COLUMNS, PREFIX
from ...gap.checks.imu import imu_of
from ...gap.log import read_measured
from ..guard.safety import Limits, Safety
from ..machine.robot import Reading, ServoRobot
from ..virtual.imu import FetchedImu
from ..virtual.in_process import bus_in_process
from .commands import Commands
from .loop import ControlLoop
from .measured_log import MeasuredLog, make_sidecar, read_events


@dataclass(frozen=True)
class Turned:
    """How a base turned, as its IMU says: m samples at their own times.

    Attributes:
        time: when each was taken (m,), on the clock of a recording [s].
        orientation: quaternion (m, 4).
        turn_rate: about the base's axes (m, 3) [rad/s].
        switches: 1 where a contact switch is closed, else 0 (m, s); NaN: it said nothing.
    """

    time: np.ndarray
    orientation: np.ndarray
    turn_rate: np.ndarray
    switches: np.ndarray

    @cached_property
    def _unwrapped(self) -> np.ndarray:
        """Orientation (m, 4) without a change of sign from sample to sample: a quaternion's negative is its turn."""
        flips = (self.orientation[1:] * self.orientation[:-1]).sum(axis=1) < 0.0
        return self.orientation * np.concatenate([[1.0], np.cumprod(np.where(flips, -1.0, 1.0))])[:, None]

    def at(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Orientation (n, 4) and turn rate (n, 3) at times (n,) [s], straight between samples."""
        turn, turn_rate = (
            np.stack([np.interp(time, self.time, column) for column in values.T], axis=1)
            for values in (self._unwrapped, self.turn_rate)
        )
        return turn / np.linalg.norm(turn, axis=1, keepdims=True), turn_rate


@dataclass(frozen=True)
class Recording:
    """One run at the control rate: n cycles of k joints.

    Attributes:
        time: of the readings (n,) [s].
        goal, position, velocity: (n, k) [rad or m], per second.
        duty, current, voltage: (n, k) [-], [A], [V].
        base: of the robot's base, as far as it is measured (n, b).
        rewards: terms of the reward by name (n,), 0 in cycles without a control step; of a policy only.
        sent: when each cycle's goals went out (n,) [s]; empty: with the reading.
        asked: when the readings were asked for (n,) [s], of which ``time`` is the middle; empty: at ``time``.
        link: position behind springs (n, k), of a joint without an encoder there ``position``; empty: none has one.
        behind: of which joints ``link`` was measured (k,); empty: of none.
        turned: how the base turned; None: no IMU said it.
    """

    time: np.ndarray
    goal: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    duty: np.ndarray
    current: np.ndarray
    voltage: np.ndarray
    base: np.ndarray
    rewards: Mapping[str, np.ndarray]
    sent: np.ndarray = field(default_factory=lambda: np.empty(0))
    asked: np.ndarray = field(default_factory=lambda: np.empty(0))
    link: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    behind: np.ndarray = field(default_factory=lambda: np.empty(0, bool))
    turned: Turned | None = None

    @property
    def period(self) -> float:
        """Of the cycles [s]."""
        return float((self.time[-1] - self.time[0]) / max(len(self.time) - 1, 1))

    def cut(self, cycles: int | np.ndarray) -> Recording:
        """The first so many cycles, or those of a mask (n,)."""
        kept = slice(cycles) if isinstance(cycles, int) else cycles
        values: dict[str, Any] = {
            name: value[kept] if len(value) else value
            for name, value in vars(self).items()
            if name not in ("rewards", "turned", "behind")
        }
        rewards = {name: value[kept] for name, value in self.rewards.items()}
        return Recording(**values, rewards=rewards, turned=self.turned, behind=self.behind)


class _Unstopped(Safety):
    """Keeps goals within their limits; nothing that is measured stops a simulation."""

    def judge(self, reading: Reading) -> None:
        del reading

    def follows(self, goal: np.ndarray, reading: Reading) -> None:
        del goal, reading


def simulate(
    robot: ServoRobot, commands: Commands, limits: Limits, rate: float, duration: float, hidden: str | None = None
) -> Recording:
    """Run ``commands`` on virtual servos in this process, in simulated time.

    The loop is that of servos, and its log is read as theirs is: what readings, their times and the rounding of a log
    do is in both.

    Args:
        robot: its numbers, chains and ranges.
        commands: source of goals.
        limits: of safety; goals are cut as on servos, nothing else can stop a simulation.
        rate: cycles per second [Hz].
        duration: [s].
        hidden: file of what the machine really is; None: what ``robot`` is believed to be.

    Raises:
        SealegsError: it comes to nothing, such as a robot that does not reach its start.
    """
    bus, rig = bus_in_process(robot, hidden=hidden, pose=getattr(commands, "pose", None))
    sidecar = make_sidecar(robot.robot.name, robot.params, robot.belief, {})
    with tempfile.TemporaryDirectory() as folder:
        log = MeasuredLog(Path(folder), "simulated", sidecar, robot.names, robot.log_base, robot.measures_links)
        with contextlib.closing(log):
            safety, begins = _Unstopped(robot, limits, 1.0 / rate), partial(setattr, rig, "held", None)
            imu = None if rig.machine.imu is None else FetchedImu(rig.machine.imu, bus.clock.now)
            loop = ControlLoop(
                bus, robot, safety, commands, rate, log=log, begins=begins, alarm=lambda _: None, imu=imu
            )
            outcome = loop.run(duration)
        if log.rows == 0:
            why = outcome.fault.sentence if outcome.fault is not None else "it ended before its first cycle."
            raise SealegsError(f"the simulation of robot '{robot.robot.name}' comes to nothing: {why}")
        return recorded(log.path, commands, robot)


def recorded(path: Path, commands: Commands, robot: ServoRobot) -> Recording:
    """A run of ``robot`` out of its log; speeds as the models have them, differences over a cycle."""
    run = read_measured(path).runs[0]
    joints = list(run.joints.values())

    def column(name: str) -> np.ndarray:
        return np.stack([getattr(joint, name) for joint in joints], axis=1)

    history = getattr(commands, "history", [])
    begun = history[0].time - run.time[0] if history else 0.0
    places = [values for name, values in run.base.items() if name not in COLUMNS and not name.startswith(PREFIX)]
    base = np.stack(places, axis=1) if places else np.zeros((len(run.time), 0))
    columns = {name: column(name) for name in ("goal", "position", "duty", "current", "voltage")}
    columns["velocity"] = velocity_of(run.time, columns["position"])
    links = [joint.position if joint.link_position is None else joint.link_position for joint in joints]
    behind = np.array([joint.link_position is not None for joint in joints])
    link = np.stack(links, axis=1) if behind.any() else np.empty((0, 0))
    sent, asked = (
        run.host[name] - run.time[0] if name in run.host else np.empty(0) for name in ("goal_sent", "read_sent")
    )
    # a model is put into states that are measured as a whole
    known = np.isfinite(np.concatenate([base, link.reshape(len(base), -1)], axis=1).sum(axis=1))
    times = {"time": run.time - run.time[0], "sent": sent, "asked": asked}
    turned, log = None, imu_of(run)
    if log is not None and robot.imu is not None:
        silent = np.full(len(log.time), np.nan)
        switches = [log.switches.get(switch.name, silent) for switch in robot.imu.switches]
        taken = log.time - robot.imu.delay - run.time[0]
        turned = Turned(taken, log.orientation, log.turn_rate, np.array([*switches]).reshape(-1, len(taken)).T)
    found = Recording(**times, **columns, base=base, rewards={}, link=link, behind=behind, turned=turned).cut(known)
    found = replace(found, rewards=rewards_of(commands, run.time[known] + begun))
    sat = next((event["time"] for event in read_events(path) if event["event"] == "sitting down"), math.inf)
    return found.cut(int((run.time[known] < sat).sum()))


def velocity_of(time: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Differences over a cycle (n, k), as the models have them."""
    period = (time[-1] - time[0]) / max(len(time) - 1, 1) or 1.0
    return np.diff(position, axis=0, prepend=position[:1]) / period


def rewards_of(commands: Commands, time: np.ndarray) -> dict[str, np.ndarray]:
    """Terms of the reward by name (n,) that a policy's control steps earned; the first ends no step and earns nothing.

    Args:
        commands: of the run.
        time: of its cycles (n,), on the clock of its readings [s].
    """
    history = getattr(commands, "history", [])
    if not history:
        return {}
    at = [int(np.argmin(np.abs(time - seen.time))) for seen in history[1:]]
    found = {name: np.zeros(len(time)) for name in history[0].rewards}
    for row, seen in zip(at, history[1:], strict=True):
        for name, value in seen.rewards.items():
            found[name][row] += value
    return found
