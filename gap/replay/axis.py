"""What kind of joint an axis is, how far it moves and how hard it is driven: the scales that causes are sought on."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

from ...envs.bench.stops import STOP_DAMPING, STOP_STIFFNESS
from .parameters import Parameter

LINEAR = (
    ("kg.m2", "kg"),
    ("N.m.s2/rad2", "N.s2/m2"),
    ("N.m.s/rad", "N.s/m"),
    ("N.m/rad", "N/m"),
    ("1/(N.m)", "1/N"),
    ("1/(rad.s)", "1/(m.s)"),
    ("N.m/A = V.s/rad", "N/A = V.s/m"),
    ("s/rad", "s/m"),
    ("1/rad", "1/m"),
    ("1/turn", "rad/m"),
    ("rad/s2", "m/s2"),
    ("rad/s", "m/s"),
    ("N.m", "N"),
    ("rad", "m"),
)
"""Units of a hinge, and what they are of a slide."""
USUAL_REACH = 2.0  # [rad] that the bounds of causes were set for: what a servo turns through
USUAL_EFFORT = 1.5  # [N.m] and what it drives with


@dataclass(frozen=True)
class Axis:
    """A hinge or a slide.

    Attributes:
        slide: whether it moves along a line: lengths in m and forces in N, where a hinge has rad and N.m.
        low, high: where it went in the log [rad] or [m].
        effort: largest torque that was commanded [N.m] or [N]; None where the chain's motor says it.
    """

    slide: bool = False
    low: float = -math.inf
    high: float = math.inf
    effort: float | None = None

    def unit(self, unit: str) -> str:
        """A unit as it is of this axis."""
        if not self.slide:
            return unit
        return next((linear for angular, linear in LINEAR if unit == angular), unit)

    @property
    def reach(self) -> float:
        """Length that a slide goes where a servo turns by a radian; 1 of a hinge."""
        span = self.high - self.low
        return span / USUAL_REACH if self.slide and math.isfinite(span) and span > 0.0 else 1.0

    @property
    def span(self) -> float:
        """How far it goes in the log [rad] or [m]; 0 where that is not known."""
        return self.high - self.low if math.isfinite(self.high - self.low) else 0.0

    @property
    def stop_stiffness(self) -> float:
        """Of what stops it [N.m/rad]: as of the bench, by this axis' effort and reach; assumed."""
        return STOP_STIFFNESS * max((self.effort or USUAL_EFFORT) / USUAL_EFFORT, 1.0) / self.reach

    @property
    def stop_damping(self) -> float:
        """Of what stops it [N.m.s/rad]."""
        return STOP_DAMPING * max((self.effort or USUAL_EFFORT) / USUAL_EFFORT, 1.0) / self.reach

    def scaled(self, parameter: Parameter) -> Parameter:
        """A parameter of a hinge as it is of this axis: unit, and bounds by how far the axis goes."""
        if not self.slide or parameter.phase:
            return parameter
        unit = self.unit(parameter.unit)
        size = 1.0 if parameter.factor else self.reach ** POWER.get(parameter.unit, 0)
        scale = parameter.scale if parameter.logarithmic else parameter.scale * size
        return dataclasses.replace(
            parameter,
            unit=unit,
            low=parameter.low * size,
            high=parameter.high * size,
            start=parameter.start * size,
            scale=scale,
        )


POWER = {"1/turn": -1, "rad": 1, "rad/s": 1, "rad/s2": 1, "N.m.s/rad": -1, "N.m/rad": -1, "N.m.s2/rad2": -2}
"""With which power of the reach numbers in these units grow, torques being given by the effort already."""
ROTATION = Axis()
