"""Checkpoints: written as a whole or not at all, and read from the newest that is readable."""

from __future__ import annotations

import json
import sys
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from ..common.documents import read_json
from ..common.errors import SealegsError
from .algorithms import build, wrapped
from .policy_files import save_policy
from .run_folder import RunFolder
from .weights import (
    FILE,
    UntrustedError,
    check_like,
    is_jax,
    loaded,
    read_tensors,
    read_zip,
    restore,
    states,
    untrusted,
    write_tensors,
)

_BUFFERS_KEPT = 2  # a buffer is large, and the older ones are needed only where the newest checkpoint is damaged
_LEARNER, _BUFFER, _STATE = "learner.safetensors", "replay_buffer.safetensors", "state.json"
_PICKLED_BUFFER = "replay_buffer.pkl"  # of earlier versions, as their model.zip and vecnormalize.pkl
_COUNTS = ("num_timesteps", "_n_updates", "_episode_num", "learning_starts")  # the last two of algorithms with a buffer
_MOMENTS = {"RMSpropTFLike": ("square_avg",), "RMSprop": ("square_avg",)}
"""What an optimiser remembers of a parameter, beside its step."""
_ROWS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


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
        _write_learner(folder / _LEARNER, model)
        if isinstance(model, OffPolicyAlgorithm):
            _write_buffer(folder / _BUFFER, model)
        (folder / _STATE).write_text(_state(model.num_timesteps, evaluations))
    newest = run.path / name
    reached = [path for path in checkpoints(run) if path.name <= newest.name]  # not one that was found damaged
    for older in reached[_BUFFERS_KEPT:]:
        for file in (_BUFFER, _PICKLED_BUFFER):
            (older / file).unlink(missing_ok=True)
    return newest


def save_evaluations(run: RunFolder, step: int, evaluations: Mapping[str, Any]) -> None:
    """Add evaluations to the checkpoint at ``step``, which was written before the last of them."""
    run.write_text(f"checkpoints/{step:012d}/{_STATE}", _state(step, evaluations))


def checkpoints(run: RunFolder) -> list[Path]:
    """Complete checkpoints, newest first."""
    return sorted((path for path in (run.path / "checkpoints").glob("[0-9]*") if path.is_dir()), reverse=True)


def load_newest(
    run: RunFolder, agent: Mapping[str, Any], env: VecEnv, trust: bool = False
) -> tuple[BaseAlgorithm, dict[str, Any]] | None:
    """Learner and evaluations of the newest readable checkpoint; None if the run has no checkpoint.

    ``env`` comes without a normaliser; the checkpoint's is put around it. With ``trust``, pickles of earlier versions
    are read where a checkpoint has nothing else.

    Raises:
        UntrustedError: the newest checkpoint has nothing but pickles, and nobody said to trust them.
        SealegsError: there are checkpoints, but none can be read.
    """
    found = checkpoints(run)
    for path in found:
        try:
            return _load(path, agent, env, trust)
        except UntrustedError:
            raise
        except (OSError, ValueError, LookupError, TypeError) as error:
            reason = str(error).strip().partition("\n")[0].rstrip(".") or type(error).__name__
            print(f"Checkpoint {path.name} cannot be read ({reason}); trying the one before it.", file=sys.stderr)
    if found:
        raise SealegsError(f"No checkpoint in {run.path / 'checkpoints'} can be read: start the run anew.")
    return None


def _state(step: int, evaluations: Mapping[str, Any]) -> str:
    return json.dumps({"step": step, "evaluations": dict(evaluations)})


def _load(path: Path, agent: Mapping[str, Any], env: VecEnv, trust: bool) -> tuple[BaseAlgorithm, dict[str, Any]]:
    evaluations = read_json(path / _STATE)["evaluations"]
    ours = (path / FILE).is_file()
    model = _read_learner(path, agent, env) if ours else _read_pickles(path, agent, env, trust)
    if isinstance(model, OffPolicyAlgorithm):
        if (path / _BUFFER).is_file():
            _read_buffer(path / _BUFFER, model)
        elif not ours and (path / _PICKLED_BUFFER).is_file():
            loaded(path / _PICKLED_BUFFER, lambda: model.load_replay_buffer(path / _PICKLED_BUFFER))
        else:
            print(f"Checkpoint {path.name} has no replay buffer any more: it is filled anew.", file=sys.stderr)
            model.learning_starts += model.num_timesteps  # no update from a handful of steps
    return model, evaluations


