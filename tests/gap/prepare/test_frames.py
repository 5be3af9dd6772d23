"""Zeros and directions of a robot's log that are not the model's: told by gravity, coupling and replay, and taken."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from sealegs.gap.diagnose import diagnose
from sealegs.gap.load.robot import Frame, Machine
from sealegs.gap.log.finding import Finding
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
        joint="elbow", verdict=NOTHING, sentence="Nothing to explain.", signal="elbow.position", frames=frames
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


# --- slides of a robot's log that count the other way round: told by weight and coupling, and turned -----------------

STIFFNESS, DAMPING, FRICTION, VISCOUS = 3000.0, 80.0, 1.0, 5.0
LIFTED, GRAVITY = 2.0, 9.81  # [kg] behind the vertical slide of the gantry, [m/s2]
SAGS = LIFTED * GRAVITY / STIFFNESS  # [m] that its drive is off its goal
TURN = 0.15  # [rad or m] of motions

GANTRY = """<mujoco model="gantry"><compiler angle="radian" autolimits="true"/><worldbody>
<body name="bridge"><joint name="x" type="slide" axis="1 0 0" range="-0.5 0.5"/>
<inertial pos="0 0 0" mass="4" diaginertia="1 1 1"/>
<body name="lift"><joint name="z" type="slide" axis="0 0 1" range="{low} {high}"/>
<inertial pos="0 0 0" mass="{mass}" diaginertia="1 1 1"/></body></body></worldbody></mujoco>"""
POLAR = """<mujoco model="polar"><compiler angle="radian" autolimits="true"/><worldbody>
<body name="boom"><joint name="pitch" axis="0 -1 0" range="-1.5 1.5"/>
<inertial pos="0.1 0 0" mass="1" diaginertia=".01 .01 .01"/>
<body name="beam"><joint name="reach" type="slide" axis="1 0 0" range="0.2 0.8"/>
<inertial pos="0 0 0" mass="2" diaginertia=".01 .01 .01"/></body></body></worldbody></mujoco>"""
CART = """<mujoco model="cart"><compiler angle="radian" autolimits="true"/><worldbody>
<body name="cart"><joint name="x" type="slide" axis="1 0 0" range="-0.5 0.5"/>
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<body name="pole"><joint name="pole" axis="0 1 0"/><inertial pos="0 0 -0.3" mass="3" diaginertia=".01 .01 .01"/></body>
</body></worldbody></mujoco>"""


def gantry(mass: float = LIFTED, low: float = -0.3, high: float = 0.3) -> str:
    return GANTRY.format(mass=mass, low=low, high=high)


def recorded(
    folder: Path, model: str, middles: Mapping[str, float], passive: str = "", believed: str = ""
) -> MeasuredRun:
    """Joints that swing about these places, by the goals that the motion needs of their drives.

    Args:
        folder: for the file of the model.
        model: of what was recorded.
        middles: by joint.
        passive: joint that nothing drives.
        believed: model that the log names; default: the same.
    """
    machine = mujoco.MjModel.from_xml_string(model)
    data, time = mujoco.MjData(machine), np.arange(0.0, 8.0, 0.005)
    rows = np.empty((4, len(time), machine.nv))
    for j, middle in enumerate(middles.values()):
        phases = [(0.4 + 0.13 * j, 0.3 * j, 0.7), (1.1 + 0.17 * j, 1.0 + j, 0.3)]
        for k in range(3):
            waves = [part * (2.0 * np.pi * f) ** k * np.sin(2.0 * np.pi * f * time + phase + 0.5 * np.pi * k)
                     for f, phase, part in phases]  # fmt: skip
            rows[k, :, j] = TURN * np.sum(waves, axis=0) + (middle if k == 0 else 0.0)
    for k in range(len(time)):
        data.qpos[:], data.qvel[:], data.qacc[:] = rows[:3, k]
        mujoco.mj_inverse(machine, data)
        rows[3, k] = data.qfrc_inverse
    noise, joints = np.random.default_rng(4).normal(0.0, 1e-5, rows[0].shape), {}
    for j, name in enumerate(middles):
        place, speed = rows[0, :, j], rows[1, :, j]
        drive = rows[3, :, j] + FRICTION * np.tanh(speed / 1e-3) + (VISCOUS + DAMPING) * speed
        goal = None if name == passive else place + drive / STIFFNESS
        joints[name] = JointLog(goal=goal, position=place + noise[:, j])
    path = folder / "robot.xml"
    path.write_text(believed or model, encoding="utf-8")
    chain: list = [
        {"ideal": {"stiffness": STIFFNESS, "damping": DAMPING, "torque_limit": 1e4, "armature": 0.0}},
        {"friction": {"coulomb": FRICTION, "viscous": VISCOUS}},
    ]
    driven: dict[str, str | list] = {name: chain for name in middles if name != passive}
    return MeasuredRun("run", time, joints, robot=str(path), actuators=driven, meta={"group": "run"})


def as_host(run: MeasuredRun, joint: str, counts: Callable[[np.ndarray], np.ndarray]) -> MeasuredRun:
    """The run as a host logs it whose places of a joint count otherwise."""
    log = run.joints[joint]
    goal = None if log.goal is None else counts(log.goal)
    return replace(run, joints={**run.joints, joint: JointLog(goal=goal, position=counts(log.position))})


def judged(run: MeasuredRun) -> tuple[dict[str, Frame], dict[str, Finding]]:
    """The frames in which a diagnosis takes a run, where they are not the model's, and what it says."""
    runs, findings = in_likely_frames(Machine.of([run]), lambda text: None)
    frames = {name: frame for name, frame in robot(runs[0]).frames.items() if frame != Frame()}
    assert len({finding.code for finding in findings}) == len(findings)
    return frames, {finding.code: finding for finding in findings}


