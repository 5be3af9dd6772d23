"""A robot of one's own as diagnosed, for plain MuJoCo: its model file with what MuJoCo itself can simulate of it."""

from __future__ import annotations

import math
import os
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np

from ...actuators import Drivetrain
from ...common.errors import SealegsError
from ...envs.described.as_robot import as_robot
from ...envs.described.model_drives import ModelDrive
from ...envs.described.model_file import ModelFile
from ...envs.described.robot_described import FileJoint, RobotFile
from ...envs.engine.model_poses import keyframes, stand, standing
from ...envs.extended import Extended
from ..load.robot import robot_of
from ..load.tree import NEGLIGIBLE_SIZE
from ..log.types import MeasuredSet
from .mjcf import native_text, not_native

FILE = "extended.xml"


def write_robot(extended: Extended, data: MeasuredSet, folder: Path, final: Path | None = None) -> Path | None:
    """Write the model with friction, damping, armature, masses, inertias, stops and actuators as they were found.

    Actuators have the file's names and control ranges, as far as these are of goals; its keyframes are kept. Meshes
    stay where they are, and their paths lead there from the folder that it is in at last.

    Args:
        extended: what was found.
        data: the log.
        folder: to write into.
        final: that the folder's content is moved to; None: it stays.

    Returns:
        The path; None for the collection's own robots, and where what was found does not go into the model.
    """
    robot = robot_of(data.runs[0])
    if robot is None:
        return None
    machine = as_robot(robot.file)
    try:
        chains = extended.chains_on(machine)
        drivetrain = machine.drivetrain(chains, extended.params_on(machine))
    except SealegsError:  # the folder's own message says so where it is applied
        return None
    source = robot.file.model.path
    _name_whole_paths(drivetrain.spec, drivetrain.model, source.parent)
    written = _Written(robot.file, drivetrain, final or folder)
    note = (
        f"{source.name} as diagnosed, for plain MuJoCo; controls are position goals, or torques where the log commands "
        f"torques. Left out: {'; '.join(written.left) or 'nothing'}."
    )
    if written.changed:
        note += f" Otherwise than in {source.name}: {'; '.join(written.changed)}."
    note = note.replace("--", "- -")  # which would end the comment
    path = folder / FILE
    path.write_text(f"<!-- {note} -->\n{written.text()}", encoding="utf-8")
    return path


