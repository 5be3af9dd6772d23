"""The wire between host and servos: who answers what, when the bytes arrive, and what faults do to them."""

from __future__ import annotations

import dataclasses
import random
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...common.documents import DocumentError, read_yaml
from ...common.errors import SealegsError, nearest
from . import protocol, protocol2
from .dynamixel import DynamixelServo
from .protocol import BROADCAST, Request
from .rig import Rig
from .servo import Servo

KINDS = {
    "drop": "replies are lost",
    "corrupt": "a bit of a reply is flipped",
    "garble": "a bit of a request is flipped where it reaches a servo: a Dynamixel says so, others keep quiet",
    "short": "a reply lacks its last data bytes, with a right checksum",
    "late": "replies come so many 'delay' seconds late",
    "silence": "a servo does not hear and does not answer; it holds what it was told last",
    "echo": "the adapter returns what the host sends",
    "unplug": "the adapter is gone; servos keep what they were told last; it comes back as 'name' where one is given",
    "overheat": "a servo measures 'value' degC",
    "brown_out": "the supply has 'value' volts; below 3.3 V the servos restart with torque off",
    "restart": "a servo restarts with torque off and is silent for 'value' seconds (0.8)",
    "frozen": "a servo's position sensor stays at what it read last, for its own control too",
    "unsigned": "a servo reports its current without its sign, as some firmware does",
    "locked": "a servo's lock register stays at 1, so that nothing written to its EEPROM persists",
    "forgetful": "a servo's lock register can be opened, and yet it keeps nothing without power",
    "limp": "a servo's torque register becomes 0 by itself",
    "imu_silence": "the IMU sends nothing",
    "overload": "a servo is latched in overload until its torque is switched off",
}
DEFAULTS = {"overheat": 80.0, "brown_out": 3.8, "restart": 0.8}
ONCE = ("restart", "limp")
"""Kinds that happen once to each servo."""


class FaultError(SealegsError):
    """A fault that does not exist or cannot be so."""


@dataclass
class Fault:
    """One fault.

    Attributes:
        kind: of :data:`KINDS`.
        servos: ids concerned; empty: all.
        at: when it begins, on the machine's clock [s].
        seconds: how long it lasts; None: for good.
        count: how many replies or requests it spoils at most; None: all.
        probability: with which it spoils one.
        delay: of late replies [s].
        value: temperature [degC], voltage [V] or time [s] where the kind has one; None: 80 degC, 3.8 V, 0.8 s.
        bus: name of the line concerned; None: all.
        name: link under which an adapter comes back; None: as before.
        done: servos to which a fault of :data:`ONCE` has happened.
    """

    kind: str
    servos: tuple[int, ...] = ()
    at: float = 0.0
    seconds: float | None = None
    count: int | None = None
    probability: float = 1.0
    delay: float = 0.05
    value: float | None = None
    bus: str | None = None
    name: str | None = None
    done: set[int] = field(default_factory=set, init=False, repr=False)

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise FaultError(
                f"there is no fault '{self.kind}'{nearest(self.kind, KINDS)}; there are {', '.join(KINDS)}."
            )
        self.servos = tuple(int(servo) for servo in self.servos)
        if not isinstance(self.name, str | None):
            raise FaultError(f"the fault '{self.kind}' takes a path as 'name', not {self.name!r}.")
        if self.value is None:
            self.value = DEFAULTS.get(self.kind)

    def active(self, now: float) -> bool:
        """Whether the fault is there at ``now`` [s]."""
        if now < self.at - 1e-9 or (self.count is not None and self.count <= 0):
            return False
        return self.seconds is None or now < self.at + self.seconds

    def over(self, now: float) -> bool:
        """Whether it will not come back."""
        spent = self.count is not None and self.count <= 0
        return spent or (self.seconds is not None and now >= self.at + self.seconds)

    def concerns(self, servo: int) -> bool:
        """Whether a servo is concerned."""
        return not self.servos or servo in self.servos


