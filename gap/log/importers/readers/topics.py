"""Topics of a bag as data frames: a row a message, by the time of one clock, and a column for each of its numbers.

Goals of trajectory messages are points that are laid out after the time of their message, as a controller follows them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, make_interp_spline

from ...parts import GAP_PERIODS
from ...types import Array
from ..clocks import in_force

JOINT_STATE = "sensor_msgs/msg/JointState"
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
CONTROLLER, DYNAMIC = "JointTrajectoryControllerState", "DynamicJointState"
COMMAND_WORDS = ("command", "cmd", "goal", "desired", "target", "reference", "setpoint")
LISTS = ("name", "joint_names")
"""Fields that name the joints of the lists beside them."""
SKIPPED = ("header", "layout", "multi_dof_joint_names")
LEADING_SHARE = 0.1
"""Share of the messages of the most frequent set of joints from which another set may lead."""


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
class Trajectory:
    """One message of k joints that are led through n points.

    Attributes:
        joints: names.
        after: times of the points after the start of the message [s], increasing, of shape (n,).
        positions: of the joints at the points [rad or m], of shape (n, k).
        velocities: of the joints at the points [1/s], of shape (n, k); None where not all points have some.
    """

    joints: tuple[str, ...]
    after: Array
    positions: Array
    velocities: Array | None


@dataclass(frozen=True, eq=False)
class Topic:
    """Messages of one topic, in the order of time.

    Attributes:
        kind: type of its messages.
        frame: numbers of each message by the path of their field, NaN where a message has none; its index is the time
            by the clock of the recording [s].
        paths: trajectories, where the messages are such.
        fields: what its columns are as fields of joint states, where they are called otherwise.
    """

    kind: str
    frame: pd.DataFrame
    paths: tuple[Trajectory, ...] = ()
    fields: Mapping[str, str] = field(default_factory=dict)

    @property
    def time(self) -> Array:
        return self.frame.index.to_numpy(np.float64)

    def is_a(self, *kinds: str) -> bool:
        return not {self.kind, self.kind.rpartition("/")[2]}.isdisjoint(kinds)

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
        near = (apart[after - 1] <= GAP_PERIODS * np.median(apart)) | np.isin(at, times)
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
                plain = path if len(value) == 1 else f"{path}[{k}]"
                yield f"{joints[k]}.{path}" if named else plain, float(number)
        elif isinstance(value, list) and len(value) == len(joints) and value and hasattr(value[0], "interface_names"):
            for joint, one in zip(joints, value, strict=True):
                for name, number in zip(one.interface_names, one.values, strict=False):
                    yield f"{joint}.{name}", float(number)
        elif hasattr(value, "__dataclass_fields__"):
            yield from numbers(value, f"{path}.", joints)


# --- trajectories ----------------------------------------------------------------------------------------------------


def trajectory_of(message: Any) -> Trajectory | None:
    """The points of a ``JointTrajectory`` that have positions; None where none has."""
    joints = tuple(map(str, message.joint_names))
    points, after = [], []
    for point in message.points:
        due = float(point.time_from_start.sec) + 1e-9 * float(point.time_from_start.nanosec)
        # controllers refuse points that do not come one after another
        if joints and len(point.positions) == len(joints) and (not after or due > after[-1]):
            points.append(point)
            after.append(due)
    if not points:
        return None
    smooth = all(len(point.velocities) == len(joints) for point in points)
    velocities = np.array([point.velocities for point in points], np.float64) if smooth else None
    return Trajectory(joints, np.array(after), np.array([point.positions for point in points], np.float64), velocities)


def laid_out(
    trajectories: Sequence[Trajectory], starts: Array, at: Array, measured: Mapping[str, Array]
) -> dict[str, Array]:
    """Goals by joint at the times of the samples, NaN before the first message that names the joint.

    A message takes over at its start. To its first point a joint goes from the goal that held then, at first from where
    it was measured; so does ``joint_trajectory_controller``, and a stream of messages that are replaced before their
    point is due moves the goal. Between points it goes straight, or along a cubic where they have velocities. The last
    point holds, and so does the goal of a joint that a message does not name.

    Args:
        trajectories: messages of one topic.
        starts: time of each [s].
        at: times of the samples [s], increasing.
        measured: positions of joints at the samples [rad or m].
    """
    order = np.argsort(starts, kind="stable")
    goals: dict[str, Array] = {}
    for joint in dict.fromkeys(joint for one in trajectories for joint in one.joints):
        values, before = np.full(len(at), np.nan), (np.nan, 0.0)
        for rank, k in enumerate(order):
            start = float(starts[k])
            end = float(starts[order[rank + 1]]) if rank + 1 < len(order) else np.inf
            if np.isnan(before[0]) and joint in trajectories[k].joints and joint in measured:
                before = (float(np.interp(start, at, measured[joint])), 0.0)
            first, last = np.searchsorted(at, [start, end])
            due = np.append(at[first:last], end if np.isfinite(end) else start)
            goal, slope = _followed(trajectories[k], joint, start, due, before)
            values[first:last] = goal[:-1]
            before = float(goal[-1]), float(slope[-1])
        goals[joint] = values
    return goals


def _followed(one: Trajectory, joint: str, start: float, at: Array, before: tuple[float, float]) -> tuple[Array, Array]:
    """Goal of one joint along a message that starts at a time [s], at times [s], and its slope [1/s]; before it the
    goal and slope held that are given, NaN where nothing did."""
    if joint not in one.joints:
        return np.full(len(at), before[0]), np.zeros(len(at))
    k = one.joints.index(joint)
    times, points = start + one.after, one.positions[:, k]
    slopes = None if one.velocities is None else one.velocities[:, k]
    if times[0] > start and np.isfinite(before[0]):
        times, points = np.append(start, times), np.append(before[0], points)
        slopes = None if slopes is None else np.append(before[1], slopes)
    if len(times) == 1:
        return np.where(at < times[0], np.nan, points[0]), np.zeros(len(at))
    curve = make_interp_spline(times, points, k=1) if slopes is None else CubicHermiteSpline(times, points, slopes)
    within, on_way = np.clip(at, times[0], times[-1]), (at >= times[0]) & (at < times[-1])
    return np.where(at < times[0], np.nan, curve(within)), np.where(on_way, curve(within, 1), 0.0)
