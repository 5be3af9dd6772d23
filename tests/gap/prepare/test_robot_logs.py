"""Logs of robots: each joint of a tree is replayed to its noise; joints that press on something are left out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from sealegs.common.errors import SealegsError
from sealegs.envs.described.as_robot import bare_model
from sealegs.gap.causes.catalogue import adjustable, catalogue
from sealegs.gap.checks.stops import stops_of
from sealegs.gap.diagnose import diagnose
from sealegs.gap.experiment import propose, write_experiment
from sealegs.gap.finder.diagnosis import diagnose as joints_of
from sealegs.gap.load.resting import Resting, find_resting
from sealegs.gap.load.robot import Machine, robot_of
from sealegs.gap.load.terms import E_SIZE
from sealegs.gap.load.tree import DERIVATIVE_STEP, Motion, least_payload, terms_along, tip_behind
from sealegs.gap.log.parts import FIT_A, FIT_B, LEAST_FREE, cut
from sealegs.gap.log.sidecar import read_sidecar
from sealegs.gap.log.types import JointLog, MeasuredRun, MeasuredSet
from sealegs.gap.measure.measured import whole_fit
from sealegs.gap.prepare import resting
from sealegs.gap.prepare.checking import check_log, with_whole_goals
from sealegs.gap.prepare.pieces import cut_joint
from sealegs.gap.prepare.resting import RESTS, without_rests
from sealegs.gap.replay.tree import held_terms, not_free
from sealegs.gap.search.fit import fit
from sealegs.gap.search.result import Search
from sealegs.gap.search.windows import split
from sealegs.gap.verdict.verdict import NOTHING

from benchmarks.kept import DATA
from benchmarks.robot_logs import so101
from testbed.arm import ARMS, mjcf
from testbed.bench import NOISE_FLOOR
from testbed.logs import hidden_arm
from tests.logged_robots import block_of, robot, two_link_run
from tests.logged_robots import free_replay as problem
from tests.logged_robots import nominal_error as error


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_terms_of_a_joint_are_those_of_inverse_dynamics(sign: float) -> None:
    model = mujoco.MjModel.from_xml_string(mjcf(ARMS["six_joint"]))
    rng = np.random.default_rng(3)
    q, w, a = rng.normal(0.0, 0.7, (3, 5, model.nv))
    data = mujoco.MjData(model)
    for joint in range(model.njnt):
        terms = terms_along(model, joint, Motion(q, w, a), sign)
        for k in range(len(q)):
            away, faster = 2.0 * DERIVATIVE_STEP, 0.4
            data.qpos[:], data.qvel[:], data.qacc[:] = q[k], w[k], a[k]
            data.qpos[joint] += sign * away
            data.qvel[joint] += sign * faster
            mujoco.mj_inverse(model, data)
            _, _, inertia, bias, slope, curve, drag, coupling = terms[k, :E_SIZE]
            torque = inertia * sign * a[k, joint] + bias + drag * faster
            torque += slope * np.sin(away) + curve * (1.0 - np.cos(away))
            assert torque == pytest.approx(sign * data.qfrc_inverse[joint], abs=2e-4)
            data.qpos[:], data.qvel[:] = q[k], w[k]
            mujoco.mj_forward(model, data)
            assert bias - coupling == pytest.approx(sign * data.qfrc_bias[joint], abs=1e-9)


def test_a_payload_adds_to_the_terms_what_it_does_to_inverse_dynamics() -> None:
    text = mjcf(ARMS["two_link"])
    point = 'pos="0 -0.18 0"'  # where the site is
    loaded = text.replace(
        "<site", f'<body {point}><inertial pos="0 0 0" mass="0.3" diaginertia="1e-9 1e-9 1e-9"/></body><site'
    )
    q, w, a = np.random.default_rng(4).normal(0.0, 0.7, (3, 4, 2))
    plain, other = (mujoco.MjModel.from_xml_string(xml) for xml in (text, loaded))
    for joint in range(2):
        terms = terms_along(plain, joint, Motion(q, w, a))
        whole = terms_along(other, joint, Motion(q, w, a))
        np.testing.assert_allclose(block_of(terms, 0) + 0.3 * block_of(terms, 1), block_of(whole, 0), atol=2e-6)


@pytest.mark.parametrize("direction", [1, -1])
def test_accelerations_of_other_joints_are_no_load_to_the_friction_of_a_gear(tmp_path: Path, direction: int) -> None:
    """The engine's bias and the published fits have none of it; 2.8 mrad were left where the noise is 0.65."""
    hidden = {"load_friction": ("shoulder_lift", "clear")}
    data, _ = hidden_arm(tmp_path, "six_joint", hidden, seed=31, runs=1, duration=6.0, nominal_error=0.0)
    run = data.runs[0]
    if direction < 0:
        log = run.joints["shoulder_lift"]
        turned = {key: -values for key, values in log.signals().items()}
        run = replace(run, joints={**run.joints, "shoulder_lift": JointLog(**turned)})
        run = replace(run, meta={**run.meta, "frames": {"shoulder_lift": {"direction": -1}}})
    replay = problem(run, "shoulder_lift")
    simulated = replay.simulate([{"friction.load": 0.25}])[0]
    assert np.sqrt(np.mean(replay.position_error(simulated) ** 2)) < 1.5 * NOISE_FLOOR


