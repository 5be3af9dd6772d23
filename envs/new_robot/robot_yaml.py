"""Writes the YAML of a robot from its model file, with comments that tell what each line decides."""

from __future__ import annotations

import dataclasses
import json
import os
import re
import textwrap
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import yaml

from ...actuators import load_chain
from ...actuators.chain import names as names_of_chains
from ...actuators.stages.controller import UNLIMITED
from ...common.atomic import write_text
from ...common.errors import WARNING, SealegsError
from ..described.as_robot import as_robot, bare_model
from ..described.model_file import UNITS, ModelFile, read_model
from ..described.robot_assumed import (
    chosen,
    motor_note,
    none_to_drive,
    passive,
    passive_sentence,
    reduction_note,
    tied_note,
)
from ..described.robot_described import HINGES, LIMIT, FileJoint, RobotFile
from ..described.robot_entries import FileEntry, FloorEntry
from ..described.robot_file import assembled, load_robot_file
from ..described.robot_imu import seat_of_imu
from ..engine.numbers import RobotError
from .robot_trial import steady
from .stance import on_legs

HEAD = """\
# Robot {name}, written from {model} by sealegs new-robot; edit what is wrong.
# The page "Your own robot" of the documentation explains each line.
# Of numbers that the model and a chain can both hold (damping, armature, frictionloss) one counts: the chain's, or the
# model file's, which then takes the chain's place. They are never added.
model: {path}   # MJCF or URDF, relative to this file
base: {base}   # fixed to the ground, or free
{ground}timestep: {timestep:.10g}   # of the simulation [s]
integrator: {integrator}   # RK4, Euler, implicit or implicitfast
joints:   # that servos drive, in the order of goals
"""

TAIL = """\
deploy:   # for sealegs deploy; what is left out is as with robot=bench
  servo: {servo}
  rest: release   # at the end: release, hold, or sit
  sensors: {{}}   # encoders that drive nothing, such as elbow.link: {{id: 7}}
  # limits other than those of robot=bench
  safety:{safety}
"""


SERVO = "sts3215"
"""Model of the servos where the chain tells none; assumed."""


@dataclass(frozen=True)
class AssumedLimits:
    """Limits of safety that nobody stated.

    Attributes:
        limits: by name of the limit and of the joint [rad, m, rad/s or m/s]; only joints that the limits of
            ``configs/robot/bench.yaml`` do not fit.
        said: sentences about limits of the model file that excitations may not keep to.
        reach: of excitations [rad or m], by joint, at which they would; only of such joints.
    """

    limits: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    said: tuple[str, ...] = ()
    reach: Mapping[str, float] = field(default_factory=dict)


def none_assumed(robot: RobotFile) -> AssumedLimits:
    """No limits but those of ``configs/robot/bench.yaml``."""
    del robot
    return AssumedLimits()


def no_servo(chain: str) -> None:
    """No model of servos, whatever the chain."""
    del chain


def write_robot_yaml(
    model: Path,
    out: Path,
    chain: str | None = None,
    reserved: Collection[str] = (),
    limits_of: Callable[[RobotFile], AssumedLimits] = none_assumed,
    servo_of: Callable[[str], str | None] = no_servo,
) -> tuple[str, ...]:
    """Write the YAML of a model, and return what was assumed in it, a sentence each.

    Args:
        model: MJCF or URDF.
        out: file to write; it must not exist.
        chain: that drives every joint; None: an ideal servo as the model has it.
        reserved: words that joints should not be called by, since columns of logs are.
        limits_of: assumes limits of safety for a robot.
        servo_of: the model of the servos that a chain describes, by its name; None: of no servo with a register table.

    Raises:
        RobotError: the model cannot be read, ``out`` exists, or what was written cannot be read.
    """
    text, said = robot_yaml(model, out, chain, reserved, limits_of, servo_of)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        write_text(out, text)
    except FileExistsError:
        raise RobotError(f"{out} exists, and is not overwritten; give another out=.") from None
    try:
        load_robot_file(out)
    except BaseException:  # what cannot be read is no robot
        out.unlink(missing_ok=True)
        raise
    return said


