"""A robot in the simulator, run like one on servos: the same bus, readings, commands, limits and records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .commands import Commands
from .robot import Reading, ServoRobot
from .safety import Limits, Safety
from .virtual.in_process import bus_in_process

SETTLING = 1.0  # [s] that the robot holds the start before the run, as on servos


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
        link: position behind springs (n, k); empty: not measured.
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
    link: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))

    @property
    def period(self) -> float:
        """Of the cycles [s]."""
        return float((self.time[-1] - self.time[0]) / max(len(self.time) - 1, 1))

    def cut(self, cycles: int | np.ndarray) -> Recording:
        """The first so many cycles, or those of a mask (n,)."""
        kept = slice(cycles) if isinstance(cycles, int) else cycles
        values: dict[str, Any] = {
            name: value[kept] if len(value) else value for name, value in vars(self).items() if name != "rewards"
        }
        return Recording(**values, rewards={name: value[kept] for name, value in self.rewards.items()})


def simulate(
    robot: ServoRobot, commands: Commands, limits: Limits, rate: float, duration: float, hidden: str | None = None
) -> Recording:
    """Run ``commands`` on virtual servos in this process, in simulated time.

    Args:
        robot: its numbers, chains and ranges.
        commands: source of goals.
        limits: of safety; goals are cut as on servos, nothing else can stop a simulation.
        rate: cycles per second [Hz].
        duration: [s].
        hidden: file of what the machine really is; None: what ``robot`` is believed to be.
    """
    pose = getattr(commands, "pose", None)
    bus, rig = bus_in_process(robot, hidden=hidden, pose=pose)
    clock = bus.line.port
    safety = Safety(robot, limits, 1.0 / rate)
    reading = robot.reading(bus.read_state(robot.all_ids))
    start = commands.start()
    sent = np.clip(reading.position if start is None else start, robot.low, robot.high)
    bus.torque_on(robot.ids)
    bus.write_goals(robot.ids, robot.to_servo(sent))
    clock.sleep(SETTLING)
    rig.held = None
    begun = clock.now()
    rows: list[tuple[Any, ...]] = []
    for cycle in range(round(duration * rate)):
        clock.sleep(begun + cycle / rate - clock.now())
        reading = robot.reading(bus.read_state(robot.all_ids), reading)
        admitted = safety.admit(commands.goals(cycle / rate, reading), sent)
        if not isinstance(admitted, np.ndarray):
            break
        sent = admitted
        clock.sleep(reading.time + getattr(commands, "delay", 0.0) - clock.now())  # not at all where it has passed
        went = bus.write_goals(robot.ids, robot.to_servo(sent))
        rows.append((*_signals(reading), sent, went))
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    time, position, duty, current, voltage, base, link, goal, went = columns
    return Recording(
        time=time - time[0],
        goal=goal,
        position=position,
        velocity=velocity_of(time, position),
        duty=duty,
        current=current,
        voltage=voltage,
        base=base,
        rewards=rewards_of(commands, time),
        sent=went - time[0],
        link=link if robot.measures_links else np.empty((0, 0)),
    )


def _signals(reading: Reading) -> tuple[Any, ...]:
    r = reading
    return r.time, r.position, r.duty, r.current, r.voltage, r.base_position, r.link


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
