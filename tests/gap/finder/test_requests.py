"""What a person asks for reaches every search; what fails on the way is said, and a bug is no verdict."""

from __future__ import annotations

import multiprocessing
import os
import re
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.managers import SyncManager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from sealegs.common.bugs import BUG, Unforeseen, place_of
from sealegs.common.errors import SealegsError
from sealegs.configs.script import run
from sealegs.gap.diagnosis import Diagnosis
from sealegs.gap.finder import diagnosis as way
from sealegs.gap.finder.parallel import Said, side_by_side
from sealegs.gap.fleet import Job, Outcome, jobs
from sealegs.gap.fleet.run import in_processes
from sealegs.gap.load.robot import Machine
from sealegs.gap.log import LogError
from sealegs.gap.log.finding import Finding
from sealegs.gap.log.types import MeasuredSet
from sealegs.gap.measure.case import ROBOT
from sealegs.gap.measure.measured import Measured
from sealegs.gap.measure.named import Error, NamedCause
from sealegs.gap.prepare.columns import chosen
from sealegs.gap.prepare.request import Request
from sealegs.gap.robot import judged as shared
from sealegs.gap.robot.joints import Known
from sealegs.gap.robot.judged import of_robot
from sealegs.gap.search.journal import keeping
from sealegs.gap.search.settings import DEFAULT
from sealegs.gap.search.structure import Structure
from sealegs.gap.verdict.decide import refuse
from sealegs.gap.verdict.verdict import JointDiagnosis, Refused

from testbed import hidden_hopper
from tests.logged_robots import two_link_run
from tests.waiting import wait_until


def raising(error: Exception) -> Callable[..., Any]:
    """A function that fails, in the place of one that may."""

    def fails(*given: Any, **more: Any) -> Any:
        raise error

    return fails


def not_diagnosed(runs: Any, joint: str, *more: Any) -> JointDiagnosis:
    """A joint that nothing is said of but what is known of it."""
    del runs
    notes = [note for one in more if isinstance(one, Known) for note in one.notes]
    return refuse(joint, Refused(joint, "it is only a test", usable=True), notes)


@pytest.mark.long
def test_a_joint_search_that_fails_is_a_finding_and_leaves_its_traceback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """It reached the progress line alone, and the report said nothing."""
    data = MeasuredSet((two_link_run(tmp_path, 2.0),), "arm")
    monkeypatch.setattr(way, "diagnose_joint", not_diagnosed)
    monkeypatch.setattr(way, "begun", raising(np.linalg.LinAlgError("no start")))
    monkeypatch.setattr(way, "of_robot", raising(np.linalg.LinAlgError("Singular matrix")))
    found = way.diagnose(data)
    assert [joint.joint for joint in found] == ["shoulder", "elbow"]
    for joint in found:
        (fault,) = (finding for finding in joint.findings if finding.code == "search.fault")
        assert "Singular matrix" in fault.sentence
    assert caplog.records[-1].exc_info is not None
    monkeypatch.setattr(way, "of_robot", raising(SealegsError("correct the sidecar.")))
    with pytest.raises(SealegsError, match="correct the sidecar"):  # which a person can mend
        way.diagnose(data)


