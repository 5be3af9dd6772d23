"""Limits of a machine, as data (the ``safety`` block of a robot's file), and whether its joints follow their goals."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ...actuators import Chain
from ...actuators.chain import largest_duty, no_load_speed, stall_torque
from ...common.errors import SealegsError, nearest
from ...configs.check import checked
from ...envs.described.robot_within import POSITIONS, fitting
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


# --- whether joints follow their goals: limits by servo model, out of the chain that the servo is believed to be -----
#
# A healthy servo whose goal is so far away that its controller gives full duty gets there at no less than half of its
# no-load speed, unless it carries more than half of its stall torque. What does not is blocked, overloaded, without
# its horn, or blind.
#
# An encoder that is stuck shows earlier: friction holds a servo at one step while its goal moves by twice the error
# at which the motor breaks away, and no further. A blind servo turns from there on, at a duty that nothing takes
# back.

GOAL_SPEED = 4.0  # times the no-load speed: a goal that moves so fast calls for full duty within a cycle or two
REACHED = 0.5  # share of the no-load speed at which a goal counts as reachable
SLACK = 1.5  # times what friction explains that a goal may move while the encoder stays at one step; assumed
LOADED = 0.1  # share of the load that friction in the gears takes, where the chain says less; assumed
UNKNOWN_ERROR, UNKNOWN_SPEED = 0.3, 10.0  # [rad], [rad/s] for chains that tell neither; assumed
UNKNOWN_REST = 0.05  # share of the error of full duty that friction holds, where the chain tells none; assumed
LEAST = 0.1  # [rad] that any joint may be behind: stiff controllers reach full duty within their own lag
LEAST_REST = 0.015  # [rad] that any goal may move without a step: ten steps of an encoder with 4096
SHAKING = 0.1  # [s] time constant over which a goal is smoothed: what is faster moves no joint by a step; assumed


@dataclass(frozen=True)
class Ability:
    """What a servo can do.

    Attributes:
        error: of the position at which the controller gives all it has, at least :data:`LEAST` [rad or m].
        speed: without load [rad/s or m/s].
        full: as ``error``, however small.
        rest: way that a goal may move while friction holds the unloaded servo at one step [rad or m].
        loaded: by how much more, per error that a load keeps up.
    """

    error: float
    speed: float
    full: float
    rest: float
    loaded: float


def ability(chain: Chain, per_radian: float = 1.0) -> Ability:
    """What a chain can do, as far as it tells, in units of the joint, which moves ``per_radian`` of the shaft."""
    duty, error, speed = largest_duty(chain), UNKNOWN_ERROR * per_radian, no_load_speed(chain)
    stall = stall_torque(chain)  # [N.m or N]
    for stage in ("position_p", "position_pd", "position_pi"):
        if chain.find(stage) is not None and (gain := chain.value(f"{stage}.gain")) > 0.0:
            error = duty / gain
    if chain.find("ideal") is not None and math.isfinite(stall):
        error = stall / max(chain.value("ideal.stiffness"), 1e-6)
    speed = speed if math.isfinite(speed) else UNKNOWN_SPEED * per_radian
    stall = stall if math.isfinite(stall) else 0.0
    rest, loaded = _held(chain, error, stall)
    return Ability(max(error, LEAST * per_radian), speed, error, rest + LEAST_REST * per_radian, loaded)


def _held(chain: Chain, full: float, stall: float) -> tuple[float, float]:
    """``rest`` and ``loaded`` of a servo: friction acts to either side, so twice the error at which it breaks away."""
    friction = chain.find("friction")
    share, load = UNKNOWN_REST, LOADED
    if friction is not None and stall > 0.0:
        load = max(load, friction.load + friction.load_stribeck)
        share = (friction.coulomb + friction.stribeck + abs(friction.asymmetry) + friction.ripple) / stall
    if chain.find("minimum_duty") is None and chain.find("duty_step") is not None:
        share += chain.value("duty_step.size")
    dead = chain.value("dead_band.width") if chain.find("dead_band") is not None else 0.0
    return SLACK * (2.0 * share * full + dead), SLACK * 2.0 * load


class Following:
    """Watches joints follow their goals.

    Attributes:
        error: by which each joint is beyond what it could have reached (k,) [rad or m].
        behind: for how long that has been more than its limit (k,) [s].
        stuck: for how long a position has not changed though its goal has moved (k,) [s].
    """

    def __init__(self, abilities: list[Ability], limit: np.ndarray, period: float) -> None:
        """Prepare.

        Args:
            abilities: of the joints' servos (k).
            limit: of the error (k,) [rad or m]; NaN: that at which each servo gives all it has.
            period: of the loop [s].
        """
        self.limits = np.where(np.isnan(limit), [item.error for item in abilities], limit)
        self._full, self._rest, self._loaded = np.array([(a.full, a.rest, a.loaded) for a in abilities]).T
        self._speed = REACHED * np.array([item.speed for item in abilities])
        self._period, self._time = period, 0.0
        self._reachable: np.ndarray | None = None
        self._position = self._smooth = np.zeros(0)
        self._least = self._most = np.zeros((2, 0))  # of the goal, and of the smoothed one, since the position changed
        self.error, self.behind, self.stuck = (np.zeros(len(abilities)) for _ in range(3))

    def see(self, goal: np.ndarray, position: np.ndarray, fresh: np.ndarray, time: float) -> None:
        """One cycle.

        Args:
            goal: that the servos have (k,) [rad or m].
            position: as read (k,) [rad or m].
            fresh: whether it was read in this cycle (k,).
            time: of the reading [s].
        """
        if self._reachable is None:
            self._reachable, self._position, self._time = position.copy(), position, time - self._period
            self._smooth, self._least, self._most = goal, np.stack([goal, goal]), np.stack([goal, goal])
        dt, self._time = max(time - self._time, 0.0), time
        step = dt * self._speed
        self._reachable = self._reachable + np.clip(goal - self._reachable, -step, step)
        low, high = np.minimum(goal, self._reachable), np.maximum(goal, self._reachable)
        self.error = np.maximum(np.maximum(low - position, position - high), 0.0)
        self.behind = self._lasting(self.error > self.limits, self.behind, dt)
        changed = fresh & (position != self._position)
        self._position = np.where(changed, position, self._position)
        self._smooth = goal + (self._smooth - goal) * np.exp(-dt / SHAKING)
        both = np.stack([goal, self._smooth])
        self._least = np.where(changed, both, np.minimum(self._least, both))
        self._most = np.where(changed, both, np.maximum(self._most, both))
        held = self._rest + self._loaded * np.minimum(np.abs(goal - self._position), self._full)
        # smoothed alone, a goal that has just stopped would still come after it
        moved = (np.maximum(self._most - both, both - self._least) > held).all(axis=0)
        self.stuck = self._lasting(moved & ~changed, self.stuck, dt)

    def _lasting(self, beyond: np.ndarray, lasted: np.ndarray, dt: float) -> np.ndarray:
        return np.where(beyond, lasted + np.where(lasted > 0.0, dt, min(dt, self._period)), 0.0)
