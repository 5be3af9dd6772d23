"""What one reading of all servos holds, in counts and in SI units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hw.packets import ServoFaultError, faults
from hw.registers import ServoModel

FIRST, LAST = "present_position", "present_current"
FIELDS = (
    "present_position",
    "present_velocity",
    "present_load",
    "present_voltage",
    "present_temperature",
    "status",
    "moving",
    "target_position",
    "present_current",
)


@dataclass(frozen=True)
class ServoState:
    """One reading of n servos: registers 56 to 70 of each, taken in one transaction.

    Attributes:
        ids: of the servos (n,).
        before: host's monotonic clock as the request went out [s].
        after: the same as the last reply had come in [s].
        position: of the output shaft, 0 at the centre of the encoder's turn (n,) [rad].
        velocity: (n,) [rad/s].
        duty: of the bridge, with its sign; register "load" (n,) [-1..1].
        voltage: at the servo (n,) [V].
        temperature: (n,) [degC].
        current: (n,) [A].
        target: position that the firmware steers to at the moment (n,) [rad].
        status: fault bits, see :class:`hw.packets.Status` (n,).
        moving: (n,) bool.
        raw: counts by register name (n,), signs applied.
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

    def faults(self) -> list[ServoFaultError]:
        """The faults that the servos report, an exception each, not raised."""
        return faults(self.ids, self.status.tolist()) if self.status.any() else []


class BlockReader:
    """Turns the blocks of registers that servos reply into a :class:`ServoState`, for all servos at once."""

    def __init__(self, model: ServoModel) -> None:
        self.model = model
        self.start = model[FIRST].address
        last = model[LAST]
        self.length = last.address + last.bytes - self.start
        self._step = 2.0 * np.pi / model.resolution

    def state(self, ids: Sequence[int], blocks: Sequence[Sequence[int]], before: float, after: float) -> ServoState:
        """The state in blocks (n, length or more) of bytes."""
        table = np.array([block[: self.length] for block in blocks], np.int64)
        raw: dict[str, np.ndarray] = {}
        for name in FIELDS:
            register = self.model[name]
            at = register.address - self.start
            word = table[:, at] if register.bytes == 1 else table[:, at] | table[:, at + 1] << 8
            if register.sign is not None:
                magnitude = word & ((1 << register.sign) - 1)
                word = np.where(word >> register.sign & 1, -magnitude, magnitude)
            raw[name] = word
        scaled = {name: raw[name] * self.model[name].scale for name in FIELDS}
        return ServoState(
            ids=tuple(ids),
            before=before,
            after=after,
            position=(raw["present_position"] - self.model.centre) * self._step,
            velocity=scaled["present_velocity"] * self._step,
            duty=scaled["present_load"],
            voltage=scaled["present_voltage"],
            temperature=scaled["present_temperature"],
            current=scaled["present_current"],
            target=(raw["target_position"] - self.model.centre) * self._step,
            status=raw["status"],
            moving=raw["moving"] != 0,
            raw=raw,
        )
