"""Largest speeds that a URDF states for its joints, which MuJoCo does not read."""

from __future__ import annotations

import math
from pathlib import Path

from .urdf_text import urdf_root


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
