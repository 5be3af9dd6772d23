"""What is said of a robot's joints: refitted numbers, chains without a motor, joints along their measured motion."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.commands.loop import nothing_found
from sealegs.gap.causes.catalogue import catalogue
from sealegs.gap.causes.visible import limits, view_of
from sealegs.gap.checks.context import joint_contexts
from sealegs.gap.checks.data_set import check_run
from sealegs.gap.checks.drive import predicted
from sealegs.gap.log.finding import Finding
from sealegs.gap.log.parts import cut
from sealegs.gap.log.types import JointLog, LogError, MeasuredRun
from sealegs.gap.measure.case import Replay
from sealegs.gap.measure.named import Error, NamedCause
from sealegs.gap.output import terminal
from sealegs.gap.output.terminal import screen
from sealegs.gap.prepare.columns import chosen
from sealegs.gap.replay.driven import DrivenProblem, driven_problem
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.replay.tree import HELD
from sealegs.gap.search.structure import Structure
from sealegs.gap.verdict.decide import MAX_SENTENCE_WORDS, decide
from sealegs.gap.verdict.verdict import BESIDE, EXPLAINED, NOT_IDENTIFIABLE, JointDiagnosis, Reason

from tests.replayed_evidence import evidence

IDEAL: list[Any] = [{"ideal": {"stiffness": 20.0, "damping": 0.5}}]
MOTION = 0.5 * np.sin(np.arange(0.0, 8.0, 0.01) * 3.0)
CAUSE = NamedCause("drive.delay", "A sentence.", "knee", 0.3, 0.0, {}, 0.5, "effect", "", ("load.mass",))
LEFT = Structure(4314.0, 0.0175, 0.01, (), unit="rad")


def run(chain: list[Any] | str = IDEAL, **columns: np.ndarray) -> MeasuredRun:
    time = np.linspace(0.0, 0.01 * (len(MOTION) - 1), len(MOTION))
    log = JointLog(goal=np.roll(MOTION, -3), position=columns.pop("position", MOTION), **columns)
    return MeasuredRun("one", time, {"knee": log}, {}, "unknown", {}, {"knee": chain})


def driven(of: MeasuredRun) -> DrivenProblem:
    runs = [of]
    models = [JointModel(load_chain(of.actuators["knee"]))]
    return driven_problem(runs, "knee", models, cut(runs, "knee"), 1e-4)


def replayed(of: MeasuredRun) -> Replay:
    problem = driven(of)
    return Replay(problem, problem)


def found(**changes: Any) -> JointDiagnosis:
    given: dict[str, Any] = {
        "joint": "knee", "verdict": NOT_IDENTIFIABLE, "sentence": "A sentence.", "signal": "knee.torque",
        "unit": "rad", "gap": {"noise_floor": Error(2.7e-4, 2e-4)}, "causes": (CAUSE,), "unexplained": 0.0,
        "experiment": None, "findings": (), "tuned_share": 0.4,
    }  # fmt: skip
    return JointDiagnosis.of(**{**given, **changes})


def test_a_chain_without_a_motor_predicts_its_torque_only() -> None:
    assert predicted(load_chain(IDEAL)) == ("torque",)
    assert predicted(load_chain("xl330")) == ("torque", "current", "duty")


def test_a_current_is_not_judged_by_a_chain_without_a_motor() -> None:
    """It was held against a current of zero: `No known cause explains the gap: 569.9 mA`."""
    with pytest.raises(LogError, match=r"has no motor; name a chain with a motor, or log 'knee\.torque'\."):
        driven(run(current=MOTION))
    with pytest.raises(LogError, match=r"known; log 'knee\.torque' as well\.") as bare:
        driven(run())
    assert "duty" not in str(bare.value)
    problem = driven(run(current=MOTION, torque=MOTION))
    assert problem.signal[0] == "torque" and "current" not in view_of(problem, problem.models[0]).columns
    (note,) = [f for f in limits(problem, "knee", ()) if f.code == "replay.no_motor"]
    assert "'knee.current'" in note.sentence and not note.data_error


def test_nothing_hidden_is_no_half_sentence() -> None:
    problem = driven(run(torque=MOTION))
    assert limits(problem, "knee", ())[0].sentence.endswith("contact was needed.")
    names = [cause.name for cause in catalogue(problem.models[0])][:2]
    assert limits(problem, "knee", names)[0].sentence.endswith(f"cannot show {', '.join(names)}.")


def stuck(of: MeasuredRun) -> list[str | None]:
    assert joint_contexts(of)
    return [finding.column for finding in check_run(of) if finding.code == "column.stuck"]


def test_zeros_of_a_servo_without_a_motor_are_no_error() -> None:
    zeros = np.zeros(len(MOTION))
    assert stuck(run(duty=zeros, current=zeros)) == []
    assert stuck(run("xl330", duty=zeros, current=zeros)) == ["knee.duty", "knee.current"]


def test_a_velocity_at_constant_speed_is_not_stuck() -> None:
    time = np.arange(len(MOTION)) * 0.01
    turn = np.abs((time + 1.0) % 4.0 - 2.0)  # a triangle of 1 rad/s
    speed = np.gradient(turn, time)
    assert stuck(run(position=turn, velocity=np.sign(speed))) == []
    frozen = np.where(time > 3.0, 0.4, np.sign(speed))
    assert stuck(run(position=turn, velocity=frozen)) == ["knee.velocity"]


def test_what_is_refitted_is_not_told_as_tuned() -> None:
    beside = Reason(BESIDE, "Beside that, numbers are refitted: friction.coulomb x 4.64.")
    text = " ".join(" ".join(screen([found(reasons=(beside,))], {}, 100)).split())
    assert "refitted numbers 40 % of the gap" in text and "friction.coulomb x 4.64" in text
    assert "tuned numbers 40 % of the gap" in " ".join(" ".join(screen([found()], {}, 100)).split())


def test_after_refitted_numbers_nobody_is_told_that_nothing_is_open(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(terminal, "train_command", lambda folder: "sealegs train")
    files = {"extended": Path("d/extended.yaml")}
    beside = Reason(BESIDE, "Beside that, numbers are refitted: friction.coulomb x 4.64.")
    said, commands = terminal.next_step([found(verdict=EXPLAINED, reasons=(beside,))], files)
    assert commands and "No further experiment" not in said and "refitted beyond their tolerance" in said
    assert "No further experiment" in terminal.next_step([found(verdict=EXPLAINED)], files)[0]


def test_what_is_missing_is_told_by_why_the_link_is_held() -> None:
    """A robot's file was asked for where there was one, and current of a chain without a motor."""
    files = {"extended": Path("d/extended.yaml")}
    held = Finding(HELD, "note", "knee", None, "The robot's base moves; write base: fixed in its YAML.")
    of_robot = found(replay=replayed(run(torque=MOTION)), findings=(held,))
    said, _ = terminal.next_step([of_robot], files)
    assert said.endswith("(limits=) or another load. The robot's base moves; write base: fixed in its YAML.")
    unknown = found(replay=replayed(run("xl330", torque=MOTION)))
    said, _ = terminal.next_step([unknown], files)
    assert "another load, or the columns current and duty. The load is not known" in said


