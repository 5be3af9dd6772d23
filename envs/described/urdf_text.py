"""Reads the XML of a URDF as MuJoCo does, and mends its dialects.

Passed over is what belongs to other programs by a prefix. Mended are a parent ``world`` that no link declares, a
floating joint on a root link of another name, inertias that no body has, and paths of meshes. Refused is what MuJoCo
takes or drops without a word that says where it stands.
"""

from __future__ import annotations

import math
import os
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from ...common.documents import XML_SIZE, read_bytes, read_xml, without_comments
from ...common.errors import WARNING
from ..engine.numbers import RobotError

FOLDERS = ("meshdir", "assetdir")
"""Where the compiler element of a URDF says that meshes are, from the URDF's own folder."""
GROUND = "world"
NO_STOP = 1e4  # [rad or m] a range that ends beyond is written for none
MOST_TURNS = 2.0  # that a joint with limits makes between them, beyond which they may be degrees; assumed


def urdf_root(path: Path) -> ElementTree.Element:
    """The root of a URDF, without what belongs to other programs by a prefix.

    Raises:
        DocumentError: it cannot be opened, or is no XML.
    """
    root = read_xml(path)
    _without_namespaces(root)
    return root


def has_macros(path: Path) -> bool:
    """Whether xacro should have expanded elements of a URDF."""
    return b"<xacro:" in without_comments(read_bytes(path, XML_SIZE))


def _without_namespaces(root: ElementTree.Element) -> None:
    own = root.tag.partition("}")[0] + "}" if root.tag.startswith("{") else None
    for item in list(root.iter()):
        for child in [child for child in item if child.tag.startswith("{") and not child.tag.startswith(own or "}")]:
            item.remove(child)
        for key in [key for key in item.attrib if key.startswith("{")]:
            del item.attrib[key]
        if own is not None:
            item.tag = item.tag.removeprefix(own)


def mended_urdf(path: Path, said: list[str], missing: list[str]) -> str:
    """The URDF with a link ``world`` where joints need one, and paths of meshes that can be opened.

    Args:
        path: of the URDF.
        said: where a sentence is added for what was mended.
        missing: where meshes that are not there are added: MuJoCo passes over those that are only looked at.

    Raises:
        DocumentError: it cannot be opened, or is no XML.
        RobotError: a name stands twice, a mass is none, or a lower limit is above the upper one.
    """
    root = urdf_root(path)
    _named_once(root, path)
    _masses_possible(root, path)
    _limits_in_order(root, path)
    _limits_in_radians(root, path, said)
    if has_macros(path):
        said.append(
            f"{path.name} has elements of xacro, which count for nothing; expand them: xacro {path.name} > robot.urdf"
        )
    links = {link.get("name") for link in root.iter("link")}
    parents = {item.get("link") for item in root.iter("parent")}
    if GROUND in parents and GROUND not in links:
        root.insert(0, ElementTree.Element("link", {"name": GROUND}))
        said.append(f"{path.name} names a parent 'world' that it does not declare; it is taken for the ground.")
    elif GROUND not in links:
        _ground(root, path, said)
    mend_inertias(root, path, said)
    extension = root.find("mujoco")
    extension = ElementTree.SubElement(root, "mujoco") if extension is None else extension
    compiler = extension.find("compiler")
    compiler = ElementTree.SubElement(extension, "compiler") if compiler is None else compiler
    folder = mesh_folder(root)
    for mesh in root.iter("mesh"):
        file = urdf_mesh(path, mesh.get("filename", ""), folder)
        if not os.path.isfile(file):
            missing.append(file.name)
        mesh.set("filename", str(file))
    for key in FOLDERS:  # paths are whole now
        compiler.attrib.pop(key, None)
    for key, value in (("strippath", "false"), ("fusestatic", "false")):
        compiler.set(key, value)
    return ElementTree.tostring(root, encoding="unicode")


def _ground(root: ElementTree.Element, path: Path, said: list[str]) -> None:
    """Call the root link ``world`` where a floating joint hangs on it: MuJoCo takes no other for the ground."""
    children = {item.get("link") for item in root.iter("child")}
    for joint in root.findall("joint"):
        parent = joint.find("parent")
        name = None if parent is None else parent.get("link")
        if joint.get("type") != "floating" or name is None or name in children:
            continue
        for item in (*root.findall("link"), *root.iter("parent")):
            key = "name" if item.tag == "link" else "link"
            if item.get(key) == name:
                item.set(key, GROUND)
        said.append(f"{path.name}: a floating joint hangs on its root link '{name}'; that is taken for the ground.")
        return


