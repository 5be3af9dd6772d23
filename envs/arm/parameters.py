"""Every number of the arm's model, with its source (paper 002)."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ..engine.numbers import Number
from .tables import FLEXIBLE, SIMPLE, Body

PRODUCTS = ("xx", "yy", "zz", "xy", "xz", "yz")
ABSENT, POINT = 1e-9, 1e-12  # [kg] and [kg.m2] of a rotor that a model does not have: the engine wants more than none


def _of(name: str, body: Body) -> dict[str, Number]:
    table = "paper 002, table VIII"
    rows = {f"{name}_mass": Number(body.mass, "kg", table, 1e-9)}
    for axis, value in zip("xyz", body.centre, strict=True):
        rows[f"{name}_{axis}"] = Number(value, "m", "paper 002, table IX: at zero angles", -10.0, 10.0)
    for axes, value in zip(PRODUCTS, body.inertia, strict=True):
        low = 1e-15 if axes[0] == axes[1] else -math.inf
        cut = (name, axes) == ("rotor1", "yz")
        rows[f"{name}_i{axes}"] = Number(value, "kg.m2", f"assumed: {table} cuts its power" if cut else table, low)
    return rows


NUMBERS: dict[str, Number] = {
    "height": Number(0.577, "m", "paper 002, table I: r_1", 0.1),
    "upper_length": Number(0.29, "m", "paper 002, table I: a_2", 0.01),
    "fore_length": Number(0.29, "m", "paper 002, table I: a_3", 0.01),
    **{key: number for name, body in FLEXIBLE.items() for key, number in _of(name, body).items()},
    "products": Number(
        1.0, "-", "assumed: sign with which printed products of inertia stand in the tensor, 1 or -1", -1.0, 1.0
    ),
    "gravity": Number(0.0, "m/s2", "paper 002, section 3: body forces are neglected"),
    "payload_mass": Number(0.0, "kg", "assumed: the tool carries nothing", neutral=True),
}


def body_of(values: Mapping[str, float], name: str) -> Body:
    """A body with these numbers."""
    xx, yy, zz, xy, xz, yz = (values[f"{name}_i{axes}"] for axes in PRODUCTS)
    x, y, z = (values[f"{name}_{axis}"] for axis in "xyz")
    return Body(values[f"{name}_mass"], (xx, yy, zz, xy, xz, yz), (x, y, z), FLEXIBLE[name].tilted)


def without_rotors() -> dict[str, float]:
    """Numbers of tables II and III in place of VIII and IX: three links, and rotors that weigh nothing."""
    return _links(SIMPLE)


def rotors_at_rest() -> dict[str, float]:
    """Numbers of an arm whose rotors are parts of the bodies that they stand on, and weigh nothing of their own."""
    links = {f"link{k}": FLEXIBLE[f"link{k}"].joined(FLEXIBLE[f"rotor{k + 1}"]) for k in (1, 2)}
    return _links({**links, "link3": FLEXIBLE["link3"]})


def _links(bodies: Mapping[str, Body]) -> dict[str, float]:
    """Numbers of an arm of these links, whose rotors weigh nothing."""
    values: dict[str, float] = {}
    for name in FLEXIBLE:
        if name in bodies:
            body = bodies[name]
            values[f"{name}_mass"] = body.mass
            inertia = body.inertia
            values |= {f"{name}_{axis}": value for axis, value in zip("xyz", body.centre, strict=True)}
        else:
            values[f"{name}_mass"] = ABSENT
            inertia = (POINT, POINT, POINT, 0.0, 0.0, 0.0)
        values |= {f"{name}_i{axes}": value for axes, value in zip(PRODUCTS, inertia, strict=True)}
    return values