@pytest.mark.long
def test_each_joint_of_an_arm_is_replayed_to_its_noise(tmp_path: Path) -> None:
    data, _ = hidden_arm(tmp_path, "six_joint", {}, seed=5, runs=1, duration=4.0, nominal_error=0.0)
    for joint in ("shoulder_lift", "wrist_flex"):
        assert error(problem(data.runs[0], joint)) < 1.5 * NOISE_FLOOR


@pytest.mark.long
def test_friction_of_one_joint_is_an_error_of_that_joint_alone(tmp_path: Path) -> None:
    data, _ = hidden_arm(
        tmp_path, "two_link", {"friction": ("elbow", "clear")}, seed=5, runs=1, duration=4.0, nominal_error=0.0
    )
    assert error(problem(data.runs[0], "shoulder")) < 1.5 * NOISE_FLOOR
    assert error(problem(data.runs[0], "elbow")) > 6.0 * NOISE_FLOOR


def test_an_arm_that_is_driven_by_torque_is_replayed_to_its_noise(tmp_path: Path) -> None:
    data, _ = hidden_arm(tmp_path, "two_link", {}, seed=5, runs=1, duration=6.0, nominal_error=0.0, by_torque=True)
    for joint in ("shoulder", "elbow"):
        windows = split(problem(data.runs[0], joint))  # nothing holds it near what was measured for longer
        assert error(windows) < 8.0 * NOISE_FLOOR


def test_a_joint_whose_neighbour_was_not_logged_moves_as_measured(tmp_path: Path) -> None:
    data, _ = hidden_arm(tmp_path, "two_link", {}, seed=5, runs=1, duration=2.0)
    run = data.runs[0]
    del run.joints["elbow"]
    why = not_free(robot(run), "shoulder", [run])
    assert why is not None and "'elbow.position'" in why.sentence


def test_frames_of_the_sidecar_undo_another_zero_and_direction(tmp_path: Path) -> None:
    data, _ = hidden_arm(tmp_path, "two_link", {}, seed=5, runs=1, duration=4.0, nominal_error=0.0)
    run = data.runs[0]
    elbow = run.joints["elbow"]
    assert elbow.goal is not None
    turned = replace(elbow, goal=0.7 - elbow.goal, position=0.7 - elbow.position, velocity=None)
    other = replace(run, joints={**run.joints, "elbow": turned})
    said = replace(other, meta={**run.meta, "frames": {"elbow": {"zero": 0.7, "direction": -1}}})
    for joint in ("shoulder", "elbow"):
        assert error(problem(other, joint)) > 3.0 * NOISE_FLOOR
        assert error(problem(said, joint)) < 1.5 * NOISE_FLOOR


def test_a_frame_that_is_none_is_told_in_a_sentence(tmp_path: Path) -> None:
    data, _ = hidden_arm(tmp_path, "two_link", {}, seed=5, runs=1, duration=2.0)
    with pytest.raises(SealegsError, match="frames is by joint"):
        robot_of(replace(data.runs[0], meta={"frames": {"elbow": {"zero": "left"}}}))


def columns(run: MeasuredRun) -> dict[str, Any]:
    return {name: values for name, values in run.columns().items() if name != "time"} | {"time": run.time}


def test_a_robot_file_that_is_not_there_is_told_in_a_sentence(tmp_path: Path) -> None:
    data, _ = hidden_arm(tmp_path, "two_link", {}, seed=5, runs=1, duration=2.0)
    run = data.runs[0]
    sidecar = {"robot": str(tmp_path / "other.xml"), "actuators": dict(run.actuators)}
    with pytest.raises(SealegsError, match=r"other\.xml, and there is no such file"):
        diagnose(columns(run), sidecar=sidecar)


