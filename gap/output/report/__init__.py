"""The report: one self-contained HTML page that a person can send to a colleague.

The template decides only where things stand: what it prints are plain values, ready to print.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from plotly.offline import get_plotlyjs
from plotly.subplots import make_subplots

from ....actuators.stages import stage_of
from ...checks.imu import IMU
from ...experiment import Experiment, goal_table
from ...ground.ground import GROUND
from ...log.parts import FIT_A, FIT_B, TEST
from ...log.types import MeasuredRun, MeasuredSet
from ...measure.case import ROBOT
from ...measure.named import NamedCause, Value
from ...replay.parameters import address
from ...replay.problem import Problem
from ...search.result import Search
from ...search.structure import told_in
from ...verdict.verdict import JointDiagnosis
from ..extension import changes as changes_of
from ..extension import not_native, readable
from ..numbers import LAYOUT, glued, number, percent, sureness, told_value
from ..pictures import cause_pictures, picture_of, png, signature_pictures
from ..pictures.first_look import as_logged, first_look, in_words
from ..pictures.style import COLOURS, EXTENDED, NAMES, TEST_SHADE
from ..pictures.timeline import timeline, told, worst_window
from ..terminal import LIMITS, SINGLE, doubts, limit_rows, limits_told, rest_of

HERE = Path(__file__).parent
CONFIG = {"responsive": True, "displaylogo": False, "modeBarButtonsToRemove": ["lasso2d", "select2d"]}
DASH = {"nominal": "solid", "refitted": "dot", "extended": "solid"}
GREY = "#e4e4e4"
MODELS = {
    "nominal": ("nominal model", "as it was believed to be"),
    "refitted": ("refitted model", "its own numbers up to fivefold, nothing added"),
    "extended": ("extended model", "with the causes below"),
    "noise_floor": ("noise of the measurement", "estimated from the log itself"),
}
KINDS = {
    "effect": "effect that the model lacks",
    "number": "wrong number in the model",
    "data": "fault of a column, fitted",
}
HEADINGS = {GROUND: "The ground", IMU: "The IMU", ROBOT: "The whole robot"}
THROUGH = "A right model runs through the black dots."
CAPTIONS = {
    "friction_against_speed": f"What the motor gives and the moving load does not get, against speed. {THROUGH}",
    "residual_against_load": f"Dry friction while moving, against the torque through the gearbox. {THROUGH}",
    "residual_against_position": f"What the measured motion demands, against the position reading. {THROUGH}",
    "residual_against_temperature": (
        f"Torque that the motion needs, over what the nominal motor would give, against its temperature. {THROUGH}"
    ),
    "response": (
        "Above: the moment of the test part where the nominal model is most wrong. Below: the error of both models "
        "over the whole log, against the quantity that this cause makes it follow; a right model stays on zero."
    ),
    "duty_against_error": f"What the controller makes of its error. {THROUGH}",
    "voltage_against_current": (
        f"Supply voltage, as measured current and speed imply it, against the current drawn. {THROUGH}"
    ),
    "hysteresis": (
        "What happens between motor and link, against the torque that the link takes. A right model follows the black "
        "dots; where errors are drawn, it stays on zero in both directions."
    ),
    "stance": (
        "Above: the stance of the test part where the nominal model is most wrong. Below: the errors of all stances of "
        "it; what the uncertain start state explains is taken off. A right model stays on zero."
    ),
    "error_since_reversal": (
        "Error of both models, against the way since the joint last turned around. A right model stays on zero."
    ),
}
REST = {
    "refitted numbers": "Numbers that the model has, refitted beside the causes, some beyond their tolerance and up to "
    "fivefold.",
    "tuned numbers": "Numbers that the model has, moved within their tolerance.",
    SINGLE: "Causes and tuned numbers of the joints, each at its own.",
}
PARAMETER_UNITS = {"mass": "kg", "arm_mass": "kg", "length": "m"}
ABSENT = "not in it"
WHOLE_ERROR_RATIO = 2.0
"""Times the error of a joint alone, from which it is said that the whole robot misses it by more."""


def rendered(template: Path, **values: Any) -> str:
    """A page from its template, with the style of reports."""
    environment = Environment(
        loader=FileSystemLoader(template.parent), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters["glued"] = glued
    style = (HERE / "report.css").read_text(encoding="utf-8")
    return environment.get_template(template.name).render(**values, style=style)


def write_report(
    diagnoses: Sequence[JointDiagnosis],
    data: MeasuredSet,
    path: Path,
    changes: Sequence[Mapping[str, Any]] | None = None,
    robot: Mapping[str, Any] | None = None,
) -> Path:
    """Write the page; it holds its scripts, styles and pictures, and asks nothing of any network.

    Args:
        diagnoses: one per joint.
        data: the logs that were diagnosed.
        path: of the HTML file.
        changes: what the extended chain changes, rows of ``path``, ``from``, ``to``, ``why`` (and ``joint`` where there
            are several); default: as :func:`sealegs.gap.output.extension.changes` has it.
        robot: what :func:`sealegs.gap.output.hand_over.confirm_whole` found.

    Raises:
        FileExistsError: the file is there already; nothing is overwritten.
    """
    html = rendered(HERE / "report.html.j2", **page(diagnoses, data, changes, robot), plotly=get_plotlyjs())
    with path.open("x", encoding="utf-8") as file:
        file.write(html)
    return path


def page(
    diagnoses: Sequence[JointDiagnosis],
    data: MeasuredSet,
    changes: Sequence[Mapping[str, Any]] | None,
    robot: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Everything the template prints."""
    joints = [_joint(diagnosis, data, changes, len(diagnoses)) for diagnosis in diagnoses]
    common = [doubt for doubt in joints[0]["doubts"] if all(doubt in joint["doubts"] for joint in joints[1:])]
    common = common if len(joints) > 1 else []
    for position, joint in enumerate(joints, start=1):
        joint["id"] = f"joint-{position}"
        joint["doubts"] = [doubt for doubt in joint["doubts"] if doubt not in common]
    return {
        "title": data.name,
        "doubts": common,
        "joints": joints,
        "runs": [_run(run) for run in data.runs],
        "robot": None if robot is None else _robot(robot, diagnoses),
    }


