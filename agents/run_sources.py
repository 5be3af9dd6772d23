"""What a run learns from: digests of the files of its robot and its own task, and copies of its actuation chains.

With other files it would be another run; later changes of the file of a chain or net do not reach it.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from ..common.documents import read_yaml
from ..common.errors import SealegsError
from ..envs.any_robot.user import file_of, is_user_task
from ..envs.described.robot_described import RobotFile
from ..envs.described.robot_sources import files_read
from ..envs.engine.batch import BatchEngine
from ..envs.engine.sb3 import BatchVecEnv
from .run_folder import RunFolder

SOURCES_FILE, CHAINS_FILE = "sources.json", "actuators.yaml"


def write_sources(run: RunFolder, env_id: str, env: BatchVecEnv) -> None:
    """Write ``sources.json``."""
    run.write_text(SOURCES_FILE, json.dumps(_digests(env_id, env), indent=2))


def check_sources(run: RunFolder, env_id: str, env: BatchVecEnv) -> None:
    """Refuse to go on with files that have changed; a run of an earlier version has no digests, and goes on.

    Raises:
        SealegsError: a file is another than the run began with; the message names it.
    """
    if not (run.path / SOURCES_FILE).is_file():
        return
    before, now = run.read_yaml(SOURCES_FILE), _digests(env_id, env)
    if sorted(map(str, before.values())) == sorted(now.values()):  # the same files, perhaps in another place
        return
    changed = sorted(path for path in {**before, **now} if before.get(path) != now.get(path))
    if changed:
        verb = "have" if len(changed) > 1 else "has"
        raise SealegsError(
            f"{', '.join(changed)} {verb} changed since {run.path} began, and a run keeps its robot and task: start a "
            "new run, or put back what was there."
        )


def _digests(env_id: str, env: BatchVecEnv) -> dict[str, str]:
    """By path, of the files of a task and of its robot; what is part of the package has none."""
    files = [file_of(env_id)] if is_user_task(env_id) else []
    robot = env.engine.task.robot.file
    said = {}
    if robot is not None:
        files += files_read([str(robot.model.path)])
        said = {} if robot.path == robot.model.path else {str(robot.path.resolve()): _said(robot)}
    return {str(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in files} | said


def _said(robot: RobotFile) -> str:
    """Digest of what a robot's YAML says to a training: not of servos, nor of chains, which a run has copies of."""
    document = dict(read_yaml(robot.path))
    document.pop("deploy", None)
    joints = document.get("joints") or {}
    document["joints"] = {name: _of_joint(row or {}) for name, row in joints.items()}
    return hashlib.sha256(json.dumps(document, sort_keys=True, default=str).encode()).hexdigest()


def _of_joint(row: Mapping[str, Any]) -> dict[str, Any]:
    # whether there is a chain decides whose numbers count
    kept = {key: value for key, value in row.items() if key not in ("chain", "servo", "unknown")}
    return {**kept, "chain": row.get("chain") is not None}


# --- chains ----------------------------------------------------------------------------------------------------------


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
    run.write_text(CHAINS_FILE, yaml.safe_dump(kept, sort_keys=False))


def read_chains(run: RunFolder) -> dict[str, Any]:
    """Chains by joint, as an environment takes them.

    Raises:
        SealegsError: the file is gone, or was damaged.
    """
    kept = run.read_yaml(CHAINS_FILE)
    for _, net in _nets(kept):
        if Path(str(net["file"])).name != net["file"]:
            raise SealegsError(f"{run.path / CHAINS_FILE} names the net {net['file']}; a run's nets lie in its folder.")
        net["file"] = str((run.path / net["file"]).resolve())
    return kept


def _nets(kept: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    return [
        (joint, stage["net"])
        for joint, stages in kept.items()
        for stage in (stages if isinstance(stages, list) else [])
        if isinstance(stage, dict) and isinstance(stage.get("net"), dict) and "file" in stage["net"]
    ]
