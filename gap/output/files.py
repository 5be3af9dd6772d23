"""A diagnosis on disk: ``diagnosis.json``, the extended chain and MJCF, the next experiment, pictures and report."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ..experiment import write_experiment
from ..ground.files import write_leg
from ..ground.leg_problem import LegProblem
from ..log.parts import TEST
from ..log.types import LogError, MeasuredSet
from ..replay.engine import STEP, bench, replay_in_engine
from ..replay.problem import largest_step
from ..replay.simulator import joint_state
from ..verdict.verdict import JointDiagnosis, NamedCause
from .extension import changes, not_native, write_extension

VERSION = 1


def fresh_folder(path: Path) -> Path:
    """Make the output folder.

    Raises:
        LogError: it has something in it already, which is never overwritten.
    """
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise LogError(f"{path} is not empty, and nothing in it is overwritten; give another out=<folder>.")
    path.mkdir(parents=True, exist_ok=True)
    return path


def write_diagnosis(
    diagnoses: Sequence[JointDiagnosis],
    data: MeasuredSet,
    folder: Path,
    progress: Callable[[str], None] = lambda text: None,
) -> dict[str, Path]:
    """Write everything into a fresh folder.

    Returns:
        Paths by what they hold: ``json``, ``report``, ``pictures``; with an extension also ``chain`` and ``mjcf``, with
        a proposal ``experiment``; of several joints ``<joint> chain`` and so on.
    """
    from .pictures import draw_all
    from .report import write_report

    written: dict[str, Path] = {}
    documents = []
    differences: list[dict[str, Any]] = []
    for diagnosis in diagnoses:
        several = len(diagnoses) > 1
        prefix, owner = (f"{diagnosis.joint}-", f"{diagnosis.joint} ") if several else ("", "")
        document = to_document(diagnosis)
        if diagnosis.problem is not None:
            progress("confirming in the engine")
            leg = isinstance(diagnosis.problem, LegProblem)
            files = (write_leg if leg else write_extension)(diagnosis, folder, prefix)
            written |= {f"{owner}{key}": path for key, path in files.items()}
            changed = changes(diagnosis)
            document["extension"] = {
                "files": {key: path.name for key, path in files.items()},
                "changes": changed,
                "not_native": []
                if leg
                else not_native(diagnosis.problem.models[0].with_fitted(diagnosis.values).chain),
                "engine": confirm(diagnosis) if all(diagnosis.problem.params) else {},
            }
            differences += changed
        if diagnosis.experiment is not None:
            actuator = data.runs[0].actuators[diagnosis.joint]
            files = write_experiment(diagnosis.experiment, diagnosis.joint, folder, actuator, prefix)
            document["next_experiment"]["file"] = files["experiment"].name
            written |= {f"{owner}{key}": path for key, path in files.items()}
        documents.append(document)
    first = documents[0]
    whole = first if len(documents) == 1 else {**_overall(documents), "joints": documents}
    whole = {"version": VERSION, "data": data.name, "runs": [run.name for run in data.runs], **whole}
    written["json"] = folder / "diagnosis.json"
    written["json"].write_text(json.dumps(_plain(whole), indent=1) + "\n", encoding="utf-8")
    progress("drawing")
    written["pictures"] = folder / "pictures"
    written["pictures"].mkdir(exist_ok=True)
    draw_all(list(diagnoses), written["pictures"])
    written["report"] = folder / "report.html"
    write_report(list(diagnoses), data, written["report"], changes=differences)
    return written


def to_document(diagnosis: JointDiagnosis) -> dict[str, Any]:
    """One joint's diagnosis as plain data."""
    experiment = diagnosis.experiment
    return {
        "joint": diagnosis.joint,
        "verdict": diagnosis.verdict,
        "sentence": diagnosis.sentence,
        "gap": {
            "signal": diagnosis.signal,
            "unit": diagnosis.unit,
            **{name: {"rmse": error.rmse, "mae": error.mae} for name, error in diagnosis.gap.items()},
        },
        "causes": [_cause(cause) for cause in diagnosis.causes],
        "unexplained": diagnosis.unexplained,
        "structure": None
        if (rest := diagnosis.structure) is None
        else {**asdict(rest), "noticed": rest.noticed, "sentence": rest.sentence},
        "rivals": list(diagnosis.rivals),
        "next_experiment": None
        if experiment is None
        else {
            "name": experiment.name,
            "sentence": experiment.sentence,
            "separation": experiment.separation,
            "repeats": experiment.repeats,
            "load": experiment.load,
            "rivals": list(experiment.rivals),
            "table": experiment.table,
        },
        "retuned": diagnosis.retuned,
        "findings": [asdict(finding) for finding in diagnosis.findings],
    }


