"""A robot as data: a YAML beside an MJCF or URDF, which says what drives each joint and whose numbers count.

    model: my_arm.xml               # relative to this file
    joints:
      shoulder: {chain: sts3215, range: [-1.5, 1.5]}
      elbow: {chain: sts3215, range: [-2.0, 2.0], unknown: [friction]}

A bare model file is a robot too: what it leaves open is assumed, and :attr:`RobotFile.said` tells what.

A drive's damping, armature and dry friction can stand in the model file and in the chain. One of the two is their
owner. The owner's number becomes the chain's, and the driven joint in the model has none, so nothing counts twice.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import mujoco
import numpy as np
import yaml

from ..actuators import Chain, DrivenCoordinate, load_chain
from ..actuators.errors import SealegsError, nearest
from ..actuators.published import PREFIX, bam_file
from ..actuators.stages import build_stage
from ..configs.check import checked, checked_fields
from .model_file import SUFFIXES, UNITS, ModelDrive, ModelFile, ModelJoint, read_model
from .robot import Robot, RobotError
from .robot_numbers import apply_numbers, model_effects, model_numbers

YAML_SUFFIXES = (".yaml", ".yml")
Owner = Literal["chain", "file"]
"""Whose number counts: the chain's, or the model file's."""

UNKNOWN = ("zero", "direction", "friction", "armature", "motor", "load")
"""Words for what nobody measured at a joint; fits may turn it."""

OWNED = {"damping": "friction.viscous", "armature": "armature", "frictionloss": "friction.coulomb"}
"""What model file and chain can both hold, and what it is called in a chain."""

TIMESTEP = 0.002  # [s] with RK4 accurate to 0.1 mrad (docs/numerics.md)
BANDWIDTH = 4.0  # [Hz] of the ideal servo that stands for a drive which the file says nothing of: assumed
SLIDE_REACH = 0.5  # [m] to either side, of a slide without a range: assumed


@dataclass(frozen=True)
class ServoEntry:
    """Which servo drives a joint, for deployment.

    Attributes:
        id: on the bus.
        zero: step of its encoder at which the joint is at 0; None: the centre.
        direction: 1 where growing steps are the joint's positive direction, else -1.
    """

    id: int
    zero: int | None = None
    direction: Literal[1, -1] = 1


@dataclass(frozen=True)
class JointEntry:
    """What the YAML says of a driven coordinate.

    Attributes:
        chain: word, path (relative to the YAML) or stages; None: an ideal servo as the model file has it.
        joint: of the model; None: the one of the same name.
        belt: joints of the model and coefficients whose sum is driven, in place of one joint.
        range: of its goals [rad or m]; None: that of the model's joint.
        damping, armature, frictionloss: their owner; None: the chain where it states the number, else the file.
        start: where episodes start [rad or m]; None: the model's keyframe, else 0.
        unknown: words of :data:`UNKNOWN`.
        servo: that drives it; None: ids from 1 in order, zero at the encoder's centre.
    """

    chain: str | list[Any] | None = None
    joint: str | None = None
    belt: dict[str, Any] | None = None
    range: tuple[float, float] | None = None
    damping: Owner | None = None
    armature: Owner | None = None
    frictionloss: Owner | None = None
    start: float | None = None
    unknown: list[str] = field(default_factory=list)
    servo: dict[str, Any] | None = None


@dataclass(frozen=True)
class FileEntry:
    """What the YAML says of the robot.

    Attributes:
        model: MJCF or URDF, relative to the YAML.
        joints: by driven coordinate; None: those that the model's actuators drive, else all.
        name: of the robot; None: that of the YAML.
        base: fixed to the ground, or free; None: as in the model.
        timestep: of the simulation [s]; None: 2 ms, or the model's where it is shorter.
        integrator: of the engine.
        deploy: what ``configs/robot`` holds of built-in robots: servo, sensors, rest, park, safety.
    """

    model: str
    joints: dict[str, Any] | None = None
    name: str | None = None
    base: Literal["fixed", "free"] | None = None
    timestep: float | None = None
    integrator: Literal["RK4", "Euler", "implicit", "implicitfast"] = "RK4"
    deploy: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class FileJoint:
    """A driven coordinate of a robot file.

    Attributes:
        name: of the coordinate: columns of logs and goals have it.
        terms: joints of the model and coefficients whose sum it is; mostly one joint.
        kind: hinge [rad, N.m] or slide [m, N].
        range: lowest and highest goal [rad or m].
        chain: that drives it, with all that the drive owns: friction, damping, armature.
        owners: of ``damping``, ``armature`` and ``frictionloss``: where the chain's number came from.
        model_values: of the same names, as the model file has them at the joint; no longer in the model.
        start: where episodes start [rad or m].
        unknown: words of :data:`UNKNOWN`.
        servo: that drives it, for deployment.
    """

    name: str
    terms: tuple[tuple[str, float], ...]
    kind: Literal["hinge", "slide"]
    range: tuple[float, float]
    chain: Chain
    owners: Mapping[str, Owner]
    model_values: Mapping[str, float]
    start: float
    unknown: tuple[str, ...] = ()
    servo: ServoEntry | None = None

    @property
    def joint(self) -> str:
        """Joint of the model; of a belt over several, the last, which the motor turns."""
        return self.terms[-1][0]

    @property
    def unit(self) -> str:
        """Of its position."""
        return UNITS[self.kind][0]

    def carried(self, chain: Chain) -> Chain:
        """``chain`` with the model file's number where it states none itself and the file owns it."""
        for key, owner in self.owners.items():
            if owner == "file" and _stated(chain, key) == 0.0:
                chain = _with(chain, key, self.model_values[key])
        return chain


