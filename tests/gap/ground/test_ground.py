"""The ground under hopping legs and walking robots."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import mujoco
import numpy as np
import pytest
from sealegs.actuators import Drivetrain
from sealegs.actuators.chain import load_chain
from sealegs.common.errors import SealegsError
from sealegs.envs.hopper.robot import FOOT, HOPPER
from sealegs.envs.robots import get_robot
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.ground.ground import GROUND, GroundSearch, on_ground, search_ground
from sealegs.gap.ground.leg_ground import (
    COLUMNS,
    LegReplay,
    column_noise,
    columns,
    contact_causes,
    find_stances,
    ground_numbers,
    leg_problem,
    touchdowns,
)
from sealegs.gap.ground.leg_model import CONTACT_DEPTH, GROUND_MASS, IMMOBILE_MASS, LegModel
from sealegs.gap.ground.pieces import ENGINE_STEP
from sealegs.gap.ground.problem import GroundProblem, Laid
from sealegs.gap.ground.tree_ground import lay_robot
from sealegs.gap.ground.tree_model import TreeModel, base_joints, ground_of
from sealegs.gap.ground.tree_replay import TreeReplay
from sealegs.gap.log.parts import FIT_A, FIT_B, TEST
from sealegs.gap.log.types import LogError, MeasuredRun, MeasuredSet
from sealegs.gap.measure.case import Replay
from sealegs.gap.measure.named import NamedCause
from sealegs.gap.output.extension import write_extension
from sealegs.gap.output.files import fresh_folder, write_diagnosis
from sealegs.gap.output.pictures import cause_pictures
from sealegs.gap.search.fit import fit
from sealegs.gap.verdict.decide import refuse
from sealegs.gap.verdict.verdict import NOT_IDENTIFIABLE, NOTHING, JointDiagnosis, Refused

from testbed import hidden_hopper
from testbed.hopper import JOINTS
from testbed.logs import hidden_walker
from testbed.quadruped import model_file
from tests.small_diagnosis import small_hopper

SHORT = 6.0  # [s]


@functools.cache
def recorded(name: str = "", size: str = "clear") -> tuple[MeasuredSet, dict]:
    return hidden_hopper({name: size} if name else {}, 21, runs=2, duration=SHORT)


def leg_of(data: MeasuredSet) -> LegModel:
    run = data.runs[0]
    return LegModel.of(run.robot_params, {joint: load_chain(run.actuators[joint]) for joint in JOINTS})


def problem_of(data: MeasuredSet) -> GroundProblem:
    leg, noise = leg_of(data), column_noise(data.runs)
    return leg_problem(data.runs, leg, find_stances(data.runs, leg, noise), noise)


@pytest.mark.long
def test_whatever_a_stance_shows_is_drawn_as_a_stance_and_written_as_the_whole_leg(tmp_path: Path) -> None:
    data, _ = recorded()
    problem = problem_of(data)
    assert problem.joint is None and problem.picture("response") == "stance"
    channels = problem.simulate([{}])[0]
    assert channels is not None
    simulated = {"nominal": channels, "extended": channels}
    slope = NamedCause("contact.slope", "A sentence.", "ground", 0.5, 0.9, {}, 0.5, "number", "stance")
    found = JointDiagnosis.of(
        joint="ground",
        verdict="explained",
        signal="base.z",
        unit="m",
        causes=(slope,),
        replay=Replay(problem, problem),
        simulated=simulated,
    )
    assert [name for name, _ in cause_pictures(found)] == ["contact.slope"]
    written = write_extension(found, data.runs, tmp_path)
    assert written.keys() == {"leg"} and "<mujoco" in written["leg"].read_text()


@pytest.mark.long
def test_touchdowns_are_found_without_knowing_where_the_ground_is() -> None:
    for name in ("", "contact.slope"):
        data, truth = recorded(name)
        run = data.runs[0]
        pressed = truth["forces"][0][:, 0] > 0.0
        landed = run.time[np.flatnonzero(pressed[1:] & ~pressed[:-1]) + 1]
        found = touchdowns(run, leg_of(data))
        assert len(found) > 6
        assert np.median([np.abs(landed - time).min() for time in found]) < 0.015


@pytest.mark.long
def test_a_stance_starts_in_flight_where_the_leg_truly_is() -> None:
    data, truth = recorded()
    stances = find_stances(data.runs, leg_of(data), column_noise(data.runs))
    for stance in stances:
        assert truth["forces"][stance.run][stance.start, 0] == 0.0
        measured = columns(data.runs[stance.run])[stance.start]
        np.testing.assert_array_less(np.abs(stance.state[:4] - measured), [1e-3, 1e-3, 6e-3, 6e-3])


def test_stances_are_found_where_encoders_were_silent_at_times() -> None:
    data, _ = recorded()
    leg, noise = leg_of(data), column_noise(data.runs)
    runs, random = [], np.random.default_rng(0)
    for run in data.runs:
        lost = random.random((3, len(run.time))) < 0.02

        def blank(values: np.ndarray | None, at: np.ndarray) -> np.ndarray:
            assert values is not None
            return np.where(at, np.nan, values)

        joints = {
            name: replace(log, link_position=blank(log.link_position, lost[k]))
            for k, (name, log) in enumerate(run.joints.items())
        }
        runs.append(replace(run, joints=joints, base={name: blank(v, lost[2]) for name, v in run.base.items()}))
    whole, found = find_stances(data.runs, leg, noise), find_stances(runs, leg, noise)
    assert len(found) > 0.7 * len(whole) and all(np.isfinite(stance.state).all() for stance in found)


def test_the_leg_in_flight_moves_as_the_plant_does() -> None:
    data, _ = recorded()
    leg = leg_of(data)
    stances = find_stances(data.runs, leg, column_noise(data.runs))
    replayer = LegReplay(leg, data.runs, stances)
    errors = [
        (path[0] - columns(data.runs[s.run])[s.start : s.stop])[:9]
        for path, s in zip(replayer.simulate([leg], range(len(stances))), stances, strict=True)
    ]
    assert (np.abs(np.mean(errors, axis=(0, 1))) < [1e-4, 1e-4, 1.5e-3, 1.5e-3]).all()


@pytest.mark.long
def test_a_ground_as_believed_leaves_no_more_than_the_noise() -> None:
    problem = problem_of(recorded()[0])
    found = fit(problem, ground_numbers(leg_of(recorded()[0])))
    rest = problem.left_over(found.simulated)
    assert rest is not None and rest < 0.1


@pytest.mark.parametrize(
    ("name", "path", "truth", "near"),
    [
        pytest.param("contact.friction", "contact.friction*", 0.3, 0.03, marks=pytest.mark.long),
        pytest.param("contact.slope", "contact.slope", 0.07, 0.006, marks=pytest.mark.long),
        pytest.param("contact.stiffness", "contact.stiffness", 1500.0, 100.0, marks=pytest.mark.long),
    ],
)
def test_the_number_of_the_ground_is_recovered(name: str, path: str, truth: float, near: float) -> None:
    problem = problem_of(recorded(name)[0])
    cause = next(cause for cause in contact_causes(leg_of(recorded()[0])) if cause.name == name)
    fits = [
        fit(problem, [*ground_numbers(leg_of(recorded()[0])), *variant], evaluations=8) for variant in cause.variants
    ]
    best = min(fits, key=lambda found: found.cost)
    assert best.values[path] == pytest.approx(truth, abs=near)
    assert best.cost < 0.6 * fit(problem, ground_numbers(leg_of(recorded()[0]))).cost


def test_every_number_of_the_ground_that_a_fit_may_turn_has_value_and_unit() -> None:
    nominal = leg_of(recorded()[0])
    parameters = [p for cause in contact_causes(nominal) for variant in cause.variants for p in variant]
    for parameter in [*parameters, *ground_numbers(nominal)]:
        path = parameter.number
        assert np.isfinite(nominal.value(path))
        assert parameter.path.endswith("*") or nominal.unit(path) == parameter.unit
    assert nominal.unit("contact.friction") == "1"


def test_causes_of_the_ground_say_themselves_how_large_and_in_which_column_they_show() -> None:
    for cause in contact_causes(leg_of(recorded()[0])):
        assert cause.against in COLUMNS
        assert set(cause.plausible) <= {p.path for p in cause.variants[0]}
        assert cause.plausible, cause.name


@pytest.mark.parametrize("time", [0.002, 0.006])
def test_ground_beyond_a_stiffness_counts_as_rigid(time: float) -> None:
    leg = leg_of(recorded()[0]).with_fitted({"contact.time": time})
    assert leg.compliance()[2] == IMMOBILE_MASS
    most = leg.softest_rigid()
    assert leg.with_fitted({"contact.stiffness": 1.01 * most}).compliance()[2] == IMMOBILE_MASS
    stiffness, damping, mass = leg.with_fitted({"contact.stiffness": 0.99 * most, "contact.damping": 7.0}).compliance()
    assert (damping, mass) == (7.0, GROUND_MASS)
    assert 1.0 / stiffness + 1.0 / leg.engine_stiffness() == pytest.approx(1.0 / (0.99 * most))


@pytest.mark.parametrize("time", [0.002, 0.006])
def test_rigid_ground_is_as_hard_as_the_floor_of_the_robot(time: float) -> None:
    """Force over depth of the contact, as the engine has it, on the robot's own floor and on the ground of a log."""
    leg = LegModel.of({"contact_time": time}, leg_of(recorded()[0]).chains)
    floor = Drivetrain(HOPPER.build_spec(leg.params), dict(leg.chains), HOPPER.coordinates)
    for model in (leg.drivetrain().model, floor.model):
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        height = data.geom_xpos[model.geom(FOOT).id, 2] - leg.params["foot_radius"]
        data.qpos[model.joint("base_z").qposadr[0]] -= height + CONTACT_DEPTH
        mujoco.mj_forward(model, data)
        assert data.contact.dist[0] == pytest.approx(-CONTACT_DEPTH, rel=1e-3)
        row = int(data.contact.efc_address[0])
        stiffness, _, impedance, _ = data.efc_KBIP[row]
        # a pyramid's four edges share the load; each is regularised for the friction beside it
        share = 1.0 if model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC else 4.0
        assert share * stiffness * impedance / data.efc_R[row] == pytest.approx(leg.engine_stiffness(), rel=0.05)


