"""Goals of trajectory messages: points laid out after the time of their message, as a controller follows them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline, make_interp_spline

from ...types import Array


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
