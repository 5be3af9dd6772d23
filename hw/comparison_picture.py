"""The gap before and after a diagnosis, drawn."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..gap.output.pictures.style import COLOURS, MEASURED, NAMES, figure, styled


@styled
def draw_gap(documents: Mapping[str, Mapping[str, Any]], path: Path) -> Path:
    """Bars: position error of each model on the machine's goals, and what each policy earns where.

    Args:
        documents: contents of ``comparison.json`` by the model that the policy was trained on.
        path: of the picture.
    """
    image = figure(8.0, 3.6)
    left, right = image.subplots(1, 2)
    models = [name for name in next(iter(documents.values()))["figures"] if name != "machine"]
    width = 0.8 / len(models)
    for k, model in enumerate(models):
        values = [1e3 * document["figures"][model]["same_goals"] for document in documents.values()]
        places = [n + (k - 0.5 * (len(models) - 1)) * width for n in range(len(documents))]
        bars = left.bar(places, values, width, color=COLOURS[model], label=NAMES[model])
        left.bar_label(bars, fmt="%.1f", padding=2)
    left.set_title("Gap between model and machine")
    left.set_ylabel("position error, same goals [mrad]")
    columns = [*models, "machine"]
    width = 0.8 / len(columns)
    for k, where in enumerate(columns):
        values = [document["figures"][where]["reward"] for document in documents.values()]
        places = [n + (k - 0.5 * (len(columns) - 1)) * width for n in range(len(documents))]
        colour = MEASURED if where == "machine" else COLOURS[where]
        right.bar(places, values, width, color=colour, label="machine" if where == "machine" else NAMES[where])
    right.set_title("What the policy earns")
    right.set_ylabel("reward per second")
    for axes in (left, right):
        axes.set_xticks(range(len(documents)), [f"policy of the\n{name} model" for name in documents])
        axes.margins(y=0.15)
        axes.grid(axis="x", visible=False)
    right.legend(loc="lower center", bbox_to_anchor=(0.5, -0.42), ncols=3, fontsize=8)
    image.savefig(path)
    return path
