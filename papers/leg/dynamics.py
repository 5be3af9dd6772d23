"""The leg's equations of motion in symbols: paper 000, appendix B, and the same without its omissions.

Constants ``a`` to ``x`` follow from table I by the Lagrange-Euler formulation. ``Constants`` also has the terms
that the paper omits as small. Its (40) is garbled in print: here it is what (36) implies, the Christoffel symbols of
the mass matrix, and :func:`printed_coriolis` is (40) to the letter.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...envs.leg.inertia import printed
from ...envs.leg.parameters import GRAVITY

TABLE_VII = {
    "a": 0.0376,
    "b": -0.00173,
    "c": 0.0231,
    "d": 0.0116,
    "e": -0.00528,
    "f": 0.0317,
    "g": 0.0105,
    "h": 0.0532,
    "k": 0.0462,
    "l": 0.0856,
    "m": 0.0213,
    "n": -0.0635,
    "p": -0.0210,
    "q": 0.0188,
    "r": 0.00527,
    "s": 0.00581,
    "t": 0.0115,
    "u": 3.077,
    "v": -0.142,
    "w": 0.951,
    "x": 0.0152,
}
"""As printed, in SI units."""


@dataclass(frozen=True)
class Constants:
    """Constants of (36) and (42), and the terms that are omitted there.

    Attributes:
        a, b, c, d, e, f, g, h, k, l, m: of the mass matrix [kg.m2].
        u, v, w, x: of gravity [N.m].
        sine_3, sine_23, sine_double: what goes with sin(q3) and sin(2 q2 + q3), with sin(q2 + q3) and with
            sin(2 q2 + 2 q3) in D11 [kg.m2].
        side_2, side_3, side_cosine_2, side_cosine_3: of D12 and D13, which are 0 in (36) [kg.m2].
    """

    a: float
    b: float
    c: float
    d: float
    e: float
    f: float
    g: float
    h: float
    k: float
    l: float  # noqa: E741 the paper's letter
    m: float
    u: float
    v: float
    w: float
    x: float
    sine_3: float
    sine_23: float
    sine_double: float
    side_2: float
    side_3: float
    side_cosine_2: float
    side_cosine_3: float

    def table(self) -> dict[str, float]:
        """Table VII from these constants."""
        own = {key: getattr(self, key) for key in TABLE_VII if hasattr(self, key)}
        derived = {
            "n": -2.0 * self.f,
            "p": -2.0 * self.g,
            "q": 0.5 * self.a,
            "r": -self.e,
            "s": 0.5 * self.d,
            "t": 0.5 * self.c,
        }
        return {key: {**own, **derived}[key] for key in TABLE_VII}

    def as_printed(self) -> Constants:
        """Without the terms that the paper omits."""
        omitted = ("sine_3", "sine_23", "sine_double", "side_2", "side_3", "side_cosine_2", "side_cosine_3")
        kept = {key: value for key, value in vars(self).items() if key not in omitted}
        return Constants(**kept, **dict.fromkeys(omitted, 0.0))


def constants(values: Mapping[str, float]) -> Constants:
    """Constants from the numbers of table I."""
    first, second, third = (printed(values, link) for link in (1, 2, 3))
    a1, a2 = values["link1_length"], values["link2_length"]
    static_2, static_3 = second.mass * second.centre, third.mass * third.centre
    (x1, z1), (x2, y2, z2) = (first.moments[0, 0], first.moments[2, 2]), np.diag(second.moments)
    x3, y3, z3 = np.diag(third.moments)
    x2 += third.mass * a2**2  # link 3 at its joint
    out = static_2[0] + third.mass * a2
    return Constants(
        a=2.0 * a1 * out,
        b=-2.0 * a1 * static_2[1],
        c=a2 * static_3[0],
        d=2.0 * a1 * static_3[0],
        e=-second.moments[0, 1],
        f=0.5 * (x2 - y2),
        g=0.5 * (x3 - y3),
        h=x1 + z1 + (second.mass + third.mass) * a1**2 + 0.5 * (x2 + y2 + x3 + y3) + z2 + z3,
        k=2.0 * a2 * static_3[0],
        l=x2 + y2 + x3 + y3,
        m=x3 + y3,
        u=GRAVITY * out,
        v=-GRAVITY * static_2[1],
        w=GRAVITY * static_3[0],
        x=-GRAVITY * static_3[1],
        sine_3=-a2 * static_3[1],
        sine_23=-2.0 * a1 * static_3[1],
        sine_double=-third.moments[0, 1],
        side_2=-(second.moments[0, 2] + a2 * static_3[2]),
        side_3=-third.moments[0, 2],
        side_cosine_2=-second.moments[1, 2],
        side_cosine_3=-third.moments[1, 2],
    )


def mass_matrix(k: Constants, q: np.ndarray) -> np.ndarray:
    """``D(q)``, equation (36) with what it omits (..., 3, 3) [kg.m2], from angles (..., 3) [rad]."""
    q2, q3 = q[..., 1], q[..., 2]
    q23, double, across = q2 + q3, 2.0 * (q2 + q3), 2.0 * q2 + q3
    d11 = (
        k.h
        + k.a * np.cos(q2)
        + k.b * np.sin(q2)
        + k.c * (np.cos(q3) + np.cos(across))
        + k.d * np.cos(q23)
        + k.e * np.sin(2.0 * q2)
        + k.f * np.cos(2.0 * q2)
        + k.g * np.cos(double)
        + k.sine_3 * (np.sin(q3) + np.sin(across))
        + k.sine_23 * np.sin(q23)
        + k.sine_double * np.sin(double)
    )
    d13 = k.side_3 * np.sin(q23) + k.side_cosine_3 * np.cos(q23)
    d12 = d13 + k.side_2 * np.sin(q2) + k.side_cosine_2 * np.cos(q2)
    d22 = k.l + k.k * np.cos(q3) + 2.0 * k.sine_3 * np.sin(q3)
    d23 = k.m + k.c * np.cos(q3) + k.sine_3 * np.sin(q3)
    d33 = np.full_like(d22, k.m)
    rows = [[d11, d12, d13], [d12, d22, d23], [d13, d23, d33]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def mass_slopes(k: Constants, q: np.ndarray) -> np.ndarray:
    """Derivatives of ``D`` by each angle (..., 3, 3, 3) [kg.m2/rad], the angle last."""
    q2, q3 = q[..., 1], q[..., 2]
    q23, double, across = q2 + q3, 2.0 * (q2 + q3), 2.0 * q2 + q3
    both = -k.d * np.sin(q23) - 2.0 * k.g * np.sin(double)
    both += k.sine_23 * np.cos(q23) + 2.0 * k.sine_double * np.cos(double)
    by_2 = both - k.a * np.sin(q2) + k.b * np.cos(q2) + 2.0 * (k.e * np.cos(2.0 * q2) - k.f * np.sin(2.0 * q2))
    by_2 += 2.0 * (k.sine_3 * np.cos(across) - k.c * np.sin(across))
    knee = k.sine_3 * np.cos(q3) - k.c * np.sin(q3)
    by_3 = both + knee + k.sine_3 * np.cos(across) - k.c * np.sin(across)
    side_13 = k.side_3 * np.cos(q23) - k.side_cosine_3 * np.sin(q23)
    side_12 = side_13 + k.side_2 * np.cos(q2) - k.side_cosine_2 * np.sin(q2)
    slopes = np.zeros((*q.shape[:-1], 3, 3, 3))
    slopes[..., 0, 0, 1], slopes[..., 0, 0, 2] = by_2, by_3
    slopes[..., 0, 1, 1] = slopes[..., 1, 0, 1] = side_12
    for row, column in ((0, 1), (1, 0), (0, 2), (2, 0)):
        slopes[..., row, column, 2] = side_13
    slopes[..., 0, 2, 1] = slopes[..., 2, 0, 1] = side_13
    slopes[..., 1, 1, 2] = 2.0 * knee
    slopes[..., 1, 2, 2] = slopes[..., 2, 1, 2] = knee
    return slopes


def coriolis(k: Constants, q: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """``H(q, dq)``: the Christoffel terms of :func:`mass_matrix` (..., 3) [N.m]."""
    slopes = mass_slopes(k, q)
    turning = np.einsum("...ijk,...j,...k->...i", slopes, speed, speed)
    return turning - 0.5 * np.einsum("...jki,...j,...k->...i", slopes, speed, speed)


def gravity(k: Constants, q: np.ndarray) -> np.ndarray:
    """``C(q)``, equation (42) (..., 3) [N.m]."""
    q2, q23 = q[..., 1], q[..., 1] + q[..., 2]
    third = k.w * np.cos(q23) + k.x * np.sin(q23)
    second = k.u * np.cos(q2) + k.v * np.sin(q2) + third
    return np.stack([np.zeros_like(third), second, third], axis=-1)


def printed_gravity(table: Mapping[str, float], q: np.ndarray) -> np.ndarray:
    """(42) to the letter: ``g_2`` lacks ``x sin(q2 + q3)`` (..., 3) [N.m]."""
    q2, q23 = q[..., 1], q[..., 1] + q[..., 2]
    second = table["u"] * np.cos(q2) + table["v"] * np.sin(q2) + table["w"] * np.cos(q23)
    third = table["w"] * np.cos(q23) + table["x"] * np.sin(q23)
    return np.stack([np.zeros_like(third), second, third], axis=-1)


def printed_coriolis(table: Mapping[str, float], q: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """(39) and (40) to the letter, with ``table`` as :data:`TABLE_VII` (..., 3) [N.m]."""
    k = table
    q2, q3 = q[..., 1], q[..., 2]
    s2, s3, s23 = np.sin(q2), np.sin(q3), np.sin(q2 + q3)
    across, double, twice = np.sin(2.0 * q2 + q3), np.sin(2.0 * (q2 + q3)), np.sin(2.0 * q2)
    h112 = -k["a"] * s2 + k["n"] * twice - k["g"] * np.cos(2.0 * q2) - k["d"] * s23 - k["k"] * across + k["p"] * double
    h113 = -k["c"] * s3 - k["d"] * s23 - k["c"] * across + k["p"] * double
    h211 = k["q"] * s2 + k["f"] * twice + k["r"] * np.cos(2.0 * q2) + k["s"] * s23 + k["c"] * across + k["g"] * double
    h311 = k["t"] * s3 + k["s"] * s23 + k["t"] * across + k["g"] * double
    w1, w2, w3 = speed[..., 0], speed[..., 1], speed[..., 2]
    first = h112 * w1 * w2 + h113 * w1 * w3
    second = h211 * w1**2 - k["k"] * s3 * w2 * w3 - k["c"] * s3 * w3**2
    third = h311 * w1**2 + k["c"] * s3 * w2**2
    return np.stack([first, second, third], axis=-1)
