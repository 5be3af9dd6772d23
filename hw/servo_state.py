"""What one reading of all servos holds, in counts and in SI units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .packets import BusError, ServoFaultError, faults
from .registers import ServoModel

FIRST, LAST = "present_position", "present_current"
WHOLE = "torque_enable"
"""First register of the longer block, which tells besides whether a servo still has its torque and its goal."""
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
        status: fault bits, see :class:`sealegs.hw.packets.Status` (n,).
        moving: (n,) bool.
        raw: counts by register name (n,), signs applied.
        torque: register ``torque_enable`` (n,); None: not read this time.
        limit: register ``torque_limit`` (n,); None: not read this time.
        missing: ids of the servos whose reply did not come; what stands here of them is older.
        problem: why; None where none is missing.
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
    limit: np.ndarray | None = None
    missing: tuple[int, ...] = ()
    problem: BusError | None = None

    def faults(self) -> list[ServoFaultError]:
        """The faults that the servos report, an exception each, not raised."""
        return faults(self.ids, self.status.tolist()) if self.status.any() else []


class BlockReader:
    """Turns the blocks of registers that servos reply into a :class:`ServoState`, all servos and registers at once.

    Attributes:
        start: address of the block's first byte.
        length: of the block in bytes.
        whole: as ``start``, of the longer block.
    """

    def __init__(self, model: ServoModel) -> None:
        registers = [model[name] for name in FIELDS]
        last = model[LAST]
        self.start = model[FIRST].address
        self.length = last.address + last.bytes - self.start
        self.whole = model[WHOLE].address
        self._more = {"torque": model[WHOLE], "limit": model["torque_limit"]}
        self._low = np.array([item.address - self.start for item in registers], np.int64)
        self._high = self._low + np.array([item.bytes - 1 for item in registers], np.int64)
        self._weight = np.array([256 * (item.bytes - 1) for item in registers], np.int64)
        self._sign = np.array([1 << item.sign if item.sign is not None else 1 << 30 for item in registers], np.int64)
        step = 2.0 * np.pi / model.resolution
        steps = {"present_position": step, "target_position": step, "present_velocity": step}
        self._scale = np.array([item.scale * steps.get(item.name, 1.0) for item in registers])
        centred = ("present_position", "target_position")
        self._zero = np.array([model.centre if item.name in centred else 0 for item in registers])

    def span(self, whole: bool) -> tuple[int, int]:
        """Address and length in bytes of the block."""
        start = self.whole if whole else self.start
        return start, self.start + self.length - start

    def state(
        self, ids: Sequence[int], blocks: Sequence[Sequence[int]], before: float, after: float, whole: bool = False
    ) -> ServoState:
        """The state in blocks (n, length or more) of bytes, which begin at ``whole`` where that is so."""
        more: dict[str, np.ndarray] = {}
        if whole:
            for name, register in self._more.items():
                more[name] = np.array([register.read(list(block), self.whole) for block in blocks])
            blocks = [block[self.start - self.whole :] for block in blocks]
        table = np.array(blocks, np.int64)
        words = table[:, self._low] + table[:, self._high] * self._weight
        counts = np.where(words & self._sign, -(words & (self._sign - 1)), words)
        values = (counts - self._zero) * self._scale
        position, velocity, duty, voltage, temperature, _, _, target, current = values.T
        rows = counts.T
        return ServoState(
            ids=tuple(ids),
            before=before,
            after=after,
            position=position,
            velocity=velocity,
            duty=duty,
            voltage=voltage,
            temperature=temperature,
            current=current,
            target=target,
            status=rows[5],
            moving=rows[6] != 0,
            raw=dict(zip(FIELDS, rows, strict=True)),
            torque=more.get("torque"),
            limit=more.get("limit"),
        )
