"""ROS bags, 1 and 2, and MCAP files: messages of joint states are the rows, and commands hold their last value there.

A topic says what joints measured, what they were told, or numbers whose names say what they are. A controller's state
says both of the first.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from .....common.extras import needed_for
from ...types import TOLD, LogError
from ..clocks import in_force, offset_note
from ..names import said
from ..recording import Recording

ENDINGS = (".bag", ".db3", ".mcap")
JOINT_STATE, TRAJECTORY = "JointState", "JointTrajectory"
CONTROLLER = "JointTrajectoryControllerState"
MEASURED = {"position": "position", "velocity": "velocity", "effort": "torque"}
COMMANDED = {"position": "goal", "velocity": "goal_velocity", "effort": "torque_command"}
"""Signals by the fields of joint states, measured and commanded."""
UNITS = {"position": "rad", "velocity": "rad/s", "effort": "N.m"}
POINT_FIELDS = {"positions": "position", "velocities": "velocity", "effort": "effort"}
"""Fields of joint states by those of a point of a trajectory."""
REFERENCE, FEEDBACK = ("reference", "desired"), ("feedback", "actual")
"""Parts of a controller's state that say what it commands, and what it measured, by the new and the old definition."""
COMMAND_WORDS = ("command", "cmd", "goal", "desired", "target", "reference", "setpoint")
LISTS = ("name", "joint_names")
"""Fields that name the joints of the lists beside them."""
SKIPPED = ("header", "layout", "multi_dof_joint_names")
LEADING_SHARE = 0.1
"""Share of the messages of the most frequent number of joints from which another number may lead."""
PLAN = "its points are a plan: record the controller's state beside it, whose reference is what was commanded"

PLACE = re.compile(r"(.+)\[(\d+)\]")
LIST_ORDER = (
    "whose are the places of {} and of the columns beside it? The list names no joints. The lines have them in the "
    "order of the positions: exchange columns where its controller has another order"
)
UNNAMED = "{} of a list that names no joints: write <joint>.{} where you know whose it is"


@dataclass(eq=False)
class Topic:
    """Messages of one topic: their type, when the bag received each and its stamp [s], and numbers by their fields."""

    name: str
    kind: str
    times: list[tuple[float, float]] = field(default_factory=list)
    rows: list[dict[str, float]] = field(default_factory=list)

    def take(self, logged: float, message: Any) -> None:
        stamp = getattr(getattr(message, "header", None), "stamp", None)
        seconds = getattr(stamp, "sec", 0) + 1e-9 * getattr(stamp, "nanosec", 0)
        self.times.append((logged, float(seconds)))
        self.rows.append(dict(_numbers(message)))

    def frame(self, clock: int) -> pd.DataFrame:
        """The numbers by one of both clocks, NaN where a message has none."""
        time = np.array(self.times)[:, clock]
        order = np.argsort(time, kind="stable")
        return pd.DataFrame([self.rows[k] for k in order], index=time[order]).dropna(axis=1, how="all")


@dataclass(frozen=True, eq=False)
class Series:
    """A field of a topic: its column, ``joint.signal`` where it is a joint's, its unit, and its numbers by their time
    [s]."""

    topic: str
    column: str
    role: str
    unit: str
    values: pd.Series


def is_bag(path: Path) -> bool:
    """Whether a path is a bag: a file, or a folder with ``metadata.yaml`` and the storage of ROS 2."""
    return path.suffix in ENDINGS or (path.is_dir() and (path / "metadata.yaml").is_file())


