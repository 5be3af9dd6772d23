"""The biped's paper (paper 003): identification recovers what is planted, and the controller hops."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from sealegs.envs.biped.drive import DRIVES, PULLEYS, RATIO, SHAPE
from sealegs.envs.biped.robot import BIPED
from sealegs.papers.biped import paper, paper_plots, rig, tables, validation
from sealegs.papers.biped.controller import PERIOD, Gait, HoppingController, Phase
from sealegs.papers.biped.ground import land
from sealegs.papers.biped.hopping import Hopping, HoppingExperiment, hop_times, rigid_cables
from sealegs.papers.biped.identification import (
    IdentificationError,
    Load,
    Record,
    bias_by_arx,
    chirp,
    fit_cable,
    fit_leg,
    fit_motor,
    fit_pulleys,
    fit_spring,
)
from sealegs.papers.biped.legs_together import LegLoad, Together, fit_both
from sealegs.papers.biped.return_map import Healing
from sealegs.papers.biped.rig import leg_load, leg_record

from testbed import biped_drive as plant

IMPACT, ENERGY = validation.Impact(1.0, 2.0), validation.Energy(4.0, 16.0)
MOTOR = {"constant": 1.21, "inertia": 1.05e-3, "friction": 8e-3, "bias": -0.06}


def recorded(command: np.ndarray, place: np.ndarray) -> Record:
    return Record(1e-3 * np.arange(len(command)), command, place)


# --- identification, against a plant of its own ----------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize(("constant", "factor", "bias"), [(1.21, 0.85, -0.06), (0.93, 1.1, 0.03)])
def test_motor_constant_inertia_factor_friction_and_bias_are_recovered(
    constant: float, factor: float, bias: float
) -> None:
    rng, rotor, pulleys, frictions = np.random.default_rng(1), 9e-4, (2e-5, 2.2e-4, 2.6e-4), (5e-3, 7e-3, 8e-3)
    command = chirp((0.15, 1.5), cycles=2, steps=10)
    found = []
    for extra, friction in zip(pulleys, frictions, strict=True):
        machine = plant.pulleys(constant, factor * rotor + extra, friction, bias)
        place = plant.encoder(plant.log(command, machine, [0.0])[:, 0], 2048, rng)
        found.append(fit_pulleys(recorded(command, place)))
        assert found[-1].bias == pytest.approx(bias, rel=0.05)
        assert found[-1].friction == pytest.approx(constant * friction, rel=0.1)
    motor = fit_motor([item.inertia for item in found], pulleys, rotor)
    assert motor.constant == pytest.approx(constant, rel=0.05)
    assert motor.factor == pytest.approx(factor, rel=0.05)


@pytest.mark.long
def test_friction_and_bias_with_the_leg_on_are_recovered() -> None:
    rng, ratio = np.random.default_rng(2), 31.42
    links = {"thigh": (3.3, 0.2, 0.07), "shin": (1.5, 0.16, 0.05)}
    sine = 9.81 * (3.3 * 0.2 + 1.5 * 0.5 + 1.5 * 0.16)
    inertia = 3.3 * 0.04 + 0.07 + 1.5 * (0.25 + 0.16**2) + 0.05
    load = Load(inertia, -2.0 * 1.5 * 0.5 * 0.16, sine, 0.0)
    start = 0.5
    held = MOTOR["constant"] * sine * math.sin(start) / ratio
    command = held + chirp((0.3, 2.5), (0.5, 3.0), 6, 2)
    motion = plant.log(command, plant.bending_leg(MOTOR, links, ratio), [start * ratio])[:, 0]
    assert 0.1 < np.ptp(motion) / ratio < 1.5
    record = recorded(command, plant.encoder(motion, 2048, rng))
    leg = fit_leg(record, load, ratio, MOTOR["constant"], MOTOR["inertia"])
    assert leg.friction == pytest.approx(MOTOR["friction"], rel=0.1)
    assert leg.bias == pytest.approx(MOTOR["bias"], rel=0.1)


@pytest.mark.parametrize("cable", [(2.96, 0.04), (3.8, 0.36)])
def test_cable_stiffness_and_damping_are_recovered_under_load(cable: tuple[float, float]) -> None:
    rng = np.random.default_rng(3)
    command = (
        4.0 * np.sign(np.sin(2.0 * np.pi * 1.3 * 1e-3 * np.arange(8000))) + chirp((3.0, 6.0), (1.0, 8.0), 4, 4)[:1]
    )
    motion = plant.log(command, plant.stretching_cable(MOTOR, cable, (6e-3, 3.0)), [0.0, 0.0])
    motor, load = (plant.encoder(motion[:, k], ticks, rng) for k, ticks in ((0, 2048), (1, 4096)))
    found = fit_cable(
        recorded(command, motor),
        motor - load,
        MOTOR["constant"],
        MOTOR["inertia"],
        MOTOR["friction"],
        MOTOR["bias"],
    )
    assert (found.stiffness, found.damping) == pytest.approx(cable, rel=0.1)


def test_spring_stiffness_is_the_slope_of_the_postures() -> None:
    rng = np.random.default_rng(4)
    shape = np.radians(np.linspace(10.0, 30.0, 9))
    weight = 600.0 + rng.normal(0.0, 1.0, 9)
    deflection = plant.encoder((600.0 * np.sin(shape) / 5.18 - 2.2) / 115.1, 2048, rng)
    found = fit_spring(weight, shape, deflection, 5.18)
    assert found.stiffness == pytest.approx(115.1, rel=0.03)
    assert found.offset == pytest.approx(2.2, abs=1.0)


@pytest.mark.long
def test_the_scale_is_read_once_the_robot_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rig, "POSTURES", rig.POSTURES[-1:])
    found = []
    for seconds in (rig.STANDS, 2.0 * rig.STANDS):
        monkeypatch.setattr(rig, "STANDS", seconds)
        found.append(rig.spring_postures("left", np.random.default_rng(1))[2])
    assert found[0] == pytest.approx(found[1], rel=0.01)


def test_the_bias_of_an_amplifier_is_what_drifts_under_a_sine_without_a_mean() -> None:
    machine = plant.pulleys(MOTOR["constant"], MOTOR["inertia"], MOTOR["friction"], MOTOR["bias"])
    command = 0.3 * np.sin(2.0 * np.pi * 1e-3 * np.arange(6000))
    place = plant.encoder(plant.log(command, machine, [0.0])[:, 0], 2048, np.random.default_rng(2))
    assert bias_by_arx(recorded(command, place)) == pytest.approx(MOTOR["bias"], abs=1e-3)
    with pytest.raises(IdentificationError, match="too short for speeds over 2 s"):
        bias_by_arx(recorded(command, place), 2.0)


@pytest.mark.long
def test_both_coordinates_of_a_leg_follow_the_equations_of_the_engine() -> None:
    spec = mujoco.MjSpec.from_string(
        """<mujoco><compiler angle="radian"/><option timestep="0.0005" gravity="0 0 -9.81"/><worldbody>
        <body><joint name="thigh" axis="0 1 0"/>
        <inertial pos="0.01 0 -0.2" mass="3" diaginertia="0.08 0.08 0.01"/>
        <body pos="0 0 -0.5"><joint name="knee" axis="0 1 0"/>
        <inertial pos="0.002 0 -0.16" mass="1.5" diaginertia="0.05 0.05 0.01"/></body></body>
        </worldbody></mujoco>"""
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = -0.5, 1.0  # about y, forward is negative: leg angle 0, leg shape 0.5
    places = np.empty((800, 2))
    for k in range(len(places)):
        thigh, shin = -data.qpos[0], -data.qpos[0] - data.qpos[1]
        places[k] = 0.5 * (thigh + shin), 0.5 * (thigh - shin)
        mujoco.mj_step(model, data, 2)
    thigh = 0.08 + 3.0 * (0.2**2 + 0.01**2) + 1.5 * 0.5**2
    shin = 0.05 + 1.5 * (0.16**2 + 0.002**2)
    load = LegLoad(thigh, shin, 1.5 * 0.5 * 0.16, 0.0, (3.0 * 0.2 + 1.5 * 0.5, 3.0 * 0.01), (1.5 * 0.16, 1.5 * 0.002))
    records = [recorded(np.full(len(places), 0.03), places[:, k]) for k in range(2)]
    found = fit_both(records, load, [1.0, 1.0], [1.0, 1.0], [0.0, 0.0], [0.0, 0.0], [0.5, 0.5])
    assert found.bias == pytest.approx((-0.03, -0.03), abs=0.02) and max(found.residual) < 2e-3
    assert min(found.unadjusted) > 10.0 * max(found.residual)


def test_the_chirp_grows_in_magnitude_and_frequency() -> None:
    command = chirp((0.2, 2.0), (0.5, 50.0), 17, 10)
    assert np.abs(command[:20_000]).max() == pytest.approx(0.2, rel=1e-3)
    assert np.abs(command[-200:]).max() == pytest.approx(2.0, rel=0.02)
    crossings = np.flatnonzero(np.diff(np.sign(command[-200:])) != 0)
    assert len(crossings) == pytest.approx(2 * 50 * 0.2, abs=2)


def test_logs_that_a_stage_cannot_use_are_refused_in_one_sentence() -> None:
    time, still = 1e-3 * np.arange(500), np.zeros(500)
    wave = np.sin(10.0 * time)
    cases = [
        (lambda: fit_pulleys(Record(time[:50], wave[:50], wave[:50])), "a record of 50 samples"),
        (lambda: fit_pulleys(Record(time**2, wave, wave)), "evenly spaced"),
        (lambda: fit_pulleys(Record(time, wave, still)), "moved by fewer than 20 steps"),
        (lambda: fit_pulleys(Record(time, wave, 3e-3 * np.round(np.sin(10.0 * time) * 500.0))), "against its commands"),
        (lambda: fit_motor([1e-3], [1e-4], 9e-4), "at least two combinations"),
        (lambda: fit_motor([2e-3, 1e-3], [1e-4, 3e-4], 9e-4), "do not grow with the pulleys"),
        (lambda: fit_spring(np.ones(3), np.ones(3), np.ones(3), 5.18), "not loaded differently"),
        (lambda: fit_cable(Record(time, wave, wave), still, 1.0, 1e-3, 0.0, 0.0), "hardly stretches"),
    ]
    for call, words in cases:
        with pytest.raises(IdentificationError, match=words):
            call()


@pytest.mark.long
def test_the_virtual_machine_is_recovered_from_its_own_logs(hopping: Hopping) -> None:
    name = "left_leg_shape"
    drive, found = DRIVES[name], paper.identify(name, hopping)
    assert found.motor.constant == pytest.approx(drive.motor_constant, rel=0.05)
    assert found.motor.factor == pytest.approx(drive.inertia_factor, rel=0.05)
    assert found.leg.friction == pytest.approx(drive.leg_friction, rel=0.1)
    assert found.cable.stiffness == pytest.approx(drive.cable_stiffness, rel=0.1)
    assert found.cable.damping == pytest.approx(drive.cable_damping, rel=0.1)


@pytest.mark.long
@pytest.mark.parametrize("name", DRIVES)
def test_friction_of_every_leg_is_recovered_where_cables_stretch(name: str) -> None:
    drive, rng = DRIVES[name], np.random.default_rng(5)
    inertia = drive.inertia_factor * drive.rotor_inertia + PULLEYS[drive.kind][2]
    load = leg_load(BIPED.parameters(), drive.kind)
    leg = fit_leg(leg_record(name, rng), load, drive.ratio, drive.motor_constant, inertia)
    assert leg.friction == pytest.approx(drive.leg_friction, rel=0.02)


def test_pulley_inertias_follow_from_the_printed_tables_and_grow() -> None:
    for kind, values in PULLEYS.items():
        assert 0.0 < values[0] < values[1] < values[2], kind


# --- hopping ----------------------------------------------------------------------------------------------------


def test_a_pulley_of_table_three_is_below_zero_on_one_side_and_its_mean_hides_it() -> None:
    sides = [tables.pulley_inertia(f"{side}_leg_shape", 0) for side in ("left", "right")]
    assert sides[0] > 0.0 > sides[1] and np.mean(sides) == pytest.approx(PULLEYS[SHAPE][0]) and PULLEYS[SHAPE][0] > 0.0


def test_a_deviation_that_grows_or_ends_in_a_fall_is_no_stable_hop() -> None:
    heals, grows = (Healing(np.full((2, 10), size)) for size in (1e-4, 4e-3))
    falls = Healing(np.full((2, 10), np.nan))
    assert heals.multiplier == pytest.approx(0.1**0.1) and not heals.fell
    assert grows.multiplier > 1.0 and falls.fell and math.isinf(falls.multiplier)
    stable, unstable = validation.heal_rows((heals, falls), {"lean 4 deg": (heals, heals)})
    assert stable.holds and unstable.holds and unstable.ours == "falls"
    assert [item.ours for item in unstable.sensitivity] == ["0.10 mrad, 0.79 times a hop"]
    assert not validation.heal_rows((grows, heals), {})[0].holds


def test_rows_of_both_coordinates_at_once_judge_bias_and_motion() -> None:
    printed = [DRIVES[f"left_leg_{kind}"].leg_bias for kind in ("angle", "shape")]
    good = Together((printed[0], printed[1]), (0.01, 0.003), (0.36, 0.16), (0.08, 0.27))
    stiff = {"left": good.bias}
    assert all(row.holds for row in validation.leg_rows({"left": good}, stiff))
    bad = replace(good, bias=(printed[0] + 0.02, printed[1]), residual=(0.2, 0.003))
    assert [row.holds for row in validation.leg_rows({"left": bad}, stiff)] == [False, False, True, True, True]
    turned = replace(good, bias=(printed[0], -0.2 * printed[1]))
    assert [row.holds for row in validation.leg_rows({"left": turned}, stiff)][2] is False, "of the other sign"


@pytest.mark.long
def test_springs_keep_a_touchdown_from_the_rotors() -> None:
    impact = validation.impact()
    assert 0.0 < impact.springs < impact.blocked


@pytest.mark.long
def test_which_foot_leaves_the_floor_first_is_counted() -> None:
    first = HoppingExperiment().run(3, 10.0)
    rows = {row.name: row for row in validation.spring_rows(first, IMPACT, (IMPACT, ENERGY))}
    told = str(rows["from phase III each of three phases can follow"].ours)
    assert sum(int(word) for word in re.findall(r"[0-9]+", told)) >= 2


@pytest.mark.long
def test_the_biped_hops_ninety_two_times_without_a_fall(hopping: Hopping) -> None:
    figures = paper.measure(hopping)
    assert figures.hops >= 92 and not figures.fell
    assert figures.spread < 0.05
    assert figures.flight > 0.1


@pytest.mark.long
def test_both_feet_leave_the_floor_in_every_hop(hopping: Hopping) -> None:
    phases = [set(hopping.phase[hopping.hop == hop].astype(int)) for hop in range(1, hopping.hops)]
    for phase in (Phase.TOUCHDOWN, Phase.KICK_OFF, Phase.RETRACT, Phase.FLIGHT):
        assert all(phase in seen for seen in phases)


@pytest.mark.long
def test_without_the_update_of_the_lean_or_without_cable_stretch_it_falls() -> None:
    assert HoppingExperiment(replace(Gait(), torso_gain=0.0)).run(20, 20.0).fell
    assert HoppingExperiment(chains=rigid_cables).run(20, 20.0).fell


@pytest.mark.long
def test_cables_stretch_as_their_torque_asks(hopping: Hopping) -> None:
    name = "left_leg_shape"
    stance = (hopping.hop > 10) & (hopping.phase == Phase.TOUCHDOWN)
    stretch = hopping.stretch[stance, 1]
    spring = hopping.spring[stance, 0]
    # at rest, spring and cable carry the same load over their ratios
    ratio = RATIO[SHAPE] / 5.18
    stiffness = DRIVES[name].cable_stiffness * ratio
    assert -stiffness * stretch.mean() == pytest.approx(DRIVES[name].spring_stiffness * spring.mean(), rel=0.1)


def test_the_same_state_goes_on_with_other_cables() -> None:
    first = HoppingExperiment()
    first.run(2, 5.0)
    other = HoppingExperiment(chains=rigid_cables)
    other.start_from(first)
    assert other.data.qpos[:3] == pytest.approx(first.data.qpos[:3])
    assert other.data.joint("left_knee").qpos == pytest.approx(first.data.joint("left_knee").qpos)
    assert other.controller.phase == first.controller.phase and other.data.time == first.data.time
    assert hop_times(other.run(2, 0.05)).size <= 1


def controller_at(phase: Phase) -> HoppingController:
    return HoppingController(phase=phase)


@pytest.mark.parametrize(
    ("phase", "contact", "speed", "following"),
    [
        (Phase.FLIGHT, (True, False), 0.0, Phase.FLIGHT),
        (Phase.FLIGHT, (True, True), 0.3, Phase.TOUCHDOWN),
        (Phase.TOUCHDOWN, (True, True), 0.3, Phase.TOUCHDOWN),
        (Phase.TOUCHDOWN, (True, True), 0.005, Phase.KICK_OFF),
        (Phase.KICK_OFF, (True, True), 0.0, Phase.KICK_OFF),
        (Phase.KICK_OFF, (False, True), 0.0, Phase.LEFT_OFF),
        (Phase.KICK_OFF, (True, False), 0.0, Phase.RIGHT_OFF),
        (Phase.KICK_OFF, (False, False), 0.0, Phase.RETRACT),
        (Phase.LEFT_OFF, (False, False), 0.0, Phase.RETRACT),
        (Phase.RIGHT_OFF, (False, False), 0.0, Phase.RETRACT),
    ],
)
def test_phases_follow_contact_and_speed(
    phase: Phase, contact: tuple[bool, bool], speed: float, following: Phase
) -> None:
    controller = controller_at(phase)
    controller.torques(0.01, 0.0, np.zeros(2), np.zeros(2), np.array(contact), speed, 0.0)
    assert controller.phase == following


def test_retraction_lasts_fifty_milliseconds() -> None:
    controller = controller_at(Phase.RETRACT)
    air = np.array([False, False])
    phases = [
        controller.torques(k * PERIOD, 0.0, np.zeros(2), np.zeros(2), air, 0.0, 0.0) is not None and controller.phase
        for k in range(60)
    ]
    assert phases.count(Phase.RETRACT) == 50 and phases[-1] == Phase.FLIGHT


def test_less_travel_than_wanted_changes_the_lean_by_the_printed_gain() -> None:
    controller = controller_at(Phase.FLIGHT)
    floor, air = np.array([True, True]), np.array([False, False])
    controller.torques(0.0, 0.0, np.zeros(2), np.zeros(2), floor, 1.0, 0.02)
    assert controller.lean == controller.gait.torso
    controller.phase = Phase.FLIGHT
    controller.torques(0.1, 0.0, np.zeros(2), np.zeros(2), air, 1.0, 0.03)
    controller.torques(0.2, 0.0, np.zeros(2), np.zeros(2), floor, 1.0, 0.015)
    gait = controller.gait
    assert controller.lean == pytest.approx(gait.torso + 8.0 * (0.015 - 0.02 - gait.travel))


def test_the_controller_has_the_printed_numbers() -> None:
    gait = Gait()
    assert math.degrees(gait.leg_spread) == pytest.approx(30.0)
    assert np.degrees(gait.shape) == pytest.approx([12.0, 12.0])
    assert np.degrees(gait.kick) == pytest.approx([5.0, 18.0])
    assert np.degrees(gait.retraction) == pytest.approx([5.0, 5.0])
    assert gait.torso_gain == 8.0 and math.degrees(gait.travel) == pytest.approx(-0.69)


@pytest.mark.long
def test_pictures_need_no_rigid_cables_that_got_so_far(tmp_path: Path, hopping: Hopping) -> None:
    paper_plots.plot_stretch(hopping, hopping.rows(slice(0, 0)), tmp_path / "stretch.png")
    assert (tmp_path / "stretch.png").exists()


def test_the_engines_contact_is_the_printed_ground_while_the_biped_lands() -> None:
    landing = land()
    assert landing.force.max() > 1500.0
    assert landing.misfit < 0.05 * landing.force.max()
    harder = land({"contact_time": 0.006})
    assert harder.misfit > 2.0 * landing.misfit
