"""The page of a fleet: one HTML file with the picture, the shared causes and the servos."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ...common.atomic import write_text, written
from ..log.finding import MAX_TOLD
from ..output.pictures import png
from ..output.pictures.style import EXTENDED, NOMINAL, figure, styled
from ..output.report import rendered
from .table import NOT_DIAGNOSED, Row, Shared

FLEET_FOLDER = Path(__file__).parent


@styled
def draw_fleet(rows: Sequence[Row], shared: Sequence[Shared]) -> Figure:
    """Servos against causes, coloured by the share of the gap, and beside it the values of the commonest causes."""
    dotted = [cause for cause in shared if cause.values][:MAX_TOLD]
    count, causes = len(rows), max(len(shared), 1)
    chart = figure(3.2 + 0.62 * causes + 2.1 * len(dotted), 2.2 + 0.3 * count)
    axes = chart.subplots(
        1, 1 + len(dotted), sharey=True, squeeze=False, width_ratios=[0.62 * causes + 0.6, *(2.1 for _ in dotted)]
    )[0]
    matrix = axes[0]
    table = np.full((count, causes), np.nan)
    for i, row in enumerate(rows):
        for cause in row.causes:
            table[i, [s.name for s in shared].index(cause["name"])] = max(cause["share"] or 0.0, 0.0)
    matrix.imshow(table, aspect="auto", cmap="Blues", vmin=-0.15, vmax=1.1, interpolation="nearest")
    for i, j in zip(*np.nonzero(np.isfinite(table)), strict=True):
        data = next(c for c in rows[i].causes if c["name"] == shared[j].name)["kind"] == "data"
        text = "data" if data else f"{100 * table[i, j]:.0f}"
        matrix.text(j, i, text, ha="center", va="center", fontsize=9, color="white" if table[i, j] > 0.6 else "black")
    for i, row in enumerate(rows):
        if not row.causes:
            words = {NOT_DIAGNOSED: "not diagnosed"}.get(row.verdict, row.verdict)
            matrix.text(-0.42, i, words, va="center", fontsize=8, color="#8a3310" if row.failed else "#5a646e")
    matrix.set_xticks(
        range(len(shared)), [cause.name for cause in shared], rotation=40, ha="right", rotation_mode="anchor"
    )
    matrix.set_yticks(range(count), [row.servo for row in rows])
    matrix.set_xlim(-0.5, causes - 0.5)
    matrix.set_title("Share of the gap [%]")
    matrix.grid(False)
    for edge in range(1, count):
        matrix.axhline(edge - 0.5, color="white", linewidth=2.0)
    matrix.tick_params(length=0)
    for axis, cause in zip(axes[1:], dotted, strict=True):
        at = {row.servo: i for i, row in enumerate(rows)}
        for servo, (value, low, high) in cause.values.items():
            axis.plot([low, high], [at[servo]] * 2, color=EXTENDED, linewidth=2.0, solid_capstyle="butt")
            axis.plot([value], [at[servo]], "o", color=EXTENDED, markersize=5)
        axis.axvline(cause.middle, color=NOMINAL, linewidth=1.2, linestyle="--", zorder=1)
        unit = f" [{cause.unit}]" if cause.unit not in ("", "1") else ""
        axis.set_xlabel(f"{cause.parameter}{unit}", fontsize=9)
        axis.set_title(cause.name, fontsize=9)
        axis.tick_params(labelsize=8)
        axis.locator_params(axis="x", nbins=4)
    return chart


def write_page(rows: Sequence[Row], shared: Sequence[Shared], folder: Path, name: str) -> dict[str, Path]:
    """Write ``fleet.html`` and ``fleet.png``, in place of those of an earlier, stopped session.

    Args:
        rows, shared: of :mod:`sealegs.gap.fleet.table`.
        folder: of the fleet; reports of servos are linked relative to it.
        name: of the fleet.
    """
    picture, page = folder / "fleet.png", folder / "fleet.html"
    drawn = png(draw_fleet(rows, shared))
    with written(picture, replace=True) as fresh:
        fresh.write_bytes(drawn)
    html = rendered(
        FLEET_FOLDER / "fleet.html.j2",
        name=name,
        picture=base64.b64encode(drawn).decode(),
        rows=rows,
        shared=shared,
        reports={row.folder for row in rows if (folder / row.folder / "report.html").is_file()},
    )
    write_text(page, html, replace=True)
    return {"page": page, "picture": picture}
