"""Messages of one topic of a bag, and what they have in common."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ...types import Array
from .trajectories import Trajectory

LEADS_OFTEN = 0.1
"""Share of the messages of the most frequent set of joints from which another set may lead."""
GAP = 10.0
"""Periods of a field without a message over which nothing is interpolated."""


@dataclass
class Topic:
    """Messages of one topic.

    Attributes:
        kind: type of its messages.
        times: when the bag received each [s].
        stamps: of each message's own header [s], NaN where it has none.
        rows: numbers of each message by the path of their field.
        paths: trajectories, where the messages are such.
    """

    kind: str
    times: list[float] = field(default_factory=list)
    stamps: list[float] = field(default_factory=list)
    rows: list[dict[str, float]] = field(default_factory=list)
    paths: list[Trajectory] = field(default_factory=list)

    def only(self, keep: NDArray[np.bool_]) -> Topic:
        """The messages for which a flag is set."""
        kept = np.flatnonzero(keep)
        rows = [self.rows[k] for k in kept] if self.rows else []
        paths = [self.paths[k] for k in kept] if self.paths else []
        return Topic(self.kind, [self.times[k] for k in kept], [self.stamps[k] for k in kept], rows, paths)

    def is_a(self, kind: str) -> bool:
        return kind in (self.kind, self.kind.rpartition("/")[2])

    @property
    def names(self) -> list[str]:
        return list(dict.fromkeys(name for row in self.rows for name in row))

    def column(self, name: str) -> Array:
        return np.array([row.get(name, np.nan) for row in self.rows])

    def known(self, name: str, own: Array) -> tuple[Array, Array]:
        """Times [s] and values of a field where messages have it, in the order of time."""
        values = self.column(name)
        rank = np.argsort(own, kind="stable")
        rank = rank[np.isfinite(values[rank])]
        return own[rank], values[rank]

    def between(self, name: str, own: Array, at: Array) -> Array:
        """A measured field at the times of other messages, linear between its own; NaN outside of them and in gaps."""
        times, values = self.known(name, own)
        times, first = np.unique(times, return_index=True)
        if len(times) < 2:
            return np.full(len(at), np.nan)
        after = np.clip(np.searchsorted(times, at), 1, len(times) - 1)
        apart = np.diff(times)
        near = (apart[after - 1] <= GAP * np.median(apart)) | np.isin(at, times)
        return np.where(near, np.interp(at, times, values[first], left=np.nan, right=np.nan), np.nan)

    def with_positions(self) -> dict[str, None]:
        """Joints whose position it has, in their order."""
        return dict.fromkeys(
            name.removesuffix(".position")
            for name in self.names
            if name.endswith(".position") and np.isfinite(self.column(name)).any()
        )

    def leading(self) -> tuple[NDArray[np.intp], list[str]]:
        """Which messages are rows of the log, and the joints that only others name.

        Two drivers may publish on one topic, each its own joints: no message has all. The largest set leads, of equal
        ones the most frequent; rare sets do not.
        """
        sets = [frozenset(name.rpartition(".")[0] for name in row) for row in self.rows]
        counts = Counter(one for one in sets if one)
        least = LEADS_OFTEN * max(counts.values(), default=0)
        lead = max((one for one in counts if counts[one] >= least), key=lambda one: (len(one), counts[one]))
        rest = [joint for joint in dict.fromkeys(joint for one in counts for joint in sorted(one)) if joint not in lead]
        return np.flatnonzero([one == lead for one in sets]), rest
