"""The tables of the paper (paper 002) as printed, with what a damaged print leaves open filled in and said.

- Table III prints the centre of link 1 at y = +0.043 m. The points of joint 1 (tables V and VI) only meet at
  -0.043 m, which is also the side that table IX has it on; -0.043 m is taken.
- Table VIII cuts the last product of rotor 1, -1.12E; the power of rotor 2's, -1.13E-5, is assumed.
- Whether a product of inertia is the element of the tensor or its negative is not said; elements are assumed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

JOINTS = ("joint1", "joint2", "joint3")
FINAL = (-145.0, 45.0, 80.0)  # [deg] section 4
TOOL = ((0.58, 0.0, 0.577), (-0.0333, -0.3720, 0.8177))  # [m] section 4: first and last position
SECONDS = 5.0  # section 4


@dataclass(frozen=True)
class Body:
    """A row of table II or VIII, with its place from table III or IX, at zero joint angles.

    Attributes:
        mass: [kg].
        inertia: I_xx, I_yy, I_zz, I_xy, I_xz, I_yz about the centre of mass, in the body's axes [kg.m2].
        centre: of mass, over the ground [m].
        tilted: whether the body's axes are turned by theta = pi/2 about x.
    """

    mass: float
    inertia: tuple[float, float, float, float, float, float]
    centre: tuple[float, float, float]
    tilted: bool = False

    @property
    def turn(self) -> np.ndarray:
        """From the body's axes to those of the ground (3, 3)."""
        return np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]) if self.tilted else np.eye(3)

    def tensor(self, products: float = 1.0) -> np.ndarray:
        """Inertia in the axes of the ground (3, 3) [kg.m2]; ``products``: their sign in the tensor."""
        xx, yy, zz, xy, xz, yz = self.inertia
        xy, xz, yz = products * xy, products * xz, products * yz
        own = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        return self.turn @ own @ self.turn.T

    def joined(self, other: Body) -> Body:
        """Both as one body, in the axes of this one."""
        mass = self.mass + other.mass
        centre = (self.mass * np.array(self.centre) + other.mass * np.array(other.centre)) / mass
        whole = np.zeros((3, 3))
        for body in (self, other):
            aside = np.array(body.centre) - centre
            whole += body.tensor() + body.mass * (aside @ aside * np.eye(3) - np.outer(aside, aside))
        own = self.turn.T @ whole @ self.turn
        xx, yy, zz, xy, xz, yz = (float(own[pair]) for pair in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
        return Body(mass, (xx, yy, zz, xy, xz, yz), (float(centre[0]), float(centre[1]), float(centre[2])), self.tilted)


FLEXIBLE: Mapping[str, Body] = {
    "rotor1": Body(
        0.656, (1.053e-3, 6.94e-5, 1.05e-3, 1.16e-5, -1.3e-7, -1.12e-5), (0.00077, 0.001733, 0.06469), tilted=True
    ),
    "link1": Body(
        2.289, (6.916e-2, 2.20e-2, 5.02e-2, 3.63e-4, -7.17e-5, 1.47e-2), (0.00478, -0.05534, 0.47136), tilted=True
    ),
    "rotor2": Body(0.656, (1.053e-3, 6.94e-5, 1.05e-3, 1.25e-5, -1.4e-7, -1.13e-5), (0.00478, -0.15272, 0.57875)),
    "link2": Body(6.24, (2.5495e-2, 1.34e-1, 1.12e-1, -1.2e-3, 1.04e-2, 8.36e-5), (0.00918, 0.01032, 0.5832)),
    "rotor3": Body(0.005, (3.9e-7, 3.9e-7, 1.5e-8, 5.0e-11, 4.0e-9, 4.0e-9), (0.29729, 0.0073, 0.615)),
    "link3": Body(0.411, (1.337e-4, 4.02e-3, 3.90e-3, -7.68e-5, -3.54e-5, 2.03e-6), (0.4049, 0.00354, 0.57109)),
}
"""Tables VIII and IX: the final model."""

SIMPLE: Mapping[str, Body] = {
    "link1": Body(
        3.136, (1.406e-1, 2.01e-2, 1.28e-1, -7.9e-3, -3.95e-3, 2.04e-2), (-0.0185, -0.043, 0.376), tilted=True
    ),
    "link2": Body(6.202, (2.51e-2, 1.3e-1, 1.13e-1, 5.36e-5, 1.21e-2, 2.18e-5), (0.00044, 0.00323, 0.5837)),
    "link3": Body(0.412, (1.41e-4, 4.05e-3, 3.92e-3, -2.5e-5, -1.37e-5, 2.45e-7), (0.3895, 0.0012, 0.5713)),
}
"""Tables II and III: the robot without rotors, which the robotics approach is for."""

DAMPING = (2.36e-5, 1.325e-5, 6.5e-6)
"""c_r between stator and rotor [N.m.s/rad], table X."""
STIFFNESS = (488.0, 503.0, 67.0)
"""k_r between rotor and link [N.m/rad], table X."""


@dataclass(frozen=True)
class Gear:
    """A gear of table IV, whose teeth bend as cantilevers.

    Attributes:
        diameter: D [mm].
        width: b as printed [mm].
        thickness: h [mm].
        length: L [mm].
        moment: I [mm4] as printed.
        stiffness: k [N.m/rad] as printed.
        true_width: b that gives the printed moment [mm].
    """

    diameter: float
    width: float
    thickness: float
    length: float
    moment: float
    stiffness: float
    true_width: float


GEARS = (
    Gear(7.0, 4.0, 1.35, 1.5, 1.845, 1340.0, 9.0),
    Gear(32.5, 4.0, 1.35, 1.5, 1.845, 28871.0, 9.0),
    Gear(11.0, 6.0, 1.35, 1.5, 1.23, 2204.0, 6.0),
    Gear(45.0, 6.0, 1.35, 1.5, 1.23, 36900.0, 6.0),
)
SHAFT = (10.0, 62.0, 981.75, 1267.0)
"""Diameter [mm], length [mm], polar moment [mm4] and stiffness [N.m/rad] of the shaft, table IV."""
TEXT_MODULI = (207e9, 84e9)  # [Pa] E and G as section 3.1 states them
TABLE_MODULI = (200e9, 80e9)  # [Pa] E and G that table IV was computed with


def second_moment(width: float, thickness: float) -> float:
    """b h^3 / 12 [mm4] from millimetres."""
    return width * thickness**3 / 12.0


def tooth_stiffness(moment: float, diameter: float, length: float, modulus: float) -> float:
    """k = E I r^2 / L^3 [N.m/rad]: a third of a cantilever's, which is what table IV holds.

    Args:
        moment: I [mm4].
        diameter: D [mm].
        length: L [mm].
        modulus: E [Pa].
    """
    return modulus * moment * 1e-12 * (0.5e-3 * diameter) ** 2 / (1e-3 * length) ** 3


def shaft_stiffness(moment: float, length: float, modulus: float) -> float:
    """k = G J / L [N.m/rad], from mm4, mm and Pa."""
    return modulus * moment * 1e-12 / (1e-3 * length)


def in_series(stiffnesses: tuple[float, ...]) -> float:
    """Stiffness of springs one behind the other [N.m/rad]."""
    return 1.0 / sum(1.0 / value for value in stiffnesses)
