"""Pictures of a whole diagnosis: the one that a report opens with, a telling stretch and what the error is made of; and
the whole log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from ...log.types import MeasuredRun
from ...search.structure import told_in
from ...verdict.verdict import JointDiagnosis
from ..numbers import LAYOUT, percent
from .style import (
    CAUSES,
    COLOURS,
    DASHES,
    NAMES,
    NOISE,
    SHARED,
    TEST_SHADE,
    TUNED,
    UNEXPLAINED,
    figure,
    legend_above,
    styled,
)
from .timeline import Timeline, timeline, worst_window

GOAL = "#9a9a9a"
UNEXPLAINED_LABEL, NOISE_LABEL = "unexplained", "noise"


@dataclass(frozen=True)
class Slice:
    """A share of the nominal model's mean squared error, 0 to 1."""

    label: str
    share: float
    colour: str
    hatch: str = ""


def budget_slices(diagnosis: JointDiagnosis) -> list[Slice]:
    """The gap budget, which adds up to one: what the robot has, causes, tuned numbers, unexplained structure, noise."""
    if "nominal" not in diagnosis.gap or "noise_floor" not in diagnosis.gap:
        return []
    nominal, floor = diagnosis.gap["nominal"].rmse, diagnosis.gap["noise_floor"].rmse
    noise = min(floor**2 / max(nominal**2, 1e-30), 1.0)
    causes = [cause for cause in diagnosis.causes if cause.share > 0.0]
    slices = [Slice(cause.name, cause.share * (1.0 - noise), CAUSES[k % len(CAUSES)]) for k, cause in enumerate(causes)]
    slices.insert(0, Slice("whole robot", diagnosis.shared_share * (1.0 - noise), SHARED))
    turned = "refitted numbers" if diagnosis.refitted or diagnosis.model == "refitted" else "tuned numbers"
    slices.append(Slice(turned, diagnosis.tuned_share * (1.0 - noise), TUNED, ".."))
    slices.append(Slice(UNEXPLAINED_LABEL, diagnosis.unexplained * (1.0 - noise), UNEXPLAINED, "//"))
    slices.append(Slice(NOISE_LABEL, noise, NOISE))
    least = 5e-4 * sum(piece.share for piece in slices)
    shown = [piece for piece in slices if piece.share > least]
    total = sum(piece.share for piece in shown)
    return [Slice(s.label, s.share / total, s.colour, s.hatch) for s in shown]


@styled
def first_look(diagnosis: JointDiagnosis, tall: bool = False) -> Figure | None:
    """Where the nominal model is most wrong, over time, beside the error as it falls from cause to cause.

    Args:
        diagnosis: of one joint.
        tall: one below the other, for a phone.

    Returns:
        The second alone where nothing was replayed; None where no model was compared.
    """
    line, slices = timeline(diagnosis), budget_slices(diagnosis)
    if not slices:
        return None
    if line is None or not len(line.x):
        chart = figure(*LAYOUT.alone)
        waterfall(chart.subplots(), diagnosis, slices)
        return chart
    chart = figure(*(LAYOUT.tall if tall else LAYOUT.wide))
    if tall:
        above, beside = chart.subfigures(2, 1, squeeze=False, height_ratios=(1.35, 1.0)).flat
    else:
        above, beside = chart.subfigures(1, 2, squeeze=False, width_ratios=(1.25, 1.0)).flat
    signals, errors = above.subplots(2, 1, sharex=True, height_ratios=(1.5, 1.0))
    over_time(signals, errors, line, diagnosis)
    legend_above(signals, 2 if tall else 4)
    waterfall(beside.subplots(), diagnosis, slices)
    return chart


