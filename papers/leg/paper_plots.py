"""Pictures like figures 5 to 10 of paper 000."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...envs.leg.kinematics import lengthening
from ...envs.leg.robot import JOINTS
from ...evaluation.pictures import STYLE, plt
from .dynamics import gravity
from .paper import OWN_SPEED, Analysis, Contributions, coriolis_error, linear, peak

COLOURS = ("tab:blue", "tab:orange", "tab:green")


def draw(
    analysis: Analysis, found: Mapping[float, Sequence[Contributions]], sweeps: Sequence[Any], out: Path
) -> list[str]:
    """Draw all; the names of the files."""
    rows = found[OWN_SPEED]
    example = sorted(rows, key=lambda row: float(np.ptp(row.lengthening)))[-1]
    with plt.rc_context(STYLE):
        pictures = {
            "mechanical.png": _mechanical(example),
            "simplified.png": _simplified(example),
            "actuators.png": _actuators(example, analysis),
            "lengthening.png": _lengthening(analysis, rows),
            "speeds.png": _speeds(found, sweeps),
        }
        for name, figure in pictures.items():
            figure.tight_layout()
            figure.savefig(out / name, dpi=130)
            plt.close(figure)
    return list(pictures)


def _mechanical(row: Contributions) -> Any:
    """Figures 5 and 6: what moves the links."""
    figure, axes = plt.subplots(2, 2, figsize=(9, 6), sharex=True, sharey=True)
    titles = ("constant inertia", "varying inertia", "Coriolis and centrifugal", "gravity")
    parts = (row.constant, row.varying, row.coriolis, row.gravity)
    for axis, title, values in zip(axes.flat, titles, parts, strict=True):
        for j, name in enumerate(JOINTS):
            axis.plot(row.time, values[:, j], color=COLOURS[j], label=name)
        axis.set_title(title)
    axes[0, 0].legend(frameon=False)
    for axis in axes[:, 0]:
        axis.set_ylabel("torque at the joint [N.m]")
    for axis in axes[1]:
        axis.set_xlabel("time [s]")
    return figure


def _simplified(row: Contributions) -> Any:
    """Figure 7: the perturbation with and without Coriolis."""
    figure, axes = plt.subplots(1, 3, figsize=(10, 3.2))
    for j, axis in enumerate(axes):
        axis.plot(row.time, row.perturbation[:, j], color=COLOURS[j], label="whole")
        axis.plot(row.time, (row.perturbation - row.coriolis)[:, j], "k--", linewidth=1.0, label="without Coriolis")
        axis.set_title(f"{JOINTS[j]}: {peak(row.coriolis)[j] / peak(row.perturbation)[j]:.1%} of its own at most")
        axis.set_xlabel("time [s]")
    axes[0].set_ylabel("perturbation [N.m]")
    axes[0].legend(frameon=False)
    return figure


def _actuators(row: Contributions, analysis: Analysis) -> Any:
    """Figures 8 and 9: what the motors give, at the motor."""
    values = analysis.values
    ratio = [values[f"planetary{j}_gear"] * values[f"skew{j}_gear"] for j in (1, 2, 3)]
    figure, axes = plt.subplots(1, 3, figsize=(10, 3.4))
    parts = (
        ("equivalent inertia", row.inertia, "tab:blue"),
        ("friction", row.friction, "tab:red"),
        ("perturbation of the links", row.perturbation, "tab:green"),
        ("motor", row.total, "black"),
    )
    for j, axis in enumerate(axes):
        for label, torque, colour in parts:
            axis.plot(row.time, 1e3 * torque[:, j] / ratio[j], color=colour, linewidth=1.1, label=label)
        axis.set_title(JOINTS[j])
        axis.set_xlabel("time [s]")
    axes[0].set_ylabel("torque at the motor [mN.m]")
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="lower center", ncols=4, frameon=False, bbox_to_anchor=(0.5, -0.01)
    )
    figure.subplots_adjust(bottom=0.3)
    axes[1].set_xlabel("time [s]\n\n")
    return figure


def _lengthening(analysis: Analysis, rows: Sequence[Contributions]) -> Any:
    """Figure 10: what is left out of joint 1, and the perturbation of joints 2 and 3 over the lengthening."""
    figure, axes = plt.subplots(1, 3, figsize=(11, 3.6))
    reach = [float(np.ptp(row.lengthening)) for row in rows]
    left_out = [100.0 * peak(row.perturbation)[0] / peak(row.inertia)[0] for row in rows]
    axes[0].plot(reach, left_out, ".", color=COLOURS[0])
    axes[0].axhline(0.5, color="black", linewidth=1.0)
    axes[0].text(0.0, 1.2, "printed: under 0.5 %", fontsize=8)
    axes[0].set(xlabel="horizontal length of the line [m]", ylabel="perturbation of joint 1 [% of its inertia]")
    q = analysis.workspace(1500)
    cloud, weight = lengthening(analysis.values, q), gravity(analysis.constants, q)
    for j, axis in ((1, axes[1]), (2, axes[2])):
        axis.plot(cloud, weight[:, j], ".", markersize=1.5, color="0.75", label="workspace")
        for row in rows[:40]:
            axis.plot(row.lengthening, row.perturbation[:, j], color=COLOURS[j], linewidth=0.8)
        ends = np.array([cloud.min(), cloud.max()])
        slope, offset = linear(cloud, weight[:, j])
        axis.plot(ends, slope * ends + offset, "k--", linewidth=1.0, label=f"{slope:.2f} R_h {offset:+.2f} N.m")
        axis.set(xlabel="horizontal lengthening R_h [m]", ylabel=f"perturbation of {JOINTS[j]} [N.m]")
        axis.legend(frameon=False)
    return figure


def _speeds(found: Mapping[float, Sequence[Contributions]], sweeps: Sequence[Any]) -> Any:
    """What leaving out Coriolis costs, and friction over inertia, by speed of the foot."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.4))
    speeds = [sweep.speed for sweep in sweeps]
    off = {speed: [100.0 * coriolis_error(row) for row in rows] for speed, rows in found.items()}
    for label, share in (("worst line", 1.0), ("95 % of lines", 0.95), ("median", 0.5)):
        left.loglog(speeds, [np.quantile(off[speed], share) for speed in speeds], "o-", markersize=3, label=label)
    left.axhline(4.2, color="black", linewidth=1.0)
    left.text(speeds[0], 4.6, "printed: 4.2 %", fontsize=8)
    left.set(xlabel="highest speed of the foot [m/s]", ylabel="error of leaving out Coriolis [%]")
    left.legend(frameon=False)
    for j, name in enumerate(JOINTS):
        right.loglog(speeds, [sweep.friction[j] for sweep in sweeps], "o-", markersize=3, color=COLOURS[j], label=name)
    right.axhline(2.0, color="black", linewidth=1.0)
    right.text(speeds[0], 2.2, "printed for joints 2 and 3: twice", fontsize=8)
    right.set(xlabel="highest speed of the foot [m/s]", ylabel="friction over inertia")
    right.legend(frameon=False)
    for axis in (left, right):
        axis.set_xticks(speeds, [f"{speed:g}" for speed in speeds])
        axis.minorticks_off()
    return figure
