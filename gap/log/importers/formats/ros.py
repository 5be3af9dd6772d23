"""ROS bags, 1 and 2, and MCAP files: joint states, and the commands of controllers held until the next one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .....actuators.extras import needed_for
from ...types import Array, LogError
from ..recording import Recording
from .ros_states import COMMANDED, MEASURED, feedback, is_controller, is_dynamic, parts, with_positions
from .ros_topics import COVERED, Topic, numbers, stamp_of
from .trajectories import Trajectory, laid_out, trajectory_of

ENDINGS = (".bag", ".db3", ".mcap")
JOINT_STATE = "sensor_msgs/msg/JointState"
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
FIELDS = {"position": "position", "velocity": "velocity", "effort": "torque"}
UNITS = {"position": "rad", "velocity": "rad/s", "effort": "N.m"}
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
    paths: dict[str, _Paths] = field(default_factory=dict)
    unknown: list[str] = field(default_factory=list)
    stand_in: str = ""
    notes: list[str] = field(default_factory=list)

    @property
    def states(self) -> set[str]:
        return {topic for topic, kind in self.kinds.items() if kind == JOINT_STATE}


@dataclass
class _Paths:
    times: list[float] = field(default_factory=list)
    stamps: list[float] = field(default_factory=list)
    messages: list[Trajectory] = field(default_factory=list)


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
        held = bag.paths.setdefault(topic, _Paths())
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
        return max(measured, key=lambda topic: (len(bag.topics[topic].times), topic))
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


def _commands(topic: str) -> bool:
    return any(word in topic.lower() for word in COMMAND_WORDS)


def _one_clock(topics: dict[str, Topic], paths: Mapping[str, _Paths]) -> tuple[dict[str, Array], list[str]]:
    """Times of the messages of each topic [s], all by one clock, and notes which that is.

    Headers are stamped by the clock of the simulation or of another computer, so they do not go with times of the bag.
    The first stamps of a simulation may be missing: such messages are taken out of ``topics``.
    """
    everything: dict[str, Topic | _Paths] = {**topics, **paths}
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


def _apart(own: Array, main: Array, name: str) -> str | None:
    """Why a topic cannot be held at the times of the joint states; None where the two overlap."""
    gap = max(float(own.min() - main.max()), float(main.min() - own.max()))
    when = "after the last" if own.min() > main.max() else "before the first"
    return f"its times do not overlap with those of {name}: all are {gap:.3g} s {when} of them" if gap > 0.0 else None


def _short(topic: str) -> str:
    return topic.strip("/").replace("/", ".")


@dataclass
class _Table:
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


def _merged(path: Path, bag: _Bag, main: str) -> Recording:
    """All topics at the times of the joint states: commands and other topics hold their last value."""
    topics = {topic: held for topic, held in bag.topics.items() if held.names}
    paths = {topic: held for topic, held in bag.paths.items() if held.messages}
    times, clock = _one_clock(topics, paths)
    table = _measured(topics[main], times[main], main)
    table.notes += [*bag.notes, *clock]
    at, known = table.time, with_positions(topics[main])
    owners: dict[str, str] = {}
    for topic, held in topics.items():
        short = _short(topic)
        if topic == main:
            continue
        if why := _apart(times[topic], times[main], main):
            table.left[short] = why
            continue
        if is_controller(bag.kinds[topic]):
            _control(table, topic, held, times[topic], main, known, owners, main == bag.stand_in)
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
            role = {"position": "goal", "effort": "torque_command"}.get(signal) if of_joint else None
            table.add(f"{short}.{name}", values, _role(joint, role), UNITS[signal] if of_joint else "")
    led = [column for topic, held in paths.items() for column in _lead(table, topic, held, times[topic], main)]
    for topic in [*bag.topics, *bag.paths]:
        if topic not in topics and topic not in paths:
            table.left[_short(topic)] = "its messages have no numbers of joints that are read"
    for topic in bag.unknown:
        table.left[_short(topic)] = (
            f"the bag does not say how {bag.kinds[topic]} is laid out; converted to MCAP (`ros2 bag convert`) it does"
        )
    late = [name for name, values in table.columns.items() if np.isnan(values[0]) and (_commands(name) or name in led)]
    first = max((int(np.argmax(np.isfinite(table.columns[name]))) for name in late), default=0)
    if first:
        table.notes.append(f"the first {first} samples, before the first command, are left out")
        table.cut(np.arange(len(table.time)) >= first)
    name = path.stem if path.is_file() else path.name
    return Recording(name, table.columns, path, "ros", {}, table.roles, tuple(table.notes), table.units, table.left)


def _control(
    table: _Table,
    topic: str,
    held: Topic,
    own: Array,
    main: str,
    known: Mapping[str, None],
    owners: dict[str, str],
    stands_in: bool,
) -> None:
    """Add what a controller says that it commands, as goals of the joints that the joint states have.

    Args:
        table: to which it is added.
        topic, held, own: of the state of the controller, with the times of its messages [s].
        main: topic of the joint states.
        known: joints whose positions these have.
        owners: goals by joint as far as controllers say them; those of this one are added.
        stands_in: whether the joint states are what controllers measured.
    """
    short, state = _short(topic), _short(main)
    for name in held.names:
        joint, part, what = parts(name)
        if part == "time_from_start":
            table.left[f"{short}.{part}"] = "a time along the trajectory, no clock"
            continue
        values = held.held(name, own, table.time)
        if not np.isfinite(values).any():
            continue
        goal = f"{short}.{joint}.{part}.positions"
        if joint not in known:
            table.add(f"{short}.{name}", values, "", "")
        elif f"{state}.{joint}.position" not in table.columns:
            table.left[f"{short}.{joint}"] = f"{main} has its position along too few of the samples"
        elif part in MEASURED:
            if not stands_in:
                table.left[f"{short}.{part}"] = f"{main} says what these joints measured"
        elif part not in COMMANDED or what not in ("positions", "velocities"):
            which = f"{part}.{what}" if part in COMMANDED else part
            table.left[f"{short}.{which}"] = "a value within the controller, which the log has no column for"
        elif what == "positions" and owners.setdefault(joint, goal) == goal:
            table.add(goal, values, _role(joint, "goal"), UNITS["position"])
        elif what == "positions":
            table.left[f"{short}.{joint}.{part}"] = f"{owners[joint]} is its goal as well, and is taken"
        elif owners.get(joint) == goal and np.isnan(values[np.isfinite(table.columns[goal])]).any():
            # it would cost the samples between
            table.left[f"{short}.{joint}.{part}.{what}"] = "it begins after the goal"
        elif owners.get(joint) == goal:
            table.add(f"{short}.{name}", values, _role(joint, "goal_velocity"), UNITS["velocity"])


def _role(joint: str, signal: str | None) -> str:
    return f"{joint.replace('/', '_')}.{signal}" if signal else ""


def _measured(held: Topic, own: Array, main: str) -> _Table:
    """The joint states: rows, and their numbers; joints that only other messages name are brought onto these rows."""
    lead, rest = held.leading()
    order = lead[np.argsort(own[lead], kind="stable")]
    keep = order[np.concatenate([[True], np.diff(own[order]) > 0.0])]
    table = _Table(own[keep], {"stamp": own[keep]}, {"stamp": "time"}, {"stamp": "s"})
    table.notes.append(f"samples are the messages of {main}")
    short, there = _short(main), np.full(len(keep), True)
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
        table.add(f"{short}.{name}", values, _role(joint, FIELDS.get(signal)), UNITS.get(signal, ""))
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


def _lead(table: _Table, topic: str, held: _Paths, starts: Array, main: str) -> list[str]:
    """Add the goals of a topic of trajectories; their columns."""
    short, at = _short(topic), table.time
    ends = starts + np.array([one.after[-1] for one in held.messages])
    if why := _apart(np.concatenate([starts, ends]), at, main):
        table.left[short] = why
        return []
    state = _short(main)
    joints = dict.fromkeys(joint for one in held.messages for joint in one.joints)
    columns = {joint: table.columns.get(f"{state}.{joint}.position") for joint in joints}
    measured = {joint: values for joint, values in columns.items() if values is not None}
    added: list[str] = []
    for joint, goal in laid_out(held.messages, starts, at, measured).items():
        said = [f".{joint}.{word}.positions" for word in ("reference", "desired")]
        if other := next((name for name in table.columns if name.endswith(tuple(said))), None):
            # what the controller says that it commanded is better than what it was asked for
            table.left[f"{short}.{joint}"] = f"points on the way to {other}, which is taken"
        elif np.isfinite(goal).any():
            table.add(column := f"{short}.{joint}.goal", goal, _role(joint, "goal"), UNITS["position"])
            added.append(column)
    if added:
        table.notes.append(
            f"goals of {topic} go to its points, each `time_from_start` after its message, from the goal before or, at "
            "first, the measured position"
        )
    return added
