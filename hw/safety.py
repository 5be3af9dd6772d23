"""Limits that hold whatever commands the robot: goals are kept within them, and measurements beyond them end the run.

Pure bookkeeping on numbers; no bus and no clock of its own. The loop asks it in every cycle and cannot switch it off.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ..actuators.errors import SealegsError, nearest
from ..configs.check import checked
from .following import GOAL_SPEED, Following, ability
from .packets import BusError, in_words
from .robot import Reading, ServoRobot

FROM_CHAIN = ("goal_speed", "following_error")
"""Limits that may be null: they follow from the servo's chain."""
LOGGABLE = ("following", "goal_speed")
WINDOW = 2.0  # [s] over which lost replies are counted, and 50 cycles at least


@dataclass(frozen=True)
class Limits:
    """Limits of a machine; numbers in ``configs/robot``.

    Attributes:
        range_margin: how far beyond its calibrated range a joint may be found [rad].
        speed: largest measured speed of a joint [rad/s].
        goal_speed: largest speed of a goal [rad/s]; faster ones are cut, and end the run where they stay so fast for
            ``following_time``. None: four times the no-load speed of the servo's chain.
        following_error: by which a joint may stay behind its goal [rad], for longer than ``following_time``. None:
            that at which the servo's chain gives full duty.
        following_time: [s].
        current: largest current of a servo [A], for longer than ``current_time``.
        current_time: [s]; starting and braking take more for some milliseconds.
        temperature: highest temperature of a servo [degC].
        voltage_low: lowest supply voltage [V].
        voltage_high: highest supply voltage [V].
        late: time that a reading may take; the replies of a later one count as lost [s].
        silent: time without a reply of a servo that is tolerated [s], and two cycles at least.
        loss: share of the replies of a servo that may be lost, over :data:`WINDOW`.
        log_only: of ``following`` and ``goal_speed``, those that are noted in the log and neither cut nor stop.
    """

    range_margin: float
    speed: float
    goal_speed: float | None
    following_error: float | None
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
        for name in (
            "speed",
            "goal_speed",
            "following_error",
            "following_time",
            "current",
            "temperature",
            "late",
            "silent",
            "loss",
        ):
            if (value := getattr(self, name)) is not None and value <= 0.0:
                raise SealegsError(f"safety.{name} is {value:g}; it must be above 0.")
        for name in self.log_only:
            if name not in LOGGABLE:
                raise SealegsError(f"safety.log_only holds '{name}'; it may hold {' and '.join(LOGGABLE)}.")
        for name in ("range_margin", "current_time"):
            if getattr(self, name) < 0:
                raise SealegsError(f"safety.{name} is {getattr(self, name):g}; it must not be negative.")
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
        kinds: dict[str, Any] = {"log_only": list[str], **dict.fromkeys(FROM_CHAIN, float | None)}
        types = {field.name: kinds.get(field.name, float) for field in fields(cls)}
        for name in config:
            if name not in types:
                raise SealegsError(f"safety.{name} is no limit{nearest(name, types)}; there are {', '.join(types)}.")
        for name in types:
            if name not in config:
                raise SealegsError(f"safety.{name} is missing; every limit needs a value.")
        values = {name: checked(f"safety.{name}", config[name], kind) for name, kind in types.items()}
        return cls(**{**values, "log_only": tuple(values["log_only"])})


@dataclass(frozen=True)
class Fault:
    """Why a run ended.

    Attributes:
        name: one word for what went wrong, as logs and tests know it.
        sentence: for people.
        servos: ids concerned; empty: all.
    """

    name: str
    sentence: str
    servos: tuple[int, ...] = ()


