"""What a diagnosis found at the joints of a robot, as numbers of the robot itself: bodies, stops, and its own frame.

A joint of a tree is judged with its angle as the log has it and with what hangs behind it as one load. The robot's
model has bodies and an angle of its own, so both are turned into those here.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence

import mujoco
import numpy as np
from scipy.optimize import lsq_linear

from ...envs.described.robot_numbers import inertia_about
from ...envs.extended import Change
from ..causes.contact import STOPS
from ..load.robot import Frame, LoggedRobot
from ..load.tree import NO_LEVER, arm_of, carries, tip_behind
from ..measure.case import ROBOT
from ..robot.directions import every
from ..verdict.verdict import JointDiagnosis

BELIEF_WEIGHT = 0.03  # of bodies to weigh as believed, beside what the joints say of those behind them
RANGE_MARGIN = 0.02  # of a joint's motion by which a range must be wider than what the log shows
CARRIED = ("load.mass_factor", "load.payload", "load.centre_shift")
"""Numbers of a joint that say what its bodies weigh."""
MAX_DILUTION = 2.0
"""By how much more than any joint says of all behind it a single body may be off, which is a part of that."""


def of_robot(robot: LoggedRobot, changes: Sequence[Change]) -> list[Change]:
    """Changes of a robot, those of loads by body and in the frame of its model.

    Where what joints carry is named, factors on it that others only tuned are no evidence against it.
    """
    named = {_body(robot, one) for one in changes if one.owner == "robot" and one.cause} - {0}
    kept: list[Change] = []
    weights: dict[str, Change] = {}
    inertias: dict[str, Change] = {}
    payloads: dict[str, list[Change]] = {}
    for change in changes:
        name = change.joint
        if change.owner != "robot" or robot.number(name) < 0:
            kept.append(change)
        elif change.path in STOPS:
            kept.append(_stop(robot.frame(name), change))
        elif change.path == "load.mass_factor":
            if change.cause or change.refitted or not _related(robot.model, robot.number(name), named):
                weights[name] = change
        elif change.path == "load.extra_inertia" and not robot.slides(name):
            inertias[name] = change
        elif change.path == "load.payload":
            tip = tip_behind(robot.model, robot.number(name))
            payloads.setdefault(robot.model.body(tip.body).name, []).append(change)
        elif change.path == "load.centre_shift":
            kept += _shift(robot, change)
        else:
            kept.append(change)
    kept += [_payload(body, found) for body, found in payloads.items()]
    return [*kept, *_inertias(robot, inertias), *_masses(robot, weights)]


def _body(robot: LoggedRobot, change: Change) -> int:
    """The body whose weight a change is about, or that of the joint that carries it; 0 for none."""
    if change.path in CARRIED and robot.number(change.joint) >= 0:
        return int(robot.model.jnt_bodyid[robot.number(change.joint)])
    return robot.model.body(change.joint).id if change.path.startswith("body.") else 0


def _related(model: mujoco.MjModel, number: int, bodies: Collection[int]) -> bool:
    """Whether a joint carries one of some bodies, or is carried by one."""
    own = int(model.jnt_bodyid[number])
    above = [int(model.body_jntadr[body]) for body in bodies if model.body_jntnum[body]]
    return any(carries(model, number, body) for body in bodies) or any(carries(model, joint, own) for joint in above)


def _payload(body: str, found: Sequence[Change]) -> Change:
    """One payload of a body, whichever joints found it: what is named counts, and what was tuned beside only alone."""
    said = [change for change in found if change.cause] or list(found)
    return Change(body, "body.payload", 0.0, float(np.mean([c.after for c in said])), said[0].cause, "robot")


def _inertias(robot: LoggedRobot, found: Mapping[str, Change]) -> list[Change]:
    """Inertias of links, each counted once: joints above feel it too, and may have found it as their own."""
    model, left = robot.model, dict(found)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for name in sorted(found, key=robot.number, reverse=True):  # from the end of the robot
        number, own = robot.number(name), found[name].after
        felt = 0.0
        for other, change in left.items():
            if (below := robot.number(other)) != number and carries(model, number, int(model.jnt_bodyid[below])):
                felt += inertia_about(change.after, data.xaxis[below], data.xaxis[number])
        rest = max(own - felt, 0.0) if own > 0.0 else min(own - felt, 0.0)
        left[name] = dataclasses.replace(found[name], after=rest if felt * own > 0.0 else own)
    return [change for change in left.values() if change.after]


def widened_range(robot: LoggedRobot, diagnosis: JointDiagnosis, found: Sequence[Change]) -> list[Change]:
    """Ends of a joint's range that its log goes beyond, which stop nothing then: as far out as the log went at least.

    Args:
        robot: that was logged.
        diagnosis: of the joint.
        found: changes of the robot, of whose stops one may lie on that side.
    """
    joint = None if diagnosis.problem is None else diagnosis.problem.joint
    ends = robot.ends(diagnosis.joint)
    if joint is None or joint.terms is None or ends is None:
        return []
    axis, told = joint.models[0].axis, {c.path for c in found if c.joint == diagnosis.joint}
    rows = []
    for path, side, end, reached in zip(("load.lower_stop", "load.stop_angle"), (-1, 1), ends, (axis.low, axis.high),
                                        strict=True):  # fmt: skip
        if path not in told and np.isinf(joint.models[0].value(path)) and side * (reached - end) > 0.0:
            rows.append(
                Change(diagnosis.joint, path, end, reached + side * RANGE_MARGIN * (axis.high - axis.low), "", "robot")
            )
    return rows


def shared_changes(robot: LoggedRobot, found: JointDiagnosis) -> list[Change]:
    """Changes of what all joints share."""
    if found.joint != ROBOT:
        return []
    owner = {number: cause.name for cause in found.causes for number in cause.parameters}
    known = every(robot)
    return [
        Change(part, known[number].effect, known[number].neutral, value, owner.get(number, ""), "robot")
        for number, value in found.values.items()
        if number in known
        for part in known[number].parts
    ]


def _stop(frame: Frame, change: Change) -> Change:
    """A stop in the frame of the model, where a lower one may be an upper one."""
    before, after = (frame.sign * (value - frame.zero) for value in (change.before, change.after))
    path = change.path
    if frame.sign < 0.0:
        path = next(other for other in STOPS if other != path)
    return dataclasses.replace(change, path=path, before=before, after=after)


def _shift(robot: LoggedRobot, change: Change) -> list[Change]:
    """The centre of mass of a joint's own body, further from the joint."""
    model, number = robot.model, robot.number(change.joint)
    body = int(model.jnt_bodyid[number])
    arm = arm_of(model, number)
    size = float(np.linalg.norm(arm))
    if size <= NO_LEVER:
        return [change]  # which is refused where it is applied
    name = model.body(body).name
    return [
        Change(name, f"body.centre_{letter}", 0.0, change.after * float(part), change.cause, "robot")
        for letter, part in zip("xyz", arm / size, strict=True)
        if abs(part) > 1e-9
    ]


