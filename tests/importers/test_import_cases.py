"""Small recordings that were once read wrongly, and what the import makes of them now."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from sealegs.actuators import load_chain
from sealegs.gap.log import LogError, read_measured
from sealegs.gap.log.importers import import_logs, propose_for, read_mapping, read_recordings

from tests.importers.importing import ANGLE, LATE, RAD, TIME, asked, proposed, table

ONE = np.ones_like(TIME)


# --- files beside the checkout ---------------------------------------------------------------------------------------


@pytest.fixture
def cases(measured_data: Path) -> Path:
    folder = measured_data / "cases"
    if not folder.is_dir():
        pytest.skip(f"needs the small recordings in {folder.name} of the measured data beside the checkout")
    return folder


@pytest.mark.parametrize(
    ("name", "lines"),
    [
        ("list_cells_a/run.csv", {"joint0.position": "positions[0]", "joint1.goal": "targets[1]"}),
        ("list_cells_b/run.csv", {"joint0.position": "positions[0]", "joint1.goal": "targets[1]"}),
        ("json_runs/runs.json", {"time": "row/config.action_hz"}),
        ("moving_flag/run.csv", {"joint.torque": None}),
        ("pace_pt/chirp_data.pt", {"joint11.position": "dof_pos[11]", "joint0.goal": "des_dof_pos[0]"}),
        ("state_and_command", {"joint.position": "position_rad", "joint.goal": "goal_rad"}),
        ("repeated_stamp/run.csv", {"joint.position": "position", "joint.goal": "goal"}),
        ("zero_velocity_garbage_effort", {"j1.position": "joint_states.j1.position", "j1.velocity": None,
                                          "j2.torque": None}),
        ("registers/run.csv", {"joint.duty": "sign_bit(Present_Load, 10)*1e-3",
                               "joint.current": "sign_bit(Present_Current, 15)*0.0065",
                               "joint.velocity": "sign_bit(Present_Velocity, 15)*2*pi/4096", "joint.torque": None}),
    ],
)  # fmt: skip
def test_a_small_recording_is_read_as_it_is_meant(
    cases: Path, tmp_path: Path, name: str, lines: dict[str, str | None]
) -> None:
    columns = propose_for(cases / "headers" / name, tmp_path / "out").mapping.columns
    assert {column: columns.get(column) for column in lines} == lines


def test_each_row_of_a_bag_has_the_command_in_force_over_most_of_it(cases: Path, tmp_path: Path) -> None:
    """Commands 0.2 ms after the states went to the next row, 9.8 ms old."""
    found = propose_for(cases / "bag_offset" / "bag" / "train", tmp_path / "out", robot="bench", actuator="ideal")
    assert "commands of /joint_command come 0.2 ms (median) after the samples" in " ".join(found.text.split())
    import_logs(cases / "bag_offset" / "bag" / "train", tmp_path / "out", found.mapping)
    (run,), (wanted,) = (read_measured(folder).runs for folder in (tmp_path / "out", cases / "bag_offset" / "as_csv"))
    for joint, log in wanted.joints.items():
        goal = run.joints[joint].goal
        assert goal is not None and log.goal is not None
        np.testing.assert_allclose(goal, log.goal[-len(goal) :], atol=1e-7)


def test_the_mapping_of_so101_has_the_gain_that_its_publisher_set(measured_data: Path, tmp_path: Path) -> None:
    """It knew P 16, and wrote the chain of the factory's P 32."""
    import_logs(measured_data / "so101_arm" / "chirp_sweep.parquet", tmp_path / "out", read_mapping("so101"))
    said = yaml.safe_load((tmp_path / "out" / "log.yaml").read_text())["actuators"]
    assert {chain[1]["position_p"]["gain"] for chain in said.values()} == {2.65} and len(said) == 6


