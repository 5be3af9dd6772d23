"""The robot that a log is of, from its file: a tree of hinges and slides, without what drives and brakes them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ...actuators import Chain
from ...envs.described.as_robot import as_robot
from ...envs.described.model_errors import line_of, uncompiled
from ...envs.described.robot_described import FileJoint, RobotFile
from ...envs.described.robot_file import is_robot_file, load_robot_file
from ...envs.engine.model_poses import followers_of
from ...envs.engine.numbers import RobotError
from ..log.types import Array, LogError, MeasuredRun

SINGLE_COORDINATE_KINDS = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


@dataclass(frozen=True)
class Frame:
    """How the angle of a joint in the log stands to that in the model: ``model = sign (log - zero)``."""

    zero: float = 0.0
    sign: float = 1.0

    def to_model(self, angles: Array) -> Array:
        """Angles of the log as the model has them."""
        return self.sign * (angles - self.zero)

    def chain_to_model(self, chain: Chain) -> Chain:
        """A chain that was found with the angle as the log has it, for the angle of the model."""
        return chain.turned(self.zero, self.sign)

    def chain_to_log(self, chain: Chain) -> Chain:
        """:meth:`chain_to_model` undone."""
        return chain.turned(-self.sign * self.zero, self.sign)


@dataclass(frozen=True, eq=False)
class LoggedRobot:
    """A robot as a replay of its joints needs it.

    Attributes:
        file: that describes it.
        model: its bodies and joints; driven ones have no damping, armature and friction.
        frames: of joints whose angle in the log differs from that of the model.
    """

    file: RobotFile
    model: mujoco.MjModel
    frames: Mapping[str, Frame] = field(default_factory=dict)

    def joint(self, name: str) -> FileJoint:
        """The driven joint of a log's columns.

        Raises:
            RobotError: the robot drives none of that name.
        """
        return self.file.joint(name)

    def number(self, name: str) -> int:
        """Number in the model of a joint, by the name of its columns: of what is driven, or of a joint of the model;
        -1 where a drive turns several joints or there is none.
        """
        driven = {item.name: item for item in self.file.joints}
        if name in driven and len(driven[name].terms) > 1:
            return -1
        joint = driven[name].joint if name in driven else name
        return int(mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_JOINT, joint))

    def ratio(self, name: str) -> float:
        """Of a joint's columns to its position in the model, where a drive turns it by another coefficient than 1."""
        item = next((item for item in self.file.joints if item.name == name), None)
        return 1.0 if item is None else item.terms[-1][1]

    def turns(self, number: int) -> bool:
        """Whether a joint of the model has one coordinate."""
        return int(self.model.jnt_type[number]) in SINGLE_COORDINATE_KINDS

    def slides(self, name: str) -> bool:
        """Whether a joint moves along a line."""
        item = next((item for item in self.file.joints if item.name == name), None)
        if item is not None:
            return item.kind == "slide"
        number = self.number(name)
        return number >= 0 and int(self.model.jnt_type[number]) == int(mujoco.mjtJoint.mjJNT_SLIDE)

    def reach(self, name: str) -> float | None:
        """The end of a joint's range in the model that is further from the log's zero [rad or m]; None: no range."""
        ends = self.ends(name)
        return None if ends is None else max(abs(end) for end in ends)

    def ends(self, name: str) -> tuple[float, float] | None:
        """The range of a joint in the model in the log's frame, the lower end first [rad or m]; None: it has none."""
        number = self.number(name)
        if number < 0 or not self.model.jnt_limited[number]:
            return None
        frame, ratio = self.frame(name), self.ratio(name)
        ends = [ratio * frame.sign * float(end) + frame.zero for end in self.model.jnt_range[number]]
        return min(ends), max(ends)

    def felt_by(self, name: str) -> list[int]:
        """Numbers of the joints whose motion a joint feels: those that carry it, those that it carries, and those of
        both that an equality moves with it."""
        own = {int(self.model.jnt_bodyid[number]) for number in moved_by(self.model, self.number(name))}
        related = set(own)
        for body in range(min(own) + 1, self.model.nbody):
            if int(self.model.body_parentid[body]) in related:
                related.add(body)
        for body in own:
            while body > 0:
                related.add(body)
                body = int(self.model.body_parentid[body])
        return [j for j in range(self.model.njnt) if int(self.model.jnt_bodyid[j]) in related]

    def column(self, number: int) -> str:
        """What columns of a joint of the model are named for."""
        name = mujoco.mj_id2name(self.model, mujoco.mjtObj.mjOBJ_JOINT, number) or f"joint {number}"
        return next((item.name for item in self.file.joints if item.terms == ((name, 1.0),)), name)

    def frame(self, name: str) -> Frame:
        """How the log's angle of a joint stands to the model's."""
        return self.frames.get(name, Frame())


