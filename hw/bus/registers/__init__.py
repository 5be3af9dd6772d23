"""Memory tables of servos, as data: one YAML file per model."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from ....common import plugins
from ....common.documents import read_yaml
from ....common.errors import SealegsError, nearest
from ..packets import RegisterError

FOLDER = Path(__file__).resolve().parent
RPM = 2.0 * math.pi / 60.0  # [rad/s]
TURNS = {"step": 1, "step/s": 1, "step/s2": 1}
"""Units that count steps of the encoder."""
ROTATIONS = {"rpm": RPM, "rev/min2": RPM / 60.0}  # [rad/s], [rad/s2]
BYTE_ORDER = Literal["little", "big"]


@dataclass(frozen=True)
class Register:
    """One register of a servo.

    Attributes:
        name: as in the model's file.
        address: of its first byte.
        bytes: 1, 2 or 4.
        area: ``eeprom`` (persists), ``ram`` (lost at power-off) or ``read`` (read-only).
        sign: bit that says "negative", of sign and magnitude; None: there is none.
        complement: whether negative counts are two's complements.
        scale: value of one count in ``unit``.
        unit: of the scaled value.
        low: smallest count that may be written.
        high: largest count that may be written.
        default: count as it leaves the factory.
        order: of its bytes.
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
    complement: bool = False
    order: BYTE_ORDER = "little"

    def decode(self, word: int) -> int:
        """The count that the raw ``word`` stands for, with its sign."""
        if self.complement:
            return word - (1 << 8 * self.bytes) if word >> (8 * self.bytes - 1) else word
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
        return self.word(int(count))

    def word(self, count: int) -> int:
        """The raw word of ``count``, which fits or is cut to the largest that does."""
        whole = (1 << 8 * self.bytes) - 1
        if self.complement:
            half = 1 << (8 * self.bytes - 1)
            return min(max(count, -half), half - 1) & whole
        if self.sign is None:
            return min(max(count, 0), whole)
        magnitude = min(abs(count), (1 << self.sign) - 1)
        return magnitude | ((1 << self.sign) if count < 0 else 0)

    def read(self, data: bytes | bytearray | list[int], start: int = 0) -> int:
        """The count in a block of memory that begins at address ``start``."""
        at = self.address - start
        return self.decode(int.from_bytes(bytes(data[at : at + self.bytes]), self.order))

    def to_bytes(self, count: int) -> bytes:
        """``count`` as it is written.

        Raises:
            RegisterError: as :meth:`encode`.
        """
        return self.encode(count).to_bytes(self.bytes, self.order)


@dataclass(frozen=True)
class Requirement:
    """How a register must be set for the host to work with a servo.

    Attributes:
        register: its name.
        remedy: what to write, and why.
        value: that it must have; None: any.
        set, clear: bits that must be 1, and 0.
        above: register whose count it must exceed; None: none.
        goals: whether it matters for goals only, which a servo that only measures does not get.
    """

    register: str
    remedy: str
    value: int | None = None
    set: int = 0
    clear: int = 0
    above: str | None = None
    goals: bool = False

    def met(self, count: int, other: int | None = None) -> bool:
        """Whether the register may have this count, beside the count of the register that it must exceed."""
        fits = self.value is None or count == self.value
        return fits and count & self.set == self.set and not count & self.clear and (other is None or count > other)

    def mended(self, count: int, model: ServoModel) -> dict[str, int]:
        """Counts by register with which it is met."""
        if self.above is not None:
            return {name: model[name].default for name in (self.above, self.register)}
        return {self.register: self.value if self.value is not None else (count | self.set) & ~self.clear}


