"""A measured log that is written while the robot moves, and is complete up to the last cycle whatever happens.

    sealegs repair-log logs/run.csv    writes its whole samples into a copy beside it

Each cycle is one line and one write to the file, so that a kill -9 leaves whole lines; a thread brings them to the disk
every 50 ms, so that a power cut costs no more than that. The other commands read the file as it is. Only a power cut
can leave a torn line, which the copy leaves out.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...common.atomic import write_text
from ...common.documents import DocumentError, parse_json
from ...common.errors import SealegsError
from ...configs.script import run
from ...envs.engine.imu import COLUMNS
from ...gap.log.sidecar import Sidecar, read_sidecar, sidecar_text
from ...gap.log.types import LogError
from ..machine.robot import Reading

SYNC = 0.05  # [s] between two times that the file is brought to the disk
FORMATS = {
    "goal": "%.6f",
    "position": "%.6f",
    "velocity": "%.5f",
    "duty": "%.3f",
    "voltage": "%.2f",
    "current": "%.4f",
    "temperature": "%.1f",
    "link_position": "%.6f",
}
"""Of the signals of each joint; the last one is of those with an encoder of their own behind the spring."""
TAKEN = "{}: exists already and a recording is never overwritten; choose another name or folder"
HOST = ("read_sent", "read_done", "goal_sent")
"""Host's clock [s]: as the request for the readings went out, as the last reply had come, as the goals went out."""


