"""The compiled joint simulator agrees with the engine, and knows the heat of motors and their shared supply."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from sealegs.actuators.chain import load_chain
from sealegs.common.errors import SealegsError
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.load.load import PendulumLoad, bench_parameters
from sealegs.gap.load.robot import LoggedRobot, Machine
from sealegs.gap.load.terms import T_COLUMNS, T_DRAWN, T_OWN
from sealegs.gap.load.tree import TreeLoad
from sealegs.gap.log.parts import cut
from sealegs.gap.log.types import JointLog, MeasuredRun, MeasuredSet
from sealegs.gap.prepare.resting import without_rests
from sealegs.gap.replay.engine import bench, replay_in_engine
from sealegs.gap.replay.free import NO_TERMS, FreeProblem, free_problem
from sealegs.gap.replay.joint_model import Axis, JointModel
from sealegs.gap.replay.layout import between_steps, heated
from sealegs.gap.replay.problem import converged, diverged
from sealegs.gap.replay.scene import touches_of
from sealegs.gap.replay.simulator import replay
from sealegs.gap.replay.tree import motion_of, not_free, terms_of
from sealegs.gap.verdict.decide import refuse_divergence
from sealegs.gap.verdict.verdict import NOTHING

from tests.logged_robots import free_replay, nominal_error, robot, two_link_run
from tests.smooth_bench import CHAIN, PARAMS

EXTENSIONS = {
    "nominal": {},
    "load dependent friction": {"friction.load": 0.1, "friction.stribeck": 0.05},
    "presliding": {"friction.bristle_stiffness": 4.0},
    "duty step": {"duty_step.size": 0.03},
    "thermal": {"thermal.loss": 0.01, "thermal.temperature": 40.0},
    "compliance": {"compliance.stiffness": 15.0, "compliance.damping": 0.02},
    "blocked": {"load.stop_angle": 0.4, "load.lower_stop": -0.4},
}
# every bounce enlarges what came before it, so that no step is short enough
BOUNCING = {"backlash.width": 0.1, "backlash.tooth_stiffness": 900.0, "backlash.tooth_damping": 0.5}


def excitation(duration: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Time [s] and goal [rad] at 200 Hz: multisine, then steps."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, duration, 0.005)
    smooth = sum(0.3 / (1 + f) * np.sin(2 * np.pi * f * time + rng.uniform(0, 6)) for f in (0.2, 0.5, 1.1, 1.9))
    steps = rng.uniform(-0.8, 0.8, int(duration) + 1)[time.astype(int)]
    return time, np.where(time < duration / 2, smooth, steps)


def simulate(
    joint: JointModel, time: np.ndarray, goal: np.ndarray, step: float, state=(0.0, 0.0), params=PARAMS
) -> np.ndarray:
    program = joint.chain.program()
    out = np.empty((len(time), 4))
    thermal = joint.chain.find("thermal")
    warm = np.full(len(time), thermal.temperature if thermal is not None else 25.0)
    constants = joint.constants(params, program)
    on = np.ones(len(time), bool)
    replay(program.copy(), constants, NO_TERMS, time, goal, on, warm, state[0], state[1], step, out)
    return out


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))


@pytest.mark.parametrize("name", EXTENSIONS)
def test_halving_the_step_changes_little_and_ever_less(name: str) -> None:
    joint = JointModel(load_chain(CHAIN)).with_values(EXTENSIONS[name])
    time, goal = excitation(8.0)
    exact = simulate(joint, time, goal, 2e-5)[:, 0]
    coarse, fine = (rms(simulate(joint, time, goal, step)[:, 0] - exact) for step in (1e-3, 2.5e-4))
    assert fine < 0.06e-3
    assert fine < 0.5 * coarse or coarse < 0.02e-3


@pytest.mark.long
@pytest.mark.parametrize("name", [*EXTENSIONS, "bouncing teeth"])
def test_the_engine_agrees(name: str) -> None:
    joint = JointModel(load_chain(CHAIN)).with_values(EXTENSIONS.get(name, BOUNCING))
    time, goal = excitation(6.0, seed=1)
    ours = simulate(joint, time, goal, 2.5e-4)
    engine = replay_in_engine(bench(joint, PARAMS), time, goal, (0.0, 0.0), step=2.5e-4)
    assert rms(ours[:, 0] - engine[:, 0]) < 0.2e-3


def test_an_empty_shaft_is_a_bench_whose_joint_is_its_armature() -> None:
    params = bench_parameters({"mass": 0.0}, "log.csv")
    joint = JointModel(load_chain(CHAIN))
    assert (joint.load.inertia(params), joint.load.gravity_torque(params)) == (0.0, 0.0)
    time, goal = excitation(6.0, seed=1)
    ours = simulate(joint, time, goal, 2.5e-4, params=params)
    engine = replay_in_engine(bench(joint, params), time, goal, (0.0, 0.0), step=2.5e-4)
    assert rms(ours[:, 0] - engine[:, 0]) < 0.2e-3
    assert np.isfinite(ours).all() and rms(ours[:, 0]) > 0.1


@pytest.mark.parametrize(
    ("params", "sentence"),
    [
        ({}, "says nothing of the bench's load; add mass"),
        ({"mass": -1.0, "length": 0.1}, "has mass: -1; a mass is zero or more"),
        ({"mass": 0.5}, "needs 'length' above zero"),
        ({"mass": 0.5, "lenght": 0.1}, "did you mean 'length'"),
    ],
)
def test_a_load_that_no_bench_has_is_refused_with_one_sentence(params: dict[str, float], sentence: str) -> None:
    with pytest.raises(SealegsError, match=sentence):
        bench_parameters(params, "log.csv")


def test_a_spring_with_an_inertia_of_its_own_is_refused() -> None:
    chain, time = load_chain("mabel_left_leg_shape"), np.arange(0.0, 1.0, 0.005)
    with pytest.raises(SealegsError, match="'spring' has an inertia of its own"):
        simulate(JointModel(chain), time, np.zeros_like(time), 1e-3)
    massless = chain.without_stage("compliance").with_value("spring.unilateral", 0.0).with_value("spring.inertia", 0.0)
    simulate(JointModel(massless), time, np.zeros_like(time), 1e-3)


def test_a_stuck_joint_stays_stuck() -> None:
    joint = JointModel(load_chain(CHAIN)).with_values({"friction.coulomb": 1.0})
    time = np.arange(0.0, 5.0, 0.005)
    out = simulate(joint, time, np.full(len(time), 0.5), 1e-3, (0.45, 0.0))
    assert np.ptp(out[:, 0]) == 0.0


def test_a_stop_holds_the_link() -> None:
    joint = JointModel(load_chain(CHAIN), PendulumLoad(stop_angle=0.3))
    time = np.arange(0.0, 2.0, 0.005)
    out = simulate(joint, time, np.full(len(time), 0.8), 1e-3)
    assert 0.3 <= out[-1, 0] < 0.31


def test_temperature_of_the_log_weakens_the_motor() -> None:
    joint = JointModel(load_chain(CHAIN)).with_values({"thermal.loss": 0.01})
    weaker = JointModel(load_chain(CHAIN)).with_values({"dc_motor.motor_constant": 1.2 * 0.8})
    time, goal = excitation(4.0)
    out = np.empty((len(time), 4))
    program = joint.chain.program()
    constants = joint.constants(PARAMS, program)
    replay(
        program,
        constants,
        NO_TERMS,
        time,
        goal,
        np.ones(len(time), bool),
        np.full(len(time), 45.0),
        0.0,
        0.0,
        1e-3,
        out,
    )
    np.testing.assert_allclose(out, simulate(weaker, time, goal, 1e-3), atol=1e-9)


@pytest.mark.long
def test_a_log_of_the_nominal_model_at_a_fine_step_has_nothing_to_explain() -> None:
    chain = [*CHAIN[:-1], {"encoder": {"ticks": 4096}}]
    joint, rng, runs = JointModel(load_chain(chain)), np.random.default_rng(3), []
    for k in range(3):
        time, goal = excitation(12.0, seed=k)
        out = simulate(joint, time, goal, 2e-5)
        reading = out[:, 0] + rng.normal(0.0, 3.9e-4, len(time))
        tick = 2.0 * np.pi / 4096
        log = JointLog(goal=goal, position=tick * np.round(reading / tick), duty=out[:, 2], current=out[:, 3])
        runs.append(MeasuredRun(f"run{k}", time, {"servo": log}, {}, "bench", PARAMS, {"servo": chain}))
    (found,) = diagnose(MeasuredSet(tuple(runs), "null"))
    assert found.verdict == NOTHING, found.sentence
    assert not found.causes


def test_a_start_is_told_in_readings() -> None:
    joint = JointModel(load_chain(CHAIN)).with_values({"encoder.scale": 0.5, "position_p.gain": 0.0})
    time = np.arange(0.0, 0.02, 0.001)
    out = simulate(joint, time, np.zeros(len(time)), 1e-4, (0.1, 2.0))
    assert out[0, 0] == pytest.approx(0.1, abs=1e-9)
    assert (out[1, 0] - out[0, 0]) / 1e-3 == pytest.approx(2.0, rel=0.1)


def test_a_temperature_that_is_polled_slowly_lies_on_a_line_between_its_readings() -> None:
    time = np.arange(0.0, 60.0, 0.005)
    read = np.where(np.arange(len(time)) % 200 == 0, np.round(30.0 + 0.5 * time), np.nan)
    log = JointLog(np.sin(time), np.sin(time), temperature=read)
    run = MeasuredRun("warm", time, {"servo": log}, robot="bench", robot_params=PARAMS)
    units = cut([run] * 6, "servo")
    problem = free_problem([run] * 6, "servo", [JointModel(load_chain(CHAIN))] * 6, units, {"position": 1.0})
    np.testing.assert_allclose(problem.temperature, np.tile(30.0 + 0.5 * time, 6), atol=1.1)


def motor(seconds: float = 60.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, current and temperature of a winding that warms by 2 K, with numbers of its own (4 J/K, 9 K/W)."""
    time = np.arange(0.0, seconds, 0.01)
    current = 0.26 * np.sin(2.0 * time) * (1.0 + (np.sin(0.2 * time) > 0.0))
    warm = np.empty(len(time))
    level = 24.7
    for k, i in enumerate(current):
        warm[k] = level
        level += 0.01 * (3.0 * i * i - (level - 24.7) / 9.0) / 4.0
    return time, current, warm