class _Written:
    """A model as text, and what of its file is left out in it or means something else, a phrase each."""

    def __init__(self, file: RobotFile, drivetrain: Drivetrain, folder: Path) -> None:
        self._file, self._drivetrain = file, drivetrain
        self._full = file.model.with_actuators()
        self._controls = FileControls(self._full)
        self._root = ElementTree.fromstring(native_text(drivetrain.spec.to_xml(), drivetrain.chains))
        _lead_from(self._root, folder)
        missing = {name: left for name, chain in drivetrain.chains.items() if (left := not_native(chain))}
        self.left = [f"{name}: {', '.join(left)}" for name, left in missing.items()]
        self.changed: list[str] = []
        joints = {item.name: item for item in file.joints}
        actuators = self._root.find("actuator")
        self._actuators = [] if actuators is None else [(joints[row.attrib["name"]], row) for row in actuators]
        for item, row in self._actuators:
            self._name(item, row)
            self._limit(item, row)
        self._leave_out_actuators()
        self._put_keyframes_back()

    def text(self) -> str:
        """The model."""
        ElementTree.indent(self._root)
        return ElementTree.tostring(self._root, encoding="unicode") + "\n"

    def _by_torque(self, item: FileJoint) -> bool:
        return self._drivetrain.chains[item.name].find("torque_command") is not None

    def _name(self, item: FileJoint, row: ElementTree.Element) -> None:
        """Call an actuator as the file does, and tell where its control means something else there."""
        drive = drive_of(self._file.model, item)
        if drive is None:
            return
        if len(drive.actuators) != 1:
            self.changed.append(f"{item.name} acts for {', '.join(drive.actuators)}")
            return
        (name,) = drive.actuators
        if all(row is other or other.attrib["name"] != name for _, other in self._actuators):
            row.set("name", name)
        if not self._controls.same(drive, self._by_torque(item)):
            what = "torque" if self._by_torque(item) else "position goal"
            self.changed.append(f"the control of {row.attrib['name']} is a {what} of {item.name}")

    def _limit(self, item: FileJoint, row: ElementTree.Element) -> None:
        """Give an actuator the control range of the file's, where that is one of goals too, or that of its goals."""
        drive, ends = drive_of(self._file.model, item), None
        if self._by_torque(item):
            ends = None if drive is None else self._controls.torques(drive)
        else:
            ends = goals = item.range
            if drive is not None and drive.goals is not None:
                low, high = drive.goals
                if max(low, goals[0]) < min(high, goals[1]):  # else it is in another unit
                    ends = drive.goals
        if ends is not None:
            row.set("ctrllimited", "true")
            row.set("ctrlrange", _row(ends))

    def _leave_out_actuators(self) -> None:
        drives = [drive_of(self._file.model, item) for item, _ in self._actuators]
        kept = {name for drive in drives if drive is not None for name in drive.actuators}
        gone = [name for name in self._controls.names if name not in kept]
        sensed = mujoco.mjtObj.mjOBJ_ACTUATOR
        sensors = [item.name or "one without a name" for item in self._full.sensors if item.objtype == sensed]
        for what, names in (("actuator", gone), ("sensor of an actuator", sensors)):
            if names:
                self.left.append(f"{what}: {', '.join(names)}")

    def _put_keyframes_back(self) -> None:
        """Write the file's keyframes, with the joints that chains add, and with goals as controls."""
        bare, model = self._file.model.spec().compile(), self._drivetrain.model
        other = [key.name or "one without a name" for key in self._full.keys if len(key.qpos) != bare.nq]
        if other:
            self.left.append(f"keyframe of another size: {', '.join(other)}")
        if not (kept := keyframes(self._full, bare)):
            return
        parent = ElementTree.SubElement(self._root, "keyframe")
        for key in kept:
            qpos = np.array(model.qpos0)
            stand(model, standing(bare, np.array(key.qpos)), qpos)
            for item in self._drivetrain.coordinates:
                self._drivetrain.set_position(item.name, qpos, self._drivetrain.position(item.name, qpos, "link"))
            row = {"name": key.name} if key.name else {}
            row |= {"time": f"{key.time:.9g}"} if key.time else {}
            row["qpos"] = _row(qpos)
            row |= {name: _row(values) for name in ("mpos", "mquat") if len(values := getattr(key, name))}
            controls = np.array(key.ctrl, dtype=float)
            if self._actuators and len(controls) == self._controls.count:
                row["ctrl"] = _row([self._control(item, controls, qpos) for item, _ in self._actuators])
            ElementTree.SubElement(parent, "key", row)
            for word, values in (("speeds", key.qvel), ("activations", key.act)):
                if np.any(np.array(values)):
                    self.left.append(f"{word} of keyframe {key.name}")

    def _control(self, item: FileJoint, controls: np.ndarray, qpos: np.ndarray) -> float:
        """The control that asks for what those of the file ask for, or else for where a keyframe stands."""
        drive = drive_of(self._file.model, item)
        if self._by_torque(item):
            asked = None if drive is None else self._controls.torque(drive, controls)
            return 0.0 if asked is None else asked
        asked = None if drive is None else self._controls.goal(drive, controls)
        return float(self._drivetrain.position(item.name, qpos, "link")) if asked is None else asked


def _row(values: object) -> str:
    return " ".join(f"{value:.9g}" for value in np.ravel(np.asarray(values, dtype=float)))


def _name_whole_paths(spec: mujoco.MjSpec, model: mujoco.MjModel, folder: Path) -> None:
    """Name files of meshes, height fields, skins and textures by whole paths, by which they are found from anywhere.

    Args:
        spec: of the model; it is changed.
        model: compiled from it, which knows where each file was found, those of attached models too.
        folder: of the model.
    """
    for key in ("meshdir", "texturedir"):  # for the six files of a cube's texture, which the compiled model forgets
        setattr(spec, key, str((folder / (getattr(spec, key) or "")).resolve()))
    for items, addresses in (
        (spec.meshes, model.mesh_pathadr),
        (spec.hfields, model.hfield_pathadr),
        (spec.skins, model.skin_pathadr),
        (spec.textures, model.tex_pathadr),
    ):
        for item in items:
            if (start := int(addresses[item.id])) >= 0:
                name = model.paths[start:].split(b"\0", 1)[0].decode()
                item.file = str((folder / name).resolve())


