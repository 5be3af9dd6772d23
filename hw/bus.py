"""A bus of servos: one reading and one command a cycle, and torque."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable, Sequence

import numpy as np

from .interface import Failing
from .packets import (
    BusError,
    ConfigurationError,
    NotWrittenError,
    RegisterError,
    WrongModelError,
)
from .port import BusPort
from .readings import ServoReadings
from .registers import load_model
from .transactions import Transactions

RECOVERY = 0.3  # [s] of torque off that clears an overload, as in huggingface/lerobot


class ServoBus(ServoReadings):
    """Servos of one model on one port. Every method is safe to call from several threads.

    Angles are those of the output shaft: 0 rad is the centre of the encoder's turn (step 2048), positive is the
    direction of growing steps. Joints, their directions and zeros are the calibration's business.

    Attributes:
        port: path of the port.
        model: register table in use.
        line: transactions on the port.
        counts: failures so far by the name of their class, those that a further try cured included.
        events: the latest failures, oldest first, as (host's monotonic time [s], error).
        status: latest error byte of each servo by id.
        marks: what each servo got with its torque in the register that tells a restart, by id; None: it has none.
        watchdog: time without a request after which the servos stop by themselves [s], where they can; None: never.
        threads: none but the caller's read it.
    """

    threads: Sequence[int] = ()

    def __init__(
        self,
        port: str,
        baudrate: int = 1_000_000,
        model: str = "sts3215",
        timeout: float = 0.02,
        retries: int = 2,
        opened: BusPort | None = None,
        watchdog: float | None = None,
    ) -> None:
        """Open the port; close it with :meth:`close`, or use the bus in a ``with``.

        Args:
            port: path, such as /dev/ttyUSB0.
            baudrate: of the bus [bit/s].
            model: name of a table in ``hw/registers``.
            timeout: how long a reply may take beyond the time of its bytes [s]; some USB adapters hold bytes for 16 ms.
            retries: further tries of a transaction whose reply was missing or unusable.
            opened: port that is open already, such as a simulated one.
            watchdog: time without a request after which the servos stop by themselves [s], where they can.

        Raises:
            PortError: the port is missing, not a serial port, or (:class:`PortBusyError`) in use.
            EchoError: the adapter returns what is sent.
            RegisterError: there is no table of that name.
        """
        table = load_model(model)
        super().__init__(Transactions(port, baudrate, timeout, retries, opened, table.protocol), table)
        self.port = port
        self.counts: Counter[str] = self.line.counts
        self.events: deque[tuple[float, BusError]] = self.line.events
        self.marks: dict[int, int | None] = {}
        self.watchdog = watchdog

    def __enter__(self) -> ServoBus:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the port. Torque stays as it is."""
        self.line.close()

    def adapters(self, ids: Sequence[int]) -> list[tuple[ServoBus, list[int]]]:
        """This one, and the ids."""
        return [(self, list(ids))]

    @property
    def retries(self) -> int:
        """Further tries of a transaction whose reply was missing or unusable."""
        return self.line.retries

    # --- who is there ------------------------------------------------------------------------------------------

    def check(self, ids: Sequence[int]) -> None:
        """Make sure that servos are there, of the bus's model, and set up so that the bus can work with them.

        Raises:
            NoReplyError: one does not answer.
            WrongModelError: one is of another model.
            ConfigurationError: one does not acknowledge writes, is not in position mode, or counts turns.
        """
        for servo in ids:
            if (number := self.ping(servo)) != self.model.model_number:
                raise WrongModelError(
                    f"servo {servo} reports model number {number}, but a {self.model.name} has "
                    f"{self.model.model_number}; give the right servo model.",
                    [servo],
                )
            for needed in self.model.requires:
                if not needed.met(value := self.read_register(servo, needed.register)):
                    raise ConfigurationError(
                        f"servo {servo} has {value} in register '{needed.register}'; {needed.remedy} "
                        f"(sealegs scan id={servo} set={needed.register}:<count>).",
                        [servo],
                    )

    # --- goals -------------------------------------------------------------------------------------------------

    def write_goals(
        self,
        ids: Sequence[int],
        position: Sequence[float] | np.ndarray,
        velocity: float | Sequence[float] | np.ndarray | None = None,
        acceleration: float | Sequence[float] | np.ndarray | None = None,
    ) -> float:
        """Send goals to all servos in one packet, which no servo acknowledges.

        Args:
            ids: of the servos (n,).
            position: goals (n,) [rad]; held within the turn of the encoder.
            velocity: of the move there (n,) [rad/s], 0: no limit; None: the register stays as it is.
            acceleration: of the move (n,) [rad/s2], 0: no limit; None: as velocity, 0 where that is given.

        Returns:
            Host's monotonic clock as the packet went out [s].

        Raises:
            RegisterError: a goal is not finite, or there are not as many as servos.
            UnpluggedError: the adapter is gone.
        """
        steps = self.to_steps(position)
        if len(steps) != len(ids):
            raise RegisterError(f"there are {len(steps)} goals for {len(ids)} servos.")
        return self.write_goal_steps(ids, steps, velocity, acceleration)

    def write_goal_steps(
        self,
        ids: Sequence[int],
        steps: Sequence[int] | np.ndarray,
        velocity: float | Sequence[float] | np.ndarray | None = None,
        acceleration: float | Sequence[float] | np.ndarray | None = None,
    ) -> float:
        """As :meth:`write_goals`, with goals in steps of the encoder (n,)."""
        goal = self.model["goal_position"]
        if velocity is None and acceleration is None:
            rows = [goal.to_bytes(int(step)) for step in steps]
            return self.line.send_all(goal.address, ids, rows)
        columns = {"goal_position": np.asarray(steps, np.int64)}
        for role, wanted in (("speed", velocity), ("ramp", acceleration)):
            name = self.model.role(role)
            if name is not None:
                counts = np.rint(np.asarray(0.0 if wanted is None else wanted, float) / self.model.si(name))
                columns[name] = np.broadcast_to(np.minimum(counts, self.model[name].high), (len(ids),))
            elif wanted is not None and np.any(np.asarray(wanted) > 0.0):
                raise RegisterError(f"the {self.model.name} has no register for the {role} of a move.")
        move = [self.model[name] for name in self.model.move]
        rows = [
            b"".join(item.to_bytes(int(columns[item.name][k]) if item.name in columns else 0) for item in move)
            for k in range(len(ids))
        ]
        return self.line.send_all(move[0].address, ids, rows)

    def to_steps(self, position: Sequence[float] | np.ndarray) -> np.ndarray:
        """Steps of the encoder nearest to positions [rad], within its turn.

        Raises:
            RegisterError: a position is not finite.
        """
        angles = np.asarray(position, np.float64)
        if not np.isfinite(angles).all():
            raise RegisterError(f"a goal is not a finite number: {angles.tolist()}.")
        steps = np.rint(angles * (self.model.resolution / (2.0 * np.pi))) + self.model.centre
        return np.clip(steps, 0, self.model.steps - 1).astype(int)

    # --- torque ------------------------------------------------------------------------------------------------

    def torque_on(self, ids: Sequence[int], wanted: Callable[[], bool] = lambda: True) -> bool:
        """Switch torque on where each servo stands: its goal becomes its position first, or it would jump.

        Each is marked besides, so that a restart can be told: see :attr:`marks`. Servos with a bus watchdog then watch
        for requests themselves, where :attr:`watchdog` says so.

        Args:
            ids: of the servos.
            wanted: asked before each servo, while no other thread can use the line: whether torque is still wanted. A
                thread that takes the wish back and then calls :meth:`torque_off` leaves no servo with torque.

        Returns:
            Whether torque is on; where it was no longer wanted, it is off on all of them.

        Raises:
            BusError: a servo failed; torque is then off on all of them.
        """
        try:
            if self.switch_on(ids, wanted):
                self.watch(ids)
                return True
        except BusError:
            self.torque_off(ids)
            raise
        self.torque_off(ids)
        return False

    def switch_on(self, ids: Sequence[int], wanted: Callable[[], bool] = lambda: True) -> bool:
        """As :meth:`torque_on`, without watchdogs; where it fails or is no longer wanted, torque stays as it is then.

        Raises:
            BusError: a servo failed.
        """
        if not wanted():
            return False
        self.hold(ids)
        return all(self._switch_on(servo, wanted) for servo in ids)

    def watch(self, ids: Sequence[int]) -> None:
        """Let servos that can do so stop by themselves after :attr:`watchdog` without a request.

        Raises:
            BusError: a servo failed.
        """
        self._watch(ids, self.watchdog)

    def _switch_on(self, servo: int, wanted: Callable[[], bool]) -> bool:
        self._mark(servo)
        if not wanted():  # what follows takes a while
            return False
        self.hold([servo])  # again: the servos before it may have moved its joint, or a hand has
        with self.line.lock:
            if not wanted():
                return False
            self.write_register(servo, "torque_enable", 1)
            return True

    def _mark(self, servo: int) -> None:
        """Make sure that a register is another one than after power-on: a torque limit a thousandth less, or an LED."""
        name, full = self.model.role("mark"), self.model.role("mark_full")
        if name is None:
            self.marks[servo] = None
            return
        mark = 1
        if full is not None:
            mark, largest = self.read_register(servo, name), self.read_register(servo, full)
            if mark != largest or mark <= 0:
                self.marks[servo] = mark
                return
            mark -= 1
        self.write_register(servo, name, mark)
        self.marks[servo] = mark

    def _watch(self, ids: Sequence[int], seconds: float | None) -> None:
        """Let servos that can stop by themselves after so long without a request [s]; None: never."""
        name = self.model.role("watchdog")
        if name is None:
            return
        register = self.model[name]
        count = 0 if seconds is None else min(max(math.ceil(seconds / register.scale - 1e-9), 1), register.high)
        for servo in ids:
            self.write_register(servo, name, count)

    def hold(self, ids: Sequence[int]) -> None:
        """Make each servo's position its goal, and make sure that the goal arrived.

        Goal speed and acceleration become 0, no limit: what another program left there would slow every later goal. A
        bus watchdog is switched off: it would refuse the goal, and nobody asks servos that are held very often.

        Raises:
            NotWrittenError: a servo has another goal.
            BusError: a servo failed.
        """
        self._watch(ids, None)
        goals = np.clip(self.read_state(ids).raw["present_position"], 0, self.model.steps - 1)
        register = self.model["goal_position"]

        def write() -> None:
            self.write_goal_steps(ids, goals, velocity=0.0)
            for servo, goal in zip(ids, goals, strict=True):
                if self.read_register(servo, register.name) != goal:
                    raise NotWrittenError(f"servo {servo} did not take its position as its goal; try again.", [servo])

        self._repeat_unwritten(write)

    def torque_off(self, ids: Sequence[int], failing: Failing | None = None) -> dict[int, BusError]:
        """Switch torque off on every servo that can be reached; never raises.

        All are told in one packet, twice. Then each is asked on its own, and told again where needed.

        Args:
            ids: of the servos.
            failing: called with servos and reason as soon as their release has failed, before the others are tried.

        Returns:
            Why, for each servo of which it is not sure that its torque is off.
        """
        register, failed = self.model["torque_enable"], dict[int, BusError]()
        with self.line.lock:
            for _ in range(2):
                if (lost := self.tell_off(ids)) is not None and not failed:
                    failed = dict.fromkeys(ids, lost)
                    if failing is not None:
                        failing(ids, lost)
            if failed:
                return failed
            for servo in ids:
                try:
                    if self.read_register(servo, register.name) != 0:
                        self.write_register(servo, register.name, 0)
                except BusError as error:
                    failed[servo] = error
                    if failing is not None:
                        failing([servo], error)
        return failed

    def tell_off(self, ids: Sequence[int]) -> BusError | None:
        """Tell all servos in one packet to switch torque off, which none acknowledges; why that failed, if it did."""
        try:
            self.line.send_all(self.model["torque_enable"].address, ids, [b"\0"] * len(ids))
        except BusError as error:
            return error
        return None

    def recover(self, ids: Sequence[int]) -> None:
        """Clear an overload: torque off for a while, then on where the servos stand.

        Raises:
            BusError: a servo failed; torque is then off on all of them.
        """
        for error in self.torque_off(ids).values():
            raise error
        self.clock.sleep(RECOVERY)
        self.torque_on(ids)
