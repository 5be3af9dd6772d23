"""A carriage that a force drives, with nothing around it that holds it: what adds up along a run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sealegs.actuators.chain import load_chain
from sealegs.gap.causes.catalogue import adjustable, catalogue
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.load.tree import TreeLoad
from sealegs.gap.log.arrays import measured_set
from sealegs.gap.log.types import MeasuredSet
from sealegs.gap.replay.joint_model import Axis, JointModel

MASS, VISCOUS, COULOMB, BIAS = 40.0, 90.0, 12.0, 1.5  # [kg], [N.s/m], [N], [N]
LEAN = 20.0  # [N.s/m]
STEP = 1e-3
CHAIN = [{"delay": {"seconds": 0.0}}, {"torque_command": {}}]
MODEL = """<mujoco model="table"><worldbody><body name="table"><joint name="table" type="slide" axis="1 0 0"/>
<inertial pos="0 0 0" mass="41.5" diaginertia="1 1 1"/></body></worldbody></mujoco>"""


def carriage(folder: Path, seconds: float = 15.0, lean: float = 0.0) -> MeasuredSet:
    """One run, with so much more viscous friction forwards than backwards, halved [N.s/m], behind a controller that
    nobody knows; the force that it commanded is logged, its bias is not.
    """
    rng = np.random.default_rng(3)
    time = np.arange(0.0, seconds, STEP)
    goal = 0.1 * (1.0 - np.cos(1.7 * time)) + 0.04 * np.sin(4.3 * time) * np.minimum(time, 1.0)
    rate = np.gradient(goal, STEP)
    force, position = np.empty(len(time)), np.empty(len(time))
    q, v = goal[0], 0.0
    for k in range(len(time)):
        force[k], position[k] = 9e3 * (goal[k] - q) + 9e2 * (rate[k] - v), q
        driven = force[k] - BIAS - (VISCOUS + np.sign(v) * lean) * v
        if abs(v) < 1e-6 and abs(driven) <= COULOMB:
            v = 0.0
            continue
        way = np.sign(v) if abs(v) >= 1e-6 else np.sign(driven)
        faster = v + STEP * (driven - way * COULOMB) / MASS
        v = 0.0 if v * faster < 0.0 else faster
        q += STEP * v
    folder.mkdir(parents=True, exist_ok=True)
    model = folder / "table.xml"
    model.write_text(MODEL, encoding="utf-8")
    columns = {
        "time": time,
        "table.goal": goal,
        "table.torque_command": force,
        "table.position": position + rng.normal(0.0, 2e-5, len(time)),
    }
    units = {"table.position": "m", "table.goal": "m"}
    return measured_set(columns, {"robot": str(model), "actuators": {"table": CHAIN}, "units": units}, "table")


@pytest.mark.long
def test_friction_is_named_though_the_amplifier_has_a_bias_that_nobody_knows(tmp_path: Path) -> None:
    """On 15 s of a public carriage with 3 N of bias, friction was withdrawn for refitted numbers without a meaning."""
    (found,) = diagnose(carriage(tmp_path))
    assert found.gap["extended"].rmse < 0.02 * found.gap["nominal"].rmse
    assert {cause.name for cause in found.causes} == {"friction.coulomb", "friction.viscous"}
    sure = {cause.name: cause.confidence for cause in found.causes}
    assert sure["friction.coulomb"] > 0.8, "charged for laws of errors that no window of the search shows: 0.66"
    assert sure["friction.viscous"] > 0.9, "dry friction beside it was counted as its rival: 0.58"
    values = {number: value for cause in found.causes for number, value in cause.parameters.items()}
    assert values["friction.coulomb"].value == pytest.approx(COULOMB, rel=0.1)
    assert values["friction.viscous"].value == pytest.approx(VISCOUS, rel=0.1)


@pytest.mark.weekly
def test_friction_that_grows_faster_in_one_direction_is_named(tmp_path: Path) -> None:
    """Of a chain without friction it was never tried: its dry friction fell back to where a search would begin."""
    (found,) = diagnose(carriage(tmp_path, lean=-LEAN))
    named = {cause.name: cause for cause in found.causes}
    assert set(named) >= {"friction.viscous", "friction.asymmetric"}
    assert named["friction.asymmetric"].confidence > 0.6
    lean = named["friction.asymmetric"].parameters["friction.viscous_asymmetry"]
    assert lean.value == pytest.approx(-LEAN, rel=0.15)
    values = {number: value for cause in found.causes for number, value in cause.parameters.items()}
    assert values["friction.coulomb"].value == pytest.approx(COULOMB, rel=0.1)
    assert values["friction.viscous"].value == pytest.approx(VISCOUS, rel=0.1)


def test_a_joint_that_a_torque_drives_may_have_a_bias_where_gravity_does_not_hold_it() -> None:
    free = JointModel(load_chain(CHAIN), TreeLoad(typical_inertia=40.0), axis=Axis(effort=50.0))
    (bias,) = [p for p in adjustable(free) if p.number == "offset.value"]
    assert (bias.low, bias.high) == (pytest.approx(-3.0), pytest.approx(3.0))
    held = JointModel(load_chain(CHAIN), TreeLoad(typical_inertia=1.0, typical_gravity=9.0), axis=Axis(effort=50.0))
    servo = JointModel(load_chain([{"ideal": {"stiffness": 10.0, "damping": 0.1}}]))
    assert not [p for model in (held, servo) for p in adjustable(model) if p.number == "offset.value"]


def test_periods_of_a_slide_are_told_per_metre_and_their_phase_in_rad() -> None:
    """Of a carriage that goes 0.25 m, teeth were sought in periods longer than that, and a phase was given in m."""
    slide = JointModel(load_chain(CHAIN), TreeLoad(), axis=Axis(slide=True, low=0.0, high=0.25, effort=50.0))
    (cause,) = catalogue(slide, ("friction.position_dependent",))
    for amplitude, count, phase in cause.variants:
        assert (amplitude.unit, count.unit, phase.unit) == ("N", "rad/m", "rad")
        assert count.low * 0.25 > 2.0 and (phase.low, phase.high) == (-9.0, 9.0)
