"""The extended model as files: chain, MJCF, and the list of what changed and why."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import mujoco
import numpy as np
import yaml

from ...actuators import Chain, load_chain
from ...envs.described.robot_numbers import inertia_about
from ...envs.extended import FILE, Change, Extended, Mounted, Owner
from ..causes.catalogue import adjustable
from ..causes.load import STOPS
from ..load.robot import Frame, LoggedRobot, robot_of, with_frames
from ..load.tree import NO_LEVER, arm_of, carries
from ..log.sidecar import relative_robot
from ..log.types import MeasuredRun, MeasuredSet
from ..measure.case import ROBOT
from ..replay.joint_model import JointModel
from ..replay.parameters import Target, about, address
from ..robot.directions import every
from ..verdict.verdict import JointDiagnosis
from .carried import FACTOR, PAYLOAD, Told, bodies_carried
from .mjcf import native_mjcf, not_native

__all__ = ["as_taken", "changes", "extended_of", "not_native", "readable", "write_extended", "write_extension"]

Taken = Literal["all", "own", "named"]
TUNED = "tuned within its tolerance"
REFITTED = "refitted, up to fivefold"
OWNERS: dict[Target, Owner] = {
    Target.STAGE: "chain",
    Target.GEAR: "chain",
    Target.LOAD: "robot",
    Target.GROUND: "robot",
    Target.HOST: "log",
    Target.TORQUE: "log",
}
"""What the targets of a diagnosis are of a machine. How its host reads it (an offset, a scale of the log) is nothing of
the machine: whoever uses the extended model is told to correct the log.
"""
HEIGHT = "contact.height"
"""Zero of the height column, likewise of the log; it is fitted with every ground, and nothing is wrong with it."""


def changes(diagnosis: JointDiagnosis) -> list[dict[str, Any]]:
    """What the extended model changes: path, value before and after, and the cause, or the tolerance, behind it."""
    if diagnosis.problem is None or diagnosis.search is None:
        return []
    nominal = diagnosis.problem.models[0]
    named = {cause.name for cause in diagnosis.causes}
    owner = {p.path: c.cause.name for c in diagnosis.search.accepted if c.cause.name in named for p in c.variant}
    owner |= diagnosis.shared
    machines = diagnosis.problem.machines
    tight = adjustable(machines[0][0]) if machines else []
    ends = {p.path: (p.low, p.high) for p in tight if p.relative}
    rows = []
    for path, value in diagnosis.values.items():
        at = address(path)
        before = nominal.value(at.number)
        after = value * before if at.factor else value
        within = path not in ends or about(value, *ends[path])
        other = TUNED if within and diagnosis.model != "refitted" else REFITTED
        rows.append({"path": at.number, "from": float(before), "to": float(after), "why": owner.get(path, other)})
    return sorted(rows, key=lambda row: row["why"] in (TUNED, REFITTED))


def extended_of(diagnoses: Sequence[JointDiagnosis], data: MeasuredSet, taken: Taken = "all") -> Extended | None:
    """The machine as diagnosed, as an environment takes it; None where no joint has an extended model.

    Args:
        diagnoses, data: of the machine.
        taken: what is taken of them: ``own`` is all but numbers of a robot's bodies that no cause is named for,
            ``named`` of that only what joints have for which a cause is named.
    """
    if all(diagnosis.problem is None for diagnosis in diagnoses):
        return None
    diagnoses, every = [item for item in diagnoses if item.joint != ROBOT], diagnoses
    several = len(diagnoses) > 1
    data = as_taken(data, diagnoses)
    robot = robot_of(data.runs[0])
    chains: dict[str, tuple[Mounted, ...]] = {}
    found, believed = [], []
    for diagnosis in diagnoses:
        prefix = f"{diagnosis.joint}-" if several else ""
        if believed_still(diagnosis, taken):
            continue
        if variants := _chains(diagnosis, data.runs, prefix):
            chains[diagnosis.joint] = variants
        for row in changes(diagnosis):
            why, number = row["why"], row["path"]
            cause = "" if why in (TUNED, REFITTED) else why
            if taken != "all" and not cause and _owner(number) == "robot":
                continue
            change = Change(diagnosis.joint, number, row["from"], row["to"], cause, _owner(number), why == REFITTED)
            found.append(change)
        believed += [dict(params) for _, params in _machines(diagnosis) if params]
    for joint in dict.fromkeys(joint for run in data.runs for joint in run.joints):
        if joint not in chains and (chain := _believed(joint, data.runs, robot)) is not None:
            chains[joint] = (Mounted(chain, ""),)
    believed = believed or [dict(run.robot_params) for run in data.runs]
    shared = believed[0] if all(params == believed[0] for params in believed) else None
    if robot is not None:  # numbers of joints become those of bodies, in the frame of the robot's model
        common = [change for item in every for change in shared_changes(robot, item)]
        ranges = [change for item in diagnoses for change in widened_range(robot, item, found)]
        told = {(one.joint, number): cause for one in diagnoses for cause in one.causes for number in cause.parameters}
        found = of_robot(robot, [*found, *ranges, *common], told)
        chains = {
            joint: tuple(Mounted(robot.frame(joint).chain_to_model(item.chain), item.file) for item in variants)
            for joint, variants in chains.items()
        }
    digest = "" if robot is None else robot.file.model.digest
    return Extended(data.runs[0].robot, shared, chains, tuple(found), digest=digest)


def as_taken(data: MeasuredSet, diagnoses: Sequence[JointDiagnosis]) -> MeasuredSet:
    """The data with the zeros and directions of a robot's angles that the diagnosis took."""
    frames = next((diagnosis.frames for diagnosis in diagnoses if diagnosis.frames), None)
    return data if frames is None else replace(data, runs=with_frames(data.runs, frames))