@dataclass(frozen=True, eq=False)
class Machine(Sequence[MeasuredRun]):
    """Runs of one machine, and what they share, worked out once and handed on: it is the sequence of its runs.

    Attributes:
        runs: in the units of the model.
    """

    runs: tuple[MeasuredRun, ...]

    @classmethod
    def of(cls, runs: Iterable[MeasuredRun]) -> Machine:
        """These runs; themselves where they are a machine's already."""
        return runs if isinstance(runs, Machine) else cls(tuple(runs))

    @cached_property
    def robot(self) -> LoggedRobot | None:
        """The robot whose file their sidecars name, in the frames that they give; None: one of the collection's own.

        Raises:
            SealegsError: the file cannot be read.
        """
        return robot_of(self.runs[0])

    def in_frames(self, frames: Mapping[str, Frame]) -> Machine:
        """The same runs, with other frames of some joints of the robot."""
        every = {**(self.robot.frames if self.robot is not None else {}), **frames}
        said = {name: {"zero": frame.zero, "direction": int(frame.sign)} for name, frame in every.items()}
        return Machine(with_frames(self.runs, said))

    def __getitem__(self, index: Any) -> Any:
        return self.runs[index]

    def __iter__(self) -> Iterator[MeasuredRun]:
        return iter(self.runs)

    def __len__(self) -> int:
        return len(self.runs)

    def __getstate__(self) -> dict[str, Any]:
        """Without the robot, which another process reads once for all of its joints."""
        return {"runs": self.runs}


def robot_of(run: MeasuredRun) -> LoggedRobot | None:
    """The robot of a run whose sidecar names a robot's file; None where it names one of the collection's own.

    Raises:
        SealegsError: the file cannot be read.
    """
    if not is_robot_file(run.robot):
        return None
    path = Path(run.robot)
    if not path.is_file():
        raise LogError(
            f"{run.name}: its sidecar names the robot {run.robot}, and there is no such file; give its path from the "
            "log's folder."
        )
    stamps = tuple(item.stat().st_mtime_ns for item in path.parent.iterdir() if is_robot_file(item) and item.is_file())
    found = _read(path, stamps, tuple(sorted(run.robot_params.items())))
    frames = run.meta.get("frames")
    return found if frames is None else _framed(found, tuple(_frames(frames, run.name, found).items()))


@lru_cache(maxsize=8)
def _framed(robot: LoggedRobot, frames: tuple[tuple[str, Frame], ...]) -> LoggedRobot:
    """The robot with these frames: one object, on which what was computed of it is kept."""
    return replace(robot, frames=dict(frames))


def with_frames(runs: Sequence[MeasuredRun], frames: Mapping[str, Any]) -> tuple[MeasuredRun, ...]:
    """The runs with frames of their joints, in the form of a sidecar's ``meta.frames``."""
    return tuple(replace(run, meta={**run.meta, "frames": frames}) for run in runs)


def frames_said(said: Any, where: str) -> dict[str, Frame]:
    """``meta.frames`` of a sidecar: by joint the log's angle where the model is at zero, and the direction.

    Raises:
        LogError: it says something else.
    """
    frames = {}
    for name, entry in said.items() if isinstance(said, dict) else [("frames", said)]:
        zero, way = (entry.get("zero", 0.0), entry.get("direction", 1)) if isinstance(entry, dict) else (None, None)
        sound = isinstance(zero, int | float) and way in (1, -1) and not set(entry) - {"zero", "direction"}
        if not sound or not isinstance(zero, int | float):
            raise LogError(
                f"{where}: meta.frames is by joint, such as elbow: {{zero: -1.57, direction: -1}}, the log's angle "
                f"[rad] where the model is at zero, and 1 or -1; not {name}: {entry!r}."
            )
        frames[str(name)] = Frame(float(zero), 1.0 if way == 1 else -1.0)
    return frames


