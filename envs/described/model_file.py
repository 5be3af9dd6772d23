"""An MJCF or URDF file as it is: its specification, what can be driven in it, and what hangs together there."""

from __future__ import annotations

import functools
import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np

from ..engine.model_poses import Pose, carried_along, free_ways, home_pose, standing
from ..engine.numbers import RobotError
from .model_couplings import couplings, led, unnamed
from .model_drives import ModelDrive, both_ways, read_drives, wheels_of
from .model_errors import uncompiled, unreadable
from .model_meshes import (
    told_guessed_masses,
    told_sizes,
    with_total_mass,
    without_masses_of_shapes,
    without_meshes_that_fail,
)
from .model_sources import SUFFIXES, check_files
from .urdf_text import mended_urdf, reductions

UNITS: Mapping[str, tuple[str, str]] = {"hinge": ("rad", "N.m"), "slide": ("m", "N")}
"""Units of position and of force, by kind of joint."""


@dataclass(frozen=True)
class ModelJoint:
    """A hinge or slide of a model file.

    Attributes:
        name: in the file.
        kind: a hinge [rad, N.m], or a slide [m, N].
        body: that it moves.
        range: where its stops are [rad or m]; None: it has none.
        damping, armature, frictionloss: that the file gives it.
        force: largest force that the file lets actuators give it, either way [N.m or N]; None: any.
        inertia: at the file's pose, with that of joints that follow it, its own armature left out [kg.m2 or kg].
        axis: in the frame of the body.
        place: in the frame of the body [m].
        simplified: what the file says of it that is read more simply here, a phrase each.
    """

    name: str
    kind: Literal["hinge", "slide"]
    body: str
    range: tuple[float, float] | None
    damping: float
    armature: float
    frictionloss: float
    force: float | None
    inertia: float
    axis: tuple[float, float, float]
    place: tuple[float, float, float]
    simplified: tuple[str, ...] = ()


@dataclass(frozen=True)
class ModelBody:
    """A moving body: mass [kg], centre of mass [m], principal inertia [kg.m2] and the axes of that (w, x, y, z).

    ``tip`` is where it would carry something [m], as :func:`tip_of` says.
    """

    name: str
    mass: float
    centre: tuple[float, float, float]
    inertia: tuple[float, float, float]
    axes: tuple[float, float, float, float]
    tip: tuple[float, float, float]


@dataclass(frozen=True)
class ModelFile:
    """What stands in a model file.

    Attributes:
        path: of the file.
        name: of the model, or of the file.
        joints: hinges and slides that have a name, by it.
        drives: what actuators of the file drive.
        undriveable: actuators that no chain can stand for, and why.
        bodies: that move and have a mass, by name.
        frames: bodies that move and have none, such as that of a tool, and where they would carry something [m].
        followers: joints that an equality constraint ties to another one (or to a fixed place: empty), by name.
        carried: by name of a joint that leads: those that follow it in proportion, offset [rad or m] and ratio of each.
        coupled: joints whose load is more than a tree of bodies says, and why.
        root: body that carries the driven tree; empty where it is the world.
        free: whether that body has a free joint.
        start: positions of joints in the keyframe ``home``, or in the first one; where there is none, in the pose in
            which the file describes the robot.
        pose: joints of any kind that stand elsewhere in that keyframe than in the file's pose, a free base too.
        floor: whether there is a plane or a height field to stand on.
        timestep: of the file [s].
        digest: of the model, to tell two files apart.
        mobility: at the file's pose, how fast a joint gains speed by a force on another one [1/(kg.m2) or 1/kg], by
            both names; all joints give way, and those that equality constraints tie move together.
        reductions: mechanical reductions that a URDF states and that nothing here uses, as they stand, by joint.
        unnamed: joints that nothing can drive, since they have no name or are balls, in words.
        said: what was mended in reading, a sentence each.
        wheels: joints that turn without end and are told speeds, and the radius of each [m]; 0: not known.
        mass: of the whole model [kg].
    """

    path: Path
    name: str
    joints: Mapping[str, ModelJoint]
    drives: tuple[ModelDrive, ...]
    undriveable: tuple[str, ...]
    bodies: Mapping[str, ModelBody]
    frames: Mapping[str, tuple[float, float, float]]
    followers: Mapping[str, str]
    carried: Mapping[str, tuple[tuple[str, float, float], ...]]
    coupled: Mapping[str, str]
    root: str
    free: bool
    start: Mapping[str, float]
    pose: Pose
    floor: bool
    timestep: float
    digest: str
    mobility: Mapping[tuple[str, str], float]
    reductions: Mapping[str, str]
    unnamed: tuple[str, ...]
    said: tuple[str, ...]
    wheels: Mapping[str, float]
    mass: float

    def mobility_of(self, terms: Sequence[tuple[str, float]]) -> float:
        """The same of a coordinate that is a sum of joints times coefficients, by a force on it [1/(kg.m2) or 1/kg]."""
        return sum(c * d * self.mobility[one, two] for one, c in terms for two, d in terms)

    def spec(self) -> mujoco.MjSpec:
        """A specification of its own: without actuators, and without keyframes, which would count them."""
        return read_specs(self.path, self.path.stat().st_mtime_ns)[0].copy()

    def with_actuators(self) -> mujoco.MjSpec:
        """A specification of its own: as the file has it, with actuators and keyframes."""
        return read_specs(self.path, self.path.stat().st_mtime_ns)[1].copy()


