"""Recordings of BAM (github.com/Rhoban/bam): one JSON for each run of a servo with a pendulum on its shaft."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from ...types import LogError
from ..recording import Recording, plain_facts

JOINT = "servo"
ROLES = {
    "timestamp": "time",
    "goal_position": f"{JOINT}.goal",
    "position": f"{JOINT}.position",
    "speed": f"{JOINT}.velocity",
    "input_volts": f"{JOINT}.voltage",
    "temp": f"{JOINT}.temperature",
    "torque_enable": f"{JOINT}.enabled",
}
"""What its recorders write (bam/*/record.py): SI units, angles in rad with 0 hanging, the supply in V."""


def is_bam(content: Any) -> bool:
    """Whether the content of a JSON file is such a recording."""
    return isinstance(content, dict) and isinstance(content.get("entries"), list)


def read_bam(path: Path) -> list[Recording]:
    """The one recording of a file.

    Raises:
        LogError: it is no such file, or its entries are no equal mappings.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise LogError(f"{path}: is not JSON: {str(error).splitlines()[0]}.") from None
    if not is_bam(content):
        raise LogError(f"{path}: is no recording: a JSON file with the list 'entries' is expected, one entry a sample.")
    entries = content["entries"]
    if not entries or not all(isinstance(entry, dict) for entry in entries):
        raise LogError(f"{path}: 'entries' has no samples; record it again.")
    columns = {}
    for name in entries[0]:
        try:
            columns[name] = np.array([np.nan if entry[name] is None else entry[name] for entry in entries], np.float64)
        except KeyError:
            raise LogError(f"{path}: not every entry has '{name}'; the recording is damaged.") from None
        except (TypeError, ValueError):
            continue  # words, such as a state
    roles = {name: role for name, role in ROLES.items() if name in columns}
    units = dict.fromkeys(("goal_position", "position"), "rad") | {"speed": "rad/s", "timestamp": "s"}
    facts = plain_facts(content)
    return [
        Recording(path.stem, columns, path, "bam", facts, roles, (), {k: v for k, v in units.items() if k in columns})
    ]
