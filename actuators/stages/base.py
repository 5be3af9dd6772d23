"""What a stage of an actuation chain is: parameters with units and bounds, the quantity it takes and gives, its law.

A stage's class says everything about it. Opcodes, the order of a chain and where each number stands in a program are
derived from the registered classes, so a new stage is one file in this folder.
"""

from __future__ import annotations

import collections
import dataclasses
import math
import numbers
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cache
from typing import Any, ClassVar, TypeVar

from ...common import plugins
from ...common.errors import SealegsError, nearest
from .parity import Frame, Parity


class ChainError(SealegsError):
    """A chain that cannot be built: unknown stage or parameter, value out of bounds, or stages in a wrong order."""


class Quantity(StrEnum):
    """What travels between two stages."""

    POSITION_GOAL = "position goal [rad]"
    SPEED_GOAL = "speed goal [rad/s]"
    DUTY = "duty [-1..1]"
    VOLTAGE = "voltage [V]"
    TORQUE = "torque [N.m]"
    MOTION = "motion [rad]"


def parameter(
    default: float | None,
    unit: str,
    low: float,
    high: float,
    doc: str,
    *,
    parity: Parity | None = None,
    neutral: float | None = None,
    in_law: bool = True,
) -> Any:
    """A numeric stage parameter.

    Args:
        default: None where it must be given.
        unit: of the value.
        low, high: inclusive bounds.
        doc: its meaning, in one sentence.
        parity: what becomes of it where the joint's angle is counted otherwise
            (:mod:`sealegs.actuators.stages.parity`); a stage without it is refused.
        neutral: value at which the stage does nothing; default: ``default``.
        in_law: whether the stage's own law reads it, so that it stands in the program.
    """
    metadata = {"unit": unit, "low": low, "high": high, "doc": doc, "parity": parity, "in_law": in_law}
    metadata["neutral"] = default if neutral is None else neutral
    if default is None:
        return field(metadata=metadata)
    return field(default=default, metadata=metadata)


@dataclass(frozen=True)
class Law:
    """Compiled scalar functions that make a stage's law; each names what it needs of the arguments listed here.

    ``p`` is the program, ``i`` where the stage's record starts in it; ``s`` is the state, ``m`` where the stage's
    memory starts in it (:mod:`sealegs.actuators.layout`).

    Attributes:
        start: from ``p, i, s, m, goal``: forget the past; returns the goal that the next stage sees.
        advance: from ``p, i, s, m, time``: carry the memory over the physics step that ends at ``time``.
        act: from ``p, i, s, m, time, value, q, w, external, first``: what the stage makes of ``value``; see
            :func:`sealegs.actuators.law.torque`.
        idle: from ``p, i, s, q, w, external``: torque of the stage [N.m] while the drive is off.
    """

    start: Callable[..., Any] | None = None
    advance: Callable[..., Any] | None = None
    act: Callable[..., Any] | None = None
    idle: Callable[..., Any] | None = None


@dataclass(frozen=True, kw_only=True)
class Stage:
    """One link of an actuation chain. Subclasses are frozen dataclasses of :func:`parameter` fields.

    Attributes:
        name: in YAML.
        takes, gives: quantities; gives is None where a stage passes on what it takes.
        after: the stage behind which it stands in a chain; empty for the first.
        at_end: whether only stages of this kind may stand behind it.
        repeats: whether a chain may hold it more than once.
        switches: whether its output jumps, so that a simulation has to meet the moment.
        derived: numbers that its law reads behind its own fields; :meth:`law_values` gives them.
        law: None where the engine knows the stage natively or others read it.
        command: column of a log that a chain with this stage is told; empty where the stage does not decide.
    """

    name: ClassVar[str]
    takes: ClassVar[tuple[Quantity, ...]]
    gives: ClassVar[Quantity | None] = None
    after: ClassVar[str]
    at_end: ClassVar[bool] = False
    repeats: ClassVar[bool] = False
    switches: ClassVar[bool] = False
    derived: ClassVar[tuple[str, ...]] = ()
    law: ClassVar[Law | None] = None
    command: ClassVar[str] = ""

    def __post_init__(self) -> None:
        for key, metadata in _parameters_of(type(self)):
            object.__setattr__(self, key, self._checked(key, getattr(self, key), metadata))

    def _checked(self, key: str, value: Any, metadata: Mapping[str, Any]) -> float:
        """``value`` as a float within its bounds."""
        if type(value) is float and metadata["low"] <= value <= metadata["high"] and abs(value) < math.inf:
            return value  # a search makes thousands of chains
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

    def turned(self, frame: Frame) -> Stage:
        """The stage with its joint's angle as another frame has it, by what each of its fields states."""
        values = {item.name: getattr(self, item.name) for item in dataclasses.fields(self)}
        metadata = {item.name: item.metadata for item in dataclasses.fields(self)}
        changed = {key: metadata[key]["parity"].turned(values, key, frame) for key in values}
        return dataclasses.replace(self, **{key: value for key, value in changed.items() if value != values[key]})

    def parameters(self) -> dict[str, float]:
        """Parameter values by name."""
        return {key: getattr(self, key) for key, _ in _parameters_of(type(self))}

    @classmethod
    def unit_of(cls, key: str) -> str:
        """Unit of a parameter; empty where the stage has none of that name."""
        return next((item.metadata.get("unit", "") for item in dataclasses.fields(cls) if item.name == key), "")

    @classmethod
    def record_names(cls) -> tuple[str, ...]:
        """Names of the numbers that the law reads, in the order of its record."""
        return _read_by_law(cls)

    @classmethod
    def offsets(cls) -> Any:
        """Where each of :meth:`record_names` stands in the record, as attributes of a named tuple of integers."""
        names = cls.record_names()
        return collections.namedtuple(f"{cls.__name__}Offsets", names)(*range(len(names)))

    @classmethod
    def neutral(cls) -> Stage:
        """The stage as it does nothing: what a cause adds to a chain before it sets its parameter.

        Raises:
            ChainError: there is no such thing, as of a motor.
        """
        values = {item.name: item.metadata.get("neutral") for item in dataclasses.fields(cls)}
        if cls.gives is not None or None in values.values():
            raise ChainError(f"the chain has no stage '{cls.name}', and there is no neutral one to add.")
        return cls(**values)

    def check(self, chain: Any) -> None:
        """Raise a :class:`ChainError` where the stage's parameters do not fit together, or not into ``chain``."""

    def law_values(self, chain: Any) -> dict[str, float]:
        """The numbers that the law reads, by :meth:`record_names`.

        ``chain`` is the whole chain, for stages that look ahead.
        """
        del chain
        values = self.parameters()
        return {name: values[name] for name in self.record_names() if name in values}

    def law_tail(self) -> list[float]:
        """Numbers of any count that the law reads behind its record."""
        return []

    def header(self, memory: int) -> dict[int, float]:
        """What the stage writes into the program's header (``layout.P_*``); its memory starts at ``memory``."""
        del memory
        return {}

    def shapes_dry_friction(self) -> bool:
        """Whether it makes dry friction more than the constant that the engine knows natively."""
        return False

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


