"""Limits that hold whatever commands the robot: goals are kept within them, and measurements beyond them end the run.

Pure bookkeeping on numbers; no bus and no clock of its own: times are those of the readings. The loop asks it in every
cycle and cannot switch it off.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...common.errors import SealegsError
from ...envs.described.robot_within import POSITIONS, TIMES, never_stops
from ..bus.packets import BusError, in_words
from ..bus.servo_state import ServoState
from ..machine.limits import GOAL_SPEED, Following, ability
from ..machine.limits import Limits as Limits
from ..machine.robot import Reading, ServoRobot

WINDOW = 2.0  # [s] over which lost replies are counted, and 50 cycles at least
CHANGED = {
    "range": " (robot.safety.range_margin)",
    "speed": " (robot.safety.speed; a smaller reach= slows an excitation)",
    "voltage": "",  # its words have the key
}
"""What a person may change where that is not the limit of the same name alone, by name of the fault."""
BLOCKED = 0.5  # of its speed without load, by which a wheel turns slower than it is told where it is blocked; assumed
JUMP = 5.0  # periods at most for which a goal may make up after a stall


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
        imu_problem: why the IMU says nothing, as far as it is known; "": nothing is wrong.
    """

    def __init__(self, robot: ServoRobot, limits: Limits, period: float) -> None:
        """Watch ``robot``, whose loop has the period ``period`` [s].

        Raises:
            SealegsError: limits do not fit the robot's joints.
        """
        self.limits, self._robot, self._period = limits, robot, period
        self.cut = {"range": 0, "speed": 0}
        self.noted: list[Fault] = []
        self.lost: dict[int, float] = dict.fromkeys(robot.all_ids, 0.0)
        self._silent: dict[int, tuple[float, int]] = dict.fromkeys(robot.all_ids, (0.0, 0))  # for how long [s], cycles
        self._over_current = np.zeros(len(robot.joints))
        self._margin, self._speed = limits.by_joint("range_margin", robot), limits.by_joint("speed", robot)
        self._check_reach()
        abilities = [ability(robot.chains[joint.name], joint.per_radian) for joint in robot.joints]
        fastest, given = np.array([item.speed * GOAL_SPEED for item in abilities]), limits.by_joint("goal_speed", robot)
        self._goal_speed = np.where(np.isnan(given), fastest, given)
        self._following = Following(abilities, limits.by_joint("following_error", robot), period)
        self._fastest = np.array([item.speed for item in abilities])
        self._too_fast, self._blocked = np.zeros(len(robot.joints)), np.zeros(len(robot.joints))
        self._wanted: np.ndarray | None = None
        self._over: set[tuple[str, int]] = set()
        self._read_at = self._asked_at = math.nan
        self.imu_problem = ""

    def _check_reach(self) -> None:
        """Refuse limits so far that they would never stop a joint; one that a person puts out of the way may pass."""
        for key in POSITIONS:
            for k, limit in enumerate(self.limits.by_joint(key, self._robot)):
                if self._robot.turning[k]:
                    continue
                ends = float(self._robot.low[k]), float(self._robot.high[k])
                if math.isfinite(limit) and (reason := never_stops(float(limit), ends, self._robot.units[k], TIMES)):
                    raise SealegsError(f"safety.{key} of joint {self._robot.names[k]} {reason}")

    def _lasting(self, beyond: np.ndarray, lasted: np.ndarray, dt: float) -> np.ndarray:
        """How long each joint has been beyond a limit (k,) [s]; what was before the first reading beyond is unknown."""
        return np.where(beyond, lasted + np.where(lasted > 0.0, dt, min(dt, self._period)), 0.0)

    def _since_reading(self, now: float) -> float:
        """Time since the latest reading, or attempt at one, which is now the one at ``now`` [s]."""
        last, self._read_at = self._read_at, now
        return max(now - last, 0.0) if math.isfinite(last) else self._period

    # --- goals -------------------------------------------------------------------------------------------------

    def admit(self, goals: np.ndarray, last: np.ndarray, now: float | None = None) -> np.ndarray | Fault:
        """Goals as they may be sent.

        Args:
            goals: wanted, in the order of joints (k,) [rad or m].
            last: sent in the cycle before, or the position at the start (k,) [rad or m].
            now: clock [s]; None: a period after the goals before.

        Returns:
            Goals within range and speed (k,) [rad or m]; a fault where one is not a finite number.
        """
        dt, self._asked_at = (self._period if now is None else now - self._asked_at), math.nan if now is None else now
        dt = min(max(dt, self._period), JUMP * self._period) if math.isfinite(dt) else self._period
        goals = np.asarray(goals, np.float64)
        if goals.shape != last.shape or not np.isfinite(goals).all():
            names = [j.name for j, goal in zip(self._robot.joints, goals, strict=False) if not math.isfinite(goal)]
            return Fault("goal", f"the goal of {', '.join(names) or 'the robot'} is not a finite number.")
        stepped = goals
        if "goal_speed" not in self.limits.log_only:
            step = self._goal_speed * dt
            stepped = np.where(self._robot.turning, goals, np.clip(goals, last - step, last + step))
        admitted = np.clip(stepped, self._robot.low, self._robot.high)
        self.cut["speed"] += int((stepped != goals).any())
        self.cut["range"] += int((admitted != stepped).any())
        return self._sustained(goals, dt) or admitted

    def _sustained(self, goals: np.ndarray, dt: float) -> Fault | None:
        """Goals that stay faster than they may be."""
        speed = np.zeros(len(goals)) if self._wanted is None else np.abs(goals - self._wanted) / dt
        speed = np.where(self._robot.turning, 0.0, speed)
        self._wanted = goals
        self._too_fast = self._lasting(speed > self._goal_speed, self._too_fast, dt)
        text = (
            "is commanded at {0:.3g} {3}/s for more than {1:g} s; its limit is {2:.3g} {3}/s (robot.safety.goal_speed)"
        )
        return self._first("goal_speed", self._too_fast, text, speed, self._goal_speed)

    def _first(
        self, name: str, lasted: np.ndarray, text: str, found: np.ndarray, limit: np.ndarray, of: str = ""
    ) -> Fault | None:
        """The first joint that was beyond a limit for longer than ``following_time``; noted where that is asked for.

        Args:
            name: of the fault.
            lasted: how long (k,) [s].
            text: takes what was found, the time, the limit, and the joint's unit.
            found, limit: (k,).
            of: name of the limit in ``log_only``; "": as ``name``.
        """
        for k, joint in enumerate(self._robot.joints):
            if lasted[k] <= self.limits.following_time:
                self._over.discard((text, k))
                continue
            said = text.format(found[k], self.limits.following_time, limit[k], self._robot.units[k])
            fault = Fault(name, f"joint {joint.name} (servo {joint.address}) {said}.", (joint.address,))
            if (of or name) not in self.limits.log_only:
                return fault
            if (text, k) not in self._over:
                self._over.add((text, k))
                self.noted.append(fault)
        return None

    def follows(self, goal: np.ndarray, reading: Reading) -> Fault | None:
        """Whether joints follow.

        Args:
            goal: that the servos have (k,) [rad or m].
            reading: of this cycle.

        Returns:
            The first that does not.
        """
        watch = self._following
        missing = () if reading.state is None else reading.state.missing
        fresh = np.array([joint.address not in missing for joint in self._robot.joints])
        turning, dt = self._robot.turning, self._period
        watch.see(np.where(turning, reading.position, goal), reading.position, fresh, reading.after)
        slower = np.abs(goal - reading.velocity) * turning
        self._blocked = self._lasting(slower > BLOCKED * self._fastest, self._blocked, dt)
        text = "turns {0:.3g} {3}/s slower than it is told for {1:g} s: it is blocked, or its supply is weak"
        if fault := self._first("following", self._blocked, text, slower, self._fastest):
            return fault
        text = (
            "has been more than {2:.2g} {3} behind its goal for {1:g} s, at last {0:.2g} {3}: it is blocked or blind, "
            "or its goals are too fast for it (robot.safety.following_error; a smaller reach= slows an excitation)"
        )
        if fault := self._first("following", watch.behind, text, watch.error, watch.limits):
            return fault
        text = "has reported the same position for {1:g} s although its goal has moved: its encoder is stuck, or it is"
        return self._first("frozen", watch.stuck, text, watch.stuck, watch.limits, "following")

    def goals_from(self, sent: np.ndarray, position: np.ndarray) -> np.ndarray:
        """Where another motion begins: at the last goals, but nowhere further from a joint than that may be behind.

        A policy sends goals to be on the way to, not to arrive at: a leg that pushes off has its goal far ahead.

        Args:
            sent: the last goals (k,) [rad or m].
            position: of the joints (k,) [rad or m].

        Returns:
            Goals (k,) [rad or m]; how fast the goals before them were counts no more.
        """
        near = np.clip(sent, position - self._following.limits, position + self._following.limits)
        near = np.where(self._robot.turning, 0.0, np.clip(near, self._robot.low, self._robot.high))
        self._wanted, self._too_fast = near, np.zeros(len(near))
        return near

    # --- measurements ------------------------------------------------------------------------------------------

    def judge(self, reading: Reading) -> Fault | None:
        """What is wrong with a reading, if anything."""
        dt = self._since_reading(reading.after)
        if (fault := self._counted(reading, dt)) is not None:
            return fault
        faults = reading.state.faults() if reading.state is not None else []
        if faults:
            return Fault(type(faults[0]).__name__, str(faults[0]), faults[0].servos)
        limits, values = self.limits, reading
        self._over_current = self._lasting(np.abs(values.current) > limits.current, self._over_current, dt)
        beyond = np.maximum(self._robot.low - values.position, values.position - self._robot.high)
        beyond = np.where(self._robot.turning, -math.inf, beyond)
        checks = (
            ("range", beyond, self._margin, "is {0:.3f} {2} beyond its range; {1:g} {2} are tolerated"),
            ("speed", np.abs(values.velocity), self._speed, "moves at {0:.3g} {2}/s; its limit is {1:g} {2}/s"),
            (
                "current",
                self._over_current,
                limits.current_time,
                f"drew more than {limits.current:g} A for {{0:.2f}} s; {{1:g}} s are tolerated",
            ),
            ("temperature", values.temperature, limits.temperature, "is at {0:.0f} degC; its limit is {1:g} degC"),
            ("voltage", values.voltage, limits.voltage_high, "gets {0:.1f} V, over safety.voltage_high, {1:g} V"),
            ("voltage", -values.voltage, -limits.voltage_low, "gets {0:.1f} V, under safety.voltage_low, {1:g} V"),
        )
        for name, found, limit, text in checks:
            # a value that is not finite is beyond every limit
            bad = np.flatnonzero(~(found <= limit))
            if len(bad):
                joint = self._robot.joints[bad[0]]
                both = found[bad[0]], np.broadcast_to(limit, found.shape)[bad[0]]
                said = text + CHANGED.get(name, f" (robot.safety.{name})")
                said = said.format(*(abs(v) if name == "voltage" else v for v in both), self._robot.units[bad[0]])
                return Fault(name, f"joint {joint.name} (servo {joint.address}) {said}.", (joint.address,))
        return self._of_base(reading)

    def _of_base(self, reading: Reading) -> Fault | None:
        """Whether the robot has fallen, or its IMU says nothing any more."""
        imu = self._robot.imu
        if imu is None:
            return None
        longest = max(imu.silent, 2.0 * self._period, 2.0 / imu.rate + imu.delay)
        why = f": {self.imu_problem}" if self.imu_problem else ""
        if reading.imu is None:
            return Fault("imu", f"the IMU has given no sample{why}.")
        if (silent := reading.after - reading.imu.time) > longest:
            text = f"the IMU gave no sample for {1e3 * silent:.0f} ms; {1e3 * longest:.0f} ms are tolerated"
            return Fault("imu", f"{text} (imu.silent){why}.")
        tilt = float(imu.tilt(reading.imu.orientation))
        if imu.fallen is not None and not tilt <= imu.fallen:  # a tilt that is no number is beyond every limit
            text = (
                f"the robot has fallen: it leans by {tilt:.2f} rad, and {imu.fallen:g} rad are tolerated (imu.fallen)"
            )
            return Fault("fallen", f"{text}.")
        return None

    def _counted(self, reading: Reading, dt: float) -> Fault | None:
        took = reading.after - reading.before
        if took > self.limits.late:
            late = f"a reading took {1e3 * took:.1f} ms, and {1e3 * self.limits.late:g} ms are tolerated."
            return self._replies(BusError(late), self._robot.all_ids, dt, "late")
        if reading.state is None or reading.state.problem is None:
            return self._replies(None, (), dt)
        return self._replies(reading.state.problem, reading.state.missing, dt)

    def missed(self, error: BusError | None, servos: Sequence[int], now: float) -> Fault | None:
        """Count the replies of a cycle without a reading.

        Args:
            error: why some are missing.
            servos: ids of these; of all others a reply came.
            now: clock [s].

        Returns:
            A fault, once a servo has been silent for too long or loses too many replies.
        """
        return self._replies(error, servos, self._since_reading(now))

    def _replies(
        self, error: BusError | None, servos: Sequence[int], dt: float, name: str | None = None
    ) -> Fault | None:
        """As :meth:`missed`, ``dt`` after the cycle before [s]; ``name``: of the fault, None: after the error."""
        share = min(dt / WINDOW, 1.0 / 50.0)
        for servo in self.lost:
            gone = servo in servos
            time, cycles = self._silent[servo]
            self._silent[servo] = (time + dt, cycles + 1) if gone else (0.0, 0)
            self.lost[servo] += share * (float(gone) - self.lost[servo])
        if error is None:
            return None
        kind = name or type(error).__name__
        silences = {servo: self._silent[servo] for servo in servos}
        if silent := tuple(s for s, (time, cycles) in silences.items() if time > self.limits.silent and cycles > 1):
            if name is not None:
                return Fault(kind, str(error))
            why = f"{in_words(silent)} gave no usable reply for {1e3 * silences[silent[0]][0]:.0f} ms: {error}"
            return Fault(kind, why, silent)
        if lossy := tuple(servo for servo in servos if self.lost[servo] > self.limits.loss):
            share_lost = 100.0 * self.lost[lossy[0]]
            why = f"{in_words(lossy)} loses {share_lost:.0f} % of its replies, and {100.0 * self.limits.loss:g} % are"
            return Fault(kind, f"{why} tolerated: {error}", lossy)
        return None


