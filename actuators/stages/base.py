"""What a stage of an actuation chain is: parameters with units and bounds, and the quantity it takes and gives."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, ClassVar

from actuators.errors import SealegsError, nearest


class ChainError(SealegsError):
    """A chain that cannot be built: unknown stage or parameter, value out of bounds, or stages in a wrong order."""


class Quantity(StrEnum):
    """What travels between two stages."""

    POSITION_GOAL = "position goal [rad]"
    DUTY = "duty [-1..1]"
    VOLTAGE = "voltage [V]"
    TORQUE = "torque [N.m]"
    MOTION = "motion [rad]"


def parameter(default: float | None, unit: str, low: float, high: float, doc: str) -> Any:
    """A numeric stage parameter: default (None: required), unit, inclusive bounds, one sentence on its meaning."""
    metadata = {"unit": unit, "low": low, "high": high, "doc": doc}
    if default is None:
        return field(metadata=metadata)
    return field(default=default, metadata=metadata)


@dataclass(frozen=True, kw_only=True)
class Stage:
    """One link of an actuation chain. Subclasses are frozen dataclasses of :func:`parameter` fields."""

    name: ClassVar[str]
    takes: ClassVar[tuple[Quantity, ...]]
    gives: ClassVar[Quantity | None] = None  # None: the same quantity as taken
    opcode: ClassVar[int] = 0  # 0: no law of its own (native to the engine, or read by other stages)

    def __post_init__(self) -> None:
        for item in dataclasses.fields(self):
            if "unit" not in item.metadata:
                continue
            value = getattr(self, item.name)
            where = f"{self.name}.{item.name}"
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise ChainError(f"{where} must be a number in {item.metadata['unit']}, not {value!r}.")
            low, high = item.metadata["low"], item.metadata["high"]
            if not math.isfinite(value) or not low <= value <= high:
                raise ChainError(f"{where} is {value:g}; it must lie between {low:g} and {high:g} {item.metadata['unit']}.")
            object.__setattr__(self, item.name, float(value))

    def parameters(self) -> dict[str, float]:
        """Parameter values by name."""
        return {item.name: getattr(self, item.name) for item in dataclasses.fields(self) if "unit" in item.metadata}

    def law_parameters(self, chain: Any) -> list[float]:
        """The numbers that the stage's law reads, in its order. ``chain`` is the whole chain, for stages that look ahead."""
        del chain
        return list(self.parameters().values())

    def memory_size(self) -> int:
        """Doubles of state that the law keeps per actuator."""
        return 0

    def to_dict(self) -> dict[str, Any]:
        """The stage as in YAML, without parameters that stand at their default."""
        kept = {}
        for item in dataclasses.fields(self):
            value = getattr(self, item.name)
            if item.default is dataclasses.MISSING or value != item.default:
                kept[item.name] = value
        return {self.name: kept}


STAGES: dict[str, type[Stage]] = {}


def register(cls: type[Stage]) -> type[Stage]:
    """Class decorator: make a stage known by its name."""
    STAGES[cls.name] = cls
    return cls


def build_stage(name: str, parameters: Any, where: str) -> Stage:
    """A stage from its YAML name and parameters.

    Raises:
        ChainError: unknown stage or parameter, missing parameter, a value that is no number or out of bounds.
    """
    if name not in STAGES:
        raise ChainError(f"{where}: there is no stage '{name}'{nearest(name, STAGES)}; stages are {', '.join(sorted(STAGES))}.")
    cls = STAGES[name]
    if parameters is None:
        parameters = {}
    if not isinstance(parameters, dict):
        raise ChainError(f"{where}: stage '{name}' needs its parameters as 'name: value' pairs, not {parameters!r}.")
    known = {item.name: item for item in dataclasses.fields(cls)}
    for key in parameters:
        if key not in known:
            names = ", ".join(known) or "none"
            raise ChainError(f"{where}: stage '{name}' has no parameter '{key}'{nearest(key, known)}; it has {names}.")
    missing = [key for key, item in known.items() if item.default is dataclasses.MISSING and key not in parameters]
    if missing:
        unit = known[missing[0]].metadata.get("unit", "")
        raise ChainError(f"{where}: stage '{name}' needs the parameter '{missing[0]}' {unit}.")
    try:
        return cls(**parameters)
    except ChainError as error:
        raise ChainError(f"{where}: {error}") from None
