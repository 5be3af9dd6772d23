"""Zeros and directions of a robot's log that are not the model's: told by gravity, coupling and replay, and taken."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.diagnose import diagnose
from sealegs.gap.load.robot import Frame
from sealegs.gap.log.types import JointLog, MeasuredRun, MeasuredSet
from sealegs.gap.output.extension import as_taken
from sealegs.gap.verdict.frames import in_likely_frames

from testbed.logs import hidden_arm
from tests.logged_robots import robot, two_link_run


def mirrored(run: MeasuredRun, joint: str, zero: float) -> MeasuredRun:
    """The run as a host logs it that counts a joint the other way round, from another zero [rad]."""
    log = run.joints[joint]
    turned = {name: -values for name, values in log.signals().items()}
    for name in ("goal", "position"):
        turned[name] = turned[name] + zero
    return replace(run, joints={**run.joints, joint: JointLog(**turned)})


def taken(run: MeasuredRun) -> dict[str, Frame]:
    """The frames in which a diagnosis takes a run, where they are not the model's."""
    runs, _ = in_likely_frames([run], lambda text: None)
    return {name: frame for name, frame in robot(runs[0]).frames.items() if frame != Frame()}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> MeasuredRun:
    return two_link_run(tmp_path_factory.mktemp("arm"), 8.0)


def test_angles_that_are_the_models_are_left_alone(run: MeasuredRun) -> None:
    assert taken(run) == {}


@pytest.mark.parametrize(("joint", "zero"), [("shoulder", 0.0), ("shoulder", 0.8), ("elbow", 0.8), ("elbow", 0.35)])
def test_a_joint_that_counts_the_other_way_from_another_zero_is_found(
    run: MeasuredRun, joint: str, zero: float
) -> None:
    """An arm and its mirror image need the same torques: either joint may be turned around, the zero is the joint's."""
    frames = taken(mirrored(run, joint, zero))
    assert [frame.sign for frame in frames.values()].count(-1.0) == 1
    assert (frames[joint].zero if zero else 0.0) == pytest.approx(zero, abs=0.05)


def test_what_was_taken_is_said_with_what_it_gains_and_its_mirror_image(run: MeasuredRun) -> None:
    told: list[str] = []
    _, findings = in_likely_frames([mirrored(run, "elbow", 0.8)], told.append)
    sentence = next(finding.sentence for finding in findings if finding.code == "robot.frame")
    assert "are taken here" in sentence and "meta: frames" in sentence and "shoulder turned around" in sentence
    assert sentence in told, "whoever sees it may stop and mend it"


def test_frames_that_a_sidecar_gives_are_doubted_and_kept(run: MeasuredRun) -> None:
    given = {"elbow": {"zero": 0.0, "direction": -1}}
    wrong = replace(run, meta={**run.meta, "frames": given})
    runs, findings = in_likely_frames([wrong], lambda text: None)
    assert "robot.frame" in [finding.code for finding in findings]
    assert runs[0].meta["frames"] == given


@pytest.mark.parametrize("effect", ["friction", "payload", "cable"])
def test_what_is_hidden_in_an_arm_is_no_other_frame(tmp_path: Path, effect: str) -> None:
    data, _ = hidden_arm(tmp_path, "two_link", {effect: ("elbow", "clear")}, seed=21, runs=1, duration=8.0)
    assert taken(data.runs[0]) == {}


@pytest.mark.long
def test_friction_is_named_in_a_joint_that_counts_the_other_way(tmp_path: Path) -> None:
    """It was searched for minutes for masses and scales; files say in which frame the model is."""
    data, _ = hidden_arm(tmp_path, "two_link", {"friction": ("elbow", "clear")}, seed=11)
    turned = MeasuredSet(tuple(mirrored(run, "elbow", 0.0) for run in data.runs), data.name)
    shoulder, elbow = diagnose(turned).joints[:2]
    assert [cause.name for cause in elbow.causes] == ["friction.coulomb"] and not shoulder.causes
    assert elbow.gap["extended"].rmse < 1.5 * elbow.gap["noise_floor"].rmse
    machine = robot(as_taken(turned, [shoulder, elbow]).runs[0])
    assert np.prod([machine.frame(joint).sign for joint in ("shoulder", "elbow")]) == -1.0
