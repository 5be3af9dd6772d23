"""Sidecars of imported logs: what the file says of the machine, and blanks with what belongs into them."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ....actuators.chain import LIBRARY, load_chain
from ....actuators.published import DRIVES, PREFIX, as_recorded, drive_of
from ....common.documents import parse_yaml
from ....common.errors import nearest
from ....envs.bench.robot import NUMBERS
from ....envs.described.robot_file import is_robot_file
from ....envs.robots import robot_meant
from ..sidecar import FOLDER_DEFAULTS, MAPPINGS, Sidecar, beside, folder_defaults, robot_beside, sidecar_text
from ..table import ENDINGS
from ..types import BESIDE_GOAL, FACTOR, LogError, MeasuredRun
from ..writer import FROM
from .expression import names_in
from .mapping import Mapping as LogMapping
from .names import Claim
from .positions import PERCENT
from .proposal import Proposal
from .readers import read_source
from .recording import Recording
from .robot import asked_robot, has_model

BENCH = "bench"
ROD_MASS = NUMBERS["arm_mass"].value  # [kg] of a rod that nobody weighed
UNMEASURED = (
    f"Neither the mass of the pendulum's rod was recorded ({ROD_MASS:g} kg are assumed) nor where the encoder's zero "
    "is."
)
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
GAIN_UNITS = {"stiffness": "N.m/rad", "damping": "N.m.s/rad"}
PLAIN_UNITS = ("rad", "m", "rad/s", "m/s", "N.m", "N")
"""Units of columns in which gains are in N.m/rad and N.m.s/rad."""


def proposed_sidecar(
    recordings: Sequence[Recording],
    proposal: Proposal,
    robot: str,
    actuator: Chain | None,
    params: Mapping[str, float] | None = None,
    limits: Mapping[str, float] | None = None,
    claims: Mapping[str, Claim] | None = None,
) -> dict[str, Any]:
    """The sidecar that files and answers give; what nobody says is left out.

    ``limits`` are the largest torques of joints that a robot's file knows [N.m].
    """
    first = recordings[0]
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
    elif driven and (chains := impedance_chains(recordings, proposal, claims or {}, limits)):
        sidecar["actuators"] = chains
    if "kp" in facts and pendulum:
        sidecar["group"] = "kp${kp}"
    machine = facts.get("motor") or facts.get("robot_type")
    if machine and isinstance(machine, str):
        sidecar["machine"] = machine
    if units := {f"{joint}.{signal}": "m" for joint in sorted(proposal.slides) for signal in ("position", "goal")
                 if f"{joint}.{signal}" in proposal.columns}:  # fmt: skip
        sidecar["units"] = units
    if percent := {name: PERCENT for name, read in proposal.columns.items() if read.unit == PERCENT}:
        sidecar["units"] = {**sidecar.get("units", {}), **percent}
    if pendulum and sidecar.get("robot") == BENCH and "arm_mass" not in {**facts, **(params or {})}:
        sidecar |= {"notes": UNMEASURED, "meta": {"unknown": ["zero", "friction", "armature"]}}
    return sidecar


def folder_and_own(runs: Sequence[MeasuredRun]) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """What all sidecars say, for ``log.yaml``, and what each says beyond it."""
    contents = [_content(run) for run in runs]
    shared = {key: value for key, value in contents[0].items() if all(other.get(key) == value for other in contents)}
    own = [{key: value for key, value in content.items() if key not in shared} for content in contents]
    for content, run in zip(own, runs, strict=True):
        content["meta"] = {**content.get("meta", {}), FROM: str(run.source)}
    return shared, own


def _content(run: MeasuredRun) -> dict[str, Any]:
    return parse_yaml(sidecar_text(Sidecar(run.robot, run.robot_params, run.actuators, run.meta)))


def said_before(folder: Path) -> dict[str, Any] | None:
    """What a folder's ``log.yaml`` says: nothing where it has other logs alone, None where it has neither.

    A ``log.yaml`` that is written beside other logs would hold for these too.

    Raises:
        LogError: the file cannot be read, or is no mapping.
    """
    said = folder_defaults(folder)
    tables = folder.iterdir() if said is None and folder.is_dir() else ()
    return {} if any(path.suffix in ENDINGS and os.path.isfile(path.with_suffix(".yaml")) for path in tables) else said


def beyond(run: MeasuredRun, said: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """What a run's own sidecar must say beyond the ``log.yaml`` that its folder has already.

    It adds to what the folder says of its machine, or says it otherwise; it takes nothing away. What the import leaves
    open holds as the folder says it, except for the group: such a run is one of its own.

    Raises:
        LogError: the folder says something that is not so of the run.
    """
    content, there = _content(run), str(said.get("robot") or "")
    if there and run.robot and robot_beside(there, folder) == robot_beside(run.robot, folder):
        content["robot"] = there  # in other words, maybe
    extra = {key: _mapping(said.get(key)).keys() - _mapping(content.get(key)).keys() for key in MAPPINGS}
    extra["robot_params"] = extra["robot_params"] if run.robot_params else set()
    extra["actuators"] -= run.joints.keys()
    extra["units"] = {name for name in extra["units"] if any(f".{one}".endswith(f".{name}") for one in run.columns())
                      and FACTOR.get(str(said["units"][name])) != 1.0}  # fmt: skip
    wrong = [f"{key}.{name}" for key in ("robot_params", "actuators", "units") for name in sorted(extra[key])]
    if there and content["robot"] not in ("", there):
        wrong.insert(0, f"robot {there}")
    if wrong:
        raise LogError(
            f"{folder / FOLDER_DEFAULTS} says {wrong[0]} of every log of its folder, and the import of {run.source} "
            "does not; say it in the mapping too, or import it into a folder of its own."
        )
    own: dict[str, Any] = {}
    for key, value in content.items():
        held = said.get(key)
        if isinstance(value, dict) and isinstance(held, dict):  # such are merged by their keys
            value = {name: entry for name, entry in value.items() if name not in held or held[name] != entry}
        if value not in ("", {}, None) and value != held:
            own[key] = value
    if said.get("group") is not None and run.meta.get("group") is None:
        own["group"] = None
    own["meta"] = {**own.get("meta", {}), FROM: str(run.source)}
    return own


def completed(run: MeasuredRun, said: Mapping[str, Any]) -> MeasuredRun:
    """A run with what its folder says where the import leaves it open."""
    return replace(
        run,
        robot=run.robot or str(said.get("robot") or ""),
        robot_params=run.robot_params or _mapping(said.get("robot_params")),
        actuators={**_mapping(said.get("actuators")), **run.actuators},
    )


def _mapping(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def blanks(runs: Sequence[MeasuredRun]) -> dict[str, str]:
    """What must be filled in before the logs can be diagnosed, with the lines of ``log.yaml`` that stand for it."""
    run, out = runs[0], {}
    if not all(one.robot for one in runs):
        out["robot"] = BLANK_ROBOT
    if len(run.joints) == 1 and all(one.robot in ("", BENCH) and not one.robot_params for one in runs):
        of = "" if run.robot else " of a bench"
        out["robot_params" + " (of a bench)" * (not run.robot)] = BLANK_LOAD.format(of=of, arm=ROD_MASS)
    driven = [joint for joint, log in run.joints.items() if log.goal is not None and joint not in run.actuators]
    if driven and not is_robot_file(run.robot):  # a robot's file has the chains of its joints
        out["actuators"] = BLANK_ACTUATORS + "".join(f"  # {joint}: sts3215\n" for joint in driven)
    return out


def text_with_blanks(content: Mapping[str, Any], blank: Mapping[str, str]) -> str:
    """A folder's sidecar with a line for each thing that must be filled in, and what belongs there."""
    known = {key: value for key, value in content.items() if value not in ("", {}, None)}
    said = yaml.safe_dump(known, sort_keys=False, allow_unicode=True) if known else ""
    return HEAD + "".join(lines for name, lines in blank.items() if name not in known) + said


