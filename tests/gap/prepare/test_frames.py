"""Zeros and directions of a robot's log that are not the model's: told by gravity, coupling and replay, and taken."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.diagnose import diagnose
from sealegs.gap.load.robot import Frame, Machine
from sealegs.gap.log.types import JointLog, MeasuredRun, MeasuredSet
from sealegs.gap.output.document import document_of, joints_of, read_document, write_document
from sealegs.gap.output.extension import as_taken, write_extension
from sealegs.gap.prepare.frames import in_likely_frames
from sealegs.gap.verdict.verdict import NOTHING, JointDiagnosis

from testbed import arm
from testbed.everyday import drawn
from testbed.logs import hidden_arm, hidden_everyday
from tests.logged_robots import robot, two_link_run
from tests.quick import quick


def mirrored(run: MeasuredRun, joint: str, zero: float) -> MeasuredRun:
    """The run as a host logs it that counts a joint the other way round, from another zero [rad]."""
    log = run.joints[joint]
    turned = {name: -values for name, values in log.signals().items()}
    for name in ("goal", "position"):
        turned[name] = turned[name] + zero
    return replace(run, joints={**run.joints, joint: JointLog(**turned)})


def taken(run: MeasuredRun) -> dict[str, Frame]:
    """The frames in which a diagnosis takes a run, where they are not the model's."""
    runs, _ = in_likely_frames(Machine.of([run]), lambda text: None)
    return {name: frame for name, frame in robot(runs[0]).frames.items() if frame != Frame()}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> MeasuredRun:
    return two_link_run(tmp_path_factory.mktemp("arm"), 8.0)


def test_angles_that_are_the_models_are_left_alone(run: MeasuredRun) -> None:
    assert taken(run) == {}


@pytest.mark.parametrize(
    ("joint", "zero"), quick([("shoulder", 0.0), ("shoulder", 0.8), ("elbow", 0.8), ("elbow", 0.35)], 2)
)
def test_a_joint_that_counts_the_other_way_from_another_zero_is_found(
    run: MeasuredRun, joint: str, zero: float
) -> None:
    """An arm and its mirror image need the same torques: either joint may be turned around, the zero is the joint's."""
    frames = taken(mirrored(run, joint, zero))
    assert [frame.sign for frame in frames.values()].count(-1.0) == 1
    assert (frames[joint].zero if zero else 0.0) == pytest.approx(zero, abs=5e-3)


@pytest.mark.long
def test_what_was_taken_is_said_with_what_it_gains_and_its_mirror_image(run: MeasuredRun) -> None:
    told: list[str] = []
    _, findings = in_likely_frames(Machine.of([mirrored(run, "elbow", 0.8)]), told.append)
    sentence = next(finding.sentence for finding in findings if finding.code == "robot.frame")
    assert "are taken here" in sentence and "meta: frames" in sentence and "shoulder turned around" in sentence
    assert sentence in told, "whoever sees it may stop and mend it"


@pytest.mark.long
def test_frames_that_a_sidecar_gives_are_doubted_and_kept(run: MeasuredRun) -> None:
    given = {"elbow": {"zero": 0.0, "direction": -1}, "shoulder": {"zero": 0.0, "direction": 1}}
    wrong = replace(run, meta={**run.meta, "frames": given})
    runs, findings = in_likely_frames(Machine.of([wrong]), lambda text: None)
    assert "robot.frame" in [finding.code for finding in findings]
    assert runs[0].meta["frames"] == given


@pytest.mark.long
@pytest.mark.parametrize("effect", ["friction", "payload", "cable"])
def test_what_is_hidden_in_an_arm_is_no_other_frame(tmp_path: Path, effect: str) -> None:
    data, _ = hidden_arm(tmp_path, "two_link", {effect: ("elbow", "clear")}, seed=21, runs=1, duration=8.0)
    assert taken(data.runs[0]) == {}


ELBOW = re.compile(r'(<joint name="elbow"[^/]*)/>(<inertial )pos="0 (\S+) 0"')


def edited(run: MeasuredRun, folder: Path, becomes: str) -> MeasuredRun:
    """The run with a model file in which the elbow's joint and centre of mass read otherwise."""
    text, count = ELBOW.subn(becomes, Path(run.robot).read_text())
    assert count == 1
    (folder / "other.xml").write_text(text)
    return replace(run, robot=str(folder / "other.xml"))


def limited(run: MeasuredRun, folder: Path, low: float, high: float) -> MeasuredRun:
    """The run of a robot whose elbow has a range [rad]."""
    return edited(run, folder, rf'\1 range="{low} {high}"/>\2pos="0 \3 0"')


@pytest.mark.long
def test_a_centre_of_mass_that_lies_elsewhere_is_no_zero(run: MeasuredRun, tmp_path: Path) -> None:
    """Gravity cannot tell it from a zero of the last joint: a zero was taken, and nothing was left to explain."""
    wrong = edited(run, tmp_path, r'\1/>\2pos="0.06 \3 0"')
    runs, findings = in_likely_frames(Machine.of([wrong]), lambda text: None)
    assert runs[0].meta.get("frames") is None
    (doubt,) = [finding for finding in findings if finding.code == "robot.frame"]
    assert "centre of mass" in doubt.sentence


@pytest.mark.long
def test_a_zero_alone_is_taken_where_the_log_leaves_the_range_of_the_model(run: MeasuredRun, tmp_path: Path) -> None:
    elbow = run.joints["elbow"]
    low, high = float(elbow.position.min()) - 0.1, float(elbow.position.max()) + 0.1
    ranged = limited(run, tmp_path, low, high)
    moved = {name: getattr(elbow, name) + 2.5 for name in ("goal", "position")}
    other = replace(ranged, joints={**run.joints, "elbow": replace(elbow, **moved)})
    assert taken(ranged) == {}
    assert taken(other)["elbow"].zero == pytest.approx(2.5, abs=5e-3)