class MeasuredLog:
    """One run's log: ``<name>.csv``, its sidecar ``<name>.yaml``, and ``<name>.events.jsonl``.

    Attributes:
        path: of the table.
        events_path: of the events: starts, failures of the bus, faults, ends; one JSON object a line.
        cells: which of :data:`FORMATS` there are of each joint (k, s), in the order of columns.
        base: number of columns ``base.*``.
        rows: written so far.
    """

    def __init__(
        self,
        folder: Path,
        name: str,
        sidecar: Sidecar,
        joints: Sequence[str],
        base: Sequence[str],
        links: Sequence[bool] | np.ndarray = (),
        told: Mapping[str, str] | None = None,
    ) -> None:
        """Make the files; the sidecar is on the disk before the first row.

        Args:
            folder: to write into.
            name: of the run, a plain file name.
            sidecar: of the log.
            joints: in the order of rows.
            base: columns ``base.*``.
            links: whether each joint has an encoder behind its spring (k,); empty: none has.
            told: column of a joint's goals, by joint, where that is not ``goal``.

        Raises:
            LogError: there is such a log, or the disk refuses.
        """
        if not name or name != Path(name).name or name.startswith("."):
            raise LogError(f"a run cannot be called {name!r}; use a name that is a plain file name.")
        self.path, self.events_path = folder / f"{name}.csv", folder / f"{name}.events.jsonl"
        self.cells, self.base = np.ones((len(joints), len(FORMATS)), bool), len(base)
        self.cells[:, -1] = links if len(links) else False
        self.rows = 0
        goals = dict.fromkeys(joints, "goal") | dict(told or {})
        names = tuple(FORMATS)
        signals = [(joints[k], names[signal]) for k, signal in np.argwhere(self.cells).tolist()]
        named = [f"{joint}.{goals[joint] if signal == 'goal' else signal}" for joint, signal in signals]
        columns = ["time", *named]
        columns += [*(f"base.{item}" for item in base), *(f"host.{item}" for item in HOST)]
        columns += [f"host.{joint}_status" for joint in joints]
        self._format = ",".join(
            ["%.6f", *(FORMATS[signal] for _, signal in signals), *("%.6f" for _ in base)]
            + ["%.6f"] * len(HOST)
            + ["%d"] * len(joints)
        )
        self._format += "\n"
        made: list[Path] = []  # by this process: what another one makes meanwhile is its recording
        beside = folder / f"{name}.yaml"
        taken = [folder / f"{name}{end}" for end in (".csv", ".parquet", ".yaml", ".yml")]
        try:
            folder.mkdir(parents=True, exist_ok=True)
            for path in taken:
                if path.exists():
                    raise LogError(TAKEN.format(path))
            write_text(beside, sidecar_text(sidecar))  # which refuses a file that is there, as O_EXCL does
            made.append(beside)
            self._file = os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o644)
            made.append(self.path)
            self._events = os.open(self.events_path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
            _write_whole(self._file, (",".join(columns) + "\n").encode())
            os.fsync(self._file)
            self._size = os.fstat(self._file).st_size
        except OSError as error:
            for path in made:  # what a full disk took a part of is no recording
                with contextlib.suppress(OSError):
                    path.unlink(missing_ok=True)
            if isinstance(error, FileExistsError) and folder.is_dir():
                raise LogError(TAKEN.format(self.path if made else beside)) from None
            raise LogError(f"{self.path}: cannot be written: {error.strerror}") from None
        _sync_folder(folder)
        self._failed: OSError | None = None
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._keep_on_disk, daemon=True)
        self._thread.start()

    def write(self, time: float, signals: np.ndarray, base: Any, host: Sequence[float], status: Any) -> None:
        """Append one cycle.

        Args:
            time: of the readings [s] since the start of the run.
            signals: those of ``cells``, joint by joint.
            base: values of the ``base`` columns.
            host: clock readings of :data:`HOST` [s] since the start of the run; NaN where no goal went out.
            status: fault bits of each joint (k,).

        Raises:
            LogError: the disk refuses, such as a full one.
        """
        if self._failed is not None:
            raise LogError(f"{self.path}: cannot be written: {self._failed.strerror}")
        try:
            self._size += _write_whole(
                self._file, (self._format % (time, *signals.ravel().tolist(), *base, *host, *status)).encode()
            )
        except OSError as error:
            with contextlib.suppress(OSError):
                os.ftruncate(self._file, self._size)  # a part of a row would keep the whole ones from being read
            raise LogError(f"{self.path}: cannot be written: {error.strerror}; the rows before are safe") from None
        self.rows += 1

    def event(self, time: float, kind: str, **details: Any) -> None:
        """Append an event at ``time`` [s] since the start of the run; never raises: it is called on the way to rest."""
        line = json.dumps({"time": round(time, 6), "event": kind, **details}, default=str)
        with contextlib.suppress(OSError):
            _write_whole(self._events, (line + "\n").encode())

    def close(self) -> None:
        """Bring everything to the disk and close the files.

        A table without a row is no recording, and would keep its folder from being diagnosed: it goes, with its
        sidecar. The events stay.
        """
        self._closing.set()
        self._thread.join()
        for file in (self._file, self._events):
            with contextlib.suppress(OSError):
                os.fsync(file)
            os.close(file)
        if self.rows == 0:
            for path in (self.path, self.path.with_suffix(".yaml")):
                path.unlink(missing_ok=True)

    def _keep_on_disk(self) -> None:
        while not self._closing.wait(SYNC):
            try:
                os.fsync(self._file)
                os.fsync(self._events)
            except OSError as error:  # a full disk may show only here
                self._failed = error
                return


def _write_whole(file: int, data: bytes) -> int:
    written = os.write(file, data)
    while written < len(data):  # a disk that fills up may take a part
        written += os.write(file, data[written:])
    return written


def _sync_folder(folder: Path) -> None:
    with contextlib.suppress(OSError):  # not every system lets a folder be opened
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def read_events(log: Path) -> list[dict[str, Any]]:
    """Events of a log, a torn last line left out."""
    found = []
    for line in log.with_name(f"{log.stem}.events.jsonl").read_text().splitlines():
        with contextlib.suppress(DocumentError):
            found.append(parse_json(line))
    return found


