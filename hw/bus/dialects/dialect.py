"""How packets are framed on the line: the part of a servo's protocol that its manufacturer's SDK knows.

All else is the same for every protocol: what a reply is worth (:mod:`sealegs.hw.bus.transactions`), and which register
is for what (:mod:`sealegs.hw.bus.registers`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from ..port import BusPort

BROADCAST = 254
READ, WRITE, REBOOT, SYNC_READ, SYNC_WRITE = 0x02, 0x03, 0x08, 0x82, 0x83
"""Codes that both manufacturers use."""


@dataclass(frozen=True)
class Reply:
    """One packet that a servo sent.

    Attributes:
        servo: its id.
        error: byte that comes with every reply.
        data: bytes.
        whole: the packet.
    """

    servo: int
    error: int
    data: list[int]
    whole: list[int]


class Dialect(Protocol):
    """One way to frame packets.

    Attributes:
        overhead: bytes of a reply beside its data.
        own_length: bytes of data with which a reply is as long as the request for them.
        longest: bytes of a request.
        chained: whether servos answer a SYNC_READ only if the one before in the list did.
        rates: that the line can have [bit/s].
    """

    overhead: int
    own_length: int
    longest: int
    chained: bool
    rates: tuple[int, ...]

    def block(self, address: int, length: int) -> list[int]:
        """Parameters that name a block of memory."""
        ...

    def place(self, address: int) -> list[int]:
        """Parameters that name where to write."""
        ...

    def request(self, target: int, instruction: int, parameters: list[int]) -> list[int]:
        """A request that lacks its header and its check."""
        ...

    def send(self, port: BusPort, request: list[int]) -> None:
        """Discard what has come in, complete the request, and send it."""
        ...

    def receive(self, port: BusPort) -> tuple[Reply | None, bool]:
        """The next packet, and whether none came in time."""
        ...

    def refusal(self, error: int) -> str | None:
        """Why the servo did not do what was asked, from the error byte; None: it did."""
        ...

    def garbled(self, error: int) -> bool:
        """Whether the error byte says that the request came broken: it was not looked at, and can be repeated."""
        ...

    def alert(self, error: int) -> bool:
        """Whether the error byte says no more than that a register names faults."""
        ...
