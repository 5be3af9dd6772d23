"""The dog of ``tests/robots`` with contact switches under its feet."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml
from sealegs.envs.engine.robot import Robot
from sealegs.envs.robots import get_robot

ROBOTS = Path(__file__).resolve().parent / "robots"
FEET = ("fl", "fr", "hl", "hr")
SWITCHES = {f"{leg}_foot": {"body": f"{leg}2", "threshold": 0.5} for leg in FEET}
SHIN = '<geom name="fl_shin" class="knee"/><site name="fl_sole" pos="0 0 -0.08" size="0.02"/>'


def switched_file(folder: Path, switches: dict[str, Any] | None = None, **imu: Any) -> Path:
    """Its file; other keys of ``imu`` as given."""
    model = (ROBOTS / "dog.xml").read_text()
    front = '<joint name="fl_knee" class="knee"/>'
    (folder / "dog.xml").write_text(model.replace(front + '<geom class="knee"/>', front + SHIN))
    document = yaml.safe_load((ROBOTS / "dog.yaml").read_text())
    document["imu"] |= {"switches": SWITCHES if switches is None else switches, **imu}
    path = folder / "dog.yaml"
    path.write_text(yaml.safe_dump(document))
    return path


def switched(folder: Path, switches: dict[str, Any] | None = None, **imu: Any) -> Robot:
    """The robot of :func:`switched_file`."""
    return get_robot(switched_file(folder, switches, **imu))