def _read_pickles(path: Path, agent: Mapping[str, Any], env: VecEnv, trust: bool) -> BaseAlgorithm:
    normalizer = path / "vecnormalize.pkl"
    if normalizer.is_file():
        if not trust:
            raise untrusted(normalizer)
        env = loaded(normalizer, lambda: VecNormalize.load(str(normalizer), env))
    return read_zip(path, agent["algorithm"], trust, env=env)


# --- the learner -----------------------------------------------------------------------------------------------------


def _write_learner(path: Path, model: BaseAlgorithm) -> None:
    """Write all that the next update depends on beside the policy: optimisers, entropy, normaliser, counts."""
    tensors = states(model) if is_jax(model) else dict(_optimizer_state(model))
    if (entropy := getattr(model, "log_ent_coef", None)) is not None:
        tensors["log_ent_coef"] = entropy
    tensors |= {f"normalizer.{name}": value for name, value in _moments(model.get_vec_normalize_env()).items()}
    counts = {name: getattr(model, name) for name in _COUNTS if hasattr(model, name)}
    recent = [{key: float(value) for key, value in episode.items()} for episode in model.ep_info_buffer or ()]
    write_tensors(path, tensors, {"counts": counts, "episodes": recent})


def _read_learner(path: Path, agent: Mapping[str, Any], env: VecEnv) -> BaseAlgorithm:
    """The learner of a checkpoint, built from the run's own config, with the numbers of the files put in.

    Raises:
        SealegsError: they do not fit it.
    """
    weights, _ = read_tensors(path / FILE)
    tensors, about = read_tensors(path / _LEARNER)
    model = build(agent, wrapped(env, agent, training=True), None)
    if jax := is_jax(model):
        tensors = restore(model, tensors, path / _LEARNER)
    else:
        check_like(weights, model.policy.state_dict(), path / FILE)
    optimizers = {} if jax else {name: item for name, item in model.get_parameters().items() if name != "policy"}
    states = {name: _steps_of(tensors, name, path / _LEARNER) for name in optimizers}
    for name, state in states.items():
        _check_steps(name, state, _optimizer(model, name), path / _LEARNER)
    rest = {name: value for name, value in tensors.items() if not any(name.startswith(f"{key}.") for key in states)}
    normalizer = model.get_vec_normalize_env()
    wanted = {f"normalizer.{name}": value for name, value in _moments(normalizer).items()}
    entropy = getattr(model, "log_ent_coef", None)
    wanted |= {} if entropy is None else {"log_ent_coef": entropy}
    check_like(rest, wanted, path / _LEARNER)

    groups = {name: item["param_groups"] for name, item in optimizers.items()}
    filled: dict[str, Any] = {name: {"state": state, "param_groups": groups[name]} for name, state in states.items()}
    if not jax:
        filled["policy"] = weights
        model.set_parameters(filled, device="cpu")
    if entropy is not None:
        entropy.data.copy_(rest["log_ent_coef"])
    for name, moments in _running(normalizer).items():
        moments.mean = rest[f"normalizer.{name}.mean"].numpy().copy()
        moments.var = rest[f"normalizer.{name}.var"].numpy().copy()
        moments.count = float(rest[f"normalizer.{name}.count"])
    for name, value in about["counts"].items():
        if name not in _COUNTS or type(value) is not int or value < 0 or not hasattr(model, name):
            raise SealegsError(f"{path / _LEARNER}: its count '{name}' is {str(value)[:60]!r}.")
        setattr(model, name, value)
    episodes = [{str(key): float(value) for key, value in dict(episode).items()} for episode in about["episodes"]]
    if any(not {"r", "l"} <= episode.keys() == episodes[0].keys() for episode in episodes):  # ARS has no times
        raise SealegsError(f"{path / _LEARNER}: its episodes are not described alike.")
    model.ep_info_buffer = deque(episodes, maxlen=model._stats_window_size)
    model.ep_success_buffer = deque(maxlen=model._stats_window_size)
    return model


