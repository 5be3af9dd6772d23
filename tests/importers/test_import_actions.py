"""Actions of a policy beside goals, and beside positions that stand a default angle away."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat
from sealegs.gap.log.importers import read_recordings
from sealegs.gap.log.importers.proposal import propose
from sealegs.gap.log.importers.proposed import Proposal

from tests.importers.test_import import motion

DEFAULTS = (0.1, 0.8, -1.5)
MADE = [motion(10.0, 50.0, 0.04, seed=seed) for seed in (3, 4, 5)]


def _proposed(path: Path, columns: Mapping[str, np.ndarray]) -> Proposal:
    table = {"time": MADE[0]["time"], **columns}
    np.savetxt(path / "run.csv", np.stack([*table.values()], axis=1), delimiter=",", header=",".join(table),
               comments="", fmt="%.6f")  # fmt: skip
    return propose(read_recordings(path / "run.csv"))


def _positions(name: str) -> dict[str, np.ndarray]:
    return {name.format(k): made["smooth"] + DEFAULTS[k] for k, made in enumerate(MADE)}


@pytest.mark.parametrize("target", ["dof_target_{}", "joint_pos_setpoints_{}"])
def test_a_target_goes_before_an_action(tmp_path: Path, target: str) -> None:
    """``actions_0`` has the shorter name; it stands 0.8 rad from the position."""
    columns = _positions("dof_pos_{}")
    for k, made in enumerate(MADE):
        columns |= {target.format(k): made["goal"] + DEFAULTS[k], f"actions_{k}": made["goal"]}
    found = _proposed(tmp_path, columns)
    assert [found.columns[f"joint{k}.goal"].text for k in range(3)] == [target.format(k) for k in range(3)]
    assert not found.questions


def test_a_default_angle_between_actions_and_positions_is_asked_about_for_all_of_them(tmp_path: Path) -> None:
    columns = _positions("joint_pos[{}]") | {f"actions[{k}]": made["goal"] for k, made in enumerate(MADE)}
    found = _proposed(tmp_path, columns)
    assert len(found.questions) == 1
    assert set(found.questions[0].about) == {f"joint{k}.goal" for k in range(3)}
    assert found.columns["joint2.goal"].text.replace("`", "") == "-1.5 + actions[2]"


def test_actions_that_are_goals_stay_unasked(tmp_path: Path) -> None:
    columns = {f"joint_pos[{k}]": made["smooth"] for k, made in enumerate(MADE)}
    columns |= {f"actions[{k}]": made["goal"] for k, made in enumerate(MADE)}
    assert not _proposed(tmp_path, columns).questions


def test_one_scaled_action_among_many_asks_about_itself_alone(tmp_path: Path) -> None:
    """A gripper in another unit says nothing of the arm."""
    columns = {f"joint_pos[{k}]": made["smooth"] for k, made in enumerate(MADE)}
    columns |= {f"actions[{k}]": made["goal"] * (4.0 if k == 2 else 1.0) for k, made in enumerate(MADE)}
    found = _proposed(tmp_path, columns)
    assert [question.about for question in found.questions] == [("joint2.goal",)]


def test_axes_of_a_kuka_have_their_torque(tmp_path: Path) -> None:
    columns: dict[str, np.ndarray] = {}
    for k, made in enumerate(MADE, 1):
        columns[f"AxisSoll_A{k} [deg]"] = 57.3 * made["goal"]
        columns[f"AxisIst_A{k} [deg]"] = 57.3 * made["smooth"]
        columns[f"Torque_A{k} [Nm]"] = np.cos(made["time"])
    found = _proposed(tmp_path, columns)
    assert {f"A{k}.{signal}" for k in (1, 2, 3) for signal in ("goal", "position", "torque")} <= found.columns.keys()


@pytest.mark.parametrize("beside", [True, False])
def test_the_clock_of_a_position_in_matlab_is_no_joint(tmp_path: Path, beside: bool) -> None:
    """``pos.Time`` beside ``pos.Data`` was taken for the position of a joint ``Time``."""
    made = MADE[0]
    content = {
        "pos": {"Time": made["time"], "Data": made["smooth"]},
        "cmd": {"Time": made["time"][::5], "Data": made["goal"][::5]},
    }
    if beside:
        content["cur"] = {"Time": made["time"], "Data": np.cos(made["time"])}
    savemat(tmp_path / "run.mat", content)
    found = propose(read_recordings(tmp_path / "run.mat"))
    assert found.joints == ["joint"]
    assert found.columns["time"].text == ("cur.Time" if beside else "Time")
    assert found.columns["joint.goal"].text == "cmd.Data"
