"""One reading of all servos, in counts and in SI units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .packets import BusError, ServoFaultError, faults
from .registers import ServoModel

WHOLE = ("torque_enable", "mark", "watchdog")
"""Roles of the registers that tell whether a servo still has its torque and its goals."""
QUANTITIES = (
    "position",
    "velocity",
    "duty",
    "voltage",
    "temperature",
    "status",
    "moving",
    "target",
    "current",
)


@dataclass(frozen=True)
class ServoState:
    """One reading of n servos, taken in one transaction of each bus.

    Attributes:
        ids: of the servos (n,).
        before: host's monotonic clock when the request went out [s].
        after: the same when the last reply had come in [s].
        position: of the output shaft, 0 at the centre of the encoder's turn (n,) [rad].
        velocity: (n,) [rad/s].
        duty: of the bridge, with its sign; register "load" (n,) [-1..1].
        voltage: at the servo (n,) [V].
        temperature: (n,) [degC].
        current: (n,) [A].
        target: position to which the firmware is moving at present (n,) [rad].
        status: fault bits, see :class:`sealegs.hw.bus.packets.Status` (n,).
        moving: (n,) bool.
        raw: counts by register name (n,), signs applied; 0 where a servo has no such register.
        torque: register ``torque_enable`` (n,), -1 where it is not known; None: not read this time.
        mark: register that reveals a restart (n,), -1 where there is none; None: not read this time.
        watchdog: register of the servo's own bus watchdog (n,), 0 where there is none; None: not read this time.
        latched: ids of the servos that only a restart frees from a fault.
        missing: ids of the servos whose reply did not come; their values here are older.
        problem: why replies are missing; None if none are.
    """

    ids: tuple[int, ...]
    before: float
    after: float
    position: np.ndarray
    velocity: np.ndarray
    duty: np.ndarray
    voltage: np.ndarray
    temperature: np.ndarray
    current: np.ndarray
    target: np.ndarray
    status: np.ndarray
    moving: np.ndarray
    raw: Mapping[str, np.ndarray]
    torque: np.ndarray | None = None
    mark: np.ndarray | None = None
    watchdog: np.ndarray | None = None
    latched: tuple[int, ...] = ()
    missing: tuple[int, ...] = ()
    problem: BusError | None = None

    def faults(self) -> list[ServoFaultError]:
        """The faults that the servos report, an exception each, not raised."""
        return faults(self.ids, self.status.tolist(), self.latched) if self.status.any() else []


class BlockReader:
    """Turns the blocks of registers that servos reply into a :class:`ServoState`, all servos and registers at once.

    Attributes:
        start: address of the first byte of the readings.
        length: of the readings in bytes.
        whole: address and length of the block that tells about torque, with the readings behind it where ``merged``.
        merged: whether that block ends with the readings.
    """

    def __init__(self, model: ServoModel) -> None:
        self._model = model
        quantities = [name for name in QUANTITIES if name in model.readings]
        registers = [model[model.readings[name]] for name in quantities]
        self.start = min(item.address for item in registers)
        end = max(item.address + item.bytes for item in registers)
        self.length = end - self.start
        known = {role: name for role in WHOLE if (name := model.role(role)) is not None}
        self._more = {role: model[name] for role, name in known.items()}
        watched = [*self._more.values()]
        if (status := model.role("status")) is not None and "status" not in model.readings:
            watched.append(model[status])
        first, last = min(item.address for item in watched), max(item.address + item.bytes for item in watched)
        self.merged = "status" in model.readings  # what stands between is little
        self.whole = (first, end - first if self.merged else last - first)
        self._quantities, self._names = quantities, [item.name for item in registers]
        weights = np.zeros((self.length, len(registers)), np.int64)  # words are sums of weighted bytes: one product
        for column, item in enumerate(registers):
            for power in range(item.bytes):
                offset = power if item.order == "little" else item.bytes - 1 - power
                weights[item.address - self.start + offset, column] = 256**power
        self._weights = weights
        never = 1 << 40
        self._sign = np.array([never if item.sign is None else 1 << item.sign for item in registers], np.int64)
        self._half = np.array([1 << (8 * i.bytes - 1) if i.complement else never for i in registers], np.int64)
        self._span = np.array([1 << 8 * item.bytes for item in registers], np.int64)
        self._signed, self._complement = (bool((bits < never).any()) for bits in (self._sign, self._half))
        self._scale = np.array([model.si(item.name) for item in registers])
        centred = ("position", "target")
        self._zero = np.array([model.centre if name in centred else 0 for name in quantities])

    def span(self, whole: bool) -> tuple[int, int]:
        """Address and length in bytes of the block that a cycle reads."""
        return self.whole if whole and self.merged else (self.start, self.length)

    def watched(self, block: Sequence[int] | None) -> dict[str, int]:
        """Torque, mark and watchdog out of a block that begins at ``whole``; None: nothing is known."""
        found = {"torque": -1, "mark": -1, "watchdog": 0}
        for role, register in self._more.items():
            if block is not None:
                found["torque" if role == "torque_enable" else role] = register.read(list(block), self.whole[0])
        return found

    def state(
        self,
        ids: Sequence[int],
        blocks: Sequence[Sequence[int]],
        before: float,
        after: float,
        whole: bool = False,
        known: Sequence[bool] | None = None,
    ) -> ServoState:
        """The state in blocks (n, length or more) of bytes.

        Args:
            ids: of the servos (n).
            blocks: bytes, which begin at ``whole`` where that is so and the blocks are merged.
            before: clock as they were asked for [s].
            after: clock as the last answer was there [s].
            whole: whether torque and mark are among the bytes.
            known: whether these were read this time (n); None: all.
        """
        more: dict[str, Any] = {}
        if whole and self.merged:
            fresh = [True] * len(ids) if known is None else known
            rows = [self.watched(block if is_new else None) for block, is_new in zip(blocks, fresh, strict=True)]
            more = {name: np.array([row[name] for row in rows]) for name in ("torque", "mark", "watchdog")}
            blocks = [block[self.start - self.whole[0] :] for block in blocks]
        data = b"".join([bytes(block[: self.length]) for block in blocks])
        counts = np.frombuffer(data, np.uint8).reshape(len(ids), self.length) @ self._weights
        if self._signed:
            counts = np.where(counts & self._sign, -(counts & (self._sign - 1)), counts)
        if self._complement:
            counts = np.where(counts >= self._half, counts - self._span, counts)
        values = ((counts - self._zero) * self._scale).T
        zeros = np.zeros(len(ids))
        found = dict(zip(self._quantities, values, strict=True))
        raw = dict(zip(self._names, counts.T, strict=True))
        status = found.get("status", zeros).astype(np.int64)
        return ServoState(
            ids=tuple(ids),
            before=before,
            after=after,
            position=found["position"],
            velocity=found["velocity"],
            duty=found["duty"],
            voltage=found["voltage"],
            temperature=found["temperature"],
            current=found.get("current", zeros),
            target=found.get("target", found["position"]),
            status=status,
            moving=found["moving"] != 0,
            raw={"present_current": zeros.astype(np.int64), "status": status, **raw},
            **more,
        )
