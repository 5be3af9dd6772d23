"""What the ground is like is found from the stances of a legged log, and not invented where it is as believed."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from sealegs.actuators import Drivetrain
from sealegs.actuators.chain import load_chain
from sealegs.envs.hopper.robot import FOOT, HOPPER
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.ground.ground import GROUND, search_ground
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
from sealegs.gap.ground.problem import GroundProblem
from sealegs.gap.log.parts import FIT_A, FIT_B, TEST
from sealegs.gap.log.types import LogError, MeasuredRun, MeasuredSet
from sealegs.gap.measure.case import Replay
from sealegs.gap.measure.named import NamedCause
from sealegs.gap.output.extension import write_extension
from sealegs.gap.output.files import fresh_folder, write_diagnosis
from sealegs.gap.output.pictures import cause_pictures
from sealegs.gap.search.fit import fit
from sealegs.gap.verdict.decide import refuse
from sealegs.gap.verdict.verdict import NOT_IDENTIFIABLE, JointDiagnosis, Refused

from testbed import hidden_hopper
from testbed.hopper import JOINTS
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
        sentence="",
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
