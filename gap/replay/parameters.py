"""What a fit may turn: a number with its unit, its bounds, and the scale on which it is moved."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from functools import cache
from typing import Protocol

TIGHT = 0.06
"""How far a number of the nominal model may be off without being a finding (bound of tuning beside causes, relative);
the delay of a robot's joint may be by more (:data:`sealegs.gap.causes.catalogue.HALF_A_TURN`).
"""


class Target(Enum):
    """Whose number it is."""

    STAGE = "stage of the actuation chain"
    GEAR = "reduction of the motor"
    LOAD = "load behind the joint"
    HOST = "host that logs the reading"
    GROUND = "ground under a foot"
    TORQUE = "torque column of a log"


OWNERS = {
    "load": Target.LOAD,
    "host": Target.HOST,
    "gear_ratio": Target.GEAR,
    "contact": Target.GROUND,
    "torque": Target.TORQUE,
}
"""Targets by the first word of a path; any other word is the name of a stage."""
FACTOR = "*"
"""Last character of a path whose value is a factor on the nominal value."""
BAR = "|"
"""Between the joint of a robot and the path of a number of that joint."""


@dataclass(frozen=True)
class Address:
    """Where a value of a fit belongs.

    Attributes:
        target: whose number it is.
        owner: name of the stage; of any other target its word in paths.
        key: the number's name there.
        factor: whether the value is a factor on the nominal value.
        joint: of a robot, whose number it is; empty where the joint is understood.
    """

    target: Target
    owner: str
    key: str
    factor: bool = False
    joint: str = ""

    @property
    def number(self) -> str:
        """``owner.key``, behind its joint where it has one: the number itself, whether given as a value or a factor."""
        own = f"{self.owner}.{self.key}"
        return f"{self.joint}{BAR}{own}" if self.joint else own

    @property
    def own(self) -> str:
        """The path as the joint itself has it."""
        return f"{self.owner}.{self.key}{FACTOR * self.factor}"


@cache
def address(path: str) -> Address:
    """The address that a path means, as it stands in the values of a fit and in ``diagnosis.json``.

    This is the only place that takes a path apart.
    """
    joint, _, own = path.rpartition(BAR)
    owner, _, key = own.removesuffix(FACTOR).partition(".")
    return Address(OWNERS.get(owner, Target.STAGE), owner, key, own.endswith(FACTOR), joint)


def numbers(paths: Iterable[str]) -> dict[str, str]:
    """Paths by the number that each of them sets."""
    return {address(path).number: path for path in paths}


class HasNumbers(Protocol):
    """A nominal model whose numbers can be read."""

    def value(self, path: str, /) -> float:
        """A number by ``owner.key``."""
        ...


def absolute(values: Mapping[str, float], nominal: HasNumbers) -> dict[str, float]:
    """Values of a fit by number, each in that number's own unit."""
    found = {}
    for path, value in values.items():
        at = address(path)
        found[at.number] = value * nominal.value(at.number) if at.factor else value
    return found


@dataclass(frozen=True)
class Parameter:
    """One number of a joint.

    Attributes:
        number: ``owner.key``; the owner is a stage, ``load``, ``host``, ``gear_ratio``, ``contact`` or ``torque``.
        unit: of the value.
        low, high: bounds.
        start: where a fit starts.
        scale: typical change.
        logarithmic: moved as a logarithm; ``scale`` is then relative.
        difference: step of finite differences, in units of ``scale``: above the ripple of ticks, below the curvature.
        factor: the value is a factor on the nominal one.
        phase: the value is the phase of something periodic [rad]: its cosine and sine make every other phase.
        shape: the value shapes what another parameter makes act, such as the speed over which friction falls.
        rigid_at_zero: the value is a stiffness of which zero stands for what does not give way at all.
    """

    number: str
    unit: str
    low: float
    high: float
    start: float
    scale: float
    logarithmic: bool = False
    difference: float = 0.3
    factor: bool = False
    phase: bool = False
    shape: bool = False
    rigid_at_zero: bool = False

    @property
    def is_size(self) -> bool:
        """Whether the value says how much there is of something: at its neutral value there is nothing of it."""
        return not (self.phase or self.shape)

    @property
    def relative(self) -> bool:
        """Whether the value is by how much something is larger than believed: a factor, or a scale that begins at 1."""
        return self.factor or (self.logarithmic and self.start == 1.0 and self.unit == "1")

    @property
    def path(self) -> str:
        """Key of its value among those of a fit: the number, with :data:`FACTOR` behind it where it is a factor."""
        return f"{self.number}{FACTOR}" if self.factor else self.number

    @property
    def joint(self) -> str:
        """Joint of a robot whose number it is; empty where the joint is understood."""
        return address(self.number).joint

    def of_joint(self, joint: str) -> Parameter:
        """The same parameter among those of a robot."""
        return replace(self, number=f"{joint}{BAR}{self.number}")

    @property
    def target(self) -> Target:
        """Whose number it is."""
        return address(self.number).target

    def neutral(self, nominal: HasNumbers) -> float:
        """The value at which the nominal model is as it was."""
        if self.factor:
            return 1.0
        value = nominal.value(self.number)
        return math.inf if self.rigid_at_zero and value == 0.0 else value

    @property
    def least(self) -> float:
        """The lower bound; of what is moved as a logarithm, above zero."""
        return max(self.low, 1e-12) if self.logarithmic else self.low

    def nothing(self, nominal: HasNumbers) -> float:
        """The optimiser's coordinate at which the value changes nothing, or of the bound that is nearest to that.

        A joint without a stop has it infinitely far off.
        """
        return self.to_fit(min(max(self.neutral(nominal), self.least), self.high))

    def physical(self, value: float, nominal: HasNumbers) -> float:
        """A fitted value in the number's own unit."""
        return value * nominal.value(self.number) if self.factor else value

    def to_fit(self, value: float) -> float:
        """Value to the optimiser's coordinate."""
        return (math.log(value) if self.logarithmic else value) / self.scale

    def from_fit(self, u: float) -> float:
        """The optimiser's coordinate to a value within the bounds."""
        value = math.exp(u * self.scale) if self.logarithmic else float(u) * self.scale
        return min(max(value, self.low), self.high)


SLIGHTLY = 1.001  # factor that tells a number that was turned from one that was not


def about(value: float, low: float, high: float) -> bool:
    """Whether a relative value is within these ends, or hardly beyond them."""
    return low / SLIGHTLY <= value <= high * SLIGHTLY


def factor(number: str, low: float, high: float, scale: float = 0.1, difference: float = 0.3) -> Parameter:
    """A factor on a nominal value."""
    return Parameter(
        number,
        unit="1",
        low=low,
        high=high,
        start=1.0,
        scale=scale,
        logarithmic=True,
        difference=difference,
        factor=True,
    )