def _optimizer_state(model: BaseAlgorithm) -> dict[str, torch.Tensor]:
    """State of all optimisers, as ``<optimiser>.<number of the parameter>.<quantity>``."""
    return {
        f"{name}.{number}.{key}": value if isinstance(value, torch.Tensor) else torch.tensor(float(value))
        for name, item in model.get_parameters().items()
        if name != "policy"
        for number, state in item["state"].items()
        for key, value in state.items()
    }


def _steps_of(tensors: Mapping[str, torch.Tensor], name: str, where: Path) -> dict[int, dict[str, torch.Tensor]]:
    """What an optimiser remembers of each parameter, by its number."""
    state: dict[int, dict[str, torch.Tensor]] = {}
    for key, value in tensors.items():
        if key.startswith(f"{name}."):
            number, dot, quantity = key.removeprefix(f"{name}.").partition(".")
            if not (dot and number.isdecimal() and len(number) < 9):
                raise SealegsError(f"{where} does not fit: '{key}' is not known.")
            state.setdefault(int(number), {})[quantity] = value
    return state


def _check_steps(
    name: str, state: Mapping[int, Mapping[str, torch.Tensor]], optimizer: torch.optim.Optimizer, where: Path
) -> None:
    """Make sure that an optimiser can go on with this state: none, or all of a parameter that it moves."""
    moments = _MOMENTS.get(type(optimizer).__name__, ("exp_avg", "exp_avg_sq"))  # Adam's
    parameters = [parameter for group in optimizer.param_groups for parameter in group["params"]]
    wanted = {
        f"{name}.{number}.{key}": torch.zeros(()) if key == "step" else parameter
        for number, parameter in enumerate(parameters)
        if number in state  # TRPO's moves the critic alone
        for key in ("step", *moments)
    }
    if state:
        check_like(
            {f"{name}.{n}.{key}": value for n, item in state.items() for key, value in item.items()}, wanted, where
        )


def _optimizer(model: BaseAlgorithm, name: str) -> torch.optim.Optimizer:
    """The optimiser of a name as ``get_parameters`` has it, such as ``policy.optimizer``."""
    found: Any = model
    for word in name.split("."):
        found = getattr(found, word)
    return found


def _running(normalizer: VecNormalize | None) -> dict[str, RunningMeanStd]:
    """What a normaliser counts; Stable-Baselines3 makes ``obs_rms`` only where observations are normalised."""
    if normalizer is None:
        return {}
    counted = {"return": normalizer.ret_rms}
    if normalizer.norm_obs:
        assert not isinstance(normalizer.obs_rms, dict)  # observations are vectors
        counted["observation"] = normalizer.obs_rms
    return counted


def _moments(normalizer: VecNormalize | None) -> dict[str, torch.Tensor]:
    """Mean, variance and count of what a normaliser saw, in double precision."""
    return {
        f"{name}.{key}": torch.from_numpy(np.array(getattr(moments, key), np.float64))
        for name, moments in _running(normalizer).items()
        for key in ("mean", "var", "count")
    }


# --- the replay buffer -----------------------------------------------------------------------------------------------


def _write_buffer(path: Path, model: OffPolicyAlgorithm) -> None:
    buffer = model.replay_buffer
    assert isinstance(buffer, ReplayBuffer)
    filled = buffer.buffer_size if buffer.full else buffer.pos
    rows = {name: torch.from_numpy(getattr(buffer, name)[:filled]) for name in _ROWS if hasattr(buffer, name)}
    write_tensors(path, rows, {"pos": buffer.pos, "full": buffer.full})


def _read_buffer(path: Path, model: OffPolicyAlgorithm) -> None:
    """Fill the buffer of a learner.

    Raises:
        SealegsError: the file is of another buffer.
    """
    buffer = model.replay_buffer
    assert isinstance(buffer, ReplayBuffer)
    rows, about = read_tensors(path)
    pos, full = about["pos"], about["full"]
    if type(pos) is not int or type(full) is not bool or not 0 <= pos < buffer.buffer_size:
        raise SealegsError(f"{path} does not fit: it was filled up to {str(pos)[:60]!r}.")
    filled = buffer.buffer_size if full else pos
    arrays = {name: getattr(buffer, name) for name in _ROWS if hasattr(buffer, name)}
    check_like(rows, {name: torch.from_numpy(array[:filled]) for name, array in arrays.items()}, path)
    for name, array in arrays.items():
        array[:filled] = rows[name].numpy()
    buffer.pos, buffer.full = pos, full
