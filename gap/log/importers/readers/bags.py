"""ROS bags, 1 and 2, and MCAP files: joint states are the rows, and commands hold their last value there.

A topic says what joints measured, what they were told, or numbers whose names say what they are. A controller's state
is two topics: what it measured, and what it told.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from .....common.extras import needed_for
from ...types import Array, LogError
from ..clocks import offset_note
from ..recording import MOST_OF_THEM, Recording
from .robots import is_led, robots_of
from .topics import (
    CONTROLLER,
    DYNAMIC,
    JOINT_STATE,
    TRAJECTORY,
    Topic,
    commands,
    joint_of,
    laid_out,
    numbers,
    short,
    trajectory_of,
)

ENDINGS = (".bag", ".db3", ".mcap")
MEASURED = {"position": "position", "velocity": "velocity", "effort": "torque"}
COMMANDED = {"position": "goal", "velocity": "goal_velocity", "effort": "torque_command"}
"""Signals by the fields of joint states, measured and commanded."""
UNITS = {"position": "rad", "velocity": "rad/s", "effort": "N.m"}
POINT_FIELDS = {"positions": "position", "velocities": "velocity", "effort": "effort"}
"""Fields of joint states by those of a point of a trajectory."""
REFERENCE, FEEDBACK = ("reference", "desired"), ("feedback", "actual")
"""Parts of a controller's state that say what it commands, and what it measured: by the new and by the old
definition."""
STATES = (CONTROLLER, DYNAMIC, JOINT_STATE)
"""Types of messages that say what joints measured, the best last."""


def is_bag(path: Path) -> bool:
    """Whether a path is a bag: a file, or a folder with ``metadata.yaml`` and the storage of ROS 2."""
    return path.suffix in ENDINGS or (path.is_dir() and (path / "metadata.yaml").is_file())


def read_bag(path: Path) -> list[Recording]:
    """The one recording of a bag: the samples of its joint states, with the commands that held then.

    Raises:
        LogError: it cannot be read, or has no joint states.
        MissingPackage: the extra ``ros`` is not installed.
    """
    with needed_for("Reading ROS bags and MCAP files"):
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore

    messages: dict[str, _Messages] = {}
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            kinds = {connection.topic: connection.msgtype for connection in reader.connections}
            used = [c for c in reader.connections if _of_joints(c.topic, c.msgtype)]
            known = [c for c in used if c.msgtype in reader.typestore.fielddefs]
            for connection, logged, raw in reader.messages(connections=known) if known else ():
                own = messages.setdefault(connection.topic, _Messages(connection.msgtype))
                own.take(1e-9 * logged, reader.deserialize(raw, connection.msgtype))
    except (AnyReaderError, OSError, ValueError, KeyError, AssertionError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise LogError(f"{path}: cannot be read as a bag: {reason}") from None
    unknown = {c.topic: c.msgtype for c in used if c not in known}
    left = {short(name): "its messages have no numbers of joints that are read" for name in messages
            if messages[name].silent}  # fmt: skip
    left |= {short(name): f"the bag does not say how {kind} is laid out; converted to MCAP (`ros2 bag convert`) it does"
             for name, kind in unknown.items()}  # fmt: skip
    topics, notes = _on_one_clock({name: own for name, own in messages.items() if not own.silent})
    states, others = _by_role(topics, left)
    main, stands_in = _main(states, left)
    if main is None:
        raise LogError(f"{path}: {_without_states(kinds, unknown)}")
    table = _Table(states, main, left)
    table.merge(others)
    name = path.stem if path.is_file() else path.name
    return [Recording(name, table.columns, path, "ros", roles=table.roles, units=table.units, left=left,
                      notes=(*table.notes, *stands_in, *notes))]  # fmt: skip


def _of_joints(topic: str, kind: str) -> bool:
    """Whether a topic may say something of joints: by its type, and where that says too little by its name."""
    plain = kind.rpartition("/")[2]
    if kind == JOINT_STATE or plain.startswith("JointTrajectory"):
        return True
    words = ("Float64", "Float32", "JointState", "DynamicJointState", "MultiArray")
    return plain.startswith(words) and (commands(topic) or "state" in topic)


class _Messages:
    """Messages of one topic as they come: when the bag received each, its stamp [s], and its numbers or trajectory."""

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self.times: list[tuple[float, float]] = []
        self.content: list[Any] = []

    @property
    def silent(self) -> bool:
        return not any(self.content)

    def take(self, logged: float, message: Any) -> None:
        content = trajectory_of(message) if self.kind == TRAJECTORY else dict(numbers(message))
        if content is None:
            return
        stamp = getattr(getattr(message, "header", None), "stamp", None)
        seconds = getattr(stamp, "sec", 0) + 1e-9 * getattr(stamp, "nanosec", 0)
        self.times.append((logged, float(seconds) if seconds > 0.0 else float("nan")))
        self.content.append(content)

    def topic(self, clock: int) -> Topic:
        """The messages by one of both clocks; those without a time are left out."""
        time = np.array(self.times)[:, clock]
        order = [k for k in np.argsort(time, kind="stable") if np.isfinite(time[k]) and self.content[k]]
        content = [self.content[k] for k in order]
        if self.kind == TRAJECTORY:
            return Topic(self.kind, pd.DataFrame(index=time[order]), tuple(content))
        return Topic(self.kind, pd.DataFrame(content, index=time[order]).dropna(axis=1, how="all"))


def _on_one_clock(messages: Mapping[str, _Messages]) -> tuple[dict[str, Topic], list[str]]:
    """Topics by one clock, and notes which that is.

    Headers are stamped by the clock of the simulation or of another computer, so they do not go with times of the
    bag. The first stamps of a simulation may be missing: such messages are taken out. No trajectory is: each is a
    command, and a stamp of zero asks a controller to start at once.
    """
    missing = {name: np.isnan([stamp for _, stamp in own.times]) for name, own in messages.items()}
    bare = [name for name, none in missing.items()
            if none.mean() > (0.0 if messages[name].kind == TRAJECTORY else MOST_OF_THEM)]  # fmt: skip
    notes = ["times are the stamps of the messages"]
    notes += [f"{none.sum()} messages of {name} without a stamp are left out" for name, none in missing.items()
              if none.any()]  # fmt: skip
    if bare:
        notes = [f"times are those at which the bag received the messages, since those of {bare[0]} have no stamp"]
    return {name: own.topic(0 if bare else 1) for name, own in messages.items()}, notes


def _by_role(topics: Mapping[str, Topic], left: dict[str, str]) -> tuple[dict[str, Topic], dict[str, Topic]]:
    """Topics of what joints measured, and all others, what controllers say that they command first."""
    states: dict[str, Topic] = {}
    told: dict[str, Topic] = {}
    for name, topic in sorted(
        topics.items(), key=lambda one: (not one[1].is_a(CONTROLLER), bool(one[1].paths), one[0])
    ):
        if not topic.is_a(CONTROLLER):
            (states if topic.is_a(*STATES) and not commands(name) else told)[name] = topic
            continue
        parts: dict[str, dict[str, str]] = {}
        for field in map(str, topic.frame):
            rest, _, last = field.rpartition(".")
            joint, _, part = rest.rpartition(".")
            if part in REFERENCE + FEEDBACK and last in POINT_FIELDS:
                parts.setdefault(part, {})[field] = f"{joint}.{POINT_FIELDS[last]}"
            else:
                left[f"{short(name)}.{part}"] = "a value within the controller, which the log has no column for"
        for part in parts:
            own: Any = topic.frame[list(parts[part])]
            if part in FEEDBACK:
                states[f"{name}/{part}"] = Topic(topic.kind, own.rename(columns=parts[part]))
            else:
                told[name] = Topic(topic.kind, own, fields=parts[part])
    return states, told


def _main(states: dict[str, Topic], left: dict[str, str]) -> tuple[str | None, list[str]]:
    """The topic whose messages are the rows of the log, and notes; None where nothing says a position.

    Joint states go before what stands in for them, which is then told. What several controllers measured is one topic:
    a joint that two have is of the first.
    """

    def rank(name: str) -> tuple[int, bool, int, str]:  # an arm that is led by hand comes last
        topic = states[name]
        place = next(k for k, kind in enumerate(STATES) if topic.is_a(kind))
        return place, not is_led(short(name).replace(".", "_")), len(topic.frame), name

    main = max((name for name, topic in states.items() if topic.with_positions()), key=rank, default=None)
    if main is None:
        return None, []
    kind = STATES[rank(main)[0]]
    controllers = sorted(name for name, topic in states.items() if topic.is_a(CONTROLLER))
    if kind == CONTROLLER and len(controllers) > 1:
        frames: dict[str, Any] = {}
        for name in controllers:
            taken = {joint_of(str(field)) for frame in frames.values() for field in frame}
            own = states.pop(name).frame
            frames[name] = own[[field for field in own if joint_of(str(field)) not in taken]]
        main = "/controllers/feedback"
        states[main] = Topic(JOINT_STATE, pd.concat(frames.values()).sort_index(kind="stable"))
        return main, [f"the bag has no {JOINT_STATE} with positions: what {', '.join(frames)} measured stands in"]
    for name in [name for name, topic in states.items() if not topic.is_a(kind)]:
        more = [joint for joint in states.pop(name).with_positions() if joint not in states[main].with_positions()]
        has = f", which does not have {', '.join(more)}" if more else ": it has its joints"
        left[short(name)] = f"{main} is taken{has}"
    return main, [f"the bag has no {JOINT_STATE} with positions: {main} stands in"] * (kind != JOINT_STATE)


def _without_states(kinds: Mapping[str, str], unknown: Mapping[str, str]) -> str:
    there = ", ".join(f"{name} ({kind})" for name, kind in sorted((unknown or kinds).items())[:6]) or "nothing"
    if not unknown:
        return f"has no {JOINT_STATE} with positions; it holds {there}."
    return (
        f"has no {JOINT_STATE} with positions, and its storage does not say how {there} is laid out; record the joint "
        "states beside, or convert the bag to MCAP, which carries definitions (`ros2 bag convert` where ROS knows "
        "these types)."
    )


class _Table:
    """The table that topics make: joint states are its rows, and commands hold their last value there."""

    def __init__(self, states: Mapping[str, Topic], main: str, left: dict[str, str]) -> None:
        self.states, self.main, self.left = states, main, left
        self.time: Array = np.zeros(0)
        self.columns: dict[str, Array] = {}
        self.roles: dict[str, str] = {}
        self.units: dict[str, str] = {}
        self.notes: list[str] = []
        self.commanded: list[str] = []  # columns that say a command
        self.goals: dict[str, str] = {}  # column by joint, of controllers

    def merge(self, others: Mapping[str, Topic]) -> None:
        """All topics at the times of the joint states."""
        apart = {name: why for name, topic in {**self.states, **others}.items() if (why := self._apart(topic))}
        self.left |= {short(name): why for name, why in apart.items()}
        near = {name: topic for name, topic in self.states.items() if name not in apart}
        self.robots = robots_of(near, self.main)
        self._rows(self.robots.joints[self.main])
        for name, joints in self.robots.joints.items():
            if name != self.main:
                led = any(map(is_led, joints.values()))
                what = "led by hand" if led else "of another robot"
                called = ", ".join(joints.values())
                self.notes.append(f"{name} is {what}, for its joints have the same names: {called}")
                self._without(self._measured(name, joints, led=led), f"{name} has no value")
        again = {name: topic for name, topic in near.items() if name not in self.robots.joints}
        for name, topic in {**again, **others}.items():
            if name not in apart:
                self._told(name, topic)
        first = max((int(np.argmax(np.isfinite(self.columns[name]))) for name in self.commanded), default=0)
        if first:
            self.notes.append(f"the first {first} samples, before the first command, are left out")
            self._cut(np.arange(len(self.time)) >= first)

    def _add(self, column: str, values: Array, joint: str, signal: str, unit: str) -> None:
        self.columns[column] = values
        if joint and signal:
            self.roles[column] = f"{joint.replace('/', '_')}.{signal}"
        if unit:
            self.units[column] = unit

    def _cut(self, keep: NDArray[np.bool_]) -> None:
        self.time = self.time[keep]
        self.columns = {name: values[keep] for name, values in self.columns.items()}

    def _apart(self, topic: Topic) -> str:
        """Why a topic cannot be held at the times of the joint states; empty where the two overlap."""
        main, own = self.states[self.main].time, topic.time
        last = max((start + path.after[-1] for start, path in zip(own, topic.paths, strict=False)), default=own[-1])
        gap = max(float(own[0] - main[-1]), float(main[0] - last))
        when = "after the last" if own[0] > main[-1] else "before the first"
        why = f"its times do not overlap with those of {self.main}: all are {gap:.3g} s {when} of them"
        return why if gap > 0.0 else ""

    # --- what was measured -------------------------------------------------------------------------------------------

    def _rows(self, names: Mapping[str, str]) -> None:
        """The joint states: rows, and their numbers; joints that only other messages name are brought onto these
        rows."""
        topic = self.states[self.main]
        lead, rest = topic.leading()
        rows: Any = topic.frame[lead]
        rows = rows[~rows.index.duplicated()]
        self.time = rows.index.to_numpy(np.float64)
        self._add("stamp", self.time, "", "", "s")
        self.roles["stamp"] = "time"
        self.notes.append(f"samples are the messages of {self.main}")
        there = self._measured(self.main, names, rows.drop(columns=[f for f in rows if joint_of(str(f)) in rest]))
        among = [joint for joint in rest if any(joint_of(name).endswith(f".{joint}") for name in self.columns)]
        if among:
            self.notes.append(
                f"messages of {self.main} name joints in turn: samples are those of the most joints, and "
                f"{', '.join(among)} of other messages is linear between its own"
            )
        elif not lead.all():
            self.notes.append(f"{int((~lead).sum())} messages of {self.main} that name other joints are left out")
        self._without(there, "not all joints were measured")

    def _measured(
        self, name: str, names: Mapping[str, str], rows: pd.DataFrame | None = None, led: bool = False
    ) -> NDArray[np.bool_]:
        """Take what joint states measured, linear between their messages where these are not the rows themselves.

        Args:
            name: of the topic.
            names: of its joints in the log.
            rows: messages that are the rows, with the fields that they have; None where none is.
            led: whether the arm is led by hand: what it measures is what the other one is told, and holds.

        Returns:
            Where all that is linear has a value.
        """
        topic, there = self.states[name], np.full(len(self.time), True)
        for field in map(str, topic.frame):
            joint, _, last = field.rpartition(".")
            column = f"{short(name)}.{field}"
            if rows is not None and field in rows:
                values = rows[field].to_numpy(np.float64)
            else:
                values = topic.in_force(field, self.time)[0] if led else topic.between(field, self.time)
                share = float(np.isfinite(values).mean())
                if share < MOST_OF_THEM:
                    self.left[column] = f"its messages have it along {100.0 * share:.0f} % of the samples"
                    continue
                there &= np.isfinite(values)
            if np.isfinite(values).any():
                self._add(column, values, names.get(joint, joint), MEASURED.get(last, ""), UNITS.get(last, ""))
        return there

    def _without(self, there: NDArray[np.bool_], why: str) -> None:
        if there.any() and not there.all():
            self.notes.append(f"{int((~there).sum())} samples, at which {why}, are left out")
            self._cut(there)
        self.columns["stamp"] = self.time - self.time[0]

    # --- what was commanded ------------------------------------------------------------------------------------------

    def _told(self, name: str, topic: Topic) -> None:
        """A topic that is no state: joint states, trajectories and controllers say goals and torques of joints, other
        numbers what their names say."""
        of_joints = topic.is_a(CONTROLLER, TRAJECTORY) or (topic.is_a(JOINT_STATE) and commands(name))
        fields = {field: topic.fields.get(field, field) for field in map(str, topic.frame)}
        laid: dict[str, Array] = {}
        if topic.paths:
            laid = self._laid_out(name, topic)
            fields = {f"{joint}.goal": f"{joint}.position" for joint in laid}
        for field, meant in fields.items():
            joint, _, last = meant.rpartition(".")
            column, unit = f"{short(name)}.{field}", UNITS.get(last, "") if of_joints else ""
            owner = self.robots.owner(name, joint) if unit else None
            own, signal = (owner[1], COMMANDED[last]) if owner else ("", "")
            by = self.goals.get(own, "") if signal else ""
            if by and not by.startswith(f"{short(name)}."):
                # what a controller says that it commanded is better than what it was asked for
                self.left[column] = f"{by} is its goal as well, and is taken"
                continue
            values, late = topic.in_force(field, self.time) if not laid else (laid[joint], 0.0)
            if commands(name) and late > 1e-9 and (note := offset_note(name, f"{1e3 * late:.3g} ms")) not in self.notes:
                self.notes.append(note)
            if not np.isfinite(values).any():
                continue
            self._add(column, values, own, signal, unit)
            if signal or commands(column):
                self.commanded.append(column)
            if signal == "goal" and topic.is_a(CONTROLLER):
                self.goals[own] = column

    def _laid_out(self, name: str, topic: Topic) -> dict[str, Array]:
        """Goals of trajectories by joint."""
        measured = {}
        for joint in dict.fromkeys(joint for path in topic.paths for joint in path.joints):
            owner = self.robots.owner(name, joint)
            if owner and (column := f"{short(owner[0])}.{joint}.position") in self.columns:
                measured[joint] = self.columns[column]
        self.notes.append(
            f"goals of {name} go to its points, each `time_from_start` after its message, from the goal before or, at "
            "first, the measured position"
        )
        return laid_out(topic.paths, topic.time, self.time, measured)
