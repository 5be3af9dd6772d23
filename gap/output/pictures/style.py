"""One look for every picture: colours that the colour-blind tell apart, the same meaning everywhere."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..numbers import LAYOUT

MEASURED, NOMINAL, REFITTED, EXTENDED = "#000000", "#e08214", "#8c8c8c", "#0072b2"
COLOURS = {"measured": MEASURED, "nominal": NOMINAL, "refitted": REFITTED, "extended": EXTENDED}
NAMES = {"measured": "measured", "nominal": "nominal model", "refitted": "refitted model", "extended": "extended model"}
BOTH = (("nominal", NOMINAL), ("extended", EXTENDED))
"""The models that are compared, with their colours."""
DASHES = {"nominal": "-", "refitted": ":", "extended": "-"}
CAUSES = ("#0072b2", "#009e73", "#cc79a7", "#56b4e9", "#7b5ea7", "#b8a500")  # Okabe and Ito, without the orange
TUNED, UNEXPLAINED, NOISE, SHARED = "#a6c3d6", "#d55e00", "#c9c9c9", "#51606b"
TEST_SHADE = "#e9eff5"

STYLE: Any = {
    "font.size": 10.0,
    "axes.titlesize": 11.0,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.7,
    "legend.frameon": False,
    "legend.fontsize": 9.0,
    "lines.linewidth": 1.6,
    "figure.dpi": 150.0,
    "savefig.dpi": 150.0,
    "hatch.linewidth": 0.6,
}

Arguments = ParamSpec("Arguments")
Drawn = TypeVar("Drawn")


def styled(draw: Callable[Arguments, Drawn]) -> Callable[Arguments, Drawn]:
    """Draw in the style, without leaving it behind for others."""

    @wraps(draw)
    def inside(*arguments: Arguments.args, **keywords: Arguments.kwargs) -> Drawn:
        with rc_context(STYLE):
            return draw(*arguments, **keywords)

    return inside


def figure(width: float = 5.8, height: float = 4.0) -> Figure:
    """An empty figure of a size in inches."""
    return Figure(figsize=(width, height), layout="constrained")


def plot(width: float = 5.8, height: float = 4.0) -> tuple[Figure, Axes]:
    """An empty figure with one plot in it."""
    chart = figure(width, height)
    return chart, chart.subplots()


def legend_above(axes: Axes, columns: int = 3) -> None:
    """A legend above the axes, where it hides no data."""
    axes.legend(
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=columns,
        borderaxespad=0.2,
        handlelength=1.6,
        columnspacing=1.2,
    )


# --- a cloud of samples as medians with quartiles over bins: what a person can read off a noisy log -------------------


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
