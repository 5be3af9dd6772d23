"""Small diagnoses for pictures, report and files: bench and hopper, short runs, few causes to choose from."""

from __future__ import annotations

from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.log.types import MeasuredSet
from sealegs.gap.verdict.verdict import JointDiagnosis

from testbed import hidden_bench, hidden_hopper
from tests.made_once import made_once

CONSIDERED = ("friction.load_dependent", "friction.viscous", "drive.delay")


@made_once
def small_diagnosis() -> tuple[JointDiagnosis, MeasuredSet]:
    """A bench that hides friction which grows with load, and what was found."""
    data, _ = hidden_bench(
        {"friction.load_dependent": "clear"}, seed=1, load=("medium", "heavy", "light"), duration=3.0
    )
    (found,) = diagnose(data, causes=CONSIDERED)
    return found, data


CONSIDERED_OF_HOPPER = ("spring.stiffness", "transmission.backlash", "load.mass", "contact.slope", "contact.friction")


@made_once
def small_hopper() -> tuple[tuple[JointDiagnosis, ...], MeasuredSet]:
    """A hopper with play in the belt of its knee, on a slope, and what was found: hip, knee and ground."""
    data, _ = hidden_hopper({"transmission.backlash": "clear", "contact.slope": "clear"}, seed=5, duration=6.0)
    return tuple(diagnose(data, causes=CONSIDERED_OF_HOPPER)), data
