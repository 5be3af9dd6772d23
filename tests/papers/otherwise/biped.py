"""The biped's rows in short runs, and another value of each of its chosen numbers.

The runs are shorter than the paper's: fewer hops, chirps of one cycle, and one of the controllers tuned on rigid
cables. What they find is worth nothing, but it moves with the same numbers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import pytest
from sealegs.envs.biped import drive
from sealegs.envs.biped.drive import ANGLE, DRIVES, PULLEYS, SHAPE
from sealegs.envs.biped.parameters import NUMBERS
from sealegs.papers.biped import balance, choices, hopping, paper, report, return_map, rig
from sealegs.papers.biped.controller import Gait
from sealegs.papers.published import Row

from .changes import Change, assumed_numbers, attribute, item

SHORT = 4.0  # [s]
SHORTER: tuple[Change, ...] = (
    attribute(paper, "HOPS", 6),
    attribute(paper, "SHOWN", (2, 3)),
    attribute(rig, "CYCLES", 1),
    attribute(return_map, "SETTLING", 4),
    attribute(return_map, "HOPS", 4),
)
EXPERIMENTS = paper.changes


def few() -> list[tuple[str, str, dict[str, Any]]]:
    """Of all runs with another number those that a row's figure is made of, with one controller of each kind."""
    wanted = [row for row in EXPERIMENTS() if row[0] in (paper.CHOSEN, paper.NO_BIAS, *paper.TORSO)]
    return wanted + [row for row in EXPERIMENTS() if row[0] == paper.ON_RIGID][:3]


def rows() -> Sequence[Row]:
    """All rows."""
    with pytest.MonkeyPatch.context() as patch:
        settled = attribute(paper, "SETTLED", paper.SETTLED - 7)
        for change in (*SHORTER, settled, attribute(paper, "changes", few)):
            change(patch)
        return report.rows(report.run(SHORT, say=lambda line: None))


def gait(**values: Any) -> Change:
    """A controller whose defaults are others."""
    defaults = tuple(values.get(field.name, field.default) for field in fields(Gait))
    return attribute(Gait.__init__, "__defaults__", defaults)


def number(name: str, **values: Any) -> Change:
    """A drive with other numbers."""
    return item(DRIVES, name, replace(DRIVES[name], **values))


def together(*changes: Change) -> Change:
    """Several changes at once."""

    def all_of_them(patch: pytest.MonkeyPatch) -> None:
        for change in changes:
            change(patch)

    return all_of_them


def pulleys(factors: Mapping[str, float]) -> Change:
    """Pulleys of other inertia, by kind of drive."""
    return together(*(item(PULLEYS, kind, tuple(f * value for value in PULLEYS[kind])) for kind, f in factors.items()))


CHOSEN = Gait()
OTHERWISE: Mapping[str, Change] = {
    **{name: change for name, change in assumed_numbers(NUMBERS, 1.05).items() if name in choices.ROBOT},
    "gains": gait(gains=(29.0, 6.4)),
    "lean": gait(torso=1.05 * CHOSEN.torso),
    "travel": gait(travel=1.2 * CHOSEN.travel),
    "gains_on_rigid": attribute(paper, "TUNED_ON_RIGID", choices.TUNED_ON_RIGID[1:]),
    "steady": attribute(report, "STEADY", 1),
    "limits": gait(limits=(7.0, 14.0)),
    "start": attribute(hopping, "DROP", 0.06),
    "encoders": together(
        attribute(rig, "NOISE", 0.6),
        attribute(hopping, "ENCODER", 1024),
        attribute(rig, "ENCODER", 1024),
        attribute(rig, "JOINT_TICKS", 2**14),
        attribute(balance, "JOINT_TICKS", 2**14),
        attribute(return_map, "FINE", 2**20),
    ),
    "order_of_table_IV": together(
        number("left_leg_angle", motor_constant=1.332), number("right_leg_shape", motor_constant=1.087),
        pulleys({ANGLE: 0.9, SHAPE: 1.4}),
    ),
    "mean_pulleys": pulleys({ANGLE: 1.1, SHAPE: 1.1}),
    "right_cable": number("right_leg_angle", cable_stiffness=3.0),
    "spring_damping": attribute(drive, "SPRING_DAMPING", 2.0),
    "excitation": item(rig.MAGNITUDES, SHAPE, ((0.2, 1.6), (0.25, 3.8))),
    "settled": attribute(paper, "SETTLED", 9),
    "return_map": attribute(return_map, "FINE", 2**20),
    "fingertip": attribute(balance, "FINGERTIP", 2.0),
}  # fmt: skip
