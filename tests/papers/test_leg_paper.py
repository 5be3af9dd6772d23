"""The leg's dynamics beside paper 000, its controllers, and the split of any robot's motor torque."""

from __future__ import annotations

import json

import numpy as np
import pytest
from sealegs.commands import evaluate
from sealegs.common.errors import SealegsError
from sealegs.envs.leg.robot import chains_of
from sealegs.evaluation.relevant import Mover, judge
from sealegs.papers.leg import control
from sealegs.papers.leg.paper import Analysis, against_engine, coriolis_error, peak, straightness
from sealegs.papers.leg.report import motor_rows, perturbation_lines, table_rows


@pytest.fixture(scope="module")
def analysis() -> Analysis:
    return Analysis()


def test_each_printed_constant_is_beside_ours_with_what_the_row_is_worth():
    rows = [*table_rows(), *motor_rows()]
    assert len(rows) >= 20 and {row.mark for row in rows} == {"follows from the inputs"}
    missed = [row.name for row in rows if row.holds is False]
    assert missed == ["e", "x", "links of table I that can exist"]


def test_the_damping_of_table_5_is_that_of_the_back_emf():
    for row in motor_rows()[:3]:
        assert row.off is not None and abs(row.off) < 0.025


def test_symbols_and_engine_agree_in_every_element():
    assert max(against_engine(20).values()) < 1e-10


def test_leaving_out_coriolis_costs_the_square_of_the_speed(analysis):
    line = analysis.lines(1, horizontal=True)[0]
    slow, fast = (coriolis_error(analysis.along(line, speed)) for speed in (0.02, 0.04))
    assert fast / slow == pytest.approx(4.0, rel=0.02)


def test_the_perturbation_of_joint_1_is_no_half_percent_at_any_speed(analysis):
    lines = analysis.lines(20, horizontal=True)
    for speed in (0.1, 0.4):
        found = [analysis.along(line, speed) for line in lines]
        shares = [peak(row.perturbation)[0] / peak(row.inertia)[0] for row in found]
        assert min(shares) > 0.05 and 0.15 < np.median(shares) < 0.30


def test_gravity_is_linear_in_the_lengthening_along_a_line_and_not_over_the_workspace(analysis):
    from sealegs.envs.leg.kinematics import lengthening
    from sealegs.papers.leg.dynamics import gravity

    for line in analysis.lines(10, horizontal=True):
        row = analysis.along(line, 0.2)
        if np.ptp(row.lengthening) > 0.02:
            assert straightness(row.lengthening, row.gravity[:, 1]) > 0.95
    q = analysis.workspace(1000)
    reach, weight = lengthening(analysis.values, q), gravity(analysis.constants, q)
    assert straightness(reach, weight[:, 1]) < 0.9


def test_compensating_friction_makes_computed_torque_exact(analysis):
    lines, command, chains = perturbation_lines(analysis), control.paths(3, seed=5), chains_of("silo4_pd")
    off = [
        control.rms(control.errors(chains, command, 0.8, model=model))
        for model in (None, control.Model(lines, friction=False), control.Model(lines, friction=True))
    ]
    assert off[2] < 0.2 * off[1] < 0.2 * off[0]


@pytest.mark.parametrize(("env", "contact"), [("SeaLegs/Leg-v0", False), ("SeaLegs/Hopper-v0", True)])
def test_the_parts_of_a_motors_torque_add_up(env, contact):
    mover = Mover(env)
    run = mover.run(tempo=2.0, seconds=0.7, amplitude=0.15)
    assert run.balance() < 1e-9
    assert mover.floating == contact and bool(np.abs(run.parts["contact"]).max() > 0.0) == contact
    verdict = judge(mover.names, [run])
    for name in mover.names:
        assert verdict.error[name] <= sum(verdict.shares[name][part] for part in verdict.left_out[name]) + 1e-12


@pytest.mark.long
def test_the_analysis_of_a_robot_is_one_command(tmp_path, capsys):
    evaluate.main(["relevant", "robot=bench", "seconds=0.8", "tempos=[2.0]", f"out={tmp_path / 'found'}"])
    found = json.loads((tmp_path / "found" / "relevant.json").read_text())
    assert found["most"]["joint"]["friction"] > 0.0 and max(found["balance"]) < 1e-6
    assert "can be left out" in capsys.readouterr().out
    assert (tmp_path / "found" / "shares.png").stat().st_size > 5000
    with pytest.raises(SealegsError, match="holds an analysis already"):
        evaluate.main(["relevant", "robot=bench", f"out={tmp_path / 'found'}"])
    with pytest.raises(SealegsError, match="say which robot"):
        evaluate.main(["relevant"])
