"""What a model file makes of a joint where the YAML says nothing: the range of its goals and an ideal servo.

What is read from an actuator, and what is assumed, is noted: the notes become sentences on the terminal and comments of
the YAML that ``sealegs new-robot`` writes.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

from ...actuators import Chain, load_chain
from ...actuators.chain import no_load_speed
from ...actuators.stages.controller import Ideal
from ...actuators.stages.friction import Friction
from ...common.errors import SealegsError
from ..engine.numbers import RobotError
from .model_drives import ModelDrive
from .model_file import UNITS, ModelFile
from .urdf_text import NO_STOP, urdf_speeds

BANDWIDTH = 4.0  # [Hz] at least, of the ideal servo that stands for a drive whose gain the file does not say
FULL_FORCE = 0.125  # of the range: position error at which that servo gives its largest force
RESOLVED = 0.5  # of a timestep times a servo's natural frequency, at most: the engine resolves its damping below that
SLIDE_REACH = 0.5  # [m] to either side, of a slide without a range
SAME = 1e-6  # of a range [rad or m]: what differs by less is the same
TOLD = 0.01  # of a range: goals that end nearer to its ends are not worth a word
RADIANS = "in radians, whatever the compiler's angle"
"""What a control range is, and an angle in the YAML of a robot."""
BOUNDS = {field.name: field.metadata for field in dataclasses.fields(Ideal)}
STIFFEST, MOST_DAMPED = float(BOUNDS["stiffness"]["high"]), float(BOUNDS["damping"]["high"])
STRONGEST = float(BOUNDS["torque_limit"]["high"])
"""What an ideal servo takes: stiffness, damping, largest force."""


def goal_range(
    model: ModelFile, terms: Sequence[tuple[str, float]], drive: ModelDrive | None, notes: list[str]
) -> tuple[float, float]:
    """Lowest and highest goal [rad or m]: of what the joints and the controls of their actuators allow, the narrower.

    Args:
        model: as read.
        terms: joints and coefficients whose sum is driven.
        drive: of the model that drives them.
        notes: where a phrase is added if it is not the range of the joint.
    """
    kind = model.joints[terms[-1][0]].kind
    unit = UNITS[kind][0]
    stops = _reached(model, terms, notes)
    goals = drive.goals if drive is not None else None
    if drive is None or goals is None:
        if stops is None:
            stops = (-math.pi, math.pi) if kind == "hinge" else (-SLIDE_REACH, SLIDE_REACH)
            far = [item for name, _ in terms if (item := model.joints[name].range) is not None and _stops(item) is None]
            no = f"its range ({_ends(far[0], unit)}) counts as none" if far else "it has no range"
            notes.append(f"{no}; {_ends(stops, unit)} is assumed")
        elif len(terms) > 1:
            notes.append(f"its range, {_ends(stops, unit)}, is what those of {_and(terms)} add up to")
        return stops
    label = f"the control range of {_listed(drive.actuators)} ({_ends(goals, unit)})"
    if stops is None:
        notes.append(f"it has no range; its goals end with {label}")
        return goals
    both = max(stops[0], goals[0]), min(stops[1], goals[1])
    if not both[0] < both[1]:
        hint = f"; a control range is {RADIANS}" if kind == "hinge" else ""
        notes.append(f"{label} lies outside its range ({_ends(stops, unit)}), which counts{hint}")
        return stops
    narrower = max(abs(both[0] - stops[0]), abs(both[1] - stops[1]))
    if narrower <= SAME:
        return stops
    if narrower >= TOLD * (stops[1] - stops[0]):
        notes.append(f"its goals end with {label}, which is narrower than its range ({_ends(stops, unit)})")
    return both


def _reached(model: ModelFile, terms: Sequence[tuple[str, float]], notes: list[str]) -> tuple[float, float] | None:
    """Lowest and highest position of a sum of joints [rad or m], by their ranges and those of joints that follow."""
    ranges = {name: _stops(model.joints[name].range) for name, _ in terms}
    for name in ranges:
        unit = UNITS[model.joints[name].kind][0]
        for follower, offset, ratio in model.carried.get(name, ()):
            own, before = _stops(model.joints[follower].range), ranges[name]
            if own is None or not ratio:
                continue
            low, high = sorted((end - offset) / ratio for end in own)
            both = (low, high) if before is None else (max(low, before[0]), min(high, before[1]))
            label = (
                f"'{follower}', which follows it, has a range of {_ends(own, UNITS[model.joints[follower].kind][0])}"
            )
            if not both[0] < both[1]:
                notes.append(f"{label}, which its own does not let it keep to")
                continue
            ranges[name] = both
            if before is None or max(abs(both[0] - before[0]), abs(both[1] - before[1])) >= TOLD * (both[1] - both[0]):
                which = f"'{name}' goes" if len(terms) > 1 else "it goes"
                notes.append(f"{label}, so {which} from {_ends(both, unit)} only")
    return _sum_of(terms, ranges)


def joint_stops(model: ModelFile, terms: Sequence[tuple[str, float]]) -> tuple[float, float] | None:
    """Lowest and highest position of a sum of joints [rad or m] by the ranges of all of them; None: one has none."""
    return _sum_of(terms, {name: _stops(model.joints[name].range) for name, _ in terms})


def _sum_of(
    terms: Sequence[tuple[str, float]], ranges: Mapping[str, tuple[float, float] | None]
) -> tuple[float, float] | None:
    """Ends of a sum of joints times coefficients by those of each; None: one has none."""
    if len(known := [item for name, _ in terms if (item := ranges[name]) is not None]) < len(terms):
        return None
    ends = [sorted(factor * end for end in item) for item, (_, factor) in zip(known, terms, strict=True)]
    return sum(low for low, _ in ends), sum(high for _, high in ends)


def _stops(written: tuple[float, float] | None) -> tuple[float, float] | None:
    """A range, or None where it is written for none."""
    return None if written is None or max(map(abs, written)) >= NO_STOP else written


def ideal_servo(
    model: ModelFile,
    name: str,
    terms: Sequence[tuple[str, float]],
    drive: ModelDrive | None,
    limits: tuple[float, float],
    timestep: float,
    notes: list[str],
) -> tuple[Chain, float | None]:
    """An ideal servo with the numbers of the model's position actuators, or with assumed ones.

    Args:
        model: as read.
        name: of the coordinate.
        terms: joints and coefficients whose sum is driven.
        drive: of the model that drives them.
        limits: of its goals [rad or m].
        timestep: of the simulation [s].
        notes: where phrases are added that say where the numbers come from.

    Returns:
        The servo, and the stiffness that it should have at least where that is assumed, else None [N.m/rad or N/m].

    Raises:
        RobotError: the file has numbers that no servo has.
    """
    joint = model.joints[terms[-1][0]]
    ratio = abs(terms[-1][1])  # of the coordinate by the joint
    position, force = UNITS[joint.kind]
    forces = [drive.force if drive is not None else None, None if joint.force is None else joint.force / ratio]
    limit = min((item for item in forces if item is not None), default=None)
    least: float | None = None
    if drive is not None and drive.stiffness > 0.0:
        stiffness, damping, why = drive.stiffness, drive.damping, "its position actuator's"
    else:
        if drive is not None:
            notes.append(motor_note(drive, joint.kind))
        inertia = (joint.inertia + joint.armature) / ratio**2
        mobility = model.mobility_of(terms)
        dry, viscous = joint.frictionloss / ratio, joint.damping / ratio**2
        stiffness, least, why = _stiffness(limit, inertia, 1.0 / mobility, dry, viscous, limits, timestep)
        if (wanted := stiffness) > STIFFEST:
            stiffness = STIFFEST
            why = f"assumed, the most that a chain takes; {why.removeprefix('assumed, ')} would be {wanted:.4g}"
        critical = max(2.0 * math.sqrt(stiffness * inertia) - viscous, 0.0)
        damping = min(critical, 2.0 * RESOLVED / (mobility * timestep), MOST_DAMPED)
    if drive is not None and drive.tied:
        notes.append(tied_note(drive))
    values = {"stiffness": _rounded(stiffness), "damping": _rounded(damping)}
    if limit is not None and limit < STRONGEST:
        values["torque_limit"] = _rounded(limit)
    notes.append(f"an ideal servo of {values['stiffness']:g} {force}/{position} drives it ({why})")
    if drive is not None and drive.dampratio and drive.stiffness > 0.0:
        notes.append(
            f"its damping, {values['damping']:g} {force}.s/{position}, is what the engine makes of dampratio "
            f"{drive.dampratio:g} of {_listed(drive.actuators)} with kp and the inertia that it moves"
        )
    if drive is not None and drive.lost:
        plural = "s have" if len(drive.actuators) > 1 else " has"
        notes.append(
            f"its actuator{plural} {' and '.join(drive.lost)} in the file, which this servo lacks: a diagnosis would "
            "find that missing; give the joint a chain with stages for it"
        )
    try:
        chain = load_chain([{"ideal": values}])
    except SealegsError as error:
        raise RobotError(
            f"{model.path}: joint '{name}': {_listed(drive.actuators) if drive else 'it'} cannot be taken as an ideal "
            f"servo: {str(error).partition(': ')[2] or error} Correct it there, or give the joint a chain."
        ) from None
    return dataclasses.replace(chain, label=f"ideal on {name}"), least


FASTEST = 10.0  # [rad/s] of a wheel whose speed nobody stated; assumed


def speed_range(
    model: ModelFile, name: str, drive: ModelDrive | None, chain: Chain | None, notes: list[str]
) -> tuple[float, float]:
    """Lowest and highest speed goal [rad/s] of a wheel: of its actuator's controls, its chain, or what the URDF states.

    Args:
        model: as read.
        name: of the joint.
        drive: of the model that drives it.
        chain: that drives it; None: an ideal one.
        notes: where a phrase is added that says where it comes from.
    """
    if drive is not None and drive.speeds is not None:
        return drive.speeds
    stated = urdf_speeds(model.path).get(name, math.inf)
    able = math.inf if chain is None else no_load_speed(chain)
    fastest = min(stated, able)
    why = "the velocity limit of the file" if stated <= able else "its chain's speed without load"
    if not math.isfinite(fastest):
        fastest, why = FASTEST, "assumed"
    fastest = float(f"{fastest:.3g}")
    notes.append(f"it is a wheel, and its goals are speeds of up to {fastest:g} rad/s ({why})")
    return -fastest, fastest


def ideal_wheel(
    model: ModelFile,
    name: str,
    drive: ModelDrive | None,
    speeds: tuple[float, float],
    timestep: float,
    notes: list[str],
) -> Chain:
    """An ideal speed drive with the numbers of the model's velocity actuator, or with assumed ones.

    Args:
        model: as read.
        name: of the joint.
        drive: of the model that drives it.
        speeds: that it is told [rad/s].
        timestep: of the simulation [s].
        notes: where a phrase is added that says where the numbers come from.
    """
    joint = model.joints[name]
    forces = [item for item in (None if drive is None else drive.force, joint.force) if item is not None]
    limit = min(forces, default=None)
    if drive is not None and drive.damping > 0.0:
        damping, why = drive.damping, "its velocity actuator's"
    elif limit is not None:
        damping, why = limit / (FULL_FORCE * (speeds[1] - speeds[0])), "assumed, full torque at a quarter of its speed"
    else:
        carried = model.mass * model.wheels.get(name, 0.0) ** 2 / max(len(model.wheels), 1)
        inertia = joint.inertia + joint.armature + carried
        damping, why = 2.0 * math.pi * BANDWIDTH * inertia, f"assumed, {BANDWIDTH:g} Hz with what it moves"
    resolved = 2.0 * RESOLVED / (model.mobility[name, name] * timestep)
    if damping > resolved:
        damping, why = resolved, f"assumed, the most that a timestep of {1e3 * timestep:g} ms resolves"
    values = {"damping": _rounded(damping)}
    if limit is not None and limit < STRONGEST:
        values["torque_limit"] = _rounded(limit)
    notes.append(f"an ideal speed drive of {values['damping']:g} N.m.s/rad drives it ({why})")
    return dataclasses.replace(load_chain([{"ideal_velocity": values}]), label=f"ideal on {name}")


def motor_note(drive: ModelDrive, kind: str) -> str:
    """That actuators take no position, while a servo takes their place that does.

    Args:
        drive: of the model, without a stiffness.
        kind: of its joint, hinge or slide.
    """
    control = "torque" if kind == "hinge" else "force"
    if len(drive.actuators) > 1:
        what = f"are motors, whose controls are a {control}" if drive.motor else "are no position servos"
    else:
        what = f"is a motor, whose control is a {control}" if drive.motor else "is no position servo"
    return f"{_listed(drive.actuators)} {what}; here goals are positions, so a position servo takes its place"


def tied_note(drive: ModelDrive) -> str:
    """That actuators of joints which an equality ties became one servo.

    Args:
        drive: of the model, to which others were added.
    """
    return (
        f"{_listed(drive.actuators)} drive it together, since an equality of the model ties {' and '.join(drive.tied)} "
        "to it; their gains and forces are added"
    )


def reduction_note(model: ModelFile, name: str) -> str:
    """That a URDF states a mechanical reduction at a joint, and why it is not used.

    Args:
        model: as read.
        name: of a joint in :attr:`ModelFile.reductions`.
    """
    return (
        f"a mechanical reduction of {model.reductions[name]} stands in {model.path.name} and is not used: limits and "
        "goals count at the joint; the gear of a motor stands in its chain (gear: {ratio: ...})"
    )


def _stiffness(
    limit: float | None,
    inertia: float,
    apparent: float,
    dry: float,
    viscous: float,
    limits: tuple[float, float],
    timestep: float,
) -> tuple[float, float, str]:
    """Stiffness of a servo whose gain nobody stated, what its joint needs at least [N.m/rad or N/m], and why the first.

    Args:
        limit: its largest force [N.m or N]; None: any.
        inertia: that it moves while the other joints are held [kg.m2 or kg].
        apparent: the same while they give way, which is less: a damping acts on this one before the others resist.
        dry: friction of the joint in the file [N.m or N].
        viscous: damping of the joint in the file [N.m.s/rad or N.s/m].
        limits: of its goals [rad or m].
        timestep: of the simulation [s].
    """
    full = FULL_FORCE * (limits[1] - limits[0])
    slowest = 2.0 * math.pi * BANDWIDTH
    rate = RESOLVED * min(apparent / inertia, 1.0) / timestep
    fastest = max(inertia * rate**2, RESOLVED * viscous / timestep)
    needs = {
        f"assumed, {BANDWIDTH:g} Hz with the joint's inertia": inertia * slowest**2,
        f"assumed, {BANDWIDTH:g} Hz with the joint's damping": viscous * slowest,
        f"assumed, half of an error of 1/{1.0 / FULL_FORCE:g} of its range overcomes its dry friction": 2.0
        * dry
        / full,
    }
    why, needed = max(needs.items(), key=lambda item: item[1])
    inertial = next(iter(needs.values()))
    wanted = 0.0 if limit is None else limit / full
    if wanted > needed:
        why = f"assumed, full force at an error of 1/{1.0 / FULL_FORCE:g} of its range"
    stiffness = max(wanted, needed)
    if stiffness > max(fastest, inertial):
        stiffness = max(fastest, inertial)
        why = next(iter(needs))
        if fastest > inertial:
            hertz = math.sqrt(fastest / inertia) / (2.0 * math.pi)
            why = f"assumed, {hertz:.3g} Hz with the joint's inertia, the fastest that a timestep of "
            why += f"{1e3 * timestep:g} ms resolves"
    return stiffness, min(needed, stiffness), why


def _ends(ends: tuple[float, float], unit: str) -> str:
    return f"{ends[0]:.4g} to {ends[1]:.4g} {unit}"


def _and(terms: Sequence[tuple[str, float]]) -> str:
    return " and ".join(name for name, _ in terms)


def _listed(names: Sequence[str]) -> str:
    return ("actuators " if len(names) > 1 else "actuator ") + " and ".join(f"'{name}'" for name in names)


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")


# --- which joints of a model are driven where nobody says so, and which ones nothing drives --------------------------

FRICTION_BOUNDS = {field.name: field.metadata for field in dataclasses.fields(Friction)}
"""Of what a chain's friction takes."""


