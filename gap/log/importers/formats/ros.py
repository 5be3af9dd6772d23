"""ROS bags, 1 and 2, and MCAP files: joint states, and the commands of controllers held until the next one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from .....actuators.extras import needed_for
from ...types import Array, LogError
from ..recording import Recording

ENDINGS = (".bag", ".db3", ".mcap")
JOINT_STATE = "sensor_msgs/msg/JointState"
FIELDS = {"position": "position", "velocity": "velocity", "effort": "torque"}
COMMAND_WORDS = ("command", "cmd", "goal", "desired", "target", "reference", "setpoint")
LISTS = ("name", "joint_names")
"""Fields that name the joints of the lists beside them."""
SKIPPED = ("header", "layout", "multi_dof_joint_names")


def is_bag(path: Path) -> bool:
    """Whether a path is a bag: a file, or a folder with ``metadata.yaml`` and the storage of ROS 2."""
    return path.suffix in ENDINGS or (path.is_dir() and (path / "metadata.yaml").is_file())


@dataclass
class _Topic:
    """Numbers of one topic by the field they come from.

    Attributes:
        times: when the bag received each message [s].
        stamps: of each message's own header [s], NaN where it has none.
        rows: numbers of each message.
    """

    times: list[float] = field(default_factory=list)
    stamps: list[float] = field(default_factory=list)
    rows: list[dict[str, float]] = field(default_factory=list)

    def column(self, name: str) -> Array:
        return np.array([row.get(name, np.nan) for row in self.rows])

    def held(self, name: str, own: Array, at: Array) -> Array:
        """The last value of a field at other times, NaN before its first: a message need not name all joints."""
        values = self.column(name)
        rank = np.argsort(own, kind="stable")
        rank = rank[np.isfinite(values[rank])]
        if not len(rank):
            return np.full(len(at), np.nan)
        last = np.searchsorted(own[rank], at, side="right") - 1
        return np.where(last >= 0, values[rank][np.maximum(last, 0)], np.nan)

    @property
    def names(self) -> list[str]:
        return list(dict.fromkeys(name for row in self.rows for name in row))


def read_bag(path: Path) -> list[Recording]:
    """The one recording of a bag: the samples of its joint states, with the commands that held then.

    Raises:
        LogError: it cannot be read, or has no joint states.
        MissingPackage: the extra ``ros`` is not installed.
    """
    with needed_for("Reading ROS bags and MCAP files"):
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore

    topics: dict[str, _Topic] = {}
    states: set[str] = set()
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            kinds = {connection.topic: connection.msgtype for connection in reader.connections}
            used = [c for c in reader.connections if _of_joints(c.topic, c.msgtype)]
            states = {c.topic for c in used if c.msgtype == JOINT_STATE}
            for connection, logged, raw in reader.messages(connections=used):
                message = reader.deserialize(raw, connection.msgtype)
                topic = topics.setdefault(connection.topic, _Topic())
                topic.times.append(1e-9 * logged)
                topic.stamps.append(_stamp(message))
                topic.rows.append(dict(_numbers(message)))
    except (AnyReaderError, OSError, ValueError, KeyError, AssertionError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise LogError(f"{path}: cannot be read as a bag: {reason}") from None
    measured = [t for t in states if t in topics and not _commands(t) and any("position" in n for n in topics[t].names)]
    if not measured:
        there = ", ".join(f"{topic} ({kind})" for topic, kind in sorted(kinds.items())[:6]) or "nothing"
        raise LogError(f"{path}: has no {JOINT_STATE} with positions; it holds {there}.")
    main = max(measured, key=lambda topic: (len(topics[topic].times), topic))
    return [_merged(path, topics, states, main)]


def _of_joints(topic: str, kind: str) -> bool:
    words = ("Float64", "Float32", "JointTrajectory", "JointState", "DynamicJointState", "MultiArray")
    return kind == JOINT_STATE or (kind.rpartition("/")[2].startswith(words) and (_commands(topic) or "state" in topic))


def _commands(topic: str) -> bool:
    return any(word in topic.lower() for word in COMMAND_WORDS)


def _stamp(message: Any) -> float:
    """Time that the header of a message says [s]; NaN where it says none."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    seconds = getattr(stamp, "sec", 0) + 1e-9 * getattr(stamp, "nanosec", 0)
    return float(seconds) if seconds > 0.0 else float("nan")


