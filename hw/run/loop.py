"""The control loop: read, judge, command, log, at a fixed rate; and the way to a safe end, whatever ends it."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, Literal

import numpy as np

from ...common.alarm import to_stderr
from ...common.errors import SealegsError
from ..bus.clock import Metronome
from ..bus.imu import ImuSource
from ..bus.interface import Bus, named
from ..bus.packets import BusError, ReplyError
from ..bus.servo_state import ServoState
from ..guard.safety import Fault, Safety, TorqueWatch
from ..guard.stop import Stop
from ..guard.supervisor import Rest, Supervisor
from ..guard.to_rest import WayToRest
from ..machine.robot import CurrentSign, Reading, ServoRobot
from .commands import Commands
from .measured_log import MeasuredLog, write_cycle
from .outcome import Outcome, fault_of
from .pace import Overruns, measured, slower_of

RETRYING = 0.5  # share of the period after which no servo is asked again
SEATED = 0.3  # [s] that the park pose is held before the release
SETTLING = 3.0  # [s] that the approach may take longer than planned
NOT_SEATED = ("following", "frozen")  # what a joint that does not get to its park pose looks like
NOWHERE = float("nan")


class ControlLoop:
    """One run on servos.

    Attributes:
        reading: the latest.
        sent: goals of the latest cycle (k,) [rad].
        elapsed: since the start of the run [s].
        state: ``start``, ``running``, ``sitting down``, ``to rest``, ``at rest``, or ``NOT AT REST`` while torque may
            be on.
        holder: process that watches the servos that are held; None: they are not.
        outcome: of the run once the servos are at rest, after an exception too; None before.
    """

    def __init__(
        self,
        bus: Bus,
        robot: ServoRobot,
        safety: Safety,
        commands: Commands,
        rate: float,
        *,
        log: MeasuredLog | None = None,
        supervisor: Supervisor | None = None,
        rest: Rest = "release",
        stop: Stop | None = None,
        each_cycle: Callable[[], str | None] = lambda: None,
        alarm: Callable[[str], None] = to_stderr,
        overruns: Literal["log", "stop"] = "log",
        park: Commands | None = None,
        begins: Callable[[], None] = lambda: None,
        armed: Callable[[], str | None] = lambda: None,
        imu: ImuSource | None = None,
    ) -> None:
        """Prepare; nothing moves.

        Args:
            bus: open.
            robot: on it.
            safety: its guard.
            commands: source of goals.
            rate: cycles per second [Hz].
            log: to write; None: none.
            supervisor: that outlives the loop; None: none.
            rest: what becomes of the servos at the end.
            stop: a person's wish to stop.
            each_cycle: called in every cycle, and on the ways to the start and to the park pose; a text that it
                returns stops all motion, such as the dead-man's switch.
            alarm: says at once what a person must know.
            park: motion along which the robot sits down before it is released, where it ends without a fault; a further
                wish to stop, and an emergency stop at once, cut it short.
            begins: called where the run begins, the robot being at its start; a hand may let go then.
            imu: of the robot; None: it has none.
            armed: asked at first, where it may wait, and before each servo gets torque; a text lets no further have it.
            overruns: what becomes of a rate that cannot be kept: it is said and logged, or ends the run as well.
        """
        self.bus, self.robot, self.safety, self.commands = bus, robot, safety, commands
        self._metronome = Metronome(rate, clock=bus.clock)
        self._log, self._supervisor = log, supervisor
        self._rest: Rest = rest
        self._stop, self.each_cycle, self.alarm, self._armed = stop or Stop(), each_cycle, alarm, armed
        self._zero_time = self._metronome.now()
        self.reading: Reading | None = None
        self.outcome: Outcome | None = None
        self.holder: int | None = None
        self.state = "start"
        self._read_at = self._zero_time
        self.sent = np.zeros(len(robot.joints))
        self._current_sign = CurrentSign(robot)
        self.park, self._torque_on, self._let_go, self._begins = park, False, False, begins
        self._note, self._imu = "", imu
        self._watch = TorqueWatch(self._metronome.period)
        self._overruns = Overruns(self._metronome.period, slower_of(commands))
        self._overruns_stop = overruns == "stop"

    @property
    def elapsed(self) -> float:
        """Since the start of the run [s]."""
        return self._metronome.now() - self._zero_time

    @property
    def reading_age(self) -> float:
        """Since the latest reading [s], on the host's clock."""
        return self.bus.clock.now() - self._read_at

    @property
    def counts(self) -> tuple[int, int]:
        """Cycles and overruns so far."""
        return self._metronome.cycles, self._metronome.overruns

    def run(self, duration: float) -> Outcome:
        """Switch torque on, run, and bring the servos to rest, however the run ends.

        What can be named ends the run as a fault. An exception that nobody foresaw is raised again once the servos are
        at rest; ``outcome`` tells what became of them.

        Args:
            duration: longest time [s].
        """
        fault: Fault | None = None
        ending = "finished"
        try:
            fault = self._begin()
            if fault is None and self._stop.reason is None:
                fault = self._cycles(min(duration, self.commands.duration))
            if fault is None and self.park is not None and self._torque_on and not self._let_go:
                fault = self._sit(self.park)
        except SealegsError as error:
            fault = fault_of(error)
        except BaseException as error:
            self._event("exception", error=repr(error))
            ending = "exception"
            raise
        finally:
            if fault is not None and not self._stop.emergency:  # which itself takes the torque away
                ending = "fault"
                if self._torque_on:
                    self._way_to_rest().say(f"STOP: {fault.sentence}")  # before servos, log and figures take their time
                self._event("fault", name=fault.name, sentence=fault.sentence, servos=named(fault.servos))
            elif self._stop.reason is not None and ending == "finished":
                ending = "stopped"
            self.outcome = self._ended(ending, None if self._stop.emergency else fault)
        return self.outcome

    def _ended(self, ending: str, fault: Fault | None) -> Outcome:
        self._metronome.stop()
        release = self._stop.emergency or not self._torque_on or self._beat() is not None  # or nobody would watch them
        at_rest = self._way_to_rest().take("release" if release else self._rest, self._rest)
        self.holder, timing = at_rest.holder, self._metronome.timing()  # which takes a while: no servo waits for it
        cut, bus = dict(self.safety.cut), dict(self.bus.counts)
        if magnitudes := self._current_sign.magnitudes:
            self._event("current without sign", servos=named(magnitudes), made="signed as duty x voltage - back-EMF")
        held = {} if self.holder is None else {"release": f"kill {self.holder}"}
        self._event(
            "end", ending=ending, reason=self._stop.reason, cycles=timing.cycles, overruns=timing.overruns, **held
        )
        return Outcome(
            ending, self._stop.reason, fault=fault, timing=timing, cut=cut, bus=bus, not_at_rest=at_rest.failed,
            rest_seconds=at_rest.seconds, rest=at_rest.rest, note=self._note,
        )  # fmt: skip

    def _way_to_rest(self) -> WayToRest:
        to = partial(setattr, self, "state")
        return WayToRest(self.bus, self.robot.ids, self._supervisor, self._stop, self.alarm, self._event, to)

    # --- start -------------------------------------------------------------------------------------------------

    def _begin(self) -> Fault | None:
        ids = self.robot.ids
        if self._said(self._armed()):
            return None
        if fault := self._fit():
            return fault
        if self._stop.reason is not None:  # asked for while the bus and the supervisor were started
            return None
        self._event("torque on", servos=named(ids))
        self._torque_on = True
        self._torque_on = self.bus.torque_on(ids, self._still_wanted)
        if not self._torque_on:
            return self._beat()
        if self._stop.reason is not None:
            return None
        try:
            here = self._put_together(self.bus.read_state(self.robot.all_ids))
            self.sent = self.robot.staying(here.position)  # goals go on from there
            if (start := self.commands.start()) is None:
                return None
            fault = self._approach(np.clip(start, self.robot.low, self.robot.high))
        except SealegsError as error:
            fault = fault_of(error)
        return None if fault is None else replace(fault, sentence=f"on the way to the start: {fault.sentence}")

    def _still_wanted(self) -> bool:
        """Asked before each servo gets its torque: whether nobody wants to stop. The supervisor watches from now on."""
        heard = self._supervisor is None or self._supervisor.starting()
        return heard and not self._said(self._armed()) and self._stop.reason is None

    def _fit(self) -> Fault | None:
        """Whether the robot may get torque: everybody answers, in time, within the limits."""
        period = self._metronome.period
        slow = measured(self.bus, self.robot, self.commands, period, self._imu).too_slow(period)
        if slow is not None and (fault := self._named("slow", slow)) is not None:
            return fault
        self.reading = self._read_once()
        self.sent = self.robot.staying(self.reading.position)  # nothing lags before it is told to
        fault = self._judge(self.reading)
        return None if fault is None else replace(fault, sentence=f"before torque came on: {fault.sentence}")

    def _named(self, name: str, sentence: str) -> Fault | None:
        """Say and log that the rate is not kept; a fault where that ends the run."""
        self._event("pace", name=name, sentence=sentence)
        if self._overruns_stop:
            return Fault(name, sentence)
        self._way_to_rest().say(sentence)
        return None

    def _read_once(self) -> Reading:
        until = self.bus.clock.now() + RETRYING * self._metronome.period
        state = self.bus.read_cycle(self.robot.all_ids, self._watch.due(self._metronome.now()), until)
        self._read_at = state.after
        return self._current_sign.mended(self._put_together(state))

    def _put_together(self, state: ServoState) -> Reading:
        """A reading of servos and IMU."""
        return self.robot.reading(state, self.reading, None if self._imu is None else self._imu.latest())

    def _reading(self) -> Reading | Fault | None:
        """A reading within the limits; why the run ends; None: nobody answered, and goals stay as they are."""
        try:
            reading = self._read_once()
        except ReplyError as error:
            self._missed(error)
            return self.safety.missed(error, error.servos or self.robot.all_ids, self._metronome.now())
        except BusError as error:  # no other try helps
            self._missed(error)
            return fault_of(error)
        if reading.state is not None and reading.state.problem is not None:
            self._missed(reading.state.problem)
        self.reading = reading
        if (fault := self._judge(reading)) is not None and self.state in ("running", "sitting down"):
            self._write_last(reading)
        return fault or reading

    def _missed(self, error: BusError) -> None:
        self._event("missed", error=type(error).__name__, sentence=str(error), servos=named(error.servos))

    def _judge(self, reading: Reading) -> Fault | None:
        if self._imu is not None:
            self.safety.imu_problem = self._imu.problem()
        lost = None if reading.state is None else self._watch.judge(reading.state, self.bus.marks)
        fault = lost or self.safety.judge(reading) or self.safety.follows(self.sent, reading)
        for noted in self.safety.noted:
            self._event("limit", name=noted.name, sentence=noted.sentence, servos=named(noted.servos))
        self.safety.noted.clear()
        return fault

    def _approach(self, start: np.ndarray) -> Fault | None:
        """Move slowly to where a trajectory begins, within the same limits: None there, or where a person stopped it.

        Raises:
            BusError: a servo cannot be reached.
        """
        way = Way(self.robot, self.sent, start)
        begun = self._metronome.wait()
        while True:
            now = self._metronome.now() - begun
            reading = self._reading()
            way.note(now, self.sent, None if reading is None or self.reading is None else self.reading.position)
            if isinstance(reading, Fault):
                self._event("approach", joints=list(self.robot.names), rows=list(way.noted))
                return reading
            self.sent = way.goal(now)
            self.bus.write_goals(self.robot.ids, self.robot.to_servo(self.sent))
            if (fault := self._beat()) is not None:
                return fault
            if self._said(self.each_cycle()) or self._stop.reason is not None:
                return None
            if reading is not None and now > way.span + 0.3 and way.is_there(reading.position):
                return None
            if now > way.span + SETTLING:
                return Fault("start", "the robot does not reach the start of the trajectory; is it blocked?")
            self._metronome.wait()

    # --- cycles ------------------------------------------------------------------------------------------------

    def _cycles(self, duration: float) -> Fault | None:
        begun: float | None = None
        self._metronome.restart()
        self.state = "running"
        period = self._metronome.period
        while self._stop.reason is None:
            woke = self._metronome.wait()
            if begun is None:
                begun = self._zero_time = woke
                self._begins()
                self._event("started", monotonic=time.monotonic())
            if (fault := self._beat()) is not None:
                return fault
            if self._said(self.each_cycle()):
                return None
            # goals belong to the grid of cycles: half a period of tolerance keeps them from slipping by one
            now = woke - begun
            if now >= duration - 0.5 * period:
                return None
            fault = self._cycle(now)
            if fault is not None:
                return fault
        return None

    def _cycle(self, now: float) -> Fault | None:
        ids = self.robot.ids
        reading = self._reading()
        if reading is None:
            self._metronome.done(NOWHERE, NOWHERE)
            return None
        if isinstance(reading, Fault):
            return reading
        if self._supervisor is not None:
            self._supervisor.asking()
        asked = self._metronome.now()
        try:
            goals = self.commands.goals(now, reading)
        except SealegsError as error:  # such as a policy that broke off
            self._write_last(reading)
            return fault_of(error)
        took = self._metronome.now() - asked
        if (fault := self._beat()) is not None:
            return fault
        admitted = self.safety.admit(goals, self.sent, now)
        if isinstance(admitted, Fault):
            self._write_last(reading)
            return admitted
        if (delay := getattr(self.commands, "delay", 0.0)) > 0.0:
            self._metronome.hold(reading.time + delay)
        try:
            sent = self.bus.write_goals(ids, self.robot.to_servo(admitted))
        except BusError as error:
            self._write_last(reading)
            return fault_of(error)
        self.sent = admitted
        self._write(reading, sent)
        read = reading.after - reading.before
        work = self._metronome.done(read, sent - reading.time, took)
        late = self._overruns.seen(self._metronome.overruns, read, took, work)
        return self._named("overruns", late) if late is not None else None

    def _write(self, reading: Reading, sent: float) -> None:
        if self._log is not None:
            write_cycle(self._log, reading, self.robot.fresh(reading), self.sent, sent, self._zero_time)

    def _write_last(self, reading: Reading) -> None:
        """Write the cycle in which a fault ends the run: a log that fails as well must not take its place."""
        try:
            self._write(reading, NOWHERE)
        except SealegsError as error:
            self._event("log", sentence=str(error))

    def _beat(self) -> Fault | None:
        if self._supervisor is None or self._supervisor.beat():
            return None
        return Fault("supervisor", "the supervisor that guards the servos has ended; without it no torque stays on.")

    def _said(self, reason: str | None) -> bool:
        """Whether a reason stops all motion; nobody then holds a switch for a way to the park pose."""
        if reason is None:
            return False
        self._let_go = True
        self._stop.ask(reason)
        return True

    def _event(self, kind: str, **details: Any) -> None:
        if self._log is not None:
            self._log.event(self.elapsed, kind, **details)

    def _sit(self, park: Commands) -> Fault | None:
        """Go slowly to where ``park`` begins, and along it; under the same limits as all else.

        A joint that does not get there ends the way down as a fault ends a run, but is none: the run was over.
        """
        heeded, self.state = self._stop.asked, "sitting down"
        assert self.reading is not None  # without one no torque came on
        here, start = self.safety.goals_from(self.sent, self.reading.position), park.start()
        self.sent = here
        start = here if start is None else np.where(np.isnan(start), here, start)
        way = Way(self.robot, here, np.clip(start, self.robot.low, self.robot.high))
        begun = self._metronome.wait()
        self._event("sitting down")
        while (now := self._metronome.now() - begun) < way.span + park.duration + SEATED:
            reading = self._reading()
            if isinstance(reading, Fault) and reading.name in NOT_SEATED:  # it lies on something, and is let go now
                self._note = f"The robot was released before it sat: {reading.sentence}"
                self._event("not seated", sentence=reading.sentence, servos=named(reading.servos))
                return None
            if isinstance(reading, Fault):
                return replace(reading, sentence=f"while sitting down: {reading.sentence}")
            if self._said(self.each_cycle()) or self._stop.asked > heeded or self._stop.emergency:
                return None
            goal, seen = way.goal(now), reading or self.reading
            if now > way.span and seen is not None:  # where nobody answers, the motion goes on all the same
                goal = park.goals(min(now - way.span, park.duration), seen)
                goal = np.where(np.isnan(goal), here, goal)  # of a joint that the motion leaves out
            if isinstance(admitted := self.safety.admit(goal, self.sent, now), Fault):
                return admitted
            sent = self.bus.write_goals(self.robot.ids, self.robot.to_servo(admitted))
            self.sent = admitted
            if reading is not None:
                self._write(reading, sent)
            if (fault := self._beat()) is not None:
                return fault
            self._metronome.wait()
        return None


