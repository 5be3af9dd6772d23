"""A robot that a model file and a YAML describe.

A drive's damping, armature, dry friction and largest force can stand in the model file and in the chain. One of the two
is their owner. The owner's number becomes the chain's, and the driven joint in the model has none, so nothing counts
twice.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import mujoco
import numpy as np

from ...actuators import Chain
from ...actuators.stages import build_stage
from ...actuators.stages.controller import UNLIMITED
from ...common.errors import nearest
from ..engine.model_poses import Label, numbers
from ..engine.numbers import RobotError
from ..engine.scene import TILE, add_scene, add_sun
from .model_file import UNITS, ModelFile
from .robot_entries import FloorEntry, Owner, ServoEntry
from .robot_numbers import apply_numbers

LIMIT = "actuatorfrcrange"
OWNED = {
    "damping": "friction.viscous",
    "armature": "armature",
    "frictionloss": "friction.coulomb",
    LIMIT: "torque_limit.limit",
}
"""What model file and chain can both hold, and what it is called in a chain; an ideal servo has a limit of its own."""
IDEAL = ("ideal", "ideal_velocity")
"""Stages of perfect drives."""
FLOOR_FRICTION = "floor_friction"
"""Number of a robot whose YAML gives it a floor."""
TALL = 2.5  # times the height of its base: rough size of a robot on legs, for light and camera
LOW = 0.12  # [m] of a base: a robot that is lower, on wheels, is wider than high; assumed
SAME = 1e-6  # of a number: what differs by less is the same

HINGES = {"range_margin": 0.15, "speed": 15.0}
"""Limits of safety of hinges [rad], [rad/s], as in ``configs/robot/bench.yaml``."""
SLIDES = {"range_margin": 0.02, "speed": 5.0}
"""The same of slides, as shares of their range: of it, and of it a second; assumed."""


@dataclass(frozen=True)
class FileJoint:
    """A driven coordinate of a robot file.

    Attributes:
        name: of the coordinate: columns of logs and goals have it.
        terms: joints of the model and coefficients whose sum it is; mostly one joint.
        kind: hinge [rad, N.m] or slide [m, N].
        range: lowest and highest goal [rad or m; of a wheel rad/s].
        chain: that drives it, with all that the drive owns: friction, damping, armature.
        owners: of ``damping``, ``armature``, ``frictionloss`` and ``actuatorfrcrange``: where the chain's number came
            from.
        model_values: of the same names, as the model file has them at the joint; no longer in the model; 0: none.
        start: where episodes start [rad or m].
        unknown: words of :data:`UNKNOWN`.
        servo: that drives it, for deployment.
        notes: what was read of its drive in the model file, or assumed, a phrase each.
        least: stiffness that its servo should have at least [N.m/rad or N/m], where that is assumed; None: it is not.
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
    notes: tuple[str, ...] = ()
    least: float | None = None

    @property
    def joint(self) -> str:
        """Joint of the model; of a belt over several, the last, which the motor turns."""
        return self.terms[-1][0]

    @property
    def unit(self) -> str:
        """Of its position."""
        return UNITS[self.kind][0]

    @property
    def by_speed(self) -> bool:
        """Whether its goals are speeds: a wheel."""
        return self.chain.command == "goal_velocity"

    @property
    def goal_unit(self) -> str:
        """Of its goals."""
        return f"{self.unit}/s" if self.by_speed else self.unit

    def carried(self, chain: Chain) -> Chain:
        """``chain`` with the model file's number where it states none itself and the file owns it."""
        for key in [key for key, owner in self.owners.items() if owner == "file" and not states(chain, key)]:
            chain = with_owned(chain, key, self.model_values[key])
        return chain

    def passed_over(self, chain: Chain) -> tuple[str, ...]:
        """Names of numbers that the model file owns and that ``chain`` states otherwise, which then counts."""
        return tuple(
            key
            for key, owner in self.owners.items()
            if owner == "file"
            and states(chain, key)
            and not math.isclose(stated(chain, key), self.model_values[key], rel_tol=SAME)
        )


