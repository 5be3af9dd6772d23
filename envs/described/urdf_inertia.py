"""Inertias of a URDF that no body has, for which MuJoCo refuses the robot: the nearest possible takes their place."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np

from ...common.errors import WARNING

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
