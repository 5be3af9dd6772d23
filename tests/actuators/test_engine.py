"""Laws inside MuJoCo: accuracy, sticking, several robots in one process, beside models and callbacks of others."""

from __future__ import annotations

import subprocess
import sys
import threading
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mujoco.batch import Batch
from sealegs.actuators import ChainError, DrivenCoordinate, Drivetrain, SealegsError, load_chain
from sealegs.actuators.engine import install, installed
from sealegs.actuators.layout import (
    S_CURRENT,
    S_DUTY,
    S_LIMIT,
    S_LOAD,
    S_OUT_OF_RANGE,
    S_STAGE,
    S_TIME,
    S_TORQUE,
    S_VOLTAGE,
)

from benchmarks.numerics import HOLD, Constants, ExactJoint, engine, excitation
from tests.smooth_bench import LINK, PENDULUM, drivetrain, run

TWO = f"""<mujoco><option timestep="0.001" integrator="RK4"/><worldbody>
<body><joint name="one" axis="0 1 0"/>{LINK}</body><body pos="1 0 0"><joint name="two" axis="0 1 0"/>{LINK}</body>
<body pos="2 0 0.1"><freejoint/><geom size=".1" density="100"/></body><geom type="plane" size="9 9 1" pos="0 0 -1"/>
</worldbody></mujoco>"""
FREE = {"ideal": {"stiffness": 0.0, "armature": 0.006}}  # a motor that does nothing


# --- accuracy ------------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_rk4_at_a_millisecond_follows_an_exact_stick_slip_joint():
    goal = excitation(8.0)
    joint = ExactJoint()
    error = engine(joint, goal, 0.001, "RK4", Constants())[:, 1] - joint.simulate(goal, HOLD, 5e-6)[:, 1]
    assert np.sqrt(np.mean(error**2)) < 0.15e-3


def test_a_series_spring_follows_the_exact_joint_on_both_sides():
    goal = excitation(8.0)
    joint = ExactJoint(stiffness=20.0, damping=0.02)
    simulated, exact = engine(joint, goal, 0.001, "RK4", Constants()), joint.simulate(goal, HOLD, 5e-6)
    assert np.sqrt(np.mean((simulated - exact) ** 2, axis=0)).max() < 0.3e-3
    assert np.ptp(exact[:, 0] - exact[:, 1]) > 0.02  # the two sides do move apart


@pytest.mark.parametrize(
    "friction",
    [
        {"coulomb": 0.7},
        {"coulomb": 0.1, "stribeck": 0.6, "stribeck_velocity": 0.05},
        {"coulomb": 0.05, "load": 1.2},
        {"coulomb": 0.6, "asymmetry": 0.02},
    ],
    ids=lambda value: "+".join(value),
)
@pytest.mark.parametrize("integrator", ["RK4", "implicitfast"])
def test_a_joint_that_friction_holds_under_load_stays(friction, integrator):
    driven = drivetrain([FREE, {"friction": friction}], PENDULUM.replace("RK4", integrator))
    data = run(driven, 0.5, start=1.2)
    before = float(data.qpos[0])
    mujoco.mj_step(driven.model, data, 1000)
    assert abs(float(data.qpos[0]) - before) < 1e-5  # 0.01 mrad in a second, under 0.55 N.m


def test_a_lossy_gear_without_a_friction_stage_is_hard_to_drive_backwards():
    motor = [{"position_p": {"gain": 0.0}}, {"regression": {"duty_torque": 1.0, "speed_torque": 0.0, "armature": 1e-4}}]
    ends = []
    for efficiency in (1.0, 0.4):
        driven = drivetrain([*motor, {"gear": {"ratio": 10.0, "efficiency": efficiency}}])
        ends.append(abs(float(run(driven, 0.2, start=1.0).qpos[0]) - 1.0))
    assert ends[1] < 0.6 * ends[0]


def test_a_friction_limit_of_the_law_reaches_every_island():
    driven = Drivetrain(
        mujoco.MjSpec.from_string(TWO), {name: [FREE, {"friction": {"load": 1.2}}] for name in ("one", "two")}
    )
    data = mujoco.MjData(driven.model)
    data.qpos[:2] = 1.0
    mujoco.mj_step(driven.model, data, 1000)
    assert data.nisland == 3
    assert data.qpos[:2] == pytest.approx(1.0, abs=2e-3)


