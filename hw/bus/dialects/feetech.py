"""Feetech's protocol, over the manufacturer's SDK."""

from __future__ import annotations

import scservo_sdk as sdk

from ..port import RATES, BusPort
from .dialect import Reply

ID, ERROR, DATA = 2, 4, 5  # places in a packet


class FeetechDialect:
    """Packets of Feetech's STS and SCS servos; a byte of addresses, a byte as check, faults in every reply."""

    overhead = 6
    own_length = 2
    longest = 250
    chained = False
    rates: tuple[int, ...] = RATES

    def __init__(self) -> None:
        self._sdk = sdk.PacketHandler(0)  # bytes of words are ours to order

    def block(self, address: int, length: int) -> list[int]:
        return [address, length]

    def place(self, address: int) -> list[int]:
        return [address]

    def request(self, target: int, instruction: int, parameters: list[int]) -> list[int]:
        return [0xFF, 0xFF, target, len(parameters) + 2, instruction, *parameters, 0]

    def send(self, port: BusPort, request: list[int]) -> None:
        self._sdk.txPacket(port, request)

    def receive(self, port: BusPort) -> tuple[Reply | None, bool]:
        packet, result = self._sdk.rxPacket(port)
        if result != sdk.COMM_SUCCESS:
            return None, result == sdk.COMM_RX_TIMEOUT
        return Reply(packet[ID], packet[ERROR], packet[DATA:-1], packet), False

    def refusal(self, error: int) -> str | None:
        del error  # it says how the servo is, not what became of the request
        return None

    def garbled(self, error: int) -> bool:
        del error
        return False

    def alert(self, error: int) -> bool:
        del error
        return False
