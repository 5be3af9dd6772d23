"""Recordings of other formats as measured logs: read, mapped, written. ``sealegs import --help``."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import yaml

from ....actuators.chain import LIBRARY, load_chain
from ....actuators.published import DRIVES, as_recorded, drive_of
from ....common.atomic import write_text
from ....common.documents import parse_yaml
from ....common.errors import nearest
from ....envs.bench.robot import NUMBERS
from ....envs.described.robot_file import RobotFile, is_robot_file, load_robot_file
from ....envs.robots import get_robot
from ..reader import FROM, write_run
from ..sidecar import FOLDER_DEFAULTS, Sidecar, beside, sidecar_text
from ..table import ENDINGS
from ..types import LogError, MeasuredRun
from .dialects import dialects
from .lines import PERCENT
from .mapping import Mapping as LogMapping
from .mapping import converted, ended, lacking, read_mapping
from .proposal import Proposal, proposal_text, propose
from .readers import check_runs, paired, read_recordings, read_source
from .recording import FEWEST_RECORDED, Recording

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
    mapping: LogMapping
    certain: LogMapping
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
    params: Mapping[str, float] | None = None,
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


def _certain(proposal: Proposal, sidecar: dict[str, Any]) -> LogMapping:
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
    source: Path,
    out: Path,
    mapping: LogMapping,
    format: str | None = None,
    recordings: Sequence[Recording] | None = None,
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


# --- sidecars of imported logs: what the file says of the machine, and blanks with what belongs into them ------------

BENCH = "bench"
ROD_MASS = NUMBERS["arm_mass"].value  # [kg] of a rod that nobody weighed
HEAD = "# What holds for every log of this folder (docs: Measured log). FILL IN marks what the files do not say.\n"
BLANK_ROBOT = """\
robot:  # FILL IN: bench (a mass on the shaft), or the file of your robot's model: my_arm.yaml, .xml, .urdf
"""
BLANK_LOAD = """\
robot_params:  # FILL IN the load{of}: mass [kg], its distance from the shaft [m], mass of the rod [kg]
  # mass: 0.5   # 0 is an empty shaft, and needs no length
  # length: 0.12
  # arm_mass: {arm:g}
