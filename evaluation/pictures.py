"""Pictures of comparisons: the gap before and after a diagnosis, errors by treatment, what a motor's torque goes into.

:data:`STYLE` is that of pictures beside a paper's: plain axes, drawn without a display.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from ..gap.output.pictures.style import COLOURS, MEASURED, NAMES, figure, styled
from .figures import UNITS
from .relevant import PARTS, RULE, Run

matplotlib.use("Agg")
from matplotlib import pyplot as plt

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["STYLE", "draw_gap", "draw_parts", "draw_treatments", "plt"]

STYLE: dict[Any, Any] = {
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "font.size": 9,
}
SHOWN = 6  # coordinates in a picture; the others are in the numbers
MARGIN = 1.3  # of an axis of errors beyond the smallest and the largest

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


def draw_treatments(
    robot: str, errors: Mapping[str, Mapping[str, np.ndarray]], order: Sequence[str], file: Path
) -> None:
    """Errors of each treatment on the machines of a robot, a group of points each.

    Args:
        robot: its name.
        errors: of its machines by treatment, of each seed [rad].
        order: of the treatments.
        file: to write.
    """
    treatments = [one for one in order if any(one in own for own in errors.values())]
    with plt.rc_context(STYLE):
        figure, axis = plt.subplots(figsize=(1.6 + 2.2 * len(errors), 3.4))
        for k, treatment in enumerate(treatments):
            for at, own in enumerate(errors.values()):
                if treatment not in own:
                    continue
                x = at + 0.8 * ((k + 0.5) / len(treatments) - 0.5)
                values = 1e3 * own[treatment]
                axis.plot(np.full(len(values), x), values, "o", color=f"C{k}", markersize=4, alpha=0.5)
                axis.plot([x - 0.04, x + 0.04], [values.mean()] * 2, color=f"C{k}", linewidth=2.5,
                          label=treatment if at == 0 else None)  # fmt: skip
        axis.set_xticks(range(len(errors)), list(errors))
        axis.set_yscale("log")
        axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.yaxis.set_minor_formatter(NullFormatter())
        rms = 1e3 * np.concatenate([values for own in errors.values() for values in own.values()])
        axis.set_ylim(rms.min() / MARGIN, rms.max() * MARGIN)
        axis.set_ylabel("tracking error on the machine,\nrms [mrad]")
        axis.set_title(f"{robot}: what a policy was trained on")
        axis.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
        figure.savefig(file, dpi=130, bbox_inches="tight")
        plt.close(figure)


def draw_parts(names: Sequence[str], runs: Sequence[Run], out: Path) -> list[str]:
    """Contributions over time, and shares over tempo; the names of the files."""
    colours = {part: f"C{k}" for k, part in enumerate(PARTS)}
    shown = list(names[:SHOWN])
    columns = min(3, len(shown))
    lines = -(-len(shown) // columns)
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(lines, columns, figsize=(4.0 * columns, 2.6 * lines + 0.8), squeeze=False)
        run = runs[-1]
        for k, (axis, name) in enumerate(zip(axes.flat, shown, strict=False)):
            for part in PARTS:
                if run.shares()[part][k] >= 0.01:
                    axis.plot(run.time, run.parts[part][:, k], color=colours[part], linewidth=1.0)
            axis.plot(run.time, run.motor[:, k], color="black", linewidth=1.2)
            axis.set_title(name)
            largest = np.abs(run.motor[:, k]).max()  # a landing's spikes would hide all else
            low, high = axis.get_ylim()
            axis.set_ylim(max(low, -2.0 * largest), min(high, 2.0 * largest))
        for axis in axes[-1]:
            axis.set_xlabel("time [s]")
        for row in axes:
            row[0].set_ylabel("torque [N.m]")
        handles = [Line2D([], [], color=colours[part], label=part) for part in PARTS]
        handles.append(Line2D([], [], color="black", label="motor"))
        _finish(figure, handles, out / "contributions.png")
        figure, axes = plt.subplots(lines, columns, figsize=(4.0 * columns, 2.6 * lines + 0.8), squeeze=False)
        tempos = [run.tempo for run in runs]
        for k, (axis, name) in enumerate(zip(axes.flat, shown, strict=False)):
            for part in PARTS:
                values = [share if (share := 100.0 * run.shares()[part][k]) > 0.01 else np.nan for run in runs]
                axis.loglog(tempos, values, "o-", markersize=3, color=colours[part])
            axis.axhline(100.0 * RULE, color="black", linewidth=1.0)
            axis.set_title(name)
            axis.set_xticks(tempos, [f"{tempo:g}" for tempo in tempos])
            axis.minorticks_off()
        for axis in axes[-1]:
            axis.set_xlabel("tempo: time for the whole range [s]")
        for row in axes:
            row[0].set_ylabel("share of the torque [%]")
        _finish(figure, handles[:-1], out / "shares.png")
    return ["contributions.png", "shares.png"]


def _finish(figure: Any, handles: Sequence[Any], path: Path) -> None:
    figure.legend(handles=handles, loc="lower center", ncols=4, frameon=False)
    figure.tight_layout(rect=(0.0, 0.5 / figure.get_figheight(), 1.0, 1.0))
    figure.savefig(path, dpi=130)
    plt.close(figure)