def fault_from(row: Any, now: float = 0.0) -> Fault:
    """A fault from its mapping; ``at`` counts from ``now`` [s].

    Raises:
        FaultError: an unknown kind or key, or a value of the wrong type.
    """
    if not isinstance(row, Mapping) or "kind" not in row:
        raise FaultError(f"a fault is a mapping with at least its 'kind', not {row!r}.")
    known = {item.name for item in dataclasses.fields(Fault) if item.init}
    for key in row:
        if key not in known:
            raise FaultError(f"a fault has no '{key}'{nearest(str(key), known)}; it has {', '.join(sorted(known))}.")
    values = {str(key): value for key, value in row.items() if value is not None}
    servos = values.get("servos", [])
    values["servos"] = [servos] if isinstance(servos, int) else servos
    for key in ("at", "seconds", "count", "probability", "delay", "value"):
        if key in values and (isinstance(values[key], bool) or not isinstance(values[key], int | float)):
            raise FaultError(f"the fault '{row['kind']}' takes a number as '{key}', not {values[key]!r}.")
    values["at"] = float(values.get("at", 0.0)) + now
    try:
        return Fault(**values)
    except (TypeError, ValueError, OverflowError) as error:
        if isinstance(error, FaultError):
            raise
        raise FaultError(f"the fault '{row['kind']}' cannot be read: {error}.") from None


def read_faults(path: str | Path) -> list[Fault]:
    """The faults of a YAML file, a list of mappings.

    Raises:
        FaultError: the file cannot be read or holds something else.
    """
    try:
        rows = read_yaml(path, f"the fault file {path}")
    except DocumentError as error:
        raise FaultError(f"{error}.") from None
    if not isinstance(rows, list):
        raise FaultError(f"the fault file {path} must hold a list of faults such as '- {{kind: drop, at: 2.0}}'.")
    return [fault_from(row) for row in rows]


def first(faults: Iterable[Fault], kind: str, now: float, servo: int | None = None) -> Fault | None:
    """The first active fault of a kind that concerns a servo (None: any), or None."""
    for fault in faults:
        if fault.kind == kind and fault.active(now) and (servo is None or fault.concerns(servo)):
            return fault
    return None


AnyServo = Servo | DynamixelServo

BITS = 10  # on the line per byte: start, eight, stop
PROCESSING = 20e-6  # [s] from a request's end to the reply's start, beside the return delay register; assumed
UNEVEN = 4e-6  # [s] by which servos of one id begin their replies apart, at most; assumed: firmware polls the line
SAMPLES = 8  # of the line a bit, where several send at once


def collided(packets: Sequence[tuple[float, bytes]]) -> bytes:
    """What a receiver reads where several send at once: the line is low wherever one pulls it low (assumed).

    Args:
        packets: each with the bits by which it begins after the first one.
    """
    if len(packets) == 1:
        return packets[0][1]
    starts = [round(start * SAMPLES) for start, _ in packets]
    last = max(start + BITS * SAMPLES * len(packet) for start, (_, packet) in zip(starts, packets, strict=True))
    line = bytearray(b"\1" * (last + BITS * SAMPLES))
    for start, (_, packet) in zip(starts, packets, strict=True):
        for k, byte in enumerate(packet):
            word = byte << 1  # a start bit, eight of data
            for bit in range(9):
                if not word >> bit & 1:
                    at = start + (k * BITS + bit) * SAMPLES
                    line[at : at + SAMPLES] = bytes(SAMPLES)
    read, at = bytearray(), line.find(0)
    while 0 <= at < last:
        middle = at + SAMPLES // 2
        read.append(sum(line[middle + (bit + 1) * SAMPLES] << bit for bit in range(8)))
        high = line.find(1, middle + 9 * SAMPLES)  # at the stop bit, or where the line is free again
        at = line.find(0, high) if high >= 0 else -1
    return bytes(read)


