"""Reads an MJCF or URDF into specifications: what MuJoCo refuses and what can be mended is mended, and told."""

from __future__ import annotations

import functools
from pathlib import Path

import mujoco

from ..engine.numbers import RobotError
from .model_errors import unreadable
from .model_mass import told_guessed_masses, with_total_mass
from .model_meshes import without_meshes_that_fail
from .model_sources import check_files
from .urdf_text import mended_urdf


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
    except (ValueError, RuntimeError) as error:  # a RuntimeError where memory ends
        raise RobotError(unreadable(path, error)) from None
    full.compiler.fusestatic = False  # bodies keep their names, masses and sensors
    without_meshes_that_fail(full, path, missing, said)
    with_total_mass(full, path, said)
    told_guessed_masses(full, path, said)
    bare = full.copy()
    for kind in ("keys", "sensors", "actuators"):
        for item in list(getattr(bare, kind)):
            if kind != "sensors" or item.objtype == mujoco.mjtObj.mjOBJ_ACTUATOR:
                bare.delete(item)
    return bare, full, tuple(said)
