"""A torque-driven log tells torque per mass alone: the masses of the robot's file say how large all the rest is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.actuators.stability import velocity_slope
from sealegs.gap.causes.catalogue import adjustable
from sealegs.gap.load.tree import TreeLoad, own_lever, tip_behind, tip_mass
from sealegs.gap.measure.unseen import refitted_numbers
from sealegs.gap.output.mjcf import _actuator
from sealegs.gap.replay.joint_model import Axis, JointModel
from sealegs.gap.replay.parameters import TIGHT, Parameter, factor
from sealegs.gap.search.torque_gauge import is_torque, room

from testbed.logs import hidden_arm
from tests.logged_robots import free_replay as problem

CHAIN = [{"torque_command": {"armature": 0.01}}, {"friction": {"coulomb": 0.1, "viscous": 0.05}}]
JOINT = JointModel(
    load_chain(CHAIN), TreeLoad(typical_inertia=0.02, typical_gravity=3.0), axis=Axis(effort=5.0), of_robot=True
)


def test_refitting_leaves_scale_and_mass_of_a_torque_driven_joint_within_their_tolerance() -> None:
    """Both of a leg's knee grew by 1.3 together, and friction with them: its interval excluded the truth."""
    wide = {p.number: p for p in adjustable(JOINT, 4.0)}
    assert wide["load.mass_factor"].high == wide["scale.factor"].high == pytest.approx(1.0 + TIGHT)
    assert wide["friction.coulomb"].high == 5.0


def test_refitting_leaves_the_mass_behind_a_motor_of_a_robot_within_its_tolerance() -> None:
    """A slide had a fifth of its mass behind five times the resistance: constant and resistance are refitted too."""
    servo = replace(JOINT, chain=load_chain("sts3215"))
    for of_robot, most in ((True, 1.0 + TIGHT), (False, 5.0)):
        wide = {p.number: p for p in adjustable(replace(servo, of_robot=of_robot), 4.0)}
        assert wide["load.mass_factor"].high == pytest.approx(most) and wide["dc_motor.resistance"].high == 5.0


def test_what_refitting_turned_names_scale_and_mass_too() -> None:
    wide = adjustable(JOINT, 4.0)
    values = {p.path: {"scale.factor": 0.57, "load.mass_factor": 1.05}.get(p.path, 1.0) for p in wide}
    assert refitted_numbers(wide, values) == "scale.factor x 0.57, load.mass_factor x 1.05"
    assert refitted_numbers(wide, values, adjustable(JOINT)) == "scale.factor x 0.57"


def test_what_a_position_log_leaves_open_of_all_torques_is_the_room_of_drive_and_mass(tmp_path: Path) -> None:
    """A profile about one optimum kept 0.4 N.m of friction out where it and the mass were 6 % high."""
    data, _ = hidden_arm(tmp_path, "two_link", {}, seed=3, runs=1, duration=3.0, by_torque=True)
    free = problem(data.runs[0], "elbow")
    tuned = adjustable(free.models[0])
    values = {p.path: 1.0 for p in tuned} | {"load.mass_factor": 1.06, "scale.factor": 1.02}
    least, most = room(free, tuned, values)
    assert most == pytest.approx(1.0) and least == pytest.approx(1.0 / (1.06 * 1.02))
    assert room(free, [p for p in tuned if p.number != "load.mass_factor"], values) == (1.0, 1.0)  # it was weighed
    torques = {p.number for p in tuned if is_torque(p)}
    assert torques == {"torque_command.armature", "friction.coulomb", "friction.viscous", "scale.factor"} | {
        "load.mass_factor"
    } | ({"offset.value"} & {p.number for p in tuned})


def test_a_resistance_within_its_tolerance_leaves_all_torques_open_and_one_that_is_sought_does_not(
    tmp_path: Path,
) -> None:
    data, _ = hidden_arm(tmp_path, "two_link", {}, seed=3, runs=1, duration=3.0)
    free = problem(data.runs[0], "elbow")
    tuned = adjustable(free.models[0])
    mass = Parameter("load.mass_factor", "1", 0.2, 6.0, 1.0, 0.1, logarithmic=True)
    numbers = [*(p for p in tuned if p.number != mass.number), mass]
    values = {p.path: 1.0 for p in numbers} | {"load.mass_factor": 2.0, "dc_motor.resistance*": 1.03}
    assert room(free, numbers, values) == pytest.approx((1.03 / (1.0 + TIGHT), 1.03 * (1.0 + TIGHT)))
    sought = [factor("dc_motor.resistance", 0.3, 3.0) if p.number == "dc_motor.resistance" else p for p in numbers]
    assert room(free, sought, values) == (1.0, 1.0)
    current = free.channels.index("current")
    weighed = replace(free, weight=np.where(np.arange(len(free.weight)) == current, 1.0, free.weight))
    assert room(weighed, numbers, values) == (1.0, 1.0), "a current that was logged says how large torques are"


def test_what_is_a_torque_is_the_same_on_a_slide() -> None:
    slide = Axis(slide=True, low=0.0, high=0.4, effort=20.0)
    assert all(is_torque(slide.scaled(p)) for p in (Parameter("friction.coulomb", "N.m", 0.0, 9.0, 0.1, 0.1),))


def test_the_masses_of_two_bodies_may_be_off_apart_and_of_one_they_may_not() -> None:
    """A right arm that torques drive had a centre of mass named with 0.77."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body name="a"><joint name="upper" axis="0 1 0"/>
        <inertial pos="0 0 -0.1" mass="1" diaginertia="1e-3 1e-3 1e-3"/><body name="b" pos="0 0 -0.2">
        <joint name="fore" axis="0 1 0"/><inertial pos="0 0 -0.15" mass="1" diaginertia="1e-3 1e-3 1e-3"/>
        </body></body></worldbody></mujoco>"""
    )
    assert (own_lever(model, 0), own_lever(model, 1)) == (pytest.approx(0.1), 0.0)
    apart = replace(JOINT, load=TreeLoad(typical_inertia=0.02, typical_gravity=3.0, own_lever=0.1))
    (shift,) = [p for p in adjustable(apart) if p.number == "load.centre_shift"]
    assert shift.high == pytest.approx(2.0 * TIGHT * 0.1)
    assert tip_mass(model, 0, tip_behind(model, 0)) == pytest.approx(1.0)
    (payload,) = [p for p in adjustable(replace(apart, load=TreeLoad(tip_mass=0.5))) if p.number == "load.payload"]
    assert (payload.low, payload.high) == (0.0, pytest.approx(TIGHT))
    servo = replace(apart, chain=load_chain("sts3215"))
    assert "load.centre_shift" not in {p.number for p in adjustable(servo)}


def test_a_weak_ideal_drive_is_as_weak_in_plain_mujoco() -> None:
    chain = load_chain([{"ideal": {"stiffness": 10.0, "damping": 1.0, "torque_limit": 4.0, "strength": 0.8}}])
    law = ElementTree.fromstring('<general name="a" joint="j"/>')
    made = _actuator(chain, law, 1e-3).attrib
    assert (made["kp"], made["kv"], made["forcerange"]) == ("8", "0.8", "-3.2 3.2")
    assert velocity_slope(chain, 1e-3) == pytest.approx(0.8)
    free = load_chain([{"ideal": {"stiffness": 10.0, "strength": 0.8}}])
    assert "forcerange" not in _actuator(free, law, 1e-3).attrib
