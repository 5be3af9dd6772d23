"""The flexible-joint arm of paper 002: its tables, its joints, and its environment."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from sealegs.actuators import DrivenCoordinate, Drivetrain
from sealegs.common.errors import SealegsError
from sealegs.envs.arm.env import ArmTask
from sealegs.envs.arm.kinematics import chain, jacobian, joints, tool
from sealegs.envs.arm.parameters import rotors_at_rest, without_rotors
from sealegs.envs.arm.robot import ARM, LINKS, ROTORS
from sealegs.envs.arm.tables import DAMPING, FINAL, FLEXIBLE, JOINTS, SIMPLE, STIFFNESS
from sealegs.envs.arm.trajectory import Line
from sealegs.envs.engine.batch import BatchEngine
from sealegs.papers.arm.axes import (
    HINGES,
    SIDES,
    SIMPLE_HINGES,
    TABLE_I,
    beside_table_one,
    gap,
    printed_axes,
    simple_axes,
)
from sealegs.papers.arm.choices import CHOICES, OPPOSITE
from sealegs.papers.arm.control import Robust, closed_loop
from sealegs.papers.arm.dynamics import (
    FINAL_MODEL,
    PERFECT,
    Joints,
    ideal_torques,
    model_of,
    open_loop,
    rotor_inertia,
    spinning_torques,
)
from sealegs.papers.arm.paper import mark
from sealegs.papers.arm.readings import PLAIN, fall, gear_ratio, late_rise, outcome, readings, referred
from sealegs.papers.arm.rows import _counted, _ranged, extent, kinematic_rows, start_rows, stiffness_rows

# --- tables and kinematics -------------------------------------------------------------------------------------------


def test_tables_one_and_four_come_out_and_what_was_chosen_for_them_is_marked_fitted() -> None:
    rows = [*kinematic_rows(), *stiffness_rows()]
    missed = [row.name for row in rows if not row.holds]
    assert missed == [
        *(
            f"gear {number}: {what}"
            for number in (1, 2)
            for what in ("I with the printed width", "k of the text's cantilever")
        ),
        *(f"gear {number}: k of the text's cantilever" for number in (3, 4)),
        "shaft: k with the text's G",
    ]
    assert all(bool(row.rests) is (row.mark == "fitted") for row in rows)


def test_tables_nine_eleven_and_twelve_close_and_lean_against_table_one() -> None:
    assert max(gap(hinge, FLEXIBLE) for hinge in HINGES) < 5e-5
    lean, beside = beside_table_one(printed_axes())
    assert lean == pytest.approx(0.98, abs=0.01) and beside == pytest.approx(10.2, abs=0.1)
    assert [1e3 * gap(hinge, SIMPLE) for hinge in SIMPLE_HINGES] == pytest.approx([0.0, 7.0, 10.1], abs=0.1)


def test_the_tool_on_axes_is_that_of_table_one_and_of_the_engine() -> None:
    angles = np.random.default_rng(0).uniform(-1.0, 1.0, (5, 3))
    assert TABLE_I.place(angles) == pytest.approx(tool(angles), abs=1e-12)
    for axes in (printed_axes(), *(simple_axes(side) for side in SIDES)):
        model = model_of(PERFECT, axes=axes)
        data = mujoco.MjData(model)
        for row in angles:
            data.qpos[:] = row
            mujoco.mj_kinematics(model, data)
            assert axes.place(row) == pytest.approx(data.site("tool").xpos, abs=1e-12)


def test_the_tool_is_where_the_three_steps_of_table_one_put_it_and_joints_follow_from_it() -> None:
    rng = np.random.default_rng(0)
    for angles in rng.uniform((-3.0, -1.0, 0.1), (3.0, 1.0, 2.5), (10, 3)):
        assert tool(angles) == pytest.approx(chain(angles)[:3, 3], abs=1e-12)
        assert joints(tool(angles)) == pytest.approx(angles, abs=1e-9)
        steps = 1e-6 * np.eye(3)
        numeric = np.stack([(tool(angles + step) - tool(angles - step)) / 2e-6 for step in steps], axis=-1)
        assert jacobian(angles) == pytest.approx(numeric, abs=1e-8)


def test_the_model_has_its_tool_where_table_one_says() -> None:
    model = ARM.build_spec().compile()
    data = mujoco.MjData(model)
    data.qpos[:] = np.deg2rad(FINAL)
    mujoco.mj_forward(model, data)
    assert data.site("tool").xpos == pytest.approx([-0.0333, -0.3720, 0.8177], abs=5e-5)


def test_a_quintic_way_from_the_stretched_arm_has_no_bound_of_acceleration_and_a_septic_one_has() -> None:
    times = np.array([1e-2, 1e-4, 1e-6])
    quintic, septic = (np.abs(Line(way=way).joints(times)[2][:, 2]) for way in ("quintic", "septic"))
    assert quintic[1] > 9.0 * quintic[0] and quintic[2] > 9.0 * quintic[1]
    assert septic.max() < 1.4


def test_the_line_is_straight_and_its_speeds_are_its_derivatives() -> None:
    line, times = Line(), np.linspace(0.3, 4.7, 2001)
    place, speed, acceleration = line.joints(times)
    assert tool(place) == pytest.approx(line.tool(times), abs=1e-7)
    assert np.gradient(place, times, axis=0)[1:-1] == pytest.approx(speed[1:-1], abs=1e-4)
    assert np.gradient(speed, times, axis=0)[1:-1] == pytest.approx(acceleration[1:-1], abs=1e-4)


# --- rotors and joints -----------------------------------------------------------------------------------------------


def test_a_rotor_turns_with_its_link_until_a_spring_lies_between_and_nothing_is_lost() -> None:
    stiff, elastic = model_of(PERFECT), model_of(FINAL_MODEL)
    assert stiff.nv == 3 and elastic.nv == 6
    assert sum(stiff.body_mass) == pytest.approx(sum(elastic.body_mass))
    for k, rotor in enumerate(ROTORS):
        assert stiff.body(stiff.body(rotor).parentid[0]).name == LINKS[k]
        assert elastic.body(elastic.body(rotor).parentid[0]).name == ("stand", *LINKS)[k]
    angles = np.array([0.4, 0.3, 0.9])
    found = []
    for model in (stiff, elastic):
        data, matrix = mujoco.MjData(model), np.empty((model.nv, model.nv))
        together = np.zeros((model.nv, 3))
        for k, name in enumerate(JOINTS):
            for joint in (name, f"{name}_motor")[: model.nv // 3]:
                data.qpos[model.joint(joint).qposadr[0]] = angles[k]
                together[model.joint(joint).dofadr[0], k] = 1.0
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, matrix)
        found.append(together.T @ matrix @ together)
    assert found[0] == pytest.approx(found[1], abs=1e-12)


def test_a_rotor_that_is_no_part_of_its_link_is_refused() -> None:
    chains = {"joint1": [{"torque_command": {"armature": 1e-4}}]}
    wrong = DrivenCoordinate("joint1", (("joint1", 1.0),), motor_body="stand", rotor="rotor2")
    with pytest.raises(SealegsError, match="'rotor2' must be a child of the body of joint 'joint1'"):
        Drivetrain(ARM.build_spec(), chains, [wrong])
    missing = DrivenCoordinate("joint1", (("joint1", 1.0),), motor_body="stand", rotor="roter1")
    with pytest.raises(SealegsError, match="did you mean 'rotor1'"):
        Drivetrain(ARM.build_spec(), chains, [missing])


def test_the_ideal_arm_follows_its_own_torques_and_dampers_lead_it_away() -> None:
    perfect, damped, third = open_loop([PERFECT, Joints(DAMPING), Joints((0.0, 0.0, 1e-3))])
    assert perfect.largest < 1e-2
    assert 2.0 < damped.largest < 2.6
    assert third.largest > 100.0


def test_what_turns_the_rotors_with_the_links_matters_as_much_in_slow_motions() -> None:
    lines = [Line(), Line(seconds=10.0)]
    quick, slow = (open_loop([PERFECT], line, torques=spinning_torques(line))[0].largest for line in lines)
    assert quick == pytest.approx(2.30, abs=0.01) and slow == pytest.approx(quick, rel=0.01)


def test_springs_of_table_ten_hardly_move_the_tool_and_soft_ones_do() -> None:
    printed, soft = open_loop([Joints(link_stiffness=STIFFNESS), Joints(link_stiffness=(1.0, 1.0, 1.0))])
    assert printed.largest < 0.01 < 0.5 < soft.largest


def test_torques_of_the_other_table_turn_the_tools_rise_into_a_fall() -> None:
    found = open_loop([PERFECT], torques=ideal_torques(Line(), without_rotors()))[0]
    rise, wanted = late_rise(found)
    assert rise < -10.0 < 10.0 < wanted


def test_motor_referred_damping_of_joint_1_alone_makes_z_fall_where_perfect_joints_let_it_rise() -> None:
    assert gear_ratio() ** 2 == pytest.approx(361.0, abs=0.5)
    assert referred(1) == pytest.approx((361.0 * DAMPING[0], *DAMPING[1:]), rel=1e-3)
    found = outcome(readings()["motor 1"])
    assert found.motion.largest == pytest.approx(222.0, abs=1.0) and found.order == "c_r1 > c_r3 > c_r2"
    assert late_rise(found.motion)[0] == pytest.approx(-21.0, abs=1.0)
    assert found.opposite and fall(found.perfect)[0] < 0.01


@pytest.mark.long
def test_each_of_three_readings_makes_z_fall_and_all_at_once_do_not() -> None:
    falls = {name: outcome(reading).opposite for name, reading in readings().items()}
    opposite = {name for name, value in falls.items() if value}
    assert opposite == {"motor 1", "motor", "axes", "torques", "axes, motor", "simple"}


def test_a_statement_that_holds_in_part_of_its_range_is_missed() -> None:
    found = [_ranged("c_r", "5.2", "lower", holds, (1.0, 2.0), ()).holds for holds in ([True, True], [True, False])]
    assert found == [True, False]


@pytest.mark.parametrize(("held", "agrees"), [([True, True], True), ([True, False], None), ([False, False], False)])
def test_a_statement_whose_values_are_not_printed_is_judged_only_where_all_agree_or_none(
    held: list[bool], agrees: bool | None
) -> None:
    row = _counted("c_r", "5.2", "lower", {0.1: held, 1.0: held}, ())
    assert row.holds is agrees and f"beside 0.1 with {sum(held)} of 2" in str(row.ours)


def test_joints_that_do_not_start_at_rest_are_a_miss() -> None:
    assert {row.name: row.holds for row in start_rows()}[
        "all velocities and accelerations start and end at rest"
    ] is False


def test_readings_that_were_sought_are_chosen_numbers_of_the_row_that_they_reach() -> None:
    sought = CHOICES["readings"]
    assert sought.reach == (OPPOSITE,) and readings()[PLAIN].text not in sought.value
    assert all(reading.text in sought.value for name, reading in readings().items() if name != PLAIN)


def test_rotors_at_rest_are_parts_of_the_links_before_and_only_their_spin_is_counted() -> None:
    whole, lumped = model_of(PERFECT), model_of(PERFECT, rotors_at_rest())
    assert sum(lumped.body_mass) == pytest.approx(sum(whole.body_mass) - FLEXIBLE["rotor1"].mass, abs=1e-6)
    data, places = [mujoco.MjData(model) for model in (whole, lumped)], np.array([0.4, 0.3, 0.9])
    matrices = [np.empty((3, 3)) for _ in data]
    for model, item, matrix in zip((whole, lumped), data, matrices, strict=True):
        item.qpos[:] = places
        mujoco.mj_forward(model, item)
        mujoco.mj_fullM(model, item, matrix)
    spin = np.diag([rotor_inertia(k) for k in range(3)])
    assert np.diag(matrices[0]) == pytest.approx(np.diag(matrices[1] + spin), rel=0.01)
    assert abs(matrices[0] - matrices[1] - spin).max() > 1e-6  # what turns them with the links before


def test_a_statement_that_holds_for_some_values_is_told_as_their_range() -> None:
    values = (1.0, 2.0, 3.0, 4.0)
    assert extent([True, True, False, True], values) == "1 to 2, 4 (3 of 4)"
    assert extent([True] * 4, values) == "everywhere from 1 to 4"
    assert extent([False] * 4, values) == "nowhere from 1 to 4"


@pytest.mark.long
def test_the_robust_controller_holds_the_tool_whatever_is_wrong_with_the_model() -> None:
    for joints_, params, believed in (
        (FINAL_MODEL, None, None),
        (FINAL_MODEL, {"payload_mass": 0.1}, None),
        (FINAL_MODEL, None, without_rotors()),
    ):
        assert closed_loop(Robust(), joints_, params, believed).largest < 0.2


def test_a_mark_is_found_between_two_values() -> None:
    values = np.array([1.0, 10.0, 100.0])
    assert mark(values, values, 30.0) == pytest.approx(30.0)
    assert np.isnan(mark(values, values, 1e3))


# --- the environment -------------------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("word", ["srlfj", "ideal", "regression", "net"])
def test_the_reference_leads_the_tool_with_each_actuator_model(word: str) -> None:
    engine = BatchEngine(ArmTask(), 2, actuator=word, control_rate=100.0, autoreset=False)
    engine.seed(0)
    engine.reset()
    for _ in range(300):
        step = engine.step(np.zeros((2, 3)))
    assert not step.terminated.any() and not step.flags["unstable"].any()
    assert (step.reward > 0.5).all()
