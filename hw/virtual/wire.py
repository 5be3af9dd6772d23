"""The wire between host and servos: who answers what, when the bytes arrive, and what faults do to them."""

from __future__ import annotations

import random
from collections.abc import Sequence

from . import protocol
from .faults import ONCE, Fault, first
from .protocol import BROADCAST, Request
from .rig import Rig
from .servo import Servo

BITS = 10  # on the line per byte: start, eight, stop
PROCESSING = 20e-6  # [s] from a request's end to the reply's start, beside the return delay register; assumed


def collided(packets: Sequence[bytes]) -> bytes:
    """What servos of one id put on the line together: it is low wherever one of them pulls it low; assumed."""
    if len(packets) == 1:
        return packets[0]
    longest = max(len(packet) for packet in packets)
    merged = bytearray(b"\xff" * longest)
    for packet in packets:
        for k, byte in enumerate(packet):
            merged[k] &= byte
    return bytes(merged)


class Wire:
    """The half-duplex line of a rig.

    Attributes:
        rig: servos and machine.
        faults: in force or to come.
        free_at: when the line is free again [s].
        requests: heard so far.
    """

    def __init__(self, rig: Rig, faults: Sequence[Fault] = (), seed: int = 0) -> None:
        self.rig = rig
        self.faults = list(faults)
        self.free_at = 0.0
        self.requests = 0
        self._random = random.Random(seed)

    def byte_time(self, baudrate: int) -> float:
        """Of one byte [s]."""
        return BITS / baudrate

    def exchange(self, request: Request, now: float, baudrate: int) -> list[tuple[float, bytes]]:
        """Carry a request to the servos at ``now`` [s]; the packets that come back, and when each has."""
        per_byte = self.byte_time(baudrate)
        self.requests += 1
        arrival = max(now, self.free_at) + request.size * per_byte
        self.free_at = arrival
        self.rig.advance(arrival)
        self.apply_faults(arrival)
        self.rig.sense()
        answers: list[tuple[float, bytes]] = []
        at = arrival + PROCESSING
        for group in self._answers(request, arrival, baudrate):
            packets = [protocol.status_packet(servo.id, servo.status(arrival), data) for servo, data in group]
            packet = collided(packets)
            servo = group[0][0]
            at += servo.get("return_delay") * 2e-6 + len(packet) * per_byte
            answers += self._spoiled(servo.id, packet, at)
        self.rig.apply()
        if answers:
            self.free_at = max(self.free_at, at)
        return answers

    # --- who answers -------------------------------------------------------------------------------------------

    def _answers(self, request: Request, now: float, baudrate: int) -> list[list[tuple[Servo, bytes]]]:
        """Who answers what, in the order of the replies; servos that answer at the same time stand together."""
        hearing = [servo for servo in self.rig.servos if self._hears(servo, now, baudrate)]
        code, data = request.instruction, request.parameters
        if code == protocol.SYNC_WRITE:
            self._sync_write(hearing, data, now)
            return []
        if code == protocol.SYNC_READ:
            if len(data) < 3:
                return []
            asked = [[servo for servo in hearing if servo.id == number] for number in data[2:]]
            return [[(servo, servo.read(data[0], data[1], now)) for servo in found] for found in asked if found]
        answers: dict[int, list[tuple[Servo, bytes]]] = {}
        for servo in hearing:
            if request.target not in (servo.id, BROADCAST):
                continue
            name = servo.id
            reply = servo.execute(code, data, now)
            if reply is not None and (request.target == name or code == protocol.PING):
                answers.setdefault(name, []).append((servo, reply))
        return [answers[name] for name in sorted(answers)]

    def _sync_write(self, hearing: list[Servo], data: bytes, now: float) -> None:
        if len(data) < 2 or (len(data) - 2) % (data[1] + 1):
            return
        width = data[1] + 1
        for k in range(2, len(data), width):
            for servo in hearing:
                if servo.id == data[k]:
                    servo.write(data[0], data[k + 1 : k + width], now)

    def _hears(self, servo: Servo, now: float, baudrate: int) -> bool:
        rates = self.rig.model.baud_rates
        index = servo.get("baud_rate")
        right = index < len(rates) and abs(rates[index] - baudrate) <= 0.03 * rates[index]
        return right and now >= servo.silent_until and first(self.faults, "silence", now, servo.id) is None

    # --- faults ------------------------------------------------------------------------------------------------

    def _spoiled(self, servo: int, packet: bytes, at: float) -> list[tuple[float, bytes]]:
        for fault in self.faults:
            if fault.kind not in ("drop", "corrupt", "short", "late"):
                continue
            if not fault.active(at) or not fault.concerns(servo) or self._random.random() >= fault.probability:
                continue
            if fault.count is not None:
                fault.count -= 1
            if fault.kind == "drop":
                return []
            if fault.kind == "corrupt":
                spoiled = bytearray(packet)
                spoiled[self._random.randrange(len(packet))] ^= 1 << self._random.randrange(8)
                packet = bytes(spoiled)
            elif fault.kind == "short":
                packet = protocol.status_packet(packet[2], packet[4], packet[5:-2])
            else:
                at += fault.delay
        return [(at, packet)]

    def apply_faults(self, now: float) -> None:
        """Bring the servos' own faults into force; forget what is over."""
        for servo in self.rig.servos:
            hot = first(self.faults, "overheat", now, servo.id)
            servo.forced_temperature = hot.value if hot else None
            low = first(self.faults, "brown_out", now, servo.id)
            self.rig.volts[servo.joint] = low.value if low else None
            servo.freeze(first(self.faults, "frozen", now, servo.id) is not None)
            servo.unsigned = first(self.faults, "unsigned", now, servo.id) is not None
            for fault in self.faults:
                if fault.kind in ONCE and fault.active(now) and fault.concerns(servo.id) and servo.id not in fault.done:
                    fault.done.add(servo.id)
                    if fault.kind == "restart":
                        servo.boot(now, fault.value or 0.0)
                    else:
                        servo.write(servo.model["torque_enable"].address, b"\0", now)
            if (overload := first(self.faults, "overload", now, servo.id)) is not None:
                servo.latched = True
                if overload.count is None and overload.seconds is None:
                    overload.seconds = 0.0  # the latch stays by itself
        self.faults = [fault for fault in self.faults if not fault.over(now)]
