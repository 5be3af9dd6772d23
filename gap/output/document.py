"""A diagnosis as plain data, the form of ``diagnosis.json``, and back."""

from __future__ import annotations

import json
import math
from collections import abc
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass, replace
from itertools import repeat
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np

from ...common.documents import DocumentError, read_json
from ...common.errors import SealegsError
from ..experiment import DetectionLimit, Experiment, read_goals
from ..measure.case import Case
from ..measure.measured import Measured
from ..measure.named import CERTAIN, NamedCause
from ..verdict.decide import overall as overall_verdict
from ..verdict.verdict import NOT_IDENTIFIABLE, PARTLY, DataError, JointDiagnosis, Reason, Verdict
from .extension import changes, not_native

FORMAT_VERSION = 2  # 1 had errors of the log among the causes, and `retuned` for both `gap.refitted` and `tuned`
FILE = "diagnosis.json"


def document_of(diagnoses: Sequence[JointDiagnosis], name: str, runs: Sequence[str]) -> dict[str, Any]:
    """The diagnosis of one machine as plain data."""
    documents = []
    for diagnosis in diagnoses:
        document = to_document(diagnosis)
        if diagnosis.problem is not None:
            chain = diagnosis.problem.chain(diagnosis.values)
            document["extension"] = {
                "changes": changes(diagnosis),
                "not_native": [] if chain is None else not_native(chain),
            }
        documents.append(document)
    return plain(whole(documents, name, runs))


def whole(documents: Sequence[dict[str, Any]], name: str, runs: Sequence[str]) -> dict[str, Any]:
    """The document of a machine from those of its joints."""
    one = documents[0] if len(documents) == 1 else {**overall(documents), "joints": list(documents)}
    return {"version": FORMAT_VERSION, "data": name, "runs": list(runs), **one}


def to_document(diagnosis: JointDiagnosis) -> dict[str, Any]:
    """One joint's diagnosis as plain data."""
    experiment = diagnosis.experiment
    return {
        "joint": diagnosis.joint,
        "verdict": diagnosis.verdict,
        "sentence": diagnosis.sentence,
        "reasons": [asdict(reason) for reason in diagnosis.reasons],
        "gap": {
            "signal": diagnosis.signal,
            "unit": diagnosis.unit,
            **{name: {"rmse": error.rmse, "mae": error.mae} for name, error in diagnosis.gap.items()},
        },
        "data_errors": [asdict(error) for error in diagnosis.data_errors],
        "causes": [_cause(cause) for cause in diagnosis.causes],
        "open_causes": [asdict(cause) for cause in diagnosis.open_causes],
        "limits": [asdict(limit) for limit in diagnosis.limits],
        "frames": None if diagnosis.frames is None else dict(diagnosis.frames),
        "model": diagnosis.model,
        "tuned_share": diagnosis.tuned_share,
        "shared_share": diagnosis.shared_share,
        "shared_shares": dict(diagnosis.shared_shares),
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
        "tuned": dict(diagnosis.tuned),
        "findings": [asdict(finding) for finding in diagnosis.findings],
    }


def _cause(cause: NamedCause) -> dict[str, Any]:
    return {key: value for key, value in asdict(cause).items() if key not in ("picture", "against")}


