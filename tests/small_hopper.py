"""A small diagnosis of a hopper that pictures, report and files are tried on: short runs, few causes to choose from."""

from __future__ import annotations

import functools

import pytest
from sealegs.gap.log.types import MeasuredSet
from sealegs.gap.verdict.diagnosis import diagnose
from sealegs.gap.verdict.verdict import JointDiagnosis

from testbed.hopper import hidden_hopper

together = pytest.mark.xdist_group("small hopper")
"""Of tests that use it: it takes minutes, and is kept in the process of one worker."""
CONSIDERED = ("spring.stiffness", "transmission.backlash", "load.mass", "contact.slope", "contact.friction")


@functools.cache
def small_hopper() -> tuple[tuple[JointDiagnosis, ...], MeasuredSet]:
    """A hopper with play in the belt of its knee, on a slope, and what was found: hip, knee and ground."""
    data, _ = hidden_hopper({"transmission.backlash": "clear", "contact.slope": "clear"}, seed=5, duration=6.0)
    return tuple(diagnose(data, causes=CONSIDERED)), data