@dataclass(frozen=True)
class RobotFile:
    """A robot that a model file and a YAML describe.

    Attributes:
        path: of the YAML, or of the bare model.
        name: of the robot.
        model: its model file.
        joints: driven coordinates, in the order of goals.
        base: fixed to the ground, or free.
        timestep: of the simulation [s].
        integrator: of the engine.
        deploy: what deployment needs beyond joints: servo, sensors, rest, park, safety.
        said: what was assumed or mended, a sentence each.
    """

    path: Path
    name: str
    model: ModelFile
    joints: tuple[FileJoint, ...]
    base: Literal["fixed", "free"]
    timestep: float
    integrator: str
    deploy: Mapping[str, Any]
    said: tuple[str, ...]

    @property
    def coupled(self) -> dict[str, str]:
        """Driven coordinates whose load is more than the tree of bodies says, with the reason."""
        reasons = {item.name: [self.model.coupled.get(name) for name, _ in item.terms] for item in self.joints}
        found = {name: next(filter(None, some), "") for name, some in reasons.items()}
        return {name: reason for name, reason in found.items() if reason}

    @property
    def digest(self) -> str:
        """Of model, driven coordinates and engine, to tell two robots apart."""
        rows = [[item.name, item.terms, item.range] for item in self.joints]
        document = [self.model.digest, self.base, self.integrator, rows]
        return hashlib.sha256(json.dumps(document).encode()).hexdigest()[:16]

    def joint(self, name: str) -> FileJoint:
        """The driven coordinate of that name.

        Raises:
            RobotError: there is none; the message names the nearest one.
        """
        found = {item.name: item for item in self.joints}
        if name not in found:
            raise RobotError(f"{self.path} drives no '{name}'{nearest(name, found)}; it drives {', '.join(found)}.")
        return found[name]

    def build(self, values: Mapping[str, float]) -> mujoco.MjSpec:
        """The specification without actuators, from a value for each of the robot's numbers.

        Driven joints have no armature, damping and dry friction: those are their chain's. Other joints keep theirs.
        """
        spec = self.model.spec()
        spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{self.integrator.upper()}")
        if self.base != ("free" if self.model.free else "fixed"):
            _set_base(spec, self.model.root, self.base)
        for item in self.joints:
            joint = spec.joint(item.joint)
            joint.armature, joint.frictionloss, joint.damping = 0.0, 0.0, 0.0 * np.asarray(joint.damping)
        apply_numbers(spec, self.model, values)
        return spec

    def bare_model(self, params: Mapping[str, float] | None = None) -> mujoco.MjModel:
        """The robot without actuators, compiled: the load that its chains work against.

        Raises:
            RobotError: as :meth:`Robot.parameters`.
        """
        return self.robot().build_spec(params).compile()

    def robot(self) -> Robot:
        """The robot as training, simulation and deployment take it."""
        singles = {item.name: item.joint for item in self.joints if item.terms == ((item.joint, 1.0),)}
        limits = {item.name: item.range for item in self.joints}
        return Robot(
            name=self.name,
            numbers=model_numbers(self.model, list(singles.values()), self.timestep),
            coordinates=tuple(DrivenCoordinate(item.name, item.terms) for item in self.joints),
            goal_limits=_Limits(limits),
            chains={item.name: item.chain for item in self.joints},
            build=self.build,
            effects=model_effects(self.model, singles),
            start={item.name: item.start for item in self.joints},
            units={item.name: item.unit for item in self.joints if item.unit != "rad"},
            file=self,
        )


