"""LeRobot data sets, versions 2.x and 3.0: ``meta/info.json`` says which columns of the Parquet files are what.

Of version 2.x each episode is a file, of 3.0 a file holds several; the column ``episode_index`` parts them in both.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pyarrow import ArrowInvalid, parquet

from .....common.documents import read_json
from ...types import LogError
from ..recording import Recording
from .tables import numeric_columns, read_parquet

INFO = Path("meta/info.json")
MEASURED = "observation.state"
NAMED = (MEASURED, "action", "observation.velocity", "observation.effort", "observation.current")
"""Features whose places are joints."""
FOLLOWERS = re.compile(r"(bi_)?so(100|101)?(_follower)?\Z")
"""Types of the robots on whose STS3215 LeRobot sets gains of its own at every start."""
GAINS = (
    "LeRobot sets P 16, I 0, D 32 and acceleration 254 on the servos of {}, and the chain sts3215 has the factory's P "
    "32: import with actuator= and a chain of half its gain (docs: Import a log, LeRobot's SO-100 and SO-101)"
)
"""As configure in src/lerobot/robots/so_follower/so_follower.py sets them."""


def is_lerobot(folder: Path) -> bool:
    """Whether a folder is such a data set."""
    return (folder / INFO).is_file()


def read_lerobot(folder: Path) -> list[Recording]:
    """A recording for each episode.

    Raises:
        LogError: the data set is incomplete or of a version that is not read, or says nothing of a robot's joints.
    """
    info = read_json(folder / INFO)
    if not isinstance(info, dict):
        raise LogError(f"{folder / INFO}: is no mapping; download it again.")
    version = str(info.get("codebase_version", ""))
    if not re.match(r"v?[23]\.", version):
        raise LogError(f"{folder / INFO}: the data set is of version {version or 'unknown'}; 2.x and 3.x are read.")
    if not (files := sorted((folder / "data").rglob("*.parquet"))):
        raise LogError(f"{folder}: has no Parquet file under data/; download the data set whole (no video is needed).")
    features = info.get("features") or {}
    numbers = {name for name in features if str(features[name].get("dtype", "")).startswith(("float", "int", "bool"))}
    if MEASURED not in numbers:
        raise LogError(f"{folder}: has no '{MEASURED}', so it says nothing of a robot's joints.")
    named = [name for name in NAMED if name in numbers]
    robot = str(info.get("robot_type") or "")
    notes = [
        "timestamps are the frame's number over the frame rate, not read from a clock",
        *([GAINS.format(robot)] if FOLLOWERS.match(robot) else []),
    ]
    table: Any = pd.concat([_file(path, named) for path in files], ignore_index=True)
    facts: dict[str, float | str] = {"fps": float(info.get("fps") or 0.0), "robot_type": robot}
    return [
        Recording(f"episode_{int(number):06d}", _columns(own, features), folder, "lerobot", facts, notes=tuple(notes))
        for number, own in table.groupby("episode_index")
    ]


def _file(path: Path, named: list[str]) -> pd.DataFrame:
    """The columns of a file that are of joints, with their time and episode."""
    try:
        there = parquet.read_schema(path).names
    except (ArrowInvalid, OSError):
        raise LogError(f"{path}: is not a Parquet file, or a damaged one; download it again.") from None
    for needed in ("timestamp", "episode_index"):
        if needed not in there:
            raise LogError(f"{path}: has no column '{needed}', which every LeRobot data set has.")
    return read_parquet(path, [name for name in (*named, "timestamp", "episode_index") if name in there])


def _columns(table: Any, features: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Columns of an episode, those of features by the names of their places."""
    cells = numeric_columns(table.sort_values("timestamp").drop(columns="episode_index")).columns
    out, measured = {"timestamp": cells.pop("timestamp")}, _names(features[MEASURED])
    for name, values in cells.items():
        feature, _, place = name.partition("[")
        index = int(place[:-1] or 0)
        called = _names(features.get(feature, {}))
        called = called if index < len(called) else measured
        out[f"{feature}.{called[index] if index < len(called) else f'joint{index}'}"] = values
    return out


def _names(feature: Mapping[str, Any]) -> list[str]:
    """Names of a feature's places: as it says them, or none but their count."""
    count, said = int(np.prod(feature.get("shape") or [0])), _said(feature.get("names"))
    return said if len(said) == len(set(said)) == count else [f"joint{k}" for k in range(count)]


def _said(names: Any) -> list[str]:
    """Names that stand in a list, in lists within it, within a mapping, or as a mapping to their places."""
    if isinstance(names, Mapping):
        values = list(names.values())
        if all(isinstance(value, int) for value in values):
            return [str(name) for name in sorted(names, key=lambda name: names[name])]
        return next((_said(value) for value in values), [])
    if isinstance(names, list):
        return [word for one in names for word in (_said(one) if isinstance(one, list | Mapping) else [str(one)])]
    return []
