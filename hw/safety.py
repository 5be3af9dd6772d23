"""Limits that hold whatever commands the robot: goals are kept within them, and measurements beyond them end the run.

Pure bookkeeping on numbers; no bus and no clock of its own. The loop asks it in every cycle and cannot switch it off.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ..actuators.errors import SealegsError, nearest
from ..configs.check import checked
from .packets import BusError
from .robot import Reading, ServoRobot

FORGIVEN = 10  # good cycles that make up for a missing one


@dataclass(frozen=True)
class Limits:
    """Limits of a machine; numbers in ``configs/robot``.

    Attributes:
        range_margin: how far beyond its calibrated range a joint may be found [rad].
        speed: largest measured speed of a joint [rad/s].
        goal_step: largest change of a goal from one cycle to the next [rad]; goals beyond it are cut.
        current: largest current of a servo [A], for longer than ``current_time``.
        current_time: [s]; starting and braking take more for some milliseconds.
        temperature: highest temperature of a servo [degC].
        voltage_low: lowest supply voltage [V].
        voltage_high: highest supply voltage [V].
        late: time that a reading may take; later ones count as missing [s].
        missing: cycles without a reading that are tolerated at a time; during them goals stay as they are.
    """

    range_margin: float
    speed: float
    goal_step: float
    current: float
    current_time: float
    temperature: float
    voltage_low: float
    voltage_high: float
    late: float
    missing: int

    def __post_init__(self) -> None:
        for name in ("speed", "goal_step", "current", "temperature", "late"):
            if getattr(self, name) <= 0.0:
                raise SealegsError(f"safety.{name} is {getattr(self, name):g}; it must be above 0.")
        for name in ("range_margin", "current_time", "missing"):
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
        types = {field.name: int if field.name == "missing" else float for field in fields(cls)}
        for name in config:
            if name not in types:
                raise SealegsError(f"safety.{name} is no limit{nearest(name, types)}; there are {', '.join(types)}.")
        for name in types:
            if name not in config:
                raise SealegsError(f"safety.{name} is missing; every limit needs a value.")
        return cls(**{name: checked(f"safety.{name}", config[name], kind) for name, kind in types.items()})


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
        cut: goals that were cut so far, by reason.
        missing: cycles without a usable reading, less what good ones made up for, in shares of 1 / :data:`FORGIVEN`.
    """

    def __init__(self, robot: ServoRobot, limits: Limits, period: float) -> None:
        """Watch ``robot``, whose loop has the period ``period`` [s]."""
        self.limits, self._robot, self._period = limits, robot, period
        self.cut = {"range": 0, "step": 0}
        self.missing = 0
        self._over_current = np.zeros(len(robot.joints))

    # --- goals -------------------------------------------------------------------------------------------------

    def admit(self, goals: np.ndarray, last: np.ndarray) -> np.ndarray | Fault:
        """Goals as they may be sent.

        Args:
            goals: wanted, in the order of joints (k,) [rad].
            last: sent in the cycle before, or the position at the start (k,) [rad].

        Returns:
            Goals within range and step (k,) [rad]; a fault where one is not a finite number.
        """
        goals = np.asarray(goals, np.float64)
        if goals.shape != last.shape or not np.isfinite(goals).all():
            names = [j.name for j, goal in zip(self._robot.joints, goals, strict=False) if not math.isfinite(goal)]
            return Fault("goal", f"the goal of {', '.join(names) or 'the robot'} is not a finite number.")
        stepped = np.clip(goals, last - self.limits.goal_step, last + self.limits.goal_step)
        admitted = np.clip(stepped, self._robot.low, self._robot.high)
        self.cut["step"] += int((stepped != goals).any())
        self.cut["range"] += int((admitted != stepped).any())
        return admitted

    # --- measurements ------------------------------------------------------------------------------------------

    def judge(self, reading: Reading) -> Fault | None:
        """What is wrong with a reading, if anything."""
        self.missing = max(self.missing - 1, 0)
        took = reading.after - reading.before
        if took > self.limits.late:
            late = f"a reading took {1e3 * took:.1f} ms, and {1e3 * self.limits.late:g} ms are tolerated."
            if (fault := self.missed(BusError(late), "late")) is not None:
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
                return Fault(name, f"joint {joint.name} (servo {joint.id}) {said}.", (joint.id,))
        return None

    def missed(self, error: BusError, name: str | None = None) -> Fault | None:
        """Count a cycle without a usable reading.

        Returns:
            A fault named after the error, once there were more than ``limits.missing`` of them at a time.
        """
        self.missing += FORGIVEN
        if self.missing <= FORGIVEN * self.limits.missing:
            return None
        return Fault(name or type(error).__name__, str(error), tuple(error.servos))
