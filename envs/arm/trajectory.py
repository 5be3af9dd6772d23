"""The straight line of section 4 (paper 002), from the stretched arm to its last position in five seconds.

The arm starts stretched, at the edge of what it reaches: joint 3 bends with the root of the way. On a way of sqrt(way)
the joint angles are smooth, so they are held as polynomials of it, and speeds and accelerations follow by the chain
rule. A quintic way grows with t^3 and joint 3 with t^1.5: its acceleration has no bound. A septic way grows with t^4,
and joint 3 starts with a finite acceleration. The paper's spline is not printed beyond its rest at both ends.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import chebyshev, polynomial

from .kinematics import PRINTED, Lengths, tool
from .tables import FINAL, SECONDS

WAYS: dict[str, tuple[float, ...]] = {
    "quintic": (0.0, 0.0, 0.0, 10.0, -15.0, 6.0),
    "septic": (0.0, 0.0, 0.0, 0.0, 35.0, -84.0, 70.0, -20.0),
}
"""Share of the way by share of the time: coefficients of its powers."""
DEGREE = 50  # of the polynomials of the root of the way: angles to 1e-8 rad


def clenshaw(x: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """Several Chebyshev series at once (n, k) at places (n,), by coefficients (degree + 1, k).

    As ``chebval``, but written so that an exported policy can carry it.
    """
    twice = 2.0 * x[:, None]
    later, last = coefficients[-1], 0.0 * twice
    for row in coefficients[-2:0:-1]:
        later, last = row + twice * later - last, later
    return coefficients[0] + x[:, None] * later - last


@dataclass(frozen=True)
class Line:
    """A straight line of the tool from the stretched arm.

    Attributes:
        last: joint angles at its end [rad].
        seconds: that it takes [s].
        way: a key of :data:`WAYS`.
        lengths: of the arm.
    """

    last: tuple[float, float, float] = tuple(np.deg2rad(FINAL).tolist())
    seconds: float = SECONDS
    way: str = "septic"
    lengths: Lengths = PRINTED

    @cached_property
    def ends(self) -> tuple[np.ndarray, np.ndarray]:
        """First and last position of the tool (3,) [m]."""
        return tool(np.zeros(3), self.lengths), tool(np.array(self.last), self.lengths)

    def _angles(self, root: np.ndarray) -> np.ndarray:
        """Joint angles (n, 3) [rad] where the tool has gone ``root`` squared of its way (n,)."""
        first, last = self.ends
        along, share = last - first, root**2
        # how far below the reach the tool is, without the cancellation of a difference of squares
        lowered = -(2.0 * (first - (0.0, 0.0, self.lengths.height)) @ along + share * (along @ along))
        a, b = self.lengths.upper, self.lengths.fore
        third = 2.0 * np.arcsin(root * np.sqrt(lowered) / (2.0 * np.sqrt(a * b)))
        place = first + share[:, None] * along
        reach, aside = a + b * np.cos(third), b * np.sin(third)
        second = np.arcsin((place[:, 2] - self.lengths.height) / reach)
        turned = np.unwrap(np.arctan2(place[:, 1], place[:, 0]) - np.arctan2(aside, reach * np.cos(second)))
        return np.stack([turned, second, third], axis=1)

    @cached_property
    def _polynomials(self) -> np.ndarray:
        """Coefficients of the angles, their first and second derivatives, side by side (DEGREE + 1, 9)."""
        nodes = np.sort(0.5 + 0.5 * chebyshev.chebpts1(4 * DEGREE))
        fitted = chebyshev.chebfit(2.0 * nodes - 1.0, self._angles(nodes), DEGREE)
        derivatives = [np.pad(chebyshev.chebder(fitted, k, 2.0), ((0, k), (0, 0))) for k in (1, 2)]
        return np.concatenate([fitted, *derivatives], axis=1)

    def joints(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Joint angles [rad], speeds [rad/s] and accelerations [rad/s2], (n, 3) each, at times (n,) [s].

        Before its start and after its end the arm rests.
        """
        share = np.clip(np.true_divide(time, self.seconds), 0.0, 1.0)
        moving = (share > 0.0) & (share < 1.0)
        coefficients = np.array(WAYS[self.way])
        lowest = int(np.flatnonzero(coefficients)[0])
        rest, half = coefficients[lowest:], 0.5 * lowest
        t = np.maximum(share, 1e-9)  # root = t^half sqrt(g)
        g, g1, g2 = (polynomial.polyval(t, polynomial.polyder(rest, k)) for k in range(3))
        s, s1 = np.sqrt(g), g1 / (2.0 * np.sqrt(g))
        s2 = g2 / (2.0 * s) - g1**2 / (4.0 * s**3)
        root = np.minimum(t**half * s, 1.0)
        speed = half * t ** (half - 1.0) * s + t**half * s1
        rate = half * (half - 1.0) * t ** (half - 2.0) * s + 2.0 * half * t ** (half - 1.0) * s1 + t**half * s2
        speed, rate = speed / self.seconds, rate / self.seconds**2
        values = clenshaw(2.0 * root - 1.0, self._polynomials)
        place, slope, bend = values[:, :3], values[:, 3:6], values[:, 6:]
        velocity = slope * speed[:, None] * moving[:, None]
        acceleration = (bend * speed[:, None] ** 2 + slope * rate[:, None]) * moving[:, None]
        return place, velocity, acceleration

    def tool(self, time: np.ndarray) -> np.ndarray:
        """Position of the tool (n, 3) [m] at times (n,) [s]."""
        first, last = self.ends
        share = np.clip(np.asarray(time, dtype=float) / self.seconds, 0.0, 1.0)
        return first + polynomial.polyval(share, np.array(WAYS[self.way]))[:, None] * (last - first)
