"""A robot in the simulator, run like one on servos: the same readings, commands, limits and records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .commands import Commands
from .robot import Reading, ServoRobot
from .safety import Limits, Safety
from .virtual.machine import Machine

SETTLING = 1.0  # [s] that the robot holds the start before the run, as on servos


@dataclass(frozen=True)
class Recording:
    """One run at the control rate: n cycles of k joints.

    Attributes:
        time: (n,) [s].
        goal, position, velocity: (n, k) [rad], [rad/s].
        duty, current, voltage: (n, k) [-], [A], [V].
        base: of the robot's base, as far as it is measured (n, b).
        rewards: terms of the reward by name (n,); of a policy only.
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

    @property
    def period(self) -> float:
        """Of the cycles [s]."""
        return float((self.time[-1] - self.time[0]) / max(len(self.time) - 1, 1))

    def cut(self, count: int) -> Recording:
        """The first ``count`` cycles."""
        values: dict[str, Any] = {name: value[:count] for name, value in vars(self).items() if name != "rewards"}
        return Recording(**values, rewards={name: value[:count] for name, value in self.rewards.items()})


def simulate(
    robot: ServoRobot,
    chains: Mapping[str, Any],
    commands: Commands,
    limits: Limits,
    rate: float,
    duration: float,
    goals: np.ndarray | None = None,
) -> Recording:
    """Run ``commands`` in the simulator.

    Args:
        robot: its numbers and ranges.
        chains: on its joints.
        commands: source of goals.
        limits: of safety; goals are cut as on servos, nothing else can stop a simulation.
        rate: cycles per second [Hz].
        duration: [s].
        goals: to command instead of what ``commands`` says (n, k) [rad]; where it starts is still theirs.
    """
    machine = Machine(robot.robot, dict(chains), None, robot.params, {s.name: s.per_radian for s in robot.sensors})
    count = round(duration * rate)
    safety = Safety(robot, limits, 1.0 / rate)
    start = commands.start()
    sent = np.clip(_read(machine, robot, None, 1.0).position if start is None else start, robot.low, robot.high)
    for joint, goal in enumerate(sent):
        machine.set_goal(joint, float(goal))
    machine.advance(SETTLING)
    rows: list[tuple[np.ndarray, ...]] = []
    reading: Reading | None = None
    for cycle in range(count):
        machine.advance(SETTLING + cycle / rate)
        reading = _read(machine, robot, reading, 1.0 / rate)
        wanted = commands.goals(cycle / rate, reading) if goals is None else goals[min(cycle, len(goals) - 1)]
        admitted = safety.admit(wanted, sent)
        if not isinstance(admitted, np.ndarray):
            break
        sent = admitted
        for joint, goal in enumerate(sent):
            machine.set_goal(joint, float(goal))
        rows.append(
            (sent, reading.position, reading.velocity, reading.duty, reading.current, reading.voltage,
             reading.base_position)
        )  # fmt: skip
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    return Recording(np.arange(len(rows)) / rate, *columns, rewards=rewards_of(commands))  # type: ignore[arg-type]


def rewards_of(commands: Commands) -> dict[str, np.ndarray]:
    """Terms of the reward by name (n,) that a policy's cycles earned; the first ends no step and earns nothing."""
    history = getattr(commands, "history", [])
    if not history:
        return {}
    return {name: np.array([0.0, *(seen.rewards[name] for seen in history[1:])]) for name in history[0].rewards}


def _read(machine: Machine, robot: ServoRobot, last: Reading | None, period: float) -> Reading:
    """What servos would read; velocity as the difference over a cycle."""
    joints = range(len(robot.joints))
    position = np.array([machine.reading(k) for k in joints])
    velocity = np.zeros(len(position)) if last is None else (position - last.position) / period
    sensors = {s.name: s.per_radian * machine.reading(k) for k, s in enumerate(robot.sensors, len(position))}
    link = np.array([sensors.get(f"{name}.link", position[k]) for k, name in enumerate(robot.names)])
    base = np.array([sensors[name] for name in robot.base_names])
    speed = np.zeros(len(base)) if last is None else (base - last.base_position) / period
    return Reading(
        before=machine.time,
        after=machine.time,
        position=position,
        velocity=velocity,
        duty=np.array([machine.duty(k) for k in joints]),
        current=np.array([machine.current(k) for k in joints]),
        voltage=np.array([machine.voltage(k) for k in joints]),
        temperature=np.full(len(position), np.nan),
        link=link,
        base_position=base,
        base_velocity=speed,
        state=None,
    )