def _robot(found: Mapping[str, Any], diagnoses: Sequence[JointDiagnosis]) -> dict[str, Any]:
    """Error of each joint where the whole robot was simulated, beside that of the joint alone, or why it was not."""
    alone = {item.joint: item.gap["extended"].rmse for item in diagnoses if "extended" in item.gap}
    rows, apart = [], []
    for name, item in found.get("joints", {}).items():
        factor, unit = told_in(item["unit"])
        row = {key: number(factor * item[key], 3) for key in ("nominal", "extended")}
        row["alone"] = number(factor * alone[name], 3) if name in alone else ""
        rows.append({"joint": name, "unit": unit, **row})
        if name in alone and item["extended"] > WHOLE_ERROR_RATIO * alone[name]:
            apart.append(name)
    said = [found[key] for key in ("bodies", "left", "harm") if key in found]
    return {"reason": found.get("reason", ""), "rows": rows, "apart": ", ".join(apart), "said": said}


def _joint(
    diagnosis: JointDiagnosis, data: MeasuredSet, changes: Sequence[Mapping[str, Any]] | None, joints: int
) -> dict[str, Any]:
    plot = signals(diagnosis, joints)
    problem = diagnosis.problem
    chain = None if problem is None else problem.chain(diagnosis.values)
    return {
        "name": diagnosis.joint,
        "heading": HEADINGS.get(diagnosis.joint, f"Joint {diagnosis.joint}"),
        "verdict": diagnosis.verdict,
        "sentence": glued(diagnosis.sentence),
        "doubts": [glued(sentence) for sentence in doubts(diagnosis)],
        "reasons": [glued(reason.sentence) for reason in diagnosis.reasons if reason.code not in ("data", LIMITS)],
        "limits": limit_rows(limits_told(diagnosis)),
        "data_errors": diagnosis.data_errors,
        "tuned_share": percent(diagnosis.tuned_share) if diagnosis.tuned_share >= 5e-4 else "",
        "rest": (rest := rest_of(diagnosis), REST[rest]),
        "signal": diagnosis.signal,
        "first_look": _first_look(diagnosis, data.runs),
        "gap": _gap(diagnosis),
        "plot": None if plot is None else {"html": plot[0], "moment": [round(t, 4) for t in plot[1]]},
        "causes": _causes(diagnosis),
        "unexplained": percent(diagnosis.unexplained),
        "structure": "" if diagnosis.structure is None else glued(diagnosis.structure.sentence),
        "rounds": [] if diagnosis.search is None else _rounds(diagnosis.search),
        "rivals": diagnosis.rivals,
        "experiment": None if diagnosis.experiment is None else _experiment(diagnosis.experiment, diagnosis.joint),
        "findings": diagnosis.findings,
        "changes": _changes(diagnosis, changes, joints == 1),
        "not_native": [] if chain is None else not_native(chain),
        "chain": "" if chain is None else readable(chain).to_yaml(),
        "numbers": [] if problem is not None else [(key, number(value)) for key, value in diagnosis.tuned.items()],
        "parts": None if problem is None else _parts(problem),
    }  # fmt: skip