def confirm(diagnosis: JointDiagnosis) -> dict[str, float]:
    """The extended model in the engine, on the longest piece of the test part.

    Returns:
        ``rmse`` of the engine, ``search_rmse`` of the search's simulator, and their ``distance`` [rad].
    """
    problem = diagnosis.problem
    assert problem is not None
    at = [k for k, unit in enumerate(problem.units) if unit.part == TEST] or [0]
    k = max(at, key=lambda k: problem.starts[k + 1] - problem.starts[k])
    rows = slice(problem.starts[k], problem.starts[k + 1])
    if not problem.on[rows].all():
        at = [j for j in at if problem.on[problem.starts[j] : problem.starts[j + 1]].all()]
        if not at:
            return {}
        k = at[0]
        rows = slice(problem.starts[k], problem.starts[k + 1])
    unit = problem.units[k]
    joint = problem.models[unit.run].with_fitted(diagnosis.values)
    drivetrain = bench(joint, problem.params[unit.run])
    program = joint.chain.program()
    state = joint_state(program, joint.constants(problem.params[unit.run], program), *unit.state)
    step = min(STEP, largest_step(joint.chain))
    out = replay_in_engine(drivetrain, problem.time[rows], problem.goal[rows], state, step)
    judged = problem.judged[rows]
    reading = joint.host_scale * out[judged, 0] + joint.host_offset
    measured = problem.measured[rows][judged, 0]
    search = diagnosis.simulated["extended"][rows][judged, 0]
    return {
        "rmse": float(np.sqrt(np.mean((reading - measured) ** 2))),
        "search_rmse": float(np.sqrt(np.mean((search - measured) ** 2))),
        "distance": float(np.sqrt(np.mean((reading - search) ** 2))),
    }


def _cause(cause: NamedCause) -> dict[str, Any]:
    return {
        "name": cause.name,
        "joint": cause.joint,
        "kind": cause.kind,
        "sentence": cause.sentence,
        "share": cause.share,
        "confidence": cause.confidence,
        "parameters": {path: asdict(value) for path, value in cause.parameters.items()},
        "gain": cause.gain,
        "rivals": list(cause.rivals),
    }


def _overall(documents: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Verdict over several joints: the worst-understood joint speaks for the machine."""
    order = ("unusable log", "not identifiable", "partly explained", "explained", "nothing to explain")
    worst = min(documents, key=lambda document: order.index(document["verdict"]))
    causes = sorted(
        (cause for document in documents for cause in document["causes"]), key=lambda cause: -cause["share"]
    )
    return {
        "verdict": worst["verdict"],
        "sentence": " ".join(document["sentence"] for document in documents),
        "gap": worst["gap"],
        "causes": causes,
        "unexplained": worst["unexplained"],
        "rivals": [rival for document in documents for rival in document["rivals"]],
        "next_experiment": worst["next_experiment"],
    }


def _plain(value: Any) -> Any:
    """JSON without NaN and NumPy types."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, Path):
        return value.name
    return None if isinstance(value, float) and not math.isfinite(value) else value
