"""A wrong encoder of one joint is one cause at that joint, though the joints that feel it look wrong as well."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar, cast

import numpy as np
import pytest
from sealegs.envs.described.as_robot import as_robot
from sealegs.envs.extended import Extended
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.load.robot import Machine
from sealegs.gap.load.terms import T_COLUMNS
from sealegs.gap.log.types import MeasuredRun, MeasuredSet
from sealegs.gap.measure.named import CERTAIN
from sealegs.gap.output.extension import of_robot, widened_range
from sealegs.gap.prepare.frames import in_likely_frames
from sealegs.gap.prepare.request import Request
from sealegs.gap.replay.tree import axis_of, motion_of, told_range
from sealegs.gap.robot import encoders
from sealegs.gap.robot.encoders import Encoder, corrected
from sealegs.gap.robot.joints import Joints
from sealegs.gap.verdict.verdict import JointDiagnosis

from testbed.logs import hidden_arm
from tests.logged_robots import robot, two_link_run


def shifted(data: MeasuredSet, joint: str, zero: float) -> MeasuredSet:
    """Logs whose encoder of a joint, which its servo goes by, is off [rad]."""
    runs = []
    for run in data.runs:
        log = run.joints[joint]
        assert log.goal is not None
        moved = replace(log, position=log.position + zero, goal=log.goal + zero)
        runs.append(replace(run, joints={**run.joints, joint: moved}))
    return replace(data, runs=tuple(runs))


@pytest.mark.long
def test_angles_are_those_that_were_before_an_encoder_misread_them(tmp_path: Path) -> None:
    run = two_link_run(tmp_path, 2.0)
    log = run.joints["shoulder"]
    read = replace(log, position=0.9 * log.position + 0.05, link_position=log.position)
    misread = replace(run, joints={**run.joints, "shoulder": read})
    (mended,) = corrected([misread], Encoder("shoulder", 0.05, 0.9))
    np.testing.assert_allclose(mended.joints["shoulder"].position, log.position, atol=1e-12)
    assert mended.joints["shoulder"].link_position is log.position, "an encoder of its own"
    assert mended.joints["elbow"] is misread.joints["elbow"]
    np.testing.assert_allclose(motion_of(robot(run), mended).position, motion_of(robot(run), run).position, atol=1e-9)


def test_an_encoder_is_said_in_words() -> None:
    assert Encoder("a", 0.05, 1.0).said("rad") == "a zero that is 0.05 rad off"
    assert Encoder("a", 0.0, 0.9).said("rad") == "0.9 times the angle"


@pytest.mark.long
@pytest.mark.parametrize(
    ("joint", "zero", "seed"), [("shoulder", 0.05, 5), pytest.param("elbow", 0.06, 7, marks=pytest.mark.weekly)]
)
def test_a_wrong_zero_is_named_at_one_joint(tmp_path: Path, joint: str, zero: float, seed: int) -> None:
    """The shoulder's 0.050 rad were found there, and 0.045 rad at the elbow, which was right: both certain."""
    data, _ = hidden_arm(tmp_path, "two_link", {}, seed, runs=2, duration=12.0)
    found = {d.joint: d for d in diagnose(shifted(data, joint, zero))}
    (cause,) = found[joint].causes
    assert cause.name == "sensor.offset"
    assert cause.parameters["encoder.offset"].value == pytest.approx(zero, abs=0.003)
    (other,) = [d for name, d in found.items() if name not in (joint, "robot")]
    assert other.causes == () and any(f.code == "robot.encoder" for f in other.findings)
    if joint == "shoulder":  # a base that is tilted about the shoulder's axis is the same
        assert "load.tilt" in cause.rivals and cause.standing != CERTAIN
        assert any(f.code == "robot.encoder_or_tilt" and "level" in f.sentence for f in found[joint].findings)


class Weighed:
    """Losses of a tilt that feels how a pan moves: 10, and another with the pan's encoder."""

    plain: ClassVar = {"pan": 5.0, "tilt": 10.0}
    terms: ClassVar = {"tilt": [np.zeros((3, T_COLUMNS))]}
    robot: ClassVar = SimpleNamespace(slides=lambda joint: False)
    speaks_against = encoders._Weighed.speaks_against

    def __init__(self, loss: float, level: float) -> None:
        self.losses, self.level = {"tilt": loss}, level

    def with_encoder(self, encoder: Encoder) -> float:
        del encoder
        return 1.0 + self.losses["tilt"]

    def with_tilt(self) -> float:
        return self.level

    def others(self, encoder: Encoder) -> SimpleNamespace:
        del encoder
        return SimpleNamespace(losses=self.losses, runs=["mended"], terms=self.terms)


