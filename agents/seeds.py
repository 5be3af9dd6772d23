"""Runs of several seeds: one folder with a run a seed, and what they have in common.

    sealegs train seeds=5 name=mine        runs/mine/seed0 to seed4, each a run as any other
    sealegs train resume=runs/mine         goes on; a seed that is finished is not trained again

seeds.md, seeds.json   reward of each seed, the interquartile mean over the seeds, its 95 % interval by the bootstrap
seeds.png              the learning curve, with the interval of that mean as a band

The interquartile mean is that of rliable (Agarwal et al. 2021). Its own package is pinned to a version of `arch` that
does not load beside pandas 3; for one task its stratified bootstrap is SciPy's.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from scipy.stats import bootstrap, trim_mean

from ..common.atomic import write_text
from ..common.documents import load_arrays, read_json, read_yaml
from ..common.errors import SealegsError
from ..common.markdown import page, table
from ..configs.check import Natural, checked
from .run_folder import RunFolder

_LIST = "seeds.yaml"
EVALUATIONS = 2**26  # [B] of a run's evaluations that are read at most
_OWN = (".*", "config.yaml", "run*.json", "evaluations.npz", "checkpoints", "best", "final", "tensorboard", "video.mp4")
"""Of a run, what no other seed takes over."""
RESAMPLES = 5000
"""Of the bootstrap over seeds."""


@dataclass(frozen=True)
class Curve:
    """Evaluations over training: steps (m,), and the mean reward of each seed (seeds, m)."""

    steps: np.ndarray
    rewards: np.ndarray


def read_curve(folders: Sequence[Path]) -> Curve:
    """The curve of the runs in ``folders`` over the range that all of them were evaluated in.

    A run that was stopped goes on with evaluations at other steps; between its own, its reward is taken as a line.
    """
    read = []
    for folder in folders:
        file = load_arrays(folder / "evaluations.npz", EVALUATIONS)
        steps, results = file.get("timesteps"), file.get("results")
        if steps is None or results is None:
            raise SealegsError(f"{folder / 'evaluations.npz'} has no timesteps and results: train the seed again.")
        read.append((steps, results.mean(axis=1)))
    low, high = max(steps[0] for steps, _ in read), min(steps[-1] for steps, _ in read)
    steps = np.unique(np.concatenate([steps for steps, _ in read]))
    steps = steps[(low <= steps) & (steps <= high)]
    return Curve(steps, np.array([np.interp(steps, *row) for row in read]))


def interquartile_mean(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Interquartile mean of ``values`` (seeds, ...) over the seeds, and its 95 % percentile-bootstrap interval.

    The interval is NaN of fewer than three seeds.
    """
    mean = np.asarray(trim_mean(values, 0.25, axis=0))
    if len(values) < 3:
        return mean, np.full_like(mean, np.nan), np.full_like(mean, np.nan)
    found = bootstrap(
        (values,), lambda rows, axis: trim_mean(rows, 0.25, axis=axis), axis=0, method="percentile",
        n_resamples=RESAMPLES, batch=100, rng=np.random.default_rng(0),
    ).confidence_interval  # fmt: skip
    return mean, np.asarray(found.low), np.asarray(found.high)


def write_seeds(folder: Path, seeds: Sequence[int]) -> str:
    """Write which seeds a folder is to hold; the name of the first one's run."""
    write_text(folder / _LIST, yaml.safe_dump(list(seeds)))
    return f"seed{seeds[0]}"


def is_study(folder: Path) -> bool:
    """Whether a folder is one of several seeds."""
    return (folder / _LIST).is_file() and bool(runs_of(folder))


def _lay(folder: Path) -> None:
    """Lay the runs that are missing: with config and chains of the first, in which that one may have learned."""
    seeds = checked(str(folder / _LIST), read_yaml(folder / _LIST), list[Natural])
    first = runs_of(folder)[0]
    config = read_yaml(first / "config.yaml")
    for run, seed in ((folder / f"seed{seed}", seed) for seed in seeds):
        if not (run / "config.yaml").is_file():
            shutil.copytree(first, run, ignore=shutil.ignore_patterns(*_OWN), dirs_exist_ok=True)
            write_text(run / "config.yaml", yaml.safe_dump({**config, "seed": seed}, sort_keys=False))


