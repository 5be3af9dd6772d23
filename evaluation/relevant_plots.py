"""Pictures of what a motor's torque goes into."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.lines import Line2D

from .plot_style import STYLE, plt
from .relevant import PARTS, RULE, Run

SHOWN = 6  # coordinates in a picture; the others are in the numbers


def draw(names: Sequence[str], runs: Sequence[Run], out: Path) -> list[str]:
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