# --- torque that is no longer on, though nobody switched it off: a servo that restarted, or lost its torque
# otherwise.
#
# After a restart a servo answers as before. Its torque is off, or on again where its firmware sees to that, and the
# register that marked it is as at power-on. So both are read back, with the readings of a cycle, often enough to name
# the loss within a tenth of a second.

LOOK = 0.05  # [s] between two looks; costs 16 bytes a servo each time


class TorqueWatch:
    """Asked in every cycle in which torque is meant to be on."""

    def __init__(self, period: float) -> None:
        """Watch a loop of the period ``period`` [s]."""
        self._least, self._looked = LOOK - 0.75 * period, -math.inf

    def due(self, now: float) -> bool:
        """Whether the cycle at ``now`` [s] reads the registers back."""
        if now - self._looked < self._least:
            return False
        self._looked = now
        return True

    def judge(self, state: ServoState, marks: Mapping[int, int | None]) -> Fault | None:
        """The servo that has lost its torque or has stopped by itself, if any; not one that says itself what is wrong.

        Args:
            state: as read.
            marks: what each servo that must have torque got in the register that tells a restart, by id.
        """
        if state.torque is None or state.mark is None or state.watchdog is None:
            return None
        told = {servo for fault in state.faults() for servo in fault.servos}  # who says itself what is wrong
        rows = zip(state.ids, state.torque.tolist(), state.mark.tolist(), state.watchdog.tolist(), strict=True)
        for servo, torque, mark, watchdog in rows:
            if servo not in marks or servo in state.missing or servo in told or torque < 0:
                continue
            if marks[servo] is not None and mark != marks[servo]:
                now = "its torque is off" if torque == 0 else f"register 'torque_enable' is {torque} again"
                sentence = (
                    f"servo {servo} has restarted: {now}, and what marked it at torque on is {mark} as after power-on, "
                    f"no longer {marks[servo]}; check its supply, wires and connectors."
                )
                return Fault("restart", sentence, (servo,))
            if torque != 1:
                sentence = (
                    f"servo {servo} has lost its torque: register 'torque_enable' is {torque}, though nobody switched "
                    "it; find out what else talks to it, or what it protects itself from."
                )
                return Fault("torque", sentence, (servo,))
            if watchdog < 0:
                sentence = (
                    f"servo {servo} has stopped by itself: it heard nothing for the time of its bus watchdog, and "
                    "takes no goals any more; find out what kept the computer or the adapter busy."
                )
                return Fault("watchdog", sentence, (servo,))
        return None