def _gap(diagnosis: JointDiagnosis) -> dict[str, Any]:
    factor, unit = told_in(diagnosis.unit)
    nominal, floor = diagnosis.gap.get("nominal"), diagnosis.gap.get("noise_floor")
    rows = []
    for key, (name, about) in MODELS.items():
        if (error := diagnosis.gap.get(key)) is None:
            continue
        if key == "extended" and not diagnosis.causes:
            about = "no cause was added"
        change = ""
        if nominal is not None and key in ("refitted", "extended") and nominal.rmse > 0.0:
            change = f"{100.0 * (error.rmse / nominal.rmse - 1.0):+.0f} %".replace("-", "\N{MINUS SIGN}")
        rows.append(
            {
                "key": key,
                "name": name,
                "about": about,
                "rmse": number(factor * error.rmse, 3),
                "mae": number(factor * error.mae, 3),
                "noises": "" if floor is None or floor.rmse <= 0.0 else f"{error.rmse / floor.rmse:.1f}",
                "change": change,
            }
        )
    return {"unit": unit, "rows": rows}


def _first_look(diagnosis: JointDiagnosis, runs: Sequence[MeasuredRun]) -> dict[str, str] | None:
    """The picture that the joint opens with, for a wide page and for a phone, and what it shows in words."""
    wide, tall = (first_look(diagnosis, tall) for tall in (False, True))
    words, caption = in_words(diagnosis), ""
    if wide is None or tall is None:
        named = [run for run in runs if any(f.run == run.name for f in diagnosis.findings)]
        run = next(iter(named or runs))
        wide, tall = (as_logged(run, diagnosis, tall) for tall in (False, True))
        words = caption = "The log as it is; no model was compared with it."
    if wide is None or tall is None:
        return None
    share = f"{100.0 * wide.get_figwidth() / LAYOUT.wide[0]:.0f}"  # so that words in all of them are as large
    pictures = {"wide": _image(png(wide)), "tall": _image(png(tall))}
    return {**pictures, "words": words, "caption": caption, "share": share}


def _causes(diagnosis: JointDiagnosis) -> list[dict[str, Any]]:
    drawn = {name: png(chart) for name, chart in cause_pictures(diagnosis)}
    by_key = {picture_of(cause): cause.name for cause in reversed(diagnosis.causes) if cause.name in drawn}
    rows = [
        _cause(cause, drawn.get(cause.name) if picture_of(cause) else None, diagnosis.problem)
        for cause in diagnosis.causes
    ]
    features = {name: png(chart) for name, chart in signature_pictures(diagnosis)}
    for cause, row in zip(diagnosis.causes, rows, strict=True):
        seen = features.get(f"{cause.name}.signature")
        row["features"] = None if seen is None else _image(seen)
        row["features_told"] = "; ".join(told(signature) for signature in cause.signatures)
        row["shown_by"] = by_key.get(picture_of(cause), "") if row["picture"] is None and not row["data"] else ""
    return rows


def _cause(cause: NamedCause, picture: bytes | None, problem: Problem | None) -> dict[str, Any]:
    image = None if picture is None else _image(picture)
    return {
        "name": cause.name,
        "kind": KINDS.get(cause.kind, cause.kind),
        "data": cause.kind == "data",
        "sentence": cause.sentence,
        "share": percent(cause.share),
        "gain": percent(cause.gain),
        "confidence": sureness(cause.confidence),
        "rivals": list(cause.rivals),
        "picture": image,
        "caption": CAPTIONS.get(picture_of(cause), ""),
        "parameters": [_parameter(path, value, problem) for path, value in cause.parameters.items()],
    }


def _image(picture: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(picture).decode()}"


def _parameter(path: str, value: Value, problem: Problem | None) -> dict[str, str]:
    told, nominal = told_value(value), _before(problem, path, value.nominal)
    return {
        "path": path,
        "value": told.value,
        "interval": told.interval,
        "nominal": nominal,
        "believed": "" if nominal == ABSENT else nominal,
        "unit": told.unit,
    }


def _before(problem: Problem | None, path: str, value: float) -> str:
    """Nominal value of a parameter; a stage that the nominal chain lacks has none."""
    stage = address(path).owner
    chain = None if problem is None or stage_of(stage) is None else problem.chain({})
    return number(value) if chain is None or chain.find(stage) is not None else ABSENT


