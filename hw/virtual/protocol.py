"""The servos' side of the protocol: requests out of a stream of bytes, status packets into it."""

from __future__ import annotations

from dataclasses import dataclass

BROADCAST = 254
PING, READ, WRITE, REG_WRITE, ACTION = 0x01, 0x02, 0x03, 0x04, 0x05
RESTORE, REBOOT, BACKUP, RESET, CALIBRATE = 0x06, 0x08, 0x09, 0x0A, 0x0B
SYNC_READ, SYNC_WRITE = 0x82, 0x83
LONGEST = 250  # largest LEN byte of a request


@dataclass(frozen=True)
class Request:
    """One request of the host.

    Attributes:
        target: id that it is for.
        instruction: code.
        parameters: bytes behind the instruction.
        size: bytes on the wire.
    """

    target: int
    instruction: int
    parameters: bytes
    size: int


def checksum(content: bytes) -> int:
    """Low byte of NOT of the sum over id, length, instruction or error, and parameters."""
    return ~sum(content) & 0xFF


def status_packet(servo: int, error: int, data: bytes = b"") -> bytes:
    """A servo's reply."""
    content = bytes((servo, len(data) + 2, error)) + data
    return b"\xff\xff" + content + bytes((checksum(content),))


def shortened(reply: bytes) -> bytes:
    """A reply without its last data byte, with a right checksum."""
    return status_packet(reply[2], reply[4], reply[5:-2])


def take_requests(stream: bytearray) -> list[Request]:
    """The complete requests at the head of ``stream``, which loses them; those with a wrong checksum are dropped."""
    found = []
    while True:
        start = stream.find(b"\xff\xff")
        if start < 0:
            del stream[: max(len(stream) - 1, 0)]
            return found
        del stream[:start]
        while len(stream) > 2 and stream[2] == 0xFF:  # more than two header bytes
            del stream[0]
        if len(stream) < 4:
            return found
        size = stream[3] + 4
        if not 2 <= stream[3] <= LONGEST:
            del stream[:2]
            continue
        if len(stream) < size:
            return found
        if checksum(bytes(stream[2 : size - 1])) != stream[size - 1]:
            del stream[:2]
            continue
        found.append(Request(stream[2], stream[4], bytes(stream[5 : size - 1]), size))
        del stream[:size]