def _one_clock(topics: dict[str, _Topic]) -> tuple[dict[str, Array], str]:
    """Times of the messages of each topic [s], all by one clock, and a note which that is.

    Headers are stamped by the clock of the simulation or of another computer, so they do not go with times of the bag.
    """
    bare = [topic for topic, held in topics.items() if np.isnan(held.stamps).any()]
    if not bare:
        return {topic: np.array(held.stamps) for topic, held in topics.items()}, "times are the stamps of the messages"
    note = f"times are those at which the bag received the messages, since those of {bare[0]} have no stamp"
    return {topic: np.array(held.times) for topic, held in topics.items()}, note


def _apart(own: Array, main: Array, name: str) -> str | None:
    """Why a topic cannot be held at the times of the joint states; None where the two overlap."""
    gap = max(float(own.min() - main.max()), float(main.min() - own.max()))
    when = "after the last" if own.min() > main.max() else "before the first"
    return f"its times do not overlap with those of {name}: all are {gap:.3g} s {when} of them" if gap > 0.0 else None


def _numbers(message: Any, prefix: str = "", joints: tuple[str, ...] = ()) -> Iterator[tuple[str, float]]:
    """Numbers of a message by the path of their field; lists beside a list of joints by the joint's name."""
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
        elif isinstance(value, list) and value and key == "points":
            yield from _numbers(value[0], f"{path}.", joints)
        elif hasattr(value, "__dataclass_fields__"):
            yield from _numbers(value, f"{path}.", joints)


def _merged(path: Path, topics: dict[str, _Topic], states: set[str], main: str) -> Recording:
    """All topics at the times of the joint states: commands and other topics hold their last value."""
    topics = {topic: held for topic, held in topics.items() if held.names}
    times, clock = _one_clock(topics)
    time = times[main]
    order = np.argsort(time, kind="stable")
    keep = order[np.concatenate([[True], np.diff(time[order]) > 0.0])]
    time = time[keep]
    columns: dict[str, Array] = {"stamp": time - time[0]}
    roles, units, notes = {"stamp": "time"}, {"stamp": "s"}, [f"samples are the messages of {main}", clock]
    left: dict[str, str] = {}
    for topic, held in topics.items():
        short = topic.strip("/").replace("/", ".")
        if why := _apart(times[topic], time, main):
            left[short] = why
            continue
        for name in held.names:
            values = held.column(name)[keep] if topic == main else held.held(name, times[topic], time)
            if not np.isfinite(values).any():
                continue
            column = f"{short}.{name}"
            columns[column] = values
            joint, _, signal = name.rpartition(".")
            if topic == main and signal in FIELDS:
                roles[column] = f"{joint.replace('/', '_')}.{FIELDS[signal]}"
                units[column] = {"position": "rad", "velocity": "rad/s", "effort": "N.m"}[signal]
            elif topic in states and _commands(topic) and signal in FIELDS:
                role = {"position": "goal", "effort": "torque_command"}.get(signal)
                if role:
                    roles[column] = f"{joint.replace('/', '_')}.{role}"
                units[column] = {"position": "rad", "velocity": "rad/s", "effort": "N.m"}[signal]
    late = [name for name, values in columns.items() if np.isnan(values[0]) and _commands(name)]
    first = max((int(np.argmax(np.isfinite(columns[name]))) for name in late), default=0)
    if first:
        notes.append(f"the first {first} samples, before the first command, are left out")
        columns = {name: values[first:] for name, values in columns.items()}
    name = path.stem if path.is_file() else path.name
    return Recording(name, columns, path, "ros", {}, roles, tuple(notes), units, left)
