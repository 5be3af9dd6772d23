"""The supervisor's process: it waits for the end of the loop, takes over, and watches servos that are held."""

from __future__ import annotations

import contextlib
import json
import os
import re
import select
import signal
import stat
import sys
from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic

from ...common.alarm import to_stderr
from ..bus.clock import HostClock
from .hold_watch import HoldWatch, claims
from .supervisor import ASKING, AT_REST, DONE, HELD, READY, RELEASE, RESTING, STARTING, Charge, Rest
from .take_over import Aftermath, bring_all_to_rest

NAMES = re.compile(rb"\[[^]]*\]")  # of servos, as JSON among the words
PATIENT = 2.0  # [s] that the loop may take over what lasts longer than a cycle: torque on, and the way to rest


@dataclass(frozen=True)
class End:
    """How the loop ended.

    Attributes:
        why: for people.
        hangs: whether it still lives.
        called: whether it said before that it brings the servos to rest: it may wait for this process.
        held: whether it left the servos held.
        release: whether the servos are to be released, whatever was to become of them.
        left: servos that the loop could not release, where it has released the others; None: nobody knows.
    """

    why: str
    hangs: bool = False
    called: bool = False
    held: bool = False
    release: bool = False
    left: tuple[str, ...] | None = None


def watch(charge: Charge, pipe: int, starting: Callable[[], None] = lambda: None) -> End | None:
    """Wait for the end of the loop; None where it brought the servos to rest.

    Args:
        charge: of this process.
        pipe: through which the loop speaks.
        starting: called once, as torque comes on.
    """
    patience: float | None = None
    last, release, started = b"", False, False
    left: tuple[str, ...] | None = None
    begun = b""  # of names
    while True:
        ready, _, _ = select.select([pipe], [], [], patience)
        if not ready:
            waits = ": its policy gave no goals" if last == ASKING else ""
            return End(f"the loop was silent for {patience:g} s{waits}", hangs=True, release=release)
        read = os.read(pipe, 4096)
        for names in NAMES.findall(begun + read):
            left = tuple(json.loads(names))
        data, bracket, rest = NAMES.sub(b"", begun + read).partition(b"[")
        begun = bracket + rest
        release |= RELEASE in data
        if STARTING in data and not started:
            started = True
            starting()
        if read:
            last = data.replace(RELEASE, b"")[-1:] or last
            patience = PATIENT if last in (STARTING, RESTING, HELD) else charge.silence
        elif last == DONE or not last:  # without a word, torque never came on
            return None
        elif last == HELD:
            return End("the loop left the servos held", held=not release, release=release)
        else:
            why = "the loop ended without bringing the servos to rest"
            return End(why, called=last == RESTING, release=release, left=left)


class Button:
    """The emergency stop as this process sees it: a descriptor of its own, and the loop's word by a signal."""

    def __init__(self, descriptor: int | None) -> None:
        """Look at ``descriptor``; None: the loop's word is all there is."""
        told, tell = os.pipe()
        signal.signal(signal.SIGUSR1, lambda *_: os.write(tell, b"!"))
        self._poll = select.poll()
        for number in (told,) if descriptor is None else (told, descriptor):
            self._poll.register(number, select.POLLIN)
        self._pressed = False

    def pressed(self, seconds: float = 0.0) -> bool:
        """Whether it was pressed or has broken, after at most so long [s]."""
        self._pressed = self._pressed or bool(self._poll.poll(1e3 * seconds))
        return self._pressed


class WakingClock(HostClock):
    """The host's clock; whoever sleeps is woken by the emergency stop."""

    def __init__(self, button: Button) -> None:
        self._button = button

    def sleep(self, seconds: float) -> None:
        """Leave the processor to others."""
        super().sleep(seconds) if self._button.pressed() else self._button.pressed(seconds)


class Process:
    """This process, as far as others notice it."""

    def __init__(self, charge: Charge, button: Button) -> None:
        self._charge, self._button = charge, button
        self._asked = list[int]()
        self._on_its_own = False

    def note(self, kind: str, **details: object) -> None:
        """Append an event to the run's."""
        if self._charge.events is None:
            return
        line = json.dumps({"monotonic": round(monotonic(), 6), "event": kind, **details}, default=str) + "\n"
        with contextlib.suppress(OSError), open(self._charge.events, "ab", buffering=0) as file:
            file.write(line.encode())
            os.fsync(file.fileno())

    def after(self, died: bool) -> Aftermath:
        """How it tells; ``died``: whether the loop is known to be gone. From now on a person can end this process."""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda number, _: self._asked.append(number))
        return Aftermath(
            note=self.note,
            say=to_stderr,
            clock=WakingClock(self._button),
            alone=lambda: died or self._on_its_own or os.getppid() != self._charge.loop or not awaited(1),
            asked=lambda: len(self._asked),
            pid=os.getpid(),
            lasting=self._charge.lasting,
            pressed=self._button.pressed,
        )

    def on_its_own(self) -> None:
        """Let go of what a program may read to its end, before it goes on for long; a terminal and a file are kept."""
        if self._on_its_own:
            return
        self._on_its_own = True
        to_stderr.flush()
        nowhere = os.open(os.devnull, os.O_RDWR)
        with contextlib.suppress(OSError):
            piped = stat.S_ISFIFO(os.fstat(2).st_mode)
            for descriptor in (0, 1, 2) if piped else (0, 1):
                os.dup2(nowhere, descriptor)


def awaited(descriptor: int) -> bool:
    """Whether the loop still reads what comes through ``descriptor``: it waits for this process."""
    poll = select.poll()
    poll.register(descriptor, 0)
    return not poll.poll(0)


def kill(loop: int) -> None:
    """End a loop that hangs: it must not wake up and command the servos again."""
    if os.getppid() == loop:
        with contextlib.suppress(ProcessLookupError):
            os.kill(loop, signal.SIGKILL)


def main(read_line: Callable[[], bytes]) -> None:
    """Serve one loop."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # it ends with its loop, not before
    charge = Charge.read(read_line())
    charge.load()
    button = Button(charge.button)
    sys.stdout.buffer.write(READY)
    sys.stdout.buffer.flush()
    mine = claims(charge)

    def starting() -> None:
        for claim in mine.values():
            claim.claim()

    end = watch(charge, sys.stdin.fileno(), starting)
    if end is None:
        return
    process = Process(charge, button)
    rest: Rest | None = "release" if end.release else charge.rest
    after = process.after(died=not end.called and not end.held)
    if not end.held:
        process.note("supervisor", why=end.why, rest=rest, process=os.getpid())
        if end.hangs:
            kill(charge.loop)

        def waited(seconds: float) -> None:
            if seconds > charge.patience:
                process.on_its_own()

        rest = bring_all_to_rest(charge.lines(), rest, after, end.why, waited, end.left)
        if rest is None:
            return
        with contextlib.suppress(OSError):
            os.write(1, AT_REST)
    if rest == "hold":
        process.on_its_own()
        HoldWatch(charge.lines(), after, mine, charge.bearable).watch()


if __name__ == "__main__":
    main(lambda: os.read(0, 65536))
