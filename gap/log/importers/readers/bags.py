"""ROS bags, 1 and 2, and MCAP files: joint states are the rows, and commands hold their last value there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from .....common.extras import needed_for
from ...types import Array, LogError
from ..clocks import offset_note
from ..recording import MOST_OF_THEM, Recording
from .robots import Robots, is_led, robots_of
from .topics import CONTROLLER, DYNAMIC, JOINT_STATE, TRAJECTORY, Topic, commands, joint_of, numbers, short
from .trajectories import laid_out, trajectory_of

ENDINGS = (".bag", ".db3", ".mcap")
MEASURED_FIELDS = {"position": "position", "velocity": "velocity", "effort": "torque"}
COMMANDED_FIELDS = {"position": "goal", "effort": "torque_command"}
"""Signals by the fields of joint states, measured and commanded."""
UNITS = {"position": "rad", "velocity": "rad/s", "effort": "N.m", "positions": "rad", "velocities": "rad/s"}
REFERENCE, FEEDBACK = ("reference", "desired"), ("feedback", "actual")
"""Parts of a controller's state that say what it commands, and what it measured: by the new and by the old
definition."""
REFERENCE_FIELDS = {"positions": "goal", "velocities": "goal_velocity"}
POINT_FIELDS = {"positions": "position", "velocities": "velocity", "effort": "effort"}
"""Fields of joint states by those of a point of a trajectory."""


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
    left = {short(name): "its messages have no numbers of joints that are read" for name in messages
            if messages[name].silent}  # fmt: skip
    unknown = {c.topic: c.msgtype for c in used if c not in known}
    left |= {short(name): f"the bag does not say how {kind} is laid out; converted to MCAP (`ros2 bag convert`) it does"
             for name, kind in unknown.items()}  # fmt: skip
    topics, notes = _on_one_clock({name: own for name, own in messages.items() if not own.silent})
    main, stands_in = _main(path, topics, kinds, unknown)
    table = _Table(topics, main)
    table.merge()
    name = path.stem if path.is_file() else path.name
    notes = [*table.notes, *stands_in, *notes]
    left = table.left | left
    return [Recording(name, table.columns, path, "ros", roles=table.roles, notes=tuple(notes), units=table.units,
                      left=left)]  # fmt: skip


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
    def paths(self) -> bool:
        return self.kind == TRAJECTORY

    @property
    def silent(self) -> bool:
        return not any(self.content)

    def take(self, logged: float, message: Any) -> None:
        content = trajectory_of(message) if self.paths else dict(numbers(message))
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
        if self.paths:
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
            if none.mean() > (0.0 if messages[name].paths else MOST_OF_THEM)]  # fmt: skip
    notes = ["times are the stamps of the messages"]
    notes += [f"{none.sum()} messages of {name} without a stamp are left out" for name, none in missing.items()
              if none.any()]  # fmt: skip
    if bare:
        notes = [f"times are those at which the bag received the messages, since those of {bare[0]} have no stamp"]
    return {name: own.topic(0 if bare else 1) for name, own in messages.items()}, notes


def _main(
    path: Path, topics: dict[str, Topic], kinds: Mapping[str, str], unknown: Mapping[str, str]
) -> tuple[str, list[str]]:
    """The topic whose messages are the rows of the log, and notes: most joint states with positions, or what stands in.

    Raises:
        LogError: nothing says a position.
    """
    without = f"the bag has no {JOINT_STATE} with positions"
    measured = {name: topic for name, topic in topics.items() if topic.with_positions() and not commands(name)}

    def rank(name: str) -> tuple[bool, int, str]:  # an arm that is led by hand comes last
        return not is_led(short(name).replace(".", "_")), len(topics[name].frame), name

    if found := [name for name, topic in measured.items() if topic.is_a(JOINT_STATE)]:
        return max(found, key=rank), []
    if found := [name for name, topic in measured.items() if topic.is_a(DYNAMIC)]:
        return max(found, key=rank), [f"{without}: {', '.join(found)} stands in"]
    if feedback := _feedback(topics):
        name = f"{next(iter(feedback))}/feedback" if len(feedback) == 1 else "/controllers/feedback"
        topics[name] = Topic(JOINT_STATE, pd.concat(feedback.values()).sort_index(kind="stable"))
        return name, [f"{without}: {name} stands in, which is what {', '.join(feedback)} measured"]
    there = ", ".join(f"{name} ({kind})" for name, kind in sorted(kinds.items())[:6]) or "nothing"
    if unknown:
        there = ", ".join(f"{name} ({kind})" for name, kind in unknown.items())
        raise LogError(
            f"{path}: has no {JOINT_STATE} with positions, and its storage does not say how {there} is laid out; "
            "record the joint states beside, or convert the bag to MCAP, which carries definitions (`ros2 bag "
            "convert` where ROS knows these types)."
        )
    raise LogError(f"{path}: has no {JOINT_STATE} with positions; it holds {there}.")


def _parts(field: str) -> tuple[str, str, str]:
    """Joint, part and field of a number of a controller's state, as of ``elbow.reference.positions``."""
    rest, _, last = field.rpartition(".")
    joint, _, part = rest.rpartition(".")
    return joint, part, last