def _named_once(root: ElementTree.Element, path: Path) -> None:
    """Refuse links and moving joints of one name.

    Raises:
        RobotError: a name stands twice.
    """
    moving = [joint for joint in root.findall("joint") if joint.get("type") != "fixed"]
    for kind, items in (("link", root.findall("link")), ("joint", moving)):
        count = Counter(name for item in items if (name := item.get("name")))
        if twice := [f"'{name}'" for name, times in count.items() if times > 1]:
            raise RobotError(
                f"{path}: more than one {kind} is called {', '.join(twice)}; give each {kind} a name of its own."
            )


def _masses_possible(root: ElementTree.Element, path: Path) -> None:
    """Refuse masses that no link has: MuJoCo takes one below 0 for none, and simulates with one that is no number.

    Raises:
        RobotError: there is one.
    """
    for link in root.findall("link"):
        if (mass := link.find("inertial/mass")) is None:
            continue
        try:
            kilograms = float(mass.get("value", "0"))
        except ValueError:  # reading the robot says it
            continue
        if not 0.0 <= kilograms < math.inf:
            raise RobotError(f"{path}: link '{link.get('name', '')}' has a mass of {kilograms:g} kg; give 0 or more.")


def _limits_in_order(root: ElementTree.Element, path: Path) -> None:
    """Refuse limits of joints that lie the wrong way round, which MuJoCo takes for none.

    Raises:
        RobotError: a lower limit is above the upper one.
    """
    reversed_ones = [
        f"'{joint.get('name', '')}' (lower {low:g}, upper {high:g})"
        for joint, low, high in _limited(root)
        if low > high
    ]
    if reversed_ones:
        raise RobotError(f"{path}: a lower limit is above the upper one at {', '.join(reversed_ones)}; exchange them.")


def _limits_in_radians(root: ElementTree.Element, path: Path, said: list[str]) -> None:
    """Ask whether limits are degrees where joints turn farther than those of robots do."""
    turns = {
        joint.get("name", ""): (high - low) / (2.0 * math.pi)
        for joint, low, high in _limited(root)
        if joint.get("type") == "revolute" and max(-low, high) < NO_STOP
    }
    if wide := [f"'{name}' ({count:.3g})" for name, count in turns.items() if count > MOST_TURNS]:
        said.append(
            f"{WARNING}{path.name}: limits let joints turn more than {MOST_TURNS:g} times round: {', '.join(wide)}; "
            "are they degrees? A URDF has radians."
        )


def _limited(root: ElementTree.Element) -> list[tuple[ElementTree.Element, float, float]]:
    """Joints that have ends, with their lower and upper limit [rad or m]; one that is left out is 0."""
    found = []
    for joint in root.findall("joint"):
        if joint.get("type") in ("revolute", "prismatic") and (limit := joint.find("limit")) is not None:
            try:
                low, high = (float(limit.get(key, "0")) for key in ("lower", "upper"))
            except ValueError:  # reading the robot says it
                continue
            found.append((joint, low, high))
    return found


def mesh_folder(root: ElementTree.Element) -> str:
    """Folder of meshes that a URDF's element for MuJoCo names; empty where it names none."""
    compilers = root.findall("mujoco/compiler")
    return next((item.get(key, "") for item in compilers for key in FOLDERS if item.get(key)), "")


def urdf_mesh(path: Path, name: str, folder: str = "") -> Path:
    """Where a file lies that a URDF names; of a package, in one of the folders that the URDF lies in.

    Args:
        path: of the URDF.
        name: of the file, as it stands there.
        folder: of meshes, from the URDF's own; files there go first.
    """
    name = name.removeprefix("file://")
    if folder:
        beside = (path.parent / folder / one for one in (Path(name).name, name))  # MuJoCo strips paths unless told
        if (found := next((place for place in beside if os.path.isfile(place)), None)) is not None:
            return found
    if name.startswith("package://"):
        inner = Path(name.removeprefix("package://"))
        tried = [place / part for place in path.parents for part in (inner, Path(*inner.parts[1:]))]
        name = str(next((place for place in tried if os.path.isfile(place)), inner))
    return path.parent / name


# --- transmissions, which MuJoCo does not read -----------------------------------------------------------------------


REDUCTIONS = ("mechanicalReduction", "mechanical_reduction")
"""Tags of ROS 1 and of ros2_control."""


def reductions(path: Path) -> dict[str, str]:
    """Reductions other than 1, as they stand in a URDF, by name of the joint; none of an MJCF."""
    if path.suffix.lower() != ".urdf":
        return {}
    found: dict[str, str] = {}
    for transmission in urdf_root(path).iter("transmission"):
        joints = transmission.findall("joint")
        inside = {id(item) for joint in joints for item in joint.iter()}
        shared = _stated(item for item in transmission.iter() if id(item) not in inside)
        for joint in joints:
            if numbers := [*_stated(joint.iter()), *shared]:
                found[joint.get("name", "")] = " and ".join(numbers)
    return found


