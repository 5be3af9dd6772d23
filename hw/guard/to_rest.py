"""The way to rest at the end of a run: what the loop does itself, and what it leaves to the supervisor."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from ..bus.interface import Bus
from .stop import Stop
from .supervisor import Rest, Supervisor, bring_to_rest


class Event(Protocol):
    """Writes an event into the run's log."""

    def __call__(self, kind: str, **details: object) -> None: ...


@dataclass(frozen=True)
class AtRest:
    """What became of the servos.

    Attributes:
        rest: what was done to them.
        seconds: that the loop took for it [s].
        failed: servos that the loop could not bring to rest, and why.
        holder: process that watches the servos that are held; None: they are not.
    """

    rest: Rest
    seconds: float
    failed: dict[int, str]
    holder: int | None = None


class WayToRest:
    """Brings servos to rest, whatever fails meanwhile."""

    def __init__(
        self,
        bus: Bus,
        ids: Sequence[int],
        supervisor: Supervisor | None,
        stop: Stop,
        alarm: Callable[[str], None],
        event: Event,
        enter: Callable[[str], None],
    ) -> None:
        """Prepare.

        Args:
            bus: open; it is closed at the end.
            ids: of the servos.
            supervisor: that is told, and gets what cannot be done here; None: none.
            stop: a person's wish, who may end the wait for the supervisor.
            alarm: says at once what a person must know.
            event: writes into the log.
            enter: told ``to rest``, ``at rest``, or ``NOT AT REST`` while torque may be on.
        """
        self._bus, self._ids, self._supervisor, self._stop = bus, list(ids), supervisor, stop
        self._alarm, self._event, self._enter = alarm, event, enter

    def take(self, rest: Rest, meant: Rest) -> AtRest:
        """Bring every servo to rest; what cannot be done here is left to the supervisor.

        Args:
            rest: what becomes of the servos.
            meant: what the supervisor was told at the start.
        """
        clock = self._bus.clock
        started = clock.now()
        self._enter("to rest")
        if self._supervisor is not None:
            if rest != meant:
                self._supervisor.release_only()
            self._supervisor.resting()
        failed = self._brought(rest)
        if rest == "hold" and (self._pressed() or not self._watched(bool(failed))):
            rest, failed = "release", self._brought("release")
        seconds = clock.now() - started
        self._bus.close()
        reasons = {servo: str(error) for servo, error in failed.items()}
        self._event(
            "not at rest" if failed else "at rest",
            by="loop",
            rest=rest,
            seconds=round(seconds, 4),
            failed={str(servo): reason for servo, reason in reasons.items()},
        )
        holder = self._leave(rest, list(failed))
        rest = "release" if self._stop.emergency else rest
        if not failed:
            self._enter("at rest")
        return AtRest(rest, seconds, reasons, holder)

    def _brought(self, rest: Rest) -> Mapping[int, Exception]:
        try:
            return bring_to_rest(self._bus, self._ids, rest, self._failing)
        except Exception as error:  # whatever it is, it must not hide that torque may be on
            self._failing(self._ids, error)
            return dict.fromkeys(self._ids, error)

    def _pressed(self) -> bool:
        """Whether the emergency stop was pressed meanwhile; the supervisor knows it then."""
        if self._stop.emergency and self._supervisor is not None:
            self._supervisor.release_only()
        return self._stop.emergency

    def _watched(self, failed: bool) -> bool:
        """Whether servos that are held may stay so: a supervisor lives that watches them, or reaches the others."""
        if self._supervisor is None:
            return True
        return self._supervisor.resting() if failed else self._supervisor.holding()

    def _leave(self, rest: Rest, failed: Sequence[int]) -> int | None:
        """Tell the supervisor how the servos are; the process that watches them from now on."""
        if self._supervisor is None:
            return None
        if failed and not self._supervisor.resting():
            self.say("The supervisor that guards the servos has ended: nobody goes on trying to reach them.")
        elif failed:
            asked = self._stop.asked
            self.say("The supervisor goes on trying to reach them; Ctrl-C ends the wait.")
            left = [str(servo) for servo in failed] if rest == "release" else []
            reached = self._supervisor.call(lambda: self._stop.asked > asked, left)
            return self._supervisor.pid if reached and rest == "hold" and not self._stop.emergency else None
        if rest == "hold":
            return self._supervisor.leave_held()
        self._supervisor.dismiss()
        return None

    def _failing(self, servos: Sequence[int], error: Exception) -> None:
        """Say at once that servos could not be brought to rest; others may still be."""
        self._enter("NOT AT REST")
        self.say(f"TORQUE MAY BE ON at servo(s) {', '.join(map(str, servos))}: CUT THE POWER. {error}")
        if self._supervisor is not None:
            self._supervisor.resting()  # each servo may take its time

    def say(self, line: str) -> None:
        """Tell a person at once; whatever becomes of that ends neither the run nor the way to rest."""
        try:
            self._alarm(line)
        except Exception as error:
            self._event("not said", line=line, error=repr(error))
