"""A small diagnosis of a hopper that pictures, report and files are tried on: short runs, few causes to choose from."""

from __future__ import annotations

from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.log.types import MeasuredSet
from sealegs.gap.verdict.verdict import JointDiagnosis

from testbed import hidden_hopper
from tests.made_once import made_once

CONSIDERED = ("spring.stiffness", "transmission.backlash", "load.mass", "contact.slope", "contact.friction")


@made_once
def small_hopper() -> tuple[tuple[JointDiagnosis, ...], MeasuredSet]:
    """A hopper with play in the belt of its knee, on a slope, and what was found: hip, knee and ground."""
    data, _ = hidden_hopper({"transmission.backlash": "clear", "contact.slope": "clear"}, seed=5, duration=6.0)
    return tuple(diagnose(data, causes=CONSIDERED)), data
