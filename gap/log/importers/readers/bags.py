"""ROS bags, 1 and 2, and MCAP files: joint states are the rows, and commands hold their last value there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .....common.extras import needed_for
from ...types import Array, LogError
from ..claims import ARM
from ..clocks import held, in_force, offset_note
from ..recording import Recording
from .robots import Robots, robots_of
from .topics import Topic
from .trajectories import laid_out, trajectory_of

ENDINGS = (".bag", ".db3", ".mcap")
JOINT_STATE = "sensor_msgs/msg/JointState"
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
CONTROLLER, DYNAMIC = "JointTrajectoryControllerState", "DynamicJointState"
COMMAND_WORDS = ("command", "cmd", "goal", "desired", "target", "reference", "setpoint")
FIELDS = {"position": "position", "velocity": "velocity", "effort": "torque"}
"""Signals by the fields of joint states."""
UNITS = {"position": "rad", "velocity": "rad/s", "effort": "N.m", "goal": "rad", "goal_velocity": "rad/s"}
COMMANDED, MEASURED = ("reference", "desired"), ("feedback", "actual")
"""Parts of a controller's state that say what it commands, and what it measured: by the new and by the old
definition."""
POINTS = {"positions": "position", "velocities": "velocity", "effort": "effort"}
"""Fields of joint states by those of a point of a trajectory."""
LISTS = ("name", "joint_names")
"""Fields that name the joints of the lists beside them."""
SKIPPED = ("header", "layout", "multi_dof_joint_names")
WITHOUT_STAMP = 0.5
"""Share of the messages of a topic without a stamp from which its stamps say nothing."""
COVERED = 0.5
"""Share of the rows that a field of other messages must reach."""


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

    topics: dict[str, Topic] = {}
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            kinds = {connection.topic: connection.msgtype for connection in reader.connections}
            used = [c for c in reader.connections if _of_joints(c.topic, c.msgtype)]
            known = [c for c in used if c.msgtype in reader.typestore.fielddefs]
            for connection, logged, raw in reader.messages(connections=known) if known else ():
                topic = topics.setdefault(connection.topic, Topic(connection.msgtype))
                _take(topic, 1e-9 * logged, reader.deserialize(raw, connection.msgtype))
    except (AnyReaderError, OSError, ValueError, KeyError, AssertionError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise LogError(f"{path}: cannot be read as a bag: {reason}") from None
    unknown = {c.topic: c.msgtype for c in used if c not in known}
    main, notes = _main(path, topics, kinds, unknown)
    return [_Merged(topics, main, notes, unknown).recording(path)]


def _take(topic: Topic, logged: float, message: Any) -> None:
    """Add one message, which the bag received at a time [s]."""
    if topic.is_a(TRAJECTORY):
        if (points := trajectory_of(message)) is None:
            return
        topic.paths.append(points)
    else:
        topic.rows.append(dict(numbers(message)))
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    seconds = getattr(stamp, "sec", 0) + 1e-9 * getattr(stamp, "nanosec", 0)
    topic.times.append(logged)
    topic.stamps.append(float(seconds) if seconds > 0.0 else float("nan"))


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
            named = joints if len(joints) == len(value) else [f"[{k}]" for k in range(len(value))]
            for name, number in zip(named, value, strict=True):
                yield f"{name}.{path}" if name[0] != "[" else f"{path}{name}", float(number)
        elif isinstance(value, list) and len(value) == len(joints) and value and hasattr(value[0], "interface_names"):
            for joint, one in zip(joints, value, strict=True):
                for name, number in zip(one.interface_names, one.values, strict=False):
                    yield f"{joint}.{name}", float(number)
        elif hasattr(value, "__dataclass_fields__"):
            yield from numbers(value, f"{path}.", joints)


def _of_joints(topic: str, kind: str) -> bool:
    """Whether a topic may say something of joints: by its type, and where that says too little by its name."""
    plain = kind.rpartition("/")[2]
    if kind == JOINT_STATE or plain.startswith("JointTrajectory"):
        return True
    words = ("Float64", "Float32", "JointState", "DynamicJointState", "MultiArray")
    return plain.startswith(words) and (_commands(topic) or "state" in topic)


def _commands(topic: str) -> bool:
    return any(word in topic.lower() for word in COMMAND_WORDS)


def _short(topic: str) -> str:
    """A topic as names of columns begin."""
    return topic.strip("/").replace("/", ".")


# --- the topic whose messages are the rows ---------------------------------------------------------------------------


def _main(
    path: Path, topics: dict[str, Topic], kinds: Mapping[str, str], unknown: Mapping[str, str]
) -> tuple[str, list[str]]:
    """The topic whose messages are the rows of the log, and notes: most joint states with positions, or what stands in.

    Raises:
        LogError: nothing says a position.
    """
    without = f"the bag has no {JOINT_STATE} with positions"

    def measured(kind: str) -> list[str]:
        return [name for name, topic in topics.items()
                if topic.is_a(kind) and not (kind == JOINT_STATE and _commands(name))
                and any("position" in field for field in topic.names)]  # fmt: skip

    def rank(name: str) -> tuple[bool, int, str]:
        match = ARM.fullmatch(_short(name).replace(".", "_"))
        return not (match and match[2]), len(topics[name].times), name  # an arm that is led by hand comes last

    if found := measured(JOINT_STATE):
        return max(found, key=rank), []
    if found := [name for name in measured(DYNAMIC) if topics[name].with_positions()]:
        return max(found, key=rank), [f"{without}: {', '.join(found)} stands in"]
    if made := _feedback({name: topic for name, topic in topics.items() if topic.is_a(CONTROLLER)}):
        name, used, topics[made[0]] = made
        return name, [f"{without}: {name} stands in, which is what {', '.join(used)} measured"]
    there = ", ".join(f"{name} ({kind})" for name, kind in sorted(kinds.items())[:6]) or "nothing"
    if unknown:
        there = ", ".join(f"{name} ({kind})" for name, kind in unknown.items())
        raise LogError(
            f"{path}: has no {JOINT_STATE} with positions, and its storage does not say how {there} is laid out; "
            "record the joint states beside, or convert the bag to MCAP, which carries definitions (`ros2 bag "
            "convert` where ROS knows these types)."
        )
    raise LogError(f"{path}: has no {JOINT_STATE} with positions; it holds {there}.")


def _parts(name: str) -> tuple[str, str, str]:
    """Joint, part and field of a number of a controller's state, as of ``elbow.reference.positions``."""
    rest, _, last = name.rpartition(".")
    joint, _, part = rest.rpartition(".")
    return joint, part, last


