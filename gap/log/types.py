"""The measured log in memory: what one run of a machine recorded, in SI units, plus what its sidecar says.

Format: ``docs/log-format.md``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...common.errors import SealegsError
from .finding import Finding

Array = NDArray[np.float64]


class LogError(SealegsError):
    """A measured log that cannot be read or written; the message names file, column and row."""


SIGNAL_UNITS: dict[str, str] = {
    "goal": "rad",
    "goal_velocity": "rad/s",
    "torque_command": "N.m",
    "position": "rad",
    "velocity": "rad/s",
    "link_position": "rad",
    "duty": "1",
    "voltage": "V",
    "current": "A",
    "torque": "N.m",
    "temperature": "degC",
    "enabled": "1",
}
"""Every signal a joint may log, with its unit on a hinge; on a slide rad is m and N.m is N."""

TOLD = ("goal", "torque_command")
"""What a joint of any machine may be told."""

OF_CHAINS = (*TOLD, "goal_velocity")
"""What a chain may be told (``Chain.command``): a speed alone is the command of a wheel."""

COMMANDS = (*TOLD, "torque", "goal_velocity")
"""What says how a joint is driven: a joint logs one of these at least. A measured torque does on a bench only, where
what it works against is known."""

BESIDE_GOAL = ("goal_velocity", "torque_command")
"""What an impedance drive takes beside its goal."""

OTHER = ("base", "host")
"""Groups of columns that belong to no joint: of the floating base, and of the computer that ran the loop."""

REQUIRED_EVERYWHERE = ("goal", "goal_velocity", "torque_command", "position", "enabled")
"""Signals that may not miss a value in any sample where their column exists."""


READING_SHARE = 0.98
"""Share of the samples in motion in which a goal that was never one is the reading itself."""
MIN_CHANGES = 40
"""Changes of a column from which a rule of them can be told."""

BEHIND: Mapping[str, str] = MappingProxyType(
    {
        "rad": "", "deg": "*pi/180", "mrad": "*1e-3", "turn": "*2*pi",
        "m": "", "mm": "*1e-3", "cm": "*1e-2",
        "rad/s": "", "deg/s": "*pi/180", "rpm": "*2*pi/60", "turn/s": "*2*pi", "mrad/s": "*1e-3",
        "m/s": "", "mm/s": "*1e-3",
    }
)  # fmt: skip
"""Expression behind a column of a unit that makes it rad, m, rad/s or m/s."""


def _factor(text: str) -> float:
    value = 1.0
    for sign, number in re.findall(r"([*/])([^*/]+)", text):
        size = math.pi if number == "pi" else float(number)
        value = value * size if sign == "*" else value / size
    return value


FACTOR: Mapping[str, float] = MappingProxyType({unit: _factor(text) for unit, text in BEHIND.items()})
"""The same as a number."""


TURN_IN_UNITS: Mapping[str, float] = MappingProxyType({"rad": 2.0 * math.pi, "deg": 360.0, "turn": 1.0})
"""A whole turn in each unit of an angle."""


def factors(*units: str) -> dict[str, float]:
    """The factors of some units."""
    return {unit: FACTOR[unit] for unit in units}


@dataclass(frozen=True, eq=False)
class JointLog:
    """The signals of one joint, each of shape (n,), float64, NaN where a sample lacks a value.

    Units are those of a hinge; on a slide rad is m and N.m is N.

    Attributes:
        goal: commanded position [rad]; None where the joint is driven by torques or speeds.
        position: measured position on the motor side of any spring [rad].
        velocity: measured velocity [rad/s].
        link_position: measured position on the link side of the spring [rad].
        duty: signed PWM duty, 1 = full.
        voltage: supply voltage [V].
        current: motor current [A].
        torque: torque at the output shaft [N.m], measured or estimated by the drive.
        temperature: motor temperature [degC].
        enabled: 1 while the drive is on, 0 while the motor is left without torque; None where it was on throughout.
        torque_command: commanded torque, held until the next sample [N.m]; of an open loop, or of a controller outside
            the drive that closes one. None where the drive takes a position goal alone.
        goal_velocity: commanded velocity [rad/s]: beside the goal, of an impedance drive; alone, of a wheel.
        goal_alone: the goal as it was commanded, where :attr:`goal` holds what was commanded beside it, too [rad]; None
            where the goal is all. No column.
        touched: 1 where something that the model lacks holds what the joint moves, as a table under an arm; no column,
            but found before a diagnosis. None where nothing does.
    """

    goal: Array | None
    position: Array
    velocity: Array | None = None
    link_position: Array | None = None
    duty: Array | None = None
    voltage: Array | None = None
    current: Array | None = None
    torque: Array | None = None
    temperature: Array | None = None
    enabled: Array | None = None
    torque_command: Array | None = None
    goal_velocity: Array | None = None
    touched: Array | None = None
    goal_alone: Array | None = None

    @property
    def always_touched(self) -> bool:
        """Whether something holds what the joint moves throughout, so that its link is moved as measured."""
        return self.touched is not None and bool(self.touched.all())

    def signals(self) -> dict[str, Array]:
        """Return the recorded signals by name, in the order of the format."""
        recorded = {name: getattr(self, name) for name in SIGNAL_UNITS}
        return {name: values for name, values in recorded.items() if values is not None}

    def each(self, change: Callable[[Array], Array]) -> JointLog:
        """The log with every recorded signal changed."""
        return replace(self, **{name: change(values) for name, values in self.signals().items()})


@dataclass(frozen=True, eq=False)
class MeasuredRun:
    """One recording of one machine.

    Attributes:
        name: file name without its ending.
        time: sample times, strictly increasing, shape (n,) [s].
        joints: one log per joint.
        base: ``base.*`` columns by the name after the dot, each of shape (n,).
        robot: robot name.
        robot_params: what differs from the robot's default (bench: ``mass`` [kg], ``arm_mass`` [kg], ``length`` [m]).
        actuators: chain name or inline chain per joint.
        source: file the run was read from, None for a run made in memory.
        meta: everything else the sidecar says (``group``, ``units``, ``sample_clock``, ...).
        host: ``host.*`` columns by the name after the dot, each of shape (n,).
        draws: by joint, what its drive draws from the supply at full voltage, and less of it for each volt that the
            supply sags by (n, 2) [A, A/V]; nothing until it is worked out (:mod:`sealegs.gap.prepare.pieces`).
        seen: by joint and path, numbers that a first look found; nothing until there was one.
    """

    name: str
    time: Array
    joints: dict[str, JointLog]
    base: dict[str, Array] = field(default_factory=dict)
    robot: str = "bench"
    robot_params: dict[str, float] = field(default_factory=dict)
    actuators: dict[str, str | list] = field(default_factory=dict)
    source: Path | None = None
    meta: dict[str, Any] = field(default_factory=dict)
    host: dict[str, Array] = field(default_factory=dict)
    draws: dict[str, Array] = field(default_factory=dict)
    seen: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @property
    def duration(self) -> float:
        """Time between first and last sample [s]."""
        return float(self.time[-1] - self.time[0])

    @property
    def period(self) -> float:
        """Median sample period [s]."""
        return float(np.median(np.diff(self.time)))

    def part(self, start: int, stop: int) -> MeasuredRun:
        """The run between two samples."""
        rows = slice(start, stop)
        base, host = ({name: values[rows] for name, values in table.items()} for table in (self.base, self.host))
        joints = {name: log.each(lambda values: values[rows]) for name, log in self.joints.items()}
        return replace(self, time=self.time[rows], joints=joints, base=base, host=host)

    def columns(self) -> dict[str, Array]:
        """Return all columns of the run by their name in the file."""
        table: dict[str, Array] = {"time": self.time}
        for joint, log in self.joints.items():
            table |= {f"{joint}.{signal}": values for signal, values in log.signals().items()}
        table |= {f"base.{name}": values for name, values in self.base.items()}
        return table | {f"host.{name}": values for name, values in self.host.items()}


@dataclass(frozen=True, eq=False)
class MeasuredSet:
    """Runs of one machine, recorded under one configuration.

    Attributes:
        runs: at least one run.
        name: folder or file name without its ending.
        findings: of the log as it is on disk, where the runs are only parts of it.
    """

    runs: tuple[MeasuredRun, ...]
    name: str
    findings: tuple[Finding, ...] = ()