# --- gains -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("beside", [{}, {"dq_des": np.gradient(ANGLE, TIME)}])
def test_constant_gains_in_columns_make_the_chain_of_their_joint(tmp_path: Path, beside: dict[str, np.ndarray]) -> None:
    """Without a velocity or torque beside the goal they were left out."""
    columns = {"time": TIME, "q_des": ANGLE, "q": LATE, "kp": 40.5 * ONE, "kd": 2.0 * ONE}
    found = proposed(tmp_path, columns | beside)
    drive = {"stiffness": 40.5, "damping": 2.0} | ({"feedforward": 1} if beside else {})
    assert found.mapping.sidecar["actuators"] == {"joint": [{"ideal": drive}]}
    assert ("replace the chain under sidecar" in found.text) == (not beside)


@pytest.mark.parametrize(
    ("facts", "stiffness"),
    [({"kp": 12.0, "kd": 0.5}, "${kp}"), ({"kp": 32.0, "kd": 32.0, "motor": "mx64"}, None), ({"kp": 12.0}, None)],
)
def test_gains_of_a_recording_reach_a_chain_that_is_a_stiffness(
    tmp_path: Path, facts: dict[str, float | str], stiffness: str | None
) -> None:
    """``actuator=ideal`` kept its own numbers; a register of a known motor, or kp alone, is no stiffness."""
    source = table(tmp_path, {"time": TIME, **RAD})
    source.with_suffix(".meta.json").write_text(json.dumps(facts))
    found = propose_for(source, tmp_path / "out", robot="bench", actuator="ideal", params={"mass": 0.0}).mapping
    chain = found.sidecar["actuators"]["joint"]
    assert (chain if isinstance(chain, str) else chain[-1]["ideal"]["stiffness"]) == (stiffness or "ideal")
    import_logs(source, tmp_path / "out", found)
    if stiffness:
        chain = load_chain(read_measured(tmp_path / "out").runs[0].actuators["joint"])
        assert (chain.value("ideal.stiffness"), chain.value("ideal.damping")) == (12.0, 0.5)


# --- what is set aside by name ---------------------------------------------------------------------------------------


def test_a_gripper_in_percent_stays_one_beside_an_answer_in_degrees(tmp_path: Path) -> None:
    columns = {"time": TIME, "lift_goal": 40.0 * ANGLE, "lift_pos": 40.0 * LATE}
    columns |= {"gripper_goal": 50.0 + 60.0 * ANGLE, "gripper_pos": 50.0 + 60.0 * LATE}
    found = proposed(tmp_path, columns, "deg")
    assert found.mapping.columns["lift.position"] == "lift_pos*pi/180"
    assert set(asked(found)) == {"gripper.position", "gripper.goal"}


def test_a_value_beyond_anything_a_joint_can_have_is_set_aside_by_name(tmp_path: Path) -> None:
    torque = np.where(np.arange(len(TIME)) % 2, 1.04e224, 0.1)
    assert "torque: it holds 1.04e+224" in proposed(tmp_path, {"time": TIME, **RAD, "torque": torque}).text


@pytest.mark.parametrize("cell", ["=cmd|calc", "=A1*2", "@SUM(A1)"])
def test_formulas_of_a_spreadsheet_are_not_computed_and_called_so(tmp_path: Path, cell: str) -> None:
    """They were 'text', or a file 'without a header line'."""
    rows = "".join(f"{t:.2f},{g:.4f},{cell}\n" for t, g in zip(TIME, ANGLE, strict=True))
    (tmp_path / "run.csv").write_text(f"time_s,goal_rad,pos_rad\n{rows}")
    found = propose_for(tmp_path / "run.csv", tmp_path / "out")
    assert (
        "pos_rad: 'it holds formulas of a spreadsheet" in found.text and "joint.position" not in found.mapping.columns
    )
    (tmp_path / "bare.csv").write_text(f"{cell},{cell}\n" * 20)
    with pytest.raises(LogError, match="holds formulas of a spreadsheet, which are not computed; export values"):
        read_recordings(tmp_path / "bare.csv")
