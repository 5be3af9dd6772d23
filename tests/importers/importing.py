"""Recordings that tests of the import share: a motion, tables of it, and what is proposed for them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.gap.log.importers import Proposed, Recording, propose_for
from sealegs.gap.log.importers.claims import claims_of
from sealegs.gap.log.importers.dialects import dialects
from sealegs.gap.log.importers.names import Claim

TIME = np.arange(0.0, 10.0, 0.01)
ANGLE = 0.6 * np.sin(2.0 * TIME) + 0.2 * np.sin(5.1 * TIME)
LATE = 0.6 * np.sin(2.0 * (TIME - 0.04)) + 0.2 * np.sin(5.1 * (TIME - 0.04))
DEG = 180.0 / np.pi
RAD = {"goal_rad": ANGLE, "pos_rad": LATE}


TICK = 2.0 * np.pi / 4096


def motion(seconds: float = 20.0, rate: float = 200.0, lag: float = 0.05, seed: int = 0) -> dict[str, np.ndarray]:
    """A goal and a joint that follows it late [s, rad, rad/s], read by an encoder of 4096 ticks."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, 1.0 / rate)
    rates, phases, sizes = np.array([1.3, 3.1, 7.0]), rng.uniform(0, 6, 3), np.array([0.6, 0.3, 0.08])

    def angle(t: np.ndarray) -> np.ndarray:
        return (sizes * np.sin(rates * t[:, None] + phases)).sum(1)

    def speed(t: np.ndarray) -> np.ndarray:
        return (sizes * rates * np.cos(rates * t[:, None] + phases)).sum(1)

    position = 0.9 * angle(time - lag)
    return {
        "time": time,
        "goal": angle(time),
        "position": np.round(position / TICK) * TICK,
        "smooth": position,
        "velocity": 0.9 * speed(time - lag) + rng.normal(0.0, 0.01, len(time)),
    }


def table(folder: Path, columns: dict[str, np.ndarray], name: str = "run.csv") -> Path:
    """Columns as a CSV file."""
    path = folder / name
    rows = np.stack(list(columns.values()), axis=1)
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.12g", encoding="utf-8")
    return path


def proposed(folder: Path, columns: dict[str, np.ndarray], unit: str | None = None, timed: bool = True) -> Proposed:
    """What is proposed for columns, at 100 Hz where they have no time and need one."""
    clock = {"time": TIME} if timed and not any("time" in name.lower() for name in columns) else {}
    return propose_for(table(folder, clock | columns), folder / "out", unit)


def asked(found: Proposed) -> dict[str, str]:
    """The question about each column of the log that is in question."""
    return {name: question.ask for question in found.mapping.questions for name in question.about}


def spoken(names: Iterable[str]) -> dict[str, Claim]:
    """What is said of the columns of a header, read together."""
    recording = Recording("run", {name: np.zeros(3) for name in names}, Path("run.csv"), "table")
    return claims_of(recording, dialects())


# --- bags as robots record them, written by the library's own writers ------------------------------------------------

START = 1.7e9
STATES, TRAJECTORY = "sensor_msgs/msg/JointState", "trajectory_msgs/msg/JointTrajectory"
LIST, POINT = "std_msgs/msg/Float64MultiArray", "trajectory_msgs/msg/JointTrajectoryPoint"
CONTROLLER = "control_msgs/msg/JointTrajectoryControllerState"
NEW, OLD = ("reference", "feedback", "error", "output"), ("desired", "actual", "error")
NONE = np.array([])
Points = Sequence[tuple[float, Sequence[float], Sequence[float]]]