def test_the_current_tells_what_rounding_hid():
    time, current, warm = motor()
    logged = np.round(warm)
    assert np.ptp(logged) <= 2.0
    found = heated(time, logged, current)
    error, before = (np.std(values - warm) for values in (found, between_steps(time, logged)))
    assert error < 0.12 and error < 0.6 * before


def test_what_the_current_does_not_explain_stays_as_it_was_logged():
    time, current, warm = motor()
    room = np.round(24.7 + 3.0 * (time > 30.0))
    assert heated(time, np.round(warm), None) is not None
    assert np.array_equal(heated(time, room, 0.0 * current), room)
    fine = np.round(warm, 2)
    assert np.array_equal(heated(time, fine, current), fine)


TIME = np.arange(400.0) * 0.005
DRAWN = 2.0  # [A] by the other joints
SAG = 0.7  # [ohm]
FOUND = {"supply.resistance": SAG}


def joint(drawn: float) -> FreeProblem:
    """A joint that is told to jump, beside others that draw so much [A]."""
    log = JointLog(np.zeros(400), np.sign(np.sin(2.0 * np.pi * TIME)))
    run = MeasuredRun("run", TIME, {"servo": log}, {}, "bench", dict(PARAMS), {"servo": CHAIN})
    terms = np.zeros((400, T_COLUMNS))
    terms[:, T_OWN] = 0.01  # [kg.m2]
    terms[:, T_DRAWN] = drawn
    model = JointModel(load_chain(CHAIN), TreeLoad(), axis=Axis(low=-1.0, high=1.0))
    return free_problem([run], "servo", [model], cut([run], "servo", None), {"position": 1e3}, [terms])


def test_what_other_joints_draw_is_as_a_lower_voltage_of_the_supply() -> None:
    """A gripper's wrist was 46 mrad off while its jaw, against a stop, pulled the voltage of both down."""
    alone, beside = joint(0.0), joint(DRAWN)
    lower = {**FOUND, "supply.volts": alone.models[0].value("supply.volts") - SAG * DRAWN}
    assert beside.simulate([FOUND])[0] == pytest.approx(alone.simulate([lower])[0], abs=1e-9)
    assert np.abs(beside.simulate([FOUND])[0] - alone.simulate([FOUND])[0]).max() > 0.05


def test_a_supply_that_does_not_sag_gives_its_voltage_whatever_others_draw() -> None:
    np.testing.assert_array_equal(joint(DRAWN).simulate([{}]), joint(0.0).simulate([{}]))


# --- robots as their scenes have them: free objects beside the robot, and links that are too quick for a long step ---

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
