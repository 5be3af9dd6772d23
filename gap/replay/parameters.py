"""What a fit may turn: a parameter with its unit, its bounds, and the scale on which it is moved."""

from __future__ import annotations

import math
from dataclasses import dataclass

TIGHT = 0.06
"""How far a number of the nominal model may be off without being a finding (bound of re-tuning beside causes,
relative).
"""


@dataclass(frozen=True)
class Parameter:
    """One number of a joint.

    Attributes:
        path: ``stage.parameter``, ``load.*`` or ``host.*``; a ``*`` at the end makes it a factor on the nominal value.
        unit: of the value.
        low, high: bounds.
        start: where a fit starts.
        scale: typical change.
        logarithmic: moved as a logarithm; ``scale`` is then relative.
        difference: step of finite differences, in units of ``scale``: above the ripple of ticks, below the curvature.
    """

    path: str
    unit: str
    low: float
    high: float
    start: float
    scale: float
    logarithmic: bool = False
    difference: float = 0.3

    def to_fit(self, value: float) -> float:
        """Value to the optimiser's coordinate."""
        return (math.log(value) if self.logarithmic else value) / self.scale

    def from_fit(self, u: float) -> float:
        """The optimiser's coordinate to a value within the bounds."""
        value = math.exp(u * self.scale) if self.logarithmic else float(u) * self.scale
        return min(max(value, self.low), self.high)


def factor(path: str, low: float, high: float, scale: float = 0.1, difference: float = 0.3) -> Parameter:
    """A factor on a nominal value."""
    return Parameter(f"{path}*", "1", low, high, 1.0, scale, True, difference)
