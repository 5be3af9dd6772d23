"""The YAML beside a measured log: which robot, with which parameters, driven by which actuation chains."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import yaml

from ...actuators.published import PREFIX
from ...common.documents import DocumentError, read_yaml
from ...common.errors import nearest
from ...envs.described.model_sources import files_read
from ...envs.described.robot_file import is_robot_file
from .types import LogError

FOLDER_DEFAULTS = "log.yaml"
"""Sidecar whose keys hold for every log of its folder that does not say otherwise."""

DESCRIPTIVE_KEYS = ("group", "units", "sample_clock", "machine", "source", "licence", "date", "notes")
KEYS = ("robot", "robot_params", "actuators", "meta", *DESCRIPTIVE_KEYS)
MAPPINGS = ("robot_params", "actuators", "meta", "units")


@dataclass(frozen=True)
class Sidecar:
    """What a sidecar says; see `MeasuredRun` for the meaning of each field."""

    robot: str
    robot_params: dict[str, float] = field(default_factory=dict)
    actuators: dict[str, str | list] = field(default_factory=dict)
    meta: dict[str, Any] = field(default_factory=dict)


def read_sidecar(log: Path) -> Sidecar:
    """Read the sidecar of the log file ``log``, on top of its folder's ``log.yaml`` where there is one.

    Raises:
        LogError: no sidecar, bad YAML, an unknown key or a value of the wrong kind.
    """
    own = next((path for path in (log.with_suffix(".yaml"), log.with_suffix(".yml")) if os.path.isfile(path)), None)
    folder = log.parent / FOLDER_DEFAULTS
    sources = [path for path in dict.fromkeys((folder, own)) if path is not None and os.path.isfile(path)]
    if not sources:
        raise LogError(
            f"{log}: its sidecar {log.with_suffix('.yaml').name} is missing; write one with robot, robot_params "
            f"and actuators (or one {FOLDER_DEFAULTS} for the whole folder)"
        )
    merged: dict[str, Any] = {}
    for path in sources:
        for key, value in _load_mapping(path).items():
            both = isinstance(value, dict) and isinstance(merged.get(key), dict)
            merged[key] = merged[key] | value if both else value
    found = checked_sidecar(merged, sources[-1])
    chains = {joint: _chain_beside(chain, log.parent) for joint, chain in found.actuators.items()}
    return replace(found, robot=robot_beside(found.robot, log.parent), actuators=chains)


def files_named(sidecar: Sidecar) -> tuple[Path, ...]:
    """The files of a robot and of its chains that a sidecar names, with all that these read in turn."""
    return files_read([sidecar.robot, *(chain for chain in sidecar.actuators.values() if isinstance(chain, str))])


def robot_beside(robot: str, folder: Path) -> str:
    """The path of a robot's file that is named as it lies beside the log; any other robot as it is."""
    path = Path(robot)
    if not is_robot_file(path) or path.is_absolute():
        return robot
    return str((folder / path).resolve() if os.path.isfile(folder / path) else path)


def named_beside(sidecar: Sidecar, folder: Path) -> Sidecar:
    """The sidecar as it is written into a folder: files are named as they lie beside it, so that both may be moved."""
    chains = {
        joint: beside(chain, folder) if isinstance(chain, str) else chain for joint, chain in sidecar.actuators.items()
    }
    return replace(sidecar, robot=relative_robot(sidecar.robot, folder), actuators=chains)


def relative_robot(robot: str, folder: Path) -> str:
    """A robot's file as it lies beside a folder; any other robot as it is."""
    return beside(robot, folder) if is_robot_file(robot) else robot


def beside(name: str, folder: Path) -> str:
    """A file of a robot, a chain or a published fit as its path from a folder; a name as it is."""
    prefix = PREFIX if name.startswith(PREFIX) else ""
    path = Path(name.removeprefix(prefix))
    if not (path.is_absolute() or os.path.isfile(path)):
        return name
    try:
        return f"{prefix}{Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()}"
    except ValueError:  # another drive
        return name


def _chain_beside(chain: str | list, folder: Path) -> str | list:
    """The path of a chain's file or published fit that is named as it lies beside the log; any other as it is."""
    if not isinstance(chain, str):
        return chain
    prefix = PREFIX if chain.startswith(PREFIX) else ""
    path = folder / chain.removeprefix(prefix)
    file = bool(prefix) or path.suffix in (".yaml", ".yml")
    return f"{prefix}{path.resolve()}" if file and os.path.isfile(path) else chain


