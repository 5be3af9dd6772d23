"""What a comparison leaves: an HTML page to send to a colleague, its numbers, and the table in the terminal."""

from __future__ import annotations

import html
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.offline import get_plotlyjs
from plotly.subplots import make_subplots

from ..common.atomic import write_text
from ..gap.output.pictures.style import COLOURS
from ..gap.output.report import chart_html, dress
from .comparison import MACHINE, Comparison, table, verdict

PEN = {"nominal": COLOURS["nominal"], "extended": COLOURS["extended"], MACHINE: COLOURS["measured"]}
STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1c2126; max-width: 60rem; margin: 0 auto; padding: 1rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.1rem; margin-top: 2rem; }
.wide { overflow-x: auto; } table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { padding: .3rem .7rem; text-align: right; border-bottom: 1px solid #e4e4e4; white-space: nowrap; }
th:first-child, td:first-child { text-align: left; white-space: normal; } .small { color: #5a646e; font-size: .85rem; }
"""


def write_page(comparison: Comparison, path: Path) -> Path:
    """Write the page; it asks nothing of any network.

    Raises:
        FileExistsError: it is there already.
    """
    header, rows = table(comparison)
    head = "".join(f"<th>{html.escape(cell)}</th>" for cell in header)
    body = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    text = f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>Simulation and machine: {html.escape(comparison.robot)}</title><style>{STYLE}</style>
<script>{get_plotlyjs()}</script></head><body>
<h1>{html.escape(headline(comparison))}</h1>
<p class="small">Policy {html.escape(comparison.policy)} on robot {html.escape(comparison.robot)}. Each column
is the same policy, asked for the same, from the same start. The gap is the model's position error over short windows,
in which it starts where the machine was and is given the goals that the machine got. What was not measured is not
compared. The machine's run: {html.escape(comparison.ending)}; its log is {html.escape(str(comparison.log))}.</p>
<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>
<h2>Signals over time</h2><p class="small">Drag to zoom, double-click to see all; a click in the legend hides a line.
Dotted lines: where a model's signal first departs.</p>
{_signals(comparison)}
<h2>Reward</h2>
{_rewards(comparison)}
</body></html>
"""
    write_text(path, text)
    return path


def headline(comparison: Comparison) -> str:
    """The comparison in a sentence."""
    said = [f"The {name} model: {verdict(row)}" for name, row in comparison.figures.items() if name != MACHINE]
    said += [comparison.note] if comparison.note else []
    first = comparison.figures["nominal"]
    departs = f" {first.departs} departs first, after {first.departs_at:.2f} s." if first.departs else ""
    return " ".join(said) + departs


def _signals(comparison: Comparison) -> str:
    joints = comparison.joints
    panels = [
        (f"{joint}: {label.format(comparison.units[k])}", field, k)
        for k, joint in enumerate(joints)
        for label, field in _FIELDS
    ]
    panels += [(name, "base", k) for k, name in enumerate(comparison.base)]
    measured = comparison.runs[MACHINE]
    panels = [panel for panel in panels if np.ptp(getattr(measured, panel[1])[:, panel[2]]) > 0.0]
    chart = make_subplots(
        rows=len(panels),
        cols=1,
        shared_xaxes=True,
        vertical_spacing=0.25 / len(panels),
        subplot_titles=[p[0] for p in panels],
    )
    for row, (_, field, k) in enumerate(panels, 1):
        for name in (MACHINE, *(n for n in comparison.runs if n != MACHINE)):
            run = comparison.runs[name]
            pen = {"color": PEN[name], "width": 2.2 if name == MACHINE else 1.3}
            values = np.asarray(getattr(run, field)[:, k], np.float32)
            about = {"name": name, "legendgroup": name, "showlegend": row == 1, "line": pen}
            chart.add_trace(go.Scatter(x=np.asarray(run.time, np.float32), y=values, mode="lines", **about), row, 1)
    for name, figures in comparison.figures.items():
        if figures.departs_at is not None:
            chart.add_vline(figures.departs_at, line={"color": PEN[name], "width": 1.2, "dash": "dot"})
    chart.update_xaxes(title_text="time [s]", row=len(panels), col=1)
    return _dressed(chart, 90 + 150 * len(panels))


_FIELDS = (
    ("goal [{}]", "goal"),
    ("position [{}]", "position"),
    ("velocity [{}/s]", "velocity"),
    ("duty", "duty"),
    ("current [A]", "current"),
)  # all that may be named as the first to depart


def _rewards(comparison: Comparison) -> str:
    chart = go.Figure()
    for name, run in comparison.runs.items():
        if not run.rewards:
            return "<p>No policy, no reward.</p>"
        total = np.cumsum(sum(run.rewards.values()))
        pen = {"color": PEN[name], "width": 2.2 if name == MACHINE else 1.3}
        chart.add_trace(go.Scatter(x=run.time, y=np.asarray(total, np.float32), name=name, mode="lines", line=pen))
    chart.update_xaxes(title_text="time [s]")
    chart.update_yaxes(title_text="reward so far")
    return _dressed(chart, 320)


def _dressed(chart: go.Figure, height: int) -> str:
    dress(chart, height)
    chart.update_layout(margin_t=40, legend={"y": 0.999, "yanchor": "top", "yref": "container"}, hovermode="x unified")
    return chart_html(chart)


# --- all that it leaves ----------------------------------------------------------------------------------------------


def write_comparison(comparison: Comparison, folder: Path, say: Callable[[str], None] = print) -> dict[str, Path]:
    """Write ``comparison.json`` and ``comparison.html`` into ``folder``, and print the table.

    Raises:
        FileExistsError: they are there already.
    """
    document = {
        "policy": comparison.policy,
        "robot": comparison.robot,
        "ending": comparison.ending,
        "log": str(comparison.log),
        "figures": {name: asdict(value) for name, value in comparison.figures.items()},
    }
    paths = {"json": folder / "comparison.json", "page": folder / "comparison.html"}
    write_text(paths["json"], json.dumps(_finite(document), indent=1))
    write_page(comparison, paths["page"])
    header, rows = table(comparison)
    for line in columns([header, *rows]):
        say(f"  {line}")
    for name, figures in comparison.figures.items():
        if name != MACHINE:
            say(f"  The {name} model: {verdict(figures)}")
    if comparison.note:
        say(f"  {comparison.note}")
    if comparison.ending != "finished":
        say(f"  The machine's run ended early: {comparison.ending}")
    say(f"  Page  {paths['page']}")
    return paths


def columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table: the first column to the left, the others to the right, two spaces between them at least."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    widths = [max(widths[0], 40), *(max(width, 16) for width in widths[1:])]
    return [
        "  ".join(f"{cell:{'>' if k else '<'}{width}}" for k, (cell, width) in enumerate(zip(row, widths, strict=True)))
        for row in rows
    ]


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _finite(item) for key, item in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value
