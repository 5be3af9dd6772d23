"""Memory tables of servos, as data: one YAML file per model."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from ...actuators.errors import nearest
from ..packets import RegisterError

FOLDER = Path(__file__).resolve().parent


@dataclass(frozen=True)
class Register:
    """One register of a servo.

    Attributes:
        name: as in the model's file.
        address: of its first byte.
        bytes: 1 or 2, little-endian.
        area: ``eeprom`` (persists), ``ram`` (lost at power-off) or ``read`` (read-only).
        sign: bit that says "negative", of sign and magnitude; None: unsigned.
        scale: value of one count in ``unit``.
        unit: of the scaled value.
        low: smallest count that may be written.
        high: largest count that may be written.
        default: count as it leaves the factory.
    """

    name: str
    address: int
    bytes: int
    area: str
    sign: int | None = None
    scale: float = 1.0
    unit: str = ""
    low: int = 0
    high: int = 0
    default: int = 0

    def decode(self, word: int) -> int:
        """The count that the raw ``word`` stands for, with its sign."""
        if self.sign is None:
            return word
        magnitude = word & ((1 << self.sign) - 1)
        return -magnitude if word >> self.sign & 1 else magnitude

    def encode(self, count: int) -> int:
        """The raw word of ``count``.

        Raises:
            RegisterError: the count is outside the register's range.
        """
        if isinstance(count, bool) or int(count) != count or not self.low <= count <= self.high:
            raise RegisterError(
                f"register '{self.name}' takes whole numbers from {self.low} to {self.high}, not {count!r}."
            )
        count = int(count)
        return (1 << self.sign) | -count if count < 0 and self.sign is not None else count

    def read(self, data: bytes | bytearray | list[int], start: int = 0) -> int:
        """The count in a block of memory that begins at address ``start``."""
        at = self.address - start
        return self.decode(data[at] if self.bytes == 1 else data[at] | data[at + 1] << 8)

    def to_bytes(self, count: int) -> bytes:
        """``count`` as it is written.

        Raises:
            RegisterError: as :meth:`encode`.
        """
        return self.encode(count).to_bytes(self.bytes, "little")


@dataclass(frozen=True)
class ServoModel:
    """A servo model: its number and its memory table.

    Attributes:
        name: of its file.
        model_number: that it reports.
        resolution: steps per turn.
        centre: step that counts as 0 rad.
        registers: by name.
        baud_rates: by the count in register ``baud_rate`` [bit/s].
    """

    name: str
    model_number: int
    resolution: int
    centre: int
    registers: Mapping[str, Register]
    baud_rates: tuple[int, ...]

    def __getitem__(self, name: str) -> Register:
        """The register of that name.

        Raises:
            RegisterError: there is none; the message names the nearest one.
        """
        if name not in self.registers:
            raise RegisterError(f"the {self.name} has no register '{name}'{nearest(name, self.registers)}.")
        return self.registers[name]

    def size(self) -> int:
        """Bytes of the memory table."""
        return max(item.address + item.bytes for item in self.registers.values())


def model_names() -> list[str]:
    """Servo models that have a table."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


@functools.cache
def load_model(name: str) -> ServoModel:
    """The servo model of that name.

    Raises:
        RegisterError: there is no table for it.
    """
    if name not in model_names():
        raise RegisterError(
            f"there is no register table for the servo model '{name}'{nearest(name, model_names())}; "
            f"there are {', '.join(model_names())}, and another one is a file in hw/registers."
        )
    table: dict[str, Any] = yaml.safe_load((FOLDER / f"{name}.yaml").read_text())
    if "like" in table:
        table = {**yaml.safe_load((FOLDER / f"{table['like']}.yaml").read_text()), **table}
    registers = {key: _register(key, row) for key, row in table["registers"].items()}
    number = int(table["model_number"])
    registers["model_number"] = Register("model_number", 3, 2, "read", default=number)
    return ServoModel(
        name, number, int(table["resolution"]), int(table["centre"]), registers, tuple(table["baud_rates"])
    )


def _register(name: str, row: Mapping[str, Any]) -> Register:
    whole = (1 << 8 * row["bytes"]) - 1
    return Register(name, **{"low": 0, "high": whole, **row})
