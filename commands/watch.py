"""Film a trained policy, as it was trained or with other actuators and commands.

    sealegs watch policy=policies/biped/seed0 env.speed=0.8                 told to walk at 0.8 m/s
    sealegs watch policy=runs/first/best extended=diagnosis                 on the machine as a diagnosis found it
    sealegs watch policy=runs/first/best actuator=diagnosis/extended.yaml   with the chain alone that it found
    sealegs watch policy=runs/mine/best task=mine.py:Mine                   of a task in a file of one's own: it is run
    sealegs watch policy=policies/hexapod/seed1 env.params.timestep=0.0005 seconds=60

Writes an mp4 and prints how long each episode in it lasts and what it earns.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..common.atomic import fresh, written
from ..common.errors import SealegsError


def main(arguments: list[str]) -> None:
    """Make the film that the command line asks for."""
    from ..agents.make_env import checked_env, make_single_env  # here, so that --help does not wait for torch
    from ..agents.policy_files import load_policy, trained_env
    from ..agents.video import record_video
    from ..configs.check import Pixels, Positive, checked, checked_seed
    from ..configs.compose import compose, split

    config = compose("watch", split(arguments, plain=("policy", "actuator", "extended", "task", "out"), first="policy"))
    if config["policy"] is None:
        raise SealegsError("say which policy to watch: policy=<folder>, such as policies/biped/seed0.")
    folder = Path(checked("policy", config["policy"], str))
    seconds, seed = checked("seconds", config["seconds"], Positive), checked_seed(config["seed"])
    width, height = (checked(key, config[key], Pixels) for key in ("width", "height"))
    task, trust = checked("task", config["task"], str | None), checked("trust", config["trust"], bool)
    act, description = load_policy(folder, trust)
    stored = trained_env(description, folder, task)
    changed = checked("env", config["env"], dict)
    numbers = [checked("env.params", env.get("params") or {}, dict) for env in (stored, changed)]
    actuator = description["actuators"] if config["actuator"] == "keep" else config["actuator"]
    if config["extended"] is not None:
        actuator, found = _as_found(config, {**stored, **changed}, numbers[1])
        numbers.append(found)
    env_config = checked_env({**stored, **changed, "params": {k: v for n in numbers for k, v in n.items()}})
    name = "-".join(folder.resolve().parts[-2:])
    out = Path(str(config["out"] or fresh(Path("runs"), f"film-{name}", ".mp4")))
    if out.exists():
        raise SealegsError(f"{out} is there already, and nothing is overwritten; give another out=<file>.")
    out.parent.mkdir(parents=True, exist_ok=True)
    env = make_single_env(env_config, actuator, width, height)
    with contextlib.closing(env), written(out) as unfinished:
        episodes = record_video(unfinished, act, env, seconds, seed)
    for number, episode in enumerate(episodes, 1):
        print(f"Episode {number}: {episode.seconds:.1f} s, reward {episode.reward:.4g}, {episode.ending}")
    print(f"Film: {out}")


def _as_found(
    config: Mapping[str, Any], env: Mapping[str, Any], believed: Mapping[str, float]
) -> tuple[dict[str, Any], dict[str, float]]:
    """Chains and numbers of the diagnosis, on what is believed now, since the policy may have been trained on them."""
    from ..configs.check import checked
    from ..envs.extended import extended_arguments

    actuator = None if config["actuator"] == "keep" else config["actuator"]
    folder = checked("extended", config["extended"], str)
    return extended_arguments(str(env["id"]), folder, actuator, believed, env.get("robot"))