def read_bag(path: Path) -> list[Recording]:
    """The one recording of a bag: the samples of its joint states, with the commands that held then.

    Raises:
        LogError: it cannot be read, has no joint states, or several robots whose joints have the same names.
        MissingPackage: the extra ``ros`` is not installed.
    """
    with needed_for("Reading ROS bags and MCAP files"):
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore

    topics: dict[str, Topic] = {}
    left: dict[str, str] = {}
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            kinds = {connection.topic: connection.msgtype for connection in reader.connections}
            used = [c for c in reader.connections if _of_joints(c.topic, c.msgtype)]
            known = [c for c in used if c.msgtype in reader.typestore.fielddefs]
            left |= {short(c.topic): f"the bag does not say how {c.msgtype} is laid out; converted to MCAP (`ros2 bag "
                     "convert`) it does" for c in used if c not in known}  # fmt: skip
            for connection, logged, raw in reader.messages(connections=known) if known else ():
                own = topics.setdefault(
                    connection.topic, Topic(connection.topic, connection.msgtype.rpartition("/")[2])
                )
                own.take(1e-9 * logged, reader.deserialize(raw, connection.msgtype))
    except (AnyReaderError, OSError, ValueError, KeyError, AssertionError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise LogError(f"{path}: cannot be read as a bag: {reason}") from None
    for topic in [topic for topic in topics.values() if not any(topic.rows)]:
        left[short(topic.name)] = PLAN if topic.kind == TRAJECTORY else "its messages have no numbers of joints"
        del topics[topic.name]
    states, commands, notes = _series(topics, left)
    if not states:
        there = ", ".join(f"{name} ({kind})" for name, kind in sorted(kinds.items())[:6]) or "nothing"
        why = f"; {next(iter(left))}: {next(iter(left.values()))}" if left else ""
        raise LogError(f"{path}: has no joint states with positions; it holds {there}{why}.")
    main, rows = _rows(states, left, path)
    notes += [f"samples are the messages of {main}"]
    return [_held(path, rows, commands, left, notes)]


def short(topic: str) -> str:
    """A topic as names of columns begin."""
    return topic.strip("/").replace("/", ".")


def _commands(topic: str) -> bool:
    """Whether a topic is called as one of commands."""
    return any(word in topic.lower() for word in COMMAND_WORDS)


def _of_joints(topic: str, kind: str) -> bool:
    """Whether a topic may say something of joints: by its type, and where that says too little by its name."""
    plain = kind.rpartition("/")[2]
    if kind == f"sensor_msgs/msg/{JOINT_STATE}" or plain.startswith(TRAJECTORY):
        return True
    words = ("Float64", "Float32", JOINT_STATE, "MultiArray")
    return plain.startswith(words) and (_commands(topic) or "state" in topic)


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
            named = len(joints) == len(value)
            for k, number in enumerate(value):
                plain = path if len(value) == 1 else f"{path}[{k}]"
                yield f"{joints[k]}.{path}" if named else plain, float(number)
        elif hasattr(value, "__dataclass_fields__"):
            yield from _numbers(value, f"{path}.", joints)


# --- what joints measured, and what they were told -------------------------------------------------------------------


def _series(
    topics: Mapping[str, Topic], left: dict[str, str]
) -> tuple[dict[str, list[Series]], list[Series], list[str]]:
    """What joints measured by topic, of joint states or else of controllers; what they were told, the word of a
    controller first, and other numbers; and notes.

    All stand on one clock: headers are stamped by the clock of the simulation or of another computer, so where a
    message has no stamp the times of the bag hold for all.
    """
    bare = next((topic.name for topic in topics.values() if not all(stamp > 0.0 for _, stamp in topic.times)), "")
    at = f"those at which the bag received the messages, since messages of {bare} have no stamp"
    notes = [f"times are {at if bare else 'the stamps of the messages'}"]
    states, feedback, told = dict[str, list[Series]](), dict[str, list[Series]](), list[Series]()
    for topic in sorted(topics.values(), key=lambda topic: (topic.kind != CONTROLLER, topic.name)):
        frame: Any = topic.frame(0 if bare else 1)
        for name in map(str, frame):
            joint, _, what = name.rpartition(".")
            part = ""
            if topic.kind == CONTROLLER:
                joint, _, part = joint.rpartition(".")
                what = POINT_FIELDS.get(what, "") if part in REFERENCE + FEEDBACK else ""
            of_joint = topic.kind in (JOINT_STATE, CONTROLLER) and what in MEASURED
            commanded = part in REFERENCE or (not part and _commands(topic.name))
            signal = (COMMANDED if commanded else MEASURED).get(what, "") if of_joint else ""
            role = f"{joint.replace('/', '_')}.{signal}" if signal else ""
            one = Series(topic.name, f"{short(topic.name)}.{name}", role, UNITS[what] if of_joint else "", frame[name])
            if part and not signal:
                left[f"{short(topic.name)}.{part}"] = "a value within the controller"
            elif commanded or topic.kind not in (JOINT_STATE, CONTROLLER):
                told.append(one)
            else:
                (feedback if part else states).setdefault(f"{topic.name}{'/' * bool(part)}{part}", []).append(one)
    measured = {name: own for name, own in states.items() if _positions(own)}
    if not measured and feedback:
        measured = {name: own for name, own in feedback.items() if _positions(own)}
        notes.append(f"no {JOINT_STATE} has positions: {', '.join(measured)} stands in")
    left |= {short(name): "joint states are taken" for name in (*states, *feedback) if name not in measured}
    return measured, told, notes


def _positions(own: list[Series]) -> list[str]:
    """Joints whose position is among series."""
    return [one.role.removesuffix(".position") for one in own if one.role.endswith(".position")]


def _rows(states: dict[str, list[Series]], left: dict[str, str], path: Path) -> tuple[str, dict[str, Series]]:
    """The topic with the most numbers, whose messages that have the most of them are the rows, and its series there.

    Raises:
        LogError: two topics have the same joint.
    """
    main = max(states, key=lambda name: (len(states[name]), name))
    for name in states.keys() - {main}:
        if shared := {*_positions(states[name])} & {*_positions(states[main])}:
            raise LogError(
                f"{path}: {main} and {name} both have the joint '{min(shared)}'; import a bag with one topic of joint "
                "states for each joint (`ros2 bag convert`, `rosbag filter`)."
            )
        left[short(name)] = f"samples are those of {main}"
    frame: Any = pd.concat({one.column: one.values for one in states[main]}, axis=1)
    counts = frame.notna().sum(axis=1)
    usual = counts.value_counts()
    rows = frame[counts == max(count for count, times in usual.items() if times >= LEADING_SHARE * usual.max())]
    rows = rows[~rows.index.duplicated()].dropna(axis=1)
    left |= dict.fromkeys(frame.columns.difference(rows.columns), "it is not in the messages that name the most joints")
    return main, {one.column: replace(one, values=rows[one.column]) for one in states[main] if one.column in rows}


def _held(
    path: Path, rows: dict[str, Series], commands: list[Series], left: dict[str, str], notes: list[str]
) -> Recording:
    """The recording of rows with commands and other numbers, which hold until the next; of two commands of a joint the
    first is taken, and what stands before the first command is left out."""
    time = next(iter(rows.values())).values.index.to_numpy(np.float64)
    joints, taken, asks, begins = _positions([*rows.values()]), dict[str, str](), dict[str, str](), 0
    columns = {column: one.values.to_numpy(np.float64) for column, one in rows.items()}
    used, lists = dict(rows), Counter(match[1] for one in commands if (match := PLACE.fullmatch(one.column)))
    for one in commands:
        role, known = one.role, one.values.dropna()
        if not role and (match := PLACE.fullmatch(one.column)):
            role, asks[one.column] = _placed(match, lists[match[1]], joints)
        if role in taken:
            left[one.column] = f"{taken[role]} is its {role.rpartition('.')[2].replace('_', ' ')} as well"
            asks.pop(one.column, None)
            continue
        if known.index[0] > time[-1] or known.index[-1] < time[0]:
            left[one.column] = "its times do not overlap with those of the joint states"
            continue
        values, late = in_force(known.index.to_numpy(np.float64), known.to_numpy(np.float64), time)
        used[one.column], columns[one.column] = replace(one, role=role), values
        taken |= {role: one.column} if role else {}
        if role or _commands(one.column):
            begins = max(begins, int(np.argmax(np.isfinite(values))))
            notes += [offset_note(one.topic, f"{1e3 * late:.3g} ms")] * (late > 1e-9)
    if begins:
        notes.append(f"the first {begins} samples, before the first command, are left out")
    columns = {"stamp": time - time[0]} | columns
    roles = {"stamp": "time"} | {column: one.role for column, one in used.items() if one.role}
    units = {"stamp": "s"} | {column: one.unit for column, one in used.items() if one.unit}
    name = path.stem if path.is_file() else path.name
    cut = {column: own[begins:] for column, own in columns.items()}
    told = tuple(dict.fromkeys(notes))
    return Recording(name, cut, path, "ros", roles=roles, notes=told, units=units, left=left, asks=asks)


def _placed(match: re.Match[str], count: int, joints: list[str]) -> tuple[str, str]:
    """The role of a place of a list that names no joints, asked about where it has as many as there are joints; and the
    question, or why it has none."""
    signal = said(match[0]).signal
    if count == len(joints) and signal in TOLD:
        return f"{joints[int(match[2])]}.{signal}", LIST_ORDER.format(f"{match[1]}[0]")
    return "", UNNAMED.format(signal or "a number", signal or "goal")