def _feedback(topics: Mapping[str, Topic]) -> tuple[str, list[str], Topic] | None:
    """What controllers measured as messages of joint states, after a name for it and the topics that it is of.

    None where no controller says a position. Where several have a joint, it is of the first.
    """
    made, used, owner = Topic(JOINT_STATE), list[str](), dict[str, str]()
    for name, topic in topics.items():
        rows: list[dict[str, float]] = []
        for row in topic.rows:
            rows.append({})
            for key, value in row.items():
                joint, part, last = _parts(key)
                if joint and part in MEASURED and last in POINTS:
                    rows[-1].setdefault(f"{joint}.{POINTS[last]}", value)
        own = Topic(JOINT_STATE, topic.times, topic.stamps, rows)
        mine = {joint for joint in own.with_positions() if owner.setdefault(joint, name) == name}
        if mine:
            used.append(name)
            made.times += own.times
            made.stamps += own.stamps
            made.rows += [{key: x for key, x in row.items() if key.rpartition(".")[0] in mine} for row in rows]
    return ((f"{used[0]}/feedback" if len(used) == 1 else "/controllers/feedback"), used, made) if used else None


# --- the table -------------------------------------------------------------------------------------------------------


class _Merged:
    """The table that topics make: joint states are its rows, and commands hold their last value there."""

    def __init__(self, topics: dict[str, Topic], main: str, notes: list[str], unknown: Mapping[str, str]) -> None:
        self.main, self.unknown, self.stands_in = main, unknown, main.endswith("/feedback")
        self.silent = [name for name, topic in topics.items() if not (topic.names or topic.paths)]
        self.topics = {name: topic for name, topic in topics.items() if name not in self.silent}
        self.notes: list[str] = []
        self.times, clock = self._one_clock()
        self.of_clock = [*notes, *clock]
        self.columns: dict[str, Array] = {}
        self.roles: dict[str, str] = {}
        self.units: dict[str, str] = {}
        self.left: dict[str, str] = {}
        self.commanded: list[str] = []
        self.goals: dict[str, str] = {}  # what is the goal of a joint of the log

    def _one_clock(self) -> tuple[dict[str, Array], list[str]]:
        """Times of the messages of each topic [s], all by one clock, and notes which that is.

        Headers are stamped by the clock of the simulation or of another computer, so they do not go with times of the
        bag. The first stamps of a simulation may be missing: such messages are taken out.
        """
        missing = {name: np.isnan(topic.stamps) for name, topic in self.topics.items()}
        # no trajectory is dropped: each is a command, and a stamp of zero asks a controller to start at once
        bare = [name for name, none in missing.items()
                if (none.any() if self.topics[name].paths else none.mean() > WITHOUT_STAMP)]  # fmt: skip
        if bare:
            note = f"times are those at which the bag received the messages, since those of {bare[0]} have no stamp"
            return {name: np.array(topic.times) for name, topic in self.topics.items()}, [note]
        notes = ["times are the stamps of the messages"]
        for name, none in missing.items():
            if count := int(none.sum()):
                self.topics[name] = self.topics[name].only(~none)
                notes.append(f"{count} messages of {name} without a stamp are left out")
        return {name: np.array(topic.stamps) for name, topic in self.topics.items()}, notes

    def recording(self, path: Path) -> Recording:
        """All topics at the times of the joint states."""
        states = {
            self.main,
            *(name for name, topic in self.topics.items() if topic.is_a(JOINT_STATE) and not _commands(name)),
        }
        states = {name: self.topics[name] for name in sorted(states) if not self._apart(self.times[name])}
        robots = robots_of(states, self.times, self.main)
        self._rows(robots.joints[self.main])
        self.notes += self.of_clock
        for name in robots.joints:
            if name != self.main and name not in robots.leaders:
                called = ", ".join(robots.joints[name].values())
                self.notes.append(f"{name} is of another robot, for its joints have the same names: {called}")
                self._without(self._measured(name, robots.joints[name]), f"{name} has no value")
        rest = {name: topic for name, topic in self.topics.items() if name not in robots.joints and not topic.paths}
        for name, topic in rest.items():
            if why := self._apart(self.times[name]):
                self.left[_short(name)] = why
            elif topic.is_a(CONTROLLER):
                self._controller(name, topic, robots)
            elif topic.is_a(DYNAMIC):
                more = ", ".join(joint for joint in topic.with_positions() if joint not in robots.joints[self.main])
                has = f", which does not have {more}" if more else ": it has its joints"
                self.left[_short(name)] = f"{self.main} is taken{has}"
            else:
                self._command(name, topic, robots)
        for name, topic in self.topics.items():
            if topic.paths:
                self._trajectories(name, topic, robots)
        for name in robots.leaders:
            self._leader(name, robots.joints[name])
        self.left |= {_short(name): "its messages have no numbers of joints that are read" for name in self.silent}
        self.left |= {
            _short(name): f"the bag does not say how {kind} is laid out; converted to MCAP (`ros2 bag convert`) it does"
            for name, kind in self.unknown.items()
        }
        first = max((int(np.argmax(np.isfinite(self.columns[name]))) for name in self.commanded), default=0)
        if first:
            self.notes.append(f"the first {first} samples, before the first command, are left out")
            self._cut(np.arange(len(self.time)) >= first)
        name = path.stem if path.is_file() else path.name
        return Recording(
            name,
            columns=self.columns,
            source=path,
            kind="ros",
            facts={},
            roles=self.roles,
            notes=tuple(self.notes),
            units=self.units,
            left=self.left,
        )

    def _add(self, column: str, values: Array, joint: str = "", signal: str = "", unit: str = "") -> None:
        self.columns[column] = values
        if joint and signal:
            self.roles[column] = f"{joint.replace('/', '_')}.{signal}"
        if unit:
            self.units[column] = unit

    def _cut(self, keep: NDArray[np.bool_]) -> None:
        self.time = self.time[keep]
        self.columns = {name: values[keep] for name, values in self.columns.items()}

    def _apart(self, own: Array) -> str:
        """Why a topic cannot be held at the times of the joint states; empty where the two overlap."""
        main = self.times[self.main]
        gap = max(float(own.min() - main.max()), float(main.min() - own.max()))
        when = "after the last" if own.min() > main.max() else "before the first"
        return (
            f"its times do not overlap with those of {self.main}: all are {gap:.3g} s {when} of them"
            if gap > 0.0
            else ""
        )

    def _held(self, name: str, topic: Topic, column: str) -> Array | None:
        """A command at the rows: the one that was in force over most of each; None where none ever was."""
        times, values = topic.known(column, self.times[name])
        if not len(times):
            return None
        out, late = in_force(times, values, self.time) if _commands(name) else (held(times, values, self.time), 0.0)
        if not np.isfinite(out).any():
            return None
        if late > 1e-9 and (note := offset_note(name, f"{1e3 * late:.3g} ms")) not in self.notes:
            self.notes.append(note)
        return out

    def _rows(self, names: Mapping[str, str]) -> None:
        """The joint states: rows, and their numbers; joints that only other messages name are brought onto these
        rows."""
        topic, own, short = self.topics[self.main], self.times[self.main], _short(self.main)
        lead, rest = topic.leading()
        order = lead[np.argsort(own[lead], kind="stable")]
        keep = order[np.concatenate([[True], np.diff(own[order]) > 0.0])]
        self.time = own[keep]
        self._add("stamp", own[keep], unit="s")
        self.roles["stamp"] = "time"
        self.notes.append(f"samples are the messages of {self.main}")
        there = self._measured(self.main, names, keep, rest)
        among = [joint for joint in rest if any(name.startswith(f"{short}.{joint}.") for name in self.columns)]
        if among:
            self.notes.append(
                f"messages of {self.main} name joints in turn: samples are those of the most joints, and "
                f"{', '.join(among)} of other messages is linear between its own"
            )
        elif len(lead) < len(topic.rows):
            self.notes.append(
                f"{len(topic.rows) - len(lead)} messages of {self.main} that name other joints are left out"
            )
        self._without(there, "not all joints were measured")
        self.columns["stamp"] = self.time - self.time[0]

    def _measured(
        self, name: str, names: Mapping[str, str], rows: NDArray[np.intp] | None = None, rest: Sequence[str] = ()
    ) -> NDArray[np.bool_]:
        """Take what joint states measured, linear between their messages where these are not the rows themselves.

        Args:
            name: of the topic.
            names: of its joints in the log.
            rows: messages that are the rows; None where none is.
            rest: joints that only other messages name.

        Returns:
            Where all that is linear has a value.
        """
        short, topic, there = _short(name), self.topics[name], np.full(len(self.time), True)
        for column in topic.names:
            joint, _, last = column.rpartition(".")
            linear = rows is None or joint in rest
            values = topic.between(column, self.times[name], self.time) if linear else topic.column(column)[rows]
            share = float(np.isfinite(values).mean())
            if share and not (linear and share < COVERED):
                there &= np.isfinite(values) | (not linear)
                role, unit = FIELDS.get(last, ""), UNITS.get(last, "")
                self._add(f"{short}.{column}", values, names.get(joint, joint), role, unit)
            elif linear:
                self.left[f"{short}.{column}"] = f"its messages have it along {100.0 * share:.0f} % of the samples"
        return there

    def _without(self, there: NDArray[np.bool_], why: str) -> None:
        if there.any() and not there.all():
            self.notes.append(f"{int((~there).sum())} samples, at which {why}, are left out")
            self._cut(there)
            self.columns["stamp"] = self.time - self.time[0]

    def _command(self, name: str, topic: Topic, robots: Robots) -> None:
        """A topic that is no state: its joint states are goals and torques, other numbers what their names say."""
        short = _short(name)
        for column in topic.names:
            values = self._held(name, topic, column)
            if values is None:
                continue
            joint, _, last = column.rpartition(".")
            of_joint = topic.is_a(JOINT_STATE) and _commands(name) and last in FIELDS
            owner = robots.owner(name, joint) if of_joint else None
            signal = {"position": "goal", "effort": "torque_command"}.get(last, "") if owner else ""
            self._add(
                f"{short}.{column}", values, owner[1] if owner else joint, signal, UNITS[last] if of_joint else ""
            )
            if _commands(f"{short}.{column}") and np.isnan(values[0]):
                self.commanded.append(f"{short}.{column}")

    def _controller(self, name: str, topic: Topic, robots: Robots) -> None:
        """What a controller says that it commands, as goals of the joints that the joint states have."""
        short = _short(name)
        for column in topic.names:
            joint, part, last = _parts(column)
            times, cells = topic.known(column, self.times[name])
            values = held(times, cells, self.time) if len(times) else np.full(len(self.time), np.nan)
            state, own = robots.owner(name, joint) or ("", joint)
            if part == "time_from_start":
                self.left[f"{short}.{part}"] = "a time along the trajectory, no clock"
            elif joint not in robots.joints.get(state, {}) or not np.isfinite(values).any():
                self.columns |= {f"{short}.{column}": values} if np.isfinite(values).any() else {}
            elif f"{_short(state)}.{joint}.position" not in self.columns:
                self.left[f"{short}.{joint}"] = f"{state} has its position along too few of the samples"
            elif part in MEASURED:
                self.left |= {} if self.stands_in else {f"{short}.{part}": f"{state} says what these joints measured"}
            elif part not in COMMANDED or last not in ("positions", "velocities"):
                which = f"{part}.{last}" if part in COMMANDED else part
                self.left[f"{short}.{which}"] = "a value within the controller, which the log has no column for"
            else:
                self._reference(short, joint, part, last, own, values)

    def _reference(self, short: str, joint: str, part: str, last: str, own: str, values: Array) -> None:
        """A position or velocity that a controller commands: the first controller of a joint has it."""
        goal = f"{short}.{joint}.{part}.positions"
        if last == "positions" and self.goals.setdefault(own, goal) == goal:
            self._goal(goal, values, own)
        elif last == "positions":
            self.left[f"{short}.{joint}.{part}"] = f"{self.goals[own]} is its goal as well, and is taken"
        elif self.goals.get(own) == goal and np.isnan(values[np.isfinite(self.columns[goal])]).any():
            # it would cost the samples between
            self.left[f"{short}.{joint}.{part}.{last}"] = "it begins after the goal"
        elif self.goals.get(own) == goal:
            self._add(f"{short}.{joint}.{part}.{last}", values, own, "goal_velocity", UNITS["velocity"])

    def _goal(self, column: str, values: Array, joint: str) -> None:
        self._add(column, values, joint, "goal", UNITS["goal"])
        if np.isnan(values[0]):
            self.commanded.append(column)

    def _trajectories(self, name: str, topic: Topic, robots: Robots) -> None:
        """The goals of a topic of trajectories, laid out in time."""
        short, starts = _short(name), self.times[name]
        ends = starts + np.array([one.after[-1] for one in topic.paths])
        if why := self._apart(np.concatenate([starts, ends])):
            self.left[short] = why
            return
        joints = dict.fromkeys(joint for one in topic.paths for joint in one.joints)
        owners = {joint: robots.owner(name, joint) or ("", "") for joint in joints}
        positions = {
            joint: self.columns.get(f"{_short(state)}.{joint}.position") for joint, (state, _) in owners.items()
        }
        measured = {joint: values for joint, values in positions.items() if values is not None}
        added = False
        for joint, goal in laid_out(topic.paths, starts, self.time, measured).items():
            own = owners[joint][1]
            if own in self.goals and any(part in self.goals[own] for part in COMMANDED):
                # what the controller says that it commanded is better than what it was asked for
                self.left[f"{short}.{joint}"] = f"points on the way to {self.goals[own]}, which is taken"
            elif np.isfinite(goal).any():
                self._goal(f"{short}.{joint}.goal", goal, own)
                added = True
        if added:
            self.notes.append(
                f"goals of {name} go to its points, each `time_from_start` after its message, from the goal before or, "
                "at first, the measured position"
            )

    def _leader(self, name: str, names: Mapping[str, str]) -> None:
        """Positions of an arm that is led by hand are the goals of the one that follows it, where it has no other."""
        short, topic, added = _short(name), self.topics[name], False
        for column in topic.names:
            joint, _, last = column.rpartition(".")
            own = names.get(joint, joint)
            if last != "position" or f"{own.replace('/', '_')}.goal" in self.roles.values():
                self.left[f"{short}.{column}"] = f"{last} of the arm that leads"
                continue
            times, values = topic.known(column, self.times[name])
            self._goal(f"{short}.{column}", in_force(times, values, self.time)[0], own)
            added = True
        if added:
            self.notes.append(f"{name} is led by hand: its positions are the goals of the arm that follows it")
