"""Every number of the hexapod, with the place where it was printed; what the text leaves open is marked assumed.

The paper is paper 001, "Dynamic simulation of six-legged robots with a focus on joint friction" (AMRU5). Of its tables
only table 10 is at hand. Numbers of motors, gears, controllers and joint friction stand in
``configs/actuator/amru5_*.yaml``, those of the gait in :mod:`sealegs.envs.hexapod.gait`.
"""

from __future__ import annotations

from ..engine.numbers import Number

LEGS = 6

_TABLE = {  # table 10: mass [kg], inertia about the centre of mass [kg.cm2] around x, y, z; links lie along x
    "body": (8.215, 1063.0, 1198.0, 843.0),
    "chassis": (2.895, 163.37, 196.09, 66.68),
    "ac": (0.157, 0.19, 11.42, 11.42),
    "bd": (0.055, 0.50, 0.47, 0.47),
    "de": (0.143, 0.17, 8.25, 8.28),
    "cf": (0.564, 0.74, 121.51, 121.67),
}
_LENGTH = "assumed: from table 10, links as uniform rods that stand over their pins by 20 mm, see docs/hexapod.md"

NUMBERS = {
    **{f"{part}_mass": Number(row[0], "kg", "paper 001, table 10", 1e-3) for part, row in _TABLE.items()},
    **{
        f"{part}_inertia_{axis}": Number(row[k] * 1e-4, "kg.m2", "paper 001, table 10", 1e-9)
        for part, row in _TABLE.items()
        for k, axis in enumerate("xyz", 1)
    },
    "rotor_mass": Number(0.186, "kg", "paper 001, table 10; three ride in each leg chassis"),
    "rotor_inertia": Number(6e-6, "kg.m2", "paper 001, table 10: I_zz of a rotor"),
    "rotation_gear": Number(
        984.0, "rad/rad", "assumed: planetary 246:1 and sprocket chain 4:1 (table 1 is missing)", 1.0
    ),
    "screw_gear": Number(35186.0, "rad/m", "assumed: ball screws of 2.5 mm lead behind 14:1 (table 1 is missing)", 1.0),
    "winding_loss": Number(
        915.0, "W/(N.m)2", "assumed: resistance over squared motor constant of the motors in configs/actuator/amru5_*"
    ),
    "leg_radius": Number(
        0.175, "m", "paper 001, 2.1: radius of the body; that the legs turn at its rim is assumed", 0.01
    ),
    "ratio": Number(8.0, "-", "assumed: AC over AB and CF over BD; " + _LENGTH[9:], 1.5, 20.0),
    "ab_length": Number(0.032, "m", _LENGTH, 0.005),
    "bd_length": Number(0.061, "m", _LENGTH, 0.005),
    "link_centre": Number(0.5, "-", "assumed: centre of mass of a link at its middle", 0.05, 0.95),
    "chassis_forward": Number(0.0, "m", "assumed: centre of mass of a leg chassis from its axis", -0.1, 0.2),
    "stance_radius": Number(0.535, "m", "assumed: of the feet about the body; paper 001, 2.1: up to 0.7 m", 0.3, 0.75),
    "stance_height": Number(0.28, "m", "assumed: of the pantograph's horizontal screws over the sole", 0.1, 0.5),
    "foot_radius": Number(0.015, "m", "assumed", 1e-3),
    "floor_friction": Number(0.8, "-", "assumed: gamma of paper 001, (20)", 1e-3),
    "penetration": Number(0.0023, "m", "paper 001, 4.2.1: standing on three legs", 1e-4, 0.05),
    "ground_damping": Number(1500.0, "N.s/m", "assumed: of the ground at that penetration", 1.0),
    "slip_speed": Number(1e-3, "m/s", "assumed: v_lim of paper 001, (20), at the load of three legs", 1e-5, 1.0),
}

# [rad], [m], [m] to both sides of the stance, assumed: twice what the reference gait needs; horizontal: as far out as
# the printed 0.7 m from the middle of the body (paper 001, 2.1)
GOAL_RANGE = {"rotation": 0.3, "vertical": 0.012, "horizontal": 0.0206}