def check_machine(whole: Sequence[MeasuredRun], runs: Sequence[MeasuredRun]) -> None:
    """Refuse a robot, numbers of it or chains that no diagnosis could take, before anything is written.

    A word of one's own for a robot is taken, if it is not that of a known one with a slip in it.

    Args:
        whole: runs with what their folder says.
        runs: the same with what the mapping says alone.

    Raises:
        SealegsError: one of them is none; the message names what may be meant.
    """
    for run in whole:
        own = bool(run.robot) and not has_model(run.robot)
        if meant := robot_meant(run.robot):
            raise LogError(f"{run.name}: there is no robot '{run.robot}'{meant}; correct the key robot.")
        if own and run.robot_params:
            raise LogError(
                f"{run.name}: robot_params are of a bench or of a robot's file, and the robot is {run.robot}; correct "
                "the key robot, or remove robot_params."
            )
        if wrong := [key for key in run.robot_params if run.robot == BENCH and key not in NUMBERS]:
            meant = nearest(wrong[0], NUMBERS) or f", which has {', '.join(NUMBERS)}"
            raise LogError(f"{run.name}: robot_params.{wrong[0]} is no number of a bench{meant}; correct it.")
    sound: set[str] = set()
    for run in runs:
        for joint, chain in run.actuators.items():
            if joint not in run.joints:
                raise LogError(
                    f"{run.name}: the mapping gives an actuator for '{joint}', which is no joint of its columns"
                    f"{nearest(joint, run.joints)}; its joints are {', '.join(run.joints)}."
                )
            if str(chain) not in sound and not (isinstance(chain, str) and _is_path(chain)):  # which lies beside them
                load_chain(chain)
            sound.add(str(chain))


