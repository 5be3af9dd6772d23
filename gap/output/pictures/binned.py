"""A cloud of samples as medians with quartiles over bins: what a person can read off a noisy log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from ..numbers import LAYOUT
from .style import EXTENDED, NOMINAL


@dataclass(frozen=True, eq=False)
class Bins:
    """Medians and quartiles (b,) of ``y`` over bins of ``x``."""

    x: np.ndarray
    median: np.ndarray
    low: np.ndarray
    high: np.ndarray


def equal_counts(x: np.ndarray, count: int = 14) -> np.ndarray:
    """Edges of bins that hold about as many samples each (count + 1,)."""
    return np.unique(np.quantile(x, np.linspace(0.0, 1.0, count + 1))) if len(x) else np.zeros(0)


def equal_widths(x: np.ndarray, count: int = 20) -> np.ndarray:
    """Edges of bins of equal width over all but the outermost samples (count + 1,)."""
    if not len(x):
        return np.zeros(0)
    low, high = np.quantile(x, (0.002, 0.998))
    return np.linspace(low, high, count + 1)


def filled(x: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Edges without those of bins with too few samples: each such bin joins the next (c,)."""
    counts = np.histogram(x, edges)[0] if len(edges) > 1 else np.zeros(0)
    kept, inside = [0], 0
    for b, count in enumerate(counts, start=1):
        inside += int(count)
        if inside >= LAYOUT.bin_samples:
            kept.append(b)
            inside = 0
    return edges[kept] if len(edges) else edges


def bins(x: np.ndarray, y: np.ndarray, edges: np.ndarray) -> Bins:
    """Bin samples; bins with too few are left out."""
    number = np.digitize(x, edges[1:-1]) if len(edges) > 1 else np.zeros(len(x), int)
    inside = (x >= edges[0]) & (x <= edges[-1]) if len(edges) > 1 else np.zeros(len(x), bool)
    rows = []
    for b in range(max(len(edges) - 1, 0)):
        use = inside & (number == b)
        if use.sum() >= LAYOUT.bin_samples:
            rows.append((np.median(x[use]), *np.quantile(y[use], (0.5, 0.25, 0.75))))
    table = np.array(rows).reshape(-1, 4)
    return Bins(*table.T)


def draw_measured(axes: Axes, b: Bins, label: str | None, colour: str = "#000000") -> None:
    """Medians as dots, quartiles as bars."""
    spread = np.abs(np.stack([b.median - b.low, b.high - b.median]))
    axes.errorbar(
        b.x, b.median, spread, fmt="o", ms=4.5, color=colour, elinewidth=1.1, capsize=2.0, label=label, zorder=5
    )


def draw_model(axes: Axes, b: Bins, label: str | None, colour: str) -> None:
    """Medians as a line, quartiles as a band."""
    axes.fill_between(b.x, b.low, b.high, color=colour, alpha=0.18, lw=0.0)
    axes.plot(b.x, b.median, color=colour, label=label, zorder=4)


def draw_models(
    axes: Axes, x: np.ndarray, models: tuple[np.ndarray, np.ndarray], edges: np.ndarray, *, told: bool = True
) -> None:
    """What the nominal and the extended model have, each as :func:`draw_model`, in the legend if ``told``."""
    for y, label, colour in zip(models, ("nominal model", "extended model"), (NOMINAL, EXTENDED), strict=True):
        draw_model(axes, bins(x, y, edges), label if told else None, colour)


def cloud(axes: Axes, x: np.ndarray, y: np.ndarray, most: int = 4000) -> None:
    """The samples themselves, thinned, behind everything."""
    every = max(len(x) // most, 1)
    axes.plot(x[::every], y[::every], ".", ms=1.6, color="#000000", alpha=0.12, zorder=1, rasterized=True)


def limits(values: np.ndarray, margin: float = 0.25) -> tuple[float, float]:
    """Axis limits that hold all but the outermost samples."""
    low, high = np.quantile(values, (0.01, 0.99)) if len(values) else (-1.0, 1.0)
    pad = margin * max(high - low, 1e-9)
    return float(low - pad), float(high + pad)
