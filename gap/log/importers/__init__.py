"""Recordings of other formats as measured logs: read, mapped, written. ``sealegs import --help``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from collections.abc import Mapping as AnyMapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from ....common.atomic import write_text
from ....common.errors import nearest
from ..sidecar import FOLDER_DEFAULTS, beside
from ..table import ENDINGS
from ..types import LogError
from ..writer import write_run
from .dialects import dialects
from .mapping import Mapping, converted, ended, lacking, read_mapping
from .proposal import Proposal, proposal_text, propose
from .readers import check_runs, paired, read_recordings, read_source
from .recording import FEWEST_RECORDED, Recording
from .sidecars import answered, asked_chain, asked_robot, folder_sidecar, proposed_sidecar, robot_of

MANY_ROWS = 20_000
"""Longer recordings are written as Parquet where nobody says which format."""

__all__ = [
    "Imported",
    "Proposed",
    "Recording",
    "answered",
    "import_logs",
    "propose_for",
    "read_mapping",
    "read_recordings",
]


@dataclass(frozen=True)
class Proposed:
    """A proposal for the recordings of a source.

    Attributes:
        text: of the mapping file, with reasons and questions.
        mapping: the same as it is applied.
        certain: without what is in question.
        recordings: that it is for.
        left: recordings that have other columns, with the reason.
    """

    text: str
    mapping: Mapping
    certain: Mapping
    recordings: tuple[Recording, ...]
    left: tuple[str, ...]


@dataclass(frozen=True)
class Imported:
    """What an import wrote.

    Attributes:
        files: tables, each with its sidecar.
        missing: keys of the sidecar that must be filled in.
        left: recordings that were not imported, with the reason.
        sidecar: of the folder.
    """

    files: tuple[Path, ...]
    missing: tuple[str, ...]
    left: tuple[str, ...]
    sidecar: Path


def propose_for(
    source: Path,
    out: Path,
    unit: str | None = None,
    robot: str | None = None,
    actuator: str | None = None,
    command: str = "",
    params: AnyMapping[str, float] | None = None,
    dialect: str | Path | None = None,
) -> Proposed:
    """Propose how the recordings of a source become logs.

    Args:
        source: file or folder.
        out: folder that the logs will go to.
        unit: of positions and goals, where the file leaves it open.
        robot: for the sidecar.
        actuator: of all joints, for the sidecar.
        command: that imports with the mapping, for its head.
        params: numbers of the robot, for the sidecar.
        dialect: file of a dialect of one's own, which comes before the others.

    Raises:
        LogError: the source cannot be read.
    """
    machine = asked_robot(robot, out)
    recordings, rest, without = _read(source, machine.joints)
    name = recordings[0].name
    left = [f"{one.name} has other columns than {name}; import it on its own" for one in rest] + without
    known = dialects(dialect)
    proposal = propose(recordings, unit, machine.slides, known, machine.joints)
    chain = asked_chain(actuator, out, proposal.joints, lambda: recordings[0])
    sidecar = proposed_sidecar(recordings[0], proposal, beside(machine.word, out), chain, params)
    text = proposal_text(proposal, sidecar, recordings, command, left)
    mapping = replace(proposal.mapping(), sidecar=sidecar)
    return Proposed(text, mapping, _certain(proposal, sidecar), tuple(recordings), tuple(left))


def _certain(proposal: Proposal, sidecar: dict[str, Any]) -> Mapping:
    certain = proposal.certain()
    kept = {*certain.joints, *certain.columns}
    own = {key: {name: one for name, one in sidecar[key].items() if name in kept}
           for key in ("actuators", "units") if key in sidecar}  # fmt: skip
    return replace(certain.mapping(), sidecar=sidecar | own)


def _alike(recordings: list[Recording]) -> list[Recording]:
    """The recordings whose columns most of them have.

    Of as many with each, those with the most samples; a list of a few rows beside runs is none.
    """
    count: Counter[tuple[str, frozenset[str]]] = Counter()
    samples: Counter[tuple[str, frozenset[str]]] = Counter()
    for recording in recordings:
        key = recording.kind, frozenset(recording.columns)
        count[key] += recording.length >= FEWEST_RECORDED
        samples[key] += recording.length
    kind, columns = max(samples, key=lambda key: (count[key], samples[key]))
    return [one for one in recordings if one.kind == kind and columns == one.columns.keys()]


def _read(source: Path, joints: Collection[str]) -> tuple[list[Recording], list[Recording], list[str]]:
    """The recordings that a proposal is for, those that have other columns, and sentences on files without a sample.

    Args:
        source: file or folder.
        joints: of the robot.
    """
    found, without = read_source(source)
    found = paired(found, source) or found
    alike = _alike(found)
    check_runs(alike, joints, source)
    return alike, [one for one in found if one not in alike], without


def import_logs(
    source: Path, out: Path, mapping: Mapping, format: str | None = None, recordings: Sequence[Recording] | None = None
) -> Imported:
    """Write the recordings of a source as measured logs into a folder that has none; nothing is overwritten.

    Args:
        source: file or folder.
        out: folder to write to.
        mapping: what becomes of their columns.
        format: ``csv`` or ``parquet``; None: by their length.
        recordings: of the source, where they are read already.

    Raises:
        LogError: a question is open, a column is missing, a value is none that a log may have, or the folder has logs.
    """
    if mapping.questions:
        asked = mapping.questions[0]
        raise LogError(
            f"the mapping has {len(mapping.questions)} open question{'s' * (len(mapping.questions) > 1)}, the first "
            f"about {', '.join(asked.about[:3])}: {ended(asked.ask)} Correct its lines under columns and remove it "
            "from questions."
        )
    found, without = list(recordings or ()), list[str]()
    if recordings is None:
        found, rest, without = _read(source, robot_of(mapping.sidecar.get("robot"), out).joints)
        found += rest
    fitting = [recording for recording in found if not lacking(mapping, recording)]
    if not fitting:
        has = [*found[0].columns, *found[0].facts]
        names = ", ".join(f"{name}{nearest(name, has)}" for name in sorted(lacking(mapping, found[0])))
        raise LogError(f"{found[0].source}: the mapping takes {names}, which it does not have; correct the mapping.")
    left = [f"{one.name} does not have the columns of the mapping" for one in found if one not in fitting] + without
    runs, out = [converted(mapping, recording) for recording in fitting], Path(out)
    for run in runs:
        robot_of(run.robot, out).check(run.name, run.joints)
    sidecar = out / FOLDER_DEFAULTS
    if there := sorted(path for path in out.glob("*") if path.suffix in ENDINGS or path.name == FOLDER_DEFAULTS):
        raise LogError(
            f"{there[0]}: exists already, and a recording is never overwritten; import into a folder of its own, or "
            "several recordings at once. Nothing was written."
        )
    text, missing, own = folder_sidecar(runs)
    if format is None:
        format = "parquet" if max(len(run.time) for run in runs) > MANY_ROWS else "csv"
    out.mkdir(parents=True, exist_ok=True)
    if text:  # before the logs, which it describes
        write_text(sidecar, text)
    texts = [yaml.safe_dump(content, sort_keys=False, allow_unicode=True) for content in own]
    files = tuple(write_run(run, out, format, text) for run, text in zip(runs, texts, strict=True))
    return Imported(files, tuple(missing), tuple(left), sidecar)