def read_model(path: str | Path) -> ModelFile:
    """Read an MJCF or URDF file.

    Raises:
        RobotError: it is missing, no model, or does not compile.
    """
    path = Path(path).resolve()
    if path.suffix.lower() in (".xacro", ".sdf"):
        stem = path.stem.partition(".")[0]
        raise RobotError(
            f"{path} is no MJCF or URDF; give the URDF that xacro macros make: xacro {stem}.xacro > {stem}.urdf."
        )
    if path.suffix.lower() not in SUFFIXES:
        raise RobotError(f"{path} is no model of a robot; give a file that ends in {', '.join(SUFFIXES)}.")
    if not os.path.isfile(path):
        raise RobotError(f"there is no model {path}; give the path of an MJCF or URDF file.")
    return _surveyed(path, path.stat().st_mtime_ns)


# --- looking -------------------------------------------------------------------------------------------------------


@functools.lru_cache(maxsize=64)
def _surveyed(path: Path, changed: int) -> ModelFile:
    bare, full, said = read_specs(path, changed)
    spec = bare.copy()
    try:
        model = spec.compile()
        drives, undriveable = read_drives(full, [model.joint(k).name for k in _single(model)])
    except (ValueError, RuntimeError) as error:  # a RuntimeError where memory ends
        raise RobotError(uncompiled(path, error)) from None
    masses, ways = _masses(model), free_ways(model)
    joints = {joint.name: joint for joint in _joints(model, _inertias(model, masses, ways)) if joint.name}
    followers, coupled = couplings(model)
    drives, carried = led(model, drives)
    undriveable = (*undriveable, *carried)
    moved = [name for drive in drives for name, _ in drive.terms] or list(joints)
    root, home = _root(model, moved), home_pose(full, model)
    return ModelFile(
        path=path,
        name=full.modelname if full.modelname not in ("", "MuJoCo Model") else path.stem,
        joints=joints,
        drives=drives,
        undriveable=undriveable,
        bodies={body.name: body for body in _bodies(model)},
        frames={model.body(k).name: _three(tip_of(model, k)) for k in _moved(model) if model.body_mass[k] <= 0.0},
        followers=followers,
        carried=carried_along(model),
        coupled=coupled,
        root=model.body(root).name if root else "",
        free=bool(root) and _is_free(model, root),
        start={model.joint(k).name: float(home[model.jnt_qposadr[k]]) for k in _single(model)},
        pose=standing(model, home),
        floor=bool(np.isin(model.geom_type, (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)).any()),
        timestep=float(model.opt.timestep),
        digest=hashlib.sha256(spec.to_xml().encode()).hexdigest()[:16],
        mobility=_mobility(model, masses, ways),
        reductions=reductions(path),
        unnamed=unnamed(model),
        said=(*said, *told_sizes(model, path)),
        wheels={name: radius for name, radius in wheels_of(model, drives).items() if name not in followers},
        mass=float(mujoco.mj_getTotalmass(model)),
    )


