"""How often a named cause is right, over the confidence that it was named with: kept cases of the hidden benches.

``python -m benchmarks.calibration`` reads ``hidden``, ``hidden_drawn`` and ``hidden_wide`` and writes
``benchmarks/results/calibration.{md,png}``. It computes nothing anew.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest
from sealegs.common.markdown import page, table

from benchmarks.kept import RESULTS, Kept, command, read, study, write

BINS = (0.0, 0.3, 0.6, 0.8, 0.9, 0.97, 1.0)
SAME = {
    "transmission.gear_ratio": {"drive.motor_constant"},
    "load.centre_of_mass": {"load.mass"},
    "drive.overload": {"drive.saturation"},
}
"""Names that one hidden number goes by: of an arm with one load, of a drive at its limit."""
SURE, CERTAIN = 0.6, 0.9
"""Thresholds of the verdict that are judged: ``sure`` and ``certain`` of :mod:`sealegs.gap.measure.confidence`."""


@dataclass(frozen=True)
class Bin:
    """Named causes of about one confidence: its mean, the share that is hidden, and how many there are."""

    confidence: float
    right: float
    count: int

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the share (Wilson)."""
        ends = binomtest(round(self.right * self.count), self.count).proportion_ci(0.95, method="wilson")
        return float(ends.low), float(ends.high)


def is_right(cause: Mapping[str, Any], row: Mapping[str, Any]) -> bool:
    """Whether a named cause is hidden, by its own name or by another of the same number."""
    return bool({cause["name"], *SAME.get(cause["name"], set())} & set(row["effects"]))


def told(rows: Sequence[Mapping[str, Any]]) -> list[tuple[float, bool]]:
    """Confidence of each named cause, and whether it is right; faults of the data are not among them."""
    return [(c["confidence"], is_right(c, row)) for row in rows for c in row["causes"] if c.get("kind") != "data"]


def reliability(rows: Sequence[Mapping[str, Any]]) -> list[Bin]:
    """The bins of confidence that have any cause."""
    every, table = told(rows), []
    for low, high in itertools.pairwise(BINS):
        inside = [(c, right) for c, right in every if low < c <= high or (low == 0.0 and c == 0.0)]
        if inside:
            confidence, right = (float(np.mean(values)) for values in zip(*inside, strict=True))
            table.append(Bin(confidence, right, len(inside)))
    return table


def calibration_error(rows: Sequence[Mapping[str, Any]]) -> float:
    """Expected calibration error: mean distance of confidence and share right, weighted by the causes of each bin."""
    table = reliability(rows)
    return sum(b.count * abs(b.confidence - b.right) for b in table) / max(sum(b.count for b in table), 1)


def by_chance(rows: Sequence[Mapping[str, Any]], draws: int = 1000) -> tuple[float, float]:
    """Calibration error of a finder whose confidences are exactly right: mean over draws, and their 95 % quantile.

    A bin of few causes is off by chance, so that the error of few cases is never near zero.
    """
    rng = np.random.default_rng(0)
    sure = np.clip([confidence for confidence, _ in told(rows)], 0.0, 1.0)
    bins = np.clip(np.searchsorted(BINS, sure, side="left") - 1, 0, len(BINS) - 2)
    right = rng.random((draws, len(sure))) < sure
    members = bins == np.arange(len(BINS) - 1)[:, None]
    errors = np.abs((right - sure) @ members.T).sum(axis=1) / max(len(sure), 1)
    return float(errors.mean()), float(np.quantile(errors, 0.95))


def picture(sets: Mapping[str, Sequence[Mapping[str, Any]]], path: Path) -> None:
    """The reliability diagram."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0, 4.8), layout="constrained")
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color="0.6", linewidth=1, label="calibrated")
    for k, (name, rows) in enumerate(sets.items()):
        table = reliability(rows)
        if not table:
            continue
        at = [b.confidence + 0.006 * k for b in table]
        count, off = sum(b.count for b in table), 100 * calibration_error(rows)
        errors = np.abs(np.array([b.interval for b in table]) - np.array([[b.right] for b in table])).T
        axes.errorbar(
            at, [b.right for b in table], yerr=errors, fmt="o-", capsize=3, color=f"C{k}",
            label=f"{name}: {count} named causes, error {off:.1f} points",
        )  # fmt: skip
        for x, b in zip(at, table, strict=True):
            axes.annotate(str(b.count), (x, b.right), xytext=(5, -11), textcoords="offset points", fontsize=8)
    axes.set_xlim(0, 1.04)
    axes.set_ylim(-0.02, 1.04)
    axes.set_xlabel("confidence that a cause is named with")
    axes.set_ylabel("share that is hidden (95 %)")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), fontsize=8)
    figure.savefig(path, dpi=110)


def said(sets: Mapping[str, Sequence[Mapping[str, Any]]]) -> str:
    """The figures, as markdown."""
    cells = []
    for name, rows in {**sets, "all": [row for one in sets.values() for row in one]}.items():
        every = told(rows)
        parts = [
            [right for c, right in every if low <= c < high]
            for low, high in ((CERTAIN, 2.0), (SURE, CERTAIN), (-1.0, SURE))
        ]
        shares = [f"{sum(part)} of {len(part)}" for part in parts]
        error, (mean, most) = calibration_error(rows), by_chance(rows)
        cells.append((name, len(every), f"{100 * error:.1f} points", *shares,
                      f"{100 * mean:.1f}, up to {100 * most:.1f} points"))  # fmt: skip
    heads = ("bench", "named causes", "calibration error", f"right of those named with {CERTAIN:g} or more",
             f"with {SURE:g} to {CERTAIN:g}", "with less", "by chance alone: mean, and 95 % of draws")  # fmt: skip
    bins = (
        (name, f"{b.confidence:.2f}", f"{b.right:.2f} ({b.interval[0]:.2f} to {b.interval[1]:.2f})", b.count)
        for name, rows in sets.items() for b in reliability(rows)
    )  # fmt: skip
    return page(
        "Calibration of confidences",
        "Made by `python -m benchmarks.calibration` from the kept cases of the hidden benches.",
        "![reliability](calibration.png)",
        "The last column is for a finder whose confidences are exactly right: bins of few causes are off by chance.",
        table(heads, cells),
        table(("bench", "confidence (mean of the bin)", "share right (95 %)", "causes"), bins),
    )


def kept() -> dict[str, list[dict[str, Any]]]:
    """Cases of each bench that has any."""
    sets = {name: read(name, {"cases": []})["cases"] for name in ("hidden", "hidden_drawn")}
    sets["hidden_wide"] = Kept(RESULTS / "hidden_wide.jsonl").rows
    return {name: rows for name, rows in sets.items() if rows}


@study
def main() -> None:
    """Command line."""
    command(__doc__).parse_args()
    sets = kept()
    write("calibration", said(sets))
    picture(sets, RESULTS / "calibration.png")
    print(said(sets))


if __name__ == "__main__":
    sys.exit(main())
