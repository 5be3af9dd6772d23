"""Limits of a machine, as data: the ``safety`` block of a robot's file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ...common.errors import SealegsError, nearest
from ...configs.check import checked
from ...envs.described.name_patterns import fitting
from ...envs.described.robot_within import POSITIONS
from .robot import ServoRobot

REACH = 0.9  # [rad] of an excitation to either side of the middle of a hinge's range
SHARE = 0.8  # of half the range, where that is less or the joint slides

FROM_CHAIN = ("goal_speed", "following_error")
"""Limits that may be null: they follow from the servo's chain."""
BY_JOINT = ("range_margin", "speed", "goal_speed", "following_error")
"""Limits in the units of the joints: a number [rad], or numbers by pattern of names [rad or m]."""
LOGGABLE = ("following", "goal_speed")

ByJoint = float | Mapping[str, float]


@dataclass(frozen=True)
class Limits:
    """Limits of a machine; numbers in ``configs/robot``.

    Attributes:
        range_margin: how far beyond its calibrated range a joint may be found [rad or m].
        speed: largest measured speed of a joint [rad/s or m/s].
        goal_speed: largest speed of a goal [rad/s or m/s]; faster ones are cut, and end the run where they stay so
            fast for ``following_time``. None: four times the no-load speed of the servo's chain.
        following_error: by which a joint may stay behind its goal [rad or m], for longer than ``following_time``. None:
            that at which the servo's chain gives full duty.
        following_time: [s].
        current: largest current of a servo [A], for longer than ``current_time``.
        current_time: [s]; starting and braking take more for some milliseconds.
        temperature: highest temperature of a servo [degC].
        voltage_low: lowest supply voltage [V].
        voltage_high: highest supply voltage [V].
        late: time that a reading may take; the replies of a later one count as lost [s].
        silent: time without a reply of a servo that is tolerated [s], and two cycles at least.
        loss: share of the replies of a servo that may be lost, over :data:`sealegs.hw.guard.safety.WINDOW`.
        log_only: of ``following`` and ``goal_speed``, those that are noted in the log and neither cut nor stop.
    """

    range_margin: ByJoint
    speed: ByJoint
    goal_speed: ByJoint | None
    following_error: ByJoint | None
    following_time: float
    current: float
    current_time: float
    temperature: float
    voltage_low: float
    voltage_high: float
    late: float
    silent: float
    loss: float
    log_only: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("following_time", "current", "temperature", "late", "silent", "loss", *BY_JOINT):
            value = getattr(self, name)
            for found in value.values() if isinstance(value, Mapping) else [value]:
                if found is not None and (found < 0.0 or (found == 0.0 and name != "range_margin")):
                    least = "must not be negative" if name == "range_margin" else "must be above 0"
                    raise SealegsError(f"safety.{name} is {found:g}; it {least}.")
        for name in self.log_only:
            if name not in LOGGABLE:
                raise SealegsError(f"safety.log_only holds '{name}'; it may hold {' and '.join(LOGGABLE)}.")
        if self.current_time < 0:
            raise SealegsError(f"safety.current_time is {self.current_time:g}; it must not be negative.")
        if self.voltage_low >= self.voltage_high:
            raise SealegsError(
                f"safety.voltage_low is {self.voltage_low:g} V, not below voltage_high, {self.voltage_high:g} V."
            )

    @classmethod
    def from_config(cls, config: Mapping[str, Any]) -> Limits:
        """Limits from the ``safety`` block of a robot's file.

        Raises:
            SealegsError: a limit is missing, unknown or no number; there is no way to leave one out.
        """
        names = [field.name for field in fields(cls)]
        for name in config:
            if name not in names:
                raise SealegsError(f"safety.{name} is no limit{nearest(name, names)}; there are {', '.join(names)}.")
        for name in names:
            if name not in config:
                raise SealegsError(f"safety.{name} is missing; every limit needs a value.")
        values: dict[str, Any] = {name: _read(name, config[name]) for name in names}
        return cls(**{**values, "log_only": tuple(values["log_only"])})

    def by_joint(self, name: str, robot: ServoRobot) -> np.ndarray:
        """One of :data:`BY_JOINT` for each joint (k,) [rad or m]; NaN where it follows from the chain.

        Raises:
            SealegsError: a pattern fits no joint, a joint has no limit, or a joint in metres has one in rad.
        """
        value, names = getattr(self, name), robot.names
        if value is None:
            return np.full(len(names), math.nan)
        if not isinstance(value, Mapping):
            if "m" in robot.units:
                raise SealegsError(self._of_slides(robot))
            return np.full(len(names), float(value))
        found = by_pattern(f"safety.{name}", value, robot)
        if None in found and name not in FROM_CHAIN:
            raise SealegsError(f"safety.{name} has no value for joint {names[found.index(None)]}; add one.")
        return np.array([math.nan if item is None else float(item) for item in found])

    def _of_slides(self, robot: ServoRobot) -> str:
        """That limits in rad were given for joints in metres, and how all of them are given."""
        slides = [name for name, unit in zip(robot.names, robot.units, strict=True) if unit == "m"]
        wrong = {key: value for key in BY_JOINT if isinstance(value := getattr(self, key), int | float)}
        said = ", ".join(f"safety.{key} is {value:g} {'rad' if key in POSITIONS else 'rad/s'}"
                         for key, value in wrong.items())  # fmt: skip
        rows = []
        for key, value in wrong.items():
            least = 0.005 if key in POSITIONS else 0.5
            table = ", ".join([*(f'"{name}": {least:g}' for name in slides[:3]), f'"*": {value:g}'])
            rows.append(f"'robot.safety.{key}={{{table}}}'")
        more = f" and {len(slides) - 1} more joints are" if len(slides) > 1 else " is"
        return f"{said}, but joint {slides[0]}{more} in m; give limits by pattern of names, such as {' '.join(rows)}."


def by_pattern(key: str, values: Mapping[str, float], robot: ServoRobot) -> list[float | None]:
    """The number of the first pattern that fits, for each joint (k); None where none does.

    A pattern that fits no joint may mean what the robot's model calls one: a joint that got another name in the file of
    its robot keeps the limits that ``sealegs new-robot`` wrote there before.

    Raises:
        SealegsError: a pattern fits no joint.
    """
    meant: dict[str, list[bool]] = {}
    for pattern in values:
        own, of_model = fitting(robot.names, pattern), fitting(robot.model_names, pattern)
        if not any(own) and not any(of_model):
            raise SealegsError(f"{key}.{pattern} fits no joint; there are {', '.join(robot.names)}.")
        meant[pattern] = own if any(own) else of_model
    return [next((values[p] for p, fits in meant.items() if fits[k]), None) for k in range(len(robot.names))]


def _read(name: str, value: Any) -> Any:
    if name in BY_JOINT and isinstance(value, Mapping):
        return {str(key): checked(f"safety.{name}.{key}", item, float) for key, item in value.items()}
    kind: Any = list[str] if name == "log_only" else float | None if name in FROM_CHAIN else float
    return checked(f"safety.{name}", value, kind)


def usual_reach(half: float, unit: str) -> float:
    """How far an excitation goes to either side where nobody says it [rad or m]; ``half``: the range."""
    return min(REACH, SHARE * half) if unit == "rad" else SHARE * half
