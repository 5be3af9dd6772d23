"""The hexapod's rows in short runs, and another value of each of its chosen numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import pytest
from sealegs.actuators import Chain
from sealegs.envs.hexapod import gait
from sealegs.envs.hexapod.gait import Tripod
from sealegs.envs.hexapod.parameters import NUMBERS
from sealegs.envs.hexapod.robot import HORIZONTAL, KINDS, ROTATION, VERTICAL
from sealegs.papers.hexapod import experiments, friction_bench, measures, paper
from sealegs.papers.hexapod import rows as hexapod
from sealegs.papers.published import Row

from .changes import Change, assumed_numbers, attribute, item

SHORT = {"CYCLES": 2.0, "STEADY": 1.25, "SPEEDS": (0.01,), "FORCES": experiments.FORCES[::5]}
STEP_CYCLE = 5.0  # [s] at the gait's own speed, in place of 12: shorter steps
FACTOR = 1.1


def rows() -> Sequence[Row]:
    """All rows."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gait, "CYCLE", STEP_CYCLE)
        for name, value in SHORT.items():
            patch.setattr(experiments, name, value)
        for name in ("CHANGED", "GEARS"):
            patch.setattr(experiments, name, getattr(experiments, name)[:1])
        return hexapod.rows(experiments.run(1.0, say=lambda line: None))


def chains(*changed: tuple[str, str]) -> Change:
    """Other values in the chains of the robot: kinds of joints and ``stage.parameter``, all times :data:`FACTOR`."""
    whole = paper.chains_of

    def others(file: str) -> dict[str, Chain]:
        found = whole(file)
        for kind, path in changed:
            stage, key = path.split(".")
            for name, chain in found.items():
                of = chain.find(stage)
                if name.endswith(kind) and of is not None and getattr(of, key) != 0.0:
                    found[name] = chain.with_value(path, FACTOR * getattr(of, key))
        return found

    def change(patch: pytest.MonkeyPatch) -> None:
        for module in (paper, friction_bench):
            patch.setattr(module, "chains_of", others)
        joint = friction_bench.planted({}, control=True)
        patch.setattr(experiments, "JOINT", joint)
        patch.setattr(hexapod, "JOINT", joint)
        patch.setattr(experiments, "COULOMB", joint.value("friction.coulomb"))

    return change


def walking(key: str, value: float) -> Change:
    """Another of the numbers that walks have in place of the chains' own."""
    return item(paper.WALKING, key, value)


def both(*changes: Change) -> Change:
    """Several changes as one."""

    def change(patch: pytest.MonkeyPatch) -> None:
        for each in changes:
            each(patch)

    return change


OTHERWISE: Mapping[str, Change] = {
    **assumed_numbers(NUMBERS, 0.95),  # a larger ratio cannot be built
    "chassis_forward": item(NUMBERS, "chassis_forward", replace(NUMBERS["chassis_forward"], value=0.01)),  # is 0
    "motor": chains(*((kind, "dc_motor.motor_constant") for kind in KINDS)),
    "controllers": chains(*((kind, "position_pi.gain") for kind in KINDS)),
    "vertical_coulomb": chains((VERTICAL, "friction.coulomb")),
    "vertical_viscous": chains((VERTICAL, "friction.viscous")),
    "horizontal_coulomb": chains((HORIZONTAL, "friction.coulomb")),
    "rotation_friction": chains((ROTATION, "friction.coulomb")),
    "breakaway_at_rest": both(
        attribute(paper, "BREAKAWAY_AT_REST", 300.0),
        attribute(experiments, "BREAKAWAY_AT_REST", 300.0),
        attribute(hexapod, "BREAKAWAY_AT_REST", 600.0),
    ),
    "breakaway_walking": walking(paper.BREAKAWAY_WALKING, 720.0),
    "horizontal_load": chains((HORIZONTAL, "friction.load"), (HORIZONTAL, "friction.load_quadratic")),
    "gait": both(*(attribute(module, "Tripod", partial(Tripod, lift=0.05)) for module in (paper, experiments))),
    "bench": attribute(friction_bench.steady, "__defaults__", ((0.003, 0.005, 0.007, 0.009),)),
    "settled": both(
        attribute(measures, "AT_REST", 0.04),
        *(attribute(function, "__defaults__", (0, -1, 1.8)) for function in (measures.settled, measures.drawing)),
    ),
    "spread_by_leg": attribute(friction_bench, "SPREAD", 0.25),
}
