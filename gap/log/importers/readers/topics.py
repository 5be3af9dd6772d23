"""Topics of a bag as data frames: a row a message, by the time of one clock, and a column for each of its numbers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ...types import Array
from ..clocks import in_force
from .trajectories import Trajectory

JOINT_STATE = "sensor_msgs/msg/JointState"
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
CONTROLLER, DYNAMIC = "JointTrajectoryControllerState", "DynamicJointState"
COMMAND_WORDS = ("command", "cmd", "goal", "desired", "target", "reference", "setpoint")
LISTS = ("name", "joint_names")
"""Fields that name the joints of the lists beside them."""
SKIPPED = ("header", "layout", "multi_dof_joint_names")
LEADING_SHARE = 0.1
"""Share of the messages of the most frequent set of joints from which another set may lead."""
LONGEST_GAP = 10.0
"""Periods of a field without a message over which nothing is interpolated."""


def short(topic: str) -> str:
    """A topic as names of columns begin."""
    return topic.strip("/").replace("/", ".")


def commands(topic: str) -> bool:
    """Whether a topic is called as one of commands."""
    return any(word in topic.lower() for word in COMMAND_WORDS)


def joint_of(field: str) -> str:
    """The joint of a field such as ``elbow.position``."""
    return field.rpartition(".")[0]


@dataclass(frozen=True, eq=False)
class Topic:
    """Messages of one topic, in the order of time.

    Attributes:
        kind: type of its messages.
        frame: numbers of each message by the path of their field, NaN where a message has none; its index is the time
            by the clock of the recording [s].
        paths: trajectories, where the messages are such.
    """

    kind: str
    frame: pd.DataFrame
    paths: tuple[Trajectory, ...] = ()

    @property
    def time(self) -> Array:
        return self.frame.index.to_numpy(np.float64)

    def is_a(self, kind: str) -> bool:
        return kind in (self.kind, self.kind.rpartition("/")[2])

    def with_positions(self) -> list[str]:
        """Joints whose position it has, in their order."""
        return [joint_of(name) for name in self.frame if str(name).endswith(".position")]

    def in_force(self, field: str, at: Array) -> tuple[Array, float]:
        """The value of a field that was in force over most of each sample, and how late it usually comes [s]."""
        known = self.frame[field].dropna()
        return in_force(known.index.to_numpy(np.float64), known.to_numpy(np.float64), at)

    def between(self, field: str, at: Array) -> Array:
        """A measured field at other times, linear between its messages; NaN outside of them and in gaps."""
        known: Any = self.frame[field].dropna()
        known = known[~known.index.duplicated()]
        times = known.index.to_numpy(np.float64)
        if len(times) < 2:
            return np.full(len(at), np.nan)
        after = np.clip(np.searchsorted(times, at), 1, len(times) - 1)
        apart = np.diff(times)
        near = (apart[after - 1] <= LONGEST_GAP * np.median(apart)) | np.isin(at, times)
        return np.where(near, np.interp(at, times, known.to_numpy(np.float64), left=np.nan, right=np.nan), np.nan)

    def leading(self) -> tuple[NDArray[np.bool_], list[str]]:
        """Which messages are rows of the log, and the joints that only others name.

        Two drivers may publish on one topic, each its own joints: no message has all. The largest set leads, of equal
        ones the most frequent; rare sets do not.
        """
        there: Any = self.frame.notna().T.groupby(joint_of, sort=False).any().T
        counts = there.value_counts()
        usual = counts[counts >= LEADING_SHARE * counts.max()]
        lead = np.array(max(usual.index, key=lambda one: (sum(one), usual[one])), bool)
        return (there.to_numpy() == lead).all(axis=1), list(there.columns[~lead])


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
            named = len(joints) == len(value)
            for k, number in enumerate(value):
                yield f"{joints[k]}.{path}" if named else f"{path}[{k}]", float(number)
        elif isinstance(value, list) and len(value) == len(joints) and value and hasattr(value[0], "interface_names"):
            for joint, one in zip(joints, value, strict=True):
                for name, number in zip(one.interface_names, one.values, strict=False):
                    yield f"{joint}.{name}", float(number)
        elif hasattr(value, "__dataclass_fields__"):
            yield from numbers(value, f"{path}.", joints)