# --- the slow way to where a motion begins ---------------------------------------------------------------------------

SPEED = 1.0  # [rad/s] of the servos' shafts
KEPT = 500  # cycles
ARRIVED = 0.15  # [rad] of the shaft that counts as there: friction and load leave a position servo short of its goal


class Way:
    """From where a robot is to where it shall be, at :data:`SPEED` of the shaft that turns furthest.

    Attributes:
        span: time that it takes [s].
        noted: the latest :data:`KEPT` cycles: time, goals and positions.
    """

    def __init__(self, robot: ServoRobot, first: np.ndarray, last: np.ndarray) -> None:
        """Plan it, from the goals ``first`` to ``last`` (k,) [rad or m]."""
        self._per_radian = np.array([joint.per_radian for joint in robot.joints])
        self._first, self._last, self._turning = first, last, robot.turning
        self.noted: deque[list[float]] = deque(maxlen=KEPT)
        self.span = float((np.abs(last - first) / self._per_radian).max()) / SPEED

    def goal(self, now: float) -> np.ndarray:
        """At ``now`` [s] since it began (k,) [rad or m]."""
        return self._first + (self._last - self._first) * min(now / max(self.span, 1e-9), 1.0)

    def note(self, now: float, goal: np.ndarray, position: np.ndarray | None) -> None:
        """Keep where the robot was told to be and was (k,) [rad or m], for a run that ends on the way; None: unread."""
        if position is not None:
            self.noted.append([round(now, 4), *np.round([*goal, *position], 5).tolist()])

    def is_there(self, position: np.ndarray) -> bool:
        """Whether all joints, at ``position`` (k,) [rad or m], are close to its end."""
        away = np.where(self._turning, 0.0, np.abs(position - self._last))
        return bool((away < ARRIVED * self._per_radian).all())
