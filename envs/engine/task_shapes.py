"""What a task gives, checked: arrays with one row per simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...common.errors import SealegsError
from .task import Task

ROWS = "one number per simulation (motion.link.shape[0] of them)"


def check_step(task: Task, terms: Any, failed: Any, count: int) -> None:
    """Refuse rewards and failures that are no arrays (n,).

    Raises:
        SealegsError: the task gives something else; says what, and how it is written.
    """
    name = type(task).__name__
    if not isinstance(terms, Mapping):
        raise SealegsError(f"{name}.rewards gives {_what(terms)}; it gives a dict of terms by name, {ROWS} each.")
    for term, values in terms.items():
        if not _is_row(values, count):
            raise SealegsError(
                f"{name}.rewards gives {_what(values)} as '{term}'; give an array with {ROWS}, such as "
                f"np.full({count}, 1.0)."
            )
    if not _is_row(failed, count):
        raise SealegsError(f"{name}.failed gives {_what(failed)}; give an array of bool with {ROWS}.")


def check_observation(task: Task, parts: Any, count: int, size: int) -> None:
    """Refuse observations whose parts are no arrays (n,) or (n, m), or that are not as wide as their names say.

    Raises:
        SealegsError: the task gives something else.
    """
    name = type(task).__name__
    if not isinstance(parts, Sequence):
        raise SealegsError(f"{name}.observe gives {_what(parts)}; give a list of arrays, with {ROWS} each.")
    for place, part in enumerate(parts):
        if not isinstance(part, np.ndarray) or part.ndim not in (1, 2) or len(part) != count:
            raise SealegsError(f"{name}.observe gives {_what(part)} as part {place}; give arrays with {ROWS}.")
    wide = sum(1 if part.ndim == 1 else part.shape[1] for part in parts)
    if wide != size:
        raise SealegsError(f"{name}.observe gives {wide} numbers, and observation_names names {size}; make them agree.")


def _is_row(values: Any, count: int) -> bool:
    return isinstance(values, np.ndarray) and values.shape == (count,)


def _what(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of the shape {value.shape}"
    return f"{value!r}" if isinstance(value, int | float | bool) else f"a {type(value).__name__}"
