"""Contact switches on a machine: they come with the IMU's samples, reach policy and log, and a robot needs them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.commands import deploy
from sealegs.common.errors import SealegsError
from sealegs.configs.script import run as run_script
from sealegs.gap.log import read_measured
from sealegs.hw.bus.imu import ImuError
from sealegs.hw.bus.imu_chips import PLAIN, LineFormat, checked_part, open_imu
from sealegs.hw.run.policy import Policy
from sealegs.hw.virtual.server import Terminal

from tests.hw.test_imu_on_servos import Sender
from tests.servo_runs import PATIENT, gentle_policy
from tests.switched_dog import FEET, switched_file

COLUMNS = [f"switch.{leg}_foot" for leg in FEET]
STEPPED = "hw.virtual.time=stepped"


@pytest.fixture(scope="module")
def dog(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return switched_file(tmp_path_factory.mktemp("dog"))


@pytest.fixture(scope="module")
def policy(dog: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("policy") / "policy.onnx"
    return gentle_policy(path, "SeaLegs/Walk-v0", robot=str(dog), action_delay=0.0, switches=True)


def run(policy: Path, robot: Path, folder: Path, *arguments: str) -> int:
    """Exit status of a deployment."""
    words = [f"policy={policy}", f"robot={robot}", f"out={folder}", "name=run", "duration=1", *PATIENT, *arguments]
    return run_script(deploy.main, "deploy", "", words)


def test_a_policy_with_switches_runs_and_its_log_has_a_column_for_each(policy: Path, dog: Path, tmp_path: Path) -> None:
    sensors = Policy(policy).contract.sensors
    assert sensors == (*(f"floating_base.{turn}" for turn in ("roll", "pitch", "yaw")), *COLUMNS)
    assert run(policy, dog, tmp_path, STEPPED) == 0
    base = read_measured(tmp_path / "run.csv").runs[0].base
    closed = np.stack([base[name][1:] for name in COLUMNS], axis=1)
    assert np.isin(closed, (0.0, 1.0)).all() and closed.mean() > 0.8, "it stands"


def test_a_switch_that_needs_more_than_the_robot_weighs_stays_open(policy: Path, dog: Path, tmp_path: Path) -> None:
    assert run(policy, dog, tmp_path, STEPPED, "robot.imu.switches.hr_foot.threshold=500") == 0
    base = read_measured(tmp_path / "run.csv").runs[0].base
    assert np.nanmax(base["switch.hr_foot"]) == 0.0 and np.nanmean(base["switch.fl_foot"]) > 0.8


def test_a_robot_without_the_switches_is_refused_with_what_to_write(
    policy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for switches, missing in (({}, "fl_foot, switch.fr_foot"), ({"fl_foot": {"body": "fl2"}}, "fr_foot, switch.hl")):
        assert run(policy, switched_file(tmp_path, switches), tmp_path, STEPPED) == 2
        said = capsys.readouterr().err
        assert f"it needs the sensors switch.{missing}" in said and "which the robot lacks" in said
        assert f"such as imu: {{switches: {{{missing.partition(',')[0]}: {{body: <its foot>}}}}}}" in said


@pytest.mark.long
def test_in_real_time_the_switches_come_over_the_serial_line_of_the_imu(
    policy: Path, dog: Path, tmp_path: Path
) -> None:
    assert run(policy, dog, tmp_path, "robot.imu.silent=2.0") == 0
    base = read_measured(tmp_path / "run.csv").runs[0].base
    assert np.nanmean(base["switch.fl_foot"]) > 0.8


@pytest.mark.parametrize(
    ("line", "text"),
    [(None, "1, 0, 0, 0, 0, 0, 0, 0, 1\n"), (f"switch.b, _, {PLAIN}, switch.a", "1, 7, 1, 0, 0, 0, 0, 0, 0, 0.2\n")],
)
def test_a_line_names_its_switches_or_has_them_behind_the_rest(line: str | None, text: str) -> None:
    terminal = Terminal()
    part: dict[str, Any] = {"name": "serial", "port": terminal.path, **({} if line is None else {"line": line})}
    with Sender(terminal, text):
        imu = open_imu(part, 100.0, ["a", "b"])
        sample = imu.latest()
        imu.close()
    terminal.close()
    assert sample is not None and sample.switches.tolist() == [0.0, 1.0]


def test_a_line_or_a_chip_that_tells_of_no_switch_is_refused() -> None:
    with pytest.raises(ImuError, match=r"imu\.part\.line: it needs the contact switches of the robot: switch\.a\."):
        LineFormat.read(PLAIN, ["a"])
    with pytest.raises(SealegsError, match=r"a bno055 has no contact switches; .* \(imu\.part\.name=serial\)"):
        checked_part({"name": "bno055"}, ["a"])
