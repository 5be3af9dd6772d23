"""What the study found: the error of each treatment on each machine, and what of the way to the limit it goes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import trim_mean

from ...common.markdown import page
from ...common.markdown import table as markdown
from .cells import DRAWN, EVERY, EXTENDED, FINE, HAND, LIMIT, NOMINAL, REFERENCES, SHORT, TREATMENTS

DRAWS = 2000
SURE = 0.95
MIDDLE = 0.25  # of the values that an interquartile mean leaves out at each end


@dataclass(frozen=True)
class Figures:
    """A treatment over all machines.

    Attributes:
        treatment: its name.
        share: of the limit's accuracy, the interquartile mean over machines and seeds, and its 95 % interval.
        median: of the machines' shares.
        closed: share of the way from nominal to limit that is closed on the median machine.
        better: machines on which its error is below that of both hand-made randomisations.
        worse: names of machines on which it is worse than nominal by more than the seeds differ.
        machines: that it was tried on.
    """

    treatment: str
    share: tuple[float, float, float]
    median: float
    closed: float
    better: int
    worse: tuple[str, ...]
    machines: int


def interquartile_mean(values: np.ndarray) -> float:
    """The mean of the middle half of all values: as robust as a median, and less of a lottery."""
    return float(trim_mean(values.ravel(), MIDDLE))


def interval(values: Sequence[np.ndarray], seed: int = 0) -> tuple[float, float, float]:
    """The interquartile mean of values by machine and seed, and its 95 % bootstrap interval.

    Machines are drawn anew, and the seeds of each: what other machines and other seeds would have given.
    """
    rng, rows = np.random.default_rng(seed), [np.asarray(row, float) for row in values]
    drawn = []
    for _ in range(DRAWS):
        chosen = [rows[k] for k in rng.integers(len(rows), size=len(rows))]
        drawn.append(interquartile_mean(np.concatenate([rng.choice(row, len(row)) for row in chosen])))
    low, high = np.quantile(drawn, [0.5 - 0.5 * SURE, 0.5 + 0.5 * SURE])
    return interquartile_mean(np.concatenate(rows)), float(low), float(high)


Errors = Mapping[str, Mapping[str, np.ndarray]]
"""By machine and treatment: the rms error of each seed (s,) [rad]."""


def errors_of(rows: Sequence[Mapping[str, object]], machines: Sequence[str], seeds: Sequence[int]) -> Errors:
    """Errors from the kept rows of cells; references have one."""
    found: dict[str, dict[str, np.ndarray]] = {}
    for name in machines:
        found[name] = {}
        for treatment in (*REFERENCES, *TREATMENTS):
            own = [
                float(np.sqrt(np.mean(np.square(np.asarray(row["rms"], float)))))
                for row in rows
                if row["machine"] == name
                and row["treatment"] == treatment
                and (treatment in REFERENCES or row["seed"] in seeds)
            ]
            if own:
                found[name][treatment] = np.array(own)
    return found


def figures_of(errors: Errors, treatment: str) -> Figures | None:
    """The figures of one treatment; None where no machine has it."""
    there = [name for name, own in errors.items() if treatment in own and LIMIT in own and NOMINAL in own]
    if not there:
        return None
    shares, closed, better, worse = [], [], 0, []
    for name in there:
        own = errors[name]
        error, limit, nominal = own[treatment], float(own[LIMIT].mean()), float(own[NOMINAL].mean())
        shares.append(limit / error)
        closed.append((nominal - error.mean()) / max(nominal - limit, 1e-12))
        rivals = [own[other].mean() for other in (HAND, EVERY) if other in own]
        better += bool(rivals) and bool(error.mean() < min(rivals))
        if error.mean() - nominal > noise(error, own[NOMINAL]):
            worse.append(name)
    return Figures(
        treatment,
        interval(shares),
        float(np.median([row.mean() for row in shares])),
        float(np.median(closed)),
        better,
        tuple(worse),
        len(there),
    )


def noise(one: np.ndarray, other: np.ndarray) -> float:
    """By how much two means of seeds may differ by chance: twice the standard error of their difference."""
    spread = [float(np.var(row, ddof=1)) / len(row) if len(row) > 1 else 0.0 for row in (one, other)]
    return 2.0 * float(np.sqrt(sum(spread)))


def table(
    errors: Errors, passed_over: Sequence[str], told: Sequence[str], hidden: Mapping[str, Mapping[str, Any]]
) -> str:
    """The study as Markdown.

    Args:
        errors: of the machines that are counted.
        passed_over: machines that were tried and are not counted.
        told: lines about the study: how it was run.
        hidden: by machine, what it hides (``effects``) and what was named at its joints (``joints``).
    """
    heads = ("trained on", "share of the limit's accuracy, IQM (95 %)", "median machine", "way to the limit closed",
             "better than both randomisations", "worse than nominal")  # fmt: skip
    over_all, hides = [], []
    for treatment in (*REFERENCES, *TREATMENTS):
        found = figures_of(errors, treatment)
        if found is None:
            continue
        middle, low, high = found.share
        tried = treatment in (EXTENDED, DRAWN, SHORT, FINE)
        over_all.append((
            treatment,
            f"{middle:.2f} ({low:.2f} to {high:.2f})",
            f"{found.median:.2f}",
            "-" if treatment == NOMINAL else f"{found.closed:.0%}",
            f"{found.better} of {found.machines}" if tried else "-",
            "-" if treatment == NOMINAL else f"{len(found.worse)}",
        ))  # fmt: skip
    names = [t for t in (*REFERENCES, *TREATMENTS) if any(t in own for own in errors.values())]
    each = ((name, *(_told(own.get(treatment)) for treatment in names)) for name, own in errors.items())
    for name, own in errors.items():
        found = figures_of({name: own}, EXTENDED)
        effects = [
            f"{row['name']} at {row['joint']} {1e3 * max(row['moves'].values()):.1f}" for row in hidden[name]["effects"]
        ]
        named = [
            f"{cause} at {joint} ({sure:.2f})"
            for joint, row in hidden[name]["joints"].items()
            for cause, sure in row["causes"].items()
        ]
        closed = "-" if found is None else f"{found.closed:.0%}"
        hides.append((name, ", ".join(effects) or "-", ", ".join(named) or "-", closed))
    parts = [
        "\n".join(told),
        markdown(heads, over_all),
        "Error on the machine, rms, mean of the seeds (smallest to largest) [mrad]:",
        markdown(("machine", *names), each),
        "What each machine hides, with how far it moves the log [mrad, rms], and what the diagnosis named:",
        markdown(("machine", "hidden", "named", "way to the limit closed, extended"), hides),
        f"Passed over, since nominal lost too little there: {', '.join(passed_over)}." if passed_over else "",
    ]
    return page("Transfer", *parts)


def _told(values: np.ndarray | None) -> str:
    if values is None:
        return "-"
    middle = f"{1e3 * values.mean():.2f}"
    return middle if len(values) < 2 else f"{middle} ({1e3 * values.min():.2f} to {1e3 * values.max():.2f})"
