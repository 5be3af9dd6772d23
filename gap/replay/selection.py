"""The units of some parts of the data, and the samples that are theirs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..log.parts import Unit
from ..log.types import LogError


@dataclass(frozen=True, eq=False)
class Selection:
    """What a part keeps of a problem.

    Attributes:
        units: kept, and ``numbers`` of them among all.
        rows: their samples (k,).
        starts: first of these of each unit kept, and the end of the last (u + 1,).
    """

    units: tuple[Unit, ...]
    numbers: tuple[int, ...]
    rows: np.ndarray
    starts: np.ndarray


def select(units: Sequence[Unit], starts: np.ndarray, parts: Sequence[int]) -> Selection:
    """The units of some parts.

    Args:
        units: of the problem.
        starts: first sample of each and the end of the last (u + 1,).
        parts: that are kept.

    Raises:
        LogError: there is none.
    """
    chosen = [k for k, unit in enumerate(units) if unit.part in parts]
    if not chosen:
        raise LogError("the logs are too short to keep some for choosing and testing; record more runs or longer ones.")
    rows = np.concatenate([np.arange(starts[k], starts[k + 1]) for k in chosen])
    sizes = [starts[k + 1] - starts[k] for k in chosen]
    kept = np.concatenate([[0], np.cumsum(sizes)]).astype(int)
    return Selection(tuple(units[k] for k in chosen), tuple(chosen), rows, kept)
