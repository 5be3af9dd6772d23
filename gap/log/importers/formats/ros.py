"""ROS bags, 1 and 2, and MCAP files: joint states, and the commands of controllers held until the next one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from .....common.extras import needed_for
from ...types import Array, LogError
from ..recording import Recording
from ..series import ARM
from .ros_robots import robots_of
from .ros_states import feedback, is_controller, is_dynamic, with_positions
from .ros_table import (
    FIELDS,
    UNITS,
    Paths,
    add_control,
    add_leader,
    add_robot,
    add_trajectories,
    apart,
    measured_at,
    role_of,
    short_of,
)
from .ros_topics import Topic, numbers, stamp_of
from .trajectories import trajectory_of

ENDINGS = (".bag", ".db3", ".mcap")
JOINT_STATE = "sensor_msgs/msg/JointState"
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
BARE = 0.5
"""Share of the messages of a topic without a stamp from which its stamps say nothing."""
COMMAND_WORDS = ("command", "cmd", "goal", "desired", "target", "reference", "setpoint")


def is_bag(path: Path) -> bool:
    """Whether a path is a bag: a file, or a folder with ``metadata.yaml`` and the storage of ROS 2."""
    return path.suffix in ENDINGS or (path.is_dir() and (path / "metadata.yaml").is_file())


@dataclass
class _Bag:
    """What a bag says of joints.

    Attributes:
        kinds: type of each topic.
        topics: those of numbers, by name.
        paths: trajectories by topic: when the bag received each [s], its stamp [s], and its points.
        unknown: topics that are not read, for the bag does not say how their type is laid out.
        stand_in: what controllers measured, as a topic of its own where nothing else says it; else empty.
        notes: for people.
    """

    kinds: dict[str, str] = field(default_factory=dict)
    topics: dict[str, Topic] = field(default_factory=dict)
    paths: dict[str, Paths] = field(default_factory=dict)
    unknown: list[str] = field(default_factory=list)
    stand_in: str = ""
    notes: list[str] = field(default_factory=list)

    @property
    def states(self) -> set[str]:
        return {topic for topic, kind in self.kinds.items() if kind == JOINT_STATE}


def read_bag(path: Path) -> list[Recording]:
    """The one recording of a bag: the samples of its joint states, with the commands that held then.

    Raises:
        LogError: it cannot be read, or has no joint states.
        MissingPackage: the extra ``ros`` is not installed.
    """
    with needed_for("Reading ROS bags and MCAP files"):
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore

    bag = _Bag()
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            bag.kinds = {connection.topic: connection.msgtype for connection in reader.connections}
            used = [c for c in reader.connections if _of_joints(c.topic, c.msgtype)]
            known = [c for c in used if c.msgtype in reader.typestore.fielddefs]
            bag.unknown = sorted({c.topic for c in used} - {c.topic for c in known})
            for connection, logged, raw in reader.messages(connections=known) if known else ():
                message = reader.deserialize(raw, connection.msgtype)
                _take(bag, connection.topic, 1e-9 * logged, message)
    except (AnyReaderError, OSError, ValueError, KeyError, AssertionError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise LogError(f"{path}: cannot be read as a bag: {reason}") from None
    return [_merged(path, bag, _main(path, bag))]


def _take(bag: _Bag, topic: str, logged: float, message: Any) -> None:
    """Add one message, which the bag received at a time [s]."""
    if bag.kinds[topic] != TRAJECTORY:
        held = bag.topics.setdefault(topic, Topic())
        held.rows.append(dict(numbers(message)))
    else:
        held = bag.paths.setdefault(topic, Paths())
        if (points := trajectory_of(message)) is None:
            return
        held.messages.append(points)
    held.times.append(logged)
    held.stamps.append(stamp_of(message))


def _main(path: Path, bag: _Bag) -> str:
    """The topic whose messages are the rows of the log: most joint states with positions, or what stands in."""
    measured = [
        topic
        for topic in bag.states & set(bag.topics)
        if not _commands(topic) and any("position" in name for name in bag.topics[topic].names)
    ]
    if not measured:
        measured = _standing_in(bag)
    if measured:
        return max(measured, key=lambda topic: (not _leads(topic), len(bag.topics[topic].times), topic))
    there = ", ".join(f"{topic} ({kind})" for topic, kind in sorted(bag.kinds.items())[:6]) or "nothing"
    if bag.unknown:
        there = ", ".join(f"{topic} ({bag.kinds[topic]})" for topic in bag.unknown)
        raise LogError(
            f"{path}: has no {JOINT_STATE} with positions, and its storage does not say how {there} is laid out; "
            "record the joint states beside, or convert the bag to MCAP, which carries definitions (`ros2 bag "
            "convert` where ROS knows these types)."
        )
    raise LogError(f"{path}: has no {JOINT_STATE} with positions; it holds {there}.")


def _standing_in(bag: _Bag) -> list[str]:
    """Topics that say what a bag without joint states measured; none where nothing does."""
    without = f"the bag has no {JOINT_STATE} with positions"
    dynamic = [topic for topic in bag.topics if is_dynamic(bag.kinds[topic]) and with_positions(bag.topics[topic])]
    if dynamic:
        bag.notes.append(f"{without}: {', '.join(dynamic)} stands in")
        return dynamic
    states = {topic: held for topic, held in bag.topics.items() if is_controller(bag.kinds[topic])}
    made = feedback(states)
    if made is None:
        return []
    name, used, held = made
    bag.notes.append(f"{without}: {name} stands in, which is what {', '.join(used)} measured")
    bag.topics[name], bag.kinds[name], bag.stand_in = held, JOINT_STATE, name
    return [name]


def _of_joints(topic: str, kind: str) -> bool:
    """Whether a topic may say something of joints: by its type, and where that says too little by its name."""
    plain = kind.rpartition("/")[2]
    if kind == JOINT_STATE or plain.startswith("JointTrajectory"):
        return True
    words = ("Float64", "Float32", "JointState", "DynamicJointState", "MultiArray")
    return plain.startswith(words) and (_commands(topic) or "state" in topic)


def _leads(topic: str) -> bool:
    """Whether a topic is of an arm that is led by hand."""
    match = ARM.fullmatch(topic.strip("/").replace("/", "_"))
    return bool(match and match[2])


def _commands(topic: str) -> bool:
    return any(word in topic.lower() for word in COMMAND_WORDS)


def _one_clock(topics: dict[str, Topic], paths: Mapping[str, Paths]) -> tuple[dict[str, Array], list[str]]:
    """Times of the messages of each topic [s], all by one clock, and notes which that is.

    Headers are stamped by the clock of the simulation or of another computer, so they do not go with times of the bag.
    The first stamps of a simulation may be missing: such messages are taken out of ``topics``.
    """
    everything: dict[str, Topic | Paths] = {**topics, **paths}
    missing = {topic: np.isnan(held.stamps) for topic, held in everything.items()}
    # no trajectory is dropped: each is a command, and a stamp of zero asks a controller to start at once
    bare = [topic for topic, none in missing.items() if (none.any() if topic in paths else none.mean() > BARE)]
    if bare:
        note = f"times are those at which the bag received the messages, since those of {bare[0]} have no stamp"
        return {topic: np.array(held.times) for topic, held in everything.items()}, [note]
    notes = ["times are the stamps of the messages"]
    for topic in list(topics):
        if count := int(missing[topic].sum()):
            topics[topic] = everything[topic] = topics[topic].only(~missing[topic])
            notes.append(f"{count} messages of {topic} without a stamp are left out")
    return {topic: np.array(held.stamps) for topic, held in everything.items()}, notes


def _merged(path: Path, bag: _Bag, main: str) -> Recording:
    """All topics at the times of the joint states: commands and other topics hold their last value."""
    topics = {topic: held for topic, held in bag.topics.items() if held.names}
    paths = {topic: held for topic, held in bag.paths.items() if held.messages}
    times, clock = _one_clock(topics, paths)
    states = {main, *(topic for topic in bag.states & set(topics) if not _commands(topic))}
    states = {topic: topics[topic] for topic in sorted(states) if not apart(times[topic], times[main], main)}
    robots = robots_of(states, times, main)
    table = measured_at(topics[main], times[main], main, robots.joints[main])
    table.notes += [*bag.notes, *clock]
    for topic in [topic for topic in robots.joints if topic != main and topic not in robots.leaders]:
        add_robot(table, topic, topics[topic], times[topic], robots.joints[topic])
    at, known, led = table.time, robots.joints[main], list[str]()
    owners: dict[str, str] = {}
    for topic, held in topics.items():
        short = short_of(topic)
        if topic in robots.joints:
            continue
        if why := apart(times[topic], times[main], main):
            table.left[short] = why
            continue
        if is_controller(bag.kinds[topic]):
            add_control(table, topic, held, times[topic], robots, owners, main == bag.stand_in)
            continue
        if is_dynamic(bag.kinds[topic]):
            more = ", ".join(joint for joint in with_positions(held) if joint not in known)
            table.left[short] = f"{main} is taken{f', which does not have {more}' if more else ': it has its joints'}"
            continue
        for name in held.names:
            values = held.held(name, times[topic], at)
            if not np.isfinite(values).any():
                continue
            joint, _, signal = name.rpartition(".")
            of_joint = topic in bag.states and _commands(topic) and signal in FIELDS
            owner = robots.owner(topic, joint) if of_joint else None
            role = {"position": "goal", "effort": "torque_command"}.get(signal) if owner else None
            own = owner[1] if owner else joint
            table.add(f"{short}.{name}", values, role_of(own, role), UNITS[signal] if of_joint else "")
    for topic, held in paths.items():
        led += add_trajectories(table, topic, held, times[topic], robots)
    for topic in robots.leaders:
        led += add_leader(table, topic, topics[topic], times[topic], robots.joints[topic])
    for topic in [*bag.topics, *bag.paths]:
        if topic not in topics and topic not in paths:
            table.left[short_of(topic)] = "its messages have no numbers of joints that are read"
    for topic in bag.unknown:
        table.left[short_of(topic)] = (
            f"the bag does not say how {bag.kinds[topic]} is laid out; converted to MCAP (`ros2 bag convert`) it does"
        )
    late = [name for name, values in table.columns.items() if np.isnan(values[0]) and (_commands(name) or name in led)]
    first = max((int(np.argmax(np.isfinite(table.columns[name]))) for name in late), default=0)
    if first:
        table.notes.append(f"the first {first} samples, before the first command, are left out")
        table.cut(np.arange(len(table.time)) >= first)
    name = path.stem if path.is_file() else path.name
    return Recording(name, table.columns, path, "ros", {}, table.roles, tuple(table.notes), table.units, table.left)