def off(run: MeasuredRun, way: float) -> MeasuredRun:
    """The run with a position of z that has another zero than its goal [m]."""
    log = run.joints["z"]
    return replace(run, joints={**run.joints, "z": replace(log, position=log.position + way)})


MIDDLES = {"x": 0.0, "z": 0.05}


@pytest.fixture(scope="module")
def slide_run(tmp_path_factory: pytest.TempPathFactory) -> MeasuredRun:
    return recorded(tmp_path_factory.mktemp("gantry"), gantry(), MIDDLES)


def test_a_vertical_slide_that_counts_the_other_way_is_turned_and_told_in_millimetres(slide_run: MeasuredRun) -> None:
    """Nothing was said of it, and the gap was a zero that is off by twice what the drive sags."""
    frames, said = judged(as_host(slide_run, "z", np.negative))
    assert frames == {"z": Frame(0.0, -1.0)}
    sentence = said["robot.frame"].sentence
    assert "are taken here" in sentence and f"{2e3 * SAGS:.3g} mm rms" in sentence and "rad" not in sentence
    assert "constant force of about twice the weight" in sentence, "of the size that is told it looks the same"


def test_a_right_slide_is_left_alone_and_a_level_one_is_listed_as_not_told(slide_run: MeasuredRun) -> None:
    frames, said = judged(slide_run)
    assert frames == {} and list(said) == ["robot.frame_unknown"]
    assert "the direction of x:" in said["robot.frame_unknown"].sentence


def test_the_direction_of_a_level_slide_that_nothing_tells_is_believed(slide_run: MeasuredRun) -> None:
    frames, said = judged(as_host(slide_run, "x", np.negative))
    assert frames == {} and list(said) == ["robot.frame_unknown"]


@pytest.mark.parametrize("mass", quick([0.5, 1.5, 4.0], 2))
def test_a_wrong_mass_is_no_other_direction(tmp_path: Path, mass: float) -> None:
    frames, said = judged(recorded(tmp_path, gantry(), MIDDLES, believed=gantry(mass)))
    assert frames == {} and "robot.frame" not in said


@pytest.mark.parametrize("sags", quick([0.5, -0.5, 4.0, -4.0], 2))
def test_a_zero_that_goal_and_position_do_not_share_is_no_other_direction(slide_run: MeasuredRun, sags: float) -> None:
    frames, said = judged(off(slide_run, sags * SAGS))
    assert frames == {} and "robot.frame" not in said


@pytest.mark.parametrize("way", quick([1.0, -1.0], 2))
def test_a_zero_of_both_is_no_other_direction(slide_run: MeasuredRun, way: float) -> None:
    frames, _ = judged(as_host(slide_run, "z", lambda places: places + 0.1 * way))
    assert frames == {}


def test_a_slide_is_only_doubted_where_a_constant_force_is_as_likely(tmp_path: Path) -> None:
    """Turned around, its load would be 1.6 times the model's: another zero or force may be it."""
    turned = as_host(recorded(tmp_path, gantry(), MIDDLES, believed=gantry(LIFTED / 1.6)), "z", np.negative)
    frames, said = judged(turned)
    assert frames == {}
    assert "constant force" in said["robot.frame"].sentence and "z: {zero: 0" in said["robot.frame"].sentence


