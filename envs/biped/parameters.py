"""Every number of the biped, with the place where it was printed; what the paper leaves open is marked assumed.

The paper is paper 003, "Identification of a bipedal robot with a compliant drivetrain" (MABEL). Numbers of a motor are
printed at the motor; :mod:`sealegs.envs.biped.drive` carries them to the leg coordinates that the chains act on.
"""

from __future__ import annotations

from ..engine.numbers import Number

LEFT, RIGHT = "left", "right"
SIDES = (LEFT, RIGHT)

_LINKS = {  # table VII: mass [kg], centre of mass [m] forward and along the link, inertia [kg.m2] about its joint
    "torso": (40.8953, 0.01229, 0.18337, 2.3727),
    "spring_carrier": (1.8987, 0.0009406, 0.1181, 0.04377),
    "shin_carrier": (1.6987, 0.0004345, 0.08684, 0.03223),
    "thigh": (3.2818, 0.000311, 0.1978, 0.1986),
    "shin": (1.5007, 0.0009671, 0.1570, 0.08813),
}

_UNUSED: dict[str, str] = dict.fromkeys(
    ("spring_carrier", "shin_carrier"), "; without effect: where it turns to is not printed, so it rides on the hip"
)
_FITTED = "fitted to the ground law of table VI, see docs/biped.md"

NUMBERS = {
    "timestep": Number(
        0.001, "s", "paper 003, VIII-C: period of the controller; of the engine", 1e-5, 2e-3, numerical=True
    ),
    "thigh_length": Number(0.5, "m", "paper 003, I: 50 cm", 0.1),
    "shin_length": Number(0.5, "m", "paper 003, I: 50 cm; here to the sole", 0.1),
    **{f"{link}_mass": Number(row[0], "kg", "paper 003, table VII", 0.01) for link, row in _LINKS.items()},
    **{
        f"{link}_forward": Number(
            row[1], "m", f"paper 003, table VII: r_x, assumed forward{_UNUSED.get(link, '')}", -0.5, 0.5
        )
        for link, row in _LINKS.items()
    },
    **{
        f"{link}_centre": Number(row[2], "m", f"paper 003, table VII: r_y{_UNUSED.get(link, '')}", 0.0, 0.5)
        for link, row in _LINKS.items()
    },
    **{
        f"{link}_inertia": Number(row[3], "kg.m2", "paper 003, table VII; read as about the joint, see docs", 1e-4)
        for link, row in _LINKS.items()
    },
    "boom_mass": Number(7.2575, "kg", "paper 003, table VII"),
    "boom_centre": Number(1.48494153, "m", "paper 003, table VII: from the tower", 0.0),
    "boom_inertia": Number(20.4951, "kg.m2", "paper 003, table VII; read as about the tower", 1e-3),
    "boom_length": Number(2.85, "m", "assumed: end of the uniform rod that has the boom's three numbers", 0.5),
    "floor_friction": Number(1.71, "-", "paper 003, table VI: alpha_h0, friction while slipping slowly"),
    "foot_radius": Number(0.02, "m", "assumed", 1e-3),
    "contact_time": Number(0.0132, "s", f"assumed: {_FITTED}; time constant of solref", 2e-3, 1.0),
    "contact_damping": Number(0.364, "-", f"assumed: {_FITTED}; damping ratio of solref", 0.05, 10.0),
    "contact_low": Number(0.747, "-", f"assumed: {_FITTED}; impedance at touch", 0.01, 0.999),
    "contact_high": Number(0.926, "-", f"assumed: {_FITTED}; impedance within", 0.01, 0.999),
    "contact_width": Number(0.0045, "m", f"assumed: {_FITTED}; depth over which it rises", 1e-4, 0.1),
    "leg_angle": Number(0.262, "rad", "assumed: between the legs as a task starts", 0.0, 1.0),
    "leg_shape": Number(0.2094, "rad", "paper 003, (46): eta_LS of 12 degrees; as a task starts", 0.02, 1.0),
}
