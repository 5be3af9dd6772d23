"""Copies of a run's actuation chains, so that later changes of a chain's or net's file do not reach the run."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import yaml

from ..common.errors import SealegsError
from ..envs.engine.batch import BatchEngine
from ..envs.engine.sb3 import BatchVecEnv
from .run_folder import RunFolder

_FILE = "actuators.yaml"


def chains(engine: BatchEngine) -> dict[str, list[dict[str, Any]]]:
    """Stages of the chain on each joint, whatever name or path was given."""
    return {name: chain.to_list() for name, chain in engine.chains.items()}


def write_chains(run: RunFolder, env: BatchVecEnv) -> None:
    """Write ``actuators.yaml``, and copies of the nets that the chains name."""
    kept = chains(env.engine)
    for joint, net in _nets(kept):
        original = Path(net["file"])
        net["file"] = f"{joint}-{original.name}"
        shutil.copyfile(original, run.path / net["file"])
    run.write_text(_FILE, yaml.safe_dump(kept, sort_keys=False))


def read_chains(run: RunFolder) -> dict[str, Any]:
    """Chains by joint, as an environment takes them.

    Raises:
        SealegsError: the file is gone, or was damaged.
    """
    kept = run.read_yaml(_FILE)
    for _, net in _nets(kept):
        if Path(str(net["file"])).name != net["file"]:
            raise SealegsError(f"{run.path / _FILE} names the net {net['file']}; a run's nets lie in its folder.")
        net["file"] = str((run.path / net["file"]).resolve())
    return kept


def _nets(kept: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    return [
        (joint, stage["net"])
        for joint, stages in kept.items()
        for stage in (stages if isinstance(stages, list) else [])
        if isinstance(stage, dict) and isinstance(stage.get("net"), dict) and "file" in stage["net"]
    ]
