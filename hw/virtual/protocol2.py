"""The servos' side of Dynamixel protocol 2: requests out of a stream of bytes, status packets into it.

Written from the protocol's description in ROBOTIS' e-Manual; shares no code with their SDK.
"""

from __future__ import annotations

from collections.abc import Sequence

from .protocol import BROADCAST, Request

HEADER = b"\xff\xff\xfd"
STATUS = 0x55
CLEAR, FAST_SYNC_READ = 0x10, 0x8A
LONGEST = 1000  # largest length of a request
POLYNOMIAL = 0x8005
ALERT = 0x80
RESULT_FAIL, INSTRUCTION, CHECKSUM, RANGE, LENGTH, LIMIT, ACCESS = 1, 2, 3, 4, 5, 6, 7
"""Numbers in the error byte."""


def _table() -> list[int]:
    rows = []
    for byte in range(256):
        value = byte << 8
        for _ in range(8):
            value = (value << 1) ^ POLYNOMIAL if value & 0x8000 else value << 1
        rows.append(value & 0xFFFF)
    return rows


TABLE = _table()


def crc(data: bytes, start: int = 0) -> int:
    """CRC-16 of the protocol: polynomial 0x8005, nothing reflected."""
    value = start
    for byte in data:
        value = (value << 8 & 0xFFFF) ^ TABLE[(value >> 8) ^ byte]
    return value


def stuffed(content: bytes) -> bytes:
    """What stands between length and CRC, with a byte added where it looks like a header."""
    return content.replace(HEADER, HEADER + b"\xfd")


def packet(servo: int, content: bytes) -> bytes:
    """A whole packet around instruction and parameters."""
    body = stuffed(content)
    head = HEADER + bytes((0, servo)) + (len(body) + 2).to_bytes(2, "little") + body
    return head + crc(head).to_bytes(2, "little")


def status_packet(servo: int, error: int, data: bytes = b"") -> bytes:
    """A servo's reply."""
    return packet(servo, bytes((STATUS, error)) + data)


def shortened(reply: bytes) -> bytes:
    """A reply without its last data byte, with a right CRC."""
    body = reply[7:-2].replace(HEADER + b"\xfd", HEADER)
    return packet(reply[4], body[:-1])


def fast_packet(answers: Sequence[tuple[int, int, bytes]]) -> bytes:
    """The one packet in which servos answer a fast sync read: (id, error, data) of each.

    Each servo ends its part with the CRC of all that was sent so far; the last one is that of the packet.
    """
    size = sum(len(data) + 4 for _, _, data in answers)
    whole = bytearray(HEADER + bytes((0, BROADCAST)) + (size + 1).to_bytes(2, "little") + bytes((STATUS,)))
    for servo, error, data in answers:
        whole += bytes((error, servo)) + data
        whole += crc(bytes(whole)).to_bytes(2, "little")
    return bytes(whole)


def take_requests(stream: bytearray) -> list[Request]:
    """The complete requests at the head of ``stream``, which loses them; those with a wrong CRC are dropped."""
    found = []
    while True:
        start = stream.find(HEADER)
        if start < 0:
            del stream[: max(len(stream) - 2, 0)]
            return found
        del stream[:start]
        if len(stream) < 7:
            return found
        length = int.from_bytes(stream[5:7], "little")
        if stream[3] == 0xFD or not 3 <= length <= LONGEST:
            del stream[:3]
            continue
        size = length + 7
        if len(stream) < size:
            return found
        if crc(bytes(stream[: size - 2])) != int.from_bytes(stream[size - 2 : size], "little"):
            del stream[:3]
            continue
        body = bytes(stream[7 : size - 2]).replace(HEADER + b"\xfd", HEADER)
        found.append(Request(stream[4], body[0], body[1:], size))
        del stream[:size]
