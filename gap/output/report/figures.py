"""The zoomable plots of the report, as plotly draws them."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from ...experiment import Experiment
from ...search.structure import told_in
from ...verdict.verdict import JointDiagnosis
from ..layout import LAYOUT
from ..pictures.style import COLOURS, EXTENDED, NAMES, TEST_SHADE
from ..pictures.timeline import timeline, worst_window

CONFIG = {"responsive": True, "displaylogo": False, "modeBarButtonsToRemove": ["lasso2d", "select2d"]}
DASH = {"nominal": "solid", "refitted": "dot", "extended": "solid"}
GREY = "#e4e4e4"


def signals(diagnosis: JointDiagnosis, joints: int) -> tuple[str, tuple[float, float]] | None:
    """Measured and simulated signals over time with their errors below.

    Returns:
        HTML of the plot, and the span [s] of the test part where the nominal model is most wrong; None without replay.
    """
    line = timeline(diagnosis)
    if line is None or not len(line.x):
        return None
    thin = line.thinned(max(LAYOUT.page_samples // joints, LAYOUT.plot_samples))
    factor, unit = told_in(line.unit)
    chart = make_subplots(rows=2, cols=1, shared_xaxes=True, row_heights=[0.56, 0.44], vertical_spacing=0.06)
    x = _small(thin.x)
    if thin.goal is not None:
        dashed = {"color": "#9a9a9a", "width": 1, "dash": "dash"}
        chart.add_trace(go.Scatter(x=x, y=_small(thin.goal), name="goal", line=dashed), 1, 1)
    thick = {"color": COLOURS["measured"], "width": 2.5}
    chart.add_trace(go.Scatter(x=x, y=_small(thin.measured), name=NAMES["measured"], line=thick), 1, 1)
    for name, values in thin.models.items():
        pen = {"color": COLOURS[name], "width": 1.4, "dash": DASH[name]}
        shown = "legendonly" if name == "refitted" else True
        about = {"name": NAMES[name], "legendgroup": name, "line": pen, "visible": shown}
        chart.add_trace(go.Scatter(x=x, y=_small(values), **about), 1, 1)
        error = factor * (thin.measured - values)
        chart.add_trace(go.Scatter(x=x, y=_small(error), showlegend=False, **about), 2, 1)
    if "noise_floor" in diagnosis.gap:
        band = 2.0 * factor * diagnosis.gap["noise_floor"].rmse
        place = {"xref": "x2 domain", "x0": 0, "x1": 1, "yref": "y2", "y0": -band, "y1": band}
        chart.add_shape(type="rect", fillcolor="#000000", opacity=0.12, line_width=0, **place)
    for start, stop in line.tested:
        chart.add_vrect(start, stop, fillcolor=TEST_SHADE, line_width=0, layer="below")
    chart.update_traces(hovertemplate="%{y:.5g}", mode="lines", connectgaps=False)
    chart.update_yaxes(title_text=f"{line.quantity} [{line.unit}]", row=1, col=1)
    chart.update_yaxes(title_text=f"measured minus model [{unit}]", row=2, col=1)
    chart.update_xaxes(title_text="time, runs one behind the other [s]", row=2, col=1)
    _dress(chart, 560)
    chart.update_layout(hovermode="x unified", dragmode="zoom")
    return _html(chart), worst_window(line, min(LAYOUT.moment, float(line.x[-1] - line.x[0])))


def excitation(proposal: Experiment) -> str:
    """HTML of the proposed goals over time."""
    chart = go.Figure(
        go.Scatter(x=_small(proposal.time), y=_small(proposal.goal), line={"color": EXTENDED}, name="goal")
    )
    chart.update_xaxes(title_text="time [s]")
    chart.update_yaxes(title_text="goal [rad]")
    _dress(chart, 280)
    return _html(chart)


def _dress(chart: go.Figure, height: int) -> None:
    chart.update_layout(
        height=height,
        margin={"l": 8, "r": 8, "t": 8, "b": 8},
        paper_bgcolor="white",
        plot_bgcolor="white",
        font={"family": "system-ui, sans-serif", "size": 12, "color": "#1c2126"},
        legend={"orientation": "h", "x": 0, "y": 1.02, "xanchor": "left", "yanchor": "bottom"},
    )
    chart.update_xaxes(gridcolor=GREY, zerolinecolor=GREY, automargin=True, title_standoff=6)
    chart.update_yaxes(gridcolor=GREY, zerolinecolor=GREY, automargin=True, title_standoff=4, title_font_size=11)


def _small(values: np.ndarray) -> np.ndarray:
    return np.asarray(values, np.float32)


def _html(chart: go.Figure) -> str:
    return chart.to_html(full_html=False, include_plotlyjs=False, config=CONFIG)
