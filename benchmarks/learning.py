"""Five seeds of a learned robot: trained, kept, measured and drawn.

    python -m benchmarks.learning hexapod               train what policies/hexapod lacks, measure, draw
    python -m benchmarks.learning hexapod --minutes 9   stop after that time; the same command goes on
    python -m benchmarks.learning hexapod --no-train    only measure and draw what is there

Each seed is a run of ``train.py`` with the arguments in ``benchmarks/learned.py``, in
``runs/learning-<robot>/seed<k>``. Its best policy, config and evaluations go to ``policies/<robot>/seed<k>``; a seed
that is there stays as it is, and is measured. ``benchmarks/results/learning_<robot>.{md,json,png}`` hold figures, the
curve with its mean and the 95 % interval of that mean, and what was to be reached.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy import stats
from sealegs.agents.config import train_config
from sealegs.agents.policy_files import policy_step
from sealegs.agents.seeds import Curve, read_curve
from sealegs.common.errors import SealegsError
from sealegs.common.markdown import page, table
from sealegs.configs.script import Interrupted, run

from benchmarks.kept import CHECKOUT, POLICIES, RESULTS, command, write
from benchmarks.learned import LEARNED, Bar, asked

KEPT = ("policy.safetensors", "model.zip", "vecnormalize.pkl", "policy.json", "policy.onnx")  # of the policy
RECORDS = ("config.yaml", "actuators.yaml", "evaluations.npz")  # of its run


def interval(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean of ``values`` (seeds, ...) over the seeds, and half the width of its 95 % interval by Student."""
    count = len(values)
    if count < 2:
        return values.mean(axis=0), np.full(values.shape[1:], np.nan)
    error = values.std(axis=0, ddof=1) / np.sqrt(count)
    return values.mean(axis=0), float(stats.t.ppf(0.975, count - 1)) * error


def train(training: Sequence[str], seed: int, runs: Path, target: Path, until: float | None = None) -> None:
    """Train a seed, or go on with it, and keep its best policy.

    Args:
        training: arguments of ``train.py``.
        seed: of the run.
        runs: folder of the runs.
        target: folder for the policy, which is not there yet.
        until: time to stop at, as ``time.monotonic`` counts it [s].

    Raises:
        Interrupted: the time was over, or Ctrl-C; a checkpoint is saved.
        SealegsError: ``train.py`` failed.
    """
    folder = runs / f"seed{seed}"
    if (folder / "config.yaml").is_file():
        same_config(folder, training)
    if (policy_step(folder / "final") or 0) < asked(training).total_timesteps:
        new = [*training, f"seed={seed}", f"name=seed{seed}", f"out={runs}"]
        begun = (folder / "config.yaml").is_file()
        _run([f"resume={folder}"] if begun else new, until)
    best = folder / "best" if (folder / "best" / "policy.json").is_file() else folder / "final"
    writing = target.with_name(f".writing-{target.name}")
    shutil.rmtree(writing, ignore_errors=True)
    writing.mkdir(parents=True)
    for path in (*(best / name for name in KEPT), *(folder / name for name in RECORDS)):
        if path.name == "model.zip":
            without_machine(path, writing / path.name)
        elif path.is_file():
            shutil.copyfile(path, writing / path.name)
    os.replace(writing, target)


def same_config(folder: Path, training: Sequence[str]) -> None:
    """Check that a run or a kept policy comes from these arguments, whatever its seed.

    Raises:
        SealegsError: it does not; the sentence names the first key that differs.
    """
    stored = train_config(yaml.safe_load((folder / "config.yaml").read_text())).as_dict()
    wanted = asked(training).as_dict()
    for key in sorted((stored.keys() | wanted.keys()) - {"seed", "video"}):
        if stored.get(key) != wanted.get(key):
            raise SealegsError(
                f"{folder} was trained with {key}: {stored.get(key)}, but train.py {' '.join(training)} now means "
                f"{wanted.get(key)}; move the folder away, and train again."
            )


def without_machine(source: Path, target: Path) -> None:
    """Copy a model of Stable-Baselines3 without the line that names the operating system it was trained on."""
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        for item in old.infolist():
            content = old.read(item)
            if item.filename == "system_info.txt":
                content = b"".join(line for line in content.splitlines(keepends=True) if not line.startswith(b"- OS:"))
            new.writestr(item, content)


def _run(arguments: Sequence[str], until: float | None) -> None:
    """``train.py`` in a session of its own, so that it hears of a stop once, from here."""
    words = [sys.executable, str(CHECKOUT / "train.py"), *arguments]
    process = subprocess.Popen(words, cwd=CHECKOUT, start_new_session=True)
    try:
        status = process.wait(None if until is None else max(until - time.monotonic(), 0.0))
    except (subprocess.TimeoutExpired, KeyboardInterrupt):
        process.send_signal(signal.SIGINT)
        process.wait()
        raise Interrupted("Stopped; the same command goes on.") from None
    if status != 0:
        raise SealegsError(f"train.py {' '.join(arguments)} ended with status {status}; its message stands above.")