"""
BLANK_ACTUATORS = """\
actuators:  # FILL IN: what drives each joint: a name such as sts3215, bam:fit.json, or a list of stages
"""
Chain = str | list[dict[str, Any]]


def proposed_sidecar(
    first: Recording, proposal: Proposal, robot: str, actuator: Chain | None, params: Mapping[str, float] | None = None
) -> dict[str, Any]:
    """The sidecar that files and answers give; what nobody says is left out."""
    facts, joints = first.facts, proposal.joints
    sidecar: dict[str, Any] = {}
    pendulum = {"mass", "length"} <= facts.keys() and len(joints) == 1
    if robot or pendulum:
        sidecar["robot"] = robot or BENCH
    if pendulum and sidecar["robot"] == BENCH:
        sidecar["robot_params"] = {key: f"${{{key}}}" for key in ("mass", "length", "arm_mass") if key in facts}
    if params:
        sidecar["robot_params"] = {**sidecar.get("robot_params", {}), **params}
    driven = [joint for joint in joints if f"{joint}.goal" in proposal.columns]
    if actuator:
        sidecar["actuators"] = dict.fromkeys(joints, actuator)
    elif of_one_servo(first, joints) and driven and (chain := shipped_chain(facts)):
        sidecar["actuators"] = {driven[0]: chain}
    if "kp" in facts and pendulum:
        sidecar["group"] = "kp${kp}"
    if units := {f"{joint}.{signal}": "m" for joint in sorted(proposal.slides) for signal in ("position", "goal")
                 if f"{joint}.{signal}" in proposal.columns}:  # fmt: skip
        sidecar["units"] = units
    if percent := {name: PERCENT for name, read in proposal.columns.items() if read.unit == PERCENT}:
        sidecar["units"] = {**sidecar.get("units", {}), **percent}
    if pendulum and sidecar.get("robot") == BENCH and "arm_mass" not in {**facts, **(params or {})}:
        sidecar["meta"] = {"unknown": ["zero", "friction", "armature"]}
    return sidecar


def folder_sidecar(runs: Sequence[MeasuredRun]) -> tuple[str, list[str], list[dict[str, Any]]]:
    """The text of ``log.yaml``, with what all sidecars say and a line for each thing that must be filled in before the
    logs can be diagnosed; names of these; and what each sidecar says beyond it."""
    contents = [parse_yaml(sidecar_text(Sidecar(run.robot, run.robot_params, run.actuators, run.meta))) for run in runs]
    shared = {key: value for key, value in contents[0].items() if all(other.get(key) == value for other in contents)}
    own = [{key: value for key, value in content.items() if key not in shared} for content in contents]
    for content, run in zip(own, runs, strict=True):
        content["meta"] = {**content.get("meta", {}), FROM: str(run.source)}
    run, blank = runs[0], dict[str, str]()
    if not all(one.robot for one in runs):
        blank["robot"] = BLANK_ROBOT
    if len(run.joints) == 1 and all(one.robot in ("", BENCH) and not one.robot_params for one in runs):
        of = "" if run.robot else " of a bench"
        blank["robot_params" + " (of a bench)" * (not run.robot)] = BLANK_LOAD.format(of=of, arm=ROD_MASS)
    driven = [joint for joint, log in run.joints.items() if log.goal is not None and joint not in run.actuators]
    if driven and not is_robot_file(run.robot):  # a robot's file has the chains of its joints
        blank["actuators"] = BLANK_ACTUATORS + "".join(f"  # {joint}: sts3215\n" for joint in driven)
    known = {key: value for key, value in shared.items() if value not in ("", {}, None)}
    said = yaml.safe_dump(known, sort_keys=False, allow_unicode=True) if known else ""
    text = "".join(lines for name, lines in blank.items() if name not in known) + said
    return HEAD * bool(text) + text, [*blank], own


def answered(
    mapping: LogMapping,
    out: Path,
    robot: str | None,
    actuator: str | None,
    params: Mapping[str, float] | None,
    source: Path,
) -> LogMapping:
    """A mapping whose sidecar has the answers of the call as well, which come before its own.

    ``source`` is read for a chain whose drive is known: the file may say how it was set.

    Raises:
        SealegsError: there is no such robot or chain.
    """
    sidecar: dict[str, Any] = dict(mapping.sidecar)
    if robot := beside(asked_robot(robot, out).word, out):
        sidecar["robot"] = robot
    if params:
        sidecar["robot_params"] = {**(sidecar.get("robot_params") or {}), **params}
    joints = [name.rpartition(".")[0] for name in mapping.columns if name.endswith((".goal", ".torque_command"))]
    if chain := asked_chain(actuator, out, joints, lambda: read_source(source)[0][0]):
        sidecar["actuators"] = dict.fromkeys(joints, chain)
    return replace(mapping, sidecar=sidecar)


def asked_chain(
    actuator: str | None, out: Path, joints: Sequence[str], recording: Callable[[], Recording]
) -> Chain | None:
    """The chain that a call asks for, set as the recording says, or as it lies beside the logs.

    Args:
        actuator: word for it.
        out: folder of the logs.
        joints: that it drives.
        recording: reads one of those that it is for, which is done only for a chain that it may set.

    Raises:
        SealegsError: there is no such chain.
    """
    if actuator is None:
        return None
    chain, drive = load_chain(actuator), drive_of(actuator)
    if drive is not None and of_one_servo(first := recording(), joints) and "kp" in first.facts:
        return as_recorded(drive, chain.to_list(), first.facts)
    return beside(actuator, out)


# --- chains of drives whose settings a recording says ----------------------------------------------------------------


def of_one_servo(recording: Recording, joints: Sequence[str]) -> bool:
    """Whether it is of one servo with a pendulum on its shaft, whose gain the file may say."""
    return recording.kind in ("bam", "table") and {"mass", "length"} <= recording.facts.keys() and len(joints) == 1


def shipped_chain(facts: Mapping[str, float | str]) -> Chain | None:
    """The shipped chain of a recording's motor, set as it says; None where there is none or it says no gain."""
    motor = facts.get("motor")
    if not isinstance(motor, str) or motor not in DRIVES or not (LIBRARY / f"{motor}.yaml").is_file():
        return None
    return as_recorded(DRIVES[motor], load_chain(motor).to_list(), facts) if "kp" in facts else None


# --- the robot of an import ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Robot:
    """A robot by its word.

    Attributes:
        word: name or path, empty where nobody says one.
        file: what its file says, None where the word is of no file that is there.
    """

    word: str = ""
    file: RobotFile | None = None

    @cached_property
    def joints(self) -> frozenset[str]:
        """Joints of its file, its model's too."""
        return frozenset({*self.file.model.joints, *(one.name for one in self.file.joints)} if self.file else ())

    @cached_property
    def slides(self) -> frozenset[str]:
        kinds = [*self.file.model.joints.values(), *self.file.joints] if self.file else []
        return frozenset(joint.name for joint in kinds if joint.kind == "slide")

    def check(self, run: str, joints: Iterable[str]) -> None:
        """Refuse a file that is not there, or joints that it does not have.

        Raises:
            LogError: the message names the nearest that it has.
        """
        if is_robot_file(self.word) and self.file is None:
            raise LogError(f"{run}: there is no robot's file {self.word}; correct the key robot.")
        for joint in joints if self.file else ():
            if joint not in self.joints:
                raise LogError(
                    f"{run}: {Path(self.word).name} has no joint '{joint}'{nearest(joint, self.joints)}; it has "
                    f"{', '.join(sorted(self.joints))}. Rename it under columns in the mapping, or leave it out."
                )


def robot_of(word: str | None, out: Path) -> Robot:
    """The robot of a word, with its file from here or from the folder of the logs, which need not exist yet."""
    if not word or not is_robot_file(word):
        return Robot(word or "")
    paths = (Path(word), Path(os.path.normpath(out / word)))
    path = next((path for path in paths if os.path.isfile(path)), None)
    return Robot(word, load_robot_file(path) if path else None)


def asked_robot(word: str | None, out: Path) -> Robot:
    """The robot that a call asks for.

    Raises:
        SealegsError: there is no robot of that name, or no such file.
    """
    if word is None or not is_robot_file(word):
        return Robot(get_robot(word).name if word else "")
    robot = robot_of(word, out)
    if robot.file is None:
        raise LogError(f"robot={word}: there is no such file; give the path of your robot's .yaml, .xml or .urdf.")
    return robot
