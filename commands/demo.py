"""The main job once, without hardware: from a measured log to a hopper that is trained on the extended model.

    sealegs demo            under 10 minutes on two cores
    sealegs demo seed=1     another hidden effect

A virtual bench stands in for hardware: it measures the hopper's servo, which has an effect that its model lacks. The
log is diagnosed. The hopper learns once on the servo as believed and once on the extended one, and both policies are
tried on the extended one.
"""

from __future__ import annotations

import shlex
import time
from pathlib import Path

import numpy as np

from ..common.documents import read_json
from ..common.errors import SealegsError
from ..common.fresh_names import fresh

SERVO = "sv1270tg"
# What the bench may hide, by the parameter that shows it: name of the cause, and range that the size is drawn from.
HIDDEN = {
    "delay.seconds": ("drive.delay", 0.015, 0.030),
    "friction.load": ("friction.load_dependent", 0.06, 0.12),
    "friction.coulomb": ("friction.coulomb", 0.05, 0.12),
}


def main(arguments: list[str]) -> None:
    """Run the whole loop into one folder."""
    from ..configs.check import Count, checked, checked_seed
    from ..configs.compose import compose, split
    from ..envs.extended import read_extended
    from ..envs.hopper.robot import HOPPER

    config = compose("demo", split(arguments, plain=("out",)))
    seed = checked_seed(config["seed"])
    steps = checked("total_timesteps", config["total_timesteps"], Count)
    out = Path(checked("out", config["out"] or str(fresh(Path("runs"), "demo")), str))
    if out.exists():
        raise SealegsError(f"{out} exists, and nothing is overwritten: give another folder, out=<folder>.")
    from ..agents.cross_evaluation import mean_reward  # here, so that no answer above waits for torch

    started = time.monotonic()

    path, (cause, low, high) = list(HIDDEN.items())[seed % len(HIDDEN)]
    size = float(np.random.default_rng(seed).uniform(low, high))
    measure(out / "log", {path: size}, seed)
    folder = diagnose(out / "log", out / "diagnosis", seed)
    runs = {"nominal": train(f"actuator={SERVO}", out, "nominal", steps, seed)}
    runs["extended"] = train(f"extended={folder}" if folder else f"actuator={SERVO}", out, "extended", steps, seed)
    extended = read_extended(folder).chains_on(HOPPER) if folder else SERVO

    heading("What came of it")
    print(f"  Hidden in the servo: {cause}, {path} = {size:.4g}")
    print(f"  Found              : {found(out / 'diagnosis' / 'diagnosis.json')}")
    print("  Mean episode reward on the extended servo, of the policy that was trained on the")
    for name, folder in runs.items():
        print(f"    {name} one: {mean_reward(folder / 'final', extended):.0f}")
    print(f"\n  Report       {out / 'diagnosis' / 'report.html'}")
    print(f"  Pictures     {out / 'diagnosis' / 'pictures'}")
    for name, folder in runs.items():
        print(f"  Film         {folder / 'video.mp4'}  ({name})")
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


def train(model: str, out: Path, name: str, steps: int, seed: int) -> Path:
    """Train the hopper; returns the run folder."""
    from . import train as script

    arguments = ["env=hopper", model, f"out={out}", f"name={name}", f"seed={seed}"]
    arguments += [f"total_timesteps={steps}", "video.seconds=6"]
    heading(f"sealegs train {' '.join(arguments)}")
    script.main(arguments)
    return out / name
