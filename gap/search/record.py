"""What a search saw and had to decide on, without the data: enough to decide again with other thresholds.

Written by ``python -m benchmarks.hidden``, read by ``python -m benchmarks.sensitivity``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...common.atomic import write_text
from ...common.documents import read_json

DIGITS = 9
TOGETHER = " with "
"""Between the names of two causes that are tried in the place of one (:mod:`.pairs`)."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """One fitted variant of a cause, on data that the fit did not see.

    Attributes:
        name: of the cause.
        number: whether the cause is a wrong number of the nominal model, not a missing effect.
        parameters: how many the variant turns.
        usual: whether it acts as the cause usually does (:attr:`sealegs.gap.causes.cause.Cause.variants`).
        blocks: loss of each block under the fit that did not see it (b,).
        sampled: loss per value of what is judged sample by sample.
        distances: of the first parameter from doing nothing in the two parts, in parts of its scale.
        scale: that of a number that is moved as a logarithm, so relative; 1 of others: in parts of a typical change.
        contradicted: share of the samples that contradict the cause.
        values: of all parameters in the fits to the two parts.
        excess: loss per value beyond that of the noise with it; NaN where it was not asked.
        limit: the cause that it cannot be told from in poorer data; empty where there is none.
    """

    name: str
    number: bool
    parameters: int
    usual: bool
    blocks: np.ndarray
    sampled: float
    distances: tuple[float, float]
    scale: float
    contradicted: float
    values: tuple[Mapping[str, float], Mapping[str, float]]
    excess: float = float("nan")
    limit: str = ""

    @property
    def flexibility(self) -> int:
        """Parameters that it is charged for; a missing effect counts as one more than a wrong number."""
        return self.parameters + (not self.number)


@dataclass(frozen=True, eq=False)
class RoundRecord:
    """One round of the forward selection.

    Attributes:
        counts: judged values per block (b,).
        before: loss of each block without any of the candidates (b,).
        sampled: loss per value of what is judged sample by sample, without any of them.
        excess: loss per value beyond that of the noise when the round began.
        left: the same with the baseline refitted from the winner's optimum.
        promise: loss per value that the screen promised to remove; NaN where the search ended before it.
        candidates: all variants that were fitted, in the order of their rough costs; none where the search ended.
        led: whether they are causes that one run of many had shown before.
        barred: names of candidates in whose place another stands already, so that they are no more than rivals.
    """

    counts: np.ndarray
    before: np.ndarray
    sampled: float
    excess: float
    left: float
    promise: float
    candidates: tuple[Evidence, ...]
    led: bool = False
    barred: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Step:
    """A round of the search that was run, and what it decided.

    Attributes:
        round: what it decided on.
        winner: name of the cause that it accepted; None: of none.
        place: number of the accepted cause that it asked about beside all others (:mod:`.exchange`), in whose place the
            winner then stands; None: of a further cause.
    """

    round: RoundRecord
    winner: str | None = None
    place: int | None = None


@dataclass(frozen=True, eq=False)
class SearchRecord:
    """All rounds of a search in the order in which they were run, and the seed of its resampling."""

    seed: int
    steps: tuple[Step, ...]

    @property
    def last(self) -> Step:
        """The last step that sought a further cause."""
        return next(step for step in reversed(self.steps) if step.place is None)


def to_dict(record: SearchRecord) -> dict[str, Any]:
    """The record as plain numbers, lists and dictionaries."""
    return {
        "seed": record.seed,
        "steps": [{"round": _round(step.round), "winner": step.winner, "place": step.place} for step in record.steps],
    }


def from_dict(document: Mapping[str, Any]) -> SearchRecord:
    """The record that :func:`to_dict` wrote."""
    steps = tuple(Step(_read_round(step["round"]), step["winner"], step.get("place")) for step in document["steps"])
    return SearchRecord(int(document["seed"]), steps)


def save(record: SearchRecord, path: Path) -> None:
    """Write a record as JSON."""
    write_text(path, json.dumps(to_dict(record)) + "\n", replace=True)


def load(path: Path) -> SearchRecord:
    """Read a record."""
    return from_dict(read_json(path))


def _round(record: RoundRecord) -> dict[str, Any]:
    return {
        "counts": [int(count) for count in record.counts],
        "before": _numbers(record.before),
        **{key: float(getattr(record, key)) for key in ("sampled", "excess", "left", "promise")},
        "led": record.led,
        "barred": list(record.barred),
        "candidates": [
            {
                "name": c.name,
                "number": c.number,
                "parameters": c.parameters,
                "usual": c.usual,
                "blocks": _numbers(c.blocks),
                "sampled": float(c.sampled),
                "distances": _numbers(c.distances),
                "scale": c.scale,
                "contradicted": float(c.contradicted),
                "values": [{path: float(value) for path, value in part.items()} for part in c.values],
                "excess": float(c.excess),
                "limit": c.limit,
            }
            for c in record.candidates
        ],
    }


def _read_round(document: Mapping[str, Any]) -> RoundRecord:
    candidates = tuple(
        Evidence(
            **{
                **row,
                "blocks": np.array(row["blocks"]),
                "distances": tuple(row["distances"]),
                "scale": row["scale"] or 1.0,  # None of what has no relative size, in older records
                "values": tuple(row["values"]),
            }
        )
        for row in document["candidates"]
    )
    arrays = {key: np.array(document[key]) for key in ("counts", "before")}
    barred = tuple(document.get("barred", ()))
    return RoundRecord(**{**document, **arrays, "candidates": candidates, "barred": barred})


def _numbers(values: Any) -> list[float]:
    return [float(f"{value:.{DIGITS}g}") for value in values]
