"""States that controllers publish: what they command, and what stands in where a bag has no joint states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from .ros_topics import Topic

CONTROLLER, DYNAMIC = "JointTrajectoryControllerState", "DynamicJointState"
COMMANDED = ("reference", "desired")
"""Parts of the state of a controller that say what it commands: by the new and by the old definition."""
MEASURED = ("feedback", "actual")
"""Parts that say what it measured."""
POINTS = {"positions": "position", "velocities": "velocity", "effort": "effort"}
"""Fields of a point of a trajectory by those of joint states."""


def is_controller(kind: str) -> bool:
    """Whether a type is the state of a controller of trajectories."""
    return kind.rpartition("/")[2] == CONTROLLER


def is_dynamic(kind: str) -> bool:
    """Whether a type holds what joints measure by the names of their interfaces."""
    return kind.rpartition("/")[2] == DYNAMIC


def parts(name: str) -> tuple[str, str, str]:
    """Joint, part and field of a number of a controller's state, as of ``elbow.reference.positions``."""
    rest, _, field = name.rpartition(".")
    joint, _, part = rest.rpartition(".")
    return joint, part, field


def with_positions(held: Topic) -> dict[str, None]:
    """Joints whose position a topic of joint states has, in their order."""
    return dict.fromkeys(
        name.removesuffix(".position")
        for name in held.names
        if name.endswith(".position") and np.isfinite(held.column(name)).any()
    )


def feedback(topics: Mapping[str, Topic]) -> tuple[str, list[str], Topic] | None:
    """What controllers measured as messages of joint states, after a name for it and the topics that it is of.

    None where no controller says a position.

    Args:
        topics: states of controllers, by name. Where several have a joint, it is of the first.
    """
    made, used, owner = Topic(), list[str](), dict[str, str]()
    for topic, held in topics.items():
        rows = [_measured(row) for row in held.rows]
        own = with_positions(replace(held, rows=rows))
        for joint in own:
            owner.setdefault(joint, topic)
        mine = {joint for joint in own if owner[joint] == topic}
        if not mine:
            continue
        used.append(topic)
        made.times += held.times
        made.stamps += held.stamps
        made.rows += [{name: x for name, x in row.items() if name.rpartition(".")[0] in mine} for row in rows]
    if not used:
        return None
    return (f"{used[0]}/feedback" if len(used) == 1 else "/controllers/feedback"), used, made


def _measured(row: Mapping[str, float]) -> dict[str, float]:
    """What the state of a controller says that it measured, named as joint states name it."""
    found: dict[str, float] = {}
    for name, value in row.items():
        joint, part, field = parts(name)
        if joint and part in MEASURED and field in POINTS:
            found.setdefault(f"{joint}.{POINTS[field]}", value)
    return found