def chosen(model: ModelFile) -> tuple[list[str], list[str]]:
    """Coordinates that are driven: those of the actuators, else all joints; and those that cannot be, in words.

    A damping or a dry friction beyond what any drive has is a way to write that a joint stands still.
    """
    drives = {drive.name: drive for drive in model.drives}
    names = list(drives) or [name for name in model.joints if name not in model.followers]
    kept, held = [], []
    for name in names:
        reason = _held(model, name, drives.get(name))
        if reason:
            held.append(reason)
        else:
            kept.append(name)
    return kept, held


def _held(model: ModelFile, name: str, drive: ModelDrive | None) -> str:
    """Why a coordinate stands still; empty where it does not."""
    joint, ratio = (name, 1.0) if drive is None else drive.terms[-1]
    found = model.joints[joint]
    position, force = UNITS[found.kind]
    for key, value, bound, unit in (
        ("damping", found.damping / ratio**2, _most("viscous"), f"{force}.s/{position}"),
        ("frictionloss", found.frictionloss / abs(ratio), _most("coulomb"), force),
    ):
        if value > bound:
            return (
                f"joint '{joint}' has a {key} of {value:g} {unit} in {model.path.name}, which holds it in place; "
                f"correct it there if it should move: a drive has at most {bound:g}"
            )
    return ""


def _most(key: str) -> float:
    return float(FRICTION_BOUNDS[key]["high"])


def none_to_drive(model: ModelFile) -> str:
    """That a model has nothing that could be driven, and what to do, as a sentence."""
    _, held = chosen(model)
    if held:
        return f"no joint can be driven: {held[0]}."
    if model.unnamed:
        return (
            f"no joint can be driven, since there are only {', '.join(model.unnamed[:3])}; give hinges and slides a "
            'name: <joint name="elbow" .../>.'
        )
    return "there is no hinge and no slide that could be driven; give a robot with joints."


def passive(model: ModelFile, driven: Sequence[str]) -> list[str]:
    """Joints of a model that nothing drives and nothing leads, in words.

    Args:
        model: as read.
        driven: names of joints of the model.
    """
    named = [name for name in model.joints if name not in driven and name not in model.followers]
    return [*(f"the {model.joints[name].kind} {name}" for name in named), *model.unnamed]


def passive_sentence(model: ModelFile, driven: Sequence[str]) -> list[str]:
    """That joints are passive, where there are any."""
    if not (found := passive(model, driven)):
        return []
    return [
        f"{model.path.name}: nothing drives {', '.join(found)}; such joints move freely, with the springs, damping and "
        "friction of the file."
    ]
