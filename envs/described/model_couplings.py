"""What hangs together in a model: joints that follow others, joints in closed loops, joints that nothing drives."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import mujoco
import numpy as np

from .model_drives import ModelDrive

EXACT = 1e-9  # of a position: a follower further from its leader's zero than that has one of its own


def couplings(model: mujoco.MjModel) -> tuple[dict[str, str], dict[str, str]]:
    """Joints that follow others, and joints whose load is more than a tree says with the reason."""
    followers: dict[str, str] = {}
    coupled: dict[str, str] = {}
    for k in _active(model):
        kind, one, two = int(model.eq_type[k]), int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
        name = model.equality(k).name or f"constraint {k}"
        if kind == mujoco.mjtEq.mjEQ_JOINT:
            follower, leader = model.joint(one).name, model.joint(two).name if two >= 0 else ""
            followers[follower] = leader
            tied = f"the equality '{name}' ties '{follower}' to " + (f"'{leader}'" if leader else "a place")
            coupled[follower] = tied
            if leader and np.any(model.eq_data[k, 2:5]):  # else the two are one joint with the mass of both
                coupled[leader] = f"{tied} otherwise than in proportion"
            elif leader and model.dof_frictionloss[model.jnt_dofadr[one]] > 0.0:
                coupled[leader] = f"{tied}, which has dry friction of its own in the file (frictionloss)"
        elif kind in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
            if int(model.eq_objtype[k]) == mujoco.mjtObj.mjOBJ_SITE:
                one, two = (int(model.site_bodyid[site]) for site in (one, two))
            for joint in set(above(model, one)) ^ set(above(model, max(two, 0))):
                coupled[model.joint(joint).name] = f"the equality '{name}' closes a loop over it"
        elif kind == mujoco.mjtEq.mjEQ_TENDON:
            for tendon in (one, two):
                for joint in wrapped(model, tendon) if tendon >= 0 else ():
                    coupled[model.joint(joint).name] = f"the equality '{name}' holds a tendon over it"
    for tendon in range(model.ntendon):
        acts = (  # one that has only ends pulls nowhere but there, which is looked for along a log
            np.any(model.tendon_stiffness[tendon])
            or np.any(model.tendon_damping[tendon])
            or model.tendon_frictionloss[tendon]
            or model.tendon_armature[tendon]
        )
        for joint in wrapped(model, tendon) if acts else ():
            coupled[model.joint(joint).name] = f"the tendon '{model.tendon(tendon).name}' pulls on it"
    return followers, coupled


def _active(model: mujoco.MjModel) -> list[int]:
    """Equality constraints that act; a file can hold others, for programs that switch them on."""
    return [k for k in range(model.neq) if model.eq_active0[k]]


def above(model: mujoco.MjModel, body: int) -> list[int]:
    """Joints between a body and the world."""
    found = []
    while body:
        found += range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])
        body = int(model.body_parentid[body])
    return found


def wrapped(model: mujoco.MjModel, tendon: int) -> list[int]:
    """Numbers of the joints that a tendon acts on."""
    first, count = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
    found: set[int] = set()
    for k in range(first, first + count):
        if model.wrap_type[k] == mujoco.mjtWrap.mjWRAP_JOINT and model.wrap_prm[k]:
            found.add(int(model.wrap_objid[k]))
        elif model.wrap_type[k] == mujoco.mjtWrap.mjWRAP_SITE:
            found.update(above(model, int(model.site_bodyid[model.wrap_objid[k]])))
    return sorted(found)


def led(model: mujoco.MjModel, drives: Sequence[ModelDrive]) -> tuple[tuple[ModelDrive, ...], tuple[str, ...]]:
    """Drives of joints that follow others as drives of their leaders; those that cannot be, in words.

    A fixed tendon over the two fingers of a gripper, of which one follows the other, drives the leading one.
    """
    kept: dict[tuple[str, ...], ModelDrive] = {}
    origins: dict[tuple[str, ...], str] = {}
    left: list[str] = []
    ways = _linear(model)
    for drive in drives:
        terms: dict[str, float] = {}
        for name, coefficient in drive.terms:
            leader, ratio = ways.get(name, (name, 1.0))
            if leader:
                terms[leader] = terms.get(leader, 0.0) + coefficient * ratio
        names = tuple(sorted(name for name, coefficient in terms.items() if abs(coefficient) > EXACT))
        label = f"actuator '{', '.join(drive.actuators)}' of '{drive.name}'"
        if not names or any(name in ways for name in names):
            left.append(
                f"{label} drives a joint that an equality of the model ties to a place, or otherwise than by a plain "
                "ratio to another joint, so no servo can stand for it"
            )
        elif len(names) == 1 and names in kept:
            first = kept[names]
            if drive.terms == ((drive.name, 1.0),) and drive.name == names[0]:  # the leader's own coordinate counts
                kept[names] = _together(drive, first, first.terms[0][1], origins[names])
            else:
                kept[names] = _together(first, drive, terms[names[0]], drive.name)
        elif terms == dict(drive.terms):
            kept[names], origins[names] = drive, drive.name
        else:
            own = names == (drive.name,) and terms[drive.name] == 1.0
            name = drive.name if own or drive.name not in ways else names[0]
            origins[names] = drive.name
            kept[names] = dataclasses.replace(drive, name=name, terms=tuple((n, terms[n]) for n in names))
    return tuple(kept.values()), tuple(left)


def _together(one: ModelDrive, other: ModelDrive, coefficient: float, origin: str) -> ModelDrive:
    """Two drives of a joint as one, at the coordinate of the first.

    Args:
        one: drive of a joint, on its own coordinate.
        other: drive of the same joint, or of one that follows it.
        coefficient: of the joint in the coordinate of ``other``.
        origin: joint or tendon that ``other`` stands for in the file.
    """
    ratio = coefficient / one.terms[0][1]  # of the other coordinate by this one
    stiffness = one.stiffness + ratio**2 * other.stiffness
    pulls = [
        None if drive.goals is None else np.sort(factor * drive.stiffness * np.array(drive.goals))
        for drive, factor in ((one, 1.0), (other, ratio))
        if drive.stiffness > 0.0
    ]
    known = [pull for pull in pulls if pull is not None]
    goals = None
    if known and len(known) == len(pulls):
        low, high = (float(sum(pull[end] for pull in known)) / stiffness for end in (0, 1))
        goals = (low, high)
    return dataclasses.replace(
        one,
        stiffness=stiffness,
        damping=one.damping + ratio**2 * other.damping,
        force=None if one.force is None or other.force is None else one.force + abs(ratio) * other.force,
        actuators=(*one.actuators, *other.actuators),
        goals=goals,
        dampratio=one.dampratio if one.dampratio == other.dampratio else 0.0,
        motor=one.motor and other.motor,
        simplified=(*one.simplified, *other.simplified),
        tied=(*one.tied, origin),
    )


def _linear(model: mujoco.MjModel) -> dict[str, tuple[str, float]]:
    """Leader and ratio of the joints that follow in proportion; an empty leader where they follow otherwise."""
    found = {}
    for k in _active(model):
        if int(model.eq_type[k]) != int(mujoco.mjtEq.mjEQ_JOINT):
            continue
        one, two = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
        if two < 0:
            found[model.joint(one).name] = ("", 0.0)
            continue
        offset, ratio, *bent = map(float, model.eq_data[k, :5])
        here, there = (float(model.qpos0[model.jnt_qposadr[joint]]) for joint in (one, two))
        plain = not any(bent) and abs(here + offset - ratio * there) < EXACT
        found[model.joint(one).name] = (model.joint(two).name, ratio) if plain else ("", 0.0)
    return found


def unnamed(model: mujoco.MjModel) -> tuple[str, ...]:
    """Joints that no YAML can name as driven: balls, and hinges and slides without a name; in words."""
    kinds = {
        int(mujoco.mjtJoint.mjJNT_HINGE): "hinge",
        int(mujoco.mjtJoint.mjJNT_SLIDE): "slide",
        int(mujoco.mjtJoint.mjJNT_BALL): "ball joint",
    }
    found = []
    for k in range(model.njnt):
        kind, name = kinds.get(int(model.jnt_type[k])), model.joint(k).name
        body = model.body(int(model.jnt_bodyid[k])).name or "a body without a name"
        if kind is not None and not name:
            found.append(f"the {kind} without a name on {body}")
        elif kind == "ball joint":
            found.append(f"the ball joint {name}")
    return tuple(found)