def test_a_bug_before_the_joints_leaves_them_their_diagnosis(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(way, "diagnose_joint", not_diagnosed)
    monkeypatch.setattr(way, "in_likely_frames", raising(IndexError("none")))
    with pytest.raises(Unforeseen, match="zeros and directions: IndexError") as bug:
        way.diagnose(hidden_hopper({}, 21, runs=1, duration=1.5)[0], only=["hip"])
    assert isinstance(bug.value.found, list) and [joint.joint for joint in bug.value.found] == ["hip"]


def test_the_ground_is_sought_with_the_settings_that_were_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def sought(*given: Any, **named: Any) -> str:
        asked.extend([*given, *named.values()])
        return "it is only a test."

    monkeypatch.setattr(way, "diagnose_joint", not_diagnosed)
    monkeypatch.setattr(way, "search_ground", sought)
    settings = replace(DEFAULT, least_gain=0.5)
    way.diagnose(hidden_hopper({}, 21, runs=1, duration=1.5)[0], settings=settings, look_on=True)
    assert settings in asked and True in asked


def accepted(key: str, best: float = 1.0) -> Any:
    """What a search of the robot accepted."""
    return SimpleNamespace(cause=SimpleNamespace(key=key, name=key.partition(" ")[0]), best=best)


def test_what_of_the_bodies_it_is_may_stay_open() -> None:
    """A payload that a centre of mass fits as well was left to the joints, which said another."""
    sought: Any = SimpleNamespace(search=SimpleNamespace(accepted=[accepted("load.mass", 0.6)]))
    cause = NamedCause("load.mass", "", ROBOT, 0.1, 0.54, {}, 0.5, "number", rivals=("load.centre_of_mass",))
    assert shared.of_any(cause, sought) == pytest.approx(0.9)


@pytest.mark.long
def test_what_joints_share_has_rivals_and_rounds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its rivals were dropped, and its report had no rounds."""
    run = two_link_run(tmp_path, 2.0)
    cause = NamedCause("load.mass", "Heavier.", ROBOT, 0.9, 0.95, {}, 0.5, "number", rivals=("load.inertia",))
    errors = {name: Error(rmse, rmse) for name, rmse in (("nominal", 0.02), ("extended", 6e-4), ("noise_floor", 6e-4))}
    errors["refitted"] = errors["nominal"]
    measured = Measured(errors, errors["nominal"], structure=Structure(0.0, 0.0), causes=(cause,), tuned_share=0.1)
    search = SimpleNamespace(accepted=[accepted("load.mass")], rounds=())
    problem = SimpleNamespace(units=(), signal=("position", "rad"))
    asked: list[Any] = []

    def sought(*given: Any, **named: Any) -> Any:
        asked.extend([*given, *named.values()])
        return SimpleNamespace(
            search=search,
            problem=problem,
            rows={},
            widespread=lambda: True,
            more=lambda joint, values: None,
            by_effect=lambda measured, *numbers: measured,
        )

    monkeypatch.setattr(shared, "affected", lambda named, noticed: True)
    monkeypatch.setattr(shared, "search_shared", sought)
    monkeypatch.setattr(shared, "measure", lambda *given: measured)
    request = Request(search=replace(DEFAULT, least_gain=0.5), look_on=True)
    found = of_robot(Machine.of([run]), [not_diagnosed([run], "elbow")], request, raising(KeyError("none"))).robot
    assert found is not None
    assert found.joint == ROBOT and found.search is search
    assert found.rivals == ({"of": "load.mass", "names": ["load.mass", "load.inertia"], "confidence": 0.95},)
    assert request.search in asked and True in asked


@pytest.mark.parametrize(
    ("widespread", "confidence", "why"), [(False, 0.95, "fewer than two joints"), (True, 0.35, "a confidence of 35%")]
)
@pytest.mark.long
def test_what_joints_do_not_share_after_all_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, widespread: bool, confidence: float, why: str
) -> None:
    """A centre of mass was found, said in the progress alone, and never heard of again."""
    run = two_link_run(tmp_path, 2.0)
    search = SimpleNamespace(accepted=[accepted("load.centre_of_mass (head)")])
    problem = SimpleNamespace(models=[SimpleNamespace(units={})])
    sought = SimpleNamespace(search=search, problem=problem, rows={}, widespread=lambda: widespread)
    measured = SimpleNamespace(values={}, causes=[SimpleNamespace(name="load.centre_of_mass", confidence=confidence)])
    monkeypatch.setattr(shared, "affected", lambda named, noticed: True)
    monkeypatch.setattr(shared, "search_shared", lambda *given, **named: sought)
    monkeypatch.setattr(shared, "measure", lambda *given: measured)
    found = of_robot(Machine.of([run]), [not_diagnosed([run], "elbow")], Request(), raising(KeyError("none")))
    (note,) = [finding.sentence for finding in found.known["elbow"].notes if finding.code == "robot.not_shared"]
    assert found.robot is None
    assert "load.centre_of_mass" in note and why in note


def test_a_bug_is_told_in_a_sentence_and_its_place_in_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It ended in a traceback, and with the exit status of any Python program."""
    monkeypatch.chdir(tmp_path)

    def fails(arguments: list[str]) -> None:
        error = KeyError("elbow")
        error.add_note("TORQUE MAY BE ON at servo(s) 1: CUT THE POWER.")
        raise error

    assert [run(fails, "diagnose", "", ["log=a b"]) for _ in range(2)] == [BUG, BUG]
    said = capsys.readouterr().err.strip().splitlines()
    assert said[0] == "TORQUE MAY BE ON at servo(s) 1: CUT THE POWER." and len(said) == 4
    place = r"tests/gap/finder/test_requests\.py line \d+\."
    assert re.match(rf"A bug of sealegs ended this: KeyError \('elbow'\) in {place}", said[1])
    reports = sorted(tmp_path.glob("sealegs-bug-*.txt"))
    assert len(reports) == 2 and reports[0].name in said[1] + said[3]
    text = reports[0].read_text()
    assert "command: sealegs diagnose 'log=a b'" in text and "Traceback" in text and "test_requests.py" in text


def fails_at_b(machine: Machine, joint: str, findings: Sequence[Finding], request: Request) -> JointDiagnosis:
    del machine, findings, request
    if joint == "b":
        raise LookupError("no such thing")
    return refuse(joint, Refused(joint, "it is only a test"))


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.long)])
def test_a_bug_at_one_joint_leaves_the_others_theirs(workers: int) -> None:
    errors: dict[str, Exception] = {}
    joints = side_by_side(
        dict.fromkeys("abc", fails_at_b), Machine.of(()), (), Request(), workers, lambda joint: None, errors
    )
    assert [joint.joint for joint in joints] == ["a", "c"] and [*errors] == ["b"]
    assert re.fullmatch(r"tests/gap/finder/test_requests\.py line \d+", place_of(errors["b"])), (
        "also of another process"
    )
    with pytest.raises(LookupError, match="no such thing"):
        side_by_side(dict.fromkeys("abc", fails_at_b), Machine.of(()), (), Request(), workers, lambda joint: None)


def test_what_was_found_beside_a_bug_is_written_before_it_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    written: list[Path] = []
    found = Diagnosis("log", ("run",), (refuse("a", Refused("a", "it is only a test")),))
    monkeypatch.setattr(Diagnosis, "save", lambda self, out, progress: written.append(out))
    monkeypatch.setattr("sealegs.gap.diagnose.diagnose", raising(Unforeseen({"b": IndexError("none")}, found)))
    assert run(lambda _: jobs.diagnose_folder(tmp_path / "log", tmp_path / "out") and None, "diagnose", "", []) == BUG
    assert written == [tmp_path / "out"]
    assert (
        f"b: IndexError (none) in an unknown place. All else was done and is in {tmp_path / 'out'}."
        in capsys.readouterr().err
    )


# --- joints of a machine in processes of their own -------------------------------------------------------------------


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