def over_time(signals: Axes, errors: Axes, line: Timeline, diagnosis: JointDiagnosis) -> None:
    """Measured, nominal and extended on the stretch of the test part where the nominal model is most wrong."""
    start, stop = stretch(line)
    at = np.flatnonzero((line.x >= start) & (line.x <= stop))
    x = line.x[at] - start
    factor, unit = told_in(line.unit)
    if line.goal is not None:
        signals.plot(x, line.goal[at], color=GOAL, lw=1.0, ls="--", label="goal")
    signals.plot(x, line.measured[at], color=COLOURS["measured"], lw=2.6, label=NAMES["measured"])
    for name in ("nominal", "extended"):
        if name in line.models and (name == "nominal" or diagnosis.model != "nominal"):
            values = line.models[name][at]
            signals.plot(x, values, color=COLOURS[name], lw=1.5, label=NAMES[name])
            errors.plot(x, factor * (line.measured[at] - values), color=COLOURS[name], lw=1.3)
    noise = 2.0 * factor * diagnosis.gap["noise_floor"].rmse
    errors.axhspan(-noise, noise, color="#000000", alpha=0.13, lw=0.0)
    signals.set_xlim(0.0, stop - start)
    signals.set_ylabel(f"{line.quantity} [{line.unit}]")
    errors.set_ylabel(f"error [{unit}]")
    errors.set_xlabel("time [s], where the nominal model is most wrong")


def stretch(line: Timeline) -> tuple[float, float]:
    """Where the nominal model is most wrong in the test part, wide enough to show a motion."""
    period = float(np.nanmedian(np.diff(line.x)))
    return worst_window(line, min(max(LAYOUT.moment, LAYOUT.moment_samples * period), float(line.x[-1] - line.x[0])))


def waterfall(axes: Axes, diagnosis: JointDiagnosis, slices: list[Slice]) -> None:
    """The nominal model's error, what each finding takes away of it, and what is left; squares, as these add up."""
    factor, unit = told_in(diagnosis.unit)
    errors = {name: factor * item.rmse for name, item in diagnosis.gap.items()}
    noise = sum(piece.share for piece in slices if piece.label == NOISE_LABEL)
    left = [piece for piece in slices if piece.label in (UNEXPLAINED_LABEL, NOISE_LABEL)]
    taken = _gathered([piece for piece in slices if piece not in left])
    rows = ["nominal model"]
    _bar(axes, 0, 0.0, Slice("", 1.0, COLOURS["nominal"]))
    _tell(axes, 0, 1.0, _told(errors["nominal"], unit))
    level = 1.0
    for piece in taken:
        _step(axes, len(rows), level)
        _bar(axes, len(rows), level - piece.share, piece)
        of_the_gap = percent(piece.share / max(1.0 - noise, piece.share))
        _tell(axes, len(rows), level, f"\N{MINUS SIGN}{of_the_gap}{' of the gap' if len(rows) == 1 else ''}")
        level -= piece.share
        rows.append(piece.label)
    if taken:
        _step(axes, len(rows), level)
    if taken or len(left) > 1:
        end = 0.0
        for piece in reversed(left):
            _bar(axes, len(rows), end, piece)
            end += piece.share
        of = errors.get("extended", errors["nominal"]) if taken else errors["nominal"]
        _tell(axes, len(rows), end, _told(of, unit))
        rows.append("what is left" if taken else "of it unexplained")
    _bar(axes, len(rows), 0.0, Slice("", noise, NOISE))
    _tell(axes, len(rows), noise, _told(errors["noise_floor"], unit))
    rows.append("noise of the reading")
    axes.set_yticks(range(len(rows)), rows)
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_xlim(0.0, 1.0)
    ticks = _ticks(errors["nominal"])
    axes.set_xticks([(tick / errors["nominal"]) ** 2 for tick in ticks], [f"{tick:g}" for tick in ticks])
    axes.set_xlabel(f"rms error [{unit}], squares to scale")
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="y", visible=False)


def _ticks(most: float) -> list[float]:
    """Round errors up to the largest, far enough apart where squares are drawn."""
    kept = [0.0]
    for tick in MaxNLocator(8, steps=[1, 2, 2.5, 5, 10]).tick_values(0.0, most):
        if kept[-1] < tick <= most and (tick / most) ** 2 - (kept[-1] / most) ** 2 > 0.09:
            kept.append(float(tick))
    return kept