def _stated(items: Iterable[ElementTree.Element]) -> list[str]:
    texts = ((item.text or "").strip() for item in items if item.tag in REDUCTIONS)
    return [text for text in texts if text and not _is_one(text)]


def _is_one(text: str) -> bool:
    try:
        return float(text) == 1.0
    except ValueError:
        return False


# --- largest speeds, which MuJoCo does not read ----------------------------------------------------------------------


def urdf_speeds(path: Path) -> dict[str, float]:
    """``velocity`` of the limits in a URDF, by name of the joint [rad/s or m/s]; none of an MJCF.

    0 counts as none: exporters write it where nobody knew one.
    """
    if path.suffix.lower() != ".urdf":
        return {}
    found: dict[str, float] = {}
    for joint in urdf_root(path).iter("joint"):
        limit = joint.find("limit")
        try:
            speed = float("" if limit is None else limit.get("velocity", ""))
        except ValueError:
            continue
        if math.isfinite(speed) and speed > 0.0:
            found[joint.get("name", "")] = speed
    return found


# --- inertias of a URDF that no body has, for which MuJoCo refuses the robot: the nearest possible takes their place.

SMALLEST_MOMENT = 1e-14  # [kg.m2] principal moment that MuJoCo takes for 0
FLAT_TOLERANCE = 1e-12  # of a principal moment: a flat body, whose largest one is the sum of the others, is possible
SAFE = 1e-6  # of a moment, by which one that is raised lies above the least that will do
DENSITY = 1000.0  # [kg/m3] of a ball that gives the least moment of a mass, as MuJoCo takes shapes for
ENTRIES = (("ixx", "ixy", "ixz"), ("ixy", "iyy", "iyz"), ("ixz", "iyz", "izz"))


def mend_inertias(root: ElementTree.Element, path: Path, said: list[str]) -> None:
    """Give links with an impossible inertia the nearest possible one of their mass.

    No principal moment is then below that of a solid ball, none above the sum of the others. A point's mass is
    left as it is on a link that is fixed to others.

    Args:
        root: of the URDF; it is changed.
        path: of the URDF.
        said: where a sentence is added if there are such links.
    """
    balanced = any(item.get("balanceinertia") == "true" for item in root.findall("mujoco/compiler"))
    joints = [joint for joint in root.findall("joint") if joint.get("type") == "fixed"]
    fixed = {child.get("link") for joint in joints for child in joint.findall("child")}
    mended = []
    for link in root.findall("link"):
        mass, item = link.find("inertial/mass"), link.find("inertial/inertia")
        if mass is None or item is None:
            continue
        try:
            kilograms = float(mass.get("value", "0"))
            matrix = np.array([[float(item.get(entry, 0.0)) for entry in row] for row in ENTRIES])
        except ValueError:  # reading the robot says it
            continue
        if not np.isfinite(matrix).all() or not 0.0 <= kilograms < np.inf:
            continue
        if not matrix.any() and link.get("name") in fixed:
            continue
        possible = _possible(matrix, kilograms, balanced)
        if possible is matrix:
            continue
        for row, names in enumerate(ENTRIES):
            for column, name in enumerate(names):
                item.set(name, repr(float(possible[row, column])))
        mended.append(f"'{link.get('name', '')}'")
    if mended:
        said.append(
            f"{WARNING}{path.name}: no body has the inertia of {', '.join(mended)}; the nearest possible one takes its "
            "place. Check the signs and units of its numbers."
        )


def _possible(matrix: np.ndarray, mass: float, balanced: bool) -> np.ndarray:
    """The nearest inertia (3, 3) that a body of ``mass`` [kg] has [kg.m2]; the same one, where it has it.

    Without a mass it has none.
    ``balanced``: MuJoCo is asked to even moments out where one is more than the sum of the others.
    """
    moments, axes = np.linalg.eigh(matrix)
    ball = 0.4 * mass * (3.0 * mass / (4.0 * np.pi * DENSITY)) ** (2.0 / 3.0)
    raised = moments if moments[0] >= SMALLEST_MOMENT else np.maximum(moments, max(ball, 2.0 * SMALLEST_MOMENT))
    lacking = raised[2] * (1.0 + SAFE) - raised[0] - raised[1]
    if not balanced and raised[0] + raised[1] < (1.0 - FLAT_TOLERANCE) * raised[2]:
        raised = raised + np.array([0.5, 0.5, 0.0]) * lacking
    if raised is moments:
        return matrix
    return axes @ np.diag(raised) @ axes.T if mass else np.zeros_like(matrix)
