"""What actuators of a model file drive, with the numbers that the engine uses once it has compiled them."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

SAME = 1e-6  # of a force: ends that differ by less are as far from 0
OVER_JOINTS = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)


@dataclass(frozen=True)
class ModelDrive:
    """What actuators of the file make of a joint or of a tendon over two joints.

    Attributes:
        name: of the joint, or of the tendon.
        terms: joints and coefficients whose sum is driven.
        stiffness, damping: of a position servo, at the driven coordinate; 0 where the file has none.
        force: its largest force [N.m or N]; None: any.
        actuators: names of the file's actuators that it stands for.
        goals: lowest and highest goal that its controls can give [rad or m]; None: any.
        dampratio: that the file gives in place of a damping; 0 where it gives none.
        motor: whether its control is a force: no actuator of it follows a position or a speed.
        lost: what its actuators have that no ideal servo has, such as ``a delay of 0.03 s``.
        tied: joints with actuators of their own that an equality ties to it, whose drives were added to it.
        simplified: what the file says of its force that is read more simply here, a phrase each.
        speeds: lowest and highest speed that its controls ask for [rad/s or m/s]; None: any, or its controls are none.
    """

    name: str
    terms: tuple[tuple[str, float], ...]
    stiffness: float = 0.0
    damping: float = 0.0
    force: float | None = None
    actuators: tuple[str, ...] = ()
    goals: tuple[float, float] | None = None
    dampratio: float = 0.0
    motor: bool = False
    tied: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()
    simplified: tuple[str, ...] = ()
    speeds: tuple[float, float] | None = None


def read_drives(full: mujoco.MjSpec, joints: Collection[str]) -> tuple[tuple[ModelDrive, ...], tuple[str, ...]]:
    """What the actuators of a file drive, those of one joint together; and those that no chain can stand for.

    Args:
        full: specification with actuators; it is left as it is.
        joints: names of the hinges and slides.

    Raises:
        ValueError: it does not compile.
    """
    spec = full.copy()
    for key in list(spec.keys):  # of another size than the model, they would stop the compiler
        spec.delete(key)
    model = spec.compile()
    written = [float(actuator.biasprm[2]) for actuator in full.actuators]  # compiling resolves a dampratio
    together: dict[str, list[int]] = {}
    terms_of: dict[str, tuple[tuple[str, float], ...]] = {}
    names: list[str] = []
    refused: list[str] = []
    for number, actuator in enumerate(spec.actuators):
        names.append(actuator.name or actuator.target)
        if actuator.trntype in OVER_JOINTS:
            terms = ((actuator.target, 1.0),)
        elif actuator.trntype == mujoco.mjtTrn.mjTRN_TENDON:
            terms = _belt(spec, actuator.target)
        else:
            terms = ()
        if not 1 <= len(terms) <= 2 or any(joint not in joints for joint, _ in terms):
            refused.append(
                f"actuator '{names[-1]}' acts on '{actuator.target}', which is neither a hinge, a slide nor a fixed "
                "tendon over at most two of them"
            )
            continue
        together.setdefault(actuator.target, []).append(number)
        terms_of[actuator.target] = terms
    found = [
        dataclasses.replace(
            _drive(model, target, terms_of[target], numbers, [written[number] for number in numbers]),
            actuators=tuple(names[number] for number in numbers),
        )
        for target, numbers in together.items()
    ]
    return tuple(found), tuple(refused)


def _drive(
    model: mujoco.MjModel,
    name: str,
    terms: tuple[tuple[str, float], ...],
    numbers: Sequence[int],
    written: Sequence[float],
) -> ModelDrive:
    """Actuators of one target; ``written`` is ``biasprm[2]`` as the file has it, where above 0 a dampratio."""
    stiffness = damping = dampratio = 0.0
    forces = [_force(model, number) for number in numbers]
    pulls: list[tuple[float, float] | None] = []
    for number, before in zip(numbers, written, strict=True):
        if int(model.actuator_biastype[number]) != int(mujoco.mjtBias.mjBIAS_AFFINE):
            continue
        square = _gear(model, number) ** 2
        stiffness -= square * float(model.actuator_biasprm[number, 1])
        damping -= square * float(model.actuator_biasprm[number, 2])
        if model.actuator_biasprm[number, 1] < 0.0:
            pulls.append(_pull(model, number))
        if before > 0.0 > model.actuator_biasprm[number, 2]:
            dampratio = before
    known = [pull for pull in pulls if pull is not None]
    goals = None
    if stiffness > 0.0 and len(known) == len(pulls):
        low, high = (sum(pull[end] for pull in known) / stiffness for end in (0, 1))
        goals = (low, high)
    speeds = None
    if stiffness == 0.0 < damping and len(numbers) == 1 and (pull := _pull(model, numbers[0])) is not None:
        speeds = pull[0] / damping, pull[1] / damping
    plain = (mujoco.mjtBias.mjBIAS_NONE, mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtDyn.mjDYN_NONE)
    kinds = (model.actuator_biastype, model.actuator_gaintype, model.actuator_dyntype)
    motor = all(int(kind[number]) == int(want) for number in numbers for kind, want in zip(kinds, plain, strict=True))
    lost = dict.fromkeys(phrase for number in numbers for phrase in _lost(model, number))
    limits = [ends for ends in forces if ends is not None]
    force, said = None, ()
    if len(limits) == len(forces):
        slides = int(model.jnt_type[model.joint(terms[0][0]).id]) == int(mujoco.mjtJoint.mjJNT_SLIDE)
        ends = sum(low for low, _ in limits), sum(high for _, high in limits)
        label = "the force of its actuators," if len(numbers) > 1 else "the force of its actuator,"
        force, said = both_ways(ends, label, "N" if slides else "N.m")
    return ModelDrive(
        name,
        terms,
        stiffness,
        damping,
        force,
        goals=goals,
        dampratio=dampratio,
        motor=motor,
        lost=tuple(lost),
        simplified=said,
        speeds=speeds,
    )


def both_ways(ends: tuple[float, float], label: str, unit: str) -> tuple[float, tuple[str, ...]]:
    """A range of forces as a largest force either way, and in words how one that is not so was read.

    Args:
        ends: lowest and highest force [N.m or N].
        label: what the range is, for the words.
        unit: of the force.
    """
    low, high = ends
    both = low < 0.0 < high  # else the larger end counts: with the other one, 0 or less, it would never move
    force = (min if both else max)(abs(low), abs(high))
    if abs(low + high) <= SAME * force:
        return force, ()
    why = "the smaller end counts both ways" if both else "a drive that acts one way only is not known here"
    return force, (f"{label} {low:g} to {high:g} {unit}, is read as {-force:g} to {force:g}: {why}",)


def _lost(model: mujoco.MjModel, number: int) -> list[str]:
    """What an actuator has that no ideal servo has."""
    kinds = mujoco.mjtDyn
    kind, constant = int(model.actuator_dyntype[number]), float(model.actuator_dynprm[number, 0])
    found = []
    if kind in (int(kinds.mjDYN_FILTER), int(kinds.mjDYN_FILTEREXACT)):
        found.append(f"a lag of {constant:g} s (timeconst)")
    elif kind not in (int(kinds.mjDYN_NONE), int(kinds.mjDYN_INTEGRATOR)):
        found.append("an activation of its own (dyntype)")
    for name, values, unit in (
        ("delay", model.actuator_delay, " s"),
        ("armature", model.actuator_armature, " kg.m2 or kg"),
        ("damping", model.actuator_damping, " N.m.s/rad or N.s/m"),
    ):
        if (value := float(np.ravel(values[number])[0])) > 0.0:
            found.append(f"{'an' if name == 'armature' else 'a'} {name} of {value:g}{unit}")
    return found


def _pull(model: mujoco.MjModel, number: int) -> tuple[float, float] | None:
    """Force of a position servo on what it drives, at 0, for its lowest and highest control; None: any."""
    if int(model.actuator_gaintype[number]) != int(mujoco.mjtGain.mjGAIN_FIXED):
        return None
    if int(model.actuator_dyntype[number]) == int(mujoco.mjtDyn.mjDYN_INTEGRATOR):  # its control is a speed
        limited, ends = model.actuator_actlimited[number], model.actuator_actrange[number]
    else:
        limited, ends = _control(model, number)
    if not limited:
        return None
    gain = float(model.actuator_gainprm[number, 0])
    plain = int(model.actuator_biastype[number]) == int(mujoco.mjtBias.mjBIAS_NONE)
    offset = 0.0 if plain else float(model.actuator_biasprm[number, 0])
    low, high = sorted(_gear(model, number) * (gain * float(end) + offset) for end in ends)
    return low, high


def _force(model: mujoco.MjModel, number: int) -> tuple[float, float] | None:
    """Lowest and highest force of an actuator on what it drives; None: any.

    A motor is held by its controls and by its range of forces: the narrower counts at each end.
    """
    found: list[tuple[float, float]] = []
    if model.actuator_forcelimited[number]:
        low, high = sorted(_gear(model, number) * float(end) for end in model.actuator_forcerange[number])
        found.append((low, high))
    if int(model.actuator_biastype[number]) == int(mujoco.mjtBias.mjBIAS_NONE):  # a motor
        pull = _pull(model, number)
        if pull is not None:
            found.append(pull)
    if not found:
        return None
    low, high = max(low for low, _ in found), min(high for _, high in found)
    return (low, high) if low <= high else found[0]


def _control(model: mujoco.MjModel, number: int) -> tuple[bool, np.ndarray]:
    """Whether the first control of an actuator is limited, and its range."""
    first = int(model.actuator_ctrladr[number])
    return bool(model.actuator_ctrllimited[first]), np.asarray(model.actuator_ctrlrange[first])


def _gear(model: mujoco.MjModel, number: int) -> float:
    return float(model.actuator_gear[int(model.actuator_outadr[number]), 0])


def _belt(spec: mujoco.MjSpec, name: str) -> tuple[tuple[str, float], ...]:
    """Joints and coefficients of a fixed tendon, those of 0 left out; none of a spatial one."""
    path = spec.tendon(name).path
    if any(item.type != mujoco.mjtWrap.mjWRAP_JOINT for item in path):
        return ()
    return tuple((item.target.name, float(item.coef)) for item in path if item.coef)


# --- which joints of a model are wheels: they turn without end, and are told a speed ---------------------------------

WHEEL = re.compile(r"wheel|tire|tyre|track|sprocket|roller|propeller|rotor|spinner", re.IGNORECASE)
"""What names of such joints and of their bodies have in them."""
ROUND = (int(mujoco.mjtGeom.mjGEOM_CYLINDER), int(mujoco.mjtGeom.mjGEOM_SPHERE), int(mujoco.mjtGeom.mjGEOM_ELLIPSOID))
ASIDE = 0.05  # of its radius, or of 1 rad: by which a round shape may be off the joint's axis; assumed


def wheels_of(model: mujoco.MjModel, drives: tuple[ModelDrive, ...]) -> dict[str, float]:
    """Hinges without a range that are wheels, and the radius of their shape [m]; 0 where it has none that is round.

    They are what an actuator of the file drives by a speed, what is called a wheel, and the last joint of a limb whose
    shape that touches is round about its axis. Other hinges without a range, such as the wrist of an arm, follow
    positions.
    """
    by_speed = {drive.name for drive in drives if drive.stiffness == 0.0 < drive.damping}
    by_position = {drive.name for drive in drives if drive.stiffness > 0.0}
    found = {}
    for number in range(model.njnt):
        name, body = model.joint(number).name, int(model.jnt_bodyid[number])
        hinge = int(model.jnt_type[number]) == int(mujoco.mjtJoint.mjJNT_HINGE)
        if not hinge or not name or model.jnt_limited[number] or name in by_position:
            continue
        radius = _radius(model, number, body)
        called = WHEEL.search(f"{name} {model.body(body).name}") is not None
        if name in by_speed or called or (radius > 0.0 and not _carries(model, body)):
            found[name] = radius
    return found


def _carries(model: mujoco.MjModel, body: int) -> bool:
    """Whether further joints hang on a body."""
    for other in range(body + 1, model.nbody):
        if model.body_jntnum[other]:
            parent = other
            while parent > body:
                parent = int(model.body_parentid[parent])
            if parent == body:
                return True
    return False


def _radius(model: mujoco.MjModel, joint: int, body: int) -> float:
    """Largest radius of the shapes round about a joint's axis that touch, on what moves as one with its body [m]."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    axis, anchor = data.xaxis[joint], data.xanchor[joint]
    radius = 0.0
    for geom in np.flatnonzero(model.body_weldid[model.geom_bodyid] == model.body_weldid[body]):
        kind, touches = int(model.geom_type[geom]), model.geom_contype[geom] or model.geom_conaffinity[geom]
        if kind not in ROUND or not touches:
            continue
        size, away = model.geom_size[geom], data.geom_xpos[geom] - anchor
        own = float(size[0])
        along = data.geom_xmat[geom].reshape(3, 3)[:, 2]
        level = kind == ROUND[1] or np.linalg.norm(np.cross(along, axis)) < ASIDE
        if level and np.linalg.norm(away - (away @ axis) * axis) < ASIDE * own:
            radius = max(radius, own)
    return radius
