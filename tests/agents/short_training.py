"""Trainings of a bench that take a second, run in the process of a test."""

from __future__ import annotations

from sealegs.commands import train
from sealegs.configs.script import run as run_script

SMALL = [
    "env=bench", "n_envs=2", "total_timesteps=128", "agent.n_steps=32", "agent.batch_size=32", "agent.n_epochs=1",
    "agent.policy_kwargs.net_arch=[8]", "evaluate.every=64", "evaluate.episodes=2", "video.seconds=0",
]  # fmt: skip


def run(*arguments: str) -> int:
    """Exit status of train.py in this process."""
    return run_script(train.main, "train", "", list(arguments))