def test_how_much_stays_unexplained_is_told() -> None:
    """Of a gap of which two thirds stayed, only the rivals of the rest were told."""
    text = " ".join(" ".join(screen([found(unexplained=0.677, structure=LEFT)], {}, 100)).split())
    assert "unexplained 68 % of the gap: 17.5 mrad, noise 0.27 mrad" in text
    errors = {key: Error(0.02, 0.02) for key in ("nominal", "refitted", "extended")} | {
        "noise_floor": Error(3e-4, 2e-4)
    }
    seen = evidence("knee", errors, (CAUSE,), LEFT, tuned_error=Error(0.02, 0.02), left=0.677)
    verdict = decide(seen)
    assert verdict.sentence.startswith("No known cause explains 68 % of the gap of 'knee'")
    assert "perhaps drive.delay 30 % (confidence 0 %)" in verdict.sentence and verdict.because("structure")
    assert len(verdict.sentence.split()) <= MAX_SENTENCE_WORDS
    assert (
        "unexplained"
        not in decide(evidence("knee", errors, (CAUSE,), LEFT, tuned_error=Error(0.02, 0.02), left=0.01)).sentence
    )


def test_the_ground_is_no_joint_to_ask_for() -> None:
    with pytest.raises(LogError, match=r"leave joints= out"):
        chosen(["hip", "knee"], ["ground"])


@pytest.mark.parametrize("several", [True, False])
def test_a_loop_says_why_its_log_could_not_be_judged(several: bool, tmp_path: Path) -> None:
    one = {
        "joint": "knee",
        "verdict": NOT_IDENTIFIABLE,
        "sentence": "Refused.",
        "reasons": [{"sentence": "The base moves."}],
    }
    folder = tmp_path / "diagnosis"
    folder.mkdir()
    (folder / "diagnosis.json").write_text(json.dumps({"joints": [one, one]} if several else one))
    assert "The base moves." in nothing_found(tmp_path)
    assert "nothing to extend" in nothing_found(tmp_path / "none")