def picture(robot: str, curve: Curve, reference: dict[str, float], path: Path) -> None:
    """The curve of each seed, their mean and its interval."""
    from matplotlib.figure import Figure

    mean, half = interval(curve.rewards)
    figure = Figure(figsize=(7.0, 4.0), layout="constrained")
    axes = figure.subplots()
    thousands = curve.steps / 1000.0
    count = len(curve.rewards)
    for row in curve.rewards:
        axes.plot(thousands, row, color="tab:blue", linewidth=0.7, alpha=0.5)
    label = f"mean of {count} seeds" if count > 1 else "one seed"
    axes.plot(thousands, mean, color="tab:blue", linewidth=2.0, label=label)
    if count > 1:
        low, high = mean - half, mean + half
        axes.fill_between(thousands, low, high, color="tab:blue", alpha=0.2, linewidth=0.0, label="its 95 % interval")
    if "reward" in reference:
        axes.axhline(reference["reward"], color="0.3", linestyle="--", label="reference controller")
    axes.set_xlabel("steps [thousands]")
    axes.set_ylabel("reward of an evaluation episode")
    axes.set_title(f"{robot.replace('_', ', ')}: learning")
    axes.legend(loc="lower right")
    axes.grid(alpha=0.3)
    figure.savefig(path, dpi=120)


def told(
    robot: str,
    training: Sequence[str],
    rows: dict[int, dict[str, float]],
    reference: dict[str, float],
    bars: Sequence[Bar],
) -> str:
    """The study as markdown."""
    names = list(next(iter(rows.values())))
    mean, half = interval(np.array([[row[name] for name in names] for row in rows.values()]))
    alone = [("reference controller", *(f"{reference[name]:.4g}" if name in reference else "-" for name in names))]
    cells = [
        *(alone if reference else []),
        *((f"seed {k}", *(f"{row[name]:.4g}" for name in names)) for k, row in rows.items()),
        ("mean and its 95 % interval",
         *(f"{m:.4g} ± {h:.2g}" if h > 1e-9 else f"{m:.4g}" for m, h in zip(mean, half, strict=True))),
    ]  # fmt: skip
    return page(
        f"Learned {robot}",
        f"`python train.py {' '.join(training)} seed=<k>`, the best policy of each seed in `policies/{robot}`; "
        f"curve in `learning_{robot}.png`. Made by `python -m benchmarks.learning {robot}`.",
        table(("", "reached", "wanted"), (("yes" if bar.holds else "**no**", bar.found, bar.wanted) for bar in bars)),
        table(("", *names), cells),
    )


def study(
    robot: str,
    seeds: int,
    minutes: float | None,
    training: bool,
    policies: Path,
    results: Path,
) -> str:
    """Train what is missing, measure and draw; the page as text.

    Args:
        robot: of :data:`benchmarks.learned.LEARNED`.
        seeds: how many to have trained; others that are there are measured too.
        minutes: after which training stops; None: at its end.
        training: whether to train.
        policies: folder of the seeds.
        results: folder for the figures.

    Raises:
        Interrupted: as :func:`train`.
        SealegsError: there is no policy to measure, or a training failed.
    """
    learned = LEARNED[robot]
    until = None if minutes is None else time.monotonic() + 60.0 * minutes
    folders = {seed: policies / f"seed{seed}" for seed in range(seeds)}
    runs = CHECKOUT / "runs" / f"learning-{robot}"
    for seed, folder in folders.items():
        if training and not folder.exists():
            print(f"{robot}, seed {seed}", flush=True)
            train(learned.training, seed, runs, folder, until)
    there = sorted((int(path.name[4:]), path) for path in policies.glob("seed*") if path.name[4:].isdecimal())
    folders = dict(there)
    for folder in folders.values():
        same_config(folder, learned.training)
    if not folders:
        raise SealegsError(f"{policies} has no policy yet; train some: python -m benchmarks.learning {robot}")
    reference = learned.reference()
    rows: dict[int, dict[str, float]] = {}
    for seed, folder in folders.items():
        print(f"measuring seed {seed}", flush=True)
        rows[seed] = learned.measure(folder)
    bars = learned.bars(list(rows.values()), reference)
    curve = read_curve(list(folders.values()))
    mean, half = interval(curve.rewards)
    document: dict[str, Any] = {
        "training": list(learned.training),
        "reference": reference,
        "seeds": {str(seed): row for seed, row in rows.items()},
        "bars": [asdict(bar) for bar in bars],
        "curve": {
            "steps": curve.steps.tolist(),
            "rewards": curve.rewards.tolist(),
            "mean": mean.tolist(),
            "half_interval": [value if np.isfinite(value) else None for value in half.tolist()],
        },
    }
    text = told(robot, learned.training, rows, reference, bars)
    write(results / f"learning_{robot}", text, document)
    picture(robot, curve, reference, results / f"learning_{robot}.png")
    return text


def main(arguments: list[str]) -> None:
    """Do what the command line asks for."""
    parser = command(None)
    parser.add_argument("robot", choices=LEARNED)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--minutes", type=float, help="stop training after this time")
    parser.add_argument("--no-train", action="store_true", help="only measure and draw")
    parser.add_argument("--policies", type=Path, help="folder of the seeds; default: policies/<robot>")
    parser.add_argument("--results", type=Path, default=RESULTS)
    options = parser.parse_args(arguments)
    policies = options.policies or POLICIES / options.robot
    training = not options.no_train
    print(study(options.robot, options.seeds, options.minutes, training, policies, options.results))


if __name__ == "__main__":
    if {"-h", "--help"} & set(sys.argv[1:]):
        sys.exit(print((__doc__ or "").strip()))
    sys.exit(run(main, "", "", sys.argv[1:]))
