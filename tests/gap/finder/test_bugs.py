"""A bug is no verdict: what was found is kept, its place is named in a file, and the exit status is its own."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from sealegs.common.bugs import BUG, Unforeseen, place_of
from sealegs.configs.script import run
from sealegs.gap.diagnosis import Diagnosis
from sealegs.gap.finder.parallel import side_by_side
from sealegs.gap.fleet import jobs
from sealegs.gap.load.robot import Machine
from sealegs.gap.log.finding import Finding
from sealegs.gap.prepare.request import Request
from sealegs.gap.verdict.evidence import Refused
from sealegs.gap.verdict.refusal import refuse
from sealegs.gap.verdict.verdict import JointDiagnosis


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
    place = r"tests/gap/finder/test_bugs\.py line \d+\."
    assert re.match(rf"A bug of sealegs ended this: KeyError \('elbow'\) in {place}", said[1])
    reports = sorted(tmp_path.glob("sealegs-bug-*.txt"))
    assert len(reports) == 2 and reports[0].name in said[1] + said[3]
    text = reports[0].read_text()
    assert "command: sealegs diagnose 'log=a b'" in text and "Traceback" in text and "test_bugs.py" in text


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
    assert re.fullmatch(r"tests/gap/finder/test_bugs\.py line \d+", place_of(errors["b"])), "also of another process"
    with pytest.raises(LookupError, match="no such thing"):
        side_by_side(dict.fromkeys("abc", fails_at_b), Machine.of(()), (), Request(), workers, lambda joint: None)


def fails_with(error: Exception) -> Callable[..., Any]:
    def fails(*given: Any, **more: Any) -> Any:
        raise error

    return fails


def test_what_was_found_beside_a_bug_is_written_before_it_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    written: list[Path] = []
    found = Diagnosis("log", ("run",), (refuse("a", Refused("a", "it is only a test")),))
    monkeypatch.setattr(Diagnosis, "save", lambda self, out, progress: written.append(out))
    monkeypatch.setattr("sealegs.gap.diagnose.diagnose", fails_with(Unforeseen({"b": IndexError("none")}, found)))
    assert run(lambda _: jobs.diagnose_folder(tmp_path / "log", tmp_path / "out") and None, "diagnose", "", []) == BUG
    assert written == [tmp_path / "out"]
    assert (
        f"b: IndexError (none) in an unknown place. All else was done and is in {tmp_path / 'out'}."
        in capsys.readouterr().err
    )