def _lead_from(root: ElementTree.Element, folder: Path) -> None:
    """Let whole paths of a model lead to the same files from the folder that it is in, wherever both are moved."""
    bases = {}
    for compiler in root.iter("compiler"):
        for key in {"meshdir", "texturedir", "assetdir"} & compiler.attrib.keys():
            bases[key] = compiler.attrib[key]
            compiler.set(key, _from(bases[key], folder.resolve()))
    for item in (item for asset in root.iter("asset") for item in asset):
        base = bases.get("texturedir" if item.tag == "texture" else "meshdir", bases.get("assetdir"))
        if Path(name := item.attrib.get("file", "")).is_absolute():
            item.set("file", _from(name, folder.resolve() if base is None else Path(base)))


def _from(path: str, folder: Path) -> str:
    """A path as it is reached from a folder."""
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # on another drive
        return path


# --- controls of the file, as goals or torques of a joint ------------------------------------------------------------


class FileControls:
    """The controls of the actuators of a model file.

    Attributes:
        names: of the actuators; of one without a name, what it acts on.
        count: of controls.
    """

    def __init__(self, full: mujoco.MjSpec) -> None:
        """Of the specification as the file has it, which is left as it is."""
        spec = full.copy()
        for key in list(spec.keys):  # of another size than the model, they would stop the compiler
            spec.delete(key)
        self._model = spec.compile()
        self.count = len(self._model.actuator_ctrlrange)
        self.names = [actuator.name or actuator.target for actuator in spec.actuators]

    def goal(self, drive: ModelDrive, controls: np.ndarray) -> float | None:
        """Where controls of all actuators ask a driven coordinate to be [rad or m]; None: they say no position."""
        if drive.stiffness <= 0.0 or (force := self._force(drive, controls)) is None:
            return None
        return force / drive.stiffness

    def torque(self, drive: ModelDrive, controls: np.ndarray) -> float | None:
        """The torque or force that controls of all actuators ask for [N.m or N]; None: they ask for none."""
        return self._force(drive, controls) if drive.motor else None

    def torques(self, drive: ModelDrive) -> tuple[float, float] | None:
        """Lowest and highest torque or force that the control ranges of motors allow [N.m or N]; None: any."""
        addresses = [int(self._model.actuator_ctrladr[number]) for number in self._numbers(drive)]
        if not drive.motor or not all(self._model.actuator_ctrllimited[at] for at in addresses):
            return None
        ends = [np.zeros(self.count) for _ in range(2)]
        for number, at in zip(self._numbers(drive), addresses, strict=True):
            low, high = self._model.actuator_ctrlrange[at]
            ends[0][at], ends[1][at] = (low, high) if self._gain(number) > 0.0 else (high, low)
        low, high = (self._force(drive, end) for end in ends)
        return None if low is None or high is None else (low, high)

    def same(self, drive: ModelDrive, torque: bool) -> bool:
        """Whether a control of the file's one actuator is the goal, or the torque, that it asks for."""
        if len(self._numbers(drive)) > 1:
            return False
        for control in (0.0, 1.0):
            controls = np.full(self.count, control)
            asked = self.torque(drive, controls) if torque else self.goal(drive, controls)
            if asked is None or not math.isclose(asked, control, abs_tol=NEGLIGIBLE_SIZE):
                return False
        return True

    def _numbers(self, drive: ModelDrive) -> list[int]:
        return [number for number, name in enumerate(self.names) if name in drive.actuators]

    def _gain(self, number: int) -> float:
        model = self._model
        return float(model.actuator_gear[int(model.actuator_outadr[number]), 0] * model.actuator_gainprm[number, 0])

    def _force(self, drive: ModelDrive, controls: np.ndarray) -> float | None:
        """Force of controls on a coordinate at 0 [N.m or N]; None: it hangs on more than these."""
        if drive.tied:  # forces of some act on another joint
            return None
        model, total = self._model, 0.0
        for number in self._numbers(drive):
            fixed = int(model.actuator_gaintype[number]) == int(mujoco.mjtGain.mjGAIN_FIXED)
            if not fixed or int(model.actuator_dyntype[number]) == int(mujoco.mjtDyn.mjDYN_INTEGRATOR):
                return None
            total += self._gain(number) * float(controls[int(model.actuator_ctrladr[number])])
            if int(model.actuator_biastype[number]) == int(mujoco.mjtBias.mjBIAS_AFFINE):
                gear = float(model.actuator_gear[int(model.actuator_outadr[number]), 0])
                total += gear * float(model.actuator_biasprm[number, 0])
        return total


def drive_of(model: ModelFile, item: FileJoint) -> ModelDrive | None:
    """What actuators of the file make of a driven coordinate; None where they do not drive it."""
    return next((d for d in model.drives if d.name in (item.name, item.joint) and d.terms == item.terms), None)
