"""Numbers of a robot: defaults with unit, bounds and source, and what a finding does to them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

from ...common.errors import SealegsError


class RobotError(SealegsError):
    """An unknown robot, or a parameter that it does not have or cannot take."""


@dataclass(frozen=True)
class Number:
    """One number of a robot: default, unit, inclusive bounds, and where it comes from.

    Attributes:
        value: default, in ``unit``.
        unit: of the value.
        source: where it was printed; ``assumed`` first, where nobody printed it.
        low: smallest accepted value.
        high: largest accepted value.
        neutral: whether the default says that there is nothing of the kind (no stop, no further inertia); a robot that
            leaves it so has the same hash as one without the number.
        numerical: whether it belongs to the simulation and not to the machine; the robot's hash leaves it out.
    """

    value: float
    unit: str
    source: str
    low: float = 0.0
    high: float = math.inf
    neutral: bool = False
    numerical: bool = False

    @property
    def assumed(self) -> bool:
        """Whether the value is a choice of ours rather than a printed or measured one."""
        return self.source.startswith("assumed")

    def takes(self, value: float) -> bool:
        """Whether ``value`` is finite and within the bounds."""
        return math.isfinite(value) and self.low <= value <= self.high


@dataclass(frozen=True)
class Effect:
    """How a number that a diagnosis found acts on a number of a robot.

    Attributes:
        number: of the robot.
        how: the finding multiplies it, is added to it, takes its place, or narrows it from above or below.
    """

    number: str
    how: Literal["times", "plus", "set", "most", "least"]

    def on(self, believed: float, found: float) -> float:
        """The number with the finding."""
        actions: Mapping[str, Callable[[float, float], float]] = {
            "times": lambda a, b: a * b,
            "plus": lambda a, b: a + b,
            "set": lambda _, b: b,
            "most": min,
            "least": max,
        }
        return actions[self.how](believed, found)
