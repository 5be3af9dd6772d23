"""The arm's rows, and another value of each of its chosen numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from sealegs.envs.arm import trajectory
from sealegs.envs.arm.parameters import NUMBERS
from sealegs.envs.arm.tables import GEARS, SIMPLE, STIFFNESS, TABLE_MODULI
from sealegs.papers.arm import axes, choices, control, dynamics, paper, readings
from sealegs.papers.arm import rows as arm
from sealegs.papers.published import Row

from .changes import Change, assumed_numbers, attribute, item

LOWER = np.logspace(-5.5, 0.5, 13)  # [N.m.s/rad] another range of c_r
YOUNG, SHEAR = TABLE_MODULI
NINTH = (0.0, 0.0, 0.0, 0.0, 0.0, 126.0, -420.0, 540.0, -315.0, 70.0)
"""The way of the lowest power on which all joints start at rest."""


def rows() -> Sequence[Row]:
    """All rows."""
    forget()
    found = arm.rows(paper.run(say=lambda line: None))
    forget()
    return found


def forget() -> None:
    """What was computed with other numbers."""
    for cached in (axes.printed_axes, axes.simple_axes, dynamics._default_torques):
        cached.cache_clear()


def both(name: str, value: object, *owners: object) -> Change:
    """Another value under the same name in several modules."""
    return together(*(attribute(owner, name, value) for owner in owners))


def together(*changes: Change) -> Change:
    """Several changes at once."""

    def all_of_them(patch: pytest.MonkeyPatch) -> None:
        for change in changes:
            change(patch)

    return all_of_them


def default(owner: type, **values: object) -> Change:
    """A dataclass some of whose defaults are others."""
    fields = [field for field in vars(owner)["__dataclass_fields__"].values() if field.init]
    given = owner.__init__.__defaults__ or ()
    names = [field.name for field in fields][-len(given) :]
    return attribute(owner.__init__, "__defaults__",
                     tuple(values.get(name, value) for name, value in zip(names, given, strict=True)))  # fmt: skip


def cut(hinge: axes.Hinge) -> axes.Hinge:
    """The hinge with table XII's Z of joint 2 on link 1 moved."""
    (start, (x, y, z)) = hinge.on_second
    return replace(hinge, on_second=(start, (x, y, z + 1e-3)))


def of_readings(change: str) -> Change:
    """Other readings: without the sought ones but the first, or with another one in the plain one's place."""
    whole = readings.readings

    def few() -> dict[str, readings.Reading]:
        found = whole()
        return {name: replace(item, damping=(0.0, 0.0, 0.0)) if name == "motor 1" else item
                for name, item in found.items()}  # fmt: skip

    def other() -> dict[str, readings.Reading]:
        found = whole()
        return {**found, readings.PLAIN: found["motor 1"]}

    return both("readings", few if change == "sought" else other, paper)


def referred(joints: int) -> dynamics.Three:
    """c_r with other gears in joints 2 and 3."""
    first, second, third = REFERRED(joints)
    return (first, 0.01 * second, 0.01 * third) if joints > 1 else (first, second, third)


REFERRED = readings.referred
FIRST = SIMPLE["link1"]
MOTOR_1 = dynamics.Joints(stator_damping=REFERRED(1), link_stiffness=STIFFNESS)
OTHERWISE: Mapping[str, Change] = {
    **{name: change for name, change in assumed_numbers(NUMBERS, -1.0).items() if name in choices.INERTIA},
    "way": item(trajectory.WAYS, "septic", NINTH),
    "reading": together(of_readings("plain"), attribute(paper, "FINAL_MODEL", MOTOR_1)),
    "y of link 1": item(SIMPLE, "link1", replace(FIRST, centre=(FIRST.centre[0], -0.044, FIRST.centre[2]))),
    "Z of joint 2 on link 1": attribute(
        arm, "HINGES", tuple(cut(h) if h is axes.HINGES[1] else h for h in axes.HINGES)
    ),
    "width of gears 1 and 2": attribute(
        arm, "GEARS", tuple(replace(gear, true_width=gear.true_width + 1.0 * (k < 2)) for k, gear in enumerate(GEARS))
    ),
    "E": attribute(arm, "TABLE_MODULI", (1.1 * YOUNG, SHEAR)),
    "third of a cantilever": attribute(arm, "tooth_stiffness", lambda *of: 1.1 * TOOTH(*of)),
    "G": attribute(arm, "TABLE_MODULI", (YOUNG, 1.1 * SHEAR)),
    "other gears": attribute(readings, "referred", referred),
    "tool on the axes of tables XI and XII": default(axes.Axes, tool=(0.5, 0.0, 0.577)),
    "range of c_r": together(both("DAMPINGS", LOWER, paper, arm), both("HIGHEST", float(LOWER[9]), paper, arm)),
    "c_r beside": together(
        both("BASES", (2e-4, 2e-3, 2e-2, 2e-1), paper, arm),
        both("BESIDE", (0.0, 2e-6, 2e-5, 2e-4, 2e-3, 2e-2, 2e-1, 2.0), paper, arm),
    ),
    "feedback": default(control.Robust, slope=20.0),
    "softest real joint": attribute(arm, "SOFTEST", 1e-9),
    "readings": of_readings("sought"),
}
TOOTH = arm.tooth_stiffness