def test_what_a_stop_carries_counts_as_load_of_the_gearbox():
    xml = PENDULUM.replace('axis="0 1 0"', 'axis="0 1 0" limited="true" range="-0.3 0.3"')
    xml = xml.replace("<option", '<compiler angle="radian"/><option')
    servo = [{"ideal": {"stiffness": 5.0, "damping": 0.5, "armature": 0.006}}, {"friction": {"load": 0.1}}]
    driven = drivetrain(servo, xml)
    data = run(driven, 2.0, goal=1.0)
    motor, load, limit = (float(driven.state("shaft", data.userdata, slot)) for slot in (S_TORQUE, S_LOAD, S_LIMIT))
    assert motor == pytest.approx(5.0 * (1.0 - float(data.qpos[0])))
    assert limit == pytest.approx(0.1 * abs(motor - load), rel=1e-6)
    assert abs(motor + load) <= limit * 1.01  # the stop answers the motor, but for the friction
    assert abs(load) > 2.0


TWO_LINKS = f"""<mujoco><option timestep="0.001" integrator="{{integrator}}"/><worldbody><body>
<joint name="hip" axis="0 1 0"/>{LINK}<body name="shank" pos="0 0 -.12"><joint name="knee" axis="0 1 0"/>{LINK}</body>
</body></worldbody>{{more}}</mujoco>"""
SERVO = [{"ideal": {"stiffness": 20.0, "damping": 1.0, "armature": 0.01}}, {"friction": {"load": 0.01}}]
BELT = [DrivenCoordinate.of_joint("hip"), DrivenCoordinate("knee", (("hip", 1.0), ("knee", 1.0)))]


def two_links(integrator: str = "RK4", more: str = "") -> Drivetrain:
    spec = mujoco.MjSpec.from_string(TWO_LINKS.format(integrator=integrator, more=more))
    return Drivetrain(spec, {"hip": SERVO, "knee": SERVO}, BELT)


def gears(driven: Drivetrain, data: mujoco.MjData, name: str) -> tuple[float, float]:
    """Motor torque and load of a gearbox [N.m]."""
    motor, load = (float(driven.state(name, data.userdata, slot)) for slot in (S_TORQUE, S_LOAD))
    return motor, load


@pytest.mark.parametrize("integrator", ["RK4", "implicitfast"])
def test_at_rest_gearboxes_of_a_belt_carry_what_their_motors_give(integrator):
    driven = two_links(integrator)
    data = mujoco.MjData(driven.model)
    data.ctrl[:] = 0.6, -0.4
    mujoco.mj_step(driven.model, data, 4000)
    assert np.abs(data.qvel).max() < 1e-6
    for name in ("hip", "knee"):
        motor, load = gears(driven, data, name)
        assert abs(motor) > 0.2
        assert load == pytest.approx(-motor, rel=0.025)  # friction holds 1 % of motor plus load


def test_other_motors_and_forces_on_bodies_load_a_gearbox():
    driven = two_links(more='<actuator><motor name="foreign" joint="hip"/></actuator>')
    data = mujoco.MjData(driven.model)
    data.ctrl[driven.model.actuator("foreign").id] = 3.0
    mujoco.mj_step(driven.model, data, 4000)
    assert gears(driven, data, "hip")[0] < -2.0
    data.xfrc_applied[driven.model.body("shank").id, 4] = -1.2
    mujoco.mj_step(driven.model, data, 4000)
    assert gears(driven, data, "knee")[0] > 1.0
    for name in ("hip", "knee"):
        motor, load = gears(driven, data, name)
        assert load == pytest.approx(-motor, rel=0.025, abs=0.01)


def test_a_load_does_not_depend_on_which_simulation_the_engine_ran_before():
    driven = two_links(more='<actuator><motor name="foreign" joint="hip"/></actuator>')
    heavy = [{**SERVO[0]}, {"friction": {"load": 0.3}}]
    for name in ("hip", "knee"):
        driven.set_chain(driven.model, name, load_chain(heavy))
    goals = np.array([[0.5, -0.4, 1.0], [-0.8, 0.7, -2.0], [0.1, 0.2, 0.0]])
    order = [driven.model.actuator(name).id for name in ("hip", "knee", "foreign")]
    batch = Batch(driven.model, len(goals), 1)
    batch.bind("ctrl")[:, order] = goals
    for _ in range(60):
        batch.step(nstep=3)
    for k, goal in enumerate(goals):
        alone = mujoco.MjData(driven.model)
        alone.ctrl[order] = goal
        for _ in range(60):
            mujoco.mj_step(driven.model, alone, 3)
        assert np.array_equal(batch.bind("qpos")[k], alone.qpos)


