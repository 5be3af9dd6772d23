"""A foreign recording in memory: its columns as they are called there, and what else the file says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ....common.documents import DocumentError, read_json
from ..types import Array, LogError

LARGEST_EXACT = 2**53
"""Whole numbers beyond this one are not exact as float64."""
STRAY_SHARE = 0.01
"""Share of the samples that may be misread, or out of order, in what is sound as a whole."""
MOST_OF_THEM = 0.5
"""Share from which most of the samples, messages or seconds are of a kind, and what is said holds for all."""
FEWEST_RECORDED = 10
"""Samples of a recording at least, where others are beside it."""


class NoRecording(LogError):
    """A file without any sample: of words, empty, or with names alone. Among recordings it is left out, and told."""


@dataclass(frozen=True, eq=False)
class Recording:
    """One run as its file has it.

    Attributes:
        name: of the run, a plain file name.
        columns: by their names in the file, each of shape (n,).
        source: file it was read from.
        kind: of the file: ``table``, ``bam``, ``lerobot``, ``ros``, ``matlab``.
        facts: single numbers and words of the file or of a file beside it: mass, gains, names.
        roles: what the format itself says of a column: ``joint.signal`` or ``time`` by column name.
        notes: what the reader did, for people.
        units: what the format itself says of a column's unit, by column name.
        left: why a column of the file is none of numbers, by its name there.
        asks: question about a column of a role, or why one without is set aside, by column name.
    """

    name: str
    columns: dict[str, Array]
    source: Path
    kind: str
    facts: dict[str, float | str] = field(default_factory=dict)
    roles: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    units: dict[str, str] = field(default_factory=dict)
    left: dict[str, str] = field(default_factory=dict)
    asks: dict[str, str] = field(default_factory=dict)

    @property
    def length(self) -> int:
        """Samples."""
        return len(next(iter(self.columns.values()), ()))

    def known_names(self) -> dict[str, Any]:
        """Columns (n,) and numbers that expressions may take, with the number of the sample, ``row``."""
        numbers = {key: value for key, value in self.facts.items() if not isinstance(value, str)}
        return {"row": np.arange(self.length, dtype=np.float64), **numbers, **self.columns}


def facts_beside(path: Path) -> dict[str, float | str]:
    """Numbers and words of ``<name>.meta.json`` beside a table.

    Raises:
        LogError: it cannot be read, or is no mapping.
    """
    beside = path.with_suffix(".meta.json")
    if not beside.is_file():
        return {}
    try:
        content, fault = read_json(beside), "must be a mapping of names to numbers"
    except DocumentError as error:
        content, fault = None, error.problem
    if not isinstance(content, Mapping):
        raise LogError(f"{beside}: {fault}; correct or remove it.")
    return plain_facts(content)


def plain_facts(content: Mapping[str, Any]) -> dict[str, float | str]:
    """The entries of a mapping that are single numbers or words."""
    return {
        str(key): value if isinstance(value, str) else float(value)
        for key, value in content.items()
        if isinstance(value, int | float | str | np.integer | np.floating) and not isinstance(value, bool)
    }