def robot_yaml(
    model: Path,
    out: Path,
    chain: str | None = None,
    reserved: Collection[str] = (),
    limits_of: Callable[[RobotFile], AssumedLimits] = none_assumed,
    servo_of: Callable[[str], str | None] = no_servo,
) -> tuple[str, tuple[str, ...]]:
    """The text that :func:`write_robot_yaml` writes, and what was assumed."""
    facts = read_model(model)
    names, held = chosen(facts)
    if not names:
        raise RobotError(f"{model}: {none_to_drive(facts)}")
    belts = {drive.name: dict(drive.terms) for drive in facts.drives if drive.terms != ((drive.name, 1.0),)}
    if chain is not None and Path(chain).suffix in (".yaml", ".yml"):
        chain = os.path.relpath(Path(chain).resolve(), out.resolve().parent)
    wheels = {name: wheel_chain(chain) for name in names if chain is not None and name in facts.wheels}
    rows: dict[str, Any] = {name: {"chain": wheels.get(name, chain)} for name in names}
    for name, belt in belts.items():
        rows[name]["belt"] = belt
    path = os.path.relpath(model.resolve(), out.resolve().parent)
    try:
        robot = steady(on_wheels(on_legs(assembled(out.resolve(), FileEntry(path, joints=rows)))))
    except SealegsError as error:
        raise RobotError(str(error).replace(f"{out.resolve()}: ", f"{model}: ")) from None  # there is no such file yet
    head = HEAD.format(
        name=robot.name,
        model=model.name,
        path=in_yaml(path),
        base=robot.base,
        ground=_ground(robot),
        timestep=robot.timestep,
        integrator=robot.integrator,
    )
    undriveable = (*facts.undriveable, *held)
    assumed = limits_of(robot)
    limited = {name for values in assumed.limits.values() for name in values}
    more = {joint.name: _more_notes(facts, joint, chain, reserved, limited) for joint in robot.joints}
    lines = [
        _joint(number, joint, rows[joint.name]["chain"], belts.get(joint.name), more[joint.name])
        for number, joint in enumerate(robot.joints, 1)
    ]
    left = [f"# Left out: {reason}.\n" for reason in undriveable]
    left += [
        f"# Joint {name} is not driven: it follows {other or 'a place'}.\n" for name, other in facts.followers.items()
    ]
    driven = [name for joint in robot.joints for name, _ in joint.terms]
    left += [f"# Nothing drives {what}: it moves freely.\n" for what in passive(facts, driven)]
    said = (*robot.said, *assumed.said, *(f"joint {name}: {note}." for name, notes in more.items() for note in notes))
    said = (*said, *(f"{reason}; it is left out." for reason in undriveable))
    said = (*said, *passive_sentence(facts, driven), *_chain_on_slides(robot, chain))
    said = (*said, *_unlike_wheels(facts, robot, wheels, chain))
    servo, untold = _servo(chain, servo_of)
    said = (*said, *(f"{model.name}: {sentence}" for sentence in untold))
    said = tuple(sorted(said, key=lambda sentence: sentence.startswith(WARNING)))  # at the end they are seen
    return head + "".join(lines) + "".join(left) + TAIL.format(servo=servo, safety=_safety(assumed)), said


def _ground(robot: RobotFile) -> str:
    """What a robot on legs stands on, and how, and what tells it how it leans."""
    lines = []
    if robot.floor is not None:
        lines.append(
            f"floor: {{friction: {robot.floor.friction:g}}}   # level, at height 0; its sliding friction, assumed"
        )
    if robot.height is not None:
        lines.append(f"height: {_number(robot.height)}   # of the base where episodes start [m]")
    if robot.exclude:
        lines.append(f"exclude: {_flow([list(pair) for pair in robot.exclude])}   # bodies that never touch")
    if robot.feet:
        lines.append(f"feet: {_flow(list(robot.feet))}   # without a shape in the file: boxes of their inertias touch")
    if robot.base == "free":
        what = "rate, delay, noise and bias as in the page An IMU, assumed; remove the line if it has none"
        lines.append(f"imu: {_flow(seat_of_imu(as_robot(robot)))}   # on its base: {what}")
    return "".join(f"{line}\n" for line in lines)


def _more_notes(
    facts: ModelFile, joint: FileJoint, chain: str | None, reserved: Collection[str], limited: Collection[str]
) -> list[str]:
    """What somebody who edits a file for the first time should know of a joint, a phrase each."""
    notes = []
    drive = next((drive for drive in facts.drives if drive.name == joint.name), None)
    if (
        chain is not None and drive is not None and drive.stiffness <= 0.0 and not joint.by_speed
    ):  # without a chain, assembling noted it
        notes.append(motor_note(drive, joint.kind))
    if chain is not None and drive is not None and drive.tied:
        notes.append(tied_note(drive))
    notes += [reduction_note(facts, name) for name, _ in joint.terms if name in facts.reductions]
    named = joint.terms == ((joint.name, 1.0),)
    if note := name_note(joint.name, named, reserved):
        # limits under the name of a joint of the model still count, those of a belt do not
        notes.append(note if named or joint.name not in limited else f"{note}, and under deploy: safety as well")
    return notes


