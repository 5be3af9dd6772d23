"""What a terminal shows: one screen a joint, with numbers as exact as they are and lines that fit."""

from __future__ import annotations

import json
import re
import shlex
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.actuators.chain import Chain
from sealegs.actuators.stages import build_stage
from sealegs.commands.diagnose import how_to_go_on
from sealegs.commands.loop import nothing_found
from sealegs.envs.bench.robot import BENCH
from sealegs.envs.extended import Extended
from sealegs.gap.causes.catalogue import catalogue
from sealegs.gap.causes.visible import limits, view_of
from sealegs.gap.checks.context import joint_contexts
from sealegs.gap.checks.data_set import check_run
from sealegs.gap.checks.drive import predicted
from sealegs.gap.experiment import DetectionLimit, Experiment, write_experiment
from sealegs.gap.log.finding import Finding
from sealegs.gap.log.parts import cut
from sealegs.gap.log.types import JointLog, LogError, MeasuredRun
from sealegs.gap.measure.case import Replay
from sealegs.gap.measure.named import CERTAIN, NEAR_MISS, ONE_OF_SEVERAL, Error, NamedCause, OpenCause, Value
from sealegs.gap.output import terminal
from sealegs.gap.output.extension import write_extended
from sealegs.gap.output.numbers import number, percent, rounded, sureness
from sealegs.gap.output.partial import FOLDER, TOLD
from sealegs.gap.output.terminal import experiment_command, screen, told_once
from sealegs.gap.prepare.columns import chosen
from sealegs.gap.replay.driven import DrivenProblem, driven_problem
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.replay.tree import HELD
from sealegs.gap.search.structure import Structure
from sealegs.gap.verdict.decide import MAX_SENTENCE_WORDS, decide, refuse
from sealegs.gap.verdict.verdict import (
    BESIDE,
    EXPLAINED,
    NOT_IDENTIFIABLE,
    NOTHING,
    PARTLY,
    DataError,
    JointDiagnosis,
    Reason,
    Refused,
)

from tests.replayed_evidence import evidence


def named(name: str, share: float, parameters: dict[str, Value], rivals: tuple[str, ...] = ()) -> NamedCause:
    return NamedCause(name, "A sentence.", "servo", share, 0.987, parameters, 0.5, "effect", "response", rivals)


DELAY = Value(0.0225123, 0.0223456, 0.0226789, "s", 0.0)
TEETH = Value(27.41, 25.01, 29.9, "N.m.s/rad", 0.0)
CAUSES = (
    named("drive.delay", 0.931, {"delay.seconds": DELAY}),
    named(
        "friction.position_dependent", 0.04, {"friction.ripple_with_a_long_name": TEETH}, ("load.mass", "drive.offset")
    ),
)
STUCK = DataError("column.stuck", "column.stuck", "servo.voltage reads 7.4 V in every sample.", "warning", "servo")
PLAN = Experiment(
    "chirp", "Run 'chirp' three times with 0.5 kg at 0.12 m within 1.2 rad for 24 s at 2.5 rad/s and 35 % of all duty.",
    2.5, np.arange(3.0), np.zeros(3), {"chirp": 2.5},
)  # fmt: skip
FOUND = JointDiagnosis.of(
    joint="servo",
    verdict=NOT_IDENTIFIABLE,
    sentence="The gap of 'servo' may be drive.delay and friction.position_dependent, but load.mass fits about as well.",
    signal="servo.position",
    causes=CAUSES,
    unexplained=0.001,
    experiment=PLAN,
    data_errors=(STUCK,),
    tuned_share=0.028,
    reasons=(Reason("rivals", "The error falls from 24.1 mrad to 0.6 mrad (noise 0.62 mrad)."),),
)
FILES = {"json": Path("/a/path/that/is/longer/than/any/window/is/wide/so/that/it/runs/over/diagnosis.json")}
VALUES = ("0.02251 s", "7.4 V", "0.5 kg", "0.12 m", "1.2 rad", "24 s", "2.5 rad/s", "35 %", "27.4 N.m.s/rad", "93 %")


@pytest.mark.parametrize("width", [60, 80, 200])
def test_lines_fit_and_no_value_is_parted_from_its_unit(width: int) -> None:
    lines = screen([FOUND], FILES, width)
    assert all(len(line) <= width for line in lines[:-1])
    assert str(FILES["json"]) in lines[-1], "a path stays whole"
    for value in VALUES:
        assert any(value in line for line in lines), f"{value!r} is broken at {width} columns"


def test_a_screen_is_read_from_the_top() -> None:
    lines = screen([FOUND], {}, 80)
    text = "\n".join(lines)
    order = [
        text.index(part) for part in ("NOT IDENTIFIABLE", "Errors of the log", "Causes", "tuned numbers", "Next exp")
    ]
    assert order == sorted(order)
    assert len(lines) < 24
    causes = text[text.index("Causes") : text.index("Next exp")]
    assert "column.stuck" not in causes, "an error of the log is no cause"


