"""Sidecars of imported logs: what the file says of the machine, and blanks with what belongs into them."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from ....actuators.chain import LIBRARY, load_chain
from ....actuators.published import DRIVES
from ....envs.bench.robot import NUMBERS
from ....envs.robot_file import is_robot_file
from ....envs.robots import get_robot
from ..sidecar import Sidecar, sidecar_text
from ..types import LogError, MeasuredRun
from .mapping import Mapping as LogMapping
from .proposed import Proposal
from .recording import Recording

BENCH = "bench"
ARM = NUMBERS["arm_mass"].value  # [kg] of a rod that nobody weighed
UNMEASURED = {
    "unknown": ["zero", "friction", "armature"],
    "notes": f"Neither the mass of the pendulum's rod was recorded ({ARM:g} kg are assumed) nor where the encoder's "
    "zero is.",
}
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


def proposed_sidecar(
    recordings: Sequence[Recording],
    proposal: Proposal,
    robot: str | None,
    actuator: str | None,
    params: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """The sidecar that files and answers give; what nobody says is left out."""
    first = recordings[0]
    facts, joints = first.facts, proposal.joints
    for recording in recordings:
        _check_facts(recording)
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
    elif first.kind in ("bam", "table") and pendulum and driven and (chain := _bam_chain(facts)):
        sidecar["actuators"] = {driven[0]: chain}
    if "kp" in facts and pendulum:
        sidecar["group"] = "kp${kp}"
    machine = facts.get("motor") or facts.get("robot_type")
    if machine and isinstance(machine, str):
        sidecar["machine"] = machine
    if units := {f"{joint}.{signal}": "m" for joint in sorted(proposal.slides) for signal in ("position", "goal")
                 if f"{joint}.{signal}" in proposal.columns}:  # fmt: skip
        sidecar["units"] = units
    if pendulum and sidecar.get("robot") == BENCH and "arm_mass" not in {**facts, **(params or {})}:
        sidecar["notes"] = UNMEASURED["notes"]
        sidecar["meta"] = {"unknown": UNMEASURED["unknown"]}
    return sidecar


def _check_facts(recording: Recording) -> None:
    """What a bench takes from a file are numbers.

    Raises:
        LogError: one of them is a word.
    """
    for key, unit in (("mass", "kg"), ("length", "m"), ("arm_mass", "kg"), ("kp", "1"), ("vin", "V")):
        if isinstance(value := recording.facts.get(key), str):
            raise LogError(f"{recording.source}: {key} is '{value}', no number [{unit}]; correct it in the file.")


def _bam_chain(facts: Mapping[str, float | str]) -> list[dict[str, Any]] | None:
    """The shipped chain of a motor with gain and supply of its recording; None where it is not known."""
    motor, path = facts.get("motor"), LIBRARY / f"{facts.get('motor')}.yaml"
    if not isinstance(motor, str) or motor not in DRIVES or not path.is_file() or "kp" not in facts:
        return None
    stages = yaml.safe_load(path.read_text(encoding="utf-8"))
    for stage in stages:
        if "position_p" in stage:
            stage["position_p"] = {**stage["position_p"], "gain": f"${{kp*{DRIVES[motor].duty_per_kp}}}"}
        if "duty_limit" in stage:
            stage["duty_limit"] = {"limit": DRIVES[motor].limit}
        if "supply" in stage and "vin" in facts:
            stage["supply"] = {**stage["supply"], "volts": "${vin}"}
    return stages


def folder_and_own(runs: Sequence[MeasuredRun]) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """What all sidecars say, for ``log.yaml``, and what each says beyond it."""
    contents = [yaml.safe_load(sidecar_text(Sidecar(r.robot, r.robot_params, r.actuators, r.meta))) for r in runs]
    shared = {key: value for key, value in contents[0].items() if all(other.get(key) == value for other in contents)}
    own = [{key: value for key, value in content.items() if key not in shared} for content in contents]
    for content, run in zip(own, runs, strict=True):
        content["meta"] = {**content.get("meta", {}), "imported_from": str(run.source)}
    return shared, own


def text_with_blanks(content: Mapping[str, Any], runs: Sequence[MeasuredRun]) -> str:
    """A folder's sidecar with a line for each thing that must be filled in, and what belongs there."""
    lines = ["# What holds for every log of this folder (docs: Measured log). FILL IN marks what the files do not say."]
    known = {key: value for key, value in content.items() if value not in ("", {}, None)}
    everywhere = set().union(*(own.actuators for own in runs))
    joints = list(runs[0].joints)
    if "robot" not in known and not all(run.robot for run in runs):
        lines.append(BLANK_ROBOT.rstrip())
    of = "" if known.get("robot") == BENCH else " of a bench"
    load = BLANK_LOAD.format(of=of, arm=ARM) if _without_load(runs) else ""
    missing = [joint for joint in joints if joint not in everywhere]
    text = load + (yaml.safe_dump(known, sort_keys=False, allow_unicode=True) if known else "")
    if missing and not everywhere:
        text += BLANK_ACTUATORS + "".join(f"  # {joint}: sts3215\n" for joint in missing)
    return "\n".join(lines) + "\n" + text


def blanks(runs: Sequence[MeasuredRun]) -> list[str]:
    """What must be filled in before the logs can be diagnosed."""
    run = runs[0]
    out = [] if run.robot else ["robot"]
    if _without_load(runs):
        out.append("robot_params" if run.robot else "robot_params (of a bench)")
    driven = [joint for joint, log in run.joints.items() if log.goal is not None and joint not in run.actuators]
    return out + (["actuators"] if driven else [])


def _without_load(runs: Sequence[MeasuredRun]) -> bool:
    """Whether these may be of a bench, and none says what hangs on its shaft."""
    return all(run.robot in ("", BENCH) and not run.robot_params for run in runs) and len(runs[0].joints) == 1


def beside(robot: str | None, out: Path) -> str | None:
    """A robot's file as its path from the folder of the logs; a name as it is."""
    if robot and Path(robot).is_file():
        return os.path.relpath(Path(robot).resolve(), out.resolve())
    return robot


def checked_robot(robot: str | None, out: Path) -> str | None:
    """The word for a robot.

    Raises:
        SealegsError: there is no robot of that name, or no such file.
    """
    if robot is None:
        return None
    if not is_robot_file(robot):
        return get_robot(robot).name
    if not (Path(robot).is_file() or (out / robot).is_file()):
        raise LogError(f"robot={robot}: there is no such file; give the path of your robot's .yaml, .xml or .urdf.")
    return robot


def answered(
    mapping: LogMapping, out: Path, robot: str | None, actuator: str | None, params: Mapping[str, float] | None
) -> LogMapping:
    """A mapping whose sidecar has the answers of the call as well, which come before its own.

    Raises:
        SealegsError: there is no such robot or chain.
    """
    sidecar: dict[str, Any] = dict(mapping.sidecar)
    if robot := beside(checked_robot(robot, out), out):
        sidecar["robot"] = robot
    if params:
        sidecar["robot_params"] = {**sidecar.get("robot_params", {}), **params}
    if actuator := checked_actuator(actuator):
        joints = [name.rpartition(".")[0] for name in mapping.columns if name.endswith((".goal", ".torque_command"))]
        sidecar["actuators"] = dict.fromkeys(joints, actuator)
    return replace(mapping, sidecar=sidecar)


def checked_actuator(actuator: str | None) -> str | None:
    """The word for a chain.

    Raises:
        SealegsError: there is no such chain.
    """
    if actuator is not None:
        load_chain(actuator)
    return actuator
