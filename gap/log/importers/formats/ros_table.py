"""The table that topics of a bag make: joint states are its rows, and commands hold their last value there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ...types import Array
from .ros_robots import Robots
from .ros_states import COMMANDED, MEASURED, parts
from .ros_topics import COVERED, Topic
from .trajectories import Trajectory, laid_out

FIELDS = {"position": "position", "velocity": "velocity", "effort": "torque"}
UNITS = {"position": "rad", "velocity": "rad/s", "effort": "N.m"}


@dataclass
class Paths:
    """Trajectories of a topic: when the bag received each [s], its stamp [s], and its points."""

    times: list[float] = field(default_factory=list)
    stamps: list[float] = field(default_factory=list)
    messages: list[Trajectory] = field(default_factory=list)


def short_of(topic: str) -> str:
    """A topic as names of columns begin."""
    return topic.strip("/").replace("/", ".")


@dataclass
class Table:
    """Columns of a recording as they come together.

    Attributes:
        time: of the rows [s].
        columns: by name, each of shape (n,).
        roles: that the format says, by column.
        units: that the format says, by column.
        notes: for people.
        left: why a topic or column is not read.
    """

    time: Array
    columns: dict[str, Array]
    roles: dict[str, str] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    left: dict[str, str] = field(default_factory=dict)

    def add(self, column: str, values: Array, role: str, unit: str) -> None:
        self.columns[column] = values
        if role:
            self.roles[column] = role
        if unit:
            self.units[column] = unit

    def cut(self, keep: NDArray[np.bool_]) -> None:
        self.time = self.time[keep]
        self.columns = {name: values[keep] for name, values in self.columns.items()}


def apart(own: Array, main: Array, name: str) -> str | None:
    """Why a topic cannot be held at the times of the joint states; None where the two overlap."""
    gap = max(float(own.min() - main.max()), float(main.min() - own.max()))
    when = "after the last" if own.min() > main.max() else "before the first"
    return f"its times do not overlap with those of {name}: all are {gap:.3g} s {when} of them" if gap > 0.0 else None


def add_control(
    table: Table,
    topic: str,
    held: Topic,
    own: Array,
    robots: Robots,
    owners: dict[str, str],
    stands_in: bool,
) -> None:
    """Add what a controller says that it commands, as goals of the joints that the joint states have.

    Args:
        table: to which it is added.
        topic, held, own: of the state of the controller, with the times of its messages [s].
        robots: whose joints the joint states have.
        owners: goals by joint of the log as far as controllers say them; those of this one are added.
        stands_in: whether the joint states are what controllers measured.
    """
    short = short_of(topic)
    for name in held.names:
        joint, part, what = parts(name)
        if part == "time_from_start":
            table.left[f"{short}.{part}"] = "a time along the trajectory, no clock"
            continue
        values = held.held(name, own, table.time)
        if not np.isfinite(values).any():
            continue
        goal = f"{short}.{joint}.{part}.positions"
        state, own_name = robots.owner(topic, joint) or ("", joint)
        if joint not in robots.joints.get(state, {}):
            table.add(f"{short}.{name}", values, "", "")
        elif f"{short_of(state)}.{joint}.position" not in table.columns:
            table.left[f"{short}.{joint}"] = f"{state} has its position along too few of the samples"
        elif part in MEASURED:
            if not stands_in:
                table.left[f"{short}.{part}"] = f"{state} says what these joints measured"
        elif part not in COMMANDED or what not in ("positions", "velocities"):
            which = f"{part}.{what}" if part in COMMANDED else part
            table.left[f"{short}.{which}"] = "a value within the controller, which the log has no column for"
        elif what == "positions" and owners.setdefault(own_name, goal) == goal:
            table.add(goal, values, role_of(own_name, "goal"), UNITS["position"])
        elif what == "positions":
            table.left[f"{short}.{joint}.{part}"] = f"{owners[own_name]} is its goal as well, and is taken"
        elif owners.get(own_name) == goal and np.isnan(values[np.isfinite(table.columns[goal])]).any():
            # it would cost the samples between
            table.left[f"{short}.{joint}.{part}.{what}"] = "it begins after the goal"
        elif owners.get(own_name) == goal:
            table.add(f"{short}.{name}", values, role_of(own_name, "goal_velocity"), UNITS["velocity"])


def role_of(joint: str, signal: str | None) -> str:
    """What the format says of a column; empty where it says no signal."""
    return f"{joint.replace('/', '_')}.{signal}" if signal else ""


def measured_at(held: Topic, own: Array, main: str, names: Mapping[str, str]) -> Table:
    """The joint states: rows, and their numbers; joints that only other messages name are brought onto these rows.

    Args:
        held, own: messages of the joint states, with their times [s].
        main: their topic.
        names: of the joints in the log.
    """
    lead, rest = held.leading()
    order = lead[np.argsort(own[lead], kind="stable")]
    keep = order[np.concatenate([[True], np.diff(own[order]) > 0.0])]
    table = Table(own[keep], {"stamp": own[keep]}, {"stamp": "time"}, {"stamp": "s"})
    table.notes.append(f"samples are the messages of {main}")
    short, there = short_of(main), np.full(len(keep), True)
    for name in held.names:
        joint, _, signal = name.rpartition(".")
        values = held.between(name, own, own[keep]) if joint in rest else held.column(name)[keep]
        if not np.isfinite(values).any() and joint not in rest:
            continue
        if joint in rest:
            share = float(np.isfinite(values).mean())
            if share < COVERED:
                table.left[f"{short}.{name}"] = f"other messages have it, along {100.0 * share:.0f} % of the samples"
                continue
            there &= np.isfinite(values)
        table.add(
            f"{short}.{name}", values, role_of(names.get(joint, joint), FIELDS.get(signal)), UNITS.get(signal, "")
        )
    among = [joint for joint in rest if any(name.startswith(f"{short}.{joint}.") for name in table.columns)]
    if among:
        table.notes.append(
            f"messages of {main} name joints in turn: samples are those of the most joints, and {', '.join(among)} "
            "of other messages is linear between its own"
        )
    elif len(lead) < len(held.rows):
        table.notes.append(f"{len(held.rows) - len(lead)} messages of {main} that name other joints are left out")
    if among and there.any() and not there.all():
        table.notes.append(f"{int((~there).sum())} samples, at which not all joints were measured, are left out")
        table.cut(there)
    table.columns["stamp"] = table.time - table.time[0]
    return table


def add_robot(table: Table, topic: str, held: Topic, own: Array, names: Mapping[str, str]) -> None:
    """Add what joint states of another robot measured, on the rows of the table; rows that these do not reach go.

    Args:
        table: to which it is added.
        topic, held, own: joint states, with the times of their messages [s].
        names: of the joints in the log.
    """
    short, there = short_of(topic), np.full(len(table.time), True)
    for name in held.names:
        joint, _, signal = name.rpartition(".")
        values = held.between(name, own, table.time)
        share = float(np.isfinite(values).mean())
        if share >= COVERED:
            there &= np.isfinite(values)
            table.add(f"{short}.{name}", values, role_of(names.get(joint, joint), FIELDS.get(signal)),
                      UNITS.get(signal, ""))  # fmt: skip
        elif share:
            table.left[f"{short}.{name}"] = f"its messages have it along {100.0 * share:.0f} % of the samples"
    called = ", ".join(names.values())
    table.notes.append(f"{topic} is of another robot, for its joints have the same names: {called}")
    if there.any() and not there.all():
        table.notes.append(f"{int((~there).sum())} samples, at which {topic} has no value, are left out")
        table.cut(there)
        table.columns["stamp"] = table.time - table.time[0]


def add_leader(table: Table, topic: str, held: Topic, own: Array, names: Mapping[str, str]) -> list[str]:
    """Add positions of an arm that is led by hand as goals of the one that follows it; their columns.

    Args:
        table: to which they are added, with all commands.
        topic, held, own: joint states, with the times of their messages [s].
        names: of the joints in the log.
    """
    short, added = short_of(topic), list[str]()
    for name in held.names:
        joint, _, signal = name.rpartition(".")
        goal = role_of(names.get(joint, joint), "goal")
        if signal != "position" or goal in table.roles.values():
            table.left[f"{short}.{name}"] = f"{signal} of the arm that leads"
            continue
        table.add(column := f"{short}.{name}", held.held(name, own, table.time), goal, UNITS["position"])
        added.append(column)
    if added:
        table.notes.append(f"{topic} is led by hand: its positions are the goals of the arm that follows it")
    return added


def add_trajectories(table: Table, topic: str, held: Paths, starts: Array, robots: Robots) -> list[str]:
    """Add the goals of a topic of trajectories; their columns."""
    short, at = short_of(topic), table.time
    ends = starts + np.array([one.after[-1] for one in held.messages])
    if why := apart(np.concatenate([starts, ends]), at, robots.main):
        table.left[short] = why
        return []
    joints = dict.fromkeys(joint for one in held.messages for joint in one.joints)
    owners = {joint: robots.owner(topic, joint) or ("", "") for joint in joints}
    columns = {joint: table.columns.get(f"{short_of(state)}.{joint}.position") for joint, (state, _) in owners.items()}
    measured = {joint: values for joint, values in columns.items() if values is not None}
    added: list[str] = []
    for joint, goal in laid_out(held.messages, starts, at, measured).items():
        said = [f".{joint}.{word}.positions" for word in ("reference", "desired")]
        role = role_of(owners[joint][1], "goal" if owners[joint][1] else None)
        told = [name for name in table.columns if name.endswith(tuple(said)) and table.roles.get(name, role) == role]
        if other := next(iter(told), None):
            # what the controller says that it commanded is better than what it was asked for
            table.left[f"{short}.{joint}"] = f"points on the way to {other}, which is taken"
        elif np.isfinite(goal).any():
            table.add(column := f"{short}.{joint}.goal", goal, role, UNITS["position"])
            added.append(column)
    if added:
        table.notes.append(
            f"goals of {topic} go to its points, each `time_from_start` after its message, from the goal before or, at "
            "first, the measured position"
        )
    return added
