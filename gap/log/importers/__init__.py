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
from ..types import LogError, MeasuredRun
from ..writer import in_the_way, is_written, write_run
from .claims import claims_of
from .dialects import dialects
from .expression import column
from .lines import ASK
from .mapping import Mapping, converted, ended, lacking, read_mapping
from .one_run import check_runs, paired
from .positions import PERCENT
from .proposal import Proposal, proposal_text, propose
from .readers import read_recordings, read_source
from .recording import FEWEST_RECORDED, Recording
from .robot import Robot, asked_robot, has_model, robot_of
from .sidecars import (
    answered,
    asked_chain,
    beyond,
    blanks,
    check_machine,
    completed,
    folder_and_own,
    proposed_sidecar,
    said_before,
    text_with_blanks,
)

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
        files: tables, each with its sidecar; those that were there already, too.
        missing: keys of the sidecar that must be filled in.
        left: recordings that were not imported, with the reason.
        sidecar: of the folder.
        far: sentences on columns far outside the range of their joint.
        unmodelled: word for a robot that names no model, empty where there is one.
    """

    files: tuple[Path, ...]
    missing: tuple[str, ...]
    left: tuple[str, ...]
    sidecar: Path
    far: tuple[str, ...] = ()
    unmodelled: str = ""


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
    machine.check_shares([name.rpartition(".")[0] for name, one in proposal.columns.items() if one.unit == PERCENT])
    sidecar = proposed_sidecar(
        recordings, proposal, beside(machine.word, out),
        asked_chain(actuator, out, proposal.joints, lambda: recordings[0]),
        params, machine.limits, claims_of(recordings[0], known),
    )  # fmt: skip
    text = proposal_text(proposal, sidecar, recordings, command, left, _far(proposal, recordings, machine))
    mapping = replace(proposal.mapping(), sidecar=sidecar)
    return Proposed(text, mapping, _certain(proposal, sidecar), tuple(recordings), tuple(left))


def _far(proposal: Proposal, recordings: Sequence[Recording], machine: Robot) -> tuple[str, ...]:
    """A sentence for each column that a proposal puts far outside its joint's range."""
    sure = {name: one for name, one in proposal.columns.items() if one.trust != ASK and one.unit != PERCENT}
    sure = {name: one for name, one in sure.items() if name.rpartition(".")[0] in machine.ranges}
    return machine.far(
        (name, column(one.text, run.known_names(), str(run.source), run.length))
        for run in recordings
        for name, one in sure.items()
    )


def _certain(proposal: Proposal, sidecar: dict[str, Any]) -> Mapping:
    certain = proposal.certain()
    kept = dict(sidecar)
    if isinstance(kept.get("actuators"), dict):
        kept["actuators"] = {joint: chain for joint, chain in kept["actuators"].items() if joint in certain.joints}
    if isinstance(kept.get("units"), dict):
        kept["units"] = {name: unit for name, unit in kept["units"].items() if name in certain.columns}
    return replace(certain.mapping(), sidecar=kept)


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
    """Write the recordings of a source as measured logs; nothing that is there is overwritten.

    A log of the same recording that is there as this import would write it is left so: an import that was interrupted
    goes on. Where a name is taken by anything else, nothing is written.

    A ``log.yaml`` that is there stays as it is: what the recordings say otherwise goes into sidecars of their own.

    Args:
        source: file or folder.
        out: folder to write to.
        mapping: what becomes of their columns.
        format: ``csv`` or ``parquet``; None: by their length.
        recordings: of the source, where they are read already.

    Raises:
        LogError: a question is open, a column is missing, a value is none that a log may have, or a target exists.
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
    runs = [converted(mapping, recording) for recording in fitting]
    out = Path(out)
    said, sidecar = said_before(out), out / FOLDER_DEFAULTS
    whole = [completed(run, said or {}) for run in runs]
    check_machine(whole, runs)
    machine = robot_of(whole[0].robot, out)
    for run in whole:
        robot_of(run.robot, out).check_file(run.name)
        machine.check_joints(run.name, run.joints)
    far = machine.far(
        (name, values)
        for run in whole
        for name, values in run.columns().items()
        if (run.meta.get("units") or {}).get(name, "rad") in ("rad", "m")
    )
    shared, own = folder_and_own(runs) if said is None else ({}, [beyond(run, said, out) for run in runs])
    missing = blanks(whole)
    there = _there(runs, own, out)
    left += [f"{run.name} is in {out} already" for run in runs if run.name in there]
    if format is None:
        format = "parquet" if max(len(run.time) for run in runs) > MANY_ROWS else "csv"
    out.mkdir(parents=True, exist_ok=True)
    if not sidecar.exists() and (shared or missing):  # before the logs, which it describes
        write_text(sidecar, text_with_blanks(shared, missing))
    files = []
    for run, content in zip(runs, own, strict=True):
        text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
        files.append(there.get(run.name) or write_run(run, out, format, text))
    unmodelled = next((run.robot for run in whole if run.robot and not has_model(run.robot)), "")
    return Imported(tuple(files), tuple(missing), tuple(left), sidecar, far, unmodelled)


def _there(runs: Sequence[MeasuredRun], own: Sequence[dict[str, Any]], out: Path) -> dict[str, Path]:
    """Logs of a folder that are what an import would write, by name.

    Raises:
        LogError: a name is taken by another log, or all of them are there.
    """
    there: dict[str, Path] = {}
    for run, content in zip(runs, own, strict=True):
        if file := is_written(run, out, content):
            there[run.name] = file
        elif first := in_the_way(run, out, content):
            raise LogError(
                f"{first}: exists already, not as this import of {run.source} would write it, and a recording is never "
                "overwritten; choose another name or folder. Nothing was written."
            )
    if len(there) == len(runs):
        all_of = f"all {len(runs)} of these logs" if len(runs) > 1 else f"this log, {runs[0].name},"
        raise LogError(
            f"{out}: has {all_of} already, and a recording is never overwritten; choose another folder to import again."
        )
    return there
