"""Messages of one topic of a bag, and what of them stands in one row: numbers by the path of their field."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...types import Array

LISTS = ("name", "joint_names")
"""Fields that name the joints of the lists beside them."""
SKIPPED = ("header", "layout", "multi_dof_joint_names")
OFTEN = 0.1
"""Share of the messages of the most frequent set of joints from which another set may lead."""
GAP = 10.0
"""Periods of a field without a message over which nothing is interpolated."""
COVERED = 0.5
"""Share of the rows that a field of other messages must reach."""


@dataclass
class Topic:
    """Numbers of one topic by the field they come from.

    Attributes:
        times: when the bag received each message [s].
        stamps: of each message's own header [s], NaN where it has none.
        rows: numbers of each message.
    """

    times: list[float] = field(default_factory=list)
    stamps: list[float] = field(default_factory=list)
    rows: list[dict[str, float]] = field(default_factory=list)

    def only(self, keep: NDArray[np.bool_]) -> Topic:
        """The messages for which a flag is set."""
        kept = np.flatnonzero(keep)
        return Topic([self.times[k] for k in kept], [self.stamps[k] for k in kept], [self.rows[k] for k in kept])

    def column(self, name: str) -> Array:
        return np.array([row.get(name, np.nan) for row in self.rows])

    def held(self, name: str, own: Array, at: Array) -> Array:
        """The last value of a field at other times, NaN before its first: a message need not name all joints."""
        times, values = self._known(name, own)
        if not len(times):
            return np.full(len(at), np.nan)
        last = np.searchsorted(times, at, side="right") - 1
        return np.where(last >= 0, values[np.maximum(last, 0)], np.nan)

    def between(self, name: str, own: Array, at: Array) -> Array:
        """A measured field at the times of other messages, linear between its own; NaN outside of them and in gaps."""
        times, values = self._known(name, own)
        times, first = np.unique(times, return_index=True)
        if len(times) < 2:
            return np.full(len(at), np.nan)
        after = np.clip(np.searchsorted(times, at), 1, len(times) - 1)
        apart = np.diff(times)
        near = (apart[after - 1] <= GAP * np.median(apart)) | np.isin(at, times)
        return np.where(near, np.interp(at, times, values[first], left=np.nan, right=np.nan), np.nan)

    def leading(self) -> tuple[NDArray[np.intp], list[str]]:
        """Which messages are rows of the log, and the joints that only others name.

        Two drivers may publish on one topic, each its own joints: no message has all. The largest set leads, of equal
        ones the most frequent; rare sets do not.
        """
        sets = [frozenset(name.rpartition(".")[0] for name in row) for row in self.rows]
        counts = Counter(one for one in sets if one)
        least = OFTEN * max(counts.values(), default=0)
        lead = max((one for one in counts if counts[one] >= least), key=lambda one: (len(one), counts[one]))
        rest = [joint for joint in dict.fromkeys(joint for one in counts for joint in sorted(one)) if joint not in lead]
        return np.flatnonzero([one == lead for one in sets]), rest

    @property
    def names(self) -> list[str]:
        return list(dict.fromkeys(name for row in self.rows for name in row))

    def _known(self, name: str, own: Array) -> tuple[Array, Array]:
        """Times [s] and values of a field where messages have it, in the order of time."""
        values = self.column(name)
        rank = np.argsort(own, kind="stable")
        rank = rank[np.isfinite(values[rank])]
        return own[rank], values[rank]


def stamp_of(message: Any) -> float:
    """Time that the header of a message says [s]; NaN where it says none."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    seconds = getattr(stamp, "sec", 0) + 1e-9 * getattr(stamp, "nanosec", 0)
    return float(seconds) if seconds > 0.0 else float("nan")


def numbers(message: Any, prefix: str = "", joints: tuple[str, ...] = ()) -> Iterator[tuple[str, float]]:
    """Numbers of a message by the path of their field; lists beside a list of joints by the joint's name.

    What joints measure by the names of their interfaces is named as joint states name it: ``elbow.position``.
    """
    fields = {
        key: getattr(message, key) for key in getattr(message, "__dataclass_fields__", {}) if not key.startswith("__")
    }
    joints = next((tuple(map(str, fields[key])) for key in LISTS if len(fields.get(key, ())) > 0), joints)
    for key, value in fields.items():
        if key in SKIPPED or key in LISTS:
            continue
        path = f"{prefix}{key}"
        if isinstance(value, bool | int | float | np.number):
            yield path, float(value)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
            named = joints if len(joints) == len(value) else [f"[{k}]" for k in range(len(value))]
            for name, number in zip(named, value, strict=True):
                yield f"{name}.{path}" if name[0] != "[" else f"{path}{name}", float(number)
        elif isinstance(value, list) and len(value) == len(joints) and value and hasattr(value[0], "interface_names"):
            for joint, one in zip(joints, value, strict=True):
                for name, number in zip(one.interface_names, one.values, strict=False):
                    yield f"{joint}.{name}", float(number)
        elif hasattr(value, "__dataclass_fields__"):
            yield from numbers(value, f"{path}.", joints)