def _owner(number: str) -> Owner:
    return "log" if number == HEIGHT else OWNERS[address(number).target]


def believed_still(diagnosis: JointDiagnosis, taken: Taken) -> bool:
    """Whether a joint stays as it was believed."""
    return diagnosis.problem is None or (taken == "named" and not (diagnosis.causes or diagnosis.shared))


def _believed(joint: str, runs: Sequence[MeasuredRun], robot: LoggedRobot | None) -> Chain | None:
    """The chain that runs say of a joint, with what its robot's file owns; None where they say none."""
    source = next((run.actuators[joint] for run in runs if joint in run.actuators), None)
    if source is None:
        return None
    chain = load_chain(source)
    return chain if robot is None or robot.number(joint) < 0 else robot.joint(joint).carried(chain)


def _chains(diagnosis: JointDiagnosis, runs: Sequence[MeasuredRun], prefix: str) -> tuple[Mounted, ...]:
    """Extended chains of a joint by nominal chain."""
    joints = _variants(diagnosis)
    warm = _temperature(diagnosis, runs)
    return tuple(
        Mounted(readable(_warm(joint.chain, warm)), f"{prefix}extended{_suffix(k)}.yaml")
        for k, (joint, _) in enumerate(joints, 1)
    )


def _machines(diagnosis: JointDiagnosis) -> tuple[tuple[JointModel, Mapping[str, float]], ...]:
    return () if diagnosis.problem is None else diagnosis.problem.machines


def _variants(diagnosis: JointDiagnosis) -> list[tuple[JointModel, dict[str, float]]]:
    """The extended joint for each nominal chain of the runs, with numbers of the bench; none of several joints."""
    found: dict[str, tuple[JointModel, dict[str, float]]] = {}
    for nominal, params in _machines(diagnosis):
        found.setdefault(nominal.chain.to_yaml(), (nominal.with_fitted(diagnosis.values), dict(params)))
    return list(found.values())


def _suffix(number: int) -> str:
    return f"-{number}" if number > 1 else ""


def _temperature(diagnosis: JointDiagnosis, runs: Sequence[MeasuredRun]) -> float | None:
    """Median temperature of the motor in the log [degC]; None where it was not logged."""
    logged = [run.joints[diagnosis.joint].temperature for run in runs if diagnosis.joint in run.joints]
    values = np.concatenate([values for values in logged if values is not None] or [np.zeros(0)])
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) else None


def _warm(chain: Chain, temperature: float | None) -> Chain:
    """The chain with its motor as warm as it was in the log, where warmth weakens it."""
    thermal = chain.find("thermal")
    if thermal is None or temperature is None:
        return chain
    warm = replace(thermal, temperature=round(temperature, 1))
    return replace(chain, stages=tuple(warm if stage is thermal else stage for stage in chain.stages))


def write_extended(extended: Extended, folder: Path, final: Path | None = None) -> Path:
    """Write the machine as diagnosed, for ``extended=<folder>``.

    Args:
        extended: the machine.
        folder: to write into.
        final: where the file comes to lie, if elsewhere: it names the robot's file as that lies beside it.
    """
    lines = [
        "# The machine as diagnosed; give this folder as extended=<folder> to train, deploy, evaluate or",
        "# sealegs.make_env. Changes with owner 'log' are of how the log reads the machine: no model has them.",
        "# Where one was named as a cause, the folder is refused until the log is corrected.",
    ]
    said = replace(extended, robot=relative_robot(extended.robot, folder if final is None else final))
    text = yaml.safe_dump(_plain(said.to_dict()), sort_keys=False, width=120)
    path = folder / FILE
    path.write_text("\n".join(lines) + "\n" + text, encoding="utf-8")
    return path