def test_a_slide_that_counts_from_the_other_end_of_its_range_is_turned_with_it(tmp_path: Path) -> None:
    slide_run = recorded(tmp_path, gantry(low=-0.02, high=0.4), {"x": 0.0, "z": 0.2})
    frames, _ = judged(as_host(slide_run, "z", lambda places: 0.38 - places))
    assert list(frames) == ["z"] and frames["z"].sign == -1.0 and frames["z"].zero == pytest.approx(0.38)


@pytest.mark.parametrize("mass", [LIFTED, LIFTED / 3.0])
def test_the_range_tells_what_the_weight_alone_leaves_open(tmp_path: Path, mass: float) -> None:
    believed = gantry(mass, low=-0.02, high=0.4)
    slide_run = recorded(tmp_path, gantry(low=-0.02, high=0.4), {"x": 0.0, "z": 0.2}, believed=believed)
    frames, said = judged(as_host(slide_run, "z", np.negative))
    assert frames == {"z": Frame(0.0, -1.0)} and "constant" not in said["robot.frame"].sentence


def test_a_direction_that_a_sidecar_gives_is_doubted_and_kept(slide_run: MeasuredRun) -> None:
    given = {"z": {"zero": 0.0, "direction": -1}}
    frames, said = judged(replace(slide_run, meta={**slide_run.meta, "frames": given}))
    assert frames == {"z": Frame(0.0, -1.0)} and "are taken" not in said["robot.frame"].sentence


def test_a_slide_that_a_force_drives_is_doubted_and_not_turned(slide_run: MeasuredRun) -> None:
    log = slide_run.joints["z"]
    assert log.goal is not None
    speed = np.gradient(log.position, slide_run.time)
    force = STIFFNESS * (log.goal - log.position) - DAMPING * speed
    turned = JointLog(goal=None, position=-log.position, torque_command=-force)
    chain = [{"torque_command": {}}, {"friction": {"coulomb": FRICTION, "viscous": VISCOUS}}]
    driven = replace(slide_run, joints={**slide_run.joints, "z": turned}, actuators={**slide_run.actuators, "z": chain})
    frames, said = judged(driven)
    assert frames == {} and "z: {zero: 0, direction: -1}" in said["robot.frame"].sentence


@pytest.mark.long
@pytest.mark.parametrize("joint", ["", "reach", "pitch"])
def test_of_a_slide_on_a_hinge_the_joint_is_turned_that_counts_the_other_way(tmp_path: Path, joint: str) -> None:
    """An arm and its mirror image need the same torques; the range of the slide tells them apart."""
    slide_run = recorded(tmp_path, POLAR, {"pitch": 0.4, "reach": 0.5})
    frames, _ = judged(as_host(slide_run, joint, np.negative) if joint else slide_run)
    assert {name: frame.sign for name, frame in frames.items()} == ({joint: -1.0} if joint else {})


def test_a_cart_is_turned_by_its_coupling_and_the_pole_is_named_that_may_be_turned_instead(tmp_path: Path) -> None:
    slide_run = recorded(tmp_path, CART, {"x": 0.0, "pole": 0.3}, passive="pole")
    assert judged(slide_run)[0] == {}
    frames, said = judged(as_host(slide_run, "x", np.negative))
    assert frames == {"x": Frame(0.0, -1.0)}
    assert "pole turned around instead" in said["robot.frame"].sentence and "robot.frame_unknown" not in said


def test_a_hinge_that_is_only_doubted_turns_no_slide_instead(tmp_path: Path) -> None:
    """Of a pole that a torque drives no direction is taken; its cart was turned in its place, and both were named."""
    slide_run = recorded(tmp_path, CART, {"x": 0.0, "pole": 0.3})
    pole = slide_run.joints["pole"]
    assert pole.goal is not None
    torque = STIFFNESS * (pole.goal - pole.position) - DAMPING * np.gradient(pole.position, slide_run.time)
    chain: list = [{"torque_command": {}}, {"friction": {"coulomb": FRICTION, "viscous": VISCOUS}}]
    turned = JointLog(goal=None, position=-pole.position, torque_command=-torque)
    driven = replace(
        slide_run, joints={**slide_run.joints, "pole": turned}, actuators={**slide_run.actuators, "pole": chain}
    )
    frames, said = judged(driven)
    assert frames == {} and "pole: {zero: 0, direction: -1}" in said["robot.frame"].sentence
