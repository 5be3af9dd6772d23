"""Joints of a machine in processes of their own."""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections.abc import Callable, Sequence
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.managers import SyncManager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from sealegs.gap.finder.parallel import Said, side_by_side
from sealegs.gap.fleet import Job, Outcome
from sealegs.gap.fleet.run import in_processes
from sealegs.gap.load.robot import Machine
from sealegs.gap.log import LogError
from sealegs.gap.log.finding import Finding
from sealegs.gap.prepare.columns import chosen
from sealegs.gap.prepare.request import Request
from sealegs.gap.search.journal import keeping
from sealegs.gap.verdict.decide import refuse
from sealegs.gap.verdict.verdict import JointDiagnosis, Refused

from tests.raising import raising
from tests.waiting import wait_until


@pytest.mark.long
def test_joints_are_diagnosed_side_by_side_and_one_whose_process_dies_again(tmp_path: Path) -> None:
    found, told = [], []
    request = Request(progress=told.append)
    with keeping(tmp_path / "fits.jsonl"):
        joints = side_by_side(dict.fromkeys("abc", dies_in_a_process), Machine.of(()), (), request, 2, found.append)
    assert [joint.joint for joint in joints] == ["a", "b", "c"]
    assert {joint.joint for joint in found} == {"a", "b", "c"} and any("without a result" in text for text in told)


def dies_in_a_process(machine: Machine, joint: str, findings: Sequence[Finding], request: Request) -> JointDiagnosis:
    del machine, findings, request
    if joint == "b" and multiprocessing.parent_process() is not None:
        os._exit(1)
    return refuse(joint, Refused(joint, "it is only a test"))


@pytest.mark.long
@pytest.mark.parametrize("lost", [False, True])
def test_what_joints_are_at_is_told_and_no_diagnosis_needs_it(monkeypatch: pytest.MonkeyPatch, lost: bool) -> None:
    """A queue that could not be had, or whose process was killed, took all joints with it."""
    told: list[str] = []
    if lost:
        monkeypatch.setattr(SyncManager, "start", raising(EOFError()))
    joints = side_by_side(
        dict.fromkeys("abc", says), Machine.of(()), (), Request(progress=told.append), 2, lambda joint: None
    )
    assert [joint.joint for joint in joints] == ["a", "b", "c"]
    assert ("a: at work on a" in told) is not lost
    monkeypatch.undo()
    ended = multiprocessing.get_context("spawn").Manager()
    said = Said("a", ended.Queue())
    ended.shutdown()
    said("into the void")


def says(machine: Machine, joint: str, findings: Sequence[Finding], request: Request) -> JointDiagnosis:
    del machine, findings
    request.progress(f"at work on {joint}")
    return refuse(joint, Refused(joint, "it is only a test"))


def test_joints_one_after_the_other_are_named_and_counted() -> None:
    told: list[str] = []
    side_by_side(dict.fromkeys("abc", says), Machine.of(()), (), Request(progress=told.append), 1, lambda joint: None)
    assert told[0] == "a: at work on a" and told[1].startswith("a: ") and told[1].endswith("; 2 joints left")
    assert told[3].endswith("; 1 joint left") and told[5].endswith("; 0 joints left")


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
        side_by_side(
            dict.fromkeys("abc", partial(waits_for_ever, folder)), Machine.of(()), (), request, 2, lambda joint: None
        )


def waits_for_ever(
    folder: Path, machine: Machine, joint: str, findings: Sequence[Finding], request: Request
) -> JointDiagnosis:
    del machine, findings, request
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


class Here:
    """A process that does its work in this one."""

    exitcode = 0

    def __init__(self, target: Callable[..., None], args: tuple[Any, ...]) -> None:
        self.start = partial(target, *args)

    def join(self, timeout: float | None = None) -> None:
        del timeout

    def is_alive(self) -> bool:
        return False

    terminate = kill = join


def tells_its_joints(job: Job, connection: Connection, joints: int) -> None:
    connection.send(Outcome(job.name, {"joints": joints}))


def test_joints_side_by_side_take_the_cores_that_the_process_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a container with 4 of 64 cores, each of two robots began 32 processes."""
    here = SimpleNamespace(Pipe=multiprocessing.Pipe, Process=Here)
    monkeypatch.setattr(multiprocessing, "get_context", lambda kind: here)
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {3, 5, 8, 9}, raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 64)
    jobs = [Job(name, tmp_path / name, tmp_path / "out" / name) for name in ("a", "b")]
    found = list(in_processes(jobs, 2, lambda name, text: None, tells_its_joints))
    assert [outcome.document for outcome in found] == [{"joints": 2}] * 2