def _feedback(topics: Mapping[str, Topic]) -> dict[str, pd.DataFrame]:
    """What controllers measured, by topic, as joint states have it: a joint that several have is of the first."""
    found: dict[str, pd.DataFrame] = {}
    taken: set[str] = set()
    for name, topic in topics.items():
        fields = {field: _parts(str(field)) for field in topic.frame} if topic.is_a(CONTROLLER) else {}
        own = {field: f"{joint}.{POINT_FIELDS[last]}" for field, (joint, part, last) in fields.items()
               if part in FEEDBACK and last in POINT_FIELDS and joint not in taken}  # fmt: skip
        if any(field.endswith(".position") for field in own.values()):
            measured: Any = topic.frame[list(own)]
            found[name] = measured.rename(columns=own)
            taken |= {*map(joint_of, own.values())}
    return found


class _Table:
    """The table that topics make: joint states are its rows, and commands hold their last value there."""

    def __init__(self, topics: Mapping[str, Topic], main: str) -> None:
        self.topics, self.main = topics, main
        self.time: Array = np.zeros(0)
        self.columns: dict[str, Array] = {}
        self.roles: dict[str, str] = {}
        self.units: dict[str, str] = {}
        self.left: dict[str, str] = {}
        self.notes: list[str] = []

    def merge(self) -> None:
        """All topics at the times of the joint states."""
        apart = {name: why for name, topic in self.topics.items() if (why := self._apart(topic))}
        self.left |= {short(name): why for name, why in apart.items()}
        near = {name: topic for name, topic in sorted(self.topics.items()) if name not in apart}
        measured = {name: topic for name, topic in near.items()
                    if name == self.main or (topic.is_a(JOINT_STATE) and not commands(name))}  # fmt: skip
        robots = robots_of(measured, self.main)
        self._rows(robots.joints[self.main])
        for name in robots.joints:
            if name != self.main:
                called = ", ".join(robots.joints[name].values())
                led = any(map(is_led, robots.joints[name].values()))
                what = "led by hand" if led else "of another robot"
                self.notes.append(f"{name} is {what}, for its joints have the same names: {called}")
                self._without(self._measured(name, robots.joints[name], led=led), f"{name} has no value")
        for name, topic in near.items():
            if topic.is_a(CONTROLLER):
                self._controller(name, topic, robots)
            elif topic.is_a(DYNAMIC) and name != self.main:
                more = [joint for joint in topic.with_positions() if joint not in robots.joints[self.main]]
                has = f", which does not have {', '.join(more)}" if more else ": it has its joints"
                self.left[short(name)] = f"{self.main} is taken{has}"
            elif name not in robots.joints and not topic.paths:
                self._command(name, topic, robots)
        for name, topic in near.items():
            if topic.paths:
                self._trajectories(name, topic, robots)
        commanded = [values for column, values in self.columns.items() if self._commands(column)]
        first = max((int(np.argmax(np.isfinite(values))) for values in commanded), default=0)
        if first:
            self.notes.append(f"the first {first} samples, before the first command, are left out")
            self._cut(np.arange(len(self.time)) >= first)

    def _commands(self, column: str) -> bool:
        told = self.roles.get(column, "").rpartition(".")[2]
        return told == "goal" or (not told and commands(column)) or told == "torque_command"

    def _add(self, column: str, values: Array, joint: str = "", signal: str = "", unit: str = "") -> None:
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
        main, own = self.topics[self.main].time, topic.time
        last = max((start + path.after[-1] for start, path in zip(own, topic.paths, strict=False)), default=own[-1])
        gap = max(float(own[0] - main[-1]), float(main[0] - last))
        when = "after the last" if own[0] > main[-1] else "before the first"
        why = f"its times do not overlap with those of {self.main}: all are {gap:.3g} s {when} of them"
        return why if gap > 0.0 else ""

    # --- what was measured -------------------------------------------------------------------------------------------

    def _rows(self, names: Mapping[str, str]) -> None:
        """The joint states: rows, and their numbers; joints that only other messages name are brought onto these
        rows."""
        topic = self.topics[self.main]
        lead, rest = topic.leading()
        rows: Any = topic.frame[lead]
        rows = rows[~rows.index.duplicated()]
        self.time = rows.index.to_numpy(np.float64)
        self._add("stamp", self.time, unit="s")
        self.roles["stamp"] = "time"
        self.notes.append(f"samples are the messages of {self.main}")
        there = self._measured(self.main, names, rows, rest)
        among = [
            joint for joint in rest if any(name.startswith(f"{short(self.main)}.{joint}.") for name in self.columns)
        ]
        if among:
            self.notes.append(
                f"messages of {self.main} name joints in turn: samples are those of the most joints, and "
                f"{', '.join(among)} of other messages is linear between its own"
            )
        elif not lead.all():
            self.notes.append(f"{int((~lead).sum())} messages of {self.main} that name other joints are left out")
        self._without(there, "not all joints were measured")

    def _measured(
        self, name: str, names: Mapping[str, str], rows: pd.DataFrame | None = None, rest: Sequence[str] = (),
        led: bool = False,
    ) -> NDArray[np.bool_]:  # fmt: skip
        """Take what joint states measured, linear between their messages where these are not the rows themselves.

        Args:
            name: of the topic.
            names: of its joints in the log.
            rows: messages that are the rows; None where none is.
            rest: joints that only other messages name.
            led: whether the arm is led by hand: what it measures is what the other one is told, and holds.

        Returns:
            Where all that is linear has a value.
        """
        topic, there = self.topics[name], np.full(len(self.time), True)
        for field in map(str, topic.frame):
            joint, _, last = field.rpartition(".")
            column = f"{short(name)}.{field}"
            if rows is not None and joint not in rest:
                values = rows[field].to_numpy(np.float64)
            else:
                values = topic.in_force(field, self.time)[0] if led else topic.between(field, self.time)
                share = float(np.isfinite(values).mean())
                if share < MOST_OF_THEM:
                    self.left[column] = f"its messages have it along {100.0 * share:.0f} % of the samples"
                    continue
                there &= np.isfinite(values)
            if np.isfinite(values).any():
                self._add(column, values, names.get(joint, joint), MEASURED_FIELDS.get(last, ""), UNITS.get(last, ""))
        return there

    def _without(self, there: NDArray[np.bool_], why: str) -> None:
        if there.any() and not there.all():
            self.notes.append(f"{int((~there).sum())} samples, at which {why}, are left out")
            self._cut(there)
        self.columns["stamp"] = self.time - self.time[0]

    # --- what was commanded ------------------------------------------------------------------------------------------

    def _held(self, name: str, topic: Topic, field: str) -> Array:
        """A command at the rows: the one that was in force over most of each."""
        values, late = topic.in_force(field, self.time)
        if commands(name) and late > 1e-9 and (note := offset_note(name, f"{1e3 * late:.3g} ms")) not in self.notes:
            self.notes.append(note)
        return values

    def _command(self, name: str, topic: Topic, robots: Robots) -> None:
        """A topic that is no state: its joint states are goals and torques, other numbers what their names say."""
        of_joints = topic.is_a(JOINT_STATE) and commands(name)
        for field in map(str, topic.frame):
            joint, _, last = field.rpartition(".")
            owner = robots.owner(name, joint) if of_joints and last in MEASURED_FIELDS else None
            signal = COMMANDED_FIELDS.get(last, "") if owner else ""
            unit = UNITS.get(last, "") if of_joints else ""
            values = self._held(name, topic, field)
            if np.isfinite(values).any():
                self._add(f"{short(name)}.{field}", values, owner[1] if owner else joint, signal, unit)

    def _controller(self, name: str, topic: Topic, robots: Robots) -> None:
        """What a controller says that it commands, as goals of the joints that the joint states have."""
        for field in map(str, topic.frame):
            joint, part, last = _parts(field)
            column, state, own = f"{short(name)}.{field}", *(robots.owner(name, joint) or ("", joint))
            signal = REFERENCE_FIELDS.get(last, "") if part in REFERENCE else ""
            values = self._held(name, topic, field) if signal else np.zeros(0)
            if part in FEEDBACK:
                why = "" if self.main.endswith("/feedback") else f"{state} says what these joints measured"
                self.left |= {f"{short(name)}.{part}": why} if why else {}
            elif not signal:
                self.left[f"{short(name)}.{part}"] = "a value within the controller, which the log has no column for"
            elif joint not in robots.joints.get(state, {}):
                self._add(column, values)
            elif f"{short(state)}.{joint}.position" not in self.columns:
                self.left[f"{short(name)}.{joint}"] = f"{state} has its position along too few of the samples"
            elif taken := self._goal_of(own, f"{short(name)}.{joint}.{part}.") if signal == "goal" else "":
                self.left[f"{short(name)}.{joint}.{part}"] = f"{taken} is its goal as well, and is taken"
            elif signal == "goal":
                self._add(column, values, own, signal, UNITS[last])
            elif (goal := self._goal_of(own)) and goal.startswith(f"{short(name)}."):
                if np.isnan(values[np.isfinite(self.columns[goal])]).any():  # it would cost the samples between
                    self.left[column] = "it begins after the goal"
                else:
                    self._add(column, values, own, signal, UNITS[last])

    def _goal_of(self, joint: str, but: str = "") -> str:
        """The column that is the goal of a joint already; empty where there is none."""
        goal = f"{joint.replace('/', '_')}.goal"
        others = (name for name, role in self.roles.items() if role == goal)
        return next((name for name in others if not (but and name.startswith(but))), "")

    def _trajectories(self, name: str, topic: Topic, robots: Robots) -> None:
        """The goals of a topic of trajectories, laid out in time."""
        owners = {joint: robots.owner(name, joint) or ("", "") for path in topic.paths for joint in path.joints}
        measured = {joint: self.columns[column] for joint, (state, _) in owners.items()
                    if (column := f"{short(state)}.{joint}.position") in self.columns}  # fmt: skip
        added = False
        for joint, goal in laid_out(topic.paths, topic.time, self.time, measured).items():
            own, taken = owners[joint][1], self._goal_of(owners[joint][1])
            if any(f".{part}." in taken for part in REFERENCE):
                # what the controller says that it commanded is better than what it was asked for
                self.left[f"{short(name)}.{joint}"] = f"points on the way to {taken}, which is taken"
            elif np.isfinite(goal).any():
                self._add(f"{short(name)}.{joint}.goal", goal, own, "goal", UNITS["position"])
                added = True
        if added:
            self.notes.append(
                f"goals of {name} go to its points, each `time_from_start` after its message, from the goal before or, "
                "at first, the measured position"
            )