# --- several robots, threads, steps --------------------------------------------------------------------------------


@pytest.mark.parametrize("chain", ["ideal", "sts3215", "net", "sv1270tg"])
def test_a_batch_on_threads_is_bit_equal_to_single_simulations(chain):
    driven = drivetrain(chain)
    goals = np.linspace(-1.0, 1.0, 12)
    batch = Batch(driven.model, len(goals), 3)
    batch.bind("ctrl")[:] = goals[:, None]
    batch.step(nstep=300)
    for k, goal in enumerate(goals):
        assert np.array_equal(batch.bind("qpos")[k], run(driven, 0.3, goal).qpos)


def test_robots_with_different_chains_do_not_disturb_each_other():
    alone = {chain: run(drivetrain(chain), 0.2, 0.5).qpos.copy() for chain in ("sts3215", "xl330", "net")}
    both = Drivetrain(mujoco.MjSpec.from_string(TWO), {"one": "sts3215", "two": "xl330"})
    data = mujoco.MjData(both.model)
    data.ctrl[:] = 0.5
    mujoco.mj_step(both.model, data, 200)
    assert data.qpos[0] == pytest.approx(alone["sts3215"][0], abs=1e-9)
    assert data.qpos[1] == pytest.approx(alone["xl330"][0], abs=1e-9)
    results: dict[str, np.ndarray] = {}

    def work(chain: str) -> None:
        results[chain] = run(drivetrain(chain), 0.2, 0.5).qpos.copy()

    threads = [threading.Thread(target=work, args=(chain,)) for chain in alone]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(np.array_equal(results[chain], alone[chain]) for chain in alone)


SAGGING = {"volts": 7.4, "resistance": 0.6}


def servo(**supply: float) -> list:
    """A position servo that pushes with nearly all it has."""
    motor = {"motor_constant": 1.2, "resistance": 2.7, "armature": 0.026}
    return [{"position_p": {"gain": 5.0}}, {"supply": SAGGING | supply}, {"dc_motor": motor}]


@pytest.mark.parametrize("integrator", ["RK4", "implicitfast"])
def test_drives_of_one_supply_sag_together(integrator):
    """A leg trained on drives with a supply each walked on voltages that its battery does not give."""
    model = TWO.replace("RK4", integrator)
    driven = Drivetrain(mujoco.MjSpec.from_string(model), {"one": servo(), "two": servo()})
    data = mujoco.MjData(driven.model)
    mujoco.mj_step(driven.model, data)
    data.ctrl[:] = 0.5, -0.5
    mujoco.mj_step(driven.model, data, 30)
    mujoco.mj_forward(driven.model, data)  # which changes nothing, as little as without a sag
    slots = {slot: [driven.state(name, data.userdata, slot) for name in ("one", "two")] for slot in (S_DUTY, S_CURRENT)}
    drawn = [max(float(d * i), 0.0) for d, i in zip(slots[S_DUTY], slots[S_CURRENT], strict=True)]
    assert min(drawn) > 0.5
    for name, duty in zip(("one", "two"), slots[S_DUTY], strict=True):
        volts = float(driven.state(name, data.userdata, S_VOLTAGE) / duty)
        assert volts == pytest.approx(7.4 - 0.6 * sum(drawn), abs=0.02)


def test_a_supply_of_its_own_sags_with_its_own_drive_alone():
    alone, beside = {"one": servo(shared=0.0)}, {"one": servo(shared=0.0), "two": servo()}
    found = []
    for chains in (alone, beside):
        driven = Drivetrain(mujoco.MjSpec.from_string(TWO), chains)
        data = mujoco.MjData(driven.model)
        data.ctrl[:] = 0.4
        mujoco.mj_step(driven.model, data, 300)
        found.append(data.qpos[:1].copy())
    np.testing.assert_array_equal(*found)


def test_discrete_memory_advances_once_a_step_in_every_integrator():
    for integrator, stages in (("RK4", 3.0), ("implicitfast", 0.0)):
        driven = drivetrain("sts3215", PENDULUM.replace("RK4", integrator))
        data = run(driven, 0.01, 0.5)
        assert driven.state("shaft", data.userdata, S_TIME) == pytest.approx(0.009)
        assert driven.state("shaft", data.userdata, S_STAGE) == stages