def _masses(model: mujoco.MjModel) -> np.ndarray:
    """Mass matrix at the file's pose, with armatures (nv, nv)."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    return full


def _inertias(model: mujoco.MjModel, masses: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """What each degree of freedom moves while the others are held (nv,), its followers with it, armature left out."""
    found = np.diag(masses).copy()
    leading = ways.any(axis=0)
    found[leading] = np.diag(ways.T @ masses @ ways)[leading]
    return found - model.dof_armature


def _mobility(model: mujoco.MjModel, masses: np.ndarray, ways: np.ndarray) -> dict[tuple[str, str], float]:
    ways = ways[:, ways.any(axis=0)]
    inverse = ways @ np.linalg.inv(ways.T @ masses @ ways) @ ways.T
    dofs = {model.joint(k).name: int(model.jnt_dofadr[k]) for k in _single(model)}
    return {(one, two): float(inverse[a, b]) for one, a in dofs.items() for two, b in dofs.items()}


def _joints(model: mujoco.MjModel, inertia: np.ndarray) -> list[ModelJoint]:
    kinds: dict[int, Literal["hinge", "slide"]] = {
        int(mujoco.mjtJoint.mjJNT_HINGE): "hinge",
        int(mujoco.mjtJoint.mjJNT_SLIDE): "slide",
    }
    found = []
    for number in range(model.njnt):
        if (kind := kinds.get(int(model.jnt_type[number]))) is None:
            continue
        dof, low, high = int(model.jnt_dofadr[number]), *map(float, model.jnt_range[number])
        force, said = _force(model, number, UNITS[kind][1])
        found.append(
            ModelJoint(
                name=model.joint(number).name,
                kind=kind,
                body=model.body(int(model.jnt_bodyid[number])).name,
                range=(low, high) if model.jnt_limited[number] else None,
                damping=float(model.dof_damping[dof]),
                armature=float(model.dof_armature[dof]),
                frictionloss=float(model.dof_frictionloss[dof]),
                force=force,
                inertia=float(inertia[dof]),
                axis=_three(model.jnt_axis[number]),
                place=_three(model.jnt_pos[number]),
                simplified=(*said, *_powers(model, dof)),
            )
        )
    return found


def _force(model: mujoco.MjModel, joint: int, unit: str) -> tuple[float | None, tuple[str, ...]]:
    """Largest force of actuators on a joint either way, and in words how a range that is not so was read."""
    if not model.jnt_actfrclimited[joint]:
        return None, ()
    low, high = map(float, model.jnt_actfrcrange[joint])
    return both_ways((low, high), "its actuatorfrcrange,", unit)


def _powers(model: mujoco.MjModel, dof: int) -> list[str]:
    """In words, that a damping has more than its linear part."""
    square, cube = map(float, model.dof_dampingpoly[dof])
    if not (square or cube):
        return []
    whole = f"{float(model.dof_damping[dof]):g} {square:g} {cube:g}"
    instead = f"; write friction: {{drag: {square:g}}} into its chain for the second" if square > 0.0 else ""
    return [f"of its damping {whole} only the first number counts where it is driven{instead}"]


def _single(model: mujoco.MjModel) -> list[int]:
    """Hinges and slides that have a name."""
    kinds = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    return [k for k in range(model.njnt) if int(model.jnt_type[k]) in kinds and model.joint(k).name]


def _three(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = map(float, values)
    return x, y, z


def _moved(model: mujoco.MjModel) -> list[int]:
    """Bodies with a name that some joint moves."""
    return [k for k in range(1, model.nbody) if model.body_weldid[k] and model.body(k).name]


def _bodies(model: mujoco.MjModel) -> list[ModelBody]:
    """Those of them that have a mass."""
    return [
        ModelBody(
            model.body(k).name,
            float(model.body_mass[k]),
            _three(model.body_ipos[k]),
            _three(model.body_inertia[k]),
            (float(model.body_iquat[k, 0]), *_three(model.body_iquat[k, 1:])),
            tip=_three(tip_of(model, k)),
        )
        for k in _moved(model)
        if model.body_mass[k] > 0.0
    ]


def tip_of(model: mujoco.MjModel, body: int) -> np.ndarray:
    """Where a body would carry something, in its frame (3,) [m]: at its last site, or else at its centre of mass.

    A body without a mass carries it at its origin.
    """
    sites = np.flatnonzero(model.site_bodyid == body)
    return np.array(model.site_pos[sites[-1]]) if len(sites) else centre_of(model, body)


def centre_of(model: mujoco.MjModel, body: int) -> np.ndarray:
    """Centre of mass of a body, in its frame (3,) [m]; its origin where it has no mass.

    What MuJoCo gives for that of a body without a mass is no place in it: it may hold the body's place in its parent.
    """
    return np.array(model.body_ipos[body]) if model.body_mass[body] > 0.0 else np.zeros(3)


def _root(model: mujoco.MjModel, joints: Sequence[str]) -> int:
    """Body below the world that carries the first of these joints."""
    if not joints:
        return 0
    body = int(model.jnt_bodyid[model.joint(joints[0]).id])
    while model.body_parentid[body]:
        body = int(model.body_parentid[body])
    return body


def _is_free(model: mujoco.MjModel, body: int) -> bool:
    first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    return any(model.jnt_type[k] == mujoco.mjtJoint.mjJNT_FREE for k in range(first, first + count))


# --- reading, with what MuJoCo refuses and what can be mended --------------------------------------------------------


@functools.lru_cache(maxsize=64)
def read_specs(path: Path, changed: int) -> tuple[mujoco.MjSpec, mujoco.MjSpec, tuple[str, ...]]:
    """The specification without actuators, the same with them, and what was mended."""
    del changed  # a part of the key: a file that was edited is read again
    said: list[str] = []
    missing: list[str] = []
    try:
        check_files(path)
        if path.suffix.lower() == ".urdf":
            full = mujoco.MjSpec.from_string(mended_urdf(path, said, missing))
            full.modelfiledir = str(path.parent)
        else:
            full = mujoco.MjSpec.from_file(str(path))
        _ = [body.joints for body in full.bodies]  # looking at them, MuJoCo refuses names that stand twice
    except (ValueError, RuntimeError) as error:  # a RuntimeError where memory ends
        raise RobotError(unreadable(path, error)) from None
    full.compiler.fusestatic = False  # bodies keep their names, masses and sensors
    without_meshes_that_fail(full, path, missing, said)
    with_total_mass(full, path, said)
    without_masses_of_shapes(full, path)
    told_guessed_masses(full, path, said)
    bare = full.copy()
    for kind in ("keys", "sensors", "actuators"):
        for item in list(getattr(bare, kind)):
            if kind != "sensors" or item.objtype == mujoco.mjtObj.mjOBJ_ACTUATOR:
                bare.delete(item)
    return bare, full, tuple(said)