@pytest.mark.long
def test_the_joint_that_would_leave_its_range_is_the_one_that_is_turned(run: MeasuredRun, tmp_path: Path) -> None:
    """Either joint turned around fits the torques; the shoulder was turned, and the elbow left out of its range."""
    ranged = edited(run, tmp_path, r'\1 ref="1.3" range="0.2 2.4"/>\2pos="0 \3 0"')
    elbow = run.joints["elbow"]
    raised = replace(elbow, **{name: getattr(elbow, name) + 1.3 for name in ("goal", "position")})
    one_sided = replace(ranged, joints={**run.joints, "elbow": raised})
    assert taken(one_sided) == {}
    frames = taken(mirrored(one_sided, "elbow", 0.0))
    assert list(frames) == ["elbow"] and frames["elbow"].sign == -1.0


@pytest.mark.long
def test_runs_of_hosts_that_count_differently_are_not_forced_into_one_frame(run: MeasuredRun) -> None:
    runs, _ = in_likely_frames(
        Machine.of([run, mirrored(run, "elbow", 0.8), mirrored(run, "elbow", 0.8)]), lambda text: None
    )
    assert all(one.meta.get("frames") is None for one in runs)


@pytest.mark.long
def test_runs_with_other_gains_tell_the_same_frames(
    run: MeasuredRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every run was taken for one of the first one's gain, and the frame of none was doubted."""
    monkeypatch.setitem(arm.SERVOS, "two_link", arm.SERVO | {"gain": 4.0 * arm.SERVO["gain"]})
    stiff = replace(two_link_run(tmp_path, 8.0), name="stiff", robot=run.robot)
    runs, _ = in_likely_frames(
        Machine.of([mirrored(one, "elbow", 0.8) for one in (run, stiff, stiff)]), lambda text: None
    )
    assert robot(runs[1]).frame("elbow").zero == pytest.approx(0.8, abs=0.05)


def test_a_group_that_is_kept_for_the_test_does_not_choose(run: MeasuredRun) -> None:
    kept = replace(mirrored(run, "elbow", 0.8), meta={**run.meta, "group": "kept"})
    plain = replace(run, meta={**run.meta, "group": "seen"})
    runs, findings = in_likely_frames(Machine.of([plain, kept]), lambda text: None, "kept")
    assert all(one.meta.get("frames") is None for one in runs)
    assert "robot.frame" not in [finding.code for finding in findings]


@pytest.mark.long
def test_a_frame_that_is_given_for_one_joint_leaves_the_others_to_be_found(run: MeasuredRun) -> None:
    given = {"elbow": {"zero": 0.0, "direction": 1}}
    said = replace(mirrored(run, "shoulder", 0.8), meta={**run.meta, "frames": given})
    shoulder = taken(said)["shoulder"]
    assert shoulder.sign == -1.0 and shoulder.zero == pytest.approx(0.8, abs=0.05)


def test_a_saved_diagnosis_says_in_which_frames_its_values_are(tmp_path: Path) -> None:
    frames = {"elbow": {"zero": 0.8, "direction": -1}}
    joint = JointDiagnosis.of(
        joint="elbow",
        verdict=NOTHING,
        sentence="Nothing to explain.",
        signal="elbow.position",
        unit="rad",
        frames=frames,
    )
    document = document_of([joint], "arm", ["run"])
    write_document(document, tmp_path / "diagnosis.json")
    (found,) = joints_of(read_document(tmp_path), tmp_path)
    assert found.frames == frames


@pytest.mark.weekly
def test_friction_is_named_in_a_joint_that_counts_the_other_way(tmp_path: Path) -> None:
    """It was searched for minutes for masses and scales, then a zero of 0.03 rad too much was named an encoder's."""
    data, _ = hidden_arm(tmp_path, "two_link", {"friction": ("elbow", "clear")}, seed=11)
    turned = MeasuredSet(tuple(mirrored(run, "elbow", 0.8) for run in data.runs), data.name)
    shoulder, elbow = diagnose(turned).joints[:2]
    assert [cause.name for cause in elbow.causes] == ["friction.coulomb"] and not shoulder.causes
    assert elbow.gap["extended"].rmse < 1.5 * elbow.gap["noise_floor"].rmse
    assert elbow.experiment is None and shoulder.experiment is None, "goals would be of angles that nobody checked"
    machine = robot(as_taken(turned, [shoulder, elbow]).runs[0])
    assert np.prod([machine.frame(joint).sign for joint in ("shoulder", "elbow")]) == -1.0
    written = write_extension(elbow, as_taken(turned, [shoulder, elbow]).runs, tmp_path)
    assert "counted as in the log" in written["chain"].read_text(encoding="utf-8")


@pytest.mark.long
def test_a_joint_whose_goals_are_shifted_does_not_count_the_other_way(tmp_path: Path) -> None:
    """A shift of 33 mrad at a leg's hip is more torque than gravity: the hip was turned around, 55 degrees off, and
    nothing was identifiable at any joint.
    """
    data, _ = hidden_everyday(drawn(2, 302), tmp_path)
    machine, findings = in_likely_frames(Machine.of(data.runs), lambda text: None)
    assert machine.robot is not None and not machine.robot.frames
    assert not [finding for finding in findings if finding.code == "robot.frame"]