def _chain_on_slides(robot: RobotFile, chain: str | None) -> tuple[str, ...]:
    """That the numbers of a chain which was given to hinges and slides alike count in other units at slides."""
    slides = [joint.name for joint in robot.joints if joint.kind == "slide"]
    if chain is None or not slides or len(slides) == len(robot.joints):
        return ()
    return (
        f"Where a joint is a slide ({', '.join(slides)}), numbers of '{chain}' count as N and m, at hinges as N.m and "
        "rad; give slides a chain of their own.",
    )


def wheel_chain(chain: str) -> str | None:
    """The chain of a servo's speed mode, beside that of its position mode; None: there is none, or it is one itself."""
    if load_chain(chain).command == "goal_velocity":
        return chain
    return name if (name := f"{chain}_wheel") in names_of_chains() else None


def _unlike_wheels(
    facts: ModelFile, robot: RobotFile, wheels: Mapping[str, str | None], chain: str | None
) -> tuple[str, ...]:
    """What was taken for a wheel, and that a chain of position goals cannot drive one."""
    found = []
    if lost := [name for name, own in wheels.items() if own is None]:
        found.append(
            f"{WARNING}{', '.join(lost)}: '{chain}' is told positions and there is no chain '{chain}_wheel', so an "
            "ideal speed drive takes its place; give one with velocity_pi."
        )
    endless = [joint for joint in robot.joints if not joint.by_speed and facts.joints[joint.joint].range is None]
    whole = 2.0 * np.pi - 0.01  # a leg's keep to less
    if hinges := [item.name for item in endless if item.kind == "hinge" and item.range[1] - item.range[0] > whole]:
        found.append(
            f"{facts.path.name}: {', '.join(hinges)} {'turn' if len(hinges) > 1 else 'turns'} without end and is told "
            "positions, as nothing says that it is a wheel; if it is, give it a chain such as sts3215_wheel."
        )
    return tuple(found)


def _servo(chain: str | None, servo_of: Callable[[str], str | None]) -> tuple[str, tuple[str, ...]]:
    """The model of the servos with what the YAML says of it, and a sentence where a given chain tells none."""
    if chain is not None and (servo := servo_of(chain)) is not None:
        return f"{servo}   # model of its servos, which the chain {in_yaml(chain)} describes", ()
    line = f"{SERVO}   # model of its servos, such as sts3250, scs0009, xl330_m288; assumed"
    if chain is None:
        return line, ()
    return line, (f"deploy: servo is {SERVO}, assumed, as no register table belongs to '{chain}'; write your servos'.",)


def _safety(assumed: AssumedLimits) -> str:
    """The limits that joints need in place of those of ``configs/robot/bench.yaml``."""
    rows = [
        f"    {key}: {_flow({**values, '*': HINGES[key]} if key in HINGES else dict(values))}   # {what}, assumed"
        for key, what in (
            ("range_margin", "beyond the range; slides in m"),
            ("speed", "measured, a second; slides in m; as the model states, or above what excitations need"),
            ("following_error", "behind its goal, of ideal servos: leave it out with other chains"),
        )
        if (values := assumed.limits.get(key))
    ]
    if assumed.reach:
        rows.append(
            f"    # excitations keep to the velocity limits of the model with reach='{json.dumps(assumed.reach)}'"
        )
    return "".join(f"\n{row}" for row in rows) if rows else " {}"


def _joint(number: int, joint: FileJoint, chain: str | None, belt: dict[str, float] | None, more: Sequence[str]) -> str:
    position, force = UNITS[joint.kind]
    drive: Any = chain
    if drive is None:
        stage = "ideal_velocity" if joint.by_speed else "ideal"
        ideal = dataclasses.asdict(joint.chain.find(stage))
        kept = {key: ideal[key] for key in ("stiffness", "damping") if ideal.get(key)}
        limit = {"torque_limit": ideal["torque_limit"]} if ideal["torque_limit"] < UNLIMITED else {}
        drive = [{stage: kept | limit}]
    units = {
        "damping": f"{force}.s/{position}",
        "armature": "kg.m2" if joint.kind == "hinge" else "kg",
        "frictionloss": force,
        LIMIT: force,
    }
    lines = [f"  {in_yaml(joint.name)}:   # {joint.kind}, {position} and {force}"]
    for note in (*joint.notes, *more):
        lines += textwrap.wrap(
            f"{note[:1].upper()}{note[1:]}.", 120, initial_indent="    # ", subsequent_indent="    #   "
        )
    if belt is not None:
        lines.append(f"    belt: {_flow(belt)}   # driven is the sum of these joints, times their coefficients")
    lines.append(f"    chain: {_flow(drive)}   # a chain by its name, such as sts3215 or xl330, a file, or stages")
    low, high = (round(end, 6) for end in joint.range)
    lines.append(f"    range: {_flow([low, high])}   # of its goals [{joint.goal_unit}]")
    for key, owner in joint.owners.items():
        value = joint.model_values[key]
        if key == LIMIT and not value:
            continue
        lines.append(f"    {key}: {owner}   # chain or file; the file has {value:g} {units[key]}")
    start = round(joint.start, 6) if joint.by_speed else min(max(round(joint.start, 6), low), high)
    lines.append(f"    start: {_number(start)}   # of episodes [{position}]")
    lines.append("    unknown: []   # what nobody measured: zero, direction, friction, armature, motor, load")
    lines.append(f"    servo: {{id: {number}}}   # and zero: its step at 0, direction: 1 or -1")
    return "\n".join(lines) + "\n"


