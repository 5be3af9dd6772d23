"""Joints of a robot that nothing drives, that follow others, or that nobody logged: the rest is judged all the same."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from sealegs.actuators.chain import load_chain
from sealegs.common.errors import SealegsError
from sealegs.gap.diagnose import diagnose
from sealegs.gap.log.types import MeasuredRun, MeasuredSet
from sealegs.gap.replay.tree import held_still, motion_of, not_free

from testbed.bench import NOISE_FLOOR
from testbed.logs import hidden_arm
from tests.logged_robots import free_replay, nominal_error, robot

MIMIC = (
    '<body name="mirror_link" pos="0 -0.18 0"><joint name="mirror" axis="0 0 1"/>'
    '<inertial pos="0 -0.02 0" mass="1e-5" diaginertia="1e-9 1e-9 1e-9"/></body><body name="jaw_link"'
)
TIE = '</worldbody><equality><joint joint1="mirror" joint2="jaw" polycoef="0.1 -1 0.2 0 0"/></equality>'
FRICTION = {"friction": ("elbow", "clear")}


def gripper(folder: Path, *, mimic: bool = False, hidden: Any = None, runs: int = 1, duration: float = 4.0):
    """A two-joint arm with a driven jaw that hides something, in a model with or without a mimic finger."""
    wrong = 0.0 if hidden is None else 0.05
    data, _ = hidden_arm(folder, "gripper", hidden or {}, 5, runs=runs, duration=duration, nominal_error=wrong)
    if mimic:
        text = (folder / "arm.xml").read_text()
        text = text.replace('<body name="jaw_link"', MIMIC, 1).replace("</worldbody>", TIE)
        (folder / "arm.xml").write_text(text)
    return data


def without(data: MeasuredSet, joint: str) -> MeasuredSet:
    """The same log, with nothing of a joint in it."""
    for run in data.runs:
        del run.joints[joint], run.actuators[joint]
    return data


def swinging(folder: Path, hidden: Any = None, runs: int = 1, duration: float = 4.0) -> MeasuredSet:
    """A two-joint arm with a pendulum at its end, of which only the position is logged."""
    data, _ = hidden_arm(
        folder, "swinging", hidden or {}, 5, runs=runs, duration=duration, passive=("swing",),
        nominal_error=0.0 if hidden is None else 0.05,
    )  # fmt: skip
    return data


def replay_error(run: MeasuredRun, joint: str) -> float:
    machine = robot(run)
    chain = load_chain(run.actuators[joint])
    assert not_free(machine, joint, [run], chain.armature()) is None
    return nominal_error(free_replay(run, joint))


def columns(run: MeasuredRun) -> dict[str, Any]:
    return dict(run.columns())


def sidecar(run: MeasuredRun) -> dict[str, Any]:
    return {"robot": run.robot, "actuators": dict(run.actuators)}


def test_a_follower_moves_as_its_equality_says(tmp_path: Path) -> None:
    run = gripper(tmp_path, mimic=True, duration=2.0).runs[0]
    machine = robot(run)
    motion = motion_of(machine, run)
    jaw, mirror = (int(machine.model.joint(name).dofadr[0]) for name in ("jaw", "mirror"))
    leader, follower = motion.position[:, jaw], motion.position[:, mirror]
    np.testing.assert_allclose(follower, 0.1 - leader + 0.2 * leader**2, atol=1e-12)
    np.testing.assert_allclose(np.gradient(follower, run.time)[50:-50], motion.speed[50:-50, mirror], atol=0.15)
    data = mujoco.MjData(machine.model)  # where the engine has the constraint too
    data.qpos[:] = motion.position[200]
    mujoco.mj_forward(machine.model, data)
    assert np.abs(data.efc_pos[: data.ne]).max() < 1e-9


def test_joints_beside_a_mimic_gripper_are_replayed_to_their_noise(tmp_path: Path) -> None:
    run = gripper(tmp_path, mimic=True).runs[0]
    assert replay_error(run, "elbow") < 1.5 * NOISE_FLOOR
    why = not_free(robot(run), "jaw", [run])
    assert why is not None and "ties 'mirror' to 'jaw'" in why.sentence


def test_a_light_gripper_that_was_not_logged_counts_as_held_and_this_is_said(tmp_path: Path) -> None:
    run = without(gripper(tmp_path, mimic=True), "jaw").runs[0]
    assert replay_error(run, "elbow") < 4.0 * NOISE_FLOOR  # it does move
    note = held_still(robot(run), "elbow", [run], 0.026)
    assert note is not None and "'jaw' at 0 was not logged and is taken as held there" in note.sentence
    assert note.value is not None and 0.0 < note.value < 0.05


def test_a_passive_joint_is_logged_by_its_position_alone_and_counts(tmp_path: Path) -> None:
    run = swinging(tmp_path).runs[0]
    assert replay_error(run, "elbow") < 1.5 * NOISE_FLOOR
    machine, other = robot(run), without(swinging(tmp_path), "elbow").runs[0]
    del other.joints["swing"], run.joints["swing"]
    why = not_free(machine, "elbow", [run])
    assert why is not None and "log 'swing.position'" in why.sentence
    why = not_free(machine, "shoulder", [other])
    assert why is not None and "log 'elbow.position' and 'swing.position'" in why.sentence


def test_the_refusal_of_a_joint_tells_which_joints_to_log(tmp_path: Path) -> None:
    run = swinging(tmp_path, duration=2.0).runs[0]
    table = {
        name: values for name, values in columns(run).items() if name.split(".")[-1] in ("time", "goal", "position")
    }
    del table["swing.position"]
    found = diagnose(table, sidecar=sidecar(run), causes=["friction.coulomb"])
    elbow = found.joint("elbow")
    assert elbow.verdict == "not identifiable"
    assert any("log 'swing.position'" in reason.sentence for reason in elbow.reasons)
    assert "robot.held" in [finding.code for finding in elbow.findings]
    assert "robot.frame" not in [finding.code for finding in elbow.findings], "torques of other joints are in there"


def test_a_command_is_asked_for_where_the_sidecar_names_a_drive_and_refused_where_nothing_drives(
    tmp_path: Path,
) -> None:
    run = swinging(tmp_path, duration=2.0).runs[0]
    table = columns(run)
    del table["elbow.goal"]
    with pytest.raises(SealegsError, match=r"the column 'elbow\.goal' \[rad\] is missing"):
        diagnose(table, sidecar=sidecar(run), causes=["friction.coulomb"])
    (tmp_path / "arm.yaml").write_text(
        "model: arm.xml\njoints: {shoulder: {chain: sts3215}, elbow: {chain: sts3215}}\n"
    )
    said = {"robot": str(tmp_path / "arm.yaml")}
    with pytest.raises(SealegsError, match=r"arm\.yaml drives no 'swing', it is a passive joint; log its position"):
        diagnose({**columns(run), "swing.goal": run.joints["swing"].position}, sidecar=said)
    misspelt = {name.replace("swing", "swng"): values for name, values in columns(run).items()}
    with pytest.raises(SealegsError, match=r"arm\.xml has no joint 'swng' \(did you mean 'swing'\?\)"):
        diagnose(misspelt, sidecar=said)


@pytest.mark.long
@pytest.mark.parametrize(
    "kind", ["unlogged", *(pytest.param(one, marks=pytest.mark.weekly) for one in ("mimic", "passive"))]
)
def test_friction_of_the_elbow_is_named_beside_joints_without_columns(kind: str, tmp_path: Path) -> None:
    if kind == "passive":
        data = swinging(tmp_path, FRICTION, runs=2, duration=10.0)
    else:
        data = gripper(tmp_path, mimic=True, hidden=FRICTION, runs=2, duration=10.0)
    data = without(data, "jaw") if kind == "unlogged" else data
    found = diagnose(data, causes=["friction.coulomb", "friction.viscous", "drive.delay"])
    assert [cause.name for cause in found.joint("elbow").causes] == ["friction.coulomb"]
    assert found.joint("elbow").causes[0].confidence > 0.9
    assert found.joint("shoulder").causes == ()
