"""Transactions on a bus of servos, over the manufacturers' SDKs.

An SDK frames and parses packets; this module decides what a reply is worth. A transaction discards old input first,
accepts a reply only if servo, length and order fit, can be repeated, and every failure has its name.
"""

from __future__ import annotations

import threading
from collections import Counter, deque
from collections.abc import Callable, Sequence
from typing import TypeVar

from .dialects import BROADCAST, SYNC_READ, SYNC_WRITE, Dialect, dialect_of
from .packets import (
    BusError,
    ClosedError,
    CorruptReplyError,
    NoReplyError,
    RefusedError,
    RegisterError,
    ReplyError,
    ShortReplyError,
    StaleReplyError,
    UnpluggedError,
    in_words,
)
from .port import BusPort

LATEST, OVERDUE = 1.0, 4  # [s] after which no answer comes any more; failed requests whose answers are still expected
USELESS = 8  # packets that are no answer, behind which the timeout counts though more come

T = TypeVar("T")


class Transactions:
    """One port, one transaction at a time.

    Attributes:
        path: of the port.
        port: the SDK's port.
        lock: held over whatever must not be interrupted by other threads.
        retries: further tries of a transaction whose reply was missing or unusable.
        counts: failures so far by the name of their class, those that a further try cured included.
        events: the latest failures, oldest first, as (host's monotonic time [s], error).
        status: latest error byte of each servo by id.
        dialect: how packets are framed.
    """

    def __init__(
        self,
        path: str,
        baudrate: int,
        timeout: float,
        retries: int,
        port: BusPort | None = None,
        protocol: str = "feetech",
    ) -> None:
        """Open the port.

        Args:
            path: of the port.
            baudrate: of the bus [bit/s].
            timeout: how long a reply may take beyond the time of its bytes [s].
            retries: further tries of a transaction whose reply was missing or unusable.
            port: that is open already, such as a simulated one; None: open ``path``.
            protocol: of the servos.

        Raises:
            PortError: as :class:`~sealegs.hw.bus.port.BusPort`.
        """
        self.path, self.retries = path, retries
        self.counts: Counter[str] = Counter()
        self.events: deque[tuple[float, BusError]] = deque(maxlen=256)
        self.status: dict[int, int] = {}
        self.lock = threading.RLock()
        self._overdue: deque[tuple[float, int]] = deque(maxlen=OVERDUE)  # (time [s], data bytes) of failed requests
        self.round_trip = RoundTrip()
        self._unsettled = False  # a reply failed: more of it may be on its way
        self._gone: UnpluggedError | None = None
        self.dialect: Dialect = dialect_of(protocol)
        self.port = BusPort(path, baudrate, timeout, self.dialect.rates) if port is None else port
        self._byte_time = 10.0 / baudrate

    def close(self) -> None:
        """Close the port."""
        with self.lock:
            self.port.closePort()

    # --- one transaction ---------------------------------------------------------------------------------------

    def send_all(self, address: int, ids: Sequence[int], rows: Sequence[bytes]) -> float:
        """Write a row of bytes to each servo in one packet, which none acknowledges.

        Returns:
            Host's monotonic clock when its last byte is on the wire [s]: then the servos heed it.

        Raises:
            RegisterError: no servo, or one twice.
            UnpluggedError, StalledError: the port failed.
        """
        check_ids(ids)
        parameters = self.dialect.block(address, len(rows[0]))
        for servo, row in zip(ids, rows, strict=True):
            parameters.append(servo)
            parameters += row
        with self.lock:
            self._require_open()
            try:
                request = self._send(BROADCAST, SYNC_WRITE, parameters)
            except Exception as error:
                raise self._named(error) from None
            return self.port.now() + len(request) * self._byte_time

    def transact(
        self, ids: Sequence[int], instruction: int, parameters: list[int], length: int, timeout: float | None = None
    ) -> dict[int, list[int]]:
        """Send a request and collect the data bytes of each servo's reply.

        Args:
            ids: that must answer; more than one for SYNC_READ only.
            instruction: code.
            parameters: of the request.
            length: data bytes that each reply must have.
            timeout: other than the port's [s].

        Raises:
            ReplyError: a reply is missing or unusable.
            UnpluggedError, StalledError: the port failed.
        """
        check_ids(ids)
        wait = self.port.reply_timeout if timeout is None else timeout
        with self.lock:
            self._require_open()
            try:
                if self._unsettled:
                    self.port.settle()
                    self._unsettled = False
                target = BROADCAST if instruction == SYNC_READ else ids[0]
                request = self._send(target, instruction, parameters)
                size = len(request) + (self.dialect.overhead + length) * len(ids)
                sent = self.port.now()
                self.port.setPacketTimeoutMillis(1e3 * (wait + size * self._byte_time))
                replies = self._collect(ids, request, length, wait)
                self.round_trip.add(max(self.port.now() - sent - size * self._byte_time, 0.0))
                return replies
            except ReplyError:
                self._unsettled = True
                self._overdue.append((self.port.now(), length))
                raise
            except Exception as error:
                self._unsettled |= isinstance(error, RefusedError) and len(ids) > 1
                raise self._named(error) from None

    def no_late_length(self, length: int) -> int:
        """Bytes to read where ``length`` are needed: as many, or the next number that no late answer can have.

        Replies say neither what they answer nor when it was asked. One that comes after its request failed, however
        late, has another length than what is asked now, and so cannot pass for the answer. Nor can the request itself,
        which some adapters return.
        """
        while self._overdue and self.port.now() - self._overdue[0][0] > LATEST:
            self._overdue.popleft()
        taken = {late for _, late in self._overdue} | {self.dialect.own_length}
        while length in taken:
            length += 1
        return length

    def _send(self, target: int, instruction: int, parameters: list[int]) -> list[int]:
        request = self.dialect.request(target, instruction, parameters)
        if len(request) > self.dialect.longest:
            raise RegisterError(f"the request is too long: {len(request)} bytes; address fewer servos at once.")
        self.dialect.send(self.port, request)
        self.port.echo.sent(request)
        self.port.is_using = False
        if self.port.discarded:
            self.note(StaleReplyError(f"{self.port.discarded} bytes came on {self.path} after their time; ignored."))
        return request

    def _collect(self, ids: Sequence[int], request: list[int], length: int, wait: float) -> dict[int, list[int]]:
        replies: dict[int, list[int]] = {}
        problem: ReplyError | None = None
        overdue = {late for _, late in self._overdue}
        spoiled: set[int] = set()  # who sent what cannot be used
        strange, broken, packets = 0, False, 0  # bytes of that; whether something had no sense; packets in all
        while len(replies) + len(spoiled) < len(ids):
            packets += 1
            if packets > len(ids) + USELESS and self.port.isPacketTimeout():  # somebody else talks without an end
                break
            reply, nothing = self.dialect.receive(self.port)
            if reply is None:
                silent = [servo for servo in ids if servo not in replies and servo not in spoiled]
                whole = (self.dialect.overhead + length) * len(replies) + strange
                broken |= not nothing or self.port.received > whole  # an SDK drops what has no header
                if broken:
                    problem = self._corrupt(silent)
                elif not (isinstance(problem, ShortReplyError) and set(problem.servos) >= set(silent)):
                    problem = self._no_reply(silent, wait)  # one whose answer was short has not been silent
                if nothing or self.port.isPacketTimeout():
                    break
                continue
            servo = reply.servo
            if reply.whole == request:  # an echo that came behind a late answer
                strange += len(request)
                continue
            if servo in replies or servo not in ids:
                problem = StaleReplyError(
                    f"servo {servo} on {self.path} answered a question that was not the latest; it was ignored.",
                    [servo],
                )
                strange += len(reply.whole)
                if replies.pop(servo, None) is not None:  # nobody knows which of the two is the answer
                    spoiled.add(servo)
                    strange += self.dialect.overhead + length
                continue
            if self.dialect.garbled(reply.error):
                problem = CorruptReplyError(
                    f"a request reached servo {servo} on {self.path} with a wrong checksum; check the wiring.", [servo]
                )
                strange += len(reply.whole)
                spoiled.add(servo)
                continue
            if (why := self.dialect.refusal(reply.error)) is not None:
                raise RefusedError(f"servo {servo} on {self.path} refuses: {why}.", [servo])
            if len(reply.data) != length:
                problem = ShortReplyError(
                    f"servo {servo} on {self.path} answered {len(reply.data)} bytes to a question for {length}; "
                    "it was ignored.",
                    [servo],
                )
                strange += len(reply.whole)
                if len(reply.data) not in overdue:  # or its answer is behind it
                    spoiled.add(servo)
                continue
            spoiled.discard(servo)
            self.status[servo] = reply.error
            replies[servo] = reply.data
        if problem is not None and len(replies) < len(ids):
            problem.replies = replies
            raise problem
        if isinstance(problem, StaleReplyError | ShortReplyError):
            self.note(problem)
        return replies

    # --- several tries -----------------------------------------------------------------------------------------

    def retry(self, transaction: Callable[[], T], retries: int | None = None, note: bool = True) -> T:
        """Try a transaction until it has a usable reply, and keep a note of every failure.

        Raises:
            BusError: of the last try; of the first, where another one cannot help.
        """
        for left in range(self.retries if retries is None else retries, -1, -1):
            try:
                with self.lock:
                    return transaction()
            except BusError as error:
                if note:
                    self.note(error)
                if not left or not isinstance(error, ReplyError):
                    raise
        raise AssertionError("unreachable")

    def note(self, error: BusError) -> None:
        """Keep a failure in ``counts`` and ``events``."""
        self.counts[type(error).__name__] += 1
        self.events.append((self.port.now(), error))

    def expect_nothing_more(self) -> None:
        """A reply is missing because nobody is there: nothing is on its way that the next request must wait for."""
        self._unsettled = False

    # --- what went wrong ---------------------------------------------------------------------------------------

    def _require_open(self) -> None:
        if self._gone is not None:
            raise self._gone
        if not self.port.is_open:
            raise ClosedError(f"the bus at {self.path} was closed; open it again.")

    def _named(self, error: Exception) -> Exception:
        """What the port raised, as an error of ours; the SDK's busy flag is freed."""
        self.port.is_using = False
        if isinstance(error, BusError):
            return error
        if (named := self.port.named(error)) is None:
            return error
        if isinstance(named, UnpluggedError):
            self._gone = named
        return named

    def _no_reply(self, missing: Sequence[int], wait: float) -> NoReplyError:
        return NoReplyError(
            f"{in_words(missing)} on {self.path} did not answer within {1e3 * wait:g} ms; check power, wiring, "
            "ids and baud rate, and that nothing else keeps the computer busy.",
            missing,
        )

    def _corrupt(self, missing: Sequence[int]) -> CorruptReplyError:
        return CorruptReplyError(
            f"a broken packet came from {in_words(missing)} on {self.path}; check the wiring, "
            "and that no two servos have one id.",
            missing,
        )


