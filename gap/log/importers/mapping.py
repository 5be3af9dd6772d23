"""A mapping: which columns of the log come from which of a foreign recording, as a YAML file that a person reads."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping as AnyMapping
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ....common.documents import DocumentError, read_yaml
from ....common.errors import nearest
from ..reader import build_run
from ..sidecar import Sidecar, check_keys, checked_kinds, checked_parts
from ..table import check_columns
from ..types import REQUIRED_EVERYWHERE, SIGNAL_UNITS, Array, LogError, MeasuredRun
from .expression import ROW, column, evaluate, names_in
from .recording import LARGEST_EXACT, Recording

FOLDER = Path(__file__).resolve().parents[3] / "configs" / "mapping"
"""Mappings of published data sets, by one word."""
KEYS = ("columns", "constants", "questions", "sidecar", "where", "notes", "unused")
FACT = re.compile(r"\$\{([^}]*)\}")


@dataclass(frozen=True)
class Question:
    """What neither names nor numbers tell.

    Attributes:
        about: columns of the log that hang on the answer.
        ask: the question, and what speaks for which answer.
    """

    about: tuple[str, ...]
    ask: str


@dataclass(frozen=True)
class Mapping:
    """How a recording becomes a log.

    Attributes:
        columns: expression for each column of the log.
        constants: numbers that expressions take beside those of the file.
        questions: that are open.
        sidecar: as it is written beside each log; ``${kp/256}`` stands for a number or word of the file.
        where: expression of the samples that are kept, those above zero.
    """

    columns: dict[str, str]
    constants: dict[str, float] = field(default_factory=dict)
    questions: tuple[Question, ...] = ()
    sidecar: dict[str, Any] = field(default_factory=dict)
    where: str | None = None


def read_mapping(path: str | Path) -> Mapping:
    """Read a mapping: a file, or the word of one that is shipped.

    Raises:
        LogError: there is none, or it is not what a mapping is.
    """
    file, shipped = Path(path), FOLDER / f"{path}.yaml"
    file = shipped if not file.suffix and not os.path.isfile(file) and os.path.isfile(shipped) else file
    try:
        content = read_yaml(file)
    except DocumentError as error:
        if not error.missing:
            raise LogError(f"{file}: {error.problem}; correct it.") from None
        words = sorted(one.stem for one in FOLDER.glob("*.yaml"))
        raise LogError(
            f"mapping={path}: there is no such file{nearest(str(path), words)}; words are {', '.join(words)}."
        ) from None
    return _checked(content, file)


def _checked(content: Any, file: Path) -> Mapping:
    if not isinstance(content, dict) or not isinstance(content.get("columns"), dict):
        raise LogError(f"{file}: must be a mapping with the key columns, a line for each column of the log.")
    check_keys(content, KEYS, str(file))
    columns = {str(name): str(text) for name, text in content["columns"].items() if text is not None}
    for name, text in columns.items():
        try:
            names_in(text)
        except LogError as error:
            raise LogError(f"{file}: column '{name}': {error}") from None
    constants, sidecar = content.get("constants") or {}, content.get("sidecar") or {}
    if not isinstance(constants, dict) or not all(type(value) in (int, float) for value in constants.values()):
        raise LogError(f"{file}: the key constants must be a mapping of names to numbers.")
    if not isinstance(sidecar, dict):
        raise LogError(f"{file}: the key sidecar must be a mapping, which becomes the sidecar of the log.")
    checked_kinds(sidecar, f"{file}, under sidecar")
    try:
        asked = tuple(
            Question(tuple(map(str, one["about"])), str(one["ask"])) for one in content.get("questions") or []
        )
    except (TypeError, KeyError):
        raise LogError(f"{file}: each of the questions needs about, a list of columns, and ask.") from None
    where = content.get("where")
    numbers = {str(key): float(value) for key, value in constants.items()}
    return Mapping(columns, numbers, asked, sidecar, None if where is None else str(where))


def ended(sentence: str) -> str:
    """A sentence with its sign at the end."""
    return sentence if sentence.endswith((".", "?", "!")) else f"{sentence}."


def lacking(mapping: Mapping, recording: Recording) -> set[str]:
    """Names of columns and numbers that a mapping takes and a recording does not have."""
    texts = [*mapping.columns.values(), *([mapping.where] if mapping.where else [])]
    taken = {name for text in texts for name in names_in(text)}
    return taken - {*recording.columns, *recording.facts, *mapping.constants, "pi", ROW}


def converted(mapping: Mapping, recording: Recording) -> MeasuredRun:
    """The run that a recording is by a mapping.

    Raises:
        LogError: a column that it takes is missing, or what comes out is no log.
    """
    where = str(recording.source)
    values = recording.known_names() | mapping.constants | recording.columns
    table: dict[str, Array] = {
        name: column(text, values, f"{where}: column '{name}'", recording.length)
        for name, text in mapping.columns.items()
    }
    if mapping.where is not None:
        kept = column(mapping.where, values, f"{where}: the key where", recording.length) > 0.0
        table = {name: cells[kept] for name, cells in table.items()}
    _check_complete(table, mapping, where)
    for name, cells in list(table.items()):
        if name.endswith(".enabled") and (cells > 0.5).all():  # on throughout is what its absence says
            del table[name]
    check_columns(list(table), recording.source)
    said = checked_parts(filled(mapping.sidecar, recording), f"{where}: sidecar of the mapping")
    joints = {name.rpartition(".")[0] for name in table if name.rpartition(".")[2] in SIGNAL_UNITS}
    # stand in for chains that the user has yet to name
    undriven: dict[str, str | list] = dict.fromkeys(joints, "ideal")
    run = build_run(
        recording.name, table, Sidecar("bench", {}, undriven, {}), recording.source, 0
    )  # checks of the values
    return MeasuredRun(
        run.name, time=run.time, joints=run.joints, base=run.base, robot=said.robot, robot_params=said.robot_params,
        actuators=said.actuators, source=recording.source, meta=said.meta, host=run.host,
    )  # fmt: skip


def _check_complete(table: AnyMapping[str, Array], mapping: Mapping, where: str) -> None:
    """Time, goals and positions have a value in every sample; the key where leaves samples out."""
    needed = [name for name in table if name == "time" or name.rpartition(".")[2] in REQUIRED_EVERYWHERE]
    lost = {name: empty for name in needed if (empty := ~np.isfinite(table[name])).any()}
    for name, empty in lost.items():
        factors = [f"known({mapping.columns[one]})" for one in lost] + [f"({mapping.where})"] * bool(mapping.where)
        raise LogError(
            f"{where}: column '{name}' has no value in {int(empty.sum())} of {len(empty)} samples, the first in row "
            f"{int(np.argmax(empty)) + 1}; hold a goal that is written only where it changes, hold(<column>), or leave "
            f"the samples out by the line `where: {'*'.join(factors)}` in the mapping."
        )


def filled(content: Any, recording: Recording) -> Any:
    """A sidecar with ``${...}`` replaced by what the recording says.

    Raises:
        LogError: it takes a number that the recording does not have.
    """
    if isinstance(content, AnyMapping):
        return {filled(key, recording): filled(value, recording) for key, value in content.items()}
    if isinstance(content, Sequence) and not isinstance(content, str):
        return [filled(value, recording) for value in content]
    if not isinstance(content, str):
        return content
    facts = {"name": recording.name, **recording.facts}

    def value(text: str) -> Any:
        found = evaluate(text, facts, f"{recording.source}: sidecar")
        return found if isinstance(found, str) else float(np.asarray(found))

    if match := FACT.fullmatch(content):
        return value(match[1])
    return FACT.sub(lambda match: _spelt(value(match[1])), content)


def _spelt(value: float | str) -> str:
    """A word, or a number with all of its digits: runs whose numbers differ are of different groups."""
    if isinstance(value, str):
        return value
    return str(int(value)) if abs(value) < LARGEST_EXACT and value == int(value) else repr(value)