class Safety:
    """Watches one run.

    Attributes:
        limits: in force.
        cut: cycles whose goals were cut so far, by reason.
        noted: limits that were passed and only noted, since the caller last emptied the list.
        lost: share of lost replies of each servo, by id.
    """

    def __init__(self, robot: ServoRobot, limits: Limits, period: float) -> None:
        """Watch ``robot``, whose loop has the period ``period`` [s]."""
        self.limits, self._robot, self._period = limits, robot, period
        self.cut = {"range": 0, "speed": 0}
        self.noted: list[Fault] = []
        self.lost: dict[int, float] = dict.fromkeys(robot.all_ids, 0.0)
        self._silent: dict[int, float] = dict.fromkeys(robot.all_ids, 0.0)
        self._over_current = np.zeros(len(robot.joints))
        abilities = [ability(robot.chains[joint.name], joint.per_radian) for joint in robot.joints]
        self._goal_speed = np.array([item.speed * GOAL_SPEED for item in abilities])
        if limits.goal_speed is not None:
            self._goal_speed[:] = limits.goal_speed
        self._following = Following(abilities, limits.following_error, period)
        self._too_fast = np.zeros(len(robot.joints))
        self._wanted: np.ndarray | None = None
        self._over: set[tuple[str, int]] = set()

    # --- goals -------------------------------------------------------------------------------------------------

    def admit(self, goals: np.ndarray, last: np.ndarray) -> np.ndarray | Fault:
        """Goals as they may be sent.

        Args:
            goals: wanted, in the order of joints (k,) [rad].
            last: sent in the cycle before, or the position at the start (k,) [rad].

        Returns:
            Goals within range and speed (k,) [rad]; a fault where one is not a finite number.
        """
        goals = np.asarray(goals, np.float64)
        if goals.shape != last.shape or not np.isfinite(goals).all():
            names = [j.name for j, goal in zip(self._robot.joints, goals, strict=False) if not math.isfinite(goal)]
            return Fault("goal", f"the goal of {', '.join(names) or 'the robot'} is not a finite number.")
        stepped = goals
        if "goal_speed" not in self.limits.log_only:
            step = self._goal_speed * self._period
            stepped = np.clip(goals, last - step, last + step)
        admitted = np.clip(stepped, self._robot.low, self._robot.high)
        self.cut["speed"] += int((stepped != goals).any())
        self.cut["range"] += int((admitted != stepped).any())
        return self._sustained(goals) or admitted

    def _sustained(self, goals: np.ndarray) -> Fault | None:
        """Goals that stay faster than they may be."""
        speed = np.zeros(len(goals)) if self._wanted is None else np.abs(goals - self._wanted) / self._period
        self._wanted = goals
        self._too_fast = np.where(speed > self._goal_speed, self._too_fast + self._period, 0.0)
        text = "is commanded at {0:.0f} rad/s for more than {1:g} s; its limit is {2:.0f} rad/s"
        return self._first("goal_speed", self._too_fast, text, speed, self._goal_speed)

    def _first(
        self, name: str, lasted: np.ndarray, text: str, found: np.ndarray, limit: np.ndarray, of: str = ""
    ) -> Fault | None:
        """The first joint that was beyond a limit for longer than ``following_time``; noted where that is asked for.

        Args:
            name: of the fault.
            lasted: how long (k,) [s].
            text: takes what was found, the time and the limit.
            found, limit: (k,).
            of: name of the limit in ``log_only``; "": as ``name``.
        """
        for k, joint in enumerate(self._robot.joints):
            if lasted[k] <= self.limits.following_time:
                self._over.discard((name, k))
                continue
            said = text.format(found[k], self.limits.following_time, limit[k])
            fault = Fault(name, f"joint {joint.name} (servo {joint.address}) {said}.", (joint.address,))
            if (of or name) not in self.limits.log_only:
                return fault
            if (name, k) not in self._over:
                self._over.add((name, k))
                self.noted.append(fault)
        return None

    def follows(self, goal: np.ndarray, reading: Reading) -> Fault | None:
        """Whether joints follow.

        Args:
            goal: that the servos have (k,) [rad].
            reading: of this cycle.

        Returns:
            The first that does not.
        """
        watch = self._following
        missing = () if reading.state is None else reading.state.missing
        watch.see(goal, reading.position, np.array([joint.address not in missing for joint in self._robot.joints]))
        text = "has been more than {2:.2f} rad behind its goal for {1:g} s, at last {0:.2f} rad: it is blocked or blind"
        if fault := self._first("following", watch.behind, text, watch.error, watch.limits):
            return fault
        text = "has reported the same position for {1:g} s although its goal has moved: its encoder is stuck, or it is"
        return self._first("frozen", watch.stuck, text, watch.stuck, watch.limits, "following")

    # --- measurements ------------------------------------------------------------------------------------------

    def judge(self, reading: Reading) -> Fault | None:
        """What is wrong with a reading, if anything."""
        if (fault := self._counted(reading)) is not None:
            return fault
        faults = reading.state.faults() if reading.state is not None else []
        if faults:
            return Fault(type(faults[0]).__name__, str(faults[0]), faults[0].servos)
        limits, values = self.limits, reading
        self._over_current = np.where(np.abs(values.current) > limits.current, self._over_current + self._period, 0.0)
        beyond = np.maximum(self._robot.low - values.position, values.position - self._robot.high)
        checks = (
            ("range", beyond, limits.range_margin, "is {0:.3f} rad beyond its range; {1:g} rad are tolerated"),
            ("speed", np.abs(values.velocity), limits.speed, "turns at {0:.1f} rad/s; its limit is {1:g} rad/s"),
            (
                "current",
                self._over_current,
                limits.current_time,
                f"drew more than {limits.current:g} A for {{0:.2f}} s; {{1:g}} s are tolerated",
            ),
            ("temperature", values.temperature, limits.temperature, "is at {0:.0f} degC; its limit is {1:g} degC"),
            ("voltage", values.voltage, limits.voltage_high, "gets {0:.1f} V; at most {1:g} V are allowed"),
            ("voltage", -values.voltage, -limits.voltage_low, "gets {0:.1f} V; at least {1:g} V are needed"),
        )
        for name, found, limit, text in checks:
            # a value that is not finite is beyond every limit
            bad = np.flatnonzero(~(found <= limit))
            if len(bad):
                joint = self._robot.joints[bad[0]]
                said = text.format(*(abs(v) if name == "voltage" else v for v in (found[bad[0]], limit)))
                return Fault(name, f"joint {joint.name} (servo {joint.address}) {said}.", (joint.address,))
        return None

    def _counted(self, reading: Reading) -> Fault | None:
        took = reading.after - reading.before
        if took > self.limits.late:
            late = f"a reading took {1e3 * took:.1f} ms, and {1e3 * self.limits.late:g} ms are tolerated."
            return self.missed(BusError(late), self._robot.all_ids, "late")
        if reading.state is None or reading.state.problem is None:
            return self.missed(None, ())
        return self.missed(reading.state.problem, reading.state.missing)

    def missed(self, error: BusError | None, servos: Sequence[int], name: str | None = None) -> Fault | None:
        """Count the replies of a cycle.

        Args:
            error: why some are missing.
            servos: ids of these; of all others a reply came.
            name: of the fault; None: after the error.

        Returns:
            A fault, once a servo has been silent for too long or loses too many replies.
        """
        tolerated = max(self.limits.silent, 1.5 * self._period)
        share = self._period / max(WINDOW, 50.0 * self._period)
        for servo in self.lost:
            gone = servo in servos
            self._silent[servo] = self._silent[servo] + self._period if gone else 0.0
            self.lost[servo] += share * (float(gone) - self.lost[servo])
        if error is None:
            return None
        kind = name or type(error).__name__
        if silent := tuple(servo for servo in servos if self._silent[servo] > tolerated):
            if name is not None:
                return Fault(kind, str(error))
            why = f"{in_words(silent)} gave no usable reply for {1e3 * self._silent[silent[0]]:.0f} ms: {error}"
            return Fault(kind, why, silent)
        if lossy := tuple(servo for servo in servos if self.lost[servo] > self.limits.loss):
            share_lost = 100.0 * self.lost[lossy[0]]
            why = f"{in_words(lossy)} loses {share_lost:.0f} % of its replies, and {100.0 * self.limits.loss:g} % are"
            return Fault(kind, f"{why} tolerated: {error}", lossy)
        return None
