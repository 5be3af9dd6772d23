"""Impossible inertias of URDF links that stand still: they change no motion, but MuJoCo refuses the robot for them."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np

LEAST = 1e-14  # [kg.m2] principal moment that MuJoCo takes for 0
ROUNDING = 1e-12  # of a principal moment: a flat body, whose largest one is the sum of the others, is possible
ENTRIES = (("ixx", "ixy", "ixz"), ("ixy", "iyy", "iyz"), ("ixz", "iyz", "izz"))


def without_static_inertias(root: ElementTree.Element, path: Path, said: list[str]) -> None:
    """Leave out inertials that no body has, of links which fixed joints tie to the ground.

    Args:
        root: of the URDF; it is changed.
        path: of the URDF.
        said: where a sentence is added if there are such links.
    """
    parents: dict[str, tuple[str, bool]] = {}
    for joint in root.findall("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is not None and child is not None:
            parents[child.get("link", "")] = parent.get("link", ""), joint.get("type") == "fixed"
    balanced = any(item.get("balanceinertia") == "true" for item in root.findall("mujoco/compiler"))
    left = []
    for link in root.findall("link"):
        inertial = link.find("inertial")
        if inertial is not None and _stands(link.get("name", ""), parents) and _impossible(inertial, balanced):
            link.remove(inertial)
            left.append(f"'{link.get('name', '')}'")
    if left:
        said.append(
            f"{path.name}: no body has the inertia of {', '.join(left)}; it is left out with the mass, which changes "
            "nothing while the base is fixed."
        )


def _stands(name: str, parents: dict[str, tuple[str, bool]]) -> bool:
    """Whether no joint moves a link, from its name and that of each link's parent with whether it is fixed there."""
    seen = set()
    while name in parents and name not in seen:
        seen.add(name)
        name, fixed = parents[name]
        if not fixed:
            return False
    return True


def _impossible(inertial: ElementTree.Element, balanced: bool) -> bool:
    """Whether MuJoCo refuses an inertia as it is written down, by whether it is asked to even principal moments out."""
    item = inertial.find("inertia")
    if item is None:
        return False
    try:
        matrix = np.array([[float(item.get(entry, 0.0)) for entry in row] for row in ENTRIES])
    except ValueError:  # reading the robot says it
        return False
    if not np.isfinite(matrix).all() or not matrix.any():  # of none at all, MuJoCo says nothing
        return False
    small, middle, large = np.linalg.eigvalsh(matrix)
    return bool(small < LEAST or (not balanced and small + middle < (1.0 - ROUNDING) * large))
