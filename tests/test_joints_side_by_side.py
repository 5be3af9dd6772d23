"""Joints of a machine in processes of their own."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Sequence
from pathlib import Path

import pytest
from sealegs.gap.log.finding import Finding
from sealegs.gap.log.types import MeasuredRun
from sealegs.gap.search.journal import keeping
from sealegs.gap.verdict.evidence import Refused
from sealegs.gap.verdict.parallel import side_by_side
from sealegs.gap.verdict.refusal import refuse
from sealegs.gap.verdict.request import Request
from sealegs.gap.verdict.verdict import JointDiagnosis


@pytest.mark.long
def test_joints_are_diagnosed_side_by_side_and_one_whose_process_dies_again(tmp_path: Path) -> None:
    found, told = [], []
    request = Request(progress=told.append)
    with keeping(tmp_path / "fits.jsonl"):
        joints = side_by_side(dies_in_a_process, (), ["a", "b", "c"], (), request, 2, found.append)
    assert [joint.joint for joint in joints] == ["a", "b", "c"]
    assert {joint.joint for joint in found} == {"a", "b", "c"} and any("without a result" in text for text in told)


def dies_in_a_process(
    runs: Sequence[MeasuredRun], joint: str, findings: Sequence[Finding], request: Request
) -> JointDiagnosis:
    del runs, findings, request
    if joint == "b" and multiprocessing.parent_process() is not None:
        os._exit(1)
    return refuse(joint, Refused(joint, "it is only a test"))