@dataclass(frozen=True)
class SpeedMode:
    """How a servo is told speeds and not positions: a wheel.

    Attributes:
        register: of its operating mode.
        value: count of that register.
        goal: register of the speed.
    """

    register: str
    value: int
    goal: str


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
        protocol: how it is talked to: ``feetech`` or ``dynamixel``.
        steps: positions that its sensor tells apart; fewer than ``resolution`` where it does not see a whole turn.
        roles: names of registers by what they are for, where that is another name; "" where the servo has none.
        readings: what a control cycle reads, by quantity: names of registers that lie close together.
        move: registers of a goal with speed and ramp, which lie one behind the other.
        requires: how its registers must be set, of those that it has.
        moves: registers that decide how a servo answers a goal.
        high_id: largest id that it can have.
        sync_read: whether several can be asked in one request.
        stops_short: steps by which its limits may stop short of a joint's range: some clamp a goal, others ignore it.
        shifts_seam: whether its homing offset moves the seam of its turn too, and not only its zero.
        speed_mode: in which it is told speeds; None: it has none.
        chains: names of the actuator chains that describe it.
    """

    name: str
    model_number: int
    resolution: float
    centre: int
    registers: Mapping[str, Register]
    baud_rates: tuple[int, ...]
    protocol: str
    steps: int
    roles: Mapping[str, str]
    readings: Mapping[str, str]
    move: tuple[str, ...]
    requires: tuple[Requirement, ...]
    moves: tuple[str, ...]
    high_id: int
    sync_read: bool
    stops_short: int
    shifts_seam: bool
    speed_mode: SpeedMode | None = None
    chains: tuple[str, ...] = ()

    @property
    def step(self) -> float:
        """Of the encoder [rad]."""
        return 2.0 * math.pi / self.resolution

    def role(self, role: str) -> str | None:
        """Name of the register that has a role; None: there is none."""
        name = self.roles.get(role, role)
        return name if name in self.registers else None

    def si(self, name: str) -> float:
        """What one count of a register is in SI units: rad, rad/s, rad/s2, A, V, or 1 of what has no such unit."""
        register = self[name]
        return register.scale * (self.step if register.unit in TURNS else ROTATIONS.get(register.unit, 1.0))

    def __getitem__(self, name: str) -> Register:
        """The register of that name.

        Raises:
            RegisterError: there is none; the message names the nearest one.
        """
        if name not in self.registers:
            raise RegisterError(f"the {self.name} has no register '{name}'{nearest(name, self.registers)}.")
        return self.registers[name]

    def centring(self, middle: float, offset: int) -> int | None:
        """Homing offset that brings the middle of a range to the centre, its ends farthest from the seam.

        Args:
            middle: of the range, in steps as the servo counts them now; over the seam they go on.
            offset: homing offset now.

        Returns:
            Count of the register; None: none moves the seam.
        """
        name = self.role("homing_offset")
        if name is None or not self.shifts_seam:
            return None
        half = self.steps // 2
        shift = (round(middle) + offset - self.centre + half) % self.steps - half  # present = actual - offset
        return min(max(shift, self[name].low), self[name].high)

    def setting(self, servo: int | str, counts: Mapping[str, int], port: str = "<path>") -> str:
        """What to type to set registers of a servo."""
        pairs = ",".join(f"{name}:{count}" for name, count in counts.items())
        return f"sealegs scan port={port} servo={self.name} id={servo} set={pairs}"

    def size(self) -> int:
        """Bytes of the memory table."""
        return max(item.address + item.bytes for item in self.registers.values())


def model_names() -> list[str]:
    """Servo models that have a table, those of installed plugins too."""
    return sorted({*(path.stem for path in FOLDER.glob("*.yaml")), *plugins.installed("servos")})


def model_of_chain(chain: str) -> str | None:
    """The servo model that an actuator chain describes, by its name; None: no table says that it is its own."""
    return next((name for name in model_names() if chain in load_model(name).chains), None)


def load_model(name: str) -> ServoModel:
    """The servo model of that name, or of a register table of one's own: the path of a YAML file.

    Raises:
        RegisterError: there is no table for it, or the table is wrong.
    """
    return _model(str(Path(name).absolute()) if _is_file(name) else name)


def _is_file(name: str) -> bool:
    return Path(name).suffix in (".yaml", ".yml")


@functools.cache
def _model(name: str) -> ServoModel:
    path = _table_of(name)
    try:
        return _made(name, _table(path))
    except SealegsError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        what = f"it lacks {error}" if isinstance(error, KeyError) else str(error)
        raise RegisterError(
            f"{path} is no register table of a servo: {what}; begin it as those in {FOLDER}."
        ) from error


def _table_of(name: str) -> Path:
    """The file of a servo model's table."""
    if _is_file(name):
        return Path(name)
    if (own := FOLDER / f"{name}.yaml").is_file():
        return own
    if name not in plugins.installed("servos"):
        raise RegisterError(
            f"there is no register table for the servo model '{name}'{nearest(name, model_names())}; "
            f"there are {', '.join(model_names())}, and another one is the path of a YAML file."
        )
    found = plugins.entry("servos", name)
    if isinstance(found, str | Path):
        return Path(found)
    return Path(found.__file__).parent / f"{name}.yaml"  # of a package that holds tables


def _table(path: Path) -> dict[str, Any]:
    """What a table says, on top of the one that it is ``like``."""
    table: dict[str, Any] = read_yaml(path)
    if "like" not in table:
        return table
    like = str(table["like"])
    base = _table(path.parent / like if _is_file(like) else _table_of(like))
    base.pop("chains", None)  # they describe that servo alone
    changed = {**base["registers"], **table.pop("registers", {})}
    return {**base, **table, "registers": {key: row for key, row in changed.items() if row is not None}}


def _made(name: str, table: Mapping[str, Any]) -> ServoModel:
    order = table.get("byte_order", "little")
    registers = {key: _register(key, row, order) for key, row in table["registers"].items()}
    number = int(table["model_number"])
    registers["model_number"] = replace(registers["model_number"], default=number)
    return ServoModel(
        name=name,
        model_number=number,
        resolution=table["resolution"],
        centre=int(table["centre"]),
        registers=registers,
        baud_rates=tuple(table["baud_rates"]),
        protocol=table["protocol"],
        steps=int(table.get("steps", table["resolution"])),
        roles=table.get("roles", {}),
        readings=table["readings"],
        move=tuple(table["move"]),
        requires=tuple(Requirement(**row) for row in table["requires"] if row["register"] in registers),
        moves=tuple(table["moves"]),
        high_id=int(table["high_id"]),
        sync_read=bool(table.get("sync_read", True)),
        stops_short=int(table.get("stops_short", 0)),
        shifts_seam=bool(table.get("shifts_seam", False)),
        speed_mode=SpeedMode(**table["speed_mode"]) if table.get("speed_mode") else None,
        chains=tuple(table.get("chains", ())),
    )


def ready_at(model: ServoModel, baudrate: int) -> dict[str, int]:
    """Registers of virtual servos whose factory settings nobody would work with: another baud rate, slow replies.

    Raises:
        RegisterError: the servo does not know the baud rate [bit/s].
    """
    if model.protocol != "dynamixel":
        return {}
    if baudrate not in model.baud_rates:
        raise RegisterError(
            f"the baud rate is {baudrate}; a {model.name} knows {', '.join(map(str, model.baud_rates))}."
        )
    return {"baud_rate": model.baud_rates.index(baudrate), "return_delay_time": 0}


def _register(name: str, row: Mapping[str, Any], order: BYTE_ORDER) -> Register:
    bits = 8 * row["bytes"]
    low, high = (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if row.get("complement") else (0, (1 << bits) - 1)
    return Register(name, **{"low": low, "high": high, "order": order, **row})
