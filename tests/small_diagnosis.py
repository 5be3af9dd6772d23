"""A small diagnosis that pictures and report are tried on: hidden bench, short runs, few causes to choose from."""

from __future__ import annotations

import functools

import pytest
from sealegs.gap.log.types import MeasuredSet
from sealegs.gap.verdict.diagnosis import diagnose
from sealegs.gap.verdict.verdict import JointDiagnosis

from testbed import hidden_bench
from tests.few_causes import few

CONSIDERED = ("friction.load_dependent", "friction.viscous", "drive.delay")


@functools.cache
def small_diagnosis() -> tuple[JointDiagnosis, MeasuredSet]:
    """A bench that hides friction which grows with load, and what was found."""
    data, _ = hidden_bench(
        {"friction.load_dependent": "clear"}, seed=1, load=("medium", "heavy", "light"), duration=6.0
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sealegs.gap.search.forward.catalogue", few(*CONSIDERED))
        (found,) = diagnose(data)
    return found, data