class Bag:
    """A bag: of ROS 1 (``bag``), of ROS 2 in ``db3`` or ``mcap``.

    A ``db3`` carries no definitions, as ROS 2 Humble writes it, but where the parts of a controller's state are given,
    as ROS 2 Jazzy does.
    """

    def __init__(self, path: Path, storage: str = "db3", parts: Sequence[str] = ()) -> None:
        pytest.importorskip("rosbags")
        from rosbags.rosbag1 import Writer as Writer1
        from rosbags.rosbag2 import StoragePlugin
        from rosbags.rosbag2 import Writer as Writer2
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self.store = get_typestore(Stores.ROS1_NOETIC if storage == "bag" else Stores.ROS2_HUMBLE)
        named = "std_msgs/Header header\nstring[] joint_names\n"
        points = "".join(f"trajectory_msgs/JointTrajectoryPoint {part}\n" for part in parts or NEW)
        self.store.register(get_types_from_msg(named + points, CONTROLLER))
        self.path, self.storage, self.parts, self.topics = path, storage, parts, dict[str, Any]()
        plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
        version: Any = 9 if parts else 8
        self.writer: Any = Writer1(path) if storage == "bag" else Writer2(path, version=version, storage_plugin=plugin)

    def __enter__(self) -> Bag:
        self.writer.open()
        return self

    def __exit__(self, *_: object) -> None:
        import sqlite3

        self.writer.close()
        for file in self.path.glob("*.db3") if not self.parts else ():
            with sqlite3.connect(file) as data:
                data.execute("DELETE FROM message_definitions")

    def put(self, topic: str, kind: str, seconds: float, stamp: float | None = None, **fields: Any) -> None:
        """A message received at a time after the start [s], with its stamp [s]; by default both are the same."""
        types, received = self.store.types, round(1e9 * seconds) + round(1e9 * START)
        if topic not in self.topics:
            self.topics[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        if kind != LIST:
            stamped = received if stamp is None else round(1e9 * stamp)
            time = types["builtin_interfaces/msg/Time"](sec=stamped // 10**9, nanosec=stamped % 10**9)
            counted = {"seq": 0} if self.storage == "bag" else {}
            fields["header"] = types["std_msgs/msg/Header"](stamp=time, frame_id="", **counted)
        raw = self.store.serialize_ros1 if self.storage == "bag" else self.store.serialize_cdr
        self.writer.write(self.topics[topic], received, raw(types[kind](**fields), kind))

    def state(
        self, topic: str, seconds: float, names: Sequence[str], position: Sequence[float], stamp: float | None = None,
        velocity: Sequence[float] = (), effort: Sequence[float] = (),
    ) -> None:  # fmt: skip
        lists = {"position": position, "velocity": velocity, "effort": effort}
        fields = {key: np.array(values, float) for key, values in lists.items()}
        self.put(topic, STATES, seconds, stamp, name=list(names), **fields)

    def joints(self, topic: str, seconds: float, position: Mapping[str, float], stamp: float | None = None) -> None:
        self.state(topic, seconds, list(position), list(position.values()), stamp)

    def numbers(self, topic: str, seconds: float, values: Sequence[float]) -> None:
        """A list without names, which has no stamp."""
        layout = self.store.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
        self.put(topic, LIST, seconds, layout=layout, data=np.array(values, float))

    def point(self, positions: Sequence[float], velocities: Sequence[float] = (), after: float = 0.0) -> Any:
        duration = self.store.types["builtin_interfaces/msg/Duration"]
        return self.store.types[POINT](
            positions=np.array(positions, float),
            velocities=np.array(velocities, float),
            accelerations=NONE,
            effort=NONE,
            time_from_start=duration(sec=int(after), nanosec=round(1e9 * (after - int(after)))),
        )

    def trajectory(self, topic: str, seconds: float, names: Sequence[str], points: Points) -> None:
        """Points as ``(after [s], positions, velocities)``."""
        made = [self.point(positions, velocities, after) for after, positions, velocities in points]
        self.put(topic, TRAJECTORY, seconds, joint_names=list(names), points=made)

    def controller(
        self, topic: str, seconds: float, goals: Mapping[str, float], position: Sequence[float],
        velocities: Sequence[float] = (),
    ) -> None:  # fmt: skip
        """A state: what is commanded at some velocities, and what is measured."""
        wanted = list(goals.values())
        error = self.point([goal - one for goal, one in zip(wanted, position, strict=True)])
        said = {"error": error, "output": self.point(wanted)}
        said |= dict.fromkeys(("reference", "desired"), self.point(wanted, velocities))
        said |= dict.fromkeys(("feedback", "actual"), self.point(position))
        self.put(topic, CONTROLLER, seconds, joint_names=list(goals), **{part: said[part] for part in self.parts})
