"""Short training runs, one of them of a second, here and in a process that can be killed, and what they leave."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from sealegs.commands import train
from sealegs.configs.script import run as run_script
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from tests.waiting import wait_until

REPOSITORY = Path(__file__).resolve().parents[2]

SMALL = [
    "env=bench",
    "n_envs=2",
    "agent.n_steps=64",
    "agent.batch_size=64",
    "agent.n_epochs=1",
    "agent.policy_kwargs.net_arch=[8]",
    "evaluate.every=256",
    "evaluate.episodes=2",
    "checkpoint.every=256",
    "video.seconds=0",
]


def run(*arguments: str) -> int:
    """Exit status of train.py in this process."""
    return run_script(train.main, "train", "", list(arguments))


def start(*arguments: str) -> subprocess.Popen[str]:
    """train.py in a process of its own."""
    command = [sys.executable, "train.py", *arguments]
    return subprocess.Popen(command, cwd=REPOSITORY, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def wait_for(path: Path, pattern: str, process: subprocess.Popen[str]) -> None:
    """Wait until ``path`` holds a file that fits ``pattern``."""
    wait_until(lambda: any(path.glob(pattern)), process, lambda: f"no {pattern} in {path}")


def killed(folder: Path) -> Path:
    """A run in ``folder`` that was killed after its first checkpoint."""
    process = start(*SMALL, f"out={folder.parent}", f"name={folder.name}", "total_timesteps=1000000")
    wait_for(folder / "checkpoints", "[0-9]*/state.json", process)
    process.kill()
    process.communicate()
    return folder


def steps(run_folder: Path) -> list[int]:
    """Steps of the complete checkpoints, oldest first."""
    return sorted(int(path.name) for path in (run_folder / "checkpoints").iterdir() if not path.name.startswith("."))


def events(run_folder: Path) -> EventAccumulator:
    """The run's event files, read by TensorBoard itself."""
    reader = EventAccumulator(str(run_folder / "tensorboard"))
    return reader.Reload()


def contents(folder: Path) -> dict[str, bytes]:
    """Every file below ``folder``."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


# --- trainings of a bench that take a second, run in the process of a test -------------------------------------------

SHORT = [
    "env=bench", "n_envs=2", "total_timesteps=128", "agent.n_steps=32", "agent.batch_size=32", "agent.n_epochs=1",
    "agent.policy_kwargs.net_arch=[8]", "evaluate.every=64", "evaluate.episodes=2", "video.seconds=0",
]  # fmt: skip
