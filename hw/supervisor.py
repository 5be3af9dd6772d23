"""A small process that outlives the control loop: when the loop dies or hangs, it brings the servos to rest.

The servos' registers offer no watchdog; left alone, they hold their last goal for ever. So the loop starts this process
before it switches torque on, sends it a byte each cycle, and says when it has brought the servos to rest itself. If the
bytes stop without that (an exception, a ``kill -9``, a loop that hangs), the supervisor takes the port. It releases
every servo or holds it where it is, even where another one fails.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from .bus import ServoBus
from .interface import Bus, Failing
from .packets import BusError, PortError

BEAT, RESTING, DONE, HELD = b".", b"r", b"d", b"h"
LEFT_HELD = "the loop left the servos held"
READY = b"ready\n"
PATIENCE = 10.0  # [s] that it goes on trying to reach port and servos
AT_REST = 2.0  # [s] that the loop may take to bring the servos to rest itself
PAUSE = 0.002  # [s] between two tries to get the port: the dead loop's lock goes with its last file
LOOK = 0.5  # [s] between two looks at servos that are held
ASKING = 0.05  # [s] between two looks whether a person still waits
STARTING = 60.0  # [s] that the process may take to start

Rest = Literal["release", "hold"]


@dataclass(frozen=True)
class Charge:
    """What a supervisor must know.

    Attributes:
        port, baudrate, servo, timeout: of the bus.
        ids: of the servos.
        rest: what becomes of the servos: ``release``: torque off; ``hold``: their position becomes their goal.
        silence: time without a beat at which the loop counts as hanging [s].
        loop: process id of the loop, which is killed before the port is taken from it.
        events: file for events, of the run's log; None: nowhere.
        patience: time that it goes on trying to reach port and servos [s].
        others: further buses of the robot; each a mapping of bus, port, baudrate, servo, ids.
    """

    port: str
    baudrate: int
    servo: str
    timeout: float
    ids: list[int]
    rest: Rest
    silence: float
    loop: int
    events: str | None = None
    patience: float = PATIENCE
    others: list[dict[str, Any]] = field(default_factory=list)

    def lines(self) -> list[tuple[str, Opening, list[int]]]:
        """Each bus: its name, what opens it, and the ids of its servos."""
        first = Opening(self.port, self.baudrate, self.servo, self.timeout)
        rest = [
            (row["bus"], Opening(row["port"], row["baudrate"], row["servo"], self.timeout), row["ids"])
            for row in self.others
        ]
        return [("", first, self.ids), *rest] if self.ids else rest


@dataclass(frozen=True)
class Opening:
    """How to open a bus.

    Attributes:
        port, baudrate, servo, timeout: as of :class:`~sealegs.hw.bus.ServoBus`.
    """

    port: str
    baudrate: int
    servo: str
    timeout: float

    def __call__(self) -> ServoBus:
        """The bus, open.

        Raises:
            PortError: it cannot be opened.
        """
        return ServoBus(self.port, self.baudrate, self.servo, self.timeout)


def bring_to_rest(bus: Bus, ids: Sequence[int], rest: Rest, failing: Failing | None = None) -> dict[int, BusError]:
    """Release or hold every servo that can be reached, whatever fails on the others.

    Args:
        bus: open.
        ids: of the servos.
        rest: what becomes of them.
        failing: called with servos and reason as soon as one has failed, before the others are tried.

    Returns:
        Why, for each servo of which it is not sure.
    """
    if rest == "release":
        return dict(bus.torque_off(ids, failing))
    failed: dict[int, BusError] = {}
    for servo in ids:
        try:
            bus.hold([servo])
        except BusError as error:
            failed[servo] = error
            if failing is not None:
                failing([servo], error)
    return failed


class Supervisor:
    """The loop's end of it."""

    def __init__(self, charge: Charge) -> None:
        """Start the process and wait until it watches.

        Raises:
            PortError: it does not start.
        """
        self._patience = charge.patience
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "sealegs.hw.supervisor"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # a Ctrl-C in the terminal is the loop's business
        )
        assert self._process.stdin is not None and self._process.stdout is not None
        self._pipe = self._process.stdin
        self._pipe.write(json.dumps(asdict(charge)).encode() + b"\n")
        self._pipe.flush()
        ready, _, _ = select.select([self._process.stdout], [], [], STARTING)
        if not ready or self._process.stdout.readline() != READY:
            self._process.kill()
            raise PortError(
                "the supervisor that guards the servos does not start; without it no torque is switched on."
            )
        os.set_blocking(self._pipe.fileno(), False)

    def beat(self) -> bool:
        """Say that the loop is alive; never blocks. False: nobody listens any more."""
        return self._say(BEAT)

    def resting(self) -> None:
        """Say that the loop has ended and brings the servos to rest, which may take longer than a cycle."""
        self._say(RESTING)

    @property
    def pid(self) -> int:
        """Number of its process."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether it watches."""
        return self._process.poll() is None

    def dismiss(self) -> None:
        """Say that the servos are at rest and the port is closed; the process ends."""
        self._say(DONE)
        self._finish(lambda: False)

    def leave_held(self) -> int:
        """Say that the servos are held and the port is closed; the process goes on watching them.

        Returns:
            Its id: ``kill <id>`` makes it release the servos.
        """
        self._say(HELD)
        with contextlib.suppress(OSError):
            self._pipe.close()
        if self._process.stdout is not None:
            self._process.stdout.close()
        return self._process.pid

    def call(self, give_up: Callable[[], bool] = lambda: False) -> None:
        """Hand the servos over, because bringing them to rest failed; waits for the supervisor's tries.

        Args:
            give_up: asked meanwhile: whether a person ends the wait. The supervisor goes on alone then.
        """
        self._finish(give_up)

    def _say(self, word: bytes) -> bool:
        with contextlib.suppress(BlockingIOError):  # the pipe is full: it listens, but has not read for long
            try:
                os.write(self._pipe.fileno(), word)
            except BrokenPipeError:
                return False
        return True

    def _finish(self, give_up: Callable[[], bool]) -> None:
        with contextlib.suppress(OSError):
            self._pipe.close()
        end = time.monotonic() + self._patience + 2.0
        while time.monotonic() < end and not give_up():
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(ASKING)
                break
        if self._process.stdout is not None:
            self._process.stdout.close()