def test_a_joint_that_the_model_lacks_is_told_with_the_nearest(tmp_path: Path) -> None:
    data, _ = hidden_arm(tmp_path, "two_link", {}, seed=5, runs=1, duration=2.0)
    run = data.runs[0]
    table = {name.replace("elbow", "elbo"): values for name, values in columns(run).items()}
    sidecar = {"robot": run.robot, "actuators": {"shoulder": run.actuators["shoulder"], "elbo": run.actuators["elbow"]}}
    with pytest.raises(SealegsError, match=r"'elbo'.*'elbow'"):
        diagnose(table, sidecar=sidecar, causes=["friction.coulomb"])


@pytest.mark.long
def test_friction_of_the_elbow_is_named_at_the_elbow(tmp_path: Path) -> None:
    data, _ = hidden_arm(tmp_path, "two_link", {"friction": ("elbow", "clear")}, seed=1, runs=2, duration=10.0)
    found = diagnose(data, causes=["friction.coulomb", "friction.viscous", "drive.delay"])
    assert found.joint("shoulder").verdict == "nothing to explain"
    (cause,) = found.joint("elbow").causes
    assert (cause.name, cause.joint) == ("friction.coulomb", "elbow")
    value = cause.parameters["friction.coulomb"]
    assert value.low < 0.172 * 1.05 and value.high > 0.172 * 0.95


@pytest.mark.long
def test_a_fit_to_windows_of_a_joint_driven_by_torque_is_carried_on_to_whole_pieces(tmp_path: Path) -> None:
    data, _ = hidden_arm(tmp_path, "two_link", {}, seed=8, runs=1, duration=6.0, by_torque=True)
    whole = problem(data.runs[0], "shoulder")
    turned = adjustable(whole.models[0])
    found = fit(split(whole).part(FIT_A, FIT_B), turned, evaluations=3)
    again = whole_fit(whole, turned, found)
    fitted = whole.part(FIT_A, FIT_B)
    before, after = (fitted.position_error(fitted.simulate([one.values])[0]) for one in (found, again))
    assert np.mean(after**2) < 0.8 * np.mean(before**2)


@pytest.mark.long
def test_a_next_experiment_of_a_joint_stays_where_the_log_went_and_holds_the_other_joints(tmp_path: Path) -> None:
    data, _ = hidden_arm(tmp_path, "two_link", {}, seed=5, runs=1, duration=3.0)
    run = data.runs[0]
    whole, position = problem(run, "elbow"), run.joints["elbow"].position
    along = held_terms(robot(run), "elbow", [run])
    tuned = tuple(adjustable(whole.models[0]))
    base = fit(whole, [])
    considered = tuple(catalogue(whole.models[0], ["friction.coulomb", "friction.load_dependent"]))
    search = Search(tuned, (), (), np.ones(1), (base, base), considered)
    best = propose(whole, search, blind=True, along=along)
    assert best is not None and "other joints held" in best.sentence
    assert best.goal.min() >= position.min() - 1e-9 and best.goal.max() <= position.max() + 1e-9
    files = write_experiment(best, "elbow", tmp_path, None, robot=run.robot)
    assert read_sidecar(files["experiment"]).robot == run.robot


def test_a_payload_takes_away_no_more_than_the_body_at_the_end(tmp_path: Path) -> None:
    """Payloads far below zero were named, heavier than all that could be missing."""
    data, _ = hidden_arm(tmp_path, "two_link", {}, seed=5, runs=1, duration=2.0, nominal_error=0.0)
    model = problem(data.runs[0], "shoulder").models[0]
    (mass,) = [cause for cause in catalogue(model) if cause.name == "load.mass"]
    (payload,) = [variant[0] for variant in mass.variants if variant[0].path == "load.payload"]
    assert -ARMS["two_link"][-1].mass < payload.low <= 0.0 and payload.high > 1.0
    machine = robot(data.runs[0])
    tip = tip_behind(machine.model, machine.number("shoulder"))
    body = machine.model.body(tip.body).name
    least = bare_model(machine.file, {f"{body}_payload": payload.low})  # the engine takes such a body
    assert least.body(body).mass[0] > 0.0


