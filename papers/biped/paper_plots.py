"""Figures 17, 19 and 21 to 23 of paper 003, drawn from our recordings."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...envs.biped.drive import DRIVES
from ...evaluation.pictures import STYLE, plt
from .hopping import NAMES, Hopping, hop_times
from .paper import SHOWN, SpringTest

WITH, WITHOUT = ("tab:red", "with cable stretch"), ("tab:blue", "rigid cables, from the same touchdown")


def _shown(hopping: Hopping) -> Hopping:
    return hopping.rows(np.isin(hopping.hop, SHOWN))


def _two_hops(panels: list[tuple[str, Any]], stretched: Hopping, rigid: Hopping, path: Path, title: str) -> None:
    """A grid of panels over time; each a label and a function from a recording to values."""
    cases = [(_shown(stretched), *WITH), (_shown(rigid), *WITHOUT)]
    start = cases[0][0].time[0]
    rows = (len(panels) + 1) // 2
    with plt.rc_context(STYLE):
        height = 2.0 * rows + 0.8
        figure, axes = plt.subplots(rows, 2, figsize=(9.5, height), sharex=True, squeeze=False)
        for axis, (label, values) in zip(axes.flat, panels, strict=False):
            for hopping, colour, name in cases:
                if len(hopping.time):
                    axis.plot(hopping.time - start, values(hopping), color=colour, linewidth=1.2, label=name)
            axis.set_ylabel(label)
            for touchdown in hop_times(cases[0][0]) - start:
                axis.axvline(touchdown, color="black", linewidth=0.7)
        for axis in axes.flat[len(panels) :]:
            axis.axis("off")
        for axis in axes[-1]:
            axis.set_xlabel("time after touchdown 31 [s]")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(
            handles, labels, loc="upper center", ncols=2, frameon=False, bbox_to_anchor=(0.5, 1.0 - 0.22 / height)
        )
        figure.suptitle(title, fontsize=10, y=1.0 - 0.08 / height)
        figure.align_ylabels()
        figure.tight_layout(rect=(0.0, 0.0, 1.0, 1.0 - 0.42 / height))
        figure.savefig(path, dpi=130)
        plt.close(figure)


def plot_positions(stretched: Hopping, rigid: Hopping, path: Path) -> None:
    """Fig. 21: joint positions [deg] and hip position [m]."""
    panels: list[tuple[str, Any]] = []
    for number, name in enumerate(NAMES):
        words = name.replace("_", " ")
        panels.append((f"{words} [deg]", lambda hopping, k=number: np.degrees(hopping.link[:, k])))
    panels.append(("left spring pulley [deg]", lambda hopping: np.degrees(hopping.spring[:, 0])))
    panels.append(("right spring pulley [deg]", lambda hopping: np.degrees(hopping.spring[:, 1])))
    panels.append(("torso pitch [deg]", lambda hopping: np.degrees(hopping.pitch)))
    panels.append(("hip height [m]", lambda hopping: hopping.hip[:, 1]))
    _two_hops(panels, stretched, rigid, path, "Positions, hops 31 and 32 (Fig. 21)")


def plot_torques(stretched: Hopping, rigid: Hopping, path: Path) -> None:
    """Fig. 22: commanded torques [N.m at the motor]."""
    panels: list[tuple[str, Any]] = [
        (f"{name.replace('_', ' ')} [N.m]", lambda hopping, k=number: hopping.torque[:, k])
        for number, name in enumerate(NAMES)
    ]
    _two_hops(panels, stretched, rigid, path, "Motor torques, hops 31 and 32 (Fig. 22)")


def plot_stretch(stretched: Hopping, rigid: Hopping, path: Path) -> None:
    """Fig. 23: cable stretch [deg at the motor]."""
    panels: list[tuple[str, Any]] = [
        (f"{name.replace('_', ' ')} [deg]", lambda hopping, k=number: np.degrees(hopping.stretch[:, k]))
        for number, name in enumerate(NAMES)
    ]
    _two_hops(panels, stretched, rigid, path, "Cable stretch at the motors, hops 31 and 32 (Fig. 23)")


def plot_springs(tests: Mapping[str, SpringTest], path: Path) -> None:
    """Fig. 19: spring torque over deflection, with the line through it and the printed one."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(1, len(tests), figsize=(4.6 * len(tests), 3.6), sharey=True, squeeze=False)
        for axis, (side, test) in zip(axes[0], tests.items(), strict=True):
            printed = DRIVES[f"{side}_leg_shape"].spring_stiffness
            axis.plot(test.deflection, test.torque, "o", color="tab:red", label="postures", markersize=4)
            line = np.array([0.0, test.deflection.max()])
            found = test.spring
            axis.plot(
                line,
                found.stiffness * line + found.offset,
                color="tab:red",
                linewidth=1.0,
                label=f"{found.stiffness:.1f} N.m/rad by (24)",
            )
            axis.plot(line, printed * line, color="black", linewidth=0.8, label=f"{printed:g} N.m/rad, printed")
            axis.set_title(f"{side} spring")
            axis.set_xlabel("deflection of the pulley [rad]")
            axis.legend(frameon=False)
        axes[0, 0].set_ylabel("W sin(leg shape) / 5.18 [N.m]")
        figure.tight_layout()
        figure.savefig(path, dpi=130)
        plt.close(figure)


def plot_balance(on_foot: np.ndarray, hanging: np.ndarray, path: Path) -> None:
    """Fig. 17: distance of the calculated centre of mass from what the robot stands on [mm]."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(1, 2, figsize=(8.0, 3.0), sharey=True)
        for axis, values, title in zip(
            axes, (on_foot, hanging), ("from the supporting toe", "from the hip"), strict=True
        ):
            axis.plot(np.arange(1, len(values) + 1), 1e3 * values, "o", color="tab:red", markersize=4)
            for bound in (-6.0, 6.0):
                axis.axhline(bound, color="black", linewidth=0.8, linestyle="--")
            axis.set_title(title)
            axis.set_xlabel("experiment")
            axis.set_ylim(-8.0, 8.0)
        axes[0].set_ylabel("centre of mass [mm]")
        figure.tight_layout()
        figure.savefig(path, dpi=130)
        plt.close(figure)