def _plain(value: Any) -> Any:
    """Numbers to six digits, so that the file can be read."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return float(f"{value:.6g}") if isinstance(value, float) else value


def write_extension(
    diagnosis: JointDiagnosis, runs: Sequence[MeasuredRun], folder: Path, prefix: str = ""
) -> dict[str, Path]:
    """Write ``extended.yaml`` (the chain) and ``extended.xml`` (the bench with what of it plain MuJoCo simulates, or
    the whole leg on the ground that was found).

    Runs that differ in their nominal chain get a chain file each.

    Args:
        diagnosis: of the joint or the ground.
        runs: that were diagnosed.
        folder, prefix: where the files go, and what their names start with.

    Returns:
        Paths by ``chain`` and ``mjcf`` (of the first chain), and ``chain.<n>`` for further ones; of a leg by ``leg``.
    """
    written: dict[str, Path] = {}
    named = ", ".join(cause.name for cause in diagnosis.causes) or "nothing named"
    lines = [f"# Extended chain of joint '{diagnosis.joint}': {named}. Against the nominal model:"]
    lines += [f"#   {row['path']}: {row['from']:.5g} -> {row['to']:.5g} ({row['why']})" for row in changes(diagnosis)]
    lines.append(
        f"# What is not of the chain (load, stops) stands in {FILE}; extended=<this folder> applies all of it."
    )
    robot = robot_of(runs[0])
    if robot is not None and robot.frame(diagnosis.joint) != Frame():  # an offset has the other sign there
        lines.append(f"# The angle is counted as in the log; {FILE} counts it as the robot's model does.")
    for k, item in enumerate(_chains(diagnosis, runs, prefix), 1):
        path = folder / item.file
        path.write_text("\n".join(lines) + "\n" + item.chain.to_yaml(), encoding="utf-8")
        written[f"chain{_suffix(k).replace('-', '.')}"] = path
    mjcf = folder / f"{prefix}extended.xml"
    if diagnosis.problem is not None and (whole := diagnosis.problem.mjcf(diagnosis.values)) is not None:
        mjcf.write_text(whole, encoding="utf-8")
        written["leg"] = mjcf
    variants = _variants(diagnosis)
    if variants and variants[0][1]:  # without a load, there is no bench to write
        joint, params = variants[0]
        missing = ", ".join(not_native(joint.chain)) or "nothing"
        note = f"<!-- For plain MuJoCo; the control is the position goal [rad]. Left out: {missing}. -->"
        mjcf.write_text(f"{note}\n{native_mjcf(joint, params)}", encoding="utf-8")
        written["mjcf"] = mjcf
    return written


def readable(chain: Chain) -> Chain:
    """Numbers to six digits, so that the file can be read."""
    rounded = [
        replace(stage, **{key: float(f"{value:.6g}") for key, value in stage.parameters().items()})
        for stage in chain.stages
    ]
    return replace(chain, stages=tuple(rounded))


# --- what a diagnosis found, as numbers of the robot itself ----------------------------------------------------------
#
# A joint of a tree is judged with its angle as the log has it and with what hangs behind it as one load. The robot's
# model has bodies and an angle of its own, so both are turned into those here.

RANGE_MARGIN = 0.02  # of a joint's motion by which a range must be wider than what the log shows
CARRIED = (FACTOR, PAYLOAD, "load.centre_shift")
"""Numbers of a joint that say what its bodies weigh."""


def of_robot(robot: LoggedRobot, changes: Sequence[Change], told: Told = MappingProxyType({})) -> list[Change]:
    """Changes of a robot, those of loads by body and in the frame of its model.

    Where what joints carry is named, what others only tuned of it is no evidence against it.

    Args:
        robot: that was logged.
        changes: of its joints, and of what they share.
        told: causes that are named, by joint and path.
    """
    named = {_body(robot, one) for one in changes if one.owner == "robot" and one.cause} - {0}
    kept: list[Change] = []
    carried: list[Change] = []
    inertias: dict[str, Change] = {}
    for change in changes:
        name = change.joint
        if change.owner != "robot" or robot.number(name) < 0:
            kept.append(change)
        elif change.path in STOPS:
            kept.append(_stop(robot.frame(name), change))
        elif change.path in (FACTOR, PAYLOAD):
            if change.cause or change.refitted or not _related(robot.model, robot.number(name), named):
                carried.append(change)
        elif change.path == "load.extra_inertia" and not robot.slides(name):
            inertias[name] = change
        elif change.path == "load.centre_shift":
            kept += _shift(robot, change)
        else:
            kept.append(change)
    return [*kept, *_inertias(robot, inertias), *bodies_carried(robot, carried, told)]


def _body(robot: LoggedRobot, change: Change) -> int:
    """The body whose weight a change is about, or that of the joint that carries it; 0 for none."""
    if change.path in CARRIED and robot.number(change.joint) >= 0:
        return int(robot.model.jnt_bodyid[robot.number(change.joint)])
    return robot.model.body(change.joint).id if change.path.startswith("body.") else 0


def _related(model: mujoco.MjModel, number: int, bodies: Collection[int]) -> bool:
    """Whether a joint carries one of some bodies, or is carried by one."""
    own = int(model.jnt_bodyid[number])
    above = [int(model.body_jntadr[body]) for body in bodies if model.body_jntnum[body]]
    return any(carries(model, number, body) for body in bodies) or any(carries(model, joint, own) for joint in above)


def _inertias(robot: LoggedRobot, found: Mapping[str, Change]) -> list[Change]:
    """Inertias of links, each counted once: joints above feel it too, and may have found it as their own."""
    model, left = robot.model, dict(found)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for name in sorted(found, key=robot.number, reverse=True):  # from the end of the robot
        number, own = robot.number(name), found[name].after
        felt = 0.0
        for other, change in left.items():
            if (below := robot.number(other)) != number and carries(model, number, int(model.jnt_bodyid[below])):
                felt += inertia_about(change.after, data.xaxis[below], data.xaxis[number])
        rest = max(own - felt, 0.0) if own > 0.0 else min(own - felt, 0.0)
        left[name] = dataclasses.replace(found[name], after=rest if felt * own > 0.0 else own)
    return [change for change in left.values() if change.after]


def widened_range(robot: LoggedRobot, diagnosis: JointDiagnosis, found: Sequence[Change]) -> list[Change]:
    """Ends of a joint's range that its log goes beyond, which stop nothing then: as far out as the log went at least.

    Args:
        robot: that was logged.
        diagnosis: of the joint.
        found: changes of the robot, of whose stops one may lie on that side.
    """
    joint = None if diagnosis.problem is None else diagnosis.problem.joint
    ends = robot.ends(diagnosis.joint)
    if joint is None or joint.terms is None or ends is None:
        return []
    axis, told = joint.models[0].axis, {c.path for c in found if c.joint == diagnosis.joint}
    rows = []
    for path, side, end, reached in zip(("load.lower_stop", "load.stop_angle"), (-1, 1), ends, (axis.low, axis.high),
                                        strict=True):  # fmt: skip
        if path not in told and np.isinf(joint.models[0].value(path)) and side * (reached - end) > 0.0:
            rows.append(
                Change(diagnosis.joint, path, end, reached + side * RANGE_MARGIN * (axis.high - axis.low), "", "robot")
            )
    return rows


def shared_changes(robot: LoggedRobot, found: JointDiagnosis) -> list[Change]:
    """Changes of what all joints share."""
    if found.joint != ROBOT:
        return []
    owner = {number: cause.name for cause in found.causes for number in cause.parameters}
    known = every(robot)
    return [
        Change(part, known[number].effect, known[number].neutral, value, owner.get(number, ""), "robot")
        for number, value in found.values.items()
        if number in known
        for part in known[number].parts
    ]


def _stop(frame: Frame, change: Change) -> Change:
    """A stop in the frame of the model, where a lower one may be an upper one."""
    before, after = (frame.sign * (value - frame.zero) for value in (change.before, change.after))
    path = change.path
    if frame.sign < 0.0:
        path = next(other for other in STOPS if other != path)
    return dataclasses.replace(change, path=path, before=before, after=after)


def _shift(robot: LoggedRobot, change: Change) -> list[Change]:
    """The centre of mass of a joint's own body, further from the joint."""
    model, number = robot.model, robot.number(change.joint)
    body = int(model.jnt_bodyid[number])
    arm = arm_of(model, number)
    size = float(np.linalg.norm(arm))
    if size <= NO_LEVER:
        return [change]  # which is refused where it is applied
    name = model.body(body).name
    return [
        Change(name, f"body.centre_{letter}", 0.0, change.after * float(part), change.cause, "robot")
        for letter, part in zip("xyz", arm / size, strict=True)
        if abs(part) > 1e-9
    ]
