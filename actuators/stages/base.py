"""What a stage of an actuation chain is: parameters with units and bounds, and the quantity it takes and gives."""

from __future__ import annotations

import dataclasses
import math
import numbers
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, ClassVar, TypeVar

from ..errors import SealegsError, nearest


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
            if "unit" in item.metadata:
                object.__setattr__(self, item.name, self._checked(item.name, getattr(self, item.name), item.metadata))

    def _checked(self, key: str, value: Any, metadata: Mapping[str, Any]) -> float:
        """``value`` as a float within its bounds."""
        where, unit, low, high = f"{self.name}.{key}", metadata["unit"], metadata["low"], metadata["high"]
        if isinstance(value, str):
            value = _number(where, unit, value)
        if isinstance(value, bool) or not isinstance(value, numbers.Real):
            raise ChainError(f"{where} must be a number in {in_words(unit)}, not {value!r}.")
        value = float(value)
        if not math.isfinite(value) or not low <= value <= high:
            raise ChainError(
                f"{where} is {value:g}; it must lie between {low:g} and {high:g} {in_words(unit)}"
                f"{_meant_otherwise(value, unit, low, high)}."
            )
        return value

    def parameters(self) -> dict[str, float]:
        """Parameter values by name."""
        return {item.name: getattr(self, item.name) for item in dataclasses.fields(self) if "unit" in item.metadata}

    def law_parameters(self, chain: Any) -> list[float]:
        """The numbers that the stage's law reads, in its order.

        ``chain`` is the whole chain, for stages that look ahead.
        """
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
                kept[item.name] = int(value) if isinstance(value, float) and value.is_integer() else value
        return {self.name: kept}


TO_SI = {
    "rad": {
        "deg": math.pi / 180.0,
        "degree": math.pi / 180.0,
        "degrees": math.pi / 180.0,
        "mrad": 1e-3,
        "turns": math.tau,
    },
    "rad/s": {"deg/s": math.pi / 180.0, "rpm": math.pi / 30.0},
    "s": {"ms": 1e-3, "us": 1e-6},
    "N.m": {"N.mm": 1e-3, "Nmm": 1e-3, "mN.m": 1e-3, "kg.cm": 0.0980665},
    "V": {"mV": 1e-3},
    "A": {"mA": 1e-3},
    "ohm": {"mohm": 1e-3},
    "H": {"mH": 1e-3, "uH": 1e-6},
    "Hz": {"kHz": 1e3},
    "kg.m2": {"kg.cm2": 1e-4, "g.cm2": 1e-7, "g.mm2": 1e-9},
    "-": {"%": 1e-2, "percent": 1e-2},
}
"""Factors from units that people write to those that parameters have, for error messages."""


def in_words(unit: str) -> str:
    """The unit as it stands in a sentence."""
    return "units of one (no unit)" if unit == "-" else unit


def _number(where: str, unit: str, text: str) -> float:
    """The number in ``text``; YAML reads 1e-3 as text, and people write units."""
    match = re.fullmatch(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S*)\s*", text)
    if match is None:
        raise ChainError(f"{where} must be a number in {in_words(unit)}, not {text!r}.")
    number, given = float(match[1]), match[2]
    if not given:
        return number
    factor = TO_SI.get(unit, {}).get(given, 1.0 if given.strip("[]") == unit else None)
    if factor is None:
        raise ChainError(f"{where} has the wrong unit in {text!r}; it is a bare number in {in_words(unit)}.")
    raise ChainError(
        f"{where} is written with its unit, {text!r}; write {number * factor:.6g}, a number in {in_words(unit)}."
    )


def _meant_otherwise(value: float, unit: str, low: float, high: float) -> str:
    """A hint where a value out of bounds is in bounds once taken for degrees or milliseconds."""
    for given, text in (("deg", "degrees"), ("ms", "milliseconds"), ("%", "percent")):
        factor = TO_SI.get(unit, {}).get(given)
        if factor is not None and math.isfinite(value) and low <= value * factor <= high:
            return f" ({value:g} {text} would be {value * factor:.4g})"
    return ""


STAGES: dict[str, type[Stage]] = {}


S = TypeVar("S", bound=Stage)


def register(cls: type[S]) -> type[S]:
    """Class decorator: make a stage known by its name."""
    STAGES[cls.name] = cls
    return cls


def build_stage(name: str, parameters: Any, where: str) -> Stage:
    """A stage from its YAML name and parameters.

    Raises:
        ChainError: unknown stage or parameter, missing parameter, a value that is no number or out of bounds.
    """
    if name not in STAGES:
        raise ChainError(
            f"{where}: there is no stage '{name}'{nearest(name, STAGES)}; stages are {', '.join(sorted(STAGES))}."
        )
    cls = STAGES[name]
    if parameters is None:
        parameters = {}
    if not isinstance(parameters, Mapping):
        raise ChainError(f"{where}: stage '{name}' needs its parameters as 'name: value' pairs, not {parameters!r}.")
    known = {item.name: item for item in dataclasses.fields(cls)}
    for key in parameters:
        if key not in known:
            names = ", ".join(known) or "none"
            raise ChainError(f"{where}: stage '{name}' has no parameter '{key}'{nearest(key, known)}; it has {names}.")
    missing = [key for key, item in known.items() if item.default is dataclasses.MISSING and key not in parameters]
    if missing:
        unit = known[missing[0]].metadata.get("unit")
        unit = f", a number in {in_words(unit)}" if unit else ""
        raise ChainError(f"{where}: stage '{name}' needs the parameter '{missing[0]}'{unit}.")
    try:
        return cls(**{str(key): value for key, value in parameters.items()})
    except ChainError as error:
        raise ChainError(f"{where}: {error}") from None