def watch(charge: Charge, pipe: int) -> tuple[str, bool] | None:
    """Wait for the end of the loop.

    Returns:
        None where the loop brought the servos to rest; else what happened, and whether the loop hangs.
    """
    patience: float | None = None
    last = b""
    while True:
        ready, _, _ = select.select([pipe], [], [], patience)
        if not ready:
            return f"the loop was silent for {patience:g} s", True
        data = os.read(pipe, 4096)
        if not data and last == HELD:
            return LEFT_HELD, False
        if not data:
            return None if last == DONE else ("the loop ended without bringing the servos to rest", False)
        last = data[-1:]
        patience = AT_REST if last == RESTING else charge.silence


def take_over(charge: Charge, why: str, hangs: bool) -> None:
    """Bring the servos to rest, and write down what became of it."""
    started = time.monotonic()
    note(charge, "supervisor", why=why, rest=charge.rest)
    if hangs and os.getppid() == charge.loop:  # it must not wake up and command the servos again
        with contextlib.suppress(ProcessLookupError):
            os.kill(charge.loop, signal.SIGKILL)
    left = {name: (opening, ids) for name, opening, ids in charge.lines()}
    lost: dict[str, list[int]] = {}
    reason = ""
    while left and time.monotonic() < started + charge.patience:
        pause = PAUSE
        for name, (opening, ids) in list(left.items()):  # one adapter that is gone keeps no other servo waiting
            try:
                with opening() as bus:
                    failed = bring_to_rest(bus, ids, charge.rest)
            except PortError as error:
                reason, lost[name] = str(error), lost.get(name, ids)
                continue
            if not failed:
                del left[name]
                continue
            reason, lost[name] = str(next(iter(failed.values()))), sorted(failed)
            pause = 20 * PAUSE
        if left:
            time.sleep(pause)
    took = round(time.monotonic() - started, 4)
    if not left:
        note(charge, "at rest", by="supervisor", rest=charge.rest, seconds=took)
        return
    servos = [f"{name}:{servo}" if name else servo for name in left for servo in lost.get(name, left[name][1])]
    note(charge, "not at rest", by="supervisor", servos=servos, reason=reason, seconds=took)


def hold_watched(charge: Charge) -> None:
    """Look at servos that are held now and then, and release them where one reports a fault, or on SIGTERM.

    Ends when their torque is off, or the port belongs to another program, or is gone.
    """
    nowhere = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):  # whoever reads what the loop printed must not wait for this process
        os.dup2(nowhere, descriptor)
    asked = list[int]()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: asked.append(number))
    while True:
        why = "asked to" if asked else None
        try:
            with contextlib.ExitStack() as stack:
                open_now = [(stack.enter_context(opening()), ids) for _, opening, ids in charge.lines()]
                states = [bus.read_state(ids, whole=True) for bus, ids in open_now]
                if not any(state.torque is not None and (state.torque == 1).any() for state in states):
                    return
                why = why or next((str(fault) for state in states for fault in state.faults()), None)
                if why is not None and not [bus for bus, ids in open_now if bus.torque_off(ids)]:
                    note(charge, "at rest", by="supervisor", rest="release", why=why)
                    return
        except PortError:
            return
        except BusError:
            pass  # another look follows
        time.sleep(ASKING if asked or why else LOOK)


def note(charge: Charge, kind: str, **details: object) -> None:
    """Append an event to the run's."""
    if charge.events is None:
        return
    line = json.dumps({"monotonic": round(time.monotonic(), 6), "event": kind, **details}) + "\n"
    with contextlib.suppress(OSError), open(charge.events, "ab", buffering=0) as file:
        file.write(line.encode())
        os.fsync(file.fileno())


def main(read_line: Callable[[], bytes]) -> None:
    """Serve one loop."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # it ends with its loop, not before
    charge = Charge(**json.loads(read_line()))
    sys.stdout.buffer.write(READY)
    sys.stdout.buffer.flush()
    end = watch(charge, sys.stdin.fileno())
    if end is None:
        return
    if end[0] != LEFT_HELD:
        take_over(charge, *end)
    if charge.rest == "hold":
        hold_watched(charge)


if __name__ == "__main__":
    main(lambda: os.read(0, 65536))
