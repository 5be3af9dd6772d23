"""A robot as data: a YAML beside an MJCF or URDF, which says what drives each joint and whose numbers count.

    model: my_arm.xml               # relative to this file
    joints:
      shoulder: {chain: sts3215, range: [-1.5, 1.5]}
      elbow: {chain: sts3215, range: [-2.0, 2.0], unknown: [friction]}

A bare model file is a robot too: what it leaves open is assumed, and :attr:`RobotFile.said` tells what.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from ...actuators import Chain, load_chain
from ...actuators.published import PREFIX, bam_file
from ...actuators.stages.controller import UNLIMITED
from ...common.documents import DocumentError, read_yaml
from ...common.errors import WARNING, SealegsError, nearest
from ...configs.check import checked, checked_fields
from ..engine.numbers import RobotError
from .model_drives import ModelDrive
from .model_file import SUFFIXES, ModelFile, read_model
from .robot_assumed import (
    FULL_FORCE,
    chosen,
    goal_range,
    ideal_servo,
    ideal_wheel,
    none_to_drive,
    passive_sentence,
    reduction_note,
    speed_range,
)
from .robot_described import LIMIT, SAME, FileJoint, RobotFile, stated, states, with_owned
from .robot_entries import UNKNOWN, YAML_SUFFIXES, FileEntry, FloorEntry, JointEntry, Owner, ServoEntry
from .robot_step import SHORTEST, feeble, said_again, settled
from .robot_within import check_limits, check_within


def is_robot_file(name: str | Path) -> bool:
    """Whether a word for a robot is the path of a robot file rather than the name of a built-in robot."""
    return Path(name).suffix.lower() in (*YAML_SUFFIXES, *SUFFIXES)


def load_robot_file(path: str | Path) -> RobotFile:
    """Read a robot from its YAML, or from a bare MJCF or URDF.

    Raises:
        RobotError: a file is missing or damaged, or what it says does not fit; the message names file and key.
    """
    path = Path(path).absolute()
    if path.suffix.lower() in SUFFIXES:
        beside = path.with_suffix(".yaml")
        said = [f"{path.name} is taken as it is; `sealegs new-robot {path.name}` writes what is assumed into a file."]
        if os.path.isfile(beside):
            said = [f"{beside} lies beside {path.name} and is not read: give it as the robot to use it."]
        return assembled(path, FileEntry(path.name), said)
    if path.suffix.lower() not in YAML_SUFFIXES:
        known = ", ".join((*YAML_SUFFIXES, *SUFFIXES))
        raise RobotError(f"{path} is no file of a robot; give one that ends in {known}.")
    try:
        entry = checked_fields("", read_document(path), FileEntry)
        file = assembled(path, entry, [])
    except RobotError:
        raise
    except SealegsError as error:
        raise RobotError(f"{path}: {error}") from None
    if entry.joints is None:  # assembling told it
        return file
    driven = [name for joint in file.joints for name, _ in joint.terms]
    return replace(file, said=(*file.said, *passive_sentence(file.model, driven)))


# --- the document ----------------------------------------------------------------------------------------------------


def read_document(path: Path) -> Any:
    """What stands in the YAML of a robot.

    Raises:
        RobotError: it is missing, cannot be read, or has a key twice.
    """
    try:
        return read_yaml(path)
    except DocumentError as error:
        if error.missing:
            raise RobotError(f"there is no robot file {path}; sealegs new-robot <model> writes one.") from None
        raise RobotError(f"{error}.") from None


# --- A robot put together from its model file and from what its YAML says; what neither says is assumed, and told ----

TIMESTEP = 0.002  # [s] with RK4 accurate to 0.1 mrad (docs/numerics.md)
ACTION = 0.02  # [s] between two actions, into which a whole number of assumed steps goes
APART = 3.0  # ratio of the numbers of file and chain from which a warning is due; assumed


def assembled(path: Path, entry: FileEntry, said: list[str] | None = None) -> RobotFile:
    """A robot from what its YAML says.

    Args:
        path: of the YAML, which need not exist: paths are relative to it.
        entry: what it says.
        said: sentences to go on with.

    Raises:
        SealegsError: something in it does not fit.
    """
    said = [] if said is None else said
    model = read_model(path.parent / entry.model)
    said += model.said
    drives = {drive.name: drive for drive in model.drives}
    if entry.joints is None:
        names, held = chosen(model)
        if not names:
            raise RobotError(f"{model.path}: {none_to_drive(model)}")
        why = "as its actuators do" if drives else "since it has no actuators"
        said.append(f"{model.path.name} says which joints are driven, {why}: {', '.join(names)}.")
        said += [f"{reason}; it is not driven." for reason in held]
        entries = {name: _default_entry(drives.get(name)) for name in names}
        if model.undriveable:
            raise RobotError(
                f"{model.path}: {model.undriveable[0]}; write which joints to drive into a YAML "
                f"(sealegs new-robot {model.path.name})."
            )
    else:
        _check_names(path, entry.joints)
        entries = {name: checked_fields(f"joints.{name}", row or {}, JointEntry) for name, row in entry.joints.items()}
    if not entries:
        raise RobotError(f"{path}: no joint is driven; the model has {', '.join(model.joints) or 'no named joint'}.")
    timestep = _usual_step(model) if entry.timestep is None else entry.timestep
    if not SHORTEST <= timestep <= 0.05:
        raise RobotError(f"{path}: timestep is {timestep:g} s; it must lie between {SHORTEST:.5f} and 0.05 s.")
    own = {name: drives.get(row.joint or name) for name, row in entries.items()}
    joints = tuple(_joint(path, model, name, row, own[name], timestep, said) for name, row in entries.items())
    _check_driven(path, joints)
    check_limits(path, joints, entry.deploy.get("safety"))
    if entry.joints is None:
        driven = [name for joint in joints for name, _ in joint.terms]
        said += passive_sentence(model, driven)
        said += [f"joint {name}: {reduction_note(model, name)}." for name in driven if name in model.reductions]
    left = [name for drive in model.drives for name in drive.actuators if drive not in own.values()]
    if entry.joints is not None and left:
        said.append(f"{model.path.name}: the actuators {', '.join(left)} drive nothing here and are left out.")
    base: Literal["fixed", "free"] = entry.base or ("free" if model.free else "fixed")
    floor = _floor(path, model, entry)
    if base == "free" and not model.floor and floor is None:
        said.append(
            f"{model.path.name} has no floor: a robot with a free base falls for ever; give it one with "
            "floor: {friction: 1.0}."
        )
    if entry.height is not None and base == "fixed":
        raise RobotError(f"{path}: height is where a free base starts, and this base is fixed; leave one of them out.")
    if base == "free" and not model.root:
        raise RobotError(f"{path}: base is free, but the joints {', '.join(entries)} hang on the world itself.")
    if base == "free" and not model.free and any(joint.body == model.root for joint in model.joints.values()):
        raise RobotError(f"{path}: base is free, but a joint ties '{model.root}' to the world; give the model a base.")
    robot = RobotFile(
        path,
        name=entry.name or path.stem,
        model=model,
        joints=joints,
        base=base,
        timestep=timestep,
        integrator=entry.integrator or "RK4",
        deploy=entry.deploy,
        said=(),
        floor=floor,
        height=entry.height,
        exclude=_excluded(path, model, entry),
        feet=_feet(path, model, entry),
        imu=entry.imu,
    )
    if entry.timestep is None:
        robot, why = settled(robot, entry.integrator)
        said = said_again(said, joints, robot.joints)
        why = why or ("" if robot.timestep > 0.99 * TIMESTEP else ", as its own step is short")
        said.append(
            f"{model.path.name}: the simulation steps by {1e3 * robot.timestep:g} ms, with {robot.integrator}{why}."
        )
    said += [
        f"{WARNING}joint {joint.name}: {phrase}."
        for joint in robot.joints
        if (phrase := feeble(joint, FULL_FORCE * (joint.range[1] - joint.range[0])))
    ]
    return replace(robot, said=tuple(said))


def _floor(path: Path, model: ModelFile, entry: FileEntry) -> FloorEntry | None:
    """The floor that the YAML adds."""
    if entry.floor is None:
        return None
    floor = checked_fields("floor", entry.floor, FloorEntry)
    if model.floor:
        raise RobotError(f"{path}: {model.path.name} has a floor of its own; leave floor out.")
    if not 0.0 <= floor.friction <= 10.0:
        raise RobotError(f"{path}: floor.friction is {floor.friction:g}; it must lie between 0 and 10.")
    return floor


def _excluded(path: Path, model: ModelFile, entry: FileEntry) -> tuple[tuple[str, str], ...]:
    """The pairs of bodies that never touch."""
    known = {body.name for body in model.spec().bodies[1:]}
    found = []
    for pair in entry.exclude:
        if len(pair) != 2:
            raise RobotError(f"{path}: exclude holds {pair}; give pairs of bodies, such as [trunk, calf].")
        for name in pair:
            if name not in known:
                raise RobotError(f"{path}: exclude: {model.path.name} has no body '{name}'{nearest(name, known)}.")
        found.append((pair[0], pair[1]))
    return tuple(found)


def _feet(path: Path, model: ModelFile, entry: FileEntry) -> tuple[str, ...]:
    """The bodies that get a shape."""
    for name in entry.feet:
        if name not in model.bodies:
            raise RobotError(
                f"{path}: feet: {model.path.name} has no body '{name}' that moves and has a mass"
                f"{nearest(str(name), model.bodies)}."
            )
    return tuple(entry.feet)


def _usual_step(model: ModelFile) -> float:
    """Step where nothing forces another [s]: 2 ms or the model's."""
    return between_actions(min(TIMESTEP, model.timestep))