@cache
def _parameters_of(stage: type[Stage]) -> tuple[tuple[str, Mapping[str, Any]], ...]:
    """Name and metadata of each parameter of a class of stages."""
    return tuple((item.name, item.metadata) for item in dataclasses.fields(stage) if "unit" in item.metadata)


@cache
def _read_by_law(stage: type[Stage]) -> tuple[str, ...]:
    """Names of the numbers that the law of a class of stages reads."""
    own = [item.name for item in dataclasses.fields(stage) if item.metadata.get("in_law")]
    return (*own, *stage.derived)


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
"""Those that are registered so far; plugins are loaded when a stage is asked for that is not among them."""


def known_stages() -> Mapping[str, type[Stage]]:
    """All stages by name, with those of plugins (:mod:`sealegs.common.plugins`).

    Raises:
        SealegsError: a plugin cannot be loaded.
    """
    plugins.load("stages")
    return STAGES


def stage_of(name: str) -> type[Stage] | None:
    """The stage of that name; None: there is none.

    Raises:
        SealegsError: as :func:`known_stages`.
    """
    return STAGES.get(name) or known_stages().get(name)


def order() -> tuple[str, ...]:
    """Names of the stages that are registered so far, in the order of a chain.

    Raises:
        ChainError: a stage stands after one that does not exist.
    """
    return _ordered(tuple(STAGES))


@cache
def _ordered(names: tuple[str, ...]) -> tuple[str, ...]:
    return in_order({name: STAGES[name] for name in names})


S = TypeVar("S", bound=Stage)


def register(cls: type[S]) -> type[S]:
    """Class decorator: make a stage known by its name.

    Raises:
        ChainError: there is another of its name, or a parameter does not state its parity, or one that it cannot have.
    """
    other = STAGES.get(cls.name, cls)
    if (other.__module__, other.__qualname__) != (cls.__module__, cls.__qualname__):
        raise ChainError(f"there is a stage '{cls.name}' already, in {other.__module__}; give this one another name.")
    fields: dict[str, Mapping[str, Any]] = {item.name: item.metadata for item in dataclasses.fields(cls)}
    for key, metadata in fields.items():
        parity = metadata.get("parity")
        if not isinstance(parity, Parity):
            raise ChainError(
                f"{cls.name}.{key} does not state what becomes of it where the joint's angle is counted the other way "
                "round; give it parity=EVEN if nothing, parity=ODD if it changes sign, or another of "
                "sealegs.actuators.stages.parity."
            )
        if (fault := parity.fault(fields, key)) is not None:
            raise ChainError(f"{cls.name}.{key} {fault}.")
    STAGES[cls.name] = cls
    return cls


def in_order(stages: Mapping[str, type[Stage]]) -> tuple[str, ...]:
    """Names of stages in the order in which a command passes through them, from each one's ``after``."""
    followers: dict[str, list[str]] = collections.defaultdict(list)
    for name, stage in stages.items():
        if stage.after and stage.after not in stages:
            raise ChainError(f"stage '{name}' stands after '{stage.after}', which does not exist.")
        followers[stage.after].append(name)

    def behind(name: str) -> list[str]:
        branches = [[follower, *behind(follower)] for follower in followers[name]]
        branches.sort(key=len)  # what nothing follows stands directly behind
        return [item for branch in branches for item in branch]

    return tuple(behind(""))


def number_laws(stages: Iterable[type[Stage]]) -> dict[Law, int]:
    """Opcodes of laws in programs, counted from one; stages may share a law."""
    laws = dict.fromkeys(stage.law for stage in stages if stage.law is not None)
    return {law: number for number, law in enumerate(laws, 1)}


def build_stage(name: str, parameters: Any, where: str) -> Stage:
    """A stage from its YAML name and parameters.

    Raises:
        ChainError: unknown stage or parameter, missing parameter, a value that is no number or out of bounds.
    """
    if (cls := stage_of(name)) is None:
        raise ChainError(
            f"{where}: there is no stage '{name}'{nearest(name, STAGES)}; stages are {', '.join(sorted(STAGES))}, and "
            "those of a file that plugins= names."
        )
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