def sidecar_text(sidecar: Sidecar) -> str:
    """Return the YAML that `read_sidecar` reads back as ``sidecar``."""
    content: dict[str, Any] = {"robot": sidecar.robot}
    content["robot_params"] = dict(sidecar.robot_params)
    content["actuators"] = dict(sidecar.actuators)
    content |= {key: sidecar.meta[key] for key in DESCRIPTIVE_KEYS if key in sidecar.meta}
    other = {key: value for key, value in sidecar.meta.items() if key not in DESCRIPTIVE_KEYS}
    if other:
        content["meta"] = other
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True)


def _load_mapping(path: Path) -> dict[str, Any]:
    try:
        content = read_yaml(path)
    except DocumentError as error:
        raise LogError(f"{path}: {error.problem}; correct it") from None
    if not isinstance(content, dict):
        raise LogError(f"{path}: must be a mapping with the keys robot, robot_params and actuators")
    return content


def checked_sidecar(content: Mapping[str, Any], path: str | Path) -> Sidecar:
    """A sidecar from its plain form.

    Raises:
        LogError: an unknown key or a value of the wrong kind; the message names ``path``.
    """
    robot = content.get("robot")
    if robot is None and "robot" in content:
        raise LogError(
            f"{path}: robot is left open, in it or in the {FOLDER_DEFAULTS} beside it; fill in the robot, for example "
            "robot: bench"
        )
    found = checked_parts(content, path)
    if not found.robot:
        raise LogError(f"{path}: the key robot must name the robot, for example robot: bench, not {robot!r}")
    return found


def check_keys(content: Mapping[str, Any], keys: Sequence[str], where: str, advice: str = "") -> None:
    """Refuse keys that are not known; the message names the nearest."""
    for key in content:
        if key not in keys:
            advice = advice or f"there are {', '.join(keys)}."
            raise LogError(f"{where}: unknown key '{key}'{nearest(str(key), keys)}; {advice}")


def checked_kinds(content: Mapping[str, Any], path: str | Path) -> None:
    """Refuse what no sidecar is, whatever numbers and words it may still take from a recording.

    Raises:
        LogError: an unknown key, or a value of the wrong kind; the message names ``path``.
    """
    check_keys(content, KEYS, str(path), "put descriptions of your own under the key meta")
    robot = content.get("robot")
    if robot is not None and (not isinstance(robot, str) or not robot):
        raise LogError(f"{path}: the key robot must name the robot, for example robot: bench, not {robot!r}")
    for key in MAPPINGS:
        if not isinstance(content.get(key) or {}, dict):
            raise LogError(f"{path}: the key {key} must be a mapping, not {content[key]!r}")
    if not isinstance((content.get("meta") or {}).get("units") or {}, dict):
        raise LogError(f"{path}: the key units must be a mapping, not {content['meta']['units']!r}")
    for joint, chain in (content.get("actuators") or {}).items():
        if not isinstance(chain, str | list) or not chain:
            raise LogError(f"{path}: actuators.{joint} must be a chain name or a list of stages, not {chain!r}")


def checked_parts(content: Mapping[str, Any], path: str | Path) -> Sidecar:
    """A sidecar from its plain form, whose robot may still be open, and is then the empty word.

    Raises:
        LogError: an unknown key or a value of the wrong kind; the message names ``path``.
    """
    checked_kinds(content, path)
    params = {
        str(name): _number(value, f"{path}: robot_params.{name}")
        for name, value in (content.get("robot_params") or {}).items()
    }
    actuators: dict[str, str | list] = {str(joint): chain for joint, chain in (content.get("actuators") or {}).items()}
    meta = {key: content[key] for key in DESCRIPTIVE_KEYS if content.get(key) is not None}
    return Sidecar(content.get("robot") or "", params, actuators, meta | (content.get("meta") or {}))


def _number(value: Any, where: str) -> float:
    # PyYAML reads 1e-3 (no dot) as text, so text that spells a number is taken as one.
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise LogError(f"{where} must be a finite number, not {value!r}")
    return number
