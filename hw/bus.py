"""A bus of Feetech servos: one reading and one command a cycle, and torque."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from .memory import ServoMemory
from .packets import (
    BusError,
    ConfigurationError,
    NoReplyError,
    NotWrittenError,
    RegisterError,
    ReplyError,
    WrongModelError,
)
from .port import BusPort
from .registers import load_model
from .servo_state import BlockReader, ServoState
from .transactions import READ, SYNC_READ, Transactions

RECOVERY = 0.3  # [s] of torque off that clears an overload, as in huggingface/lerobot
SPEED_UNIT, SPEED_ZERO, MULTI_TURN = 4, 8, 16  # bits of register phase

Failing = Callable[[Sequence[int], BusError], None]
"""Told which servos could not be brought to rest, and why."""


class ServoBus(ServoMemory):
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
        marks: torque limit that each servo got with its torque, by id; after a restart it has another.
    """

    def __init__(
        self,
        port: str,
        baudrate: int = 1_000_000,
        model: str = "sts3215",
        timeout: float = 0.02,
        retries: int = 2,
        opened: BusPort | None = None,
    ) -> None:
        """Open the port; close it with :meth:`close`, or use the bus in a ``with``.

        Args:
            port: path, such as /dev/ttyUSB0.
            baudrate: of the bus [bit/s].
            model: name of a table in ``hw/registers``.
            timeout: how long a reply may take beyond the time of its bytes [s]; some USB adapters hold bytes for 16 ms.
            retries: further tries of a transaction whose reply was missing or unusable.
            opened: port that is open already, such as a simulated one.

        Raises:
            PortError: the port is missing, not a serial port, or (:class:`PortBusyError`) in use.
            EchoError: the adapter returns what is sent.
            RegisterError: there is no table of that name.
        """
        table = load_model(model)
        super().__init__(Transactions(port, baudrate, timeout, retries, opened), table)
        self.port = port
        self._block = BlockReader(table)
        self._latest: dict[int, list[int]] = {}
        self._blank = [0] * (self._block.start - self._block.whole)
        self.counts: Counter[str] = self.line.counts
        self.events: deque[tuple[float, BusError]] = self.line.events
        self.status: dict[int, int] = self.line.status
        self.marks: dict[int, int] = {}

    def __enter__(self) -> ServoBus:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the port. Torque stays as it is."""
        self.line.close()

    @property
    def retries(self) -> int:
        """Further tries of a transaction whose reply was missing or unusable."""
        return self.line.retries

    @property
    def timeout(self) -> float:
        """How long a reply may take beyond the time of its bytes [s]."""
        return self.line.port.reply_timeout

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
            for name, fits, remedy in (
                ("response_level", lambda v: v == 1, "write 1, so that it acknowledges writes"),
                ("operating_mode", lambda v: v == 0, "write 0, position mode"),
                ("phase", lambda v: not v & MULTI_TURN, "clear bit 4, so that positions stay within one turn"),
                ("phase", lambda v: v & SPEED_UNIT, "set bit 2, so that speeds are counted in step/s"),
                ("phase", lambda v: v & SPEED_ZERO, "set bit 3, so that goal speed 0 is no limit and not a stop"),
                ("angle_resolution", lambda v: v == 1, "write 1, so that a turn has all its steps"),
            ):
                if not fits(value := self.read_register(servo, name)):
                    raise ConfigurationError(
                        f"servo {servo} has {value} in register '{name}'; {remedy} (bus.write_register).", [servo]
                    )

    # --- cycle -------------------------------------------------------------------------------------------------

    def read_state(self, ids: Sequence[int], retries: int | None = None, whole: bool = False) -> ServoState:
        """Position, velocity, duty, voltage, temperature, status and current of all servos, in one transaction.

        Args:
            ids: of the servos, each once.
            retries: other than the bus's own.
            whole: torque and goal register too; 16 bytes more of each servo.

        Raises:
            NoReplyError, CorruptReplyError, ShortReplyError, StaleReplyError: after the last try; ``servos`` names
                those whose reply is missing.
            UnpluggedError: the adapter is gone.
        """

        def read() -> ServoState:
            before = self.line.port.now()
            start, length = self._block.span(whole)
            asked = self.line.no_late_length(length)
            replies = self.line.transact(ids, SYNC_READ, [start, asked, *ids], asked)
            return self._block.state(ids, [replies[servo] for servo in ids], before, self.line.port.now(), whole)

        return self.line.retry(read, retries)

    def read_cycle(self, ids: Sequence[int], whole: bool = False, until: float | None = None) -> ServoState:
        """As :meth:`read_state`, within a control cycle: uses the replies that came, and asks again for the others.

        A reply is waited for as long as the round trips so far allow, not for the bus's whole timeout. Each servo
        whose reply is missing is asked once more, on its own, while there is time.

        Args:
            ids: of the servos, each once.
            whole: torque and goal register too.
            until: clock of the port at which nobody is asked again [s]; None: each reply may take the bus's timeout.

        Returns:
            The state; ``missing`` names the servos of which it holds an earlier one.

        Raises:
            ReplyError: no servo answered, or one is missing that has never answered.
            PortError: the port failed.
        """
        before = self.line.port.now()
        start, length = self._block.span(whole)
        wait = self.timeout if until is None else self.line.round_trip.timeout(self.timeout)
        problem: ReplyError | None = None
        with self.line.lock:
            asked = self.line.no_late_length(length)
            try:
                replies = dict(self.line.transact(ids, SYNC_READ, [start, asked, *ids], asked, wait))
            except ReplyError as error:
                self.line.note(error)
                problem, replies = error, dict(error.replies)
                if until is not None and isinstance(error, NoReplyError):
                    self.line.expect_nothing_more()  # what comes late all the same has another length
            for servo in [servo for servo in ids if servo not in replies]:
                if until is not None and self.line.port.now() > until:
                    break
                asked = self.line.no_late_length(length)
                try:
                    replies |= self.line.transact([servo], READ, [start, asked], asked, wait)
                except ReplyError as error:
                    self.line.note(error)
                    problem = error
        missing = tuple(servo for servo in ids if servo not in replies)
        offset = self._block.start - start
        unknown = [servo for servo in missing if servo not in self._latest]
        if problem is not None and (not replies or unknown):
            problem.servos = missing
            raise problem
        replies = {servo: data[:length] for servo, data in replies.items()}
        self._latest |= {servo: data[offset:] for servo, data in replies.items()}
        rows = [replies.get(servo) or [*self._blank[:offset], *self._latest[servo]] for servo in ids]
        state = self._block.state(ids, rows, before, self.line.port.now(), whole)
        if not missing or problem is None:
            return state
        problem.servos = missing
        return replace(state, missing=missing, problem=problem)

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
        step = 2.0 * np.pi / self.model.resolution
        count = len(ids)
        speeds = np.broadcast_to(np.rint(np.asarray(0.0 if velocity is None else velocity, float) / step), (count,))
        scale = self.model["acceleration"].scale * step
        ramps = np.broadcast_to(
            np.rint(np.asarray(0.0 if acceleration is None else acceleration, float) / scale), (count,)
        )
        rows = [
            self.model["acceleration"].to_bytes(int(ramps[k]))
            + goal.to_bytes(int(steps[k]))
            + self.model["goal_time"].to_bytes(0)
            + self.model["goal_velocity"].to_bytes(int(speeds[k]))
            for k in range(count)
        ]
        return self.line.send_all(self.model["acceleration"].address, ids, rows)

    def to_steps(self, position: Sequence[float] | np.ndarray) -> np.ndarray:
        """Steps of the encoder nearest to positions [rad], within its turn.

        Raises:
            RegisterError: a position is not finite.
        """
        angles = np.asarray(position, np.float64)
        if not np.isfinite(angles).all():
            raise RegisterError(f"a goal is not a finite number: {angles.tolist()}.")
        steps = np.rint(angles * (self.model.resolution / (2.0 * np.pi))) + self.model.centre
        return np.clip(steps, 0, self.model.resolution - 1).astype(int)

    # --- torque ------------------------------------------------------------------------------------------------

    def torque_on(self, ids: Sequence[int]) -> None:
        """Switch torque on where each servo stands: its goal becomes its position first, or it would jump.

        Each is marked besides, so that a restart can be told: see :attr:`marks`.

        Raises:
            BusError: a servo failed; torque is then off on all of them.
        """
        try:
            self.hold(ids)
            for servo in ids:
                self._mark(servo)
                self.write_register(servo, "torque_enable", 1)
        except BusError:
            self.torque_off(ids)
            raise

    def _mark(self, servo: int) -> None:
        """Make sure that the torque limit is another one than after power-on: a thousandth less does not show."""
        limit, full = (self.read_register(servo, name) for name in ("torque_limit", "max_torque"))
        if limit == full > 0:
            limit = full - 1
            self.write_register(servo, "torque_limit", limit)
        self.marks[servo] = limit

    def hold(self, ids: Sequence[int]) -> None:
        """Make each servo's position its goal, and make sure that the goal arrived.

        Goal speed and acceleration become 0, no limit: what another program left there would slow every later goal.

        Raises:
            NotWrittenError: a servo has another goal.
            BusError: a servo failed.
        """
        goals = np.clip(self.read_state(ids).raw["present_position"], 0, self.model.resolution - 1)
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
                try:
                    self.line.send_all(register.address, ids, [b"\0"] * len(ids))
                except BusError as error:
                    failed = dict.fromkeys(ids, error)
            if failed:
                if failing is not None:
                    failing(ids, next(iter(failed.values())))
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

    def recover(self, ids: Sequence[int]) -> None:
        """Clear an overload: torque off for a while, then on where the servos stand.

        Raises:
            BusError: a servo failed; torque is then off on all of them.
        """
        for error in self.torque_off(ids).values():
            raise error
        self.line.port.sleep(RECOVERY)
        self.torque_on(ids)