def test_a_weight_of_no_mass_at_the_end_has_nothing_to_take_away() -> None:
    """A public double pendulum has one; the eigenvalues of its inertia did not converge, and nothing was diagnosed."""
    text = (
        mjcf(ARMS["two_link"])
        .replace("<site", '<body name="weight" pos="0 -0.18 0"><site')
        .replace("</body></body></worldbody>", "</body></body></body></worldbody>")
    )
    model = mujoco.MjModel.from_xml_string(text)
    tip = tip_behind(model, 0)
    assert model.body(tip.body).name == "weight" and model.body_mass[tip.body] == 0.0
    assert least_payload(model, tip) == 0.0


def test_the_delay_of_a_robots_joint_is_known_to_half_a_turn_of_a_servos_loop(tmp_path: Path) -> None:
    """A right machine whose delay was 9 % off was not identifiable; a bench has measured its own."""
    data, _ = hidden_arm(tmp_path, "two_link", {}, seed=5, runs=1, duration=2.0, nominal_error=0.0)
    model = problem(data.runs[0], "shoulder").models[0]
    for joint, seconds in ((model, 5e-4), (replace(model, of_robot=False), 0.06 * 5e-3)):
        (delay,) = [number for number in adjustable(joint) if number.number == "delay.seconds"]
        assert (delay.high - 1.0) * joint.value("delay.seconds") == pytest.approx(seconds)


def test_a_drive_that_nobody_named_is_reported_as_assumed(tmp_path: Path) -> None:
    """Its gains were an invention, and fitted as if somebody had measured them."""
    run = two_link_run(tmp_path, 3.0)
    assert "robot.assumed_drive" not in {
        finding.code for finding in cut_joint(Machine.of([run]), "elbow", None).findings
    }
    del run.actuators["elbow"]
    (said,) = [
        f.sentence for f in cut_joint(Machine.of([run]), "elbow", None).findings if f.code == "robot.assumed_drive"
    ]
    assert "names no actuator for joint 'elbow'" in said and "an ideal servo of" in said and "assumed" in said


def test_a_second_command_that_the_chain_does_not_take_is_reported(tmp_path: Path) -> None:
    """A feed-forward torque beside a goal was left out without a word."""
    run = two_link_run(tmp_path, 3.0)
    log = replace(run.joints["elbow"], torque_command=np.zeros(len(run.time)))
    (as_it_was,), (said,) = with_whole_goals(Machine.of([replace(run, joints={**run.joints, "elbow": log})]))
    assert said.code == "command.unused" and as_it_was.joints["elbow"].goal is log.goal
    assert "elbow.torque_command is not used: the chain of joint 'elbow' does not take it" in said.sentence


# --- joints that press on something ---------------------------------------------------------------------------------


TABLE = -0.05  # [m]
Hidden = dict[str, tuple[str, str | float]]


