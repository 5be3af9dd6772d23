"""Every number of the leg, with the place where it was printed; what the paper leaves open is marked assumed.

The paper is paper 000, "On finding the relevant dynamics for model based controlling walking robots". Numbers of its
motors, gears and friction (tables II to V) stand in ``configs/actuator/silo4.yaml``, but for what turns in them.
"""

from __future__ import annotations

import math

from ..engine.numbers import Number

LINKS = (1, 2, 3)
GRAVITY = 9.81  # [m/s2]: with it, table VII's u and w follow from table I
MOMENTS = ("xx", "xy", "xz", "yy", "yz", "zz")

# Table I: mass [kg], length [m], centre of mass [m], inertia about the Denavit-Hartenberg origin [kg.m2] of each link
_LINKS = {
    1: (1.22, 0.0600, (-0.0122, 0.1010, 0.0004), (18.2e-3, 1.7e-3, 0.002e-3, 0.6e-3, -0.03e-3, 18.4e-3)),
    2: (1.26, 0.2384, (-0.1094, 0.0114, -0.0008), (0.6e-3, 1.8e-3, -0.17e-3, 22.4e-3, 0.01e-3, 22.5e-3)),
    3: (0.63, 0.2385, (-0.0845, -0.0025, 0.0039), (0.3e-3, -0.01e-3, 0.17e-3, 10.8e-3, 0.0, 10.8e-3)),
}
# Table V: rotor [kg.m2], gear, coupling between planetary and skew-axis gear [kg.m2], skew-axis gear
_ROTORS = {1: (2.3e-6, 246.0, 0.0, 1.0), 2: (6.4e-6, 14.0, 6.5e-6, 20.5), 3: (4.9e-6, 14.0, 6.5e-6, 20.5)}


def _link(link: int) -> dict[str, Number]:
    mass, length, centre, inertia = _LINKS[link]
    part = f"link{link}"
    return {
        f"{part}_mass": Number(mass, "kg", "paper 000, table I", 1e-3),
        f"{part}_length": Number(length, "m", "paper 000, table I", 1e-3),
        **{
            f"{part}_centre_{axis}": Number(value, "m", "paper 000, table I", -1.0, 1.0)
            for axis, value in zip("xyz", centre, strict=True)
        },
        **{
            f"{part}_inertia_{key}": Number(value, "kg.m2", "paper 000, table I", -1.0, 1.0)
            for key, value in zip(MOMENTS, inertia, strict=True)
        },
    }


def _rotor(joint: int) -> dict[str, Number]:
    rotor, planetary, coupling, skew = _ROTORS[joint]
    return {
        f"rotor{joint}_inertia": Number(rotor, "kg.m2", "paper 000, table V: J_m", 0.0, 1.0),
        f"coupling{joint}_inertia": Number(coupling, "kg.m2", "paper 000, table V: J_e", 0.0, 1.0),
        f"planetary{joint}_gear": Number(planetary, "-", "paper 000, table V: N_p", 1.0, 1e4),
        f"skew{joint}_gear": Number(skew, "-", "paper 000, table V: N_s", 1.0, 1e4),
    }


NUMBERS = {
    **{key: number for link in LINKS for key, number in _link(link).items()},
    **{key: number for joint in LINKS for key, number in _rotor(joint).items()},
    "product_sign": Number(
        1.0,
        "-",
        "paper 000, table VII: 1, products of inertia as the paper took table I's, integrals of x y; -1: as elements "
        "of the tensor, which table I's are",
        -1.0,
        1.0,
    ),
    "base_height": Number(0.45, "m", "assumed: of the first joint over the floor, on a stand", 0.1, 10.0),
    "foot_radius": Number(0.012, "m", "assumed", 1e-3, 0.1),
}

LIMITS = {  # [rad] assumed: foot in front, from near the body to nearly stretched
    "joint_1": (-1.2, 1.2),
    "joint_2": (-0.7, 0.9),
    "joint_3": (-2.3, -0.5),
}
STANCE = (0.0, math.radians(15.0), math.radians(-105.0))  # [rad] assumed: link 3 upright under a raised knee
