"""What an import asks about and never takes: units and goals that nobody says, actions that are no goals."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from sealegs.gap.checks.columns import check_columns
from sealegs.gap.checks.context import joint_contexts
from sealegs.gap.log.importers import propose_for, read_recordings
from sealegs.gap.log.importers.proposal import Proposal, propose
from sealegs.gap.log.types import JointLog, MeasuredRun

from tests.importers.importing import ANGLE, LATE, TIME, asked, proposed, table
from tests.importers.test_import import motion

A_TURN = 2.0 * np.pi
OTHER = 0.5 * np.cos(3.3 * TIME) + 0.2 * np.sin(7.7 * TIME)
OTHER_LATE = 0.5 * np.cos(3.3 * (TIME - 0.04)) + 0.2 * np.sin(7.7 * (TIME - 0.04))


def test_without_a_time_gains_still_make_a_chain(tmp_path: Path) -> None:
    one = np.ones_like(TIME)
    columns = {"q": LATE, "q_des": ANGLE, "dq_des": 10.0 * np.gradient(ANGLE, TIME), "kp": 40.0 * one, "kd": 2.0 * one}
    assert "stiffness: 40.0" in proposed(tmp_path, columns, timed=False).text


def test_a_slow_joint_and_one_at_rest_are_not_asked_about(tmp_path: Path) -> None:
    steps = np.where(TIME % 6.0 < 3.0, 0.5, -0.5)
    slow = np.zeros_like(TIME)
    for k in range(1, len(TIME)):
        slow[k] = slow[k - 1] + 0.01 / 1.0 * (steps[k - 1] - slow[k - 1])
    noise = 1e-3 * np.random.default_rng(0).standard_normal(len(TIME))
    for position in (slow, noise):
        assert "joint.goal" not in asked(proposed(tmp_path, {"time": TIME, "q_des": steps, "q": position}))


def test_a_swing_goes_along_with_its_goal_rather_than_against_it_half_a_period_earlier(tmp_path: Path) -> None:
    goal, position = (np.sin(9.0 * (TIME - late)) for late in (0.0, 0.04))
    assert "joint.goal" not in asked(proposed(tmp_path, {"time": TIME, "q_des": goal, "q": position}))


def commanded(scale: float) -> list[tuple[str, str | None, bool]]:
    log = JointLog(position=LATE, goal=ANGLE, goal_velocity=scale * np.gradient(ANGLE, TIME))
    run = MeasuredRun(name="run", time=TIME, joints={"j": log}, meta={}, actuators={})
    return [(f.code, f.column, f.data_error) for f in check_columns(joint_contexts(run)[0])]


@pytest.mark.parametrize("scale", [180.0 / np.pi, 60.0 / A_TURN, 1.0 / A_TURN])
def test_a_commanded_velocity_in_another_unit_is_found(scale: float) -> None:
    assert commanded(scale) == [("unit.velocity", "j.goal_velocity", True)]


def test_a_commanded_velocity_in_another_ratio_stays_and_is_told() -> None:
    assert [commanded(scale) for scale in (1.0, 0.7)] == [[], []]
    assert [commanded(scale) for scale in (30.0, -1.0)] == [[("goal_velocity.scale", "j.goal_velocity", False)]] * 2


FAST = np.gradient(LATE, TIME)


def sized(sizes: dict[str, float], form: str = "{}_{}") -> dict[str, np.ndarray]:
    """Goal and position of several sized, by how far each moves beside the angle of the tests."""
    columns = {"time_s": TIME}
    for joint, size in sizes.items():
        columns |= {form.format("goal", joint): size * ANGLE, form.format("pos", joint): size * LATE}
    return columns


def test_an_encoder_of_one_joint_tells_the_unit_of_those_that_are_called_alike(tmp_path: Path) -> None:
    columns = sized({"0": 60.0, "1": 3.0})
    columns["pos_0"] = np.round(columns["pos_0"] / (360.0 / 4096)) * 360.0 / 4096
    found = propose_for(table(tmp_path, columns), tmp_path / "out")
    assert not found.mapping.questions and found.mapping.columns["joint1.goal"] == "goal_1*pi/180"
    assert "in the unit of pos_0, whose steps are an encoder's" in " ".join(found.text.replace("#", "").split())


@pytest.mark.parametrize("last", ["gripper", "opening"])
def test_a_share_or_an_opening_of_a_gripper_decides_nothing_for_the_arm(tmp_path: Path, last: str) -> None:
    for low, high in ((0.0, 100.0), (0.0, 1.0)):
        columns = sized({"shoulder": 1.5, "elbow": 1.0})
        share = (LATE - LATE.min()) / np.ptp(LATE)
        columns |= {f"goal_{last}": low + high * np.roll(share, -4), f"pos_{last}": low + high * share}
        (question,) = propose_for(table(tmp_path, columns), tmp_path / "out", "rad").mapping.questions
        assert question.about == (f"{last}.position", f"{last}.goal") and "a share of the calibrated" in question.ask


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_an_opening_from_0_to_1_is_asked_about_where_other_joints_are_angles(tmp_path: Path, unit: str) -> None:
    """``unit=rad`` took the grippers of an ALOHA for rad."""
    columns = sized({"waist": 60.0 if unit == "deg" else 1.0})
    share = (LATE - LATE.min()) / np.ptp(LATE)
    columns |= {"goal_gripper": np.roll(share, -4), "pos_gripper": share}
    (question,) = propose_for(table(tmp_path, columns), tmp_path / "out", unit).mapping.questions
    assert question.about == ("gripper.position", "gripper.goal") and "opening of 0..1" in question.ask
    columns = sized({"waist": 1.0, "elbow": 1.0})
    columns |= {"goal_elbow": 0.4 + 0.3 * ANGLE, "pos_elbow": 0.4 + 0.3 * LATE}
    assert not propose_for(table(tmp_path, columns), tmp_path / "out", "rad").mapping.questions, "an elbow within 0..1"


DEFAULTS = (0.1, 0.8, -1.5)
MADE = [motion(10.0, 50.0, 0.04, seed=seed) for seed in (3, 4, 5)]


def _proposed(path: Path, columns: Mapping[str, np.ndarray]) -> Proposal:
    table = {"time": MADE[0]["time"], **columns}
    np.savetxt(path / "run.csv", np.stack([*table.values()], axis=1), delimiter=",", header=",".join(table),
               comments="", fmt="%.6f")  # fmt: skip
    return propose(read_recordings(path / "run.csv"))


def _positions(name: str) -> dict[str, np.ndarray]:
    return {name.format(k): made["smooth"] + DEFAULTS[k] for k, made in enumerate(MADE)}
