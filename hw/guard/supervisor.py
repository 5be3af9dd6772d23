"""A small process that outlives the control loop: when the loop dies or hangs, it brings the servos to rest.

Left alone, most servos hold their last goal for ever. So the loop starts this process before it switches torque on,
sends it a byte each cycle, and says when it has brought the servos to rest itself. If the bytes stop without that (an
exception, a ``kill -9``, a loop that hangs), the supervisor takes the port. It releases every servo or holds it where
it is, even where another one fails. Here is the loop's end of it; :mod:`sealegs.hw.guard.supervision` is the process.
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
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

from ...common.documents import parse_json
from ..bus.adapters import Listing, Whereabouts, plugged
from ..bus.dialects import dialect_of
from ..bus.interface import Bus, Failing
from ..bus.packets import BusError, PortError, UnpluggedError, in_words
from ..bus.port import BusPort
from ..bus.registers import load_model
from ..bus.servo_bus import ServoBus

BEAT, ASKING, STARTING, RESTING, DONE, HELD, RELEASE = b".", b"a", b"s", b"r", b"d", b"h", b"o"
READY, AT_REST = b"ready\n", b"at rest\n"
PATIENCE = 10.0  # [s] that a run waits for servos that could not be brought to rest
LOOKING = 0.05  # [s] between two looks whether a person still waits
STARTS = 60.0  # [s] that the process may take to start
ENDS = 2.0  # [s] that it may take to end

Rest = Literal["release", "hold"]


@dataclass(frozen=True)
class Bearable:
    """What servos may bear for long while they are held; those of a run's limits that holding still can pass.

    Attributes:
        temperature: highest of a servo [degC].
        current: largest of a servo [A], for longer than ``current_time``.
        current_time: [s].
    """

    temperature: float
    current: float
    current_time: float


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
        patience: time that a run waits for servos that could not be brought to rest [s].
        others: further buses of the robot; each a mapping of bus, port, baudrate, servo, ids.
        lasting: whether the servos outlive the run; those of a virtual machine that it started do not.
        button: file descriptor of an emergency stop, which the supervisor looks at once the loop is over; None: none.
        bearable: beyond which held servos are released; None: at their own faults only.
        homes: where the adapters were, by name of the bus; of one that is left out, its path is all there is.
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
    lasting: bool = True
    button: int | None = None
    bearable: Bearable | None = None
    homes: dict[str, Whereabouts] = field(default_factory=dict)

    @classmethod
    def read(cls, text: bytes) -> Charge:
        """The charge that :meth:`written` wrote."""
        row = parse_json(text)
        homes = {name: Whereabouts.read(home) for name, home in row["homes"].items()}
        return cls(**{**row, "bearable": row["bearable"] and Bearable(**row["bearable"]), "homes": homes})

    def written(self) -> bytes:
        """As one line."""
        return json.dumps(asdict(self)).encode() + b"\n"

    def lines(self) -> list[Line]:
        """Each bus with servos."""
        first = {"bus": "", "port": self.port, "baudrate": self.baudrate, "servo": self.servo, "ids": self.ids}
        return [self._line(**row) for row in (first, *self.others) if row["ids"]]

    def _line(self, bus: str, port: str, baudrate: int, servo: str, ids: list[int]) -> Line:
        opening = Opening(port, baudrate, servo, self.timeout, self.homes.get(bus), ids)
        return Line(bus, opening, ids)

    def load(self) -> None:
        """Read from the disk what opening a bus needs: register tables and SDKs may be gone or changed later.

        Raises:
            SealegsError: there is no such table, or its SDK is not installed.
        """
        for servo in (self.servo, *(row["servo"] for row in self.others)):
            dialect_of(load_model(servo).protocol)


@dataclass(frozen=True)
class Opening:
    """How to open a bus, under whatever name its adapter has by then.

    Attributes:
        port, baudrate, servo, timeout: as of :class:`~sealegs.hw.bus.servo_bus.ServoBus`.
        home: where its adapter was; None: ``port`` is all there is.
        ids: of its servos, by which an adapter without a serial number and in another socket is known.
        listed: lists the adapters that are plugged in.
        opened: gives a port of this process by its path, in stepped time; None: it is opened.
    """

    port: str
    baudrate: int
    servo: str
    timeout: float
    home: Whereabouts | None = None
    ids: Sequence[int] = ()
    listed: Listing = plugged
    opened: Callable[[str], BusPort] | None = None

    def __call__(self) -> ServoBus:
        """The bus, open.

        Raises:
            PortError: it cannot be opened, or nobody knows which one it is.
        """
        paths, sure = ([self.port], True) if self.home is None else self.home.now(self.listed)
        if sure:
            return self._bus(paths[0])
        found = [bus for path in paths if (bus := self._with_our_servos(path)) is not None]
        if len(found) == 1:
            return found[0]
        for bus in found:
            bus.close()
        if found:
            raise PortError(
                f"the adapter at {self.port} is gone, and several that came since have {in_words(self.ids)}; unplug "
                "the others."
            )
        known = self.home is not None and self.home.adapter is not None and self.home.adapter.serial is not None
        where = "" if known else ", into the same socket"
        raise UnpluggedError(f"the adapter at {self.port} is gone; plug it in again{where}.")

    def _bus(self, path: str) -> ServoBus:
        opened = None if self.opened is None else self.opened(path)
        return ServoBus(path, self.baudrate, self.servo, self.timeout, opened=opened)

    def _with_our_servos(self, path: str) -> ServoBus | None:
        """The bus at a port that may be somebody else's: nothing is written there before all of ours have answered."""
        try:
            bus = self._bus(path)
        except PortError:
            return None
        try:
            if all(bus.ping(servo) == bus.model.model_number for servo in self.ids):
                return bus
        except BusError:
            pass
        bus.close()
        return None