def _is_path(chain: str) -> bool:
    return chain.startswith(PREFIX) or Path(chain).suffix in (".yaml", ".yml")


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
    if drive is None and chain.find("ideal") is not None:
        own = with_gains(chain.to_list(), recording())
        return own if own != chain.to_list() else beside(actuator, out)
    return beside(actuator, out)


# --- chains of drives whose settings a recording says: the servo of BAM, and gains of an impedance drive (MIT mode) ---


def of_one_servo(recording: Recording, joints: Sequence[str]) -> bool:
    """Whether it is of one servo with a pendulum on its shaft, whose gain the file may say."""
    return recording.kind in ("bam", "table") and {"mass", "length"} <= recording.facts.keys() and len(joints) == 1


def shipped_chain(facts: Mapping[str, float | str]) -> Chain | None:
    """The shipped chain of a recording's motor, set as it says; None where there is none or it says no gain."""
    motor = facts.get("motor")
    if not isinstance(motor, str) or motor not in DRIVES or not (LIBRARY / f"{motor}.yaml").is_file():
        return None
    return as_recorded(DRIVES[motor], load_chain(motor).to_list(), facts) if "kp" in facts else None


def with_gains(chain: list[dict[str, Any]], recording: Recording) -> list[dict[str, Any]]:
    """A chain whose drive is a stiffness and a damping, with those that a recording says: ``kp``, and ``kd`` or
    ``damping``.

    Alone, of BAM, or of a motor whose own drive is known, ``kp`` is a register or in amperes, and no stiffness.
    """
    facts = recording.facts
    damping = next((key for key in ("kd", "damping") if key in facts), "")
    if not (damping and "kp" in facts) or recording.kind == "bam" or facts.get("motor") in DRIVES:
        return chain
    own = {"stiffness": "${kp}", "damping": f"${{{damping}}}"}
    return [{name: {**(values or {}), **own} if name == "ideal" else values for name, values in stage.items()}
            for stage in chain]  # fmt: skip


@dataclass(frozen=True)
class _Gain:
    """A gain: its column, its usual value and the share of rows that have it."""

    column: str
    value: float
    share: float


def impedance_chains(
    recordings: Sequence[Recording],
    out: Proposal,
    claims: Mapping[str, Claim],
    limits: Mapping[str, float] | None = None,
) -> dict[str, list[dict[str, Any]]]:
    """Chains of joints whose stiffness and damping the recordings have in columns.

    A joint whose gains change has none: then only the whole torque says what its drive was told. Nor has one whose
    columns are in degrees or turns: nobody says whether its gains are, too.

    Args:
        recordings: of one kind.
        out: what is proposed.
        claims: on columns.
        limits: largest torque of a joint [N.m], as a robot's file has it.
    """
    chains = {}
    for joint in out.joints:
        goal = out.columns.get(f"{joint}.goal")
        beside = [out.columns[name] for signal in BESIDE_GOAL if (name := f"{joint}.{signal}") in out.columns]
        if goal is None or not all(line.unit in PLAIN_UNITS for line in (goal, *beside)):
            continue
        owners = {claims[name].joint for name in names_in(goal.text) if name in claims} | {joint}
        stiffness, damping = (_gain(recordings, claims, owners, what) for what in ("stiffness", "damping"))
        if stiffness is None or damping is None:
            continue
        for gain, what in ((stiffness, "stiffness"), (damping, "damping")):
            register = "" if beside else "; where it is a register of a servo, replace the chain under sidecar"
            out.unused[gain.column] = f"the {what} of {joint}'s chain [{GAIN_UNITS[what]}]{register}"
        changing = [gain for gain in (stiffness, damping) if gain.share < 1.0]
        for gain in changing:
            out.unused[gain.column] = (
                f"it is {gain.value:g} in {gain.share:.0%} of the rows, so no chain holds for {joint}: leave the "
                "others out under where and write the chain under sidecar, or compute the torque that its drive was "
                f"told and give it as {joint}.torque_command, without the goal"
            )
        if changing or stiffness.value <= 0.0:
            continue
        limit = {"torque_limit": limits[joint]} if limits and joint in limits else {}
        drive = {"stiffness": stiffness.value, "damping": damping.value, **limit}
        chains[joint] = [{"ideal": drive | ({"feedforward": 1} if beside else {})}]
    return chains


def _gain(recordings: Sequence[Recording], claims: Mapping[str, Claim], owners: set[str], what: str) -> _Gain | None:
    """A gain of one of these joints; None where no column, or more than one, is it."""
    names = [name for name, claim in claims.items() if claim.joint in owners and claim.aside.startswith(what)]
    if len(names) != 1:
        return None
    values = np.concatenate([run.columns[names[0]] for run in recordings])
    each, counts = np.unique(values[np.isfinite(values)], return_counts=True)
    return _Gain(names[0], float(each[np.argmax(counts)]), float(counts.max() / len(values))) if len(each) else None
