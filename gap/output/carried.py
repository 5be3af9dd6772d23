"""What bodies of a robot weigh, from what each joint found of all that hangs behind it.

A body is felt at every joint that carries it, and each joint names what stands for it there: a payload at one, a
heavier link at another. Both handed over is the same mass twice. So all findings are one least-squares problem of the
bodies, and the fewest changes are taken that say what each joint found, within its interval.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from scipy.optimize import lsq_linear

from ...envs.extended import Change
from ..checks.signal import Z95
from ..load.robot import LoggedRobot
from ..load.tree import tip_behind
from ..measure.named import NamedCause

FACTOR, PAYLOAD = "load.mass_factor", "load.payload"
BELIEF_WEIGHT = 0.03  # of bodies to weigh as believed, beside what the joints say of those behind them
CLOSEST = 0.02  # standard error of what a joint carries, as a share of it: none is known better, as poses are not
MAX_DILUTION = 2.0
"""By how much more than any joint says of all behind it a single body may be off, which is a part of that."""
LIGHTEST = 0.05  # factor on the mass of a body
Told = Mapping[tuple[str, str], NamedCause]
"""Causes that are named, by joint and path of what they change."""


def bodies_carried(robot: LoggedRobot, found: Sequence[Change], told: Told) -> list[Change]:
    """Factors on the masses of bodies, and payloads at their ends, that agree best with what joints found.

    Args:
        robot: that was logged.
        found: what joints carry: :data:`FACTOR` on all that hangs behind one, or :data:`PAYLOAD` at its end.
        told: where a cause is named. Only such a change may be left out, the most doubtful first, and what is told
            decides that, also where ``found`` are numbers that were drawn about it.
    """
    if not found:
        return []
    bodies, kept = Bodies(robot, tuple(found), told), list(found)
    named = [one for one in found if (one.joint, one.path) in told]
    for doubtful in sorted(named, key=lambda one: told[one.joint, one.path].confidence):
        fewer = [one for one in kept if one is not doubtful]
        if fewer and bodies.misfit(fewer) <= 1.0:
            kept = fewer
    return bodies.changes(kept)


@dataclass(frozen=True, eq=False)
class Bodies:
    """What joints found of the bodies that they carry.

    Attributes:
        robot: that was logged.
        found: by the joints.
        told: where a cause is named.
    """

    robot: LoggedRobot
    found: tuple[Change, ...]
    told: Told

    @cached_property
    def joints(self) -> list[int]:
        """Numbers of the joints that found something."""
        return sorted({self.robot.number(one.joint) for one in self.found})

    @cached_property
    def felt(self) -> dict[int, np.ndarray]:
        """What each joint feels of each body (bodies,), as a share of all that it carries."""
        weights = {joint: weight_felt(self.robot.model, joint) for joint in self.joints}
        return {joint: row / row.sum() for joint, row in weights.items() if row.sum() > 0.0}

    def per_payload(self, joint: int, body: int) -> float:
        """What a joint feels of 1 kg at the end of a body, as a share of all that it carries."""
        model = self.robot.model
        tip = next(tip for one in self.joints if (tip := tip_behind(model, one)).body == body)
        whole = weight_felt(model, joint).sum()
        return point_felt(model, joint, body, tip.point) / whole if whole > 0.0 else 0.0

    def end(self, change: Change) -> int:
        """The body at whose end the payload of a joint is."""
        return tip_behind(self.robot.model, self.robot.number(change.joint)).body

    def share(self, change: Change, value: float) -> float:
        """What a joint found, as a share of all that it carries."""
        if change.path == FACTOR:
            return value - 1.0
        return value * self.per_payload(self.robot.number(change.joint), self.end(change))

    def half(self, change: Change) -> float:
        """Half of the 95 % interval of that share."""
        cause, width = self.told.get((change.joint, change.path)), 0.0
        if cause is not None:
            value = cause.parameters[change.path]
            width = abs(self.share(change, value.high) - self.share(change, value.low))
        return max(0.5 * width, Z95 * CLOSEST)

    def misfit(self, kept: Sequence[Change]) -> float:
        """How far some changes alone, as told, are from what joints were told to have, in halves of the intervals."""
        said = [
            dataclasses.replace(one, after=self.told[one.joint, one.path].parameters[one.path].value)
            for one in self.found
            if (one.joint, one.path) in self.told
        ]
        *_, errors = self.solved(kept, said)
        return float(np.abs(errors).max(initial=0.0))

    def solved(
        self, kept: Sequence[Change], said: Sequence[Change]
    ) -> tuple[dict[int, int], list[int], np.ndarray, np.ndarray]:
        """The least-squares solution for what joints said.

        Args:
            kept: changes that are made.
            said: by the joints, of which these are some.

        Returns:
            By body the joint whose factor it takes, the bodies with a payload, the solution (one for each such joint,
            then for each payload), and the errors of what was said in halves of the intervals.
        """
        owner = _owners(self.robot, [self.robot.number(one.joint) for one in kept if one.path == FACTOR])
        groups, ends = sorted(set(owner.values())), sorted({self.end(one) for one in kept if one.path == PAYLOAD})
        rows, wanted, halves = [], [], []
        for joint, felt in self.felt.items():
            mine = [one for one in said if self.robot.number(one.joint) == joint]
            if mine:
                rows.append(
                    [sum(felt[body] for body, of in owner.items() if of == group) for group in groups]
                    + [self.per_payload(joint, body) for body in ends]
                )
                wanted.append(sum(self.share(one, one.after) for one in mine))
                halves.append(max(self.half(one) for one in mine))
        table, goal, half = np.array(rows).reshape(len(rows), -1), np.array(wanted), np.array(halves)
        weight = half.min(initial=np.inf) / half
        belief = BELIEF_WEIGHT * np.eye(table.shape[1])[: len(groups)]
        # joints that contradict each other by a little would otherwise take nearly all of a light body's mass away
        most = [MAX_DILUTION * max(np.abs(goal).max(initial=0.0), 1e-9)] * len(groups) + [np.inf] * len(ends)
        if not table.size:
            return owner, ends, np.zeros(table.shape[1]), goal / half
        x = lsq_linear(
            np.concatenate([weight[:, None] * table, belief]),
            np.concatenate([weight * goal, np.zeros(len(groups))]),
            bounds=(-np.array(most), np.array(most)),
        ).x
        return owner, ends, x, (table @ x - goal) / half

    def changes(self, kept: Sequence[Change]) -> list[Change]:
        """Changes of bodies."""
        model = self.robot.model
        owner, ends, x, _ = self.solved(kept, self.found)
        groups = sorted(set(owner.values()))
        of = {self.robot.number(one.joint): one for one in kept if one.path == FACTOR}
        heavier = [
            dataclasses.replace(
                of[group],
                joint=model.body(body).name,
                path="body.mass_factor",
                before=1.0,
                after=max(1.0 + float(more), LIGHTEST),
            )
            for group, more in zip(groups, x, strict=False)
            for body, joint in owner.items()
            if joint == group and model.body_mass[body] > 0.0 and model.body(body).name
        ]
        for body, size in zip(ends, x[len(groups) :], strict=True):
            cause = next(one.cause for one in kept if one.path == PAYLOAD and self.end(one) == body)
            heavier.append(Change(model.body(body).name, "body.payload", 0.0, float(size), cause, "robot"))
        return heavier


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


def weight_felt(model: mujoco.MjModel, joint: int) -> np.ndarray:
    """What a joint feels of each body (bodies,): inertia at the file's pose [kg.m2], or mass at a slide [kg].

    It feels nothing of those that it does not carry.
    """
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    above, felt = int(model.jnt_bodyid[joint]), np.zeros(model.nbody)
    for body in range(1, model.nbody):
        if not _behind(model, body, above):
            continue
        if int(model.jnt_type[joint]) != int(mujoco.mjtJoint.mjJNT_HINGE):
            felt[body] = model.body_mass[body]
            continue
        turn = data.ximat[body].reshape(3, 3).T @ data.xaxis[joint]
        own = float(turn @ (model.body_inertia[body] * turn))
        felt[body] = own + float(model.body_mass[body]) * _lever(data, joint, data.xipos[body]) ** 2
    return felt


def point_felt(model: mujoco.MjModel, joint: int, body: int, point: np.ndarray) -> float:
    """The same of 1 kg at a point of a body, in its frame (3,) [m]."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    if not _behind(model, body, int(model.jnt_bodyid[joint])):
        return 0.0
    if int(model.jnt_type[joint]) != int(mujoco.mjtJoint.mjJNT_HINGE):
        return 1.0
    return _lever(data, joint, data.xpos[body] + data.xmat[body].reshape(3, 3) @ point) ** 2


def _lever(data: mujoco.MjData, joint: int, point: np.ndarray) -> float:
    """Distance of a point (3,) from the axis of a joint [m]."""
    return float(np.linalg.norm(np.cross(data.xaxis[joint], point - data.xanchor[joint])))


def _behind(model: mujoco.MjModel, body: int, above: int) -> bool:
    """Whether a body is another, or hangs on it."""
    while body > 0 and body != above:
        body = int(model.body_parentid[body])
    return body == above
