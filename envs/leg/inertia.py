"""Inertia of the links: what table I prints, what the equations of motion need, and what a body of an engine can be.

Table I's numbers are about the origins of the Denavit-Hartenberg frames. Its products are elements of the inertia
tensor: with that sign, all three links are bodies that can exist. The paper put them into its equations as integrals of
``x y``, and only so does table VII come out (its ``e`` would be -0.0016 and not -0.0053). Links 1 and 2 are then bodies
that cannot exist. The leg that moves by those equations can: :func:`realizable` gives link 2 a little more inertia and
takes as much from the joints, where only their sum counts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .parameters import LINKS

LEAST = 1e-6  # [kg.m2] second moment that a body has in every direction
PLANE = np.diag([1.0, 1.0, 0.0])  # the plane in which links 2 and 3 turn


@dataclass(frozen=True)
class Body:
    """A link as mass, centre of mass and second moments about an origin.

    Attributes:
        mass: [kg].
        centre: from the origin (3,) [m].
        moments: integral of ``r r^T`` about the origin (3, 3) [kg.m2].
    """

    mass: float
    centre: np.ndarray
    moments: np.ndarray

    def moved(self, by: np.ndarray) -> Body:
        """The body about an origin that lies ``by`` back, so that its coordinates grow by it (3,) [m]."""
        first = self.mass * self.centre
        moments = self.moments + np.outer(by, first) + np.outer(first, by) + self.mass * np.outer(by, by)
        return Body(self.mass, self.centre + by, moments)

    def central(self) -> np.ndarray:
        """Second moments about the centre of mass (3, 3) [kg.m2]."""
        return self.moments - self.mass * np.outer(self.centre, self.centre)

    def tensor(self) -> np.ndarray:
        """Inertia tensor about the centre of mass (3, 3) [kg.m2]."""
        central = self.central()
        return np.trace(central) * np.eye(3) - central

    def possible(self) -> bool:
        """Whether masses can be laid out so."""
        return bool(np.linalg.eigvalsh(self.central())[0] > 0.0)


def printed(values: Mapping[str, float], link: int) -> Body:
    """A link about its joint, its frame at the joint turned as the Denavit-Hartenberg frame at its end.

    ``product_sign`` says how table I's products are read.
    """
    part, sign = f"link{link}", values["product_sign"]
    xx, xy, xz, yy, yz, zz = (values[f"{part}_inertia_{key}"] for key in ("xx", "xy", "xz", "yy", "yz", "zz"))
    moments = np.array(
        [
            [0.5 * (yy + zz - xx), sign * xy, sign * xz],
            [sign * xy, 0.5 * (xx + zz - yy), sign * yz],
            [sign * xz, sign * yz, 0.5 * (xx + yy - zz)],
        ]
    )
    centre = np.array([values[f"{part}_centre_{axis}"] for axis in "xyz"])
    return Body(values[f"{part}_mass"], centre, moments).moved(np.array([values[f"{part}_length"], 0.0, 0.0]))


def realizable(values: Mapping[str, float]) -> tuple[dict[int, Body], np.ndarray]:
    """Links that an engine can take, and what is then to be added to the inertia of the joints (3,) [kg.m2].

    Both together move as :func:`printed` links do, as long as the first joint stands on the ground upright.
    """
    bodies = {link: printed(values, link) for link in LINKS}
    if not bodies[1].possible():  # of link 1, only the inertia about its joint moves anything
        bodies[1] = printed({**values, "product_sign": -values["product_sign"]}, 1)
    second, extra = bodies[2], 0.0
    while np.linalg.eigvalsh(second.central() + extra * PLANE)[0] < LEAST and extra < 1.0:
        extra += 1e-5
    bodies[2] = Body(second.mass, second.centre, second.moments + extra * PLANE)
    return bodies, np.array([-extra, -2.0 * extra, 0.0])


def rotors(values: Mapping[str, float]) -> np.ndarray:
    """Inertia at the joints of what turns in motors and gears: equations (17) to (19) (3,) [kg.m2]."""
    found = []
    for joint in LINKS:
        planetary, skew = values[f"planetary{joint}_gear"], values[f"skew{joint}_gear"]
        found.append(
            values[f"rotor{joint}_inertia"] * (planetary * skew) ** 2 + values[f"coupling{joint}_inertia"] * skew**2
        )
    return np.array(found)
