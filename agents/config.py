"""Typed and checked config of a training run."""

from __future__ import annotations

import ast
import dataclasses
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_type_hints

from ..common.documents import DocumentError, read_yaml
from ..common.errors import SealegsError, nearest
from ..configs.check import Count, Natural, NotNegative, Pixels, checked
from ..configs.compose import compose, override, split
from .algorithms import ACTIVATIONS

# A resumed run stays the same experiment: only its length and its bookkeeping may change.
_RESUMABLE = ("total_timesteps", "threads", "evaluate", "checkpoint", "video", "wandb")
_NAMED = ("resume", "env", "trust")  # which run, the file of its task, and whether its pickles may be loaded
WORDS = (
    "actuator", "env", "extended", "from", "hyperparams", "name", "out", "randomization", "resume", "robot", "wandb",
)  # fmt: skip
"""Keys whose values are names of files or words, and no expressions."""
_MODEL = ("actuator", "extended", "randomization")  # one of them given, none of an earlier run's counts


@dataclass(frozen=True)
class EvaluateConfig:
    """Evaluation of the policy: every ``every`` steps (0: never), over ``episodes`` episodes."""

    every: Natural
    episodes: Count


@dataclass(frozen=True)
class CheckpointConfig:
    """Checkpoints: one every ``every`` steps."""

    every: Count


@dataclass(frozen=True)
class VideoConfig:
    """Film of the trained policy: ``seconds`` [s] (0: none), size in pixels."""

    seconds: NotNegative
    width: Pixels
    height: Pixels


@dataclass(frozen=True)
class TrainConfig:
    """Task, robot model, algorithm and length of a training. Steps are counted over all simulations.

    ``actuator`` is the name or the path of a chain, its stages, one of these by joint, or None for the robot's own.
    ``env`` and ``agent`` hold the arguments of the environment and of the algorithm. ``extended`` is the diagnosis from
    which ``actuator`` and the robot's numbers in ``env`` came, or None. ``wandb`` is the project of Weights & Biases
    that the curves go to, or None. ``begun_from`` is the run or policy whose policy was there at the start, or None.
    ``measured`` names arguments in ``env`` that were measured on the model, as the lead of a trajectory is.
    """

    env: dict[str, Any]
    actuator: str | list[Any] | dict[str, Any] | None
    agent: dict[str, Any]
    extended: str | None
    seed: Natural
    n_envs: Count
    total_timesteps: Count
    threads: Count
    evaluate: EvaluateConfig
    checkpoint: CheckpointConfig
    video: VideoConfig
    wandb: str | None = None
    begun_from: str | None = None
    measured: list[str] = dataclasses.field(default_factory=list)

    def as_dict(self) -> dict[str, Any]:
        """Plain form, as it is written to ``config.yaml``."""
        return json.loads(json.dumps(dataclasses.asdict(self)))  # tuples become lists


@dataclass(frozen=True)
class Request:
    """The request of the command line: a new run of ``config`` in ``out``, or resuming the run at ``resume``.

    ``overrides`` are the arguments that change the stored config of a resumed run. ``task`` names the file of its task,
    ``trust`` says that the pickles of an earlier version may be loaded. ``seeds`` are those of a run of several; a run
    of one has none.
    """

    config: TrainConfig | None
    out: Path
    name: str | None
    resume: Path | None
    overrides: dict[str, str]
    task: str | None = None
    trust: bool = False
    seeds: tuple[int, ...] = ()


def read_config(arguments: Sequence[str], trust: bool = True) -> Request:
    """Request of the command line.

    Args:
        arguments: of ``sealegs train``.
        trust: whether a person named what they hold; where a file did, a new run loads no code of other packages.

    Raises:
        SealegsError: an unknown key, a value of the wrong type or size, a change that a resumed run cannot take; or
            code that nobody trusts.
    """
    pairs = split(arguments, plain=WORDS)
    resume = pairs.get("resume", "null")
    if resume not in ("", "null"):
        own = override({"resume": "", "env": None, "trust": False}, {k: pairs.pop(k) for k in _NAMED if k in pairs})
        overrides = pairs
        for key in overrides:
            if key.partition(".")[0] not in _RESUMABLE:
                raise SealegsError(
                    f"A resumed run keeps its config, so {key} cannot be given with resume; "
                    f"what can: {', '.join(_RESUMABLE)}."
                )
        task, trusted = checked("env", own["env"], str | None), checked("trust", own["trust"], bool)
        return Request(None, Path(), None, Path(str(own["resume"])), overrides, task, trusted)
    begins = pairs.get("from", "null") not in ("", "null")
    if pairs.get("robot", "null") not in ("", "null") and not begins:
        pairs = {"env": "track", **pairs}  # a robot of one's own has the tasks that any robot has
    of_agent = {key: pairs.pop(key) for key in list(pairs) if key.startswith("agent.") and "hyperparams" in pairs}
    composed = _of_run(pairs) if begins else compose("train", pairs, extra_keys, {"env": _own_task})
    plain = _with_zoo(composed, pairs, of_agent)
    plain["begun_from"] = checked("from", plain.pop("from"), str | None)
    robot = checked("robot", plain.pop("robot"), str | None)
    if robot is not None:
        plain["env"] = _of_robot(plain["env"], robot, pairs)
    out = checked("out", plain.pop("out"), str)
    name = checked("name", plain.pop("name"), str | int | None)
    plain.pop("resume")
    if plain.pop("trust"):
        raise SealegsError("trust= is for a run that there is: leave it out, or say which, resume=<run>.")
    seeds, plain["seed"] = _seeds(plain.pop("seeds"), plain["seed"])
    plain = _extended(_drawn_from(plain))
    if not trust:
        _refuse_foreign(plain["agent"], "The agent of this run")
    return Request(train_config(plain), Path(out), None if name is None else str(name), None, {}, seeds=seeds)


