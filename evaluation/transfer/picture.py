"""A picture for each robot: the error of each treatment on each machine, beside that of the limit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from ..plot_style import STYLE, plt
from .cells import REFERENCES, TREATMENTS
from .figures import Errors

MARGIN = 1.3  # of the axis beyond the smallest and the largest error


def draw(robot: str, errors: Errors, file: Path) -> None:
    """Draw the machines of a robot, a group of points each.

    Args:
        robot: its name.
        errors: of its machines.
        file: to write.
    """
    treatments = [t for t in (*REFERENCES[:1], *TREATMENTS) if any(t in own for own in errors.values())]
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
