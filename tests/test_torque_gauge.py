"""A torque-driven log tells torque per mass alone: the masses of the robot's file say how large all the rest is."""

from __future__ import annotations

from dataclasses import replace

import pytest
from sealegs.actuators import load_chain
from sealegs.gap.causes.catalogue import adjustable
from sealegs.gap.load.tree_load import TreeLoad
from sealegs.gap.replay.axis import Axis
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.replay.parameters import TIGHT
from sealegs.gap.verdict.unseen import refitted_numbers

CHAIN = [{"torque_command": {"armature": 0.01}}, {"friction": {"coulomb": 0.1, "viscous": 0.05}}]
JOINT = JointModel(
    load_chain(CHAIN), TreeLoad(typical_inertia=0.02, typical_gravity=3.0), axis=Axis(effort=5.0), of_robot=True
)


def test_refitting_leaves_scale_and_mass_of_a_torque_driven_joint_within_their_tolerance() -> None:
    """Both of a leg's knee grew by 1.3 together, and friction with them: its interval excluded the truth."""
    wide = {p.number: p for p in adjustable(JOINT, 4.0)}
    assert wide["load.mass_factor"].high == wide["scale.factor"].high == pytest.approx(1.0 + TIGHT)
    assert wide["friction.coulomb"].high == 5.0
    servo = replace(JOINT, chain=load_chain("sts3215"))  # its back-EMF tells volts from speed
    assert {p.number: p for p in adjustable(servo, 4.0)}["load.mass_factor"].high == 5.0


def test_what_refitting_turned_names_scale_and_mass_too() -> None:
    wide = adjustable(JOINT, 4.0)
    values = {p.path: {"scale.factor": 0.57, "load.mass_factor": 1.05}.get(p.path, 1.0) for p in wide}
    assert refitted_numbers(wide, values) == "scale.factor x 0.57, load.mass_factor x 1.05"
    assert refitted_numbers(wide, values, adjustable(JOINT)) == "scale.factor x 0.57"
