"""Servos that their loop did not bring to rest: tried again and again, until they are, and said."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Protocol

from ...common.errors import SealegsError
from ..bus.clock import Clock
from ..bus.packets import PortBusyError, PortError
from ..bus.servo_bus import ServoBus
from .supervisor import Line, Rest, bring_to_rest

PAUSE = 0.002  # [s] between two tries to get a port: a dead loop's lock goes with its last file
YOUNG = 1.0  # [s] for which it hurries so
TIRED = 0.1  # [s] between two tries later on, and of servos that do not answer


class Note(Protocol):
    """Writes an event into the run's."""

    def __call__(self, kind: str, **details: object) -> None: ...


@dataclass(frozen=True)
class Failure:
    """Servos of one bus that are not at rest.

    Attributes:
        servos: as the host addresses them.
        reason: of the first.
        unreachable: whether the port itself is gone.
    """

    servos: Sequence[str]
    reason: str
    unreachable: bool = False


@dataclass(frozen=True)
class Aftermath:
    """What a supervisor has to do with once its loop is over: whom it tells, and who asks.

    Attributes:
        note: writes an event.
        say: prints a line at once.
        clock: that passes meanwhile.
        alone: whether the loop is gone, so that nobody else says what becomes of the servos.
        asked: how often a person asked this process to end.
        pid: of this process.
        lasting: whether the servos outlive the run.
        pressed: whether the emergency stop was pressed, after which servos are released whatever was to become of them.
    """

    note: Note
    say: Callable[[str], None]
    clock: Clock
    alone: Callable[[], bool]
    asked: Callable[[], int]
    pid: int
    lasting: bool = True
    pressed: Callable[[], bool] = lambda: False


def sentence(error: Exception) -> str:
    """What went wrong, for people; an exception that nobody foresaw by its name."""
    return str(error) if isinstance(error, SealegsError) else f"{type(error).__name__}: {error}"


def bring_all_to_rest(
    lines: Sequence[Line],
    rest: Rest,
    after: Aftermath,
    why: str,
    waited: Callable[[float], None] = lambda seconds: None,
    on: Collection[str] | None = None,
) -> Rest | None:
    """Bring the servos of all buses to rest, for as long as that takes.

    Args:
        lines: of the robot.
        rest: what becomes of the servos, unless the emergency stop is pressed meanwhile.
        after: how to tell.
        why: it is not the loop that does so.
        waited: called with the time so far [s] after each try that failed.
        on: servos that may have torque, where the others are known to have none; None: all may.

    Returns:
        What was done to them; None: a person ended the tries, or a virtual machine has ended.
    """
    started = after.clock.now()
    left = list(lines)
    names = [servo for line in lines for servo in line.named(line.ids)]
    off = set[str]() if on is None or rest == "hold" else set(names) - set(on)  # as they were last known
    noted: list[str] | None = None
    said = False
    while True:
        if rest == "hold" and after.pressed():
            rest, left = "release", list(lines)  # those that are held already as well
        failures = one_try(left, rest)
        took = after.clock.now() - started
        if rest == "release":
            failed = {servo for failure in failures.values() for servo in failure.servos}
            off |= {servo for line in left for servo in line.named(line.ids) if servo not in failed}
            failures = {name: failure for name, failure in failures.items() if not off.issuperset(failure.servos)}
        left = [line for line in left if line.name in failures]
        if not left:
            break
        servos = [servo for failure in failures.values() for servo in failure.servos if servo not in off]
        reason = next(iter(failures.values())).reason
        if servos != noted:
            after.note("not at rest", by="supervisor", servos=servos, reason=reason, seconds=round(took, 4))
            noted = servos
        listed = ", ".join(servos)
        alone = after.alone()
        if alone and not after.lasting and all(failure.unreachable for failure in failures.values()):
            after.note("gone", by="supervisor", reason=reason)
            return None
        if alone and not said:
            after.say(
                f"TORQUE MAY BE ON at servo(s) {listed}: CUT THE POWER. {_begun(why)}, and the supervisor cannot reach "
                f"them: {reason.rstrip('.')}. It goes on trying; `kill {after.pid}` ends that."
            )
            said = True
        if after.asked():
            after.note("not at rest", by="supervisor", servos=servos, reason="a person ended the tries")
            after.say(
                f"TORQUE MAY BE ON at servo(s) {listed}: CUT THE POWER. The supervisor was asked to end its tries."
            )
            return None
        waited(took)
        hurried = took < YOUNG and all(failure.unreachable for failure in failures.values())
        after.clock.sleep(PAUSE if hurried else TIRED)
    done, how, ends = "released", {}, ""
    if rest == "hold":
        how = {"release": f"kill {after.pid}"}
        done, ends = "held", f" It watches them; `{how['release']}` releases them."
    after.note("at rest", by="supervisor", rest=rest, seconds=round(took, 4), **how)
    if after.alone():
        after.say(f"{_begun(why)}; the supervisor has {done} servo(s) {', '.join(names)} after {took:.2g} s.{ends}")
    return rest


def one_try(lines: Sequence[Line], rest: Rest) -> dict[str, Failure]:
    """Bring servos to rest once; what is not, by the name of the bus.

    Servos that are to be released are told so as soon as their port is open, before any servo is asked: none waits for
    one that is silent, on its bus or on another.
    """
    failures: dict[str, Failure] = {}
    with contextlib.ExitStack() as stack:
        opened: list[tuple[Line, ServoBus]] = []
        for line in lines:
            try:
                bus = stack.enter_context(line.opening())
                if rest == "release":
                    bus.tell_off(line.ids)
                opened.append((line, bus))
            except Exception as error:  # whatever it is, another try may help
                failures[line.name] = _failure(line, line.ids, error)
        for line, bus in opened:
            try:
                if failed := bring_to_rest(bus, line.ids, rest):
                    failures[line.name] = _failure(line, sorted(failed), next(iter(failed.values())))
            except Exception as error:
                failures[line.name] = _failure(line, line.ids, error)
    return failures


def _failure(line: Line, servos: Sequence[int], error: Exception) -> Failure:
    gone = isinstance(error, PortError) and not isinstance(error, PortBusyError)
    return Failure(line.named(servos), sentence(error), gone)


def _begun(why: str) -> str:
    return why[:1].upper() + why[1:]
