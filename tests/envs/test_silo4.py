"""The machine SILO4: four legs of paper 000 under a body; it stands, and walks on a reference gait."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from sealegs.common.errors import SealegsError
from sealegs.envs.leg.kinematics import foot
from sealegs.envs.leg.parameters import STANCE
from sealegs.envs.leg.robot import JOINTS, LEG
from sealegs.papers.leg.machine import LEGS, SILO4, Wave, coordinate, margin, standing_height, walk


def test_each_leg_is_the_leg_of_the_paper() -> None:
    model, one = SILO4.build_spec().compile(), LEG.build_spec().compile()
    for leg in LEGS:
        for link in (1, 2, 3):
            there, here = model.body(f"{leg}_link_{link}"), one.body(f"link_{link}")
            assert there.mass == pytest.approx(here.mass) and there.inertia == pytest.approx(here.inertia)
        for joint in JOINTS:
            dofs = [m.joint(name).dofadr[0] for m, name in ((model, coordinate(leg, joint)), (one, joint))]
            assert model.dof_armature[dofs[0]] == pytest.approx(one.dof_armature[dofs[1]])
    chains = SILO4.chains_for(None)
    assert all(chains[coordinate(leg, joint)] == chains[f"left_hind_{joint}"] for leg in LEGS for joint in JOINTS)
    assert float(model.body_mass.sum()) == pytest.approx(30.0, abs=0.1)


def test_feet_are_where_the_legs_kinematics_say() -> None:
    values = SILO4.parameters()
    model = SILO4.build_spec().compile()
    data = mujoco.MjData(model)
    for leg in LEGS:
        for joint, angle in zip(JOINTS, STANCE, strict=True):
            data.joint(coordinate(leg, joint)).qpos = angle
    mujoco.mj_kinematics(model, data)
    reach, _, down = foot(values, np.array(STANCE))
    for leg in LEGS:
        x, y, z = data.geom(f"{leg}_foot").xpos
        assert abs(x) == pytest.approx(0.5 * values["body_length"])
        assert abs(y) == pytest.approx(0.5 * values["body_width"] + reach)
        assert z == pytest.approx(standing_height(values) + down) == pytest.approx(values["foot_radius"])


def test_the_centre_of_mass_stays_over_the_feet_that_stand() -> None:
    gait, values = Wave(), SILO4.parameters()
    times = gait.settle + np.linspace(0.0, gait.cycle, 200, endpoint=False)
    assert min(margin(gait, values, float(time)) for time in times) > 0.015
    hurried = Wave(duty=0.7)
    assert min(margin(hurried, values, float(time)) for time in times) < 0.0, "under 3/4 a wave gait is unstable"


def test_it_stands() -> None:
    stood = walk(Wave(settle=99.0), 2.0)
    assert stood.tilt.max() < 2e-3 and np.abs(stood.place[-1, :2]).max() < 1e-3
    assert np.ptp(stood.place[-50:, 2]) < 1e-5 and stood.error[-1] < 1e-3
    assert (np.abs(stood.feet[-1]) < 2e-3).all()


def test_it_walks_as_fast_as_its_gait_with_every_foot_lifted() -> None:
    gait = Wave()
    walked = walk(gait, gait.settle + gait.cycle)
    moving = walked.time > gait.settle
    way = np.ptp(walked.place[moving, 0])
    assert way == pytest.approx(gait.speed * gait.cycle, rel=0.05) and abs(walked.place[-1, 1]) < 0.01
    assert walked.tilt.max() < 0.02 and walked.error.max() < 0.02
    assert (walked.feet.max(axis=0) > 0.9 * gait.lift).all()
    assert ((walked.feet > 5e-3).sum(axis=1) <= 1).all(), "one leg after the other"


def test_a_number_that_it_has_not_is_told_in_a_sentence() -> None:
    with pytest.raises(SealegsError, match="did you mean 'body_mass'"):
        walk(Wave(), 0.1, {"body_mas": 10.0})