def recover(path: Path) -> tuple[Path, int]:
    """Copy the whole lines of a log that a power cut tore.

    Args:
        path: of the table.

    Returns:
        The new file, ``<name>-recovered.csv`` with a sidecar of its own, and the number of lines that were left out.

    Raises:
        LogError: there is no such log, nothing in it is whole, or the new file exists.
    """
    try:
        lines = path.read_bytes().split(b"\n")
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from None
    width = lines[0].count(b",")
    whole = lines[:1]
    for line in lines[1:-1]:  # what follows the last line break is torn
        if line.count(b",") != width or not _numeric(line):
            break
        whole.append(line)
    if len(whole) < 2:
        raise LogError(f"{path}: holds no whole sample.")
    target = path.with_name(f"{path.stem}-recovered.csv")
    for file in (target, target.with_suffix(".yaml")):
        if file.exists():
            raise LogError(f"{file}: exists already and a recording is never overwritten; move it elsewhere.")
    write_text(target.with_suffix(".yaml"), sidecar_text(read_sidecar(path)))
    write_text(target, b"\n".join([*whole, b""]).decode())
    return target, sum(line != b"" for line in lines) - len(whole)


def _numeric(line: bytes) -> bool:
    try:
        return all(cell == b"" or float(cell) == float(cell) or cell == b"nan" for cell in line.split(b","))
    except ValueError:
        return False


def main(arguments: list[str]) -> None:
    """Recover the log that the command line names."""
    if len(arguments) != 1:
        raise SealegsError("give the log that a power cut tore, such as logs/bench/run.csv.")
    target, left_out = recover(Path(arguments[0]))
    print(f"{target}: all whole samples; {left_out} torn line(s) left out.")


def make_sidecar(
    robot: str, params: Mapping[str, float], actuators: Mapping[str, Any], meta: Mapping[str, Any]
) -> Sidecar:
    """Sidecar of a run on servos; the host's clock stamps its samples."""
    return Sidecar(robot, dict(params), dict(actuators), {"sample_clock": "host", **meta})


if __name__ == "__main__":
    if {"-h", "--help"} & set(sys.argv[1:]):
        sys.exit(print((__doc__ or "").strip()))
    sys.exit(run(main, "", "", sys.argv[1:]))


# --- the row of a control cycle --------------------------------------------------------------------------------------


def write_cycle(
    log: MeasuredLog,
    reading: Reading,
    fresh: tuple[np.ndarray, np.ndarray, np.ndarray],
    goal: np.ndarray,
    sent: float,
    zero: float,
) -> None:
    """Append a cycle, if all joints were read in it: a row holds nothing older, and a log needs every position.

    What an encoder beside them measures is NaN where it stayed silent.

    Args:
        log: to write.
        reading: of the cycle.
        fresh: which joints, far sides of springs and quantities of the base were read in it, as
            :meth:`sealegs.hw.machine.robot.ServoRobot.fresh` says.
        goal: that the servos have (k,) [rad].
        sent: clock as the goals went out [s]; NaN where none did.
        zero: clock at the start of the run [s].
    """
    joints, links, base = fresh
    if not joints.all():
        return
    state = reading.state
    values = {"goal": goal, "link_position": np.where(links, reading.link, np.nan), **vars(reading)}
    columns = [values[signal] for signal in FORMATS]
    host = (reading.before - zero, reading.after - zero, sent - zero)
    status = state.status[: len(goal)] if state is not None else ()
    measured = np.full(log.base, np.nan)
    found = [*np.where(base, reading.base_position, np.nan), *_turn(reading)][: log.base]
    measured[: len(found)] = found
    log.write(reading.time - zero, np.stack(columns, axis=1)[log.cells], measured, host, status)


def _turn(reading: Reading) -> np.ndarray:
    """Cells of :attr:`sealegs.envs.engine.imu.Imu.columns`; NaN, or none, where the IMU has said nothing new."""
    turn = reading.imu
    if turn is None or not turn.fresh:
        return np.full(len(COLUMNS), np.nan)
    return np.array([*turn.orientation, *turn.turn_rate, reading.time - turn.time, *turn.switches])
