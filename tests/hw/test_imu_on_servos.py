"""An IMU on a machine: its samples reach policy and log, and a run ends where the robot falls or the IMU is silent."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation
from sealegs.commands import deploy
from sealegs.configs.script import run as run_script
from sealegs.gap.log import read_measured
from sealegs.hw.run.measured_log import read_events
from sealegs.hw.run.policy import Policy

from tests.servo_runs import PATIENT, gentle_policy

ROBOTS = Path(__file__).resolve().parents[1] / "robots"
DOG, STAND = ROBOTS / "dog.yaml", f"{ROBOTS / 'stand.py'}:Stand"
STEPPED = "hw.virtual.time=stepped"


@pytest.fixture(scope="module")
def policy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("policy") / "policy.onnx"
    return gentle_policy(path, STAND, robot=str(DOG), action_delay=0.0)


def run(policy: Path, folder: Path, *arguments: str, robot: Path = DOG) -> int:
    """Exit status of a deployment."""
    words = [f"policy={policy}", f"task={STAND}", f"robot={robot}", f"out={folder}", "name=run", *PATIENT, *arguments]
    return run_script(deploy.main, "deploy", "", [*words, *([] if "duration" in str(arguments) else ["duration=2"])])


def changed(folder: Path, **keys: Any) -> Path:
    """The dog's file with other keys; None takes one out."""
    document = {**yaml.safe_load(DOG.read_text()), "model": str(ROBOTS / "dog.xml"), "name": "dog", **keys}
    path = folder / "dog.yaml"
    path.write_text(yaml.safe_dump({key: value for key, value in document.items() if value is not None}))
    return path


def test_the_contract_says_that_the_policy_needs_to_know_how_the_base_turns(policy: Path) -> None:
    sensors = Policy(policy, STAND).contract.sensors
    assert sensors == ("floating_base.roll", "floating_base.pitch", "floating_base.yaw")


def test_a_policy_with_tilt_and_turn_rate_runs_and_its_log_has_what_the_imu_said(policy: Path, tmp_path: Path) -> None:
    assert run(policy, tmp_path, STEPPED) == 0
    log = read_measured(tmp_path / "run.csv").runs[0]
    turn = np.stack([log.base[f"imu.{key}"] for key in "wxyz"], axis=1)
    assert np.isfinite(turn[1:]).all() and np.abs(np.linalg.norm(turn[1:], axis=1) - 1.0).max() < 1e-5
    lean = Rotation.from_quat(turn[1:], scalar_first=True).apply([0.0, 0.0, 1.0])[:, 2]
    assert lean.min() > 0.95, "it stands"
    assert (np.abs(log.base["imu.age"][1:]) < 0.02).all() and log.meta["imu"]["site"] == "imu"


def test_a_robot_without_an_imu_is_refused_with_what_to_write(
    policy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(policy, tmp_path, STEPPED, robot=changed(tmp_path, imu=None)) == 2
    said = capsys.readouterr().err
    assert "an IMU gives floating_base.roll, floating_base.pitch, floating_base.yaw" in said
    assert "imu: {rate: 100}" in said


def test_a_policy_that_was_trained_before_the_robot_had_an_imu_runs_with_one(tmp_path: Path) -> None:
    """A walking policy was refused: its tilt and turn rate had to come from encoders with ids of servos."""
    bare = changed(tmp_path, imu=None)
    trained = gentle_policy(tmp_path / "policy.onnx", STAND, robot=str(bare))
    bare.unlink()
    assert run(trained, tmp_path / "log", STEPPED, "duration=0.2") == 0


def test_a_run_ends_where_the_imu_falls_silent(
    policy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "faults.yaml").write_text("- {kind: imu_silence, at: 1.5}\n")
    assert run(policy, tmp_path, STEPPED, f"hw.virtual.faults={tmp_path / 'faults.yaml'}", "duration=5") == 2
    assert "STOP: the IMU gave no sample for" in capsys.readouterr().err
    events = {event["event"]: event for event in read_events(tmp_path / "run.csv")}
    assert events["fault"]["name"] == "imu" and "at rest" in events


def test_a_short_silence_is_borne(policy: Path, tmp_path: Path) -> None:
    (tmp_path / "faults.yaml").write_text("- {kind: imu_silence, at: 1.5, seconds: 0.04}\n")
    assert run(policy, tmp_path, STEPPED, f"hw.virtual.faults={tmp_path / 'faults.yaml'}") == 0
    empty = np.isnan(read_measured(tmp_path / "run.csv").runs[0].base["imu.w"])
    assert 1 <= empty[1:].sum() <= 4, "rows without a new sample have none"


def test_a_robot_that_falls_is_released(policy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(policy, tmp_path, STEPPED, "robot.imu.fallen=0.001") == 2
    said = capsys.readouterr().err
    assert "the robot has fallen: it leans by" in said and "0.001 rad are tolerated" in said and "released" in said


def test_the_machine_may_hide_that_its_imu_is_turned(policy: Path, tmp_path: Path) -> None:
    (tmp_path / "hidden.yaml").write_text("imu.rotation: [0.0, 0.2, 0.0]\nimu.noise.orientation: 0.0\n")
    for name, more in (("plain", []), ("turned", [f"hw.virtual.hidden={tmp_path / 'hidden.yaml'}"])):
        assert run(policy, tmp_path / name, STEPPED, "robot.imu.bias.orientation=0", "duration=0.5", *more) == 0
    pitch = []
    for name in ("plain", "turned"):
        log = read_measured(tmp_path / name / "run.csv").runs[0]
        turn = Rotation.from_quat(np.stack([log.base[f"imu.{k}"][1:] for k in "wxyz"], axis=1), scalar_first=True)
        pitch.append(turn.inv().apply([0.0, 0.0, -1.0])[5])
    # the site is turned by a quarter: a turn about the IMU's y axis is one about the base's -x axis
    assert pitch[1][1] - pitch[0][1] == pytest.approx(np.sin(0.2), abs=0.03)
    assert abs(pitch[1][0] - pitch[0][0]) < 0.03


@pytest.mark.parametrize("line", ["imu.dely: 0.1", "imu.delay: -1", "imu.rotation: 3"])
def test_what_no_imu_hides_is_refused(
    policy: Path, tmp_path: Path, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "hidden.yaml").write_text(line + "\n")
    assert run(policy, tmp_path, STEPPED, f"hw.virtual.hidden={tmp_path / 'hidden.yaml'}") == 2
    said = capsys.readouterr().err
    assert "imu." in said and said.strip().count("\n") == 0


@pytest.mark.long
def test_in_real_time_the_samples_come_over_a_serial_line(policy: Path, tmp_path: Path) -> None:
    assert run(policy, tmp_path, "robot.imu.silent=2.0") == 0
    log = read_measured(tmp_path / "run.csv").runs[0]
    assert np.isfinite(log.base["imu.w"]).mean() > 0.5
