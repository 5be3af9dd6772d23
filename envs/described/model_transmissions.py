"""Mechanical reductions that a URDF states in its transmissions, which MuJoCo does not read."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable
from pathlib import Path

from .urdf_text import urdf_root

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
