"""Dynamixel protocol 2, over the manufacturer's SDK."""

from __future__ import annotations

from ....common.extras import needed_for
from ..port import BusPort
from .dialect import Reply

with needed_for("the Dynamixel protocol"):
    import dynamixel_sdk as sdk

ID, PARAMETERS, ERROR, DATA = 4, 8, 8, 9  # places in a packet
ALERT, GARBLED = 0x80, 3
REFUSALS = {
    1: "it could not process the request",
    2: "it does not know the instruction",
    4: "the value is outside what the register takes, or its bus watchdog has stopped it",
    5: "the value has another length than the register",
    6: "the value is outside the limits that are set in the servo",
    7: "the register cannot be written, or not while torque is on",
}


class DynamixelDialect:
    """Packets of Dynamixel protocol 2: two bytes of addresses and lengths, a CRC, byte stuffing."""

    overhead = 11
    own_length = 3
    longest = 1000
    chained = True  # assumed: each waits for the packet of the one before
    rates: tuple[int, ...] = (9600, 57600, 115200, 1000000, 2000000, 3000000, 4000000)

    def __init__(self) -> None:
        self._sdk = sdk.PacketHandler(2.0)

    def block(self, address: int, length: int) -> list[int]:
        return [*address.to_bytes(2, "little"), *length.to_bytes(2, "little")]

    def place(self, address: int) -> list[int]:
        return [*address.to_bytes(2, "little")]

    def request(self, target: int, instruction: int, parameters: list[int]) -> list[int]:
        length = (len(parameters) + 3).to_bytes(2, "little")
        return [0xFF, 0xFF, 0xFD, 0, target, *length, instruction, *parameters, 0, 0]

    def send(self, port: BusPort, request: list[int]) -> None:
        self._sdk.txPacket(port, request)  # pyright: ignore[reportAttributeAccessIssue]

    def receive(self, port: BusPort) -> tuple[Reply | None, bool]:
        packet, result = self._sdk.rxPacket(port, False)  # pyright: ignore[reportAttributeAccessIssue, reportCallIssue]
        if result != sdk.COMM_SUCCESS:
            return None, result == sdk.COMM_RX_TIMEOUT
        length = packet[5] | packet[6] << 8  # without the bytes that were stuffed
        return Reply(packet[ID], packet[ERROR], list(packet[DATA : 5 + length]), list(packet)), False

    def refusal(self, error: int) -> str | None:
        number = error & ~ALERT
        return REFUSALS.get(number, f"error {number}") if number else None

    def garbled(self, error: int) -> bool:
        return error & ~ALERT == GARBLED

    def alert(self, error: int) -> bool:
        return bool(error & ALERT)
