"""The paper's figures 8 to 12, drawn from our recordings."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from ...evaluation.pictures import STYLE, plt
from .paper import Standing, Walk

COLOURS = {"none": "tab:gray", "dry/viscous": "tab:orange", "LuGre": "tab:blue", "dry/viscous 2": "tab:red"}


def plot_standing(cases: Mapping[str, Standing], path: Path) -> None:
    """Fig. 8: height of the body over time with motors at 0 V."""
    with plt.rc_context(STYLE):
        figure, axis = plt.subplots(figsize=(6.0, 3.6))
        for name, row in cases.items():
            axis.plot(row.time, 1e3 * row.height, color=COLOURS[name], label=name)
        axis.set_xlabel("time [s]")
        axis.set_ylabel("height of the body [mm]")
        axis.legend(frameon=False, title="joint friction")
        figure.tight_layout()
        figure.savefig(path, dpi=130)
        plt.close(figure)


def plot_friction(row: Standing, path: Path) -> None:
    """Fig. 9: friction force at the vertical joint of leg 0 beside the load that it balances."""
    with plt.rc_context(STYLE):
        figure, axis = plt.subplots(figsize=(6.0, 3.6))
        shown = (row.time > 0.0) & (row.time <= 0.6)
        axis.plot(
            row.time[shown], row.load[shown], color="black", linestyle="--", linewidth=1.0, label="load, reversed"
        )
        axis.plot(row.time[shown], row.friction[shown], color=COLOURS["LuGre"], label="LuGre friction")
        axis.set_xlabel("time [s]")
        axis.set_ylabel("force at the vertical joint of leg 0 [N]")
        axis.legend(frameon=False)
        figure.tight_layout()
        figure.savefig(path, dpi=130)
        plt.close(figure)


def plot_limit(row: Standing, limit: np.ndarray, path: Path) -> None:
    """Fig. 10: what the bristles of the vertical joint of leg 0 hold at most, over time and over the joint's speed.

    Args:
        row: the robot that stands on bristles.
        limit: :func:`sealegs.papers.hexapod.paper.limit_by_speed` of its speeds (n,) [N].
        path: of the picture.
    """
    with plt.rc_context(STYLE):
        figure, (over_time, over_speed) = plt.subplots(1, 2, figsize=(8.0, 3.6), sharey=True)
        shown = (row.time > 0.0) & (row.time <= 0.6)
        over_time.plot(row.time[shown], limit[shown], color=COLOURS["LuGre"], linewidth=1.0)
        over_time.set_xlabel("time [s]")
        over_time.set_ylabel("limit of the bristles [N]")
        order = np.argsort(row.speed[shown])
        over_speed.plot(1e3 * row.speed[shown][order], limit[shown][order], ".", color=COLOURS["LuGre"], markersize=3.0)
        over_speed.set_xlabel("speed of the vertical joint of leg 0 [mm/s]")
        figure.tight_layout()
        figure.savefig(path, dpi=130)
        plt.close(figure)


def plot_motors(walks: Mapping[str, Walk], kind: str, path: Path) -> None:
    """One side of Fig. 11: reference, current and voltage of a motor of leg 0 over one cycle, transfer shaded."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(3, 1, figsize=(7.0, 7.5), sharex=True)
        for name, walk in walks.items():
            cycle = walk.cycle(-1)
            time = walk.time[cycle]
            for axis, values, factor in zip(
                axes, (walk.goal, walk.current, walk.voltage), (1e3, 1.0, 1.0), strict=True
            ):
                axis.plot(
                    time, factor * walk.quantity(values, kind)[cycle], color=COLOURS[name], label=name, linewidth=1.0
                )
        walk = next(iter(walks.values()))
        time = walk.time[walk.cycle(-1)]
        for axis, label in zip(axes, ("reference [mm]", "current [A]", "voltage [V]"), strict=True):
            _shade(axis, time, walk.gait.in_transfer(0, time))
            axis.set_ylabel(label)
        axes[0].set_title(f"{kind} motor of leg 0 (grey: transfer)")
        axes[-1].set_xlabel("time [s]")
        figure.legend(*axes[1].get_legend_handles_labels(), loc="lower center", ncols=len(walks), frameon=False)
        figure.align_ylabels()
        figure.tight_layout(rect=(0.0, 0.04, 1.0, 1.0))
        figure.savefig(path, dpi=130)
        plt.close(figure)


def _shade(axis: Axes, time: np.ndarray, air: np.ndarray) -> None:
    low, high = axis.get_ylim()
    axis.fill_between(time, low, high, where=air.tolist(), color="0.85", zorder=0, linewidth=0)
    axis.set_ylim(low, high)


def plot_resistance(cases: Mapping[str, Mapping[float, float]], path: Path) -> None:
    """Fig. 12: specific resistance over the heading velocity."""
    with plt.rc_context(STYLE):
        figure, axis = plt.subplots(figsize=(6.0, 3.6))
        for name, row in cases.items():
            axis.plot(
                [100 * speed for speed in row],
                list(row.values()),
                color=COLOURS[name],
                marker="o",
                markersize=4,
                label=name,
            )
        axis.set_ylim(bottom=0.0)
        axis.set_xlabel("heading velocity [cm/s]")
        axis.set_ylabel("specific resistance")
        axis.legend(frameon=False, title="joint friction", loc="center left", bbox_to_anchor=(1.0, 0.5))
        figure.tight_layout()
        figure.savefig(path, dpi=130)
        plt.close(figure)