@dataclass(frozen=True)
class _Limits:
    """Limits of goals that hang on no number."""

    limits: Mapping[str, tuple[float, float]]

    def __call__(self, values: Mapping[str, float]) -> Mapping[str, tuple[float, float]]:
        del values
        return self.limits


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
        if beside.is_file():
            said = [f"{beside} lies beside {path.name} and is not read: give it as the robot to use it."]
        return assembled(path, FileEntry(path.name), said)
    if path.suffix.lower() not in YAML_SUFFIXES:
        known = ", ".join((*YAML_SUFFIXES, *SUFFIXES))
        raise RobotError(f"{path} is no file of a robot; give one that ends in {known}.")
    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise RobotError(f"there is no robot file {path}; sealegs new-robot <model> writes one.") from None
    except (OSError, UnicodeDecodeError) as error:
        raise RobotError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}.") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f" in line {mark.line + 1}" if mark else ""
        raise RobotError(f"{path} is not valid YAML{where}: {getattr(error, 'problem', error)}.") from None
    try:
        return assembled(path, checked_fields("", document, FileEntry), [])
    except RobotError:
        raise
    except SealegsError as error:
        raise RobotError(f"{path}: {error}") from None


# --- putting together ----------------------------------------------------------------------------------------------


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
        chosen = list(drives) or [name for name in model.joints if name not in model.followers]
        why = "as its actuators do" if drives else "since it has no actuators"
        said.append(f"{model.path.name} says which joints are driven, {why}: {', '.join(chosen)}.")
        entries = {name: _default_entry(drives.get(name)) for name in chosen}
        if model.undriveable:
            raise RobotError(
                f"{model.path}: {model.undriveable[0]}; write which joints to drive into a YAML "
                f"(sealegs new-robot {model.path.name})."
            )
    else:
        entries = {name: checked_fields(f"joints.{name}", row or {}, JointEntry) for name, row in entry.joints.items()}
    if not entries:
        raise RobotError(f"{path}: no joint is driven; the model has {', '.join(model.joints) or 'no named joint'}.")
    joints = tuple(_joint(path, model, name, row, drives.get(name), said) for name, row in entries.items())
    _check_driven(path, model, joints)
    left = [name for drive in model.drives for name in drive.actuators if drive.name not in entries]
    if entry.joints is not None and left:
        said.append(f"{model.path.name}: the actuators {', '.join(left)} drive nothing here and are left out.")
    base: Literal["fixed", "free"] = entry.base or ("free" if model.free else "fixed")
    if base == "free" and not model.floor:
        said.append(f"{model.path.name} has no floor: a robot with a free base falls for ever.")
    if base == "free" and not model.root:
        raise RobotError(f"{path}: base is free, but the joints {', '.join(entries)} hang on the world itself.")
    if base == "free" and not model.free and any(joint.body == model.root for joint in model.joints.values()):
        raise RobotError(f"{path}: base is free, but a joint ties '{model.root}' to the world; give the model a base.")
    timestep = entry.timestep
    if timestep is None:
        timestep = min(TIMESTEP, model.timestep)
        said.append(f"{model.path.name}: the simulation steps by {1e3 * timestep:g} ms, with {entry.integrator}.")
    if not 1e-5 <= timestep <= 0.05:
        raise RobotError(f"{path}: timestep is {timestep:g} s; it must lie between 0.00001 and 0.05 s.")
    name = entry.name or path.stem
    return RobotFile(path, name, model, joints, base, timestep, entry.integrator, entry.deploy, tuple(said))


def _default_entry(drive: ModelDrive | None) -> JointEntry:
    return JointEntry(belt=dict(drive.terms) if drive is not None and len(drive.terms) > 1 else None)


def _joint(
    path: Path, model: ModelFile, name: str, entry: JointEntry, drive: ModelDrive | None, said: list[str]
) -> FileJoint:
    where = f"{path}: joints.{name}"
    terms = _terms(where, model, name, entry)
    joint = model.joints[terms[-1][0]]
    single = terms == ((joint.name, 1.0),)
    limits = entry.range
    if limits is None:
        limits = joint.range if single and joint.range is not None else None
        if limits is None:
            limits = (-math.pi, math.pi) if joint.kind == "hinge" else (-SLIDE_REACH, SLIDE_REACH)
            said.append(
                f"joint {name} has no range; {limits[0]:.4g} to {limits[1]:.4g} {UNITS[joint.kind][0]} is assumed."
            )
    if not limits[0] < limits[1]:
        raise RobotError(f"{where}.range is {limits[0]:g} to {limits[1]:g}; it goes from its low to its high end.")
    ratio = abs(terms[-1][1])  # of the coordinate by the joint
    stated = {
        "damping": joint.damping / ratio**2,
        "armature": joint.armature / ratio**2,
        "frictionloss": joint.frictionloss / ratio,
    }
    chain = _chain(where, path, entry, joint, drive, said, name)
    owners: dict[str, Owner] = {}
    for key, value in stated.items():
        of_chain = _stated(chain, key)
        owners[key] = getattr(entry, key) or ("chain" if of_chain > 0.0 or value == 0.0 else "file")
        if of_chain > 0.0 and value > 0.0 and getattr(entry, key) is None:
            said.append(
                f"joint {name}: {key} is {value:g} in {model.path.name} and {of_chain:g} in its chain; the chain's "
                f"counts ({key}: chain), the other is left out."
            )
        if owners[key] == "file":
            chain = _with(chain, key, value)
            if getattr(entry, key) is None:
                said.append(f"joint {name}: {key} {value:g} of {model.path.name} counts, its chain states none.")
    for word in entry.unknown:
        if word not in UNKNOWN:
            raise RobotError(f"{where}.unknown holds '{word}'{nearest(word, UNKNOWN)}; words are {', '.join(UNKNOWN)}.")
    start = entry.start
    if start is None:
        start = sum(c * model.start.get(other, 0.0) for other, c in terms)
        start = min(max(start, limits[0]), limits[1])
    servo = None if entry.servo is None else checked_fields(f"joints.{name}.servo", entry.servo, ServoEntry)
    return FileJoint(name, terms, joint.kind, limits, chain, owners, stated, start, tuple(entry.unknown), servo)


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
    return tuple(belt.items())


