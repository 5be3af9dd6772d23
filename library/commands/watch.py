"""Film a trained policy, as it was trained or with other actuators and commands.

    sealegs watch policy=policies/biped/seed0 env.speed=0.8           told to walk at 0.8 m/s
    sealegs watch policy=runs/first/best actuator=diagnosis/extended.yaml   with the chain that a diagnosis found
    sealegs watch policy=policies/hexapod/seed1 env.params.timestep=0.0005 seconds=60

Writes an mp4 and prints how long each episode in it lasts and what it earns.
"""

from __future__ import annotations

import contextlib
import datetime
from pathlib import Path

from sealegs.actuators.atomic import written
from sealegs.actuators.errors import SealegsError


def main(arguments: list[str]) -> None:
    """Make the film that the command line asks for."""
    from sealegs.agents.make_env import checked_env, make_single_env  # here, so that --help does not wait for torch
    from sealegs.agents.policy_files import load_policy
    from sealegs.agents.video import record_video
    from sealegs.configs.check import Pixels, Positive, checked, checked_seed
    from sealegs.configs.compose import compose, split

    config = compose("watch", split(arguments, plain=("policy", "actuator", "out"), first="policy"))
    if config["policy"] is None:
        raise SealegsError("say which policy to watch: policy=<folder>, such as policies/biped/seed0.")
    folder = Path(checked("policy", config["policy"], str))
    seconds, seed = checked("seconds", config["seconds"], Positive), checked_seed(config["seed"])
    width, height = (checked(key, config[key], Pixels) for key in ("width", "height"))
    act, description = load_policy(folder)
    stored, changed = description["env"], checked("env", config["env"], dict)
    numbers = [checked("env.params", env.get("params") or {}, dict) for env in (stored, changed)]
    env_config = checked_env({**stored, **changed, "params": numbers[0] | numbers[1]})
    actuator = description["actuators"] if config["actuator"] == "keep" else config["actuator"]
    now = datetime.datetime.now().strftime("%Y%m%d-%H%M%S")
    name = "-".join(folder.resolve().parts[-2:])
    out = Path(str(config["out"] or f"runs/film-{name}-{now}.mp4"))
    if out.exists():
        raise SealegsError(f"{out} is there already, and nothing is overwritten; give another out=<file>.")
    out.parent.mkdir(parents=True, exist_ok=True)
    env = make_single_env(env_config, actuator, width, height)
    with contextlib.closing(env), written(out) as unfinished:
        episodes = record_video(unfinished, act, env, seconds, seed)
    for number, episode in enumerate(episodes, 1):
        print(f"Episode {number}: {episode.seconds:.1f} s, reward {episode.reward:.4g}, {episode.ending}")
    print(f"Film: {out}")