def dips(time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Goals (k, 6) [rad] of slow motions whose lowest points are some centimetres below the table."""
    rates = np.array([0.05, 0.11, 0.07, 0.17, 0.1, 0.1])
    sizes, middles = np.array([0.4, 0.3, 0.5, 0.4, 0.3, 0.2]), np.array([0.0, 0.3, 0.6, 0.3, 0.0, 0.3])
    return middles + sizes * np.sin(2.0 * np.pi * rates * time[:, None] + rng.uniform(0.0, 2.0 * np.pi, 6))


def arm(folder: Path, hidden: Hidden, seed: int = 4, runs: int = 2, duration: float = 24.0) -> MeasuredSet:
    return hidden_arm(folder, "six_joint", hidden, seed, runs=runs, duration=duration, goals=dips)[0]


def rests(data: MeasuredSet) -> Resting | None:
    return find_resting(robot(data.runs[0]), data.runs)


@pytest.fixture(scope="module")
def pressed(tmp_path_factory: pytest.TempPathFactory) -> MeasuredSet:
    return arm(tmp_path_factory.mktemp("arm"), {"table": ("elbow_flex", TABLE)})


@pytest.mark.long
def test_a_table_is_found_at_its_height_by_the_body_that_touches_it(pressed: MeasuredSet) -> None:
    found = rests(pressed)
    assert found is not None
    assert found.body == "gripper_link"
    assert found.height == pytest.approx(TABLE, abs=0.006)
    assert 0.01 < found.deeper < 0.05
    assert found.joints == ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")


@pytest.mark.long
def test_the_contacts_are_told_and_no_piece_and_no_stop_is_taken_from_them(pressed: MeasuredSet) -> None:
    runs, (finding,) = without_rests(Machine.of(pressed.runs))
    assert finding.code == RESTS
    assert "such as a table" in finding.sentence and "left out at shoulder_pan" in finding.sentence
    for name in ("shoulder_lift", "elbow_flex"):
        for unit in cut(runs, name):
            touched = runs[unit.run].joints[name].touched
            assert touched is not None and not touched[unit.start : unit.stop].any()
            time = runs[unit.run].time[unit.start : unit.stop]
            assert time[-1] - time[unit.judged] >= LEAST_FREE - 0.01
        assert stops_of(runs, name) == ()


@pytest.mark.long
def test_one_wrong_reading_and_a_run_of_a_moment_hide_no_table(pressed: MeasuredSet) -> None:
    """A single reading far below became the lowest height, and a run of one pose ended in a traceback."""
    first, second = pressed.runs
    log = first.joints["elbow_flex"]
    wrong = log.position.copy()
    wrong[1200] += 0.6
    torn = replace(first, joints={**first.joints, "elbow_flex": replace(log, position=wrong)})
    joints = {name: JointLog(log.position[:3], log.position[:3]) for name, log in first.joints.items()}
    moment = MeasuredRun("moment", first.time[:3], joints, robot=first.robot, actuators=first.actuators)
    found = find_resting(robot(first), [torn, second, moment])
    assert found is not None and found.height == pytest.approx(TABLE, abs=0.006)


@pytest.mark.long
def test_contacts_are_kept_where_too_little_would_be_left_and_that_is_said(
    pressed: MeasuredSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(resting, "MIN_JUDGED_SHARE", 0.99)
    runs, (finding,) = without_rests(Machine.of(pressed.runs))
    assert all(log.touched is None for run in runs for log in run.joints.values())
    assert "too little would be left" in finding.sentence


@pytest.mark.long
def test_numbers_that_fail_are_told_and_stop_no_diagnosis(
    pressed: MeasuredSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*given: object) -> None:
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr(resting, "find_resting", fail)
    machine, (finding,) = without_rests(Machine.of(pressed.runs))
    assert (
        list(machine.runs) == list(pressed.runs)
        and "could not be told (LinAlgError: SVD did not converge)" in finding.sentence
    )


@pytest.mark.long
@pytest.mark.skipif(not (DATA / "so101_arm").is_dir(), reason="the public arm's logs are not beside the project")
def test_the_public_arm_presses_on_its_table_in_two_motions(tmp_path: Path) -> None:
    motions = ("friction_gravity", "hold_under_gravity", "single_joint_elbow")
    found = rests(check_log(so101(DATA, tmp_path, motions), lambda text: None)[0])
    assert found is not None
    assert set(found.stretches) == {"run2", "run3"}
    assert "wrist_flex" in found.joints and "gripper" not in found.joints


@pytest.mark.long
@pytest.mark.parametrize(
    "hidden",
    [
        {"friction": ("elbow_flex", 0.3)},
        pytest.param({}, marks=pytest.mark.long),
        pytest.param({"stop": ("elbow_flex", 0.8)}, marks=pytest.mark.long),
        pytest.param({"payload": ("gripper", 0.15)}, marks=pytest.mark.long),
        pytest.param({"weak_motor": ("shoulder_lift", 0.7)}, marks=pytest.mark.long),
        pytest.param({"play": ("elbow_flex", 0.12)}, marks=pytest.mark.long),
        pytest.param({"cable": ("elbow_flex", 0.6)}, marks=pytest.mark.long),
    ],
)
def test_nothing_else_is_taken_for_a_table(tmp_path: Path, hidden: Hidden) -> None:
    assert rests(arm(tmp_path, hidden)) is None


@pytest.mark.long
@pytest.mark.parametrize("friction", [False, True])
def test_behind_a_table_a_joint_is_judged_as_in_clear_air(tmp_path: Path, friction: bool) -> None:
    hidden: Hidden = {"table": ("elbow_flex", TABLE)}
    if friction:
        hidden["friction"] = ("elbow_flex", "clear")
    (found,) = joints_of(arm(tmp_path, hidden, runs=3), only=["elbow_flex"])
    assert any(finding.code == RESTS for finding in found.findings)
    if friction:
        assert found.causes[0].name == "friction.coulomb" and found.causes[0].confidence > 0.6
    else:
        assert found.verdict == NOTHING or not found.causes
        assert found.gap["nominal"].rmse < 3e-3  # 42.6 mrad with the contacts in it
