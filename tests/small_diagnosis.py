"""A small diagnosis that pictures and report are tried on: hidden bench, short runs, few causes to choose from."""

from __future__ import annotations

import functools

import pytest

from gap.diagnosis import diagnose
from gap.log_types import MeasuredSet
from gap.verdict import JointDiagnosis
from tests.few_causes import few
from tests.plant import hidden_bench

CONSIDERED = ("friction.load_dependent", "friction.viscous", "drive.delay")


@functools.cache
def small_diagnosis() -> tuple[JointDiagnosis, MeasuredSet]:
    """A bench that hides friction which grows with load, and what was found."""
    data, _ = hidden_bench(
        {"friction.load_dependent": "clear"}, seed=1, load=("medium", "heavy", "light"), duration=6.0
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gap.search.catalogue", few(*CONSIDERED))
        (found,) = diagnose(data)
    return found, data
