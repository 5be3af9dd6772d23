"""The main job once, without hardware: from a measured log to a hopper that is trained on the extended model.

    sealegs demo            under 10 minutes on two cores
    sealegs demo seed=1     another hidden effect

A virtual bench stands in for hardware: it measures the hopper's servo, which has an effect that its model lacks. The
log is diagnosed. The hopper learns by one recipe on the servo as believed and on the extended one, three seeds of each.
All policies are then tried on the machine: the hopper with the servo as it really is.
"""

from __future__ import annotations

import contextlib
import shlex
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..common.atomic import fresh
from ..common.documents import read_json
from ..common.errors import SealegsError

SERVO = "sv1270tg"
# What the bench may hide, by the parameter that shows it: name of the cause, and range that the size is drawn from.
HIDDEN = {
    "delay.seconds": ("drive.delay", 0.015, 0.030),
    "friction.load": ("friction.load_dependent", 0.06, 0.12),
    "friction.coulomb": ("friction.coulomb", 0.05, 0.12),
}

FILMED, SIZE = 6.0, (320, 360)  # [s] of the film, and [pixels] of each of its halves


def main(arguments: list[str]) -> None:
    """Run the whole loop into one folder."""
    from ..configs.check import Count, checked, checked_seed
    from ..configs.compose import compose, split

    config = compose("demo", split(arguments, plain=("out",)))
    seed = checked_seed(config["seed"])
    steps, seeds = (checked(key, config[key], Count) for key in ("total_timesteps", "seeds"))
    out = Path(checked("out", config["out"] or str(fresh(Path("runs"), "demo")), str))
    if out.exists():
        raise SealegsError(f"{out} exists, and nothing is overwritten: give another folder, out=<folder>.")
    from ..actuators import load_chain
    from ..agents.policy_files import mean_reward  # here, so that no answer above waits for torch
    from ..gap.replay.joint_model import JointModel

    started = time.monotonic()

    path, (cause, low, high) = list(HIDDEN.items())[seed % len(HIDDEN)]
    size = float(np.random.default_rng(seed).uniform(low, high))
    measure(out / "log", {path: size}, seed)
    folder = diagnose(out / "log", out / "diagnosis", seed)
    models = {"nominal": f"actuator={SERVO}", "extended": f"extended={folder}" if folder else f"actuator={SERVO}"}
    runs = {name: train(model, out, name, steps, seeds) for name, model in models.items()}
    machine = JointModel(load_chain(SERVO)).with_values({path: size}).chain.to_list()

    heading("What came of it, on the machine")
    print(f"  Hidden in the servo: {cause}, {path} = {size:.4g}")
    print(f"  Found              : {found(out / 'diagnosis' / 'diagnosis.json')}")
    print(f"  Episode reward on the machine, mean of {seeds} seeds (lowest to highest), trained on the")
    for name, seeds_of in runs.items():
        rewards = [mean_reward(run / "final", machine) for run in seeds_of]
        print(f"    {name:<9}model: {np.mean(rewards):4.0f} ({min(rewards):.0f} to {max(rewards):.0f})")
    print(f"\n  Report       {out / 'diagnosis' / 'report.html'}")
    print(f"  Pictures     {out / 'diagnosis' / 'pictures'}")
    print(f"  Film         {film(out, {name: seeds_of[0] for name, seeds_of in runs.items()}, machine, seed)}")
    print(f"  Curves       {out / 'nominal' / 'seeds.png'}, {out / 'extended' / 'seeds.png'}")
    print(f"  TensorBoard  tensorboard --logdir {out}")
    print(f"  {time.monotonic() - started:.0f} s in all.")


def heading(text: str) -> None:
    """Title of a step."""
    print(f"\n== {text}", flush=True)


def measure(log: Path, hidden: dict[str, float], seed: int) -> None:
    """Record the servo on the virtual bench."""
    from ..gap.virtual.bench import record

    heading(f"Measuring a {SERVO} on the virtual bench")
    files = record(log, SERVO, hidden, seed)
    print(f"  {len(files)} runs in {log}")


def diagnose(log: Path, out: Path, seed: int) -> Path | None:
    """Explain the log; the folder of the extended model, None where there is none."""
    from ..envs.extended import FILE
    from . import diagnose as script

    arguments = [f"log={log}", f"out={out}", f"seed={seed}"]
    heading(shlex.join(["sealegs", "diagnose", *arguments]))
    script.main(arguments)
    return out if (out / FILE).is_file() else None


def found(file: Path) -> str:
    """Causes that a diagnosis names, with their parameters."""
    diagnosis = read_json(file)
    causes = [
        ", ".join([cause["name"], *(f"{path} = {number['value']:.4g}" for path, number in cause["parameters"].items())])
        for cause in diagnosis["causes"]
    ]
    return "; ".join(causes) or diagnosis["verdict"]


def train(model: str, out: Path, name: str, steps: int, seeds: int) -> list[Path]:
    """Train the hopper with several seeds; returns their run folders."""
    from ..agents.seeds import runs_of
    from . import train as script

    arguments = ["env=hopper", model, f"out={out}", f"name={name}", f"seeds={seeds}"]
    arguments += [f"total_timesteps={steps}", "video.seconds=0"]
    heading(f"sealegs train {' '.join(arguments)}")
    script.main(arguments)
    return runs_of(out / name)


def film(out: Path, runs: Mapping[str, Path], machine: list[Any], seed: int) -> str:
    """Film policies on the machine side by side, in the order given; where it is, or why there is none."""
    import imageio.v2 as imageio

    from ..agents.make_env import make_single_env
    from ..agents.policy_files import load_policy
    from ..agents.video import record_video

    file, parts = out / f"{'-and-'.join(runs)}.mp4", [out / name / "machine.mp4" for name in runs]
    try:
        for part, run in zip(parts, runs.values(), strict=True):
            act, description = load_policy(run / "final")
            with contextlib.closing(make_single_env(description["env"], machine, *SIZE)) as env:
                record_video(part, act, env, FILMED, seed)
        readers = [imageio.get_reader(part) for part in parts]
        rate = readers[0].get_meta_data()["fps"]
        writer = imageio.get_writer(file, fps=rate, macro_block_size=2)
        with writer:
            for pictures in zip(*readers, strict=False):
                writer.append_data(np.hstack(pictures))
    except SealegsError as error:  # drawing needs OpenGL and ffmpeg, and the policies are there without a film
        return f"none: {error}"
    return f"{file} (left to right: {', '.join(runs)})"
