"""Zero, direction and range of each joint, found with a person's help and kept as a file with the robot.

    sealegs calibrate robot=bench port=/dev/ttyUSB0
    sealegs calibrate robot=hopper port=/dev/ttyUSB0 out=calibrations/hopper-left.yaml

Torque stays off throughout: the person moves each joint by hand. Nothing is written to the servos, and no file is
overwritten.
"""

from __future__ import annotations

import datetime
import functools
import sys
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import yaml

from ...common.atomic import STAMP, write_text
from ...common.errors import SealegsError
from ...configs.check import Count, checked
from ...configs.script import run
from ...envs.engine.base import BaseLayout
from ...envs.engine.robot import Robot
from ..bus.registers import ServoModel
from .calibration_file import FOLDER, read_joints
from .joints import (
    MAIN,
    CalibrationError,
    Joint,
    Line,
    check_gears,
    check_joints,
    checked_gears,
    gear_of,
    homing,
    line_of,
    read_lines,
    table,
)

HEAD = (
    "# zero: step of the encoder at 0; direction: 1 where steps grow with the joint; range: rad or m; per_radian:\n"
    "# how far the joint moves per radian of its servo; homing_offset: of the servo, with which these steps hold\n"
)
STILL = 8  # steps that a joint at rest may wander
MOVED = 0.092  # [rad] of the servo's shaft that count as moved; 60 steps of 4096 a turn
SEAM = 0.5  # share of a turn: a jump beyond it between two readings went over the encoder's seam
INSIDE = 0.02  # [rad] of the servo's shaft by which the range stays inside the stops that were found
PERIOD = 0.02  # [s] between two readings


class Encoders(Protocol):
    """What calibration needs of a bus."""

    def scan(self, ids: Iterable[int] = ...) -> dict[int, int]:
        """Model number by id of the servos that answer."""
        ...

    def torque_off(self, ids: Sequence[int]) -> Mapping[int, Exception]:
        """Switch torque off."""
        ...

    def read_register(self, servo: int, name: str) -> int:
        """A register's count."""
        ...


def guide(
    bus: Encoders,
    robot: Robot,
    servo: ServoModel,
    params: Mapping[str, float],
    ask: Callable[[str], str] = input,
    say: Callable[[str], None] = print,
    done: Sequence[Joint] = (),
    keep: Callable[[list[Joint]], None] = lambda _: None,
    line: Line = MAIN,
    names: Sequence[str] | None = None,
    gears: Mapping[str, float] | None = None,
    port: str | None = None,
) -> list[Joint]:
    """Ask a person through the calibration of every joint on one bus.

    Args:
        bus: with the servos, open.
        robot: whose joints are looked for.
        servo: model of the servos.
        params: numbers of the robot other than its own.
        ask: prints a question and waits for the answer.
        say: prints a line.
        done: joints of an earlier try, which are not asked for again.
        keep: called with the joints so far as soon as one is done.
        line: the bus.
        names: of the joints on it; None: all of the robot.
        gears: how far a joint moves per radian of its servo, by pattern of names; 1 where none fits.
        port: path of the bus, for what a person is to type; None: not known.

    Raises:
        CalibrationError: too few servos, or a range that cannot be reached.
        EOFError: the person has gone.
    """
    every = [item.name for item in robot.coordinates]
    names = every if names is None else list(names)
    say(f"Looking for the servos of '{robot.name}': {', '.join(names)}.")
    ids = sorted(bus.scan())
    say(f"Found {len(ids)}: {', '.join(map(str, ids)) or 'none'}.")
    if len(ids) < len(names):
        raise CalibrationError(
            f"robot '{robot.name}' has {len(names)} joint(s), but {len(ids)} servo(s) answer; check power and "
            "wiring, and that no two have one id: connect them one at a time and give each its own."
        )
    if failed := bus.torque_off(ids):
        raise CalibrationError(f"torque cannot be switched off: {next(iter(failed.values()))}")
    say("Torque is off. Support the robot: it may sag.")
    limits, units = robot.goal_limits(robot.parameters(params)), BaseLayout(robot, params).units
    units = {item.name: units[item.terms[0][0]] for item in robot.coordinates}
    joints = [joint for joint in done if joint.name in names and joint.id in ids]
    if joints:
        say(f"Kept from before: {', '.join(joint.name for joint in joints)}.")
    for name in [name for name in names if name not in [joint.name for joint in joints]]:
        number = _choose(bus, name, [n for n in ids if n not in [j.id for j in joints]], servo, ask, say)
        gear = gear_of(name, gears or {}) or 1.0
        found = _joint(
            bus, name, number, limits=limits[name], servo=servo, ask=ask, say=say, per_radian=gear, unit=units[name],
            port=port,
        )  # fmt: skip
        joints.append(replace(found, line=line))
        keep(joints)
    joints.sort(key=lambda joint: names.index(joint.name))
    if names == every:
        check_joints(joints, robot, servo, params, port)
    return joints


