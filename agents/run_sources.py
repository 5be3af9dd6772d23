"""Digests of the files that a run learns from: its robot's, and its own task's. On others it would be another run."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from ..common.documents import read_yaml
from ..common.errors import SealegsError
from ..envs.any_robot.user import file_of, is_user_task
from ..envs.described.robot_described import RobotFile
from ..envs.described.robot_sources import files_read
from ..envs.engine.sb3 import BatchVecEnv
from .run_folder import RunFolder

_FILE = "sources.json"


def write_sources(run: RunFolder, env_id: str, env: BatchVecEnv) -> None:
    """Write ``sources.json``."""
    run.write_text(_FILE, json.dumps(_digests(env_id, env), indent=2))


def check_sources(run: RunFolder, env_id: str, env: BatchVecEnv) -> None:
    """Refuse to go on with files that have changed; a run of an earlier version has no digests, and goes on.

    Raises:
        SealegsError: a file is another than the run began with; the message names it.
    """
    if not (run.path / _FILE).is_file():
        return
    before, now = run.read_yaml(_FILE), _digests(env_id, env)
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
