"""Joints of a machine in processes of their own."""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import pytest
from sealegs.gap.log import LogError
from sealegs.gap.log.finding import Finding
from sealegs.gap.log.types import MeasuredRun
from sealegs.gap.search.journal import keeping
from sealegs.gap.verdict.columns import chosen
from sealegs.gap.verdict.evidence import Refused
from sealegs.gap.verdict.parallel import side_by_side
from sealegs.gap.verdict.refusal import refuse
from sealegs.gap.verdict.request import Request
from sealegs.gap.verdict.verdict import JointDiagnosis

from tests.waiting import wait_until


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


@pytest.mark.long
def test_processes_of_joints_end_with_a_program_that_is_killed(tmp_path: Path) -> None:
    program = multiprocessing.get_context("spawn").Process(target=diagnoses_for_ever, args=(tmp_path,))
    program.start()
    wait_until(lambda: len(list(tmp_path.glob("*.pid"))) == 2, said=lambda: str(program.exitcode))
    workers = [int(file.stem) for file in tmp_path.glob("*.pid")]
    program.kill()
    program.join()
    wait_until(lambda: not any(lives(worker) for worker in workers))


def diagnoses_for_ever(folder: Path) -> None:
    request = Request()
    with keeping(folder / "fits.jsonl"):
        side_by_side(partial(waits_for_ever, folder), (), ["a", "b", "c"], (), request, 2, lambda joint: None)


def waits_for_ever(
    folder: Path, runs: Sequence[MeasuredRun], joint: str, findings: Sequence[Finding], request: Request
) -> JointDiagnosis:
    del runs, findings, request
    (folder / f"{os.getpid()}.pid").touch()
    threading.Event().wait()
    return refuse(joint, Refused(joint, "it is only a test"))


def lives(process: int) -> bool:
    """Whether it runs; one that has ended and that nobody asked after does not."""
    file = Path(f"/proc/{process}/stat")
    try:
        return file.read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_joints_that_are_asked_for_are_those_of_the_log() -> None:
    assert chosen(["hip", "knee", "ankle"], ["ankle", "hip"]) == ["hip", "ankle"]
    assert chosen(["hip", "knee"], None) == ["hip", "knee"]
    with pytest.raises(LogError, match=r"no joint 'kne' \(did you mean 'knee'\?\); joints= takes hip, knee\.$"):
        chosen(["hip", "knee"], ["kne"])