def _rounds(search: Search) -> list[dict[str, Any]]:
    total, least = float(search.counts.sum()), search.settings.rival_win_rate
    rounds = []
    for step in search.rounds:
        if not step.candidates:
            continue
        shown = step.candidates[: LAYOUT.candidates]
        levels = [float(np.sqrt(c.blocks.sum() / total)) for c in shown]
        before = float(np.sqrt(step.before.sum() / total))
        top = max(before, *levels)
        rows = [
            {
                "name": c.cause.key,
                "level": f"{level:.2f}",
                "width": f"{100.0 * level / top:.2f}",
                "best": percent(c.best) if c.best > 0.005 else "",
                "role": "chosen" if step.accepted and k == 0 else "rival" if k > 0 and c.best > least else "other",
            }
            for k, (c, level) in enumerate(zip(shown, levels, strict=True))
        ]
        hidden = len(step.candidates) - len(shown)
        floor = f"{100.0 / top:.2f}"
        rounds.append(
            {"before": f"{before:.2f}", "floor": floor, "accepted": step.accepted, "rows": rows, "more": hidden}
        )
    return rounds


def _experiment(proposal: Experiment, joint: str) -> dict[str, Any]:
    table = sorted(proposal.table.items(), key=lambda item: -item[1])
    top = max([value for _, value in table], default=0.0) or 1.0
    return {
        "name": proposal.name,
        "sentence": glued(proposal.sentence),
        "plot": excitation(proposal),
        "file": f"data:text/csv;base64,{base64.b64encode(goal_table(proposal, joint).encode()).decode()}",
        "table": [
            {
                "name": name,
                "value": f"{value:.1f}",
                "width": f"{100.0 * value / top:.2f}",
                "chosen": name == proposal.name,
            }
            for name, value in table
        ],
    }


def _changes(diagnosis: JointDiagnosis, given: Sequence[Mapping[str, Any]] | None, alone: bool) -> list[dict[str, str]]:
    """Rows of the given changes that are of this joint; where they do not say, all of a single joint's."""
    mine = [row for row in given or () if row.get("joint", diagnosis.joint if alone else None) == diagnosis.joint]
    return [
        {
            "path": row["path"],
            "from": _before(diagnosis.problem, row["path"], row["from"]),
            "to": number(row["to"]),
            "why": row["why"],
        }
        for row in mine or changes_of(diagnosis)
    ]


def _parts(problem: Problem) -> dict[str, str]:
    """Seconds of data that each part of the method saw, and what the simulator used."""
    seconds: dict[int, float] = dict.fromkeys((FIT_A, FIT_B, TEST), 0.0)
    for unit, a, b in zip(problem.units, problem.starts[:-1], problem.starts[1:], strict=True):
        use = problem.time[a:b][problem.judged[a:b]]
        seconds[unit.part] = seconds.get(unit.part, 0.0) + (float(use[-1] - use[0]) if len(use) else 0.0)
    return {
        "fit": f"{seconds[FIT_A]:.0f} + {seconds[FIT_B]:.0f} s",
        "test": f"{seconds[TEST]:.0f} s",
        "step": f"{1e3 * problem.step:g} ms",
    }


def _run(run: MeasuredRun) -> dict[str, Any]:
    params = ", ".join(
        f"{key} {number(value)}\N{NO-BREAK SPACE}{PARAMETER_UNITS.get(key, '')}".strip()
        for key, value in run.robot_params.items()
    )
    signals = dict.fromkeys(signal for log in run.joints.values() for signal in log.signals())
    return {
        "name": run.name,
        "duration": f"{run.duration:.1f}",
        "rate": f"{1.0 / run.period:.0f}",
        "samples": f"{len(run.time)}",
        "params": params,
        "signals": ", ".join(signals),
    }


# --- zoomable plots, as plotly draws them ----------------------------------------------------------------------------


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
    dress(chart, 560)
    chart.update_layout(hovermode="x unified", dragmode="zoom")
    return chart_html(chart), worst_window(line, min(LAYOUT.moment, float(line.x[-1] - line.x[0])))


def excitation(proposal: Experiment) -> str:
    """HTML of the proposed goals over time."""
    chart = go.Figure(
        go.Scatter(x=_small(proposal.time), y=_small(proposal.goal), line={"color": EXTENDED}, name="goal")
    )
    chart.update_xaxes(title_text="time [s]")
    chart.update_yaxes(title_text="goal [rad]")
    dress(chart, 280)
    return chart_html(chart)


def dress(chart: go.Figure, height: int) -> None:
    """Give a chart the look of all charts, and a height [pixels]."""
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


def chart_html(chart: go.Figure) -> str:
    """HTML of a chart, for a page that has plotly's script."""
    return chart.to_html(full_html=False, include_plotlyjs=False, config=CONFIG)
