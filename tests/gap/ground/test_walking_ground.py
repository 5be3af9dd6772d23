"""The ground under any robot whose base moves: what is laid out, and what is found of an independent walker."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import mujoco
import numpy as np
import pytest
from sealegs.common.errors import SealegsError
from sealegs.envs.robots import get_robot
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.ground.ground import GROUND, GroundSearch, on_ground, search_ground
from sealegs.gap.ground.pieces import ENGINE_STEP
from sealegs.gap.ground.problem import Laid
from sealegs.gap.ground.tree_ground import lay_robot
from sealegs.gap.ground.tree_model import TreeModel, base_joints, ground_of
from sealegs.gap.ground.tree_replay import TreeReplay
from sealegs.gap.log.types import MeasuredRun, MeasuredSet
from sealegs.gap.verdict.verdict import NOT_IDENTIFIABLE, NOTHING

from testbed.logs import hidden_walker
from testbed.quadruped import model_file


@cache
def walked(effect: str = "", magnitude: str | float = "clear", seed: int = 1, duration: float = 4.0) -> MeasuredSet:
    effects: Mapping[str, float | str] = {effect: magnitude} if effect else {}
    return hidden_walker(effects, seed, Path(mkdtemp()), duration=duration)[0]


def laid_out(data: MeasuredSet) -> Laid:
    found = lay_robot(data.runs, {}, lambda text: None)
    assert isinstance(found, Laid), found
    return found


@pytest.mark.long
def test_any_robot_whose_base_moves_stands_on_a_ground(tmp_path: Path) -> None:
    assert on_ground(walked().runs)
    for name, joints in (("hexapod", ["body"]), ("biped", ["hip_x", "hip_z", "torso_pitch"]), ("arm", [])):
        robot = get_robot(name)
        model = robot.build_spec().compile()
        assert [model.joint(number).name for number in base_joints(robot, model)] == joints


@pytest.mark.long
def test_on_its_own_ground_a_walker_is_replayed_within_the_noise() -> None:
    problem = laid_out(walked()).problem
    believed, slippery = problem.residual(problem.simulate([{}, {"contact.friction*": 0.2}]))
    assert np.median(np.abs(believed)) < 1.0
    assert np.mean(slippery**2) > 2.0 * np.mean(believed**2)


@pytest.mark.long
def test_joints_follow_their_measured_motion_whatever_the_ground() -> None:
    replay = laid_out(walked()).problem.replayer
    assert isinstance(replay, TreeReplay)
    run = walked().runs[replay.pieces[0].run]
    start = run.time[replay.pieces[0].start]
    for name in ("front_left_hip", "rear_right_knee"):
        column = replay.position[:, 0, replay.joints.index(name)]
        measured = np.interp(start + np.arange(len(column)) * ENGINE_STEP, run.time, run.joints[name].position)
        assert np.abs(column - measured).max() < 5e-3


@pytest.mark.long
def test_a_robot_with_closed_loops_starts_with_them_closed() -> None:
    robot = get_robot("hexapod")
    drivetrain = robot.drivetrain()
    data = mujoco.MjData(drivetrain.model)
    held = {item.name: float(drivetrain.position(item.name, data.qpos)) for item in robot.coordinates}
    time = np.arange(0.0, 5.0, 0.01)
    first = walked().runs[0]
    rows = {name: np.full(len(time), value + 0.01) for name, value in held.items()}
    log = first.joints["front_left_hip"]
    joints = {name: replace(log, position=values, goal=values) for name, values in rows.items()}
    noise = np.random.default_rng(0).normal(0.0, 1e-4, (6, len(time)))
    base = {
        f"body.{key}": noise[k] + (0.28 if key == "z" else 0.0)
        for k, key in enumerate(("x", "y", "z", "roll", "pitch", "yaw"))
    }
    run = replace(first, robot="hexapod", time=time, joints=joints, base=base, actuators={})
    replay = laid_out(MeasuredSet((run, replace(run, name="b"), replace(run, name="c")), "hexapod")).problem.replayer
    assert isinstance(replay, TreeReplay)
    data = mujoco.MjData(replay.model)
    data.qpos[:] = replay.rest[0, : replay.model.nq]
    mujoco.mj_fwdPosition(replay.model, data)
    loops = data.efc_type[: data.nefc] == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    assert loops.any() and np.abs(data.efc_pos[: data.nefc][loops]).max() < 1e-6


@pytest.mark.long
def test_ground_rises_along_x_and_y_by_its_slopes() -> None:
    model = laid_out(walked()).problem.models[0]
    assert isinstance(model, TreeModel)
    sloped = model.with_fitted({"contact.slope": 0.1, "contact.slope_y": 0.05}).drivetrain().model
    _, body = ground_of(sloped)
    data = mujoco.MjData(sloped)
    mujoco.mj_forward(sloped, data)
    normal = data.xmat[body].reshape(3, 3)[:, 2]
    assert -normal[0] / normal[2] == pytest.approx(0.1, rel=0.02)
    assert -normal[1] / normal[2] == pytest.approx(0.05, rel=0.02)


@pytest.mark.long
def test_feet_meet_the_ground_as_softly_as_the_model_file_says() -> None:
    model = laid_out(walked()).problem.models[0]
    assert isinstance(model, TreeModel)
    assert (model.contact.time, model.contact.ratio, model.contact.friction) == pytest.approx((0.011, 1.0, 0.9))
    stiffness, damping = -model.solref()  # MuJoCo: 1 / (time ratio)^2 and 2 / time
    assert (stiffness, damping) == pytest.approx((1.0 / 0.011**2, 2.0 / 0.011))


def test_feet_and_floor_mix_as_in_the_engine(tmp_path: Path) -> None:
    path = model_file(tmp_path)
    text = path.read_text().replace(
        'friction="0.9 0.005 0.0001" solref="0.011 1"/>', 'friction="0.4" solref="0.02 1"/>', 1
    )
    path.write_text(text)
    robot = get_robot(path)
    model = TreeModel.of(robot, {}, robot.drivetrain().chains, (0.0, 0.0))
    assert (model.contact.friction, model.contact.time) == pytest.approx((0.9, 0.0155))


def test_a_robot_on_several_planes_is_refused(tmp_path: Path) -> None:
    path = model_file(tmp_path)
    path.write_text(
        path.read_text().replace("<worldbody>", '<worldbody><geom type="plane" size="0 0 1" pos="0 0 -1"/>', 1)
    )
    robot = get_robot(path)
    with pytest.raises(SealegsError, match="several planes"):
        TreeModel.of(robot, {}, robot.drivetrain().chains, (0.0, 0.0))


@pytest.mark.long
def test_columns_may_leave_the_name_of_the_free_joint_out() -> None:
    with_name = [replace(run, base={f"trunk.{key}": v for key, v in run.base.items()}) for run in walked().runs]
    one, other = laid_out(walked()), laid_out(replace(walked(), runs=tuple(with_name)))
    np.testing.assert_array_equal(one.problem.measured, other.problem.measured)


def lying(run: MeasuredRun) -> MeasuredRun:
    return replace(run, base={key: run.base[key] for key in ("x", "z", "roll")})


def lacking(run: MeasuredRun) -> MeasuredRun:
    return replace(run, joints={name: log for name, log in run.joints.items() if name != "rear_left_knee"})


@pytest.mark.long
@pytest.mark.parametrize(
    ("change", "said"), [(lying, "record base.trunk.pitch"), (lacking, "record rear_left_knee.position")]
)
def test_a_walk_without_a_pose_or_a_joint_says_which_to_record(
    change: Callable[[MeasuredRun], MeasuredRun], said: str
) -> None:
    found = search_ground([change(run) for run in walked().runs], {}, 0, lambda text: None)
    assert isinstance(found, str) and said in found


def test_runs_whose_sidecars_differ_in_the_robot_are_diagnosed_apart() -> None:
    first, *others = walked().runs
    data = MeasuredSet((first, *(replace(run, robot_params={"trunk_mass": 2.5}) for run in others)), "mixed")
    with pytest.raises(SealegsError, match="other robot_params than"):
        diagnose(data)


@pytest.mark.long
@pytest.mark.parametrize(
    ("effect", "truth", "low", "high"),
    [
        ("contact.friction", "clear", 0.2, 0.42),
        pytest.param("contact.slope", "clear", 0.07, 0.09, marks=pytest.mark.weekly),
    ],
)
def test_what_is_wrong_with_the_ground_of_an_independent_walker_is_named(
    effect: str, truth: str, low: float, high: float
) -> None:
    *_, ground = diagnose(walked(effect, truth, 11, 8.0))
    assert ground.joint == GROUND
    named = {cause.name: cause for cause in ground.causes if cause.confidence >= 0.6}
    assert set(named) == {effect}, ground.sentence
    size = named[effect].parameters[effect]
    assert low < size.value < high


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.weekly)])
def test_the_ground_of_an_independent_walker_that_is_as_believed_is_left_alone(seed: int) -> None:
    *_, ground = diagnose(walked(seed=seed, duration=8.0))
    assert (ground.joint, ground.causes) == (GROUND, ())
    assert ground.verdict in (NOTHING, NOT_IDENTIFIABLE)


@pytest.mark.long
def test_wind_is_no_ground() -> None:
    found = search_ground(walked("wind", "clear", 17, 8.0).runs, {}, 0, lambda text: None)
    assert isinstance(found, GroundSearch)
    assert not found.search.accepted
