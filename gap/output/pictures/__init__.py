"""Pictures of a diagnosis: of the whole, and one per cause that shows it to a person who doubts it."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ...measure.named import NamedCause
from ...verdict.verdict import JointDiagnosis
from .drive import duty_against_error, residual_against_temperature, response, voltage_against_current
from .evidence import Evidence
from .first_look import first_look, overview
from .timeline import signature_pictures, stance
from .transmission import (
    error_since_reversal,
    friction_against_speed,
    hysteresis,
    passed_torque,
    residual_against_load,
    residual_against_position,
)

SUMMARIES: dict[str, Callable[[JointDiagnosis], Figure | None]] = {
    "first_look": first_look,
    "overview": overview,
}
CAUSES: dict[str, Callable[[Evidence, NamedCause], Figure]] = {
    "friction_against_speed": friction_against_speed,
    "residual_against_load": residual_against_load,
    "residual_against_position": residual_against_position,
    "residual_against_temperature": residual_against_temperature,
    "response": response,
    "duty_against_error": duty_against_error,
    "voltage_against_current": voltage_against_current,
    "hysteresis": hysteresis,
    "error_since_reversal": error_since_reversal,
}
"""Pictures by the key that a cause of the catalogue names."""
OF_REPLAY: dict[str, Callable[[Evidence, NamedCause], Figure]] = {"passed_torque": passed_torque, "stance": stance}
"""Those that a replay shows in place of the one that the cause names."""
SHARED = frozenset({"friction_against_speed", "residual_against_load", "voltage_against_current", "hysteresis"})
"""Of these, the ones that look the same for every cause: drawn once, for the largest cause that names them."""


def picture_of(cause: NamedCause) -> str:
    """Which picture shows a cause; empty where none does."""
    return "" if cause.kind == "data" else cause.picture


def pictures(diagnosis: JointDiagnosis) -> Iterator[tuple[str, Figure]]:
    """The pictures of one joint, one at a time: summaries by their name, causes by theirs."""
    for name, draw in SUMMARIES.items():
        if (chart := draw(diagnosis)) is not None:
            yield name, chart
    yield from cause_pictures(diagnosis)
    yield from signature_pictures(diagnosis)


def cause_pictures(diagnosis: JointDiagnosis) -> Iterator[tuple[str, Figure]]:
    """The pictures of the causes of one joint, by their names; none where nothing was replayed."""
    problem = diagnosis.problem
    if problem is None:
        return
    evidence, drawn = Evidence(diagnosis), set[str]()
    for cause in diagnosis.causes:
        key = problem.picture(picture_of(cause))
        draw = CAUSES.get(key) or OF_REPLAY.get(key)
        if draw is not None and key not in drawn & SHARED:
            drawn.add(key)
            yield cause.name, draw(evidence, cause)


def png(chart: Figure) -> bytes:
    """A picture as a PNG file."""
    FigureCanvasAgg(chart)
    buffer = io.BytesIO()
    chart.savefig(buffer, format="png")
    return buffer.getvalue()


def draw_all(diagnoses: Sequence[JointDiagnosis], folder: Path) -> dict[str, Path]:
    """Draw every picture of a diagnosis into a folder that has none yet.

    Returns:
        Paths by name of the picture (``first_look``, ``overview``, ..., name of a cause); with several joints
        ``<joint>.<name>``.

    Raises:
        FileExistsError: a picture of that name is there already; nothing is overwritten.
    """
    folder.mkdir(parents=True, exist_ok=True)
    drawn: dict[str, Path] = {}
    for diagnosis in diagnoses:
        prefix = f"{diagnosis.joint}." if len(diagnoses) > 1 else ""
        for name, chart in pictures(diagnosis):
            path = folder / f"{prefix}{name}.png"
            with path.open("xb") as file:
                file.write(png(chart))
            drawn[f"{prefix}{name}"] = path
    return drawn


__all__ = [
    "CAUSES",
    "SUMMARIES",
    "cause_pictures",
    "draw_all",
    "picture_of",
    "pictures",
    "png",
    "signature_pictures",
]