@dataclass(frozen=True)
class Line:
    """One bus of a robot.

    Attributes:
        name: of the bus; "" is the first.
        opening: opens it.
        ids: of the servos there.
    """

    name: str
    opening: Callable[[], ServoBus]
    ids: Sequence[int]

    def named(self, servos: Sequence[int]) -> list[str]:
        """Servos as the host addresses them."""
        return [f"{self.name}:{servo}" if self.name else str(servo) for servo in servos]


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


@contextlib.contextmanager
def _passed_on(button: int | None) -> Iterator[int | None]:
    """A descriptor as another process gets it: none of those of its standard input, output and errors."""
    if button is None:
        yield None
        return
    import fcntl

    copy = fcntl.fcntl(button, fcntl.F_DUPFD, 3)
    try:
        yield copy
    finally:
        os.close(copy)


class Supervisor:
    """The loop's end of it."""

    def __init__(self, charge: Charge) -> None:
        """Start the process and wait until it watches.

        Raises:
            PortError: it does not start.
        """
        self._patience = charge.patience
        with _passed_on(charge.button) as button:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "sealegs.hw.guard.supervision"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                start_new_session=True,  # a Ctrl-C in the terminal is the loop's business
                pass_fds=() if button is None else (button,),
            )
            charge = replace(charge, button=button)
        assert self._process.stdin is not None and self._process.stdout is not None
        self._pipe, self._answers = self._process.stdin, self._process.stdout
        self._pipe.write(charge.written())
        self._pipe.flush()
        ready, _, _ = select.select([self._answers], [], [], STARTS)
        if not ready or self._answers.readline() != READY:
            self._process.kill()
            raise PortError(
                "the supervisor that guards the servos does not start; without it no torque is switched on."
            )
        os.set_blocking(self._pipe.fileno(), False)

    def beat(self) -> bool:
        """Say that the loop is alive; never blocks. False: nobody listens any more."""
        return self._say(BEAT)

    def asking(self) -> bool:
        """Say that a policy is asked for goals, so that one that never answers is named. False: nobody listens."""
        return self._say(ASKING)

    def starting(self) -> bool:
        """Say that torque comes on, servo by servo; from now on the loop is watched. False: nobody listens any more."""
        return self._say(STARTING)

    def resting(self) -> bool:
        """Say that the loop has ended and brings the servos to rest, which may take longer than a cycle.

        Returns:
            False: nobody listens any more.
        """
        return self._say(RESTING)

    def holding(self) -> bool:
        """Say that the servos are held and are to be watched from :meth:`leave_held` on. False: nobody listens."""
        return self._say(HELD)

    def release_only(self) -> None:
        """Say that the servos are to be released, whatever was to become of them: an emergency stop."""
        if not self._say(RELEASE):  # it has taken over, or watches servos that are held
            self._process.send_signal(signal.SIGUSR1)

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
        with contextlib.suppress(OSError):
            self._pipe.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(ENDS)
        self._answers.close()

    def leave_held(self) -> int:
        """The port is closed: the process takes it and watches the servos, as :meth:`holding` said.

        Returns:
            Its id: ``kill <id>`` makes it release the servos.
        """
        with contextlib.suppress(OSError):
            self._pipe.close()
        self._answers.close()
        return self._process.pid

    def call(self, give_up: Callable[[], bool] = lambda: False, left: Sequence[str] = ()) -> bool:
        """Hand the servos over, because bringing them to rest failed; waits for the supervisor's tries.

        Args:
            give_up: asked meanwhile: whether a person ends the wait. The supervisor goes on alone then.
            left: servos that are not released, where the others are; none: nothing is known of any.

        Returns:
            Whether it brought them to rest; where they are held, it goes on watching them.
        """
        if left:
            self._say(json.dumps(list(left)).encode())
        with contextlib.suppress(OSError):
            self._pipe.close()
        end = time.monotonic() + self._patience
        answer = b""
        while time.monotonic() < end and not give_up():
            if select.select([self._answers], [], [], LOOKING)[0]:
                answer = self._answers.readline()
                break
        self._answers.close()
        return answer == AT_REST

    def _say(self, word: bytes) -> bool:
        with contextlib.suppress(BlockingIOError):  # the pipe is full: it listens, but has not read for long
            try:
                os.write(self._pipe.fileno(), word)
            except (BrokenPipeError, ValueError):  # ValueError: it was called, and acts on its own
                return False
        return True
