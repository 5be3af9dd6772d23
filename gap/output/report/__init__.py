"""The report: one self-contained HTML page that a person can send to a colleague."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from plotly.offline import get_plotlyjs

from ...log.types import MeasuredSet
from ...verdict.verdict import JointDiagnosis
from ..numbers import glued
from .view import page

HERE = Path(__file__).parent


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
        robot: what :func:`sealegs.gap.output.whole.confirm_whole` found.

    Raises:
        FileExistsError: the file is there already; nothing is overwritten.
    """
    environment = Environment(
        loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["glued"] = glued
    style = (HERE / "report.css").read_text(encoding="utf-8")
    values = page(diagnoses, data, changes, robot)
    html = environment.get_template("report.html.j2").render(**values, style=style, plotly=get_plotlyjs())
    with path.open("x", encoding="utf-8") as file:
        file.write(html)
    return path


__all__ = ["write_report"]