@pytest.mark.weekly
def test_a_slope_is_named_beside_play_in_the_belt() -> None:
    (_, _, ground), _ = small_hopper()
    assert ground.joint == GROUND
    assert [cause.name for cause in ground.causes] == ["contact.slope"], ground.sentence
    slope = ground.causes[0].parameters["contact.slope"]
    assert slope.low <= 0.07 <= slope.high


@pytest.mark.long
def test_stances_of_a_test_group_are_the_test_part_and_no_others() -> None:
    data, _ = recorded()
    leg, noise = leg_of(data), column_noise(data.runs)
    stances = find_stances(data.runs, leg, noise)
    kept = data.runs[1]
    problem = leg_problem(data.runs, leg, stances, noise, kept.name)
    assert {unit.run for unit in problem.units if unit.part == TEST} == {1}
    assert {unit.part for unit in problem.units if unit.run == 0} == {FIT_A, FIT_B}
    with pytest.raises(LogError, match="there is no group 'other' to test on"):
        leg_problem(data.runs, leg, stances, noise, "other")


def test_a_diagnosis_tells_the_ground_which_group_to_keep(monkeypatch: pytest.MonkeyPatch) -> None:
    data, _ = recorded()
    told: dict[str, object] = {}

    def ground(*arguments: object, **named: object) -> str:
        told.update(named)
        return "there is no ground."

    monkeypatch.setattr("sealegs.gap.finder.diagnosis.search_ground", ground)
    monkeypatch.setattr(
        "sealegs.gap.finder.diagnosis.diagnose_joint",
        lambda runs, joint, *others: refuse(joint, Refused(f"'{joint}'", "it was left out.", usable=True)),
    )
    *_, found = diagnose(data, data.runs[1].name)
    assert told["test_group"] == data.runs[1].name
    assert (found.joint, found.verdict, found.signal, found.unit) == (GROUND, NOT_IDENTIFIABLE, "base.z", "m")
    assert found.sentence == "Nothing can be said about the ground: there is no ground."