def test_without_a_cause_the_reasons_are_told() -> None:
    bare = JointDiagnosis.of(
        joint="servo",
        verdict=EXPLAINED,
        sentence="Nothing.",
        signal="servo.position",
        reasons=(Reason("agrees", "The noise is 0.62 mrad."),),
    )
    assert any("The noise is 0.62 mrad." in line for line in screen([bare], {}))


def test_what_a_log_would_not_show_is_told_by_family() -> None:
    """Thirty limits stood in one paragraph."""
    limits = (
        DetectionLimit("friction.coulomb", "friction.coulomb", "N.m", 0.05, 0.04, 0.06),
        DetectionLimit("drive.delay", "delay.seconds", "s", 0.0, -np.inf, 0.004),
        DetectionLimit("friction.ratchet", "friction.ratchet", "N.m", 0.0, -np.inf, np.inf),
    )
    quiet = JointDiagnosis.of(
        joint="servo",
        verdict=NOTHING,
        sentence="Nothing to explain: fine.",
        signal="servo.position",
        reasons=(Reason("limits", "A wall."),),
        limits=limits,
    )
    lines = screen([quiet], {})
    assert "    friction: coulomb 0.04 to 0.06 N.m; ratchet at all" in lines
    assert "    drive: delay below 0.004 s" in lines and not any("A wall." in line for line in lines)


@pytest.mark.parametrize(
    ("robot", "task"), [("bench", " env=bench"), ("/a/my_arm.yaml", " env=track robot=/a/my_arm.yaml"), ("crane", "")]
)
def test_where_no_experiment_is_proposed_the_screen_says_what_to_type_next(
    robot: str, task: str, tmp_path: Path
) -> None:
    """An explained gap ended in a list of files."""
    extended = tmp_path / "out" / "extended-robot.yaml"
    extended.parent.mkdir()
    write_extended(Extended(robot, {}, {}), extended.parent)
    explained = FOUND.changed(verdict=EXPLAINED, experiment=None)
    lines = screen([explained], {"extended": extended}, 60)
    assert f"  sealegs train{task} extended={extended.parent}" in lines
    assert not any("sealegs train" in line for line in screen([FOUND], {"extended": extended}, 60))
    assert not any("sealegs train" in line for line in screen([explained], {}, 60)), "there is nothing to train on"


def test_what_is_not_identifiable_is_not_trained_on(tmp_path: Path) -> None:
    """After `not identifiable` the last line said to train on what was found."""
    files = {"extended": write_extended(Extended("bench", {}, {}), tmp_path)}
    unhelpful = replace(PLAN, separation=0.1)
    for plan in (None, unhelpful):
        text = " ".join(screen([FOUND.changed(experiment=plan)], files, 80))
        assert "sealegs train" not in text and "Nothing to train on yet" in text and "limits=" in text
    for verdict in (PARTLY, EXPLAINED):
        lines = screen([FOUND.changed(verdict=verdict, experiment=unhelpful)], files, 80)
        assert f"  sealegs train env=bench extended={tmp_path}" in lines
    certain = replace(FOUND.causes[0], standing=CERTAIN)
    sure, other = FOUND.changed(causes=(certain,), experiment=None), FOUND.changed(joint="b", experiment=None)
    lines = screen([sure, other], files, 80)
    assert any("sealegs train" in line for line in lines), "what is certain speaks for the machine"


def test_a_proposed_experiment_is_the_next_command_and_can_be_copied_into_a_shell(tmp_path: Path) -> None:
    """The command was not printed, and the documented one ran the motion of an arm on the bench."""
    folder = tmp_path / "a diagnosis"
    folder.mkdir()
    plan = replace(PLAN, load={"mass": 0.8, "length": BENCH.parameters({})["length"], "arm_mass": 0.0})
    files = write_experiment(plan, "servo", folder, "xl330")
    found = FOUND.changed(experiment=plan)
    command = screen([found], files, 80, tmp_path / "my logs")
    words = next(shlex.split(line) for line in command if "sealegs deploy" in line)
    assert words[2:] == [
        f"excitation={folder / 'next_experiment.csv'}", "robot=bench", "actuator=xl330", "robot.params.mass=0.8",
        f"out={tmp_path / 'my logs'}",
    ]  # fmt: skip
    (tmp_path / "arm.yaml").write_text("model: none.xml\n")
    robot = str(tmp_path / "arm.yaml")
    frame = {"zero": 0.1, "direction": -1}
    files = write_experiment(PLAN, "elbow", folder, None, robot=robot, frame=frame, prefix="elbow-")
    assert shlex.split(experiment_command(files["experiment"], tmp_path / "logs"))[2:] == [
        f"excitation={folder / 'elbow-next_experiment.csv'}", f"robot={robot}", f"out={tmp_path / 'logs'}-model-frame",
    ]  # fmt: skip


