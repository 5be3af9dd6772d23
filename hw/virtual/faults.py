"""Faults on request: what is wrong with the wire, the servos or their supply, from when and for how long."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...common.documents import DocumentError, read_yaml
from ...common.errors import SealegsError, nearest

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