def check_ids(ids: Sequence[int]) -> None:
    """Make sure that servos are addressed, each once, by ids that a servo can have.

    Raises:
        RegisterError: they are not.
    """
    if not len(ids):
        raise RegisterError("no servo is addressed; give at least one id.")
    if len(set(ids)) != len(ids):
        raise RegisterError(f"a servo is addressed twice: {list(ids)}.")
    if min(ids) < 0 or max(ids) >= BROADCAST:
        raise RegisterError(f"{list(ids)} are not all ids of servos, which are 0 to 253.")


# --- round trips, from which the timeout of a reply follows ----------------------------------------------------------


MEAN_SHARE, SPREAD_SHARE = 0.125, 0.25  # of a new sample in mean and spread, as in RFC 6298
PATIENCE_SPREADS = 4.0  # spreads beyond the mean that a reply may take
PORT_MARGIN = 0.002  # [s] beyond that: how finely a port keeps its timeout
MIN_ROUND_TRIPS = 8  # needed before they count


class RoundTrip:
    """Mean and spread of the round trips so far.

    Attributes:
        mean: [s].
    """

    def __init__(self) -> None:
        self.mean = self._spread = 0.0
        self._count, self._patience = 0, 1.0

    def add(self, seconds: float) -> None:
        """A transaction was answered in full."""
        self._patience = 1.0
        if self._count == 0:
            self.mean, self._spread = seconds, 0.5 * seconds
        self._spread += SPREAD_SHARE * (abs(seconds - self.mean) - self._spread)
        self.mean += MEAN_SHARE * (seconds - self.mean)
        self._count += 1

    def nobody(self) -> None:
        """Nobody answered in time: the adapter may have become slower, so the next timeout is twice as long."""
        self._patience *= 2.0

    def timeout(self, longest: float) -> float:
        """How long to wait for a reply [s], at most ``longest``."""
        if self._count < MIN_ROUND_TRIPS:
            return longest
        return min(self._patience * (self.mean + PATIENCE_SPREADS * self._spread + PORT_MARGIN), longest)