def overall(documents: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Verdict over several joints: the worst-understood joint speaks for the machine, unless a cause is certain.

    Then what is certain speaks, and what is open elsewhere is among the reasons.
    """
    worst = documents[overall_verdict([document["verdict"] for document in documents])]
    causes = sorted(
        (cause for document in documents for cause in document["causes"]), key=lambda cause: -cause["share"]
    )
    speaks, verdict, reasons = worst, worst["verdict"], worst["reasons"]
    certain = {document["joint"]: max(_certain(document), default=0.0) for document in documents}
    if verdict == NOT_IDENTIFIABLE and any(certain.values()):
        speaks, verdict = max(documents, key=lambda document: certain[document["joint"]]), PARTLY
        rest = [one for one in documents if one is not speaks]
        told = [{"code": "joint", "sentence": one["sentence"]} for one in rest]
        reasons = [*speaks["reasons"], *told]
    return {
        "verdict": verdict,
        "sentence": speaks["sentence"],
        "reasons": reasons,
        "gap": speaks["gap"],
        "data_errors": [error for document in documents for error in document["data_errors"]],
        "causes": causes,
        "open_causes": [cause for document in documents for cause in document.get("open_causes", ())],
        "unexplained": speaks["unexplained"],
        "rivals": [rival for document in documents for rival in document["rivals"]],
        "next_experiment": worst["next_experiment"],
    }


def _certain(document: Mapping[str, Any]) -> list[float]:
    """Shares of the causes of a joint that are certain."""
    return [cause["share"] for cause in document["causes"] if cause["standing"] == CERTAIN]


def plain(value: Any) -> Any:
    """JSON without NaN and NumPy types."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, Path):
        return value.name
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_document(document: Mapping[str, Any], path: Path) -> None:
    """Write a document as ``diagnosis.json``."""
    path.write_text(json.dumps(plain(document), indent=1) + "\n", encoding="utf-8")


def read_document(folder: Path) -> dict[str, Any]:
    """The document of a diagnosis folder.

    Raises:
        SealegsError: there is none, or it is damaged.
    """
    path = folder / FILE
    try:
        document = read_json(path)
    except DocumentError as error:
        raise SealegsError(f"{folder} holds no diagnosis: {path.name} {error.problem}; diagnose again.") from None
    if not isinstance(document, dict) or document.get("version") != FORMAT_VERSION:
        raise SealegsError(f"{path} is no diagnosis of this version of sealegs, or it is damaged; diagnose again.")
    return document


def sentences_of(written: Mapping[str, Path]) -> list[str]:
    """What a diagnosis says of the whole robot, from the document among its files (``json``)."""
    path = written.get("json")
    if path is None or not path.is_file():
        return []
    found = read_json(path).get("whole_robot") or {}
    return [found[key] for key in ("bodies", "left", "harm") if key in found]


def joints_of(document: Mapping[str, Any], folder: Path) -> tuple[JointDiagnosis, ...]:
    """The joints of a document, without what is not on disk: problem, search and simulated channels.

    Raises:
        SealegsError: the document is damaged.
    """
    try:
        rows = document.get("joints") or [document]
        return tuple(_joint(row, folder) for row in rows)
    except (LookupError, TypeError, AttributeError, ValueError) as error:
        raise SealegsError(f"{folder / FILE} is damaged ({error}); diagnose again.") from None


def _joint(row: Mapping[str, Any], folder: Path) -> JointDiagnosis:
    errors = {key: value for key, value in row["gap"].items() if isinstance(value, dict)}
    return JointDiagnosis(
        _read(Case, {**row, **{key: row["gap"][key] for key in ("signal", "unit")}}),
        Verdict(row["verdict"], row["sentence"], _read(tuple[Reason, ...], row["reasons"])),
        _read(Measured, {**row, "gap": errors}),
        data_errors=_read(tuple[DataError, ...], row["data_errors"]),
        experiment=_experiment(row.get("next_experiment"), folder),
        limits=_read(tuple[DetectionLimit, ...], row.get("limits", ())),
    )


def _experiment(row: Mapping[str, Any] | None, folder: Path) -> Experiment | None:
    if row is None or "file" not in row or not (folder / row["file"]).is_file():
        return None
    _, time, goal = read_goals(folder / row["file"])
    return replace(_read(Experiment, {**row, "time": (), "goal": ()}), time=time, goal=goal)


def _read(kind: Any, value: Any) -> Any:
    """A value of a type from plain data: a dataclass from those keys that it has, NaN for a number that is null."""
    origin, inner = get_origin(kind), get_args(kind)
    if isinstance(kind, type) and is_dataclass(kind):
        types = get_type_hints(kind)
        return kind(**{f.name: _read(types[f.name], value[f.name]) for f in fields(kind) if f.name in value})
    if origin in (UnionType, Union):
        return None if value is None else _read(next(one for one in inner if one is not NoneType), value)
    if origin is tuple:
        each = repeat(inner[0]) if Ellipsis in inner else inner
        return tuple(_read(one, item) for one, item in zip(each, value, strict=False))
    if origin in (dict, abc.Mapping):
        return {key: _read(inner[1], item) for key, item in value.items()}
    return math.nan if kind is float and value is None else value
