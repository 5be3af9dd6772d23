"""A column of a foreign file with what its name and its format say of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..types import Array
from .expression import names_in
from .names import Said
from .recording import Recording

VAGUE = ("motor", "servo", "joint", "axis", "arm", "pendulum", "robot")
"""Words that name no joint where there is only one."""


@dataclass(frozen=True)
class Column:
    """A column of the file.

    Attributes:
        name: in the file.
        said: what its name says.
        unit: by its format or its name.
        how: who says so, for people.
        by_format: whether the format says what it is.
        rest: word of its name that names neither its joint nor anything else that is known.
    """

    name: str
    said: Said
    unit: str
    how: str
    by_format: bool
    rest: str = ""


def span(values: Array) -> float:
    """How far a column reaches, -1 where it has no value."""
    finite = values[np.isfinite(values)]
    return float(np.ptp(finite)) if len(finite) else -1.0


def without_doubt(unit: str) -> str:
    """A unit that is said; empty where the format leaves it open."""
    return "" if unit == "?" else unit


def plain(joint: str) -> str:
    """A joint's name without words that name none."""
    return "" if joint in VAGUE else joint


def taken(text: str, recording: Recording) -> list[str]:
    """Columns of a recording that an expression takes."""
    return [name for name in names_in(text) if name in recording.columns]
