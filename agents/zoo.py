"""Hyperparameters as rl-baselines3-zoo writes them (hyperparams/ppo.yml): read as data, nothing in them is run.

    sealegs train agent=ppo hyperparams=ppo.yml                     the entry of the environment, or the file's only one
    sealegs train agent=ppo hyperparams=ppo.yml:HalfCheetah-v4      another entry

An entry holds n_envs, n_timesteps, normalize, frame_stack, callback, vec_env_wrapper and the algorithm's arguments.
Text such as "dict(net_arch=[64, 64], activation_fn=nn.ReLU)" is taken apart as a Python expression of literals.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..common.documents import DocumentError, read_yaml
from ..common.errors import SealegsError, nearest
from .algorithms import ACTIVATIONS

_RENAMED = {"frame_stack": "history", "vec_env_wrapper": "wrappers", "callback": "callbacks"}
_IGNORED = ("monitor_kwargs",)
"""Of wrappers that count what the batch counts itself."""
_REFUSED = {
    "env_wrapper": "wraps one simulation, and a run's simulations are one batch: leave it out, or use history",
    "env_kwargs": "is of another environment: give env.<key>=",
}
_TEXT = ("normalize", "policy_kwargs", "train_freq", "replay_buffer_kwargs")
"""Keys whose text is an expression."""
TOP = {"n_timesteps": "total_timesteps", "n_envs": "n_envs"}
"""Keys of an entry that are not the agent's, and what a config calls them."""


def read_zoo(word: str, env_id: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Keys of the config, and of its group ``agent``, of an entry of a zoo's file.

    Args:
        word: path of the file, and perhaps ``:`` and the name of the entry.
        env_id: of the environment that is trained in.

    Raises:
        SealegsError: the file cannot be read, has no such entry, or has what is not read from a file.
    """
    path, _, name = word.partition(":")
    try:
        document = read_yaml(path)
    except DocumentError as error:
        raise SealegsError(f"hyperparams={word}: {error}") from None
    entry, where = _entry(document, name, env_id, path)
    top: dict[str, Any] = {}
    agent: dict[str, Any] = {}
    for key, value in entry.items():
        if key in _REFUSED:
            if value:
                raise SealegsError(f"{where}: {key} {_REFUSED[key]}.")
        elif key in TOP:
            top[TOP[key]] = value
        elif key == "callback" or key == "vec_env_wrapper":
            agent[_RENAMED[key]] = value if isinstance(value, list) else [value]
        elif key not in _IGNORED:
            text = isinstance(value, str) and key in _TEXT
            agent[_RENAMED.get(key, key)] = expression(value, f"{where}: {key}") if text else value
    return top, agent


def _entry(document: Any, name: str, env_id: str, path: str) -> tuple[Mapping[str, Any], str]:
    """The entry that is meant, and how to call it in a message."""
    if not isinstance(document, dict):
        raise SealegsError(f"{path} holds no hyperparameters by environment.")
    if not name and not any(isinstance(value, dict) for key, value in document.items() if key not in _TEXT):
        return document, path  # an entry without a name
    entries = {str(key): value for key, value in document.items() if isinstance(value, dict)}
    found = name or next((word for word in (env_id, env_id.rpartition("/")[2]) if word in entries), "")
    if not found and len(entries) == 1:
        found = next(iter(entries))
    if found not in entries:
        known = ", ".join(list(entries)[:8]) + (", ..." if len(entries) > 8 else "")
        raise SealegsError(
            f"{path} has no entry {name or env_id}{nearest(name or env_id, entries)}: give hyperparams={path}:<entry>, "
            f"one of {known}."
        )
    return entries[found], f"{Path(path).name}:{found}"


def expression(text: str, where: str) -> Any:
    """Value of a Python expression of literals, ``dict(...)`` and activations such as ``nn.ReLU``; nothing is run.

    Raises:
        SealegsError: it is another expression.
    """
    try:
        return _value(ast.parse(text.strip(), mode="eval").body)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise SealegsError(f"{where} is '{text[:80]}', which is not read ({error}).") from None


def _value(node: ast.AST) -> Any:
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "dict" and not node.args:
        if any(item.arg is None for item in node.keywords):
            raise ValueError("** in dict()")
        return {item.arg: _value(item.value) for item in node.keywords}
    if isinstance(node, ast.Dict):
        if any(key is None for key in node.keys):
            raise ValueError("** in a dict")
        return {_value(key): _value(value) for key, value in zip(node.keys, node.values, strict=True) if key}
    if isinstance(node, ast.List | ast.Tuple):
        return [_value(item) for item in node.elts]
    if isinstance(node, ast.Attribute) and node.attr.lower() in ACTIVATIONS:  # nn.ReLU, th.nn.ReLU
        return node.attr.lower()
    if isinstance(node, ast.Name | ast.Attribute | ast.Call):
        raise ValueError(f"{ast.unparse(node)[:40]} is no literal")
    return ast.literal_eval(node)