@dataclass(frozen=True)
class RobotFile:
    """A robot that a model file and a YAML describe.

    Attributes:
        path: of the YAML, or of the bare model.
        name: of the robot.
        model: its model file.
        joints: driven coordinates, in the order of goals.
        base: fixed to the ground, or free.
        floor: that is added to the model; None: there is what the model has.
        height: of a free base at the start of an episode [m]; None: the keyframe's, or the model's.
        exclude: pairs of bodies that never touch.
        feet: bodies that get the box of their mass and inertia as a shape that touches.
        imu: what the YAML says of an IMU on its free base; None: it has none.
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
    floor: FloorEntry | None = None
    height: float | None = None
    exclude: tuple[tuple[str, str], ...] = ()
    feet: tuple[str, ...] = ()
    imu: Mapping[str, Any] | None = None

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
        floor = [] if self.floor is None else ["floor"]  # its friction is a number of the robot
        document = [self.model.digest, self.base, self.integrator, rows, *floor, *self.exclude, *self.feet]
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

    def whose(self, chains: Mapping[str, Chain]) -> tuple[str, ...]:
        """Which numbers of chains from elsewhere count in place of the model file's, though that owns them.

        Args:
            chains: by driven coordinate.
        """
        found: dict[tuple[str, tuple[str, ...]], list[str]] = {}
        for name, chain in chains.items():
            if keys := self.joint(name).passed_over(chain):
                found.setdefault((chain.label, keys), []).append(name)
        where = "a YAML of the robot" if self.path == self.model.path else self.path.name
        return tuple(
            f"joint{'s' if len(names) > 1 else ''} {', '.join(names)}: {', '.join(keys)} of the chain {label} "
            f"{'count' if len(keys) > 1 else 'counts'}, not of {self.model.path.name}; to count these, name the chain "
            f"in {where}, with {next(iter(keys))}: file."
            for (label, keys), names in found.items()
        )

    def build(self, values: Mapping[str, float]) -> mujoco.MjSpec:
        """The specification without actuators, from a value for each of the robot's numbers.

        Driven joints have no armature, damping, dry friction and largest force of actuators: those are their chain's.
        Other joints keep theirs.
        """
        spec = self.model.spec()
        spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{self.integrator.upper()}")
        if self.base != ("free" if self.model.free else "fixed"):
            _set_base(spec, self.model.root, self.base)
        for item in self.joints:
            joint = spec.joint(item.joint)
            joint.armature, joint.frictionloss, joint.damping = 0.0, 0.0, 0.0 * np.asarray(joint.damping)
            joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
        apply_numbers(spec, self.model, values)
        for one, other in self.exclude:
            spec.add_exclude(bodyname1=one, bodyname2=other)
        for name in self.feet:
            body = self.model.bodies[name]
            spec.body(name).add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX, size=box_of(body.mass, along_frame(body.inertia, body.axes)),
                pos=body.centre, mass=0.0,
            )  # fmt: skip
        if self.floor is not None:
            reach = TALL * max(self.height or 0.2, LOW)
            floor = add_scene(spec, values[FLOOR_FRICTION], reach=reach)
            floor.rgba = (*TILE, 1.0)  # MuJoCo leaves the textures of a URDF out
            if self.model.root:
                add_sun(spec.body(self.model.root), reach)
        return spec

    def at_height(self) -> dict[Label, tuple[float, ...]]:
        """The free base at the height where episodes start, turned as the model has it."""
        if self.height is None:
            return {}
        spec = self.model.spec()
        if not self.model.free:
            _set_base(spec, self.model.root, "free")
        model = spec.compile()
        first = int(model.body_jntadr[model.body(self.model.root).id])
        label = next(label for label, number in numbers(model).items() if number == first)
        at = int(model.jnt_qposadr[first])
        own = self.model.pose.get(label, tuple(float(value) for value in model.qpos0[at : at + 7]))
        return {label: (*own[:2], self.height, *own[3:])}


def along_frame(inertia: tuple[float, float, float], axes: tuple[float, ...]) -> tuple[float, float, float]:
    """Moments about the axes of a body's frame [kg.m2], from the principal ones and the quaternion of their axes.

    A foot stands level in its frame. Its principal axes lean where its heel is heavier: it stood on its toes' edge.
    """
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, np.array(axes))
    x, y, z = np.square(turn.reshape(3, 3)) @ np.array(inertia)
    return float(x), float(y), float(z)


def box_of(mass: float, inertia: tuple[float, float, float]) -> np.ndarray:
    """Half sides (3,) [m] of the solid box that has a mass [kg] and moments [kg.m2] about its axes."""
    squares = 1.5 / mass * (sum(inertia) - 2.0 * np.array(inertia))
    return np.sqrt(np.maximum(squares, 1e-6))


def _set_base(spec: mujoco.MjSpec, root: str, base: str) -> None:
    """Give the body that carries the robot a free joint, or take it from it."""
    body = spec.body(root)
    if base == "free":
        body.add_freejoint()
        return
    for joint in list(body.joints):
        if joint.type == mujoco.mjtJoint.mjJNT_FREE:
            spec.delete(joint)


# --- who owns what the file and the chain both hold ----------------------------------------------------------------


def states(chain: Chain, key: str) -> bool:
    """Whether a chain has a number of :data:`OWNED` of its own: a friction stage says both of its numbers, 0 too."""
    if OWNED[key].startswith("friction."):
        return chain.find("friction") is not None
    return stated(chain, key) > 0.0


def stated(chain: Chain, key: str) -> float:
    """A number of :data:`OWNED` as the chain has it, at the joint."""
    if key == "armature":
        return chain.armature()
    if key == LIMIT:
        return 0.0 if (limit := _limit(chain)) >= UNLIMITED else limit
    stage, _, parameter = OWNED[key].partition(".")
    return getattr(chain.find(stage), parameter) if chain.find(stage) is not None else 0.0


def with_owned(chain: Chain, key: str, value: float) -> Chain:
    """The chain with a number of :data:`OWNED`, given at the joint; a limit only where the chain could pass it."""
    if key == "armature":
        motor = next(stage for stage in chain.stages if "armature" in stage.parameters())
        return chain.with_value(f"{motor.name}.armature", value / chain.gear_ratio() ** 2)
    if key == LIMIT:
        return _limited(chain, value) if value > 0.0 else chain
    if chain.find("friction") is None and value > 0.0:
        chain = chain.with_stage(build_stage("friction", {"coulomb": 0.0, "viscous": 0.0}, chain.label))
    return chain.with_value(OWNED[key], value) if chain.find("friction") is not None else chain


def _limit(chain: Chain) -> float:
    """Largest torque at the joint that stages of the chain state [N.m or N]; :data:`UNLIMITED` where none does."""
    limits = [stage.law_values(chain)["limit"] for stage in chain.stages if stage.name == "torque_limit"]
    return min([*limits, *(drive.torque_limit for name in IDEAL if (drive := chain.find(name)) is not None), UNLIMITED])


def _stall(chain: Chain) -> float:
    """Largest torque at the joint that the chain's motor has at rest [N.m or N]; infinite where that is not known."""
    motor, supply, regression = (chain.find(name) for name in ("dc_motor", "supply", "regression"))
    if motor is not None and supply is not None:
        return chain.gear_ratio() * motor.motor_constant * supply.volts / motor.resistance
    return math.inf if regression is None else chain.gear_ratio() * abs(regression.duty_torque)


def largest_torque(chain: Chain) -> float:
    """Largest torque of a chain at its joint, at rest [N.m or N]; infinite where that is not known."""
    return min(_limit(chain), _stall(chain))


def _limited(chain: Chain, limit: float) -> Chain:
    """The chain with a largest torque at the joint [N.m or N], where it could give more."""
    if largest_torque(chain) <= limit:
        return chain
    for name in IDEAL:
        if chain.find(name) is not None:
            return chain.with_value(f"{name}.torque_limit", limit)
    chain = chain.with_stage(build_stage("torque_limit", {"limit": limit}, chain.label))
    at_joint = chain.find("torque_limit").law_values(chain)["limit"]  # a gear behind it turns faster and pulls less
    return chain.with_value(OWNED[LIMIT], limit**2 / at_joint)
