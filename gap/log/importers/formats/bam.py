"""Recordings of BAM (github.com/Rhoban/bam): one JSON for each run of a servo with a pendulum on its shaft."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from .....common.documents import RECORDING, DocumentError, read_json
from ...types import Array, LogError
from ..recording import Recording, plain_facts

JOINT = "servo"
OWN = frozenset(["mass", "arm_mass", "length", "kp", "vin", "motor", "trajectory"])
"""What its recorders say of a run, beside the entries."""
OF_UNITS = ("unit", "units")
"""Keys with which a file says the unit of its columns, one for all of its angles or by their names."""
ROLES = {
    "timestamp": "time",
    "goal_position": f"{JOINT}.goal",
    "position": f"{JOINT}.position",
    "speed": f"{JOINT}.velocity",
    "input_volts": f"{JOINT}.voltage",
    "temp": f"{JOINT}.temperature",
    "measured_current": f"{JOINT}.current",
    "torque_enable": f"{JOINT}.enabled",
}
"""What its recorders write (bam/*/record.py): SI units, angles in rad with 0 hanging, the supply in V."""


def is_bam(content: Any) -> bool:
    """Whether the content of a JSON file is such a recording."""
    if not isinstance(content, dict) or not isinstance(content.get("entries"), list):
        return False
    return not OWN.isdisjoint(content) and content.keys().isdisjoint(OF_UNITS)  # all of its units are fixed


def read_bam(path: Path) -> list[Recording]:
    """The one recording of a file.

    Raises:
        LogError: it is no such file, or its entries are no mappings.
    """
    try:
        content = read_json(path, RECORDING)
    except DocumentError as error:
        raise LogError(f"{path}: {error.problem}.") from None
    if not is_bam(content):
        raise LogError(
            f"{path}: is no recording: a JSON file with the list 'entries', one a sample, and a key such as mass or "
            "motor is expected."
        )
    entries = content["entries"]
    if not entries or not all(isinstance(entry, dict) for entry in entries):
        raise LogError(f"{path}: 'entries' has no samples; record it again.")
    columns: dict[str, Array] = {}
    left: dict[str, str] = {}
    notes: list[str] = []
    for name in dict.fromkeys(name for entry in entries for name in entry):
        lacking = [k for k, entry in enumerate(entries, 1) if name not in entry]
        cells = [entry.get(name) for entry in entries]
        try:
            columns[name] = np.array([np.nan if cell is None else cell for cell in cells], np.float64)
        except (TypeError, ValueError):
            left[name] = "words or lists, where a column has a number in each entry"
            continue
        if lacking:
            count = f"{len(lacking)} of {len(entries)} entries, the first is entry {lacking[0]}"
            notes.append(f"'{name}' is missing in {count}; its cells are empty there")
    roles = {name: role for name, role in ROLES.items() if name in columns}
    units = dict.fromkeys(("goal_position", "position"), "rad") | {
        "speed": "rad/s",
        "timestamp": "s",
        "measured_current": "A",
    }
    facts = plain_facts(content)
    units = {name: unit for name, unit in units.items() if name in columns}
    return [Recording(path.stem, columns, path, "bam", facts, roles, tuple(notes), units, left)]