def between_actions(step: float) -> float:
    """The step [s], or a bit less, so that a whole number of them lies between two actions."""
    return ACTION / math.ceil(ACTION / max(step, SHORTEST) - SAME)


def _check_names(path: Path, joints: Mapping[Any, Any]) -> None:
    """Refuse names that YAML reads as a number or as yes and no."""
    for name in joints:
        if not isinstance(name, str):
            raise RobotError(f"{path}: in joints, YAML reads the name {name} as a value; put it in quotes, as in '8':.")


def _default_entry(drive: ModelDrive | None) -> JointEntry:
    own = drive is None or drive.terms == ((drive.name, 1.0),)
    return JointEntry(belt=None if own or drive is None else dict(drive.terms))


def _joint(
    path: Path,
    model: ModelFile,
    name: str,
    entry: JointEntry,
    drive: ModelDrive | None,
    timestep: float,
    said: list[str],
) -> FileJoint:
    where = f"{path}: joints.{name}"
    terms = _terms(where, model, name, entry)
    joint = model.joints[terms[-1][0]]
    notes: list[str] = []
    given = None if entry.chain is None else _chain(where, path, entry.chain)
    wheel = name in model.wheels and terms == ((name, 1.0),) if given is None else given.command == "goal_velocity"
    if wheel and terms != ((joint.name, 1.0),):
        raise RobotError(f"{where}: a chain of speed goals drives one joint, not a sum of several; give it one joint.")
    if wheel:
        limits = entry.range or speed_range(model, joint.name, drive, given, notes)
    else:
        limits = entry.range or goal_range(model, terms, drive, notes)
    if not limits[0] < limits[1]:
        raise RobotError(f"{where}.range is {limits[0]:g} to {limits[1]:g}; it goes from its low to its high end.")
    if not wheel:
        check_within(where, model, terms, entry)
    ratio = abs(terms[-1][1])  # of the coordinate by the joint
    in_file = {
        "damping": joint.damping / ratio**2,
        "armature": joint.armature / ratio**2,
        "frictionloss": joint.frictionloss / ratio,
        LIMIT: 0.0 if joint.force is None or joint.force / ratio >= UNLIMITED else joint.force / ratio,
    }
    least: float | None = None
    if given is not None:
        chain = given
    elif wheel:
        chain = ideal_wheel(model, joint.name, drive, limits, timestep, notes)
    else:
        chain, least = ideal_servo(model, name, terms, drive, limits, timestep, notes)
    said += [f"joint {name}: {note}." for note in notes]
    # a chain of the YAML has a largest force of its own
    simplified = (*joint.simplified, *(drive.simplified if drive is not None and entry.chain is None else ()))
    said += [f"{WARNING}joint {name}: {phrase}." for phrase in simplified]
    owners: dict[str, Owner] = {}
    # what an assumed chain states, it has from the file
    its_own = [key for key in in_file if entry.chain is not None and states(chain, key)]
    for key, value in in_file.items():
        of_chain, own = stated(chain, key), key in its_own
        owners[key] = getattr(entry, key) or ("chain" if own or value == 0.0 else "file")
        if own and value > 0.0 and getattr(entry, key) is None:
            factor = max(value, of_chain) / min(value, of_chain) if of_chain else math.inf
            warning = WARNING if factor >= APART else ""
            by = f", {factor:.2g} times {'less' if of_chain < value else 'more'}" if warning and of_chain else ""
            said.append(
                f"{warning}joint {name}: {key} is {value:g} in {model.path.name} and {of_chain:g} in its chain{by}; "
                f"the chain's counts ({key}: chain), the other is left out."
            )
        if owners[key] == "file":
            before = chain
            try:
                chain = with_owned(chain, key, value)
            except SealegsError as error:
                why = str(error).partition(": ")[2] or str(error)
                raise RobotError(
                    f"{model.path}: joint '{joint.name}' has a {key} of {value:g}: {why} Correct it there, give {key}: "
                    f"chain in {path.name}, or do not drive the joint."
                ) from None
            if getattr(entry, key) is None and chain is not before:
                said.append(f"joint {name}: {key} {value:g} of {model.path.name} counts, its chain states none.")
    for word in entry.unknown:
        if word not in UNKNOWN:
            raise RobotError(f"{where}.unknown holds '{word}'{nearest(word, UNKNOWN)}; words are {', '.join(UNKNOWN)}.")
    start = entry.start
    if start is None:
        start = sum(c * model.start.get(other, 0.0) for other, c in terms)
        start = start if wheel else min(max(start, limits[0]), limits[1])
    servo = None if entry.servo is None else checked_fields(f"joints.{name}.servo", entry.servo, ServoEntry)
    return FileJoint(
        name, terms=terms, kind=joint.kind, range=limits, chain=chain, owners=owners, model_values=in_file, start=start,
        unknown=tuple(entry.unknown), servo=servo, notes=(*notes, *simplified), least=least,
    )  # fmt: skip