def _masses(robot: LoggedRobot, found: Mapping[str, Change]) -> list[Change]:
    """Factors on the masses of bodies that agree best with what the joints found of all that hangs behind them."""
    if not found:
        return []
    model = robot.model
    owner = _owners(robot, [robot.number(name) for name in found])
    names = {robot.number(name): name for name in found}
    groups = sorted(set(owner.values()))
    rows, wanted = [], []
    for number, name in names.items():
        share = np.array([_weight(model, number, [b for b, o in owner.items() if o == group]) for group in groups])
        if (whole := share.sum()) > 0.0:
            rows.append(share / whole)
            wanted.append(found[name].after - 1.0)
    table = np.concatenate([np.array(rows).reshape(-1, len(groups)), BELIEF_WEIGHT * np.eye(len(groups))])
    # joints that contradict each other by a little would otherwise take nearly all of a light body's mass away
    most = MAX_DILUTION * max(max(map(abs, wanted), default=0.0), 1e-9)
    change = lsq_linear(table, np.array([*wanted, *np.zeros(len(groups))]), bounds=(-most, most)).x
    changes = []
    for group, more in zip(groups, change, strict=True):
        of = found[names[group]]
        changes += [
            dataclasses.replace(
                of, joint=model.body(b).name, path="body.mass_factor", before=1.0, after=max(1.0 + float(more), 0.05)
            )
            for b, o in owner.items()
            if o == group and model.body_mass[b] > 0.0 and model.body(b).name
        ]
    return changes


def _owners(robot: LoggedRobot, numbers: Sequence[int]) -> dict[int, int]:
    """For each body behind any of these joints, the nearest of them above it."""
    model = robot.model
    at = {int(model.jnt_bodyid[number]): number for number in numbers}
    owner: dict[int, int] = {}
    for body in range(1, model.nbody):
        number = at.get(body, owner.get(int(model.body_parentid[body])))
        if number is not None:
            owner[body] = number
    return owner


def _weight(model: mujoco.MjModel, joint: int, bodies: Sequence[int]) -> float:
    """How much bodies weigh in what a joint feels: inertia at the file's pose [kg.m2], or mass of a slide [kg]."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    above = int(model.jnt_bodyid[joint])
    total = 0.0
    for body in bodies:
        carrier = body
        while carrier > 0 and carrier != above:
            carrier = int(model.body_parentid[carrier])
        if carrier != above:
            continue
        if int(model.jnt_type[joint]) != int(mujoco.mjtJoint.mjJNT_HINGE):
            total += float(model.body_mass[body])
            continue
        axis, away = data.xaxis[joint], data.xipos[body] - data.xanchor[joint]
        turn = data.ximat[body].reshape(3, 3).T @ axis
        own = float(turn @ (model.body_inertia[body] * turn))
        total += own + float(model.body_mass[body]) * float(away @ away - (away @ axis) ** 2)
    return total
