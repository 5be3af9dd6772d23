"""Robots as their scenes have them: free objects beside the robot, and links that are too quick for a long step."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from sealegs.gap.load.robot import LoggedRobot, Machine
from sealegs.gap.log.types import MeasuredRun
from sealegs.gap.prepare.resting import without_rests
from sealegs.gap.replay.problem import converged, diverged
from sealegs.gap.replay.scene import touches_of
from sealegs.gap.replay.tree import motion_of, not_free, terms_of
from sealegs.gap.verdict.decide import refuse_divergence

from tests.logged_robots import free_replay, nominal_error, robot, two_link_run

BOX = '<body name="box" pos="1 0 0.05"><freejoint name="box"/><geom size="0.05" mass="0.1"/></body>'
BALL = '<body name="lamp" pos="1 0 0.05"><joint name="neck" type="ball"/><geom size="0.05" mass="0.1"/></body>'


def beside(run: MeasuredRun, objects: str, *, first: bool = False) -> None:
    """Put objects into the scene of a run's robot, before its bodies or behind them, with a key for all coordinates."""
    path = Path(run.robot)
    text = path.read_text().replace("<worldbody>", f"<worldbody>{objects}") if first else path.read_text()
    path.write_text(text if first else text.replace("</worldbody>", f"{objects}</worldbody>"))
    count = mujoco.MjModel.from_xml_path(str(path)).nq
    key = f'<keyframe><key name="home" qpos="{" ".join(["0"] * count)}"/></keyframe></mujoco>'
    path.write_text(path.read_text().replace("</mujoco>", key))


@pytest.mark.long
@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("objects", [BOX, BALL, BOX + BALL])
def test_objects_of_a_scene_change_nothing_of_its_robot(tmp_path: Path, objects: str, first: bool) -> None:
    """Each diagnosis of an arm beside a free box ended in a traceback."""
    run = two_link_run(tmp_path, 4.0)
    alone = terms_of(robot(run), "elbow", [run])[0]
    beside(run, objects, first=first)
    assert robot(run).model.njnt == 2
    np.testing.assert_allclose(terms_of(robot(run), "elbow", [run])[0], alone, atol=1e-12)
    assert nominal_error(free_replay(run, "elbow")) < 2e-3


def test_a_body_with_a_ball_joint_that_holds_a_driven_joint_stays(tmp_path: Path) -> None:
    run = two_link_run(tmp_path, 4.0)
    path = Path(run.robot)
    hung = path.read_text().replace(
        "<worldbody>",
        '<worldbody><body name="hook"><joint name="hip" type="ball"/>'
        '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>',
    )
    path.write_text(hung.replace("</worldbody>", "</body></worldbody>"))
    assert robot(run).model.njnt == 3


def floor(run: MeasuredRun, height: float) -> MeasuredRun:
    """The run with a floor in its scene, and a foot at the end of the arm, which hangs down from 0.5 m."""
    path = Path(run.robot)
    text = path.read_text().replace("<worldbody>", f'<worldbody><geom type="plane" size="2 2 0.1" pos="0 0 {height}"/>')
    foot = '<geom name="foot" type="sphere" size="0.01" pos="0 -0.18 0" mass="0"/><site name="end"'
    path.write_text(text.replace('<site name="end"', foot))
    return run


def test_where_a_robot_touches_its_own_floor_is_left_out_at_the_joints_that_carry_it(tmp_path: Path) -> None:
    """Joints are replayed without contacts: a planar robot on its floor had an offset of 82 mrad named."""
    run = two_link_run(tmp_path, 8.0)
    assert touches_of(robot(floor(run, -1.0)), run) is None
    tip = heights(robot(run), run)
    low = float(np.quantile(tip, 0.1))
    found = touches_of(robot(floor(two_link_run(tmp_path, 8.0), low - 0.01)), run)
    assert found is not None and found.part == "elbow_link" and set(found.joints) == {"shoulder", "elbow"}
    np.testing.assert_array_equal(found.joints["elbow"][tip < low - 0.002], 1.0)
    assert 0.1 <= found.joints["elbow"].mean() < 0.4