class Wire:
    """The half-duplex line of a rig.

    Attributes:
        rig: servos and machine.
        bus: name of the line; servos on others neither hear nor answer.
        servos: on it.
        faults: in force or to come.
        free_at: when the line is free again [s].
        heard: requests so far.
        uneven: by which servos of one id begin their replies apart, at most [s].
    """

    def __init__(self, rig: Rig, faults: Sequence[Fault] = (), seed: int = 0, bus: str = "") -> None:
        self.rig, self.bus = rig, bus
        self.servos = [servo for servo in rig.servos if servo.bus == bus]
        self.dynamixel = rig.models[bus].protocol == "dynamixel"
        self._protocol = protocol2 if self.dynamixel else protocol
        self.faults = [fault for fault in faults if fault.bus in (None, bus)]
        self.free_at = 0.0
        self.heard, self.uneven = 0, UNEVEN
        self._random = random.Random(seed)

    def byte_time(self, baudrate: int) -> float:
        """Of one byte [s]."""
        return BITS / baudrate

    def exchange(self, request: Request, now: float, baudrate: int) -> list[tuple[float, bytes]]:
        """Carry a request to the servos at ``now`` [s]; the packets that come back, and when each has."""
        per_byte = self.byte_time(baudrate)
        self.heard += 1
        arrival = max(now, self.free_at) + request.size * per_byte
        self.free_at = arrival
        self.rig.advance(arrival)
        self.apply_faults(arrival)
        self.rig.sense()
        answers: list[tuple[float, bytes]] = []
        at = arrival + PROCESSING
        for servo in self.servos:
            if self._hears(servo, arrival, baudrate):
                servo.hear(arrival)
        if request.instruction == protocol2.FAST_SYNC_READ and self.dynamixel:
            answers = self._fast_sync_read(request.parameters, arrival, baudrate, at)
            at = max([at, *(time for time, _ in answers)])
        else:
            for group in self._answers(request, arrival, baudrate):
                apart = [self._random.uniform(0.0, self.uneven) for _ in group] if len(group) > 1 else [0.0]
                delays = [servo.reply_delay + more for (servo, _, _), more in zip(group, apart, strict=True)]
                packets = [self._protocol.status_packet(servo.id, error, data) for servo, error, data in group]
                begin = min(delays)
                bits = [(delay - begin) * baudrate for delay in delays]
                packet = collided(list(zip(bits, packets, strict=True)))
                at += max(delay + len(packet) * per_byte for delay, packet in zip(delays, packets, strict=True))
                answers += self._spoiled(group[0][0].id, packet, at)
        self.rig.apply()
        if answers:
            self.free_at = max(self.free_at, at)
        return answers

    # --- who answers -------------------------------------------------------------------------------------------

    def requests(self, stream: bytearray) -> list[Request]:
        """The complete requests at the head of ``stream``, which loses them."""
        return self._protocol.take_requests(stream)

    def _answers(self, request: Request, now: float, baudrate: int) -> list[list[tuple[AnyServo, int, bytes]]]:
        """Who answers what, in the order of the replies; servos that answer at the same time stand together."""
        hearing = [servo for servo in self.servos if self._hears(servo, now, baudrate)]
        garbled = [servo for servo in hearing if self._garbled(servo, now)]
        code, data = request.instruction, request.parameters
        if code == protocol.SYNC_WRITE:
            self._sync_write([servo for servo in hearing if servo not in garbled], data, now)
            return []
        if code == protocol.SYNC_READ:
            return self._sync_read(hearing, garbled, data, now)
        answers: dict[int, list[tuple[AnyServo, int, bytes]]] = {}
        for servo in hearing:
            if request.target not in (servo.id, BROADCAST):
                continue
            name = servo.id
            reply = self._complaint if servo in garbled else servo.execute(code, data, now)
            if reply is not None and (request.target == name or code == protocol.PING):
                answers.setdefault(name, []).append((servo, *reply))
        return [answers[name] for name in sorted(answers)]

    def _block(self, data: bytes) -> tuple[int, int, bytes]:
        """Address and length of a block of memory, and what follows them."""
        width = 2 if self.dynamixel else 1
        address, length = (int.from_bytes(data[k * width : (k + 1) * width], "little") for k in (0, 1))
        return address, length, data[2 * width :]

    def _sync_read(
        self, hearing: list[AnyServo], garbled: list[AnyServo], data: bytes, now: float
    ) -> list[list[tuple[AnyServo, int, bytes]]]:
        start, length, ids = self._block(data)
        answers = []
        for number in ids:
            found = [servo for servo in hearing if servo.id == number and servo.model.sync_read]
            if not found and self.dynamixel:
                break  # assumed: each waits for the packet of the one before
            replies = [(s, self._complaint if s in garbled else s.answer(start, length, now)) for s in found]
            if said := [(servo, *reply) for servo, reply in replies if reply is not None]:
                answers.append(said)
        return answers

    def _fast_sync_read(self, data: bytes, now: float, baudrate: int, at: float) -> list[tuple[float, bytes]]:
        start, length, ids = self._block(data)
        hearing = {servo.id: servo for servo in self.servos if self._hears(servo, now, baudrate)}
        parts = [(servo, *servo.answer(start, length, now)) for n in ids if (servo := hearing.get(n)) is not None]
        if not parts or [servo.id for servo, _, _ in parts] != list(ids):
            return []  # assumed: who is missing leaves the one packet without an end
        packet = protocol2.fast_packet([(servo.id, error, block) for servo, error, block in parts])
        at += sum(servo.reply_delay for servo, _, _ in parts) + len(packet) * self.byte_time(baudrate)
        return self._spoiled(parts[0][0].id, packet, at)

    def _sync_write(self, hearing: list[AnyServo], data: bytes, now: float) -> None:
        start, length, rows = self._block(data)
        if not rows or len(rows) % (length + 1):
            return
        for k in range(0, len(rows), length + 1):
            for servo in hearing:
                if servo.id == rows[k]:
                    servo.write(start, rows[k + 1 : k + 1 + length], now)

    def _hears(self, servo: AnyServo, now: float, baudrate: int) -> bool:
        right = abs(servo.baudrate - baudrate) <= 0.03 * servo.baudrate
        return right and now >= servo.silent_until and first(self.faults, "silence", now, servo.id) is None

    # --- faults ------------------------------------------------------------------------------------------------

    @property
    def _complaint(self) -> tuple[int, bytes] | None:
        """What a servo says to a request with a wrong checksum; Feetech's say nothing (assumed)."""
        return (protocol2.CHECKSUM, b"") if self.dynamixel else None

    def _garbled(self, servo: AnyServo, now: float) -> bool:
        """Whether a request reaches a servo with a flipped bit."""
        fault = first(self.faults, "garble", now, servo.id)
        if fault is None or self._random.random() >= fault.probability:
            return False
        if fault.count is not None:
            fault.count -= 1
        return True

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
                packet = self._protocol.shortened(packet)
            else:
                at += fault.delay
        return [(at, packet)]

    def apply_faults(self, now: float) -> None:
        """Bring the faults of servos and IMU into force; forget what is over."""
        if self.rig.machine.imu is not None and not self.bus:
            self.rig.machine.imu.silent = first(self.faults, "imu_silence", now) is not None
        for servo in self.servos:
            hot = first(self.faults, "overheat", now, servo.id)
            servo.forced_temperature = hot.value if hot else None
            low = first(self.faults, "brown_out", now, servo.id)
            self.rig.volts[servo.joint] = low.value if low else None
            servo.freeze(first(self.faults, "frozen", now, servo.id) is not None)
            servo.unsigned = first(self.faults, "unsigned", now, servo.id) is not None
            servo.locked = first(self.faults, "locked", now, servo.id) is not None
            servo.forgetful = first(self.faults, "forgetful", now, servo.id) is not None
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
