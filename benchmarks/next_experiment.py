"""Does the proposed experiment turn an undecided verdict into the right name?

    python -m benchmarks.next_experiment              writes benchmarks/results/next_experiment.{jsonl,md}

A hidden bench (:mod:`testbed`) records a poor set: two runs of eight seconds with one load and little motion. It is
diagnosed; what is then proposed is run on the same hidden machine, with the goals and the load that the proposal names;
old and new logs are diagnosed together. Where the verdict is still open, the next proposal is run as well. Poor
sets of seed 11 were used for development, those of the page were first run for it. Finished cases are kept, so that it
can be stopped and goes on.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from sealegs.common.markdown import page, table
from sealegs.gap.experiment import GOAL_RATE, Experiment
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.log.types import MeasuredSet
from sealegs.gap.verdict.verdict import JointDiagnosis

from benchmarks.kept import RESULTS, Kept, command, study, write

EXPERIMENTS = 2
POOR = {
    "sine": lambda t: 0.4 * np.sin(2 * np.pi * 0.5 * t),
    "small": lambda t: 0.05 * np.sin(2 * np.pi * 0.25 * t),
    "slow": lambda t: 0.5 * np.sin(2 * np.pi * 0.1 * t),
    "still": lambda t: 0.3 + 0.0 * t,
}
"""Goals [rad] over time [s] of the poor sets."""
CASES = (
    ("load.mass", "sine", "clear"),
    ("drive.delay", "small", "clear"),
    ("load.centre_of_mass", "sine", "clear"),
    ("friction.viscous", "small", "clear"),
    ("transmission.backlash", "small", "clear"),
    ("friction.load_dependent", "still", "clear"),
    ("drive.deadband", "slow", "clear"),
    ("load.inertia", "small", "clear"),
    ("transmission.gear_ratio", "small", "clear"),
    ("drive.supply_sag", "small", "clear"),
    ("friction.stribeck", "sine", "clear"),
    ("drive.saturation", "small", "clear"),
    ("", "small", "clear"),
)


def record_experiment(data: MeasuredSet, truth: dict[str, Any], experiment: Experiment, seed: int) -> MeasuredSet:
    """The old logs and those of the experiment, run on the same hidden machine."""
    from testbed import run_again

    def goals(time: np.ndarray) -> np.ndarray:
        at = np.floor((time - time[0]) * GOAL_RATE + 1e-6).astype(int)
        return experiment.goal[np.clip(at, 0, len(experiment.goal) - 1)]

    duration = len(experiment.goal) / GOAL_RATE
    more = run_again(data, truth, goals, experiment.load, duration=duration, runs=experiment.repeats, seed=seed)
    tag = len(data.runs)
    runs = [run.__class__(**{**run.__dict__, "name": f"{run.name}_{tag}"}) for run in more]
    return MeasuredSet((*data.runs, *runs), data.name)


def summary(found: JointDiagnosis) -> dict[str, Any]:
    """What a diagnosis said."""
    causes = [cause for cause in found.causes if cause.kind != "data"]
    return {
        "verdict": found.verdict,
        "causes": [[cause.name, cause.confidence, list(cause.rivals)] for cause in causes],
        "experiment": None
        if (e := found.experiment) is None
        else {"name": e.name, "load": e.load, "separation": e.separation, "rivals": list(e.rivals)},
    }


def run(effect: str, kind: str, size: str, seed: int) -> dict[str, Any]:
    """One case: the poor set, then experiments until the verdict is closed."""
    from testbed import hidden_bench

    hidden: dict[str, dict[str, float] | str | float] = {effect: size} if effect else {}
    data, truth = hidden_bench(hidden, seed, "medium", runs=2, duration=8.0, schedules=(POOR[kind],))
    rows, began = [], time.perf_counter()
    (found,) = diagnose(data)
    rows.append(summary(found))
    for number in range(EXPERIMENTS):
        if found.experiment is None:
            break
        data = record_experiment(data, truth, found.experiment, seed + number)
        (found,) = diagnose(data)
        rows.append(summary(found))
    return {
        "key": f"{effect or 'nothing'}:{size} {kind} #{seed}",
        "effect": effect,
        "steps": rows,
        "seconds": time.perf_counter() - began,
    }


def outcome(effect: str, step: dict[str, Any]) -> str:
    """``right``, ``open`` (with the right name among the rivals or none named) or ``wrong``."""
    names = [name for name, _, _ in step["causes"]]
    if not effect:
        return "right" if not names and step["verdict"] == "nothing to explain" else "open" if not names else "wrong"
    if not names or step["verdict"] in ("not identifiable", "nothing to explain", "unusable log"):
        return "open"
    if names[0] == effect:
        return "right"
    return "open" if effect in step["causes"][0][2] and step["causes"][0][1] < 0.9 else "wrong"


@study
def main() -> None:
    """Command line."""
    parser = command(__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=[12, 13])
    parser.add_argument("--effects", nargs="+", help="default: all")
    parser.add_argument("--out", type=Path, default=RESULTS / "next_experiment")
    options = parser.parse_args()
    kept = Kept(options.out.with_suffix(".jsonl"))
    todo = [
        (effect, kind, size, seed) for seed in options.seeds for effect, kind, size in CASES
        if f"{effect or 'nothing'}:{size} {kind} #{seed}" not in kept
        and not (options.effects and effect not in options.effects)
    ]  # fmt: skip
    kept.run(lambda case: run(*case), todo,
             lambda row: " -> ".join(outcome(row["effect"], step) for step in row["steps"]))  # fmt: skip
    write(options.out, told(kept.rows))


def told(rows: Sequence[dict[str, Any]]) -> str:
    """The page."""
    cells = []
    for row in rows:
        effect, steps = row["effect"], row["steps"]
        said = []
        for step in steps:
            named = ", ".join(f"{name} {confidence:.2f}" for name, confidence, _ in step["causes"]) or "–"
            said.append(f"{outcome(effect, step)}: {step['verdict']} ({named})")
        proposed = [step["experiment"] for step in steps[: len(steps) - 1]]
        what = "; ".join(f"{p['name']}, {p['load']['mass']:.3g} kg" for p in proposed) or "–"
        hidden, kind, seed = row["key"].split(" ")
        cells.append((f"{hidden} {seed}", kind, said[0], what, "; ".join(said[1:]) or "–"))
    before, after = (_counts(outcome(row["effect"], row["steps"][k]) for row in rows) for k in (0, -1))
    return page(
        "Next experiment (`python -m benchmarks.next_experiment`)",
        "Hidden effect, poor set, verdict on it, what was proposed and run, and the verdict on all logs together.",
        table(("hidden", "poor set", "at first", "proposed", "then"), cells),
        f"Before: {before}. After: {after}.",
    )


def _counts(outcomes: Iterable[str]) -> str:
    return ", ".join(f"{count} {name}" for name, count in sorted(Counter(outcomes).items()))


if __name__ == "__main__":
    sys.exit(main())