def _of_robot(env: Mapping[str, Any], robot: str, given: Mapping[str, str]) -> dict[str, Any]:
    """The config ``env`` for a robot: numbers that it has for another one (``params``) count only where ``given``."""
    if env.get("robot") != robot and isinstance(params := env.get("params"), Mapping) and "env.params" not in given:
        env = {**env, "params": {key: value for key, value in params.items() if f"env.params.{key}" in given}}
    return {**env, "robot": robot}


def _of_run(pairs: Mapping[str, str]) -> dict[str, Any]:
    """The config of a run that begins with what another one learnt: that one's, with the command line's keys on top.

    Raises:
        SealegsError: there is none, or a key would make another task or algorithm of it.
    """
    from .initial import stored_config

    named = {key: value for key, value in pairs.items() if key in ("from", "env", "trust")}
    own = override({"from": "", "env": None, "trust": False}, named)
    folder, trust = Path(str(own["from"])), checked("trust", own["trust"], bool)
    stored = stored_config(folder)
    if "agent" in pairs:
        raise SealegsError(f"{folder} was learnt by its own algorithm: leave agent= out; agent.<key>= can be given.")
    env = _env_as_named(stored, str(folder), checked("env", own["env"], str | None), trust)
    env = {**env, **dict.fromkeys(stored.get("measured", ()))}  # measured anew on the model
    if any(key in pairs for key in _MODEL):
        numbers = () if stored.get("extended") is None else ("params",)  # they are of the diagnosis before
        env = {key: value for key, value in env.items() if key not in numbers} | {"randomization": None}
        stored = {**stored, "actuator": None, "extended": None}
    kept = {key: value for key, value in stored.items() if key not in ("begun_from", "measured", "seed")}
    base = {**compose("train", {}), **kept, "env": env, "from": str(folder.absolute())}
    rest = {key: value for key, value in pairs.items() if key not in named}
    return override(base, rest, extra_keys)


def _with_zoo(plain: dict[str, Any], given: Mapping[str, str], of_agent: Mapping[str, str]) -> dict[str, Any]:
    """The config with the agent of the zoo's file that ``hyperparams`` names, and keys ``given`` with it on top.

    Args:
        plain: the config.
        given: keys of the command line, which count more than the file's.
        of_agent: those of the group ``agent``.
    """
    word = checked("hyperparams", plain.pop("hyperparams"), str | None)
    if word is None:
        return plain

    top, agent = read_zoo(word, str(plain["env"]["id"]))
    plain = {**plain, **{key: value for key, value in top.items() if key not in given}}
    plain["agent"] = {"algorithm": plain["agent"]["algorithm"], "policy": plain["agent"]["policy"], **agent}
    if "${" in json.dumps(plain["agent"], default=str):
        raise SealegsError(f"hyperparams={word} holds '${{', which stands for nothing here: write the value.")
    return override(plain, of_agent, extra_keys)


def _seeds(count: Any, seed: Any) -> tuple[tuple[int, ...], Any]:
    """Seeds of a run of several, and the first of them; () and ``seed`` of a run of one."""
    count = checked("seeds", count, Count | None)
    if count is not None and seed != 0:
        raise SealegsError(f"seeds={count} and seed={seed} say the same: give seeds={count}, or seed=[0,1,2].")
    if not isinstance(seed, list) and count is None:
        return (), seed
    seeds = list(range(count)) if count is not None else checked("seed", seed, list[Natural])
    if not seeds or len(set(seeds)) < len(seeds):
        raise SealegsError(f"seed={seeds} must name one seed at least, and each once.")
    return tuple(seeds), seeds[0]


def _own_task(word: str) -> dict[str, Any]:
    """The config group ``env`` of a task in a file of the user's."""
    from ..envs.any_robot.user import absolute, is_user_task, user_id

    if not is_user_task(word):
        raise SealegsError(f"env={word} is no task; a task of your own is given as path/to/task.py:MyTask.")
    user_id(word)
    return {"id": absolute(word), "randomization": None}