def test_mj_forward_between_steps_changes_nothing():
    driven = drivetrain("sts3215")
    plain, watched = (mujoco.MjData(driven.model) for _ in range(2))
    for k in range(200):
        plain.ctrl[0] = watched.ctrl[0] = 0.3 * np.sin(0.1 * k)
        mujoco.mj_step(driven.model, plain)
        mujoco.mj_forward(driven.model, watched)
        mujoco.mj_step(driven.model, watched)
        mujoco.mj_forward(driven.model, watched)
    assert plain.qpos[0] == pytest.approx(watched.qpos[0], abs=1e-9)


@pytest.mark.parametrize("chain", ["sts3215", "net", "sv1270tg"])
def test_the_model_written_as_mjcf_moves_as_the_one_it_came_from(chain):
    driven = drivetrain(chain)
    again = mujoco.MjModel.from_xml_string(driven.spec.to_xml())
    data = mujoco.MjData(again)
    data.ctrl[0] = 0.4
    mujoco.mj_step(again, data, 300)
    assert data.qpos == pytest.approx(run(driven, 0.3, 0.4).qpos, abs=1e-4)


def test_a_reset_forgets_the_past():
    driven = drivetrain("sts3215")
    data = run(driven, 0.5, 1.0)
    mujoco.mj_resetData(driven.model, data)
    data.ctrl[0] = 0.4
    mujoco.mj_step(driven.model, data, 100)
    assert np.array_equal(data.qpos, run(driven, 0.1, 0.4).qpos)


def test_a_parameter_changes_per_simulation_of_a_batch_as_in_a_model_of_its_own():
    driven = drivetrain("sts3215")
    batch = Batch(driven.model, 3, 0)
    values = np.array([0.02, 0.052, 0.2])
    driven.set_value(batch, "shaft", "friction.coulomb", values)
    driven.set_value(batch, "shaft", "dc_motor.armature", np.full(3, 0.026))
    batch.bind("ctrl")[:] = 0.3
    driven.set_value(batch, "shaft", "friction.coulomb", values)
    batch.step(nstep=300)
    for k, value in enumerate(values):
        own = drivetrain(load_chain("sts3215").with_value("friction.coulomb", value))
        assert batch.bind("qpos")[k] == pytest.approx(run(own, 0.3, 0.3).qpos, abs=1e-12)
    with pytest.raises(ChainError, match="kind of friction"):
        driven.set_value(driven.model, "shaft", "friction.load", 0.1)
    with pytest.raises(ChainError, match="memory"):
        driven.set_value(driven.model, "shaft", "encoder.latency", 0.01)


def test_a_belt_drives_the_sum_of_two_joints():
    xml = f"""<mujoco><option timestep="0.001" integrator="RK4" gravity="0 0 0"/><worldbody><body>
    <joint name="hip" axis="0 1 0"/>{LINK}<body pos="0 0 -.12"><joint name="knee" axis="0 1 0"/>{LINK}</body></body>
    </worldbody></mujoco>"""
    belt = DrivenCoordinate("knee", (("hip", 1.0), ("knee", 1.0)))
    stiff = [{"ideal": {"stiffness": 20.0, "damping": 1.0, "armature": 0.01}}, {"friction": {"load": 0.01}}]
    for chain in (stiff, [*stiff, {"spring": {"stiffness": 50.0, "damping": 0.1}}]):
        driven = Drivetrain(mujoco.MjSpec.from_string(xml), {"hip": stiff, "knee": chain}, [
            DrivenCoordinate.of_joint("hip"), belt,
        ])  # fmt: skip
        data = mujoco.MjData(driven.model)
        data.ctrl[:] = 0.3, -0.2
        mujoco.mj_step(driven.model, data, 4000)
        assert driven.position("knee", data.qpos, "link") == pytest.approx(-0.2, abs=5e-3)
        assert data.qpos[1] == pytest.approx(-0.5, abs=1e-2)
        assert driven.position("knee", data.qpos) == pytest.approx(-0.2, abs=5e-3)


STIFF_SERVO = [{"ideal": {"stiffness": 500.0, "damping": 5.0, "armature": 0.01}}]
HANGING = PENDULUM.replace('gravity="0 0 0"', "")