@pytest.mark.parametrize(
    ("loss", "level", "judged", "runs"),
    [(4.0, 99.0, ["tilt"], ["mended"]), (40.0, 99.0, [], []), (40.0, 41.0, ["pan"], [])],
    ids=["explained", "further off", "or tilted"],
)
def test_an_encoder_that_the_other_joints_are_further_off_with_stays_a_matter_of_its_joint(
    monkeypatch: pytest.MonkeyPatch, loss: float, level: float, judged: list[str], runs: list[str]
) -> None:
    """A pan said with 40 % to read 0.94 of its angle, so the tilt was searched anew, and lost its payload."""
    pan: Any = SimpleNamespace(joint="pan")
    monkeypatch.setattr(encoders, "misread", lambda one: Encoder("pan", 0.0, 0.94))
    monkeypatch.setattr(encoders, "joints_of", lambda *given: Joints(cast(Any, {"pan": 1, "tilt": 2}), {}))
    monkeypatch.setattr(encoders, "_Weighed", lambda *given: Weighed(loss, level))
    asked: list[str] = []
    light = encoders.in_light(cast(Any, None), [], [pan], Request(), lambda joints: asked.extend(joints) or [])
    assert light.found == [pan] and asked == judged and list(light.runs) == runs


# --- ranges of a robot's file that its log goes beyond -------------------------------------------------------------


def ranged(run: MeasuredRun, low: float, high: float) -> MeasuredRun:
    """The run of a robot whose file gives the shoulder a range [rad]."""
    path = Path(run.robot)
    text = path.read_text(encoding="utf-8")
    ends = np.array([low, high]) if 'angle="radian"' in text else np.degrees([low, high])
    first = '<joint name="shoulder" type="hinge"'
    assert first in text
    other = path.with_name("ranged.xml")
    other.write_text(text.replace(first, f'{first} limited="true" range="{ends[0]:.9g} {ends[1]:.9g}"'), "utf-8")
    return replace(run, robot=str(other))


@pytest.mark.long
def test_a_range_that_the_log_goes_beyond_is_said_and_widened_in_the_extended_model(tmp_path: Path) -> None:
    """The extended robot was blocked 0.2 rad within the motion that was measured, and nothing said so."""
    run = two_link_run(tmp_path, 2.0)
    top = float(run.joints["shoulder"].position.max())
    run = ranged(run, -3.0, top - 0.2)
    said = told_range(robot(run), "shoulder", [run])
    assert said is not None and "beyond the range" in said.sentence and "ranged.xml" in said.sentence
    assert told_range(robot(run), "elbow", [run]) is None
    (found,) = diagnose(MeasuredSet((run,), "log"), only=["shoulder"], causes=["drive.delay"])
    machine = robot(run)
    wider = of_robot(machine, widened_range(machine, found, ()))
    model = as_robot(machine.file)
    params = Extended(run.robot, {}, {}, tuple(wider)).params_on(model)
    low, high = model.drivetrain(None, params).model.jnt_range[machine.number("shoulder")]
    axis = axis_of(machine, "shoulder", [run])
    assert high > axis.high and low == pytest.approx(-3.0, abs=1e-6)
    assert isinstance(found, JointDiagnosis) and any(f.code == "robot.range" for f in found.findings)


def test_a_range_that_the_log_stays_within_is_left_alone(tmp_path: Path) -> None:
    run = ranged(two_link_run(tmp_path, 2.0), -3.0, 3.0)
    assert told_range(robot(run), "shoulder", [run]) is None


def test_frames_that_are_not_compared_are_said_to_be_believed(tmp_path: Path) -> None:
    """A gripper of 5 g without a column switched the check of directions off, and nothing said so."""
    run = two_link_run(tmp_path, 2.0)
    without = replace(run, joints={"shoulder": run.joints["shoulder"]})
    _, findings = in_likely_frames(Machine.of([without]), lambda text: None)
    assert [f.code for f in findings] == ["robot.frame_unchecked"] and "elbow.position" in findings[0].sentence