def _drawn_from(plain: dict[str, Any]) -> dict[str, Any]:
    """The config with what its environment draws anew: a diagnosis is also the model, where no other is given."""
    from ..envs.extended import names_diagnosis, with_machines

    env = dict(plain["env"])
    said = checked("randomization", plain.pop("randomization"), str | dict[str, Any] | None)
    source = env.get("randomization") if said is None else said
    if names_diagnosis(source) and plain["extended"] is None and plain["actuator"] is None:
        plain = {**plain, "extended": str(source)}
    if said is None and not (isinstance(source, dict) or names_diagnosis(source)):
        return plain
    source = with_machines(source, str(env["id"]), env.get("params"), env.get("robot"))
    return {**plain, "env": {**env, "randomization": source}}


def _extended(plain: dict[str, Any]) -> dict[str, Any]:
    """The config with copies of the chains and numbers of the diagnosis that it names."""
    folder = checked("extended", plain["extended"], str | None)
    if folder is None:
        return plain
    from ..envs.extended import extended_arguments

    env = dict(plain["env"])
    chains, params = extended_arguments(str(env["id"]), folder, plain["actuator"], env.get("params"), env.get("robot"))
    actuator = {joint: chain.to_list() for joint, chain in chains.items()}
    return {**plain, "actuator": actuator, "env": {**env, "params": params}}


def with_overrides(
    stored: Mapping[str, Any], overrides: Mapping[str, str], where: str, task: str | None = None, trust: bool = False
) -> TrainConfig:
    """Config of a resumed run: the stored one, with the overrides that are allowed.

    Args:
        stored: of the run's ``config.yaml``, which is data: no code runs because it names it.
        overrides: of the command line.
        where: the run, for messages.
        task: the file of the run's task, as the command line names it.
        trust: whether callbacks and wrappers of packages other than ours may be loaded.

    Raises:
        SealegsError: as :func:`train_config`, or the run's task or callback is code that nobody named.
    """
    env = _env_as_named(stored, where, task, trust)
    return train_config(override({**stored, "env": env}, overrides))


def _env_as_named(stored: Mapping[str, Any], where: str, task: str | None, trust: bool) -> dict[str, Any]:
    """The environment of a stored config, none of whose code runs because the config names it.

    Arguments and errors as of :func:`with_overrides`.
    """
    from ..envs.any_robot.user import trained_in

    if "${" in json.dumps(stored, default=str):  # OmegaConf would fill in variables of the person's environment
        raise SealegsError(f"{where}: its config.yaml holds '${{'; write out what it stands for.")
    env = trained_in(checked("env", stored.get("env"), dict[str, Any]), where, task, "env")
    if not trust:
        _refuse_foreign(checked("agent", stored.get("agent"), dict[str, Any]), f"{where}: its config.yaml")
    return env


def _refuse_foreign(agent: Mapping[str, Any], where: str) -> None:
    from .algorithms import foreign

    if named := foreign(agent):
        raise SealegsError(f"{where} names {named[0]}, which is code: give trust=true if you trust it.")


def train_config(plain: Mapping[str, Any]) -> TrainConfig:
    """Typed config from its plain form.

    Raises:
        SealegsError: a value of the wrong type or size.
    """
    from .algorithms import checked_agent
    from .make_env import checked_env

    later = {"extended": None, "wandb": None, "begun_from": None, "measured": []}  # than runs of earlier versions
    values = _typed(TrainConfig, {**later, **plain}, "")
    config = TrainConfig(**values)
    return dataclasses.replace(config, env=checked_env(config.env), agent=checked_agent(config.agent))


def _typed(kind: Any, plain: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    """Arguments of the dataclass ``kind`` from plain values; nested dataclasses are built."""
    values: dict[str, Any] = {}
    for name, annotation in get_type_hints(kind, include_extras=True).items():
        if name not in plain:
            raise SealegsError(f"The key {prefix}{name} is missing.")
        if dataclasses.is_dataclass(annotation) and isinstance(annotation, type):
            inner = checked(prefix + name, plain[name], dict[str, Any])
            values[name] = annotation(**_typed(annotation, inner, f"{prefix}{name}."))
        else:
            values[name] = checked(prefix + name, plain[name], annotation)
    return values


def extra_keys(base: Mapping[str, Any]) -> list[str]:
    """Dotted keys beside those that its files list: arguments of its environment and of its algorithm."""
    from .algorithms import agent_keys
    from .make_env import env_keys

    agent = [f"agent.{key}" for key in agent_keys(base["agent"])]
    return agent + [f"env.{key}" for key in env_keys(base["env"])]


# --- hyperparameters as rl-baselines3-zoo writes them (hyperparams/ppo.yml): read as data, nothing in them is run ----
#
#     sealegs train agent=ppo hyperparams=ppo.yml                   the entry of the environment, or the file's only one
#     sealegs train agent=ppo hyperparams=ppo.yml:HalfCheetah-v4    another entry
#
# An entry holds n_envs, n_timesteps, normalize, frame_stack, callback, vec_env_wrapper and the algorithm's arguments.
# Text such as "dict(net_arch=[64, 64], activation_fn=nn.ReLU)" is taken apart as a Python expression of literals.

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