def test_a_group_with_too_few_stances_to_test_on_is_named() -> None:
    data, _ = recorded()
    still = standing(data.runs[1])
    found = search_ground([data.runs[0], still], {}, 0, lambda text: None, still.name)
    assert isinstance(found, str) and f"0 are in the group '{still.name}'" in found


def without_links(run: MeasuredRun) -> MeasuredRun:
    return replace(run, joints={name: replace(log, link_position=None) for name, log in run.joints.items()})


def without_base(run: MeasuredRun) -> MeasuredRun:
    return replace(run, base={})


def standing(run: MeasuredRun) -> MeasuredRun:
    return replace(run, base={**run.base, "z": np.full(len(run.time), 0.17)})


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (without_links, "record hip.link_position and knee.link_position"),
        (without_base, "record it as base.z"),
        (standing, "let it hop for longer"),
    ],
)
def test_a_log_that_shows_no_stances_says_what_to_record(
    change: Callable[[MeasuredRun], MeasuredRun], said: str
) -> None:
    found = search_ground([change(run) for run in recorded()[0].runs], {}, 0, lambda text: None)
    assert isinstance(found, str) and said in found


@pytest.mark.long
def test_files_hold_joints_and_ground_and_the_extended_leg_loads(tmp_path: Path) -> None:
    import mujoco

    found, data = small_hopper()
    written = write_diagnosis(found, data, fresh_folder(tmp_path / "out"))
    html = written["report"].read_text(encoding="utf-8")
    assert "The ground" in html
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "ground-extended.xml"))
    assert model.body("ground").quat[2] != 0.0
    assert {"hip chain", "knee chain", "ground leg", "json", "report", "pictures"} <= written.keys()
    assert all(path.exists() for path in written.values())
    pictures = {path.name for path in written["pictures"].iterdir()}
    assert {"ground.contact.slope.png", "knee.transmission.backlash.png"} <= pictures


# --- walking robots ---------------------------------------------------------------------------------------------------


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