def _terms(where: str, model: ModelFile, name: str, entry: JointEntry) -> tuple[tuple[str, float], ...]:
    """Joints of the model that a coordinate is made of."""
    if entry.joint is not None and entry.belt is not None:
        raise RobotError(f"{where} has a joint and a belt; give one of them.")
    if entry.belt is not None:
        belt = {str(key): checked(f"{where}.belt.{key}", value, float) for key, value in entry.belt.items()}
        if not 1 <= len(belt) <= 2 or 0.0 in belt.values():
            raise RobotError(f"{where}.belt runs over one or two joints, each with a coefficient other than 0.")
    else:
        belt = {entry.joint or name: 1.0}
    for joint in belt:
        if joint not in model.joints:
            known = ", ".join(model.joints) or "none with a name"
            raise RobotError(
                f"{where}: {model.path.name} has no hinge or slide '{joint}'{nearest(joint, model.joints)}; "
                f"it has {known}."
            )
        if (leader := model.followers.get(joint)) is not None:
            tied = f"follows '{leader}'" if leader else "is held in place"
            path = where.rpartition(": ")[0]
            raise RobotError(f"{path}: joint '{joint}' {tied} by an equality of the model; leave it out of joints.")
    return tuple(belt.items())


def _check_driven(path: Path, joints: Sequence[FileJoint]) -> None:
    """Refuse joints that are driven twice."""
    users: dict[str, str] = {}
    for item in joints:
        if item.joint in users:
            raise RobotError(f"{path}: {users[item.joint]} and {item.name} both drive the joint '{item.joint}'.")
        users[item.joint] = item.name


def _chain(where: str, path: Path, source: str | list[Any]) -> Chain:
    """The chain as the YAML names it."""
    given: Any = source
    if isinstance(source, str) and Path(source).suffix in YAML_SUFFIXES:
        given = path.parent / source
    elif isinstance(source, str) and (fit := bam_file(source)) is not None:
        given = f"{PREFIX}{path.parent / fit}"
    try:
        return load_chain(given)
    except SealegsError as error:
        raise RobotError(f"{where}.chain: {error}") from None