def write_calibration(
    path: Path, robot: Robot, servo: ServoModel, joints: Sequence[Joint], replace: bool = False
) -> None:
    """Write a calibration; with ``replace``, over one that is not finished.

    Raises:
        CalibrationError: the file exists; a calibration is never overwritten.
    """
    document = {
        "robot": robot.name,
        "servo": servo.name,
        "date": datetime.datetime.now().astimezone().isoformat(timespec="seconds"),
        "joints": {joint.name: as_row(joint) for joint in joints},
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        write_text(path, HEAD + yaml.safe_dump(document, sort_keys=False), replace)
    except FileExistsError:
        raise CalibrationError(f"{path} exists, and a calibration is never overwritten; give another out=.") from None


def unfinished(out: Path | None, robot: Robot) -> Path:
    """Where the joints that are done wait for the others.

    Beside ``out``, of whose machine they are; None: in the folder, since the name that a calibration gets there by
    itself is another one at each try.
    """
    return FOLDER / f"{robot.name}.unfinished" if out is None else out.with_name(f"{out.name}.unfinished")


def kept(
    path: Path,
    robot: Robot,
    work: Callable[[Sequence[Joint], Callable[[list[Joint]], None]], list[Joint]],
    servo: ServoModel,
    lines: Sequence[Line] = (),
) -> list[Joint]:
    """Calibrate, going on where an earlier try ended; each joint is on the disk as soon as it is done.

    Args:
        path: of the joints that are done.
        robot: whose joints they are.
        work: calibrates: takes the joints that are done and what keeps them.
        servo: model of the servos.
        lines: buses beside the first one.

    Raises:
        CalibrationError: it did not come to its end; says what is kept.
    """
    done = read_joints(path, robot, servo, lines) if path.is_file() else []

    def keep(joints: list[Joint]) -> None:
        done[:] = joints
        write_calibration(path, robot, servo, joints, replace=True)

    try:
        return work(list(done), keep)
    except (EOFError, KeyboardInterrupt, SealegsError) as error:
        why = {EOFError: "the terminal was closed", KeyboardInterrupt: "it was stopped"}.get(type(error), str(error))
        names = ", ".join(joint.name for joint in done)
        rest = (
            f"{names} {'is' if len(done) == 1 else 'are'} kept in {path}: start again to go on from there, or delete it"
        )
        raise CalibrationError(
            f"the calibration did not come to its end: {why.rstrip('.')}; {rest if done else 'nothing is saved'}."
        ) from None


def as_row(joint: Joint) -> dict[str, Any]:
    """A joint as its file has it."""
    row = {
        "id": joint.id,
        "zero": joint.zero,
        "direction": joint.direction,
        "range": [round(joint.low, 4), round(joint.high, 4)],
    }
    if joint.per_radian != 1.0:
        row |= {"range": [joint.low, joint.high], "per_radian": joint.per_radian}
    if joint.line.servo is not None:
        row["servo"] = joint.line.servo.name
    return row if joint.homing_offset is None else {**row, "homing_offset": joint.homing_offset}


# --- one joint -----------------------------------------------------------------------------------------------------


def _choose(
    bus: Encoders,
    name: str,
    free: list[int],
    servo: ServoModel,
    ask: Callable[[str], str],
    say: Callable[[str], None],
) -> int:
    """The servo of a joint: the one that a person moves."""
    needed = round(MOVED / servo.step)
    if len(free) == 1:
        say(f"\n{name}: servo {free[0]}, the only one left.")
        return free[0]
    while True:
        before = {number: _still(bus, number) for number in free}
        ask(f"\n{name}: move this joint by hand, a good bit, and leave it there; then press Enter. ")
        moved = {number: abs(_shortest(_still(bus, number) - before[number], servo)) for number in free}
        best = max(moved, key=lambda number: moved[number])
        others = [n for n in free if n != best and moved[n] > 0.5 * moved[best]]
        if moved[best] >= needed and not others:
            say(f"{name}: servo {best}.")
            return best
        say(
            f"Servos {best} and {others[0]} both moved; move one joint only."
            if moved[best] >= needed
            else f"Nothing moved by more than {needed} steps; try again."
        )


def _joint(
    bus: Encoders,
    name: str,
    number: int,
    limits: tuple[float, float],
    servo: ServoModel,
    ask: Callable[[str], str],
    say: Callable[[str], None],
    per_radian: float,
    unit: str,
    port: str | None,
) -> Joint:
    step, needed = servo.step * per_radian, round(MOVED / servo.step)
    (low, high), digits = limits, 2 if unit == "rad" else 4
    reach = max(high, 0.0) - min(low, 0.0)
    at = 0.0 if reach < step * servo.steps else round(0.5 * (low + high), digits)  # 0 may be beyond the encoder's turn
    ask(f"{name}: bring it to {at:g} {unit} as the robot's documentation defines it, hold it still, press Enter. ")
    place = _still(bus, number)
    far = "" if per_radian == 1.0 else " of its servo's shaft"
    while True:
        ask(f"{name}: move it in its positive direction, between 5 and 90 degrees{far}; press Enter. ")
        moved = _shortest(_still(bus, number) - place, servo)
        if abs(moved) >= needed:
            break
        say(f"It moved by {moved} steps only, and {needed} are needed; try again.")
    direction = 1 if moved > 0 else -1
    zero = round(place - direction * at / step)
    say(f"{name}: the robot works between {low:.{digits}f} and {high:.{digits}f} {unit}.")
    steps = _sweep(bus, number, lambda: ask(f"{name}: move it slowly from stop to stop; press Enter when done. "))
    shifts = servo.role("homing_offset")
    offset = None if shifts is None else bus.read_register(number, shifts)
    if np.abs(np.diff(steps)).max(initial=0) > SEAM * servo.steps:
        raise CalibrationError(_over_the_seam(name, number, steps, servo, offset, port))
    ends = sorted(direction * (float(edge) - zero) * step for edge in (steps.min(), steps.max()))
    low, high = ends[0] + INSIDE * per_radian, ends[1] - INSIDE * per_radian
    joint = Joint(
        name, id=number, zero=zero, direction=direction, low=low, high=high, homing_offset=offset, per_radian=per_radian
    )
    say(f"{name}: zero at step {zero}, direction {direction:+d}, range {low:.{digits}f} to {high:.{digits}f} {unit}.")
    return joint


def _over_the_seam(
    name: str, number: int, steps: np.ndarray, servo: ServoModel, offset: int | None, port: str | None
) -> str:
    """That a sweep went over the encoder's seam, and what helps: nothing where it went round by a whole turn."""
    seam = f"the encoder's seam (step 0 and {servo.steps - 1}), which the servo cannot cross"
    path = np.unwrap(steps, period=servo.steps)
    if servo.steps == servo.resolution and np.ptp(path) >= servo.steps:
        return (
            f"joint {name} went round by {np.ptp(path) / servo.steps:.1f} turns and so over {seam}: in position mode a "
            "joint has less than one turn; calibrate it again, and move it only as far as it is to go."
        )
    mend = homing(servo, number, float(path.min() + path.max()) / 2.0, offset, port)
    return f"joint {name}: its range goes over {seam}; {mend}turn the horn by half a turn and calibrate again."


def _still(bus: Encoders, number: int, attempts: int = 50) -> int:
    """Step at which a servo rests.

    Raises:
        CalibrationError: it does not come to rest.
    """
    window: list[int] = []
    for _ in range(attempts):
        window = [*window[-4:], bus.read_register(number, "present_position")]
        if len(window) == 5 and max(window) - min(window) <= STILL:
            return int(np.median(window))
        time.sleep(PERIOD)
    raise CalibrationError(
        f"servo {number} does not come to rest (last steps {window}); hold it still and start again."
    )


def _sweep(bus: Encoders, number: int, until: Callable[[], object]) -> np.ndarray:
    """Steps of a servo while a person moves it, until ``until`` returns (n,)."""
    steps: list[int] = []
    failed: list[BaseException] = []
    done = threading.Event()

    def watch() -> None:
        try:
            while not done.is_set():
                steps.append(bus.read_register(number, "present_position"))
                time.sleep(PERIOD)
        except BaseException as error:  # told by the thread that asked
            failed.append(error)

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        until()
    finally:
        done.set()
        watcher.join()
    if failed:
        raise failed[0]
    return np.array([*steps, bus.read_register(number, "present_position")])


def _shortest(steps: int, servo: ServoModel) -> int:
    """Difference of two encoder steps the short way round; as it is where the sensor does not see a whole turn."""
    if servo.steps != servo.resolution:
        return steps
    return (steps + servo.steps // 2) % servo.steps - servo.steps // 2


def _with(others: Sequence[Joint], keep: Callable[[list[Joint]], None], joints: list[Joint]) -> None:
    keep([*others, *joints])


def main(arguments: list[str]) -> None:
    """Calibrate the robot that the command line names."""
    from ...configs.compose import compose, split
    from ...envs.robots import get_robot
    from ..bus.registers import load_model
    from ..bus.servo_bus import ServoBus
    from .own_robot import READERS

    config = compose("calibrate", split(arguments, plain=("port", "out")), readers=READERS)
    if config["port"] is None:
        raise SealegsError("port=<path> is missing: name the adapter's port, such as /dev/ttyUSB0.")
    settings, rate = config["robot"], checked("baudrate", config["baudrate"], Count)
    robot, servo = get_robot(settings["name"]), load_model(settings["servo"])
    stamp = datetime.datetime.now().strftime(STAMP)
    given = None if config["out"] is None else Path(str(config["out"]))
    out, partial = given or FOLDER / f"{robot.name}-{stamp}.yaml", unfinished(given, robot)
    if out.exists():
        raise CalibrationError(f"{out} exists, and a calibration is never overwritten; give another out=.")
    params = table(settings, "params")
    names = [item.name for item in robot.coordinates]
    lines = read_lines(table(settings, "buses"), [*names, *table(settings, "sensors")])
    gears = checked_gears(table(settings, "gears"), robot)

    def work(done: Sequence[Joint], keep: Callable[[list[Joint]], None]) -> list[Joint]:
        check_gears(done, gears, partial)
        joints = list(done)
        for line in (MAIN, *lines):
            here = [name for name in names if line_of(name, lines) == line]
            if not here:
                continue
            rest = [joint for joint in joints if joint.name not in here]
            model, port = line.model(servo), str(line.port if line.name else config["port"])
            with ServoBus(port, line.baudrate or rate, model.name) as bus:
                mine = [joint for joint in joints if joint.name in here]
                told = functools.partial(_with, rest, keep)
                asked = {"line": line, "names": here, "gears": gears, "port": port}
                found = guide(bus, robot, model, params, done=mine, keep=told, **asked)
            joints = [*rest, *found]
        joints.sort(key=lambda joint: names.index(joint.name))
        check_joints(joints, robot, servo, params, str(config["port"]))
        return joints

    joints = kept(partial, robot, work, servo, lines)
    write_calibration(out, robot, servo, joints)
    partial.unlink(missing_ok=True)
    print(f"\nWritten: {out}. sealegs deploy takes the newest of {FOLDER}/, or calibration={out}.")


if __name__ == "__main__":
    sys.exit(run(main, "calibrate", __doc__ or "", sys.argv[1:]))
