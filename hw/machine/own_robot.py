"""The config group ``robot`` of a user's own robot: ``robot=my_arm.yaml``, ``.xml`` or ``.urdf`` in place of a name."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...common.documents import read_yaml
from ...common.errors import SealegsError, nearest
from ...configs.check import checked
from ...configs.compose import FOLDER
from ...envs.engine.numbers import RobotError
from ...envs.robots import COLLECTION, get_robot
from .assumed_limits import ASSUMED, assumed_limits

DEFAULTS = "bench"
"""Robot of ``configs/robot`` whose safety limits hold where a robot's file says nothing: those of a small servo."""


def own_robot(word: str) -> dict[str, Any]:
    """What ``configs/robot`` holds of built-in robots, from the file of a robot.

    Raises:
        SealegsError: the file is wrong, or has an unknown key under ``deploy``.
    """
    path = COLLECTION.get(word, Path(word)).absolute()
    robot = get_robot(path)
    if robot.file is None:
        raise RobotError(f"robot={word} is no file of a robot.")
    config = {**read_yaml(FOLDER / "robot" / f"{DEFAULTS}.yaml")}
    config |= {"sensors": {}, "gears": {}, "registers": {}}
    given = robot.file.deploy
    known = [key for key in config if key not in ("name", "params", "actuator")]
    for key in given:
        if key not in known:
            raise SealegsError(f"{path}: deploy.{key} is unknown{nearest(key, known)}; there are {', '.join(known)}.")
    stated = checked(f"{path}: deploy.safety", given.get("safety") or {}, dict[str, Any])
    # a trial takes a second
    trial = {} if all(key in stated for key in ASSUMED) else assumed_limits(robot.file, advised=False).limits
    assumed = {
        key: values if config["safety"][key] is None else {**values, "*": config["safety"][key]}
        for key, values in trial.items()
        if values
    }
    limits = {**config["safety"], **assumed, **stated}
    for key in limits:
        if key not in config["safety"]:
            hint = nearest(key, config["safety"])
            raise SealegsError(
                f"{path}: deploy.safety.{key} is unknown{hint}; there are {', '.join(config['safety'])}."
            )
    tables = _beside(path, given)
    imu = {} if robot.imu is None else dict(robot.imu.said)  # each key may be another on the command line
    return {
        **config,
        **given,
        **tables,
        "imu": imu,
        "name": str(path),
        "params": {},
        "actuator": None,
        "safety": limits,
    }


def _beside(path: Path, given: Mapping[str, Any]) -> dict[str, Any]:
    """Where a robot's file gives register tables of its own by their paths, those from its folder."""

    def told(row: Any) -> Any:
        if isinstance(row, Mapping) and str(row.get("servo", "")).endswith((".yaml", ".yml")):
            return {**row, "servo": str(path.parent / row["servo"])}
        return row

    found = {key: told(given)[key] for key in ("servo",) if key in given}
    buses = given.get("buses")
    return {**found, "buses": {name: told(row) for name, row in buses.items()}} if isinstance(buses, Mapping) else found


class _OwnRobots:
    """What reads them, and the names of ours that files alone describe."""

    names = tuple(COLLECTION)

    def __call__(self, word: str) -> dict[str, Any]:
        return own_robot(word)


READERS = {"robot": _OwnRobots()}
"""For :func:`sealegs.configs.compose.compose`, where a config chooses a robot."""
