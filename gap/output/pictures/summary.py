"""Pictures of a whole diagnosis: over time, the candidates side by side, and the next experiment."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ...search.structure import told_in
from ...verdict.verdict import JointDiagnosis
from ..layout import LAYOUT
from .style import (
    CAUSES,
    COLOURS,
    DASHES,
    NAMES,
    TEST_SHADE,
    UNEXPLAINED,
    figure,
    styled,
)
from .timeline import Timeline, timeline

BESIDE = "#c4c4c4"  # what is shown for comparison


@styled
def overview(diagnosis: JointDiagnosis) -> Figure | None:
    """The whole log and the error of each model; None where nothing was replayed."""
    line = timeline(diagnosis)
    if line is None:
        return None
    chart = figure(9.0, 5.6)
    whole, error = chart.subplots(2, 1)
    thin = line.thinned(12_000)
    _signals(whole, thin, 0.9)
    whole.set_ylabel(f"{line.quantity} [{line.unit}]")
    whole.set_xlabel("time, runs one behind the other [s]")
    _shade(whole, line)
    handles, labels = whole.get_legend_handles_labels()
    handles.append(Patch(color=TEST_SHADE))
    whole.legend(
        handles, [*labels, "test part: nothing was fitted to it"], loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=6,
        borderaxespad=0.2, handlelength=1.6, columnspacing=1.2,
    )  # fmt: skip

    factor, unit = told_in(line.unit)
    noise = factor * diagnosis.gap["noise_floor"].rmse if "noise_floor" in diagnosis.gap else 0.0
    for name, values in thin.models.items():
        error.plot(
            thin.x, factor * (thin.measured - values), color=COLOURS[name], ls=DASHES[name], lw=0.9, label=NAMES[name]
        )
    error.axhspan(
        -2.0 * noise, 2.0 * noise, color="#000000", alpha=0.13, lw=0.0, label="noise (two deviations)", zorder=5
    )
    error.set_ylabel(f"measured minus model [{unit}]")
    error.set_xlabel("time, runs one behind the other [s]")
    _shade(error, line)
    error.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, borderaxespad=0.2, handlelength=1.6)

    for axes in (whole, error):
        axes.set_xlim(line.x[0], line.x[-1])
    return chart


def _signals(axes: Axes, line: Timeline, width: float) -> None:
    if line.goal is not None:
        axes.plot(line.x, line.goal, color="#9a9a9a", lw=0.8, ls="--", label="goal")
    axes.plot(line.x, line.measured, color=COLOURS["measured"], lw=width + 0.8, label="measured")
    for name in ("nominal", "extended"):
        if name in line.models:
            axes.plot(line.x, line.models[name], color=COLOURS[name], lw=width, label=NAMES[name])


def _shade(axes: Axes, line: Timeline) -> None:
    for start, stop in line.tested:
        axes.axvspan(start, stop, color=TEST_SHADE, lw=0.0, zorder=0)


# --- candidates and experiment -------------------------------------------------------------------------------------


@styled
def rivals(diagnosis: JointDiagnosis) -> Figure | None:
    """Held-out error of the candidates of each round of the search; None where nothing was searched."""
    search = diagnosis.search
    rounds = [r for r in search.rounds if r.candidates][: LAYOUT.rounds] if search is not None else []
    if search is None or not rounds:
        return None
    total = float(search.counts.sum())
    shown = [r.candidates[: LAYOUT.candidates] for r in rounds]
    chart = figure(7.6, 1.0 + 0.34 * sum(len(s) + 2.2 for s in shown))
    panels = chart.subplots(len(rounds), 1, height_ratios=[len(s) + 1.2 for s in shown], squeeze=False)[:, 0]
    for number, (axes, step, candidates) in enumerate(zip(panels, rounds, shown, strict=True), start=1):
        levels = [float(np.sqrt(c.blocks.sum() / total)) for c in candidates]
        before = float(np.sqrt(step.before.sum() / total))
        for k, (c, level) in enumerate(zip(candidates, levels, strict=True)):
            chosen = step.accepted and k == 0
            rival = k > 0 and c.best > search.settings.rival_win_rate
            colour = CAUSES[(number - 1) % len(CAUSES)] if chosen else UNEXPLAINED if rival else BESIDE
            axes.barh(k, level, color=colour, height=0.72)
            note = f"{level:.2f}   wins {100.0 * c.best:.0f} % of draws" if c.best > 0.005 else f"{level:.2f}"
            axes.text(
                level, k, f"  {note}", va="center", fontsize=8.5, zorder=6,
                bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5, "alpha": 0.85},
            )  # fmt: skip
        axes.axvline(1.0, color="black", lw=1.0)
        axes.axvline(before, color="#555555", lw=1.0, ls="--")
        axes.text(
            before, -0.85, f"without any of them {before:.2f} ", ha="right", va="center", fontsize=8, color="#555555"
        )
        axes.set_yticks(range(len(candidates)), [c.cause.key for c in candidates], fontsize=9)
        axes.set_ylim(len(candidates) - 0.4, -1.3)
        axes.set_xlim(0.0, 1.35 * max(before, *levels))
        axes.grid(axis="y", visible=False)
        end = "accepted" if step.accepted else "none pays: the search ends"
        axes.set_title(f"Round {number}: {end}")
    panels[-1].set_xlabel("error on data that the fit did not see, in noise floors (line: noise)")
    accepted = [k for k, step in enumerate(rounds) if step.accepted]
    told = [(CAUSES[accepted[0] % len(CAUSES)], "accepted")] if accepted else []
    most = 100.0 * search.settings.rival_win_rate
    told += [(UNEXPLAINED, f"rival: wins more than {most:.0f} % of draws"), (BESIDE, "worse")]
    chart.legend(
        handles=[Patch(color=colour, label=label) for colour, label in told], loc="outside lower right", ncols=3
    )
    return chart


@styled
def experiment(diagnosis: JointDiagnosis) -> Figure | None:
    """The proposed excitation, and how far each of the library separates the rivals; None where none is proposed."""
    proposal = diagnosis.experiment
    if proposal is None:
        return None
    chart = figure(7.6, 5.0)
    over_time, table = chart.subplots(2, 1, height_ratios=(1.3, 1.0))
    over_time.plot(proposal.time, proposal.goal, color=COLOURS["extended"])
    over_time.set_xlabel("time [s]")
    over_time.set_ylabel("goal [rad]")
    over_time.set_title(f"Next experiment: {proposal.name}")
    names = sorted(proposal.table, key=lambda name: -proposal.table[name])
    values = [proposal.table[name] for name in names]
    table.barh(names, values, color=[COLOURS["extended"] if name == proposal.name else BESIDE for name in names])
    for k, value in enumerate(values):
        table.text(value, k, f"  {value:.3g}", va="center", fontsize=8.5)
    table.invert_yaxis()
    table.grid(axis="y", visible=False)
    table.set_xlim(0.0, 1.12 * max(*values, 1e-9))
    table.set_xlabel("difference of the rivals, in noise floors")
    return chart