def test_a_joint_that_always_touches_is_moved_as_measured(tmp_path: Path) -> None:
    run = two_link_run(tmp_path, 8.0)
    highest = float(heights(robot(run), run).max())
    marked, (finding,) = without_rests(Machine.of([floor(run, highest)]))
    assert "moved as measured" in finding.sentence and finding.code == "robot.touches"
    why = not_free(robot(run), "elbow", marked)
    assert why is not None and "touches the floor" in why.sentence


def tied(run: MeasuredRun, low: float, high: float) -> MeasuredRun:
    """The run with a tendon in its robot's file that has only ends: the sum of both angles."""
    path = Path(run.robot)
    tendon = f'''<tendon><fixed name="cord" limited="true" range="{low} {high}">
    <joint joint="shoulder" coef="1"/><joint joint="elbow" coef="1"/></fixed></tendon></mujoco>'''
    path.write_text(path.read_text().replace("</mujoco>", tendon))
    return run


def test_a_tendon_that_only_ends_is_nothing_where_it_does_not(tmp_path: Path) -> None:
    """Each joint of a hand with such tendons was moved as measured, so nothing but its current could be judged."""
    run = two_link_run(tmp_path, 4.0)
    tied(run, -9.0, 9.0)
    assert not_free(robot(run), "elbow", [run]) is None
    machine, said = without_rests(Machine.of([run]))
    assert list(machine) == [run] and not said
    assert nominal_error(free_replay(run, "elbow")) < 2e-3


def test_what_a_tendon_ends_is_left_out_at_the_joints_that_it_runs_over(tmp_path: Path) -> None:
    run = two_link_run(tmp_path, 8.0)
    position = motion_of(robot(run), run).position.sum(axis=1)
    tied(run, float(position.min()) - 0.5, float(np.quantile(position, 0.97)))
    (marked,), (finding,) = without_rests(Machine.of([run]))
    assert finding.code == "robot.touches" and "'cord' most" in finding.sentence
    for name in ("shoulder", "elbow"):
        touched = marked.joints[name].touched
        assert touched is not None and 0.02 < touched.mean() < 0.5


def heights(machine: LoggedRobot, run: MeasuredRun) -> np.ndarray:
    """Height of the arm's end (n,) [m]."""
    data, rows = mujoco.MjData(machine.model), motion_of(machine, run).position
    found = []
    for row in rows:
        data.qpos[:] = row
        mujoco.mj_kinematics(machine.model, data)
        found.append(float(data.site("end").xpos[2]))
    return np.array(found)


def damped(run: MeasuredRun, damping: float) -> MeasuredRun:
    """The run with an ideal drive of so much damping [N.m.s/rad] on a link of 2 g.m2."""
    run.actuators["elbow"] = [{"ideal": {"stiffness": 20.0, "damping": damping}}]
    return run


def test_a_replay_that_leaves_all_bounds_is_made_in_shorter_steps(tmp_path: Path) -> None:
    """Two steps that both diverge differ by nothing: the longest was taken as exact, and friction named with 0.99."""
    run = two_link_run(tmp_path, 4.0)
    problem = free_replay(damped(run, 4.0), "elbow")
    assert all(diverged(problem.simulate([{}], step)[0]) for step in (5e-3, 2.5e-3))
    found = converged(problem)
    assert found.step < 2.5e-3 and not diverged(found.simulate([{}])[0])
    assert refuse_divergence(found, "elbow") is None


def test_a_model_that_leaves_all_bounds_in_any_step_is_refused_in_a_sentence(tmp_path: Path) -> None:
    problem = converged(free_replay(damped(two_link_run(tmp_path, 4.0), 500.0), "elbow"))
    why = refuse_divergence(problem, "elbow")
    assert why is not None and "leaves all bounds even in steps of" in why.reason
