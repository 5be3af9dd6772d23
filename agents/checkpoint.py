"""Checkpoints: written as a whole or not at all, and read from the newest that is readable."""

from __future__ import annotations

import json
import pickle
import sys
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from ..actuators.errors import SealegsError
from ..common.documents import read_json
from .algorithms import algorithm
from .policy_files import save_policy
from .run_folder import RunFolder

_BUFFERS_KEPT = 2  # a buffer is large, and the older ones are needed only where the newest checkpoint is damaged
_BUFFER, _STATE = "replay_buffer.pkl", "state.json"


def save_checkpoint(
    run: RunFolder, model: BaseAlgorithm, description: dict[str, Any], evaluations: Mapping[str, Any]
) -> Path:
    """Write ``checkpoints/<steps>``.

    Once it is complete, the replay buffers of older checkpoints are deleted, except that of the one before, which is
    kept in case the newest cannot be read.

    Raises:
        OSError: the disk is full; earlier checkpoints stay.
    """
    name = f"checkpoints/{model.num_timesteps:012d}"
    with run.writing(name) as folder:
        save_policy(folder, model, description)
        if isinstance(model, OffPolicyAlgorithm):
            model.save_replay_buffer(folder / _BUFFER)
        (folder / _STATE).write_text(_state(model.num_timesteps, evaluations))
    newest = run.path / name
    reached = [path for path in checkpoints(run) if path.name <= newest.name]  # not one that was found damaged
    for older in reached[_BUFFERS_KEPT:]:
        (older / _BUFFER).unlink(missing_ok=True)
    return newest


def save_evaluations(run: RunFolder, step: int, evaluations: Mapping[str, Any]) -> None:
    """Add evaluations to the checkpoint at ``step``, which was written before the last of them."""
    run.write_text(f"checkpoints/{step:012d}/{_STATE}", _state(step, evaluations))


def checkpoints(run: RunFolder) -> list[Path]:
    """Complete checkpoints, newest first."""
    return sorted((path for path in (run.path / "checkpoints").glob("[0-9]*") if path.is_dir()), reverse=True)


def load_newest(run: RunFolder, agent: Mapping[str, Any], env: VecEnv) -> tuple[BaseAlgorithm, dict[str, Any]] | None:
    """Learner and evaluations of the newest readable checkpoint; None if the run has no checkpoint.

    ``env`` comes without a normaliser; the checkpoint's is put around it.

    Raises:
        SealegsError: there are checkpoints, but none can be read.
    """
    found = checkpoints(run)
    for path in found:
        try:
            return _load(path, agent, env)
        except (
            OSError,
            ValueError,
            RuntimeError,
            KeyError,
            EOFError,
            pickle.UnpicklingError,
            zipfile.BadZipFile,
            zlib.error,
        ) as error:
            reason = str(error).strip().partition("\n")[0] or type(error).__name__
            print(f"Checkpoint {path.name} cannot be read ({reason}); trying the one before it.", file=sys.stderr)
    if found:
        raise SealegsError(f"No checkpoint in {run.path / 'checkpoints'} can be read: start the run anew.")
    return None


def _state(step: int, evaluations: Mapping[str, Any]) -> str:
    return json.dumps({"step": step, "evaluations": dict(evaluations)})


def _load(path: Path, agent: Mapping[str, Any], env: VecEnv) -> tuple[BaseAlgorithm, dict[str, Any]]:
    state = read_json(path / _STATE)
    normalizer = path / "vecnormalize.pkl"
    wrapped = VecNormalize.load(str(normalizer), env) if normalizer.is_file() else env
    model = algorithm(agent["algorithm"]).load(path / "model.zip", env=wrapped)
    if isinstance(model, OffPolicyAlgorithm):
        if (path / _BUFFER).is_file():
            model.load_replay_buffer(path / _BUFFER)
        else:
            print(f"Checkpoint {path.name} has no replay buffer any more: it is filled anew.", file=sys.stderr)
            model.learning_starts += model.num_timesteps  # no update from a handful of steps
    return model, state["evaluations"]