def test_play_lets_the_link_move_freely_by_its_width():
    driven = drivetrain([*STIFF_SERVO, {"backlash": {"width": 0.1}}], HANGING)
    data = run(driven, 3.0, goal=1.0, start=1.0)
    gap = driven.position("shaft", data.qpos, "motor") - driven.position("shaft", data.qpos, "link")
    assert gap == pytest.approx(0.05, abs=1e-3)  # the load hangs on one flank
    data.qfrc_applied[driven.model.joint("shaft").dofadr] = 1.5
    mujoco.mj_step(driven.model, data, 3000)
    gap = driven.position("shaft", data.qpos, "motor") - driven.position("shaft", data.qpos, "link")
    assert gap == pytest.approx(-0.05, abs=1e-3)


def test_teeth_that_are_set_later_are_those_of_a_model_built_with_them():
    play = {"width": 0.1, "tooth_stiffness": 300.0, "tooth_damping": 0.2}
    built = drivetrain([*STIFF_SERVO, {"backlash": play}], HANGING)
    stiff = drivetrain([*STIFF_SERVO, {"backlash": {**play, "tooth_damping": 0.0}}], HANGING)
    assert not np.array_equal(run(built, 0.5, 1.0).qpos, run(stiff, 0.5, 1.0).qpos)
    stiff.set_value(stiff.model, "shaft", "backlash.tooth_damping", 0.2)
    assert np.array_equal(run(built, 0.5, 1.0).qpos, run(stiff, 0.5, 1.0).qpos)
    batch = Batch(built.model, 2, 0)
    built.set_value(batch, "shaft", "backlash.tooth_stiffness", np.array([300.0, 100.0]))
    batch.bind("ctrl")[:] = 1.0
    batch.step(nstep=500)
    assert batch.bind("qpos")[0] == pytest.approx(run(built, 0.5, 1.0).qpos, abs=1e-12)
    assert batch.bind("qpos")[1] != pytest.approx(run(built, 0.5, 1.0).qpos, abs=1e-6)


def test_teeth_are_no_harder_than_a_step_can_bear():
    hard = {"width": 0.1, "tooth_stiffness": 1e6, "tooth_damping": 1e3}
    data = run(drivetrain([*STIFF_SERVO, {"backlash": hard}], HANGING), 2.0, 1.0)
    assert np.isfinite(data.qpos).all() and np.abs(data.qvel).max() < 50.0


def test_damping_of_teeth_without_a_stiffness_is_refused():
    with pytest.raises(ChainError, match="give both or neither"):
        drivetrain([*STIFF_SERVO, {"backlash": {"width": 0.1, "tooth_damping": 1.0}}])


# --- refusals ------------------------------------------------------------------------------------------------------


def test_what_does_not_fit_the_model_is_refused_with_the_nearest_name():
    with pytest.raises(SealegsError, match="did you mean 'shaft'"):
        drivetrain("ideal", joint="shft")
    with pytest.raises(ChainError, match="the robot has shaft"):
        Drivetrain(mujoco.MjSpec.from_string(PENDULUM), {"elbow": "ideal"}, [DrivenCoordinate.of_joint("shaft")])
    with pytest.raises(SealegsError, match="over 3 joints"):
        Drivetrain(
            mujoco.MjSpec.from_string(PENDULUM),
            {"a": "ideal"},
            [DrivenCoordinate("a", (("shaft", 1.0), ("shaft", 1.0), ("shaft", 1.0)))],
        )


def test_a_joints_own_friction_and_armature_add_to_those_of_its_chain():
    own = 'axis="0 1 0" damping="0.3" frictionloss="0.2" armature="0.004"'
    for more in ({}, {"load": 0.1}):
        chain = [FREE, {"friction": {"coulomb": 0.1, "viscous": 0.05, **more}}]
        driven = drivetrain(chain, PENDULUM.replace('axis="0 1 0"', own))
        model = driven.model
        driven.set_value(model, "shaft", "friction.viscous", 0.07)
        driven.set_value(model, "shaft", "friction.coulomb", 0.15)
        driven.set_value(model, "shaft", "friction.viscous", 0.05)
        assert model.dof_damping[0] == pytest.approx(0.35)
        assert model.dof_frictionloss[0] == pytest.approx(0.3)
        assert model.dof_armature[0] == pytest.approx(0.01)
        data = run(driven, 0.3, start=0.5)  # 0.28 N.m of gravity, held by 0.3 together
        assert data.qpos[0] == pytest.approx(0.5, abs=1e-3)


def test_a_motor_behind_a_spring_needs_an_inertia():
    servo = [{"ideal": {"stiffness": 5.0}}, {"spring": {"stiffness": 20.0}}]
    with pytest.raises(ChainError, match=r"no inertia; give its motor .* an 'armature'"):
        drivetrain(servo)
    driven = drivetrain([{"ideal": {"stiffness": 5.0, "armature": 0.01}}, servo[1]])
    with pytest.raises(ChainError, match="no inertia"):
        driven.set_value(driven.model, "shaft", "ideal.armature", 0.0)


