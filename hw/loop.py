"""The control loop: read, judge, command, log, at a fixed rate; and the way to a safe end, whatever ends it."""

from __future__ import annotations

import contextlib
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .bus import ServoBus
from .clock import Metronome, Timing
from .commands import Commands
from .measured_log import MeasuredLog
from .packets import BusError, PortError
from .robot import Reading, ServoRobot
from .safety import Fault, Safety
from .supervisor import Rest, Supervisor, bring_to_rest

APPROACH_SPEED = 1.0  # [rad/s] on the way to where a trajectory begins
ARRIVED = 0.15  # [rad] from it that counts as there: friction and load leave a position servo short of its goal
SETTLING = 3.0  # [s] that the approach may take longer than planned
NOWHERE = float("nan")


@dataclass
class Outcome:
    """What became of a run.

    Attributes:
        ending: ``finished``, ``stopped`` (by a person) or ``fault``.
        reason: why a person stopped it.
        fault: where there was one.
        timing: of the loop.
        cut: goals that safety cut, by reason.
        bus: failures of the bus by name, the cured ones included.
        not_at_rest: servos that could not be brought to rest by the loop, and why.
        rest_seconds: from the end of the last cycle to the servos at rest [s].
    """

    ending: str
    reason: str | None
    fault: Fault | None
    timing: Timing
    cut: dict[str, int]
    bus: dict[str, int]
    not_at_rest: dict[int, str] = field(default_factory=dict)
    rest_seconds: float = 0.0


class Stop:
    """A person's wish to stop: Ctrl-C, a closed terminal, a polite kill, or the dead-man's switch let go.

    Attributes:
        reason: None while nobody wants to stop.
    """

    def __init__(self) -> None:
        self.reason: str | None = None

    def ask(self, reason: str) -> None:
        """Stop at the end of the cycle."""
        self.reason = self.reason or reason

    @contextlib.contextmanager
    def on_signals(self) -> Iterator[None]:
        """Turn signals into a wish to stop; a second Ctrl-C cannot break off the way to a safe end."""
        names = {"SIGINT": "Ctrl-C", "SIGTERM": "SIGTERM", "SIGHUP": "the terminal was closed"}
        previous: dict[int, Any] = {}
        for name, reason in names.items():
            if (number := getattr(signal, name, None)) is not None:
                with contextlib.suppress(ValueError):  # not in the main thread: whoever runs it there stops it himself
                    previous[number] = signal.signal(number, lambda *_, reason=reason: self.ask(reason))
        try:
            yield
        finally:
            for number, handler in previous.items():
                signal.signal(number, handler)