def _told(error: float, unit: str) -> str:
    return f"{error:#.3g}".rstrip(".") + f" {unit}"


def _step(axes: Axes, row: int, level: float) -> None:
    axes.plot([level, level], [row - 1 - 0.5 * LAYOUT.bar, row + 0.5 * LAYOUT.bar], color="#555555", lw=0.7)


def _gathered(taken: list[Slice]) -> list[Slice]:
    """The largest with a row of their own, the rest in one."""
    if len(taken) <= LAYOUT.causes + 1:
        return taken
    rest = taken[LAYOUT.causes :]
    return [*taken[: LAYOUT.causes], Slice(f"{len(rest)} more", sum(piece.share for piece in rest), SHARED)]


def _bar(axes: Axes, row: int, left: float, piece: Slice) -> None:
    axes.barh(
        row, piece.share, left=left, color=piece.colour, hatch=piece.hatch, edgecolor="white", lw=0.8, height=LAYOUT.bar
    )


def _tell(axes: Axes, row: int, right: float, text: str) -> None:
    """A number beside the right end of a bar, or within it where there is no room."""
    room = right < 0.72
    axes.annotate(
        text, (right, row), xytext=(4 if room else -4, 0), textcoords="offset points",
        ha="left" if room else "right", va="center", fontsize=9.5, weight="bold", color="#1c2126",
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.2, "alpha": 0.0 if room else 0.75},
    )  # fmt: skip


@styled
def as_logged(run: MeasuredRun, diagnosis: JointDiagnosis, tall: bool = False) -> Figure | None:
    """What a run has of a joint that was not replayed: its goal and position; None where it has nothing."""
    log = run.joints.get(diagnosis.joint)
    if log is None or not np.isfinite(log.position).any():
        return None
    chart = figure(*((5.2, 3.4) if tall else (11.0, 2.6)))
    axes = chart.subplots()
    if log.goal is not None:
        axes.plot(run.time, log.goal, color=GOAL, lw=1.0, ls="--", label="goal")
    axes.plot(run.time, log.position, color=COLOURS["measured"], label=NAMES["measured"])
    axes.set_xlabel(f"time [s] of {run.name}, as it was logged")
    axes.set_ylabel(f"position [{'m' if diagnosis.unit in ('m', 'N') else 'rad'}]")
    axes.ticklabel_format(useOffset=False)
    axes.ticklabel_format(axis="y", scilimits=(-3, 5))
    legend_above(axes, 3)
    return chart


def in_words(diagnosis: JointDiagnosis) -> str:
    """The picture in words, for who cannot see it."""
    parts = ", ".join(f"{piece.label} {percent(piece.share)}" for piece in budget_slices(diagnosis))
    return f"{diagnosis.signal} over time, measured and simulated; the nominal model's mean squared error: {parts}."


# --- the whole log --------------------------------------------------------------------------------------------------


@styled
def overview(diagnosis: JointDiagnosis) -> Figure | None:
    """The whole log and the error of each model; None where nothing was replayed."""
    line = timeline(diagnosis)
    if line is None:
        return None
    chart = figure(9.0, 5.6)
    whole, error = chart.subplots(2, 1)
    thin = line.thinned(12_000)
    if thin.goal is not None:
        whole.plot(thin.x, thin.goal, color=GOAL, lw=0.8, ls="--", label="goal")
    whole.plot(thin.x, thin.measured, color=COLOURS["measured"], lw=1.7, label="measured")
    for name in ("nominal", "extended"):
        if name in thin.models:
            whole.plot(thin.x, thin.models[name], color=COLOURS[name], lw=0.9, label=NAMES[name])
    whole.set_ylabel(f"{line.quantity} [{line.unit}]")
    whole.set_xlabel("time, runs one behind the other [s]")
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
    error.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, borderaxespad=0.2, handlelength=1.6)

    for axes in (whole, error):
        axes.set_xlim(line.x[0], line.x[-1])
        for start, stop in line.tested:
            axes.axvspan(start, stop, color=TEST_SHADE, lw=0.0, zorder=0)
    return chart