def _flow(value: Any) -> str:
    if isinstance(value, str):
        return in_yaml(value)
    return yaml.safe_dump(
        value, allow_unicode=True, default_flow_style=True, width=float("inf"), sort_keys=False
    ).strip()


def _number(value: float) -> str:
    """A number as YAML reads it back: not 4e-05, which is a word there."""
    return _flow([float(value)])[1:-1]


# --- names of joints, and those that logs or the command line cannot take --------------------------------------------


SLASHES = "/\\"
"""What no log can have in the name of a joint, since files of a diagnosis are named for it."""
SPECIAL = "!\"#&'(),:;<=>[]^`{}~"
"""What the command line takes for something else where it stands without quotes."""
WORDS = ("true", "false", "null", "nan", "inf")


def in_yaml(word: str) -> str:
    """A word as it stands in a YAML: in quotes where it would be read as anything else."""
    if any(ord(letter) < 32 for letter in word):
        return json.dumps(word)
    plain = yaml.safe_dump([word], default_flow_style=True, width=float("inf"), allow_unicode=True)[1:-2]
    return f"'{plain}'" if plain == word and _is_number(word) else plain


def name_note(name: str, single: bool, reserved: Collection[str]) -> str:
    """What a joint's name keeps from working, and the way out, as a phrase; empty where all works.

    Args:
        name: of the driven coordinate.
        single: whether it is one joint of the model, and no belt.
        reserved: words that columns of logs are.
    """
    other = f"my_{name}"
    if name in reserved:
        why = f"logs have columns '{name}.*' that belong to no joint, so a log of this robot cannot be read"
    elif any(letter in name for letter in SLASHES):
        why = "its name has a slash, so a log of this robot cannot be read: a diagnosis names files for joints"
        other = _without_signs(name)
    elif any(letter in SPECIAL or ord(letter) > 126 or ord(letter) < 32 for letter in name):
        why = "its name has a sign that needs quotes on the command line"
        other = _without_signs(name)
    elif _is_number(name) or name.lower() in WORDS:
        why = "its name reads as a value, so that it needs quotes on the command line"
        other = f"joint_{_without_signs(name)}"
    else:
        return ""
    if not single:
        return f"{why}; give it another name here, such as {other}"
    return f"{why}; give the joint another name here and name the model's: {other}: {{joint: {in_yaml(name)}, ...}}"


def _without_signs(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9_]+", "_", name).strip("_") or "joint"


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


# --- whether a robot whose base hangs in the air has wheels to stand on, and the height at which they touch the
# ground.

LEVEL = 0.6  # sine of the angle between an axle and the vertical, from which a wheel rolls; assumed


def on_wheels(robot: RobotFile) -> RobotFile:
    """The robot with a free base on a floor that its wheels touch, and a sentence that says so.

    Left as it is one that has no two wheels with a round shape, or a place to stand of its own.
    """
    model = robot.model
    if robot.height is not None or not model.root or model.floor or model.free:
        return robot
    if any(joint.body == model.root for joint in model.joints.values()):
        return robot
    wheels = [joint.joint for joint in robot.joints if joint.by_speed and model.wheels.get(joint.joint, 0.0) > 0.0]
    if len(wheels) < 2:
        return robot
    compiled = bare_model(replace(robot, base="free"))
    data = mujoco.MjData(compiled)
    mujoco.mj_kinematics(compiled, data)
    numbers = {name: compiled.joint(name).id for name in wheels}
    rolling = [name for name, k in numbers.items() if np.hypot(*data.xaxis[k][:2]) > LEVEL]
    if len(rolling) < 2:
        return robot
    base = float(data.xpos[compiled.body(model.root).id][2])
    lowest = min(float(data.xanchor[numbers[name]][2]) - model.wheels[name] for name in rolling)
    height = float(f"{base - lowest:.4g}")
    sentence = (
        f"{model.path.name}: it stands on wheels ({', '.join(rolling)}): base is free, with a floor, at a height of "
        f"{height:g} m, where they touch it."
    )
    return replace(robot, base="free", floor=FloorEntry(), height=height, said=(*robot.said, sentence))
