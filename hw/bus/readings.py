"""What servos read: one transaction a cycle, the replies that came, a second try for the others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from .dialects import READ, SYNC_READ
from .memory import ServoMemory
from .packets import NoReplyError, ReplyError, status_of
from .port import BusPort
from .registers import ServoModel
from .servo_state import BlockReader, ServoState
from .transactions import Transactions


class ServoReadings(ServoMemory):
    """Readings of servos of one model.

    Attributes:
        status: latest error byte of each servo by id.
    """

    def __init__(self, line: Transactions, model: ServoModel) -> None:
        super().__init__(line, model)
        self.status: dict[int, int] = line.status
        self._block = BlockReader(model)
        self._latest: dict[int, list[int]] = {}
        self._blank = [0] * (self._block.start - self._block.span(True)[0])

    @property
    def clock(self) -> BusPort:
        """That replies are waited for by."""
        return self.line.port

    @property
    def timeout(self) -> float:
        """How long a reply may take beyond the time of its bytes [s]."""
        return self.line.port.reply_timeout

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
            before = self.clock.now()
            start, length = self._block.span(whole)
            replies = self._read_all(ids, start, length)
            rows = [replies[servo] for servo in ids]
            state = self._block.state(ids, rows, before, self.clock.now(), whole)
            more = self._read_all(ids, *self._block.whole) if whole and not self._block.merged else {}
            return self._with_torque(state, more if whole else None)

        return self.line.retry(read, retries)

    def _read_all(self, ids: Sequence[int], start: int, length: int, wait: float | None = None) -> dict[int, list[int]]:
        """A block of each servo, in one transaction where the servos know how; ``wait``: for a reply [s].

        Raises:
            ReplyError: of the last servo that failed; ``replies`` holds those that came.
        """
        if self.model.sync_read:
            asked = self.line.no_late_length(length)
            parameters = [*self.line.dialect.block(start, asked), *ids]
            return self.line.transact(ids, SYNC_READ, parameters, asked, wait)
        replies: dict[int, list[int]] = {}
        problem: ReplyError | None = None
        for servo in ids:
            try:
                replies |= self._read_one(servo, start, length, wait)
            except ReplyError as error:
                problem = error
                if wait is not None and isinstance(error, NoReplyError):
                    self.line.expect_nothing_more()
        if problem is not None:
            problem.replies = replies
            raise problem
        return replies

    def _read_one(self, servo: int, start: int, length: int, wait: float | None) -> dict[int, list[int]]:
        asked = self.line.no_late_length(length)
        return self.line.transact([servo], READ, self.line.dialect.block(start, asked), asked, wait)

    def _with_torque(self, state: ServoState, watched: Mapping[int, list[int]] | None) -> ServoState:
        """The state with torque and mark out of blocks of their own, and with faults that a register names.

        Args:
            state: the readings.
            watched: blocks by id, as far as they came; None: none were asked for.
        """
        more: dict[str, Any] = {}
        if watched is not None and not self._block.merged:
            rows = [self._block.watched(watched.get(servo)) for servo in state.ids]
            more = {name: np.array([row[name] for row in rows]) for name in rows[0]}
        alerts = [k for k, servo in enumerate(state.ids) if self.line.dialect.alert(self.status.get(servo, 0))]
        if alerts:
            status = state.status.copy()
            for k in alerts:
                status[k] = self._hardware_error(state.ids[k])
            more |= {"status": status, "latched": tuple(state.ids[k] for k in alerts if status[k])}
        return replace(state, **more) if more else state

    def _hardware_error(self, servo: int) -> int:
        try:
            return status_of(self.read_role(servo, "status"))
        except ReplyError as error:  # the next reading asks again
            self.line.note(error)
            return 0

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
        before = self.clock.now()
        start, length = self._block.span(whole)
        wait = self.timeout if until is None else self.line.round_trip.timeout(self.timeout)
        problem: ReplyError | None = None
        with self.line.lock:
            replies: dict[int, list[int]] = {}
            try:
                replies |= self._read_all(ids, start, length, wait)
            except ReplyError as error:
                self.line.note(error)
                problem = error
                replies |= error.replies
                if until is not None and isinstance(error, NoReplyError):
                    self.line.expect_nothing_more()  # what comes late all the same has another length
                    if not replies:
                        self.line.round_trip.nobody()
                        wait = self.line.round_trip.timeout(self.timeout)
                problem = self._ask_again(ids, replies, start, length, wait, until) or problem
            watched: dict[int, list[int]] = {}
            if whole and not self._block.merged and replies:
                try:
                    watched |= self._read_all([servo for servo in ids if servo in replies], *self._block.whole, wait)
                except ReplyError as error:
                    self.line.note(error)
                    watched |= error.replies
        missing = tuple([servo for servo in ids if servo not in replies])
        offset = self._block.start - start
        unknown = [servo for servo in missing if servo not in self._latest]
        if problem is not None and (not replies or unknown):
            problem.servos = missing
            raise problem
        replies = {servo: data[:length] for servo, data in replies.items()}
        self._latest |= {servo: data[offset:] for servo, data in replies.items()}
        rows = [replies.get(servo) or [*self._blank[:offset], *self._latest[servo]] for servo in ids]
        known = [servo in replies for servo in ids]
        state = self._block.state(ids, rows, before, self.clock.now(), whole, known)
        state = self._with_torque(state, watched if whole else None)
        if not missing or problem is None:
            return state
        problem.servos = missing
        return replace(state, missing=missing, problem=problem)

    def _ask_again(
        self,
        ids: Sequence[int],
        replies: dict[int, list[int]],
        start: int,
        length: int,
        wait: float,
        until: float | None,
    ) -> ReplyError | None:
        """Ask once more for the replies that are missing, and add those that come; the latest failure.

        Servos of which each waits for the packet of the one before are asked together, without the first that is
        missing: it may have silenced them all. Those that remain are asked one by one.
        """
        problem: ReplyError | None = None
        left, alone = [servo for servo in ids if servo not in replies], list[int]()
        while left or alone:
            if until is not None and self.clock.now() > until:
                break
            try:
                if self.line.dialect.chained and len(left) > 1:
                    alone.append(left.pop(0))
                    replies |= self._read_all(left, start, length, wait)
                else:
                    servo = left.pop(0) if left else alone.pop(0)
                    replies |= self._read_one(servo, start, length, wait)
            except ReplyError as error:
                self.line.note(error)
                problem = error
                replies |= error.replies
            left = [servo for servo in left if servo not in replies]
        return problem
