"""The gap before and after a diagnosis, drawn."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..gap.output.pictures.style import COLOURS, MEASURED, NAMES, figure, styled
from .figures import UNITS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Documents = Mapping[str, Mapping[str, Any]]
"""Contents of ``comparison.json`` by the model that the policy was trained on; null in them is what there is not."""


@styled
def draw_gap(documents: Documents, path: Path) -> Path:
    """Bars: position error of each model on the machine's goals, in rad and in m, and what each policy earns where."""
    figures = {name: document["figures"] for name, document in documents.items()}
    models = [name for name in next(iter(figures.values())) if name != "machine"]
    there = {
        unit: key
        for unit, key in UNITS.items()
        if any(row[model].get(key) is not None for row in figures.values() for model in models)
    }
    image = figure(4.0 * (1 + len(there)), 3.6)
    *errors, right = image.subplots(1, 1 + len(there))
    for axes, (unit, key) in zip(errors, there.items(), strict=True):
        _bars(axes, figures, models, key, 1e3, "%.3g")
        axes.set_title("Gap between model and machine")
        axes.set_ylabel(f"position error, same goals [{unit}]")
    _bars(right, figures, [*models, "machine"], "reward", 1.0)
    right.set_title("What the policy earns")
    right.set_ylabel("reward per second")
    for axes in (*errors, right):
        axes.set_xticks(range(len(figures)), [f"policy of the\n{name} model" for name in figures])
        axes.margins(y=0.15)
        axes.grid(axis="x", visible=False)
    right.legend(loc="lower center", bbox_to_anchor=(0.5, -0.42), ncols=3, fontsize=8)
    image.savefig(path)
    return path


def _bars(axes: Axes, figures: Documents, columns: Sequence[str], key: str, factor: float, label: str = "") -> None:
    """One figure of each policy, a bar for each of the columns: models and machine."""
    width = 0.8 / len(columns)
    for k, column in enumerate(columns):
        found = [row[column].get(key) for row in figures.values()]
        values = [math.nan if value is None else factor * value for value in found]
        places = [n + (k - 0.5 * (len(columns) - 1)) * width for n in range(len(figures))]
        colour = MEASURED if column == "machine" else COLOURS[column]
        bars = axes.bar(places, values, width, color=colour, label=NAMES.get(column, column))
        if label:
            axes.bar_label(bars, fmt=label, padding=2)