def test_a_refusal_is_told_once() -> None:
    """The clause that a long refusal begins with stood there twice."""
    why = "no run moves joint a. " + "Log a motion of it, as the page on measured logs says. " * 3
    refused = refuse("a", Refused("the log", why))
    assert refused.reasons and "no run moves" in refused.sentence
    sentence, reasons = told_once(refused)
    assert sentence == f"The log cannot be used: {why}" and not reasons
    assert " ".join(screen([refused], {}, 80)).count("no run moves joint a") == 1


def test_draws_are_told_where_a_near_miss_counts_them() -> None:
    near = OpenCause("load.mass", NEAR_MISS, "it is the best in 28 % of the draws.")
    text = " ".join(" ".join(screen([FOUND.changed(open_causes=(near,))], {}, 80)).split())
    assert "Draws: blocks of the data that no fit saw, resampled at random" in text
    assert "Draws:" not in " ".join(screen([FOUND], {}, 80))


def test_numbers_are_rounded_by_their_interval() -> None:
    assert rounded(DELAY) == ("0.02251", "0.02235", "0.02268")
    assert rounded(Value(123.456, 100.2, 150.9, "1", 0.0)) == ("123", "100", "151")
    assert rounded(Value(-0.00004, -0.01, 0.01, "1", 0.0)) == ("0.000", "\N{MINUS SIGN}0.010", "0.010")
    assert rounded(Value(0.3, 0.3, 0.3, "1", 0.0))[0] == "0.3"
    assert number(-1.5) == "\N{MINUS SIGN}1.5"


def test_a_share_that_is_not_zero_is_not_told_as_zero() -> None:
    assert percent(0.0) == "0 %"
    assert percent(1e-5) == "< 0.1 %"
    assert not re.match(r"0(\.0)? %", percent(6e-4))


def test_no_confidence_is_told_as_certain() -> None:
    assert sureness(1.0) == sureness(0.9999) == "99 %"
    assert sureness(0.6) == "60 %"


def test_who_stops_a_diagnosis_is_given_the_whole_command_that_goes_on(tmp_path: Path) -> None:
    told = tmp_path / FOLDER / TOLD
    assert how_to_go_on(["log=a"], tmp_path) == "Stopped before anything was found."
    told.parent.mkdir()
    told.touch()
    said = how_to_go_on(["log=my logs", "out=elsewhere", "causes=[drive.delay,friction.coulomb]"], tmp_path)
    assert said.endswith(f"sealegs diagnose 'log=my logs' 'causes=[drive.delay,friction.coulomb]' out={tmp_path}")


# --- what is said of a robot's joints: refitted numbers, chains without a motor, joints along their measured motion --

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
    beside_hidden = [found(verdict=EXPLAINED), found(verdict=NOT_IDENTIFIABLE, joint="knee", causes=())]
    monkeypatch.setattr(terminal, "overall", lambda documents: {"verdict": EXPLAINED})
    assert "cannot show stays open" in terminal.next_step(beside_hidden, files)[0]
    known = found(verdict=EXPLAINED)
    vague = known.changed(causes=tuple(replace(one, standing=ONE_OF_SEVERAL) for one in known.causes))
    assert vague.causes and "cannot show stays open" in terminal.next_step([known, vague], files)[0], "it has rivals"


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


# --- what a person is told to type after a diagnosis works -----------------------------------------------------------

SERVO = [("ideal", {"stiffness": 20.0, "damping": 0.5})]
TORQUE = [("torque_command", {})]


@pytest.mark.parametrize(("stages", "trained"), [(SERVO, True), (TORQUE, False)])
def test_nobody_is_told_to_train_what_torques_drive(
    stages: list[tuple[str, dict[str, float]]], trained: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`sealegs train` refuses such a robot."""
    monkeypatch.setattr(terminal, "to_document", lambda item: {})
    monkeypatch.setattr(terminal, "overall", lambda items: {"verdict": EXPLAINED})
    monkeypatch.setattr(terminal, "train_command", lambda folder: f"sealegs train extended={folder}")
    model = JointModel(Chain(tuple(build_stage(name, given, "a chain") for name, given in stages)))
    problem = SimpleNamespace(joint=SimpleNamespace(models=(model,)))
    found: Any = SimpleNamespace(
        joint="elbow",
        causes=(SimpleNamespace(standing=CERTAIN),),
        model="extended",
        problem=problem,
        experiment=None,
        refitted=False,
        verdict=EXPLAINED,
    )
    sentence, commands = terminal.next_step([found], {"extended": Path("diagnosis/extended.yaml")})
    assert bool(commands) == trained and ("with your own code" in sentence) != trained
