"""One look for every picture: colours that the colour-blind tell apart, the same meaning everywhere."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec, TypeVar

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

MEASURED, NOMINAL, REFITTED, EXTENDED = "#000000", "#e08214", "#8c8c8c", "#0072b2"
COLOURS = {"measured": MEASURED, "nominal": NOMINAL, "refitted": REFITTED, "extended": EXTENDED}
NAMES = {"measured": "measured", "nominal": "nominal model", "refitted": "refitted model", "extended": "extended model"}
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
