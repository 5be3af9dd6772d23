"""The paper's figures 10 to 12 and 18 to 25 (paper 002), drawn from our runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...envs.arm.tables import DAMPING, JOINTS, STIFFNESS
from ...envs.arm.trajectory import Line
from ...evaluation.pictures import STYLE, plt
from .dynamics import inverse
from .paper import DAMPINGS, HIGHEST, MARKS, SPRING, STATOR, Results

COLOURS = ("tab:blue", "tab:orange", "tab:green")


def _save(figure: Any, path: Path) -> None:
    figure.align_ylabels()
    figure.tight_layout()
    figure.savefig(path, dpi=130)
    plt.close(figure)


def plot_trajectory(path: Path) -> None:
    """Figures 10 to 12 and 15 to 17: angles, speeds, accelerations and torques of the joints of the ideal robot."""
    times = np.linspace(2e-3, 4.998, 400)
    labels = ("angle [rad]", "speed [rad/s]", "acceleration [rad/s²]", "torque [N.m]")
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(4, 1, figsize=(7.5, 8.5), sharex=True)
        septic, quintic = Line().joints(times), Line(way="quintic").joints(times)
        for k, name in enumerate(JOINTS):
            for axis, values in zip(axes, (*septic, inverse(Line(), times)), strict=True):
                axis.plot(times, values[:, k], color=COLOURS[k], label=f"{name}, septic")
            axes[2].plot(times, quintic[2][:, k], color=COLOURS[k], ls="--", lw=0.8, label=f"{name}, quintic")
        for axis, label in zip(axes, labels, strict=True):
            axis.set_ylabel(label)
        axes[2].set_ylim(-6.0, 6.0)
        axes[2].legend(ncols=2, frameon=False, fontsize=7)
        axes[0].legend(frameon=False, fontsize=7)
        axes[-1].set_xlabel("time [s]")
        _save(figure, path)


def plot_stiffness(results: Results, path: Path) -> None:
    """Figure 18, and the same for the springs between rotors and links."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(1, 2, figsize=(9.5, 3.8), sharey=True)
        for axis, values, deviations, title in (
            (axes[0], STATOR, results.stator, "between stator and rotor"),
            (axes[1], SPRING, results.spring, "between rotor and link"),
        ):
            axis.loglog(values, deviations, "o-", color="tab:blue", ms=3)
            for level in MARKS:
                axis.axhline(level, color="black", lw=0.7, ls="--")
                axis.annotate(
                    f"{level:g} mm", (values[0], level), xytext=(0, 2), textcoords="offset points", fontsize=7
                )
            axis.set_xlabel(f"stiffness {title}, all joints alike [N.m/rad]")
        for value in STIFFNESS:
            axes[1].axvline(value, color="tab:red", lw=0.8)
        axes[1].annotate("table X", (STIFFNESS[2], results.spring.max()), color="tab:red", fontsize=7, ha="right")
        axes[0].set_ylabel("largest deviation of the tool [mm]")
        _save(figure, path)


def plot_damping(results: Results, path: Path) -> None:
    """Figures 19 to 22: deviation by damping of each joint, and over time."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(1, 3, figsize=(13.0, 3.9))
        for k, name in enumerate(JOINTS):
            axes[0].loglog(
                DAMPINGS, [m.largest for m in results.damping[name]], "o-", color=COLOURS[k], ms=3, label=name
            )
            axes[0].axvline(DAMPING[k], color=COLOURS[k], lw=0.7, ls=":")
        axes[0].set_xlabel("$c_r$ of one joint [N.m.s/rad] (dotted: table X)")
        axes[0].set_ylabel("largest deviation of the tool [mm]")
        axes[0].legend(frameon=False, fontsize=8)
        shades = plt.get_cmap("viridis")
        for axis, motions, title in (
            (axes[1], results.third[HIGHEST], "highest $c_{r1}$, and $c_{r3}$ of"),
            (axes[2], results.crossing, "$c_{r3}$ alone, of"),
        ):
            for k, (value, motion) in enumerate(motions.items()):
                axis.plot(motion.time, 1e3 * motion.deviation, color=shades(k / len(motions)), label=f"{value:g}")
            axis.legend(title=title, title_fontsize=7, frameon=False, fontsize=7)
            axis.set_xlabel("time [s]")
            axis.set_ylabel("deviation [mm]")
        _save(figure, path)


def plot_tool(results: Results, path: Path) -> None:
    """Figures 24 and 25: the tool's coordinates and deviation."""
    shown = (("motor", "tab:red"), ("axes", "tab:orange"), ("torques", "tab:green"))
    cases = (
        ("table X", results.final, "tab:blue"),
        *((results.outcomes[name].reading.text, results.outcomes[name].motion, colour) for name, colour in shown),
    )
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(4, 1, figsize=(7.5, 8.0), sharex=True)
        for axis, column in zip(axes, range(3), strict=False):
            axis.plot(
                results.final.time, results.final.wanted[:, column], color="black", lw=2.5, alpha=0.3, label="ideal"
            )
            for label, motion, colour in cases:
                axis.plot(motion.time, motion.tool[:, column], color=colour, lw=1.1, label=label)
            axis.set_ylabel(f"{'xyz'[column]} [m]")
        for _, motion, colour in cases:
            axes[3].semilogy(motion.time[1:], np.maximum(1e3 * motion.deviation[1:], 1e-4), color=colour, lw=1.1)
        axes[3].set_ylabel("deviation [mm]")
        axes[3].set_xlabel("time [s]")
        axes[0].legend(frameon=False, fontsize=7)
        _save(figure, path)
