"""The paper's figures 6 and 7, drawn from our recordings in its colours."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ...evaluation.pictures import STYLE, plt
from .paper import SETTLING, Hops, by_period, flexions

COLOURS = {"with actuator": "tab:blue", "without actuator": "tab:red"}
SHOWN = 2.0  # [s], as in Fig. 6


def plot_time(cases: Mapping[str, Hops], path: Path) -> None:
    """Fig. 6: motor positions and height over two seconds, black lines at the moments of greatest flexion."""
    rows = ("hip motor [rad]", "knee motor [rad]", "height of hip [cm]")
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(
            3, len(cases), figsize=(5 * len(cases), 6.2), sharex=True, sharey="row", squeeze=False
        )
        for column, (name, hops) in enumerate(cases.items()):
            starts = flexions(hops)
            begin = hops.time[starts[0]] if len(starts) else SETTLING
            shown = (hops.time >= begin) & (hops.time <= begin + SHOWN)
            for row, values in enumerate((hops.motor[:, 0], hops.motor[:, 1], 100.0 * hops.height)):
                axis = axes[row, column]
                axis.plot(hops.time[shown] - begin, values[shown], color=COLOURS[name], linewidth=1.2)
                for start in hops.time[starts] - begin:
                    if start <= SHOWN:
                        axis.axvline(start, color="black", linewidth=0.7)
                if column == 0:
                    axis.set_ylabel(rows[row])
            axes[0, column].set_title(f"simulation {name}")
            axes[-1, column].set_xlabel("time [s]")
        figure.align_ylabels()
        figure.tight_layout()
        figure.savefig(path, dpi=130)
        plt.close(figure)


def plot_periods(cases: Mapping[str, Hops], path: Path) -> None:
    """Fig. 7: positions and speeds of motor and link over the period, from greatest flexion to greatest flexion.

    Lines are the mean over the hops; bands, where they are wide enough to be seen, the range of all of them.
    """
    rows = (
        ("motor [rad]", "motor"),
        ("motor [rad/s]", "motor_speed"),
        ("link [rad]", "link"),
        ("link [rad/s]", "link_speed"),
    )
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(4, 2, figsize=(9, 8.5), sharex=True)
        for name, hops in cases.items():
            for row, (label, field) in enumerate(rows):
                periods = by_period(hops, getattr(hops, field))
                if not len(periods):
                    continue
                share = np.linspace(0.0, 100.0, periods.shape[1])
                for column, joint in enumerate(("hip", "knee")):
                    axis, values = axes[row, column], periods[:, :, column]
                    axis.plot(share, values.mean(axis=0), color=COLOURS[name], linewidth=1.4, label=name)
                    axis.fill_between(
                        share, values.min(axis=0), values.max(axis=0), color=COLOURS[name], alpha=0.18, lw=0
                    )
                    axis.set_ylabel(f"{joint} {label}")
        for row in (1, 3):  # steps of an ideal motor are speeds without bound: keep the real one visible
            for column in range(2):
                field = rows[row][1]
                real = getattr(cases["with actuator"], field)[:, column] if "with actuator" in cases else None
                if real is not None:
                    reach = 1.6 * float(np.abs(real[len(real) // 5 :]).max())
                    low, high = axes[row, column].get_ylim()
                    axes[row, column].set_ylim(max(low, -reach), min(high, reach))
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="upper center", ncols=len(cases), frameon=False)
        for axis in axes[-1]:
            axis.set_xlabel("share of the period [%]")
        figure.align_ylabels()
        figure.tight_layout(rect=(0.0, 0.0, 1.0, 0.97))
        figure.savefig(path, dpi=130)
        plt.close(figure)