def runs_of(folder: Path) -> list[Path]:
    """Runs of a folder of seeds, in the order of the seeds; none where it is no such folder."""
    found = [path.parent for path in folder.glob("seed*/config.yaml") if path.parent.name[4:].isdecimal()]
    return sorted(found, key=lambda path: int(path.name[4:]))


def learn_all(folder: Path, learn: Callable[[Path], None], finished: Callable[[Path], bool]) -> None:
    """Let each run of a folder of seeds learn that is not finished, then write what they have in common.

    Args:
        folder: of the seeds.
        learn: goes on with a run to its end.
        finished: whether a run is at its end.
    """
    study = RunFolder(folder)
    try:
        _lay(folder)
        for run in runs_of(folder):
            if finished(run):
                print(f"{run} is finished.", flush=True)
            else:
                learn(run)
        print(summarize(folder), flush=True)
    finally:
        study.close()


def summarize(folder: Path) -> str:
    """Write ``seeds.md``, ``seeds.json`` and ``seeds.png`` of finished runs; the table as text.

    Raises:
        SealegsError: a run has no final policy.
    """
    runs = runs_of(folder)
    columns = {"final policy": "mean_reward", "its reference alone": "reference_reward"}
    try:
        policies = [read_json(run / "final" / "policy.json") for run in runs]
        final = {column: [row.get(key) for row in policies] for column, key in columns.items()}
    except (OSError, ValueError, AttributeError) as error:
        raise SealegsError(f"A run in {folder} has no final policy that can be read ({error}).") from None
    values = {name: np.array(row, float) for name, row in final.items() if None not in row}
    means = {name: interquartile_mean(row) for name, row in values.items()}
    rows = [
        *((run.name, *(f"{row[k]:.4g}" for row in values.values())) for k, run in enumerate(runs)),
        ("interquartile mean", *(f"{mean:.4g}" for mean, _, _ in means.values())),
        ("its 95 % interval", *(_interval(low, high) for _, low, high in means.values())),
    ]
    text = table(("reward of an evaluation episode", *values), rows)
    write_text(folder / "seeds.md", page(f"{folder.name}: {len(runs)} seeds", text), replace=True)
    document = {
        "seeds": {run.name: {name: float(row[k]) for name, row in values.items()} for k, run in enumerate(runs)},
        "interquartile_mean": {
            name: {"mean": float(mean), "low": _number(low), "high": _number(high)}
            for name, (mean, low, high) in means.items()
        },
    }
    write_text(folder / "seeds.json", json.dumps(document, indent=2), replace=True)
    return f"{text}\n{_draw(folder, runs)}"


def _draw(folder: Path, runs: Sequence[Path]) -> str:
    """Draw ``seeds.png``; where it is, or why it is not."""
    try:
        from matplotlib.figure import Figure
    except ModuleNotFoundError:
        return "No picture: it needs the package matplotlib: pip install 'sealegs[report]'."
    curve = read_curve(runs)
    mean, low, high = interquartile_mean(curve.rewards)
    figure = Figure(figsize=(7.0, 4.0), layout="constrained")
    axes = figure.subplots()
    axes.plot(curve.steps, curve.rewards.T, color="tab:blue", linewidth=0.7, alpha=0.4)
    axes.plot(curve.steps, mean, color="tab:blue", linewidth=2.0, label=f"interquartile mean of {len(runs)} seeds")
    axes.fill_between(curve.steps, low, high, color="tab:blue", alpha=0.2, linewidth=0.0, label="its 95 % interval")
    axes.set_xlabel("steps")
    axes.set_ylabel("reward of an evaluation episode")
    axes.set_title(folder.name)
    axes.legend(loc="lower right")
    axes.grid(alpha=0.3)
    figure.savefig(folder / "seeds.png", dpi=120)
    return f"  Curve       {folder / 'seeds.png'}"


def _interval(low: np.ndarray, high: np.ndarray) -> str:
    return f"{low:.4g} to {high:.4g}" if np.isfinite(low) else "of 3 seeds or more"


def _number(value: np.ndarray) -> float | None:
    return float(value) if np.isfinite(value) else None
