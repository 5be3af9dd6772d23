"""A run goes on with the robot and the task that it began with, and says which file is another."""

import shutil
from pathlib import Path

import pytest

from tests.agents.test_train import SMALL, run

ROBOTS = Path(__file__).parents[1] / "robots"
TASK = """
from dataclasses import dataclass
from sealegs.envs.any_robot.reach import ReachTask

@dataclass(frozen=True)
class Mine(ReachTask):
    episode_steps = 50
"""


def begun(folder: Path, task: str = "") -> Path:
    """A run of an arm of its own, perhaps with a task of its own, stopped at step 128."""
    for name in ("arm.xml", "arm.yaml"):
        shutil.copy(ROBOTS / name, folder / name)
    small = [item for item in SMALL if item != "env=bench"]
    asked = [f"env={folder / 'mine.py'}:Mine"] if task else []
    if task:
        (folder / "mine.py").write_text(task)
    arguments = [*asked, f"robot={folder / 'arm.yaml'}", f"out={folder}", "name=run", "total_timesteps=128"]
    assert run(*small, *arguments) == 0
    return folder / "run"


def changed(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "old", "new"),
    [("arm.xml", 'mass="0.1"', 'mass="0.2"'), ("arm.yaml", "timestep: 0.002", "timestep: 0.001")],
)
def test_a_run_does_not_go_on_with_another_robot(tmp_path: Path, capsys, name: str, old: str, new: str) -> None:
    folder = begun(tmp_path)
    changed(tmp_path / name, old, new)
    assert run(f"resume={folder}", "total_timesteps=256") == 2
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert f"{tmp_path / name} has changed since {folder} began" in error and "start a new run" in error
    changed(tmp_path / name, new, old)
    assert run(f"resume={folder}", "total_timesteps=256") == 0


@pytest.mark.long
def test_a_run_does_not_go_on_with_another_task(tmp_path: Path, capsys) -> None:
    folder = begun(tmp_path, TASK)
    changed(tmp_path / "mine.py", "50", "60")
    assert run(f"resume={folder}", "total_timesteps=256") == 2
    assert f"{tmp_path / 'mine.py'} has changed since" in capsys.readouterr().err


@pytest.mark.long
def test_servos_and_comments_of_a_robot_may_change_in_a_run(tmp_path: Path) -> None:
    folder = begun(tmp_path)
    changed(tmp_path / "arm.yaml", "joints:", "# mounted on Monday\ndeploy: {}\njoints:")
    assert run(f"resume={folder}", "total_timesteps=256") == 0


@pytest.mark.long
def test_a_run_of_an_earlier_version_goes_on(tmp_path: Path) -> None:
    folder = begun(tmp_path)
    (folder / "sources.json").unlink()
    changed(tmp_path / "arm.xml", 'mass="0.1"', 'mass="0.2"')
    assert run(f"resume={folder}", "total_timesteps=256") == 0