def _frames(said: Any, run: str, robot: LoggedRobot) -> dict[str, Frame]:
    """The same of joints that the robot has.

    Raises:
        LogError: it says something else, or names another joint.
    """
    frames = frames_said(said, run)
    for name in frames:
        robot.joint(name)
    return frames


@lru_cache(maxsize=8)
def _read(path: Path, changed: tuple[int, ...], params: tuple[tuple[str, float], ...]) -> LoggedRobot:
    del changed  # files that were edited are read again
    file = load_robot_file(path)
    return LoggedRobot(file, without_objects(file, dict(params)))


def without_objects(file: RobotFile, params: Mapping[str, float]) -> mujoco.MjModel:
    """A robot's model without the objects of its scene that move freely: trees of bodies with a free or a ball joint
    and no joint that is driven. No log says how they moved, and no joint of the robot carries them.

    Raises:
        RobotError: as :func:`~sealegs.envs.described.as_robot.bare_model`, or it does not compile without them.
    """
    spec = as_robot(file).build_spec(params)
    driven = {name for item in file.joints for name, _ in item.terms}
    loose = [root for root in spec.worldbody.bodies if _is_object(root, driven)]
    names = ", ".join(root.name for root in loose)
    if loose:
        for key in list(spec.keys):  # they have a place for each coordinate
            spec.delete(key)
        for item in (*spec.cameras, *spec.lights):  # they may look at what goes, and move nothing
            item.mode, item.targetbody = mujoco.mjtCamLight.mjCAMLIGHT_FIXED, ""
    for root in loose:
        spec.delete(root)
    try:
        return spec.compile()
    except ValueError as error:
        path = file.model.path
        if not loose:
            raise RobotError(uncompiled(path, error)) from None
        raise RobotError(
            f"{path} does not compile without the objects of its scene that move freely ({names}): {line_of(error)}; "
            "take them out of the file, with all that names them."
        ) from None


def _is_object(root: mujoco.MjsBody, driven: Collection[str]) -> bool:
    joints = [*root.joints, *(joint for body in root.find_all("body") for joint in body.joints)]
    loose = any(joint.type in (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL) for joint in joints)
    return loose and not any(joint.name in driven for joint in joints)


# --- joints that an equality constraint of the file ties to another one, such as the fingers of a gripper ------------


def moved_by(model: mujoco.MjModel, joint: int) -> dict[int, float]:
    """How far joints go that move with one in proportion, per unit of its own way: itself first, by number."""
    found, followers = {joint: 1.0}, followers_of(model)
    for _ in followers:
        for number, follower in followers.items():
            if number not in found and follower.leader in found and follower.way.trim().degree() <= 1:
                found[number] = found[follower.leader] * float(follower.way.deriv()(0.0))
    return found


class Turned:
    """A joint with those that an equality moves with it: where they are as it goes further, and their torques on it."""

    def __init__(self, model: mujoco.MjModel, joint: int) -> None:
        moved = moved_by(model, joint)
        self.dofs = np.array([model.jnt_dofadr[number] for number in moved])
        self.address = np.array([model.jnt_qposadr[number] for number in moved])
        self.ratios = np.array(list(moved.values()))
        self.alone = len(moved) == 1
        self._dof, self._at = int(self.dofs[0]), int(self.address[0])

    def place(self, data: mujoco.MjData, row: Array, way: float) -> None:
        """Put them where a row of positions (nv,) has them, and ``way`` further [rad or m]."""
        if self.alone:  # a tenth of the time
            data.qpos[self._at] = row[self._dof] + way
        else:
            data.qpos[self.address] = row[self.dofs] + way * self.ratios

    def of(self, torques: Array) -> float:
        """What torques (nv,) come to at the joint."""
        return float(torques[self._dof]) if self.alone else float(self.ratios @ torques[self.dofs])

    def along(self, torques: Array) -> Array:
        """The same of torques along a log (n, nv), as (n,)."""
        return torques[:, self.dofs] @ self.ratios
