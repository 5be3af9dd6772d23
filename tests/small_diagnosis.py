"""A small diagnosis that pictures and report are tried on: hidden bench, short runs, few causes to choose from."""

from __future__ import annotations

from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.log.types import MeasuredSet
from sealegs.gap.verdict.verdict import JointDiagnosis

from testbed import hidden_bench
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
