"""One supply feeds all joints: what the others draw lowers the voltage of each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.gap.load.terms import T_COLUMNS, T_DRAWN, T_OWN
from sealegs.gap.load.tree_load import TreeLoad
from sealegs.gap.log.parts import cut
from sealegs.gap.log.types import JointLog, MeasuredRun
from sealegs.gap.replay.free import FreeProblem, free_problem
from sealegs.gap.replay.joint_model import Axis, JointModel
from sealegs.gap.replay.tree import drawn_beside

from tests.smooth_bench import CHAIN, PARAMS

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


def test_a_bridge_draws_duty_times_current_and_gives_nothing_back() -> None:
    still = np.zeros(3)
    logs = {
        "wrist": JointLog(still, still, duty=np.full(3, 0.5), current=np.full(3, 3.0)),
        "jaw": JointLog(still, still, duty=np.array([-0.5, 0.5, np.nan]), current=np.array([-1.0, -1.0, 1.0])),
        "base": JointLog(still, still, current=np.full(3, 9.0)),
    }
    run = MeasuredRun("run", np.arange(3.0), logs, {}, "robot", {}, {})
    np.testing.assert_allclose(drawn_beside(run, "wrist"), [0.5, 0.0, 0.0])
    np.testing.assert_allclose(drawn_beside(run, "jaw"), 1.5)
    np.testing.assert_allclose(drawn_beside(replace(run, joints={"jaw": logs["jaw"]}), "jaw"), 0.0)