@pytest.mark.parametrize("integrator", ["RK4", "implicitfast"])
@pytest.mark.parametrize(
    "chain",
    [
        [{"ideal": {"stiffness": 1.0, "damping": 40.0}}],
        [
            {"position_p": {"gain": 1.0}},
            {"supply": {"volts": 7.0}},
            {"dc_motor": {"motor_constant": 3, "resistance": 0.2}},
        ],
        [{"ideal": {"stiffness": 1.0, "armature": 1e-4}}, {"spring": {"stiffness": 1e4}}],
    ],
)
def test_a_chain_that_the_step_makes_unstable_is_refused(chain, integrator):
    with pytest.raises(ChainError, match=r"is unstable at a step of 0\.001 s") as caught:
        drivetrain(chain, PENDULUM.replace("RK4", integrator))
    assert "\n" not in str(caught.value)
    longest = float(str(caught.value).split("shorter than ")[1].split()[0])
    drivetrain(chain, PENDULUM.replace("RK4", integrator).replace("0.001", f"{0.95 * longest:g}"))


def test_a_net_refuses_a_simulation_slower_than_itself():
    with pytest.raises(
        ChainError, match=r"works at 200 Hz, but the simulation steps at 100 Hz; make its time step 0\.005"
    ):
        drivetrain("net", PENDULUM.replace("0.001", "0.01"))


def test_a_net_counts_inputs_outside_its_training_range():
    driven = drivetrain("net")
    data = run(driven, 0.2, 0.5)
    assert driven.state("shaft", data.userdata, S_OUT_OF_RANGE) == 0.0
    data.qvel[0] = 40.0
    mujoco.mj_step(driven.model, data, 20)
    assert driven.state("shaft", data.userdata, S_OUT_OF_RANGE) > 0.0


REPOSITORY = Path(__file__).resolve().parents[2]
FOREIGN = """<mujoco><worldbody><body><joint name="j" axis="0 1 0"/><geom size=".1"/></body></worldbody><actuator>
<general joint="j" biastype="user" {user}/><motor joint="j"/></actuator></mujoco>"""


def foreign_script(setup: str, expected: str) -> None:
    """Run a check in a process of its own: callbacks belong to a process."""
    code = f"""
import ctypes, mujoco, numpy as np
from sealegs.actuators import Drivetrain
FOREIGN, PENDULUM = {FOREIGN!r}, {PENDULUM!r}
models = [mujoco.MjModel.from_xml_string(FOREIGN.format(user=user)) for user in ('', 'user="3 4"')]
{setup}
for _ in range(2):  # before and after one of ours exists
    forces = []
    for model in models:
        data = mujoco.MjData(model); data.ctrl[1] = 2.0
        mujoco.mj_step(model, data); forces += data.actuator_force.tolist()
    assert np.allclose(forces, {expected}), forces
    driven = Drivetrain(mujoco.MjSpec.from_string(PENDULUM), {{"shaft": "sts3215"}})
    ours = mujoco.MjData(driven.model); ours.ctrl[0] = 0.5
    mujoco.mj_step(driven.model, ours, 500)
    assert 0.3 < ours.qpos[0] < 0.6, ours.qpos
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=REPOSITORY, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.long
def test_models_without_our_actuators_are_untouched():
    foreign_script("", "[0, 2, 0, 2]")


@pytest.mark.long
def test_a_python_callback_of_another_library_keeps_its_actuators():
    foreign_script("mujoco.set_mjcb_act_bias(lambda model, data, actuator: 0.25)", "[0.25, 2, 0.25, 2]")


@pytest.mark.long
def test_a_c_callback_of_another_library_keeps_its_actuators():
    foreign_script(
        "kind = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int)\n"
        "theirs = kind(lambda model, data, actuator: 0.5)\n"
        "mujoco.set_mjcb_act_bias(theirs)",
        "[0.5, 2, 0.5, 2]",
    )


def test_the_law_is_installed_again_after_another_library_took_its_place():
    driven = drivetrain("sts3215")
    try:
        mujoco.set_mjcb_act_bias(None)
        assert not installed()
        drivetrain("ideal")
        assert installed()
        assert run(driven, 0.3, 0.5).qpos[0] > 0.1
    finally:
        install()