def _check_driven(path: Path, model: ModelFile, joints: Sequence[FileJoint]) -> None:
    """Refuse joints that are driven twice, or that another one carries along."""
    users: dict[str, str] = {}
    for item in joints:
        if item.joint in users:
            raise RobotError(f"{path}: {users[item.joint]} and {item.name} both drive the joint '{item.joint}'.")
        users[item.joint] = item.name
        for name, _ in item.terms:
            if (leader := model.followers.get(name)) is not None:
                tied = f"follows '{leader}'" if leader else "is held in place"
                raise RobotError(f"{path}: joint '{name}' {tied} by an equality of the model; leave it out of joints.")


def _chain(
    where: str,
    path: Path,
    entry: JointEntry,
    joint: ModelJoint,
    drive: ModelDrive | None,
    said: list[str],
    name: str,
) -> Chain:
    """The chain as the YAML names it, or an ideal servo as the model file has it."""
    if entry.chain is not None:
        source: Any = entry.chain
        if isinstance(source, str) and Path(source).suffix in YAML_SUFFIXES:
            source = path.parent / source
        elif isinstance(source, str) and (fit := bam_file(source)) is not None:
            source = f"{PREFIX}{path.parent / fit}"
        try:
            return load_chain(source)
        except SealegsError as error:
            raise RobotError(f"{where}.chain: {error}") from None
    limit = next((force for force in (drive.force if drive else None, joint.force) if force is not None), None)
    if drive is not None and drive.stiffness > 0.0:
        stiffness, damping, why = drive.stiffness, drive.damping, "its position actuator's"
    else:
        inertia, rate = joint.inertia + joint.armature, 2.0 * math.pi * BANDWIDTH
        stiffness, damping = inertia * rate**2, 2.0 * inertia * rate
        why = f"assumed, {BANDWIDTH:g} Hz with the joint's inertia"
    values = {"stiffness": _rounded(stiffness), "damping": _rounded(damping)}
    if limit is not None:
        values["torque_limit"] = _rounded(limit)
    unit = "/".join(reversed(UNITS[joint.kind]))
    said.append(f"joint {name} has no chain; an ideal servo of {values['stiffness']:g} {unit} drives it ({why}).")
    return dataclasses.replace(load_chain([{"ideal": values}]), label=f"ideal on {name}")


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")


# --- who owns what the file and the chain both hold ----------------------------------------------------------------


def _stated(chain: Chain, key: str) -> float:
    """A number of :data:`OWNED` as the chain has it, at the joint."""
    if key == "armature":
        return chain.armature()
    stage, _, parameter = OWNED[key].partition(".")
    return getattr(chain.find(stage), parameter) if chain.find(stage) is not None else 0.0


def _with(chain: Chain, key: str, value: float) -> Chain:
    """The chain with a number of :data:`OWNED`, given at the joint."""
    if key == "armature":
        motor = next(stage for stage in chain.stages if "armature" in stage.parameters())
        return chain.with_value(f"{motor.name}.armature", value / chain.gear_ratio() ** 2)
    if chain.find("friction") is None and value > 0.0:
        chain = chain.with_stage(build_stage("friction", {"coulomb": 0.0, "viscous": 0.0}, chain.label))
    return chain.with_value(OWNED[key], value) if chain.find("friction") is not None else chain


def _set_base(spec: mujoco.MjSpec, root: str, base: str) -> None:
    """Give the body that carries the robot a free joint, or take it from it."""
    body = spec.body(root)
    if base == "free":
        body.add_freejoint()
        return
    for joint in list(body.joints):
        if joint.type == mujoco.mjtJoint.mjJNT_FREE:
            spec.delete(joint)