class ControlLoop:
    """One run on servos.

    Attributes:
        reading: the latest.
        sent: goals of the latest cycle (k,) [rad].
        elapsed: since the start of the run [s].
    """

    def __init__(
        self,
        bus: ServoBus,
        robot: ServoRobot,
        safety: Safety,
        commands: Commands,
        rate: float,
        *,
        log: MeasuredLog | None = None,
        supervisor: Supervisor | None = None,
        rest: Rest = "release",
        stop: Stop | None = None,
        stepped: bool = False,
        each_cycle: Callable[[], str | None] = lambda: None,
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
            stepped: the machine's time advances by a period in each cycle, however long that takes; of a virtual bus.
            each_cycle: called in every cycle, and on the way to the start; a text that it returns stops the run, such
                as the dead-man's switch.
        """
        self.bus, self.robot, self.safety, self.commands = bus, robot, safety, commands
        self._metronome = Metronome(rate, stepped)
        self._log, self._supervisor = log, supervisor
        self._rest: Rest = rest
        self._stop, self._each_cycle = stop or Stop(), each_cycle
        self._zero_time = self._metronome.now()
        self.reading: Reading | None = None
        self.sent = np.zeros(len(robot.joints))
        self._events_seen = 0

    @property
    def elapsed(self) -> float:
        """Since the start of the run [s]."""
        return self._metronome.now() - self._zero_time

    @property
    def counts(self) -> tuple[int, int]:
        """Cycles and overruns so far."""
        return self._metronome.cycles, self._metronome.overruns

    def run(self, duration: float) -> Outcome:
        """Switch torque on, run, and bring the servos to rest.

        Args:
            duration: longest time [s].

        Raises:
            BusError: the servos cannot be reached at the start.
            SealegsError: the log cannot be written on; the servos are at rest then too.
        """
        fault: Fault | None = None
        ending = "finished"
        try:
            self._begin()
            fault = self._cycles(min(duration, self.commands.duration))
            if fault is not None:
                ending = "fault"
            elif self._stop.reason is not None:
                ending = "stopped"
        except BaseException as error:
            self._event("exception", error=repr(error))
            raise
        finally:
            timing = self._metronome.timing()
            if fault is not None:
                self._event("fault", name=fault.name, sentence=fault.sentence, servos=list(fault.servos))
            seconds, failed = self._to_rest()
        cut, bus = dict(self.safety.cut), dict(self.bus.counts)
        outcome = Outcome(ending, self._stop.reason, fault, timing, cut, bus, failed, seconds)
        self._event("end", ending=ending, reason=self._stop.reason, cycles=timing.cycles, overruns=timing.overruns)
        return outcome

    # --- start -------------------------------------------------------------------------------------------------

    def _begin(self) -> None:
        ids = self.robot.ids
        self.sent = np.clip(self._read().position, self.robot.low, self.robot.high)
        if self._stop.reason is not None:  # asked for while the bus and the supervisor were started
            return
        self._event("torque on", servos=ids)
        self.bus.torque_on(ids)
        if (start := self.commands.start()) is not None:
            self._approach(np.clip(start, self.robot.low, self.robot.high))

    def _read(self) -> Reading:
        self.reading = self._read_once(None)
        return self.reading

    def _read_once(self, retries: int | None) -> Reading:
        state = self.bus.read_state(self.robot.all_ids, retries=retries)
        if self._metronome.stepped:
            state = replace(state, before=self._metronome.now(), after=self._metronome.now())
        return self.robot.reading(state, self.reading)

    def _approach(self, start: np.ndarray) -> None:
        """Move slowly to where a trajectory begins; under the same limits as all else.

        Raises:
            BusError: it cannot be reached, or a limit was passed on the way.
        """
        first = self.sent
        span = float(np.abs(start - first).max()) / APPROACH_SPEED
        begun = self._metronome.wait()
        while True:
            now = self._metronome.now() - begun
            reading = self._read()
            if (fault := self.safety.judge(reading)) is not None:
                raise BusError(f"on the way to the start: {fault.sentence}", fault.servos)
            self.sent = first + (start - first) * min(now / max(span, 1e-9), 1.0)
            self.bus.write_goals(self.robot.ids, self.robot.to_servo(self.sent))
            if (fault := self._beat()) is not None:
                raise BusError(fault.sentence)
            if (reason := self._each_cycle()) is not None:
                self._stop.ask(reason)
            if self._stop.reason is not None:
                return
            if now > span + 0.3 and (np.abs(reading.position - start) < ARRIVED).all():
                return
            if now > span + SETTLING:
                off = {n: f"{e:+.2f}" for n, e in zip(self.robot.names, reading.position - start, strict=True)}
                raise BusError(f"the robot does not reach the start of the trajectory; it is off by {off} rad.")
            self._metronome.wait()

    # --- cycles ------------------------------------------------------------------------------------------------

    def _cycles(self, duration: float) -> Fault | None:
        begun: float | None = None
        self._metronome.restart()
        period = self._metronome.period
        while self._stop.reason is None:
            woke = self._metronome.wait()
            if begun is None:
                begun = self._zero_time = woke
                self._event("started", monotonic=time.monotonic())
            if (fault := self._beat()) is not None:
                return fault
            if (reason := self._each_cycle()) is not None:
                self._stop.ask(reason)
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
        try:
            reading = self._read_once(0)
        except BusError as error:
            self._metronome.done(NOWHERE, NOWHERE)
            self._event("missed", error=type(error).__name__, sentence=str(error), servos=list(error.servos))
            if isinstance(error, PortError):  # no other try helps
                return Fault(type(error).__name__, str(error), tuple(error.servos))
            return self.safety.missed(error)
        self.reading = reading
        fault = self.safety.judge(reading)
        if fault is not None:
            self._write(reading, NOWHERE)
            return fault
        admitted = self.safety.admit(self.commands.goals(now, reading), self.sent)
        if isinstance(admitted, Fault):
            self._write(reading, NOWHERE)
            return admitted
        try:
            sent = self.bus.write_goals(ids, self.robot.to_servo(admitted))
            sent = self._metronome.now() if self._metronome.stepped else sent
        except BusError as error:
            self._write(reading, NOWHERE)
            return Fault(type(error).__name__, str(error), tuple(error.servos))
        self.sent = admitted
        self._write(reading, sent)
        self._metronome.done(reading.after - reading.before, sent - reading.time)
        return None

    def _write(self, reading: Reading, sent: float) -> None:
        if self._log is None:
            return
        zero = self._zero_time
        values = {"goal": self.sent, "link_position": reading.link, **vars(reading)}
        columns = [values[signal] for signal in self._log.signals]
        host = (reading.before - zero, reading.after - zero, sent - zero)
        status = reading.state.status[: len(self.robot.joints)] if reading.state is not None else ()
        self._log.write(reading.time - zero, np.stack(columns, axis=1), reading.base_position, host, status)

    def _beat(self) -> Fault | None:
        if self._supervisor is None or self._supervisor.beat():
            return None
        return Fault("supervisor", "the supervisor that guards the servos has ended; without it no torque stays on.")

    def _event(self, kind: str, **details: Any) -> None:
        if self._log is not None:
            self._log.event(self.elapsed, kind, **details)

    # --- end ---------------------------------------------------------------------------------------------------

    def _to_rest(self) -> tuple[float, dict[int, str]]:
        """Bring every servo to rest; what cannot be done here is left to the supervisor."""
        started = time.monotonic()
        if self._supervisor is not None:
            self._supervisor.resting()
        failed = bring_to_rest(self.bus, self.robot.ids, self._rest)
        seconds = time.monotonic() - started
        self.bus.close()
        reasons = {servo: str(error) for servo, error in failed.items()}
        self._event(
            "not at rest" if failed else "at rest",
            by="loop",
            rest=self._rest,
            seconds=round(seconds, 4),
            failed=reasons,
        )
        if self._supervisor is not None:
            (self._supervisor.call if failed else self._supervisor.dismiss)()
        return seconds, reasons
