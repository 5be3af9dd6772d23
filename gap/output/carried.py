"""What bodies of a robot weigh, from what each joint found of all that hangs behind it.

A body is felt at every joint that carries it, and each joint names what stands for it there: a payload at one, a
heavier link at another. Both handed over is the same mass twice. So all findings are one least-squares problem of the
bodies, and the fewest changes are taken that say what each joint found, within its interval.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import mujoco
import numpy as np
from scipy.optimize import lsq_linear

from ...envs.described.model_file import tip_of
from ...envs.extended import Change
from ..checks.signal import Z95
from ..load.robot import LoggedRobot
from ..load.tree import tip_behind
from ..measure.named import NamedCause

FACTOR, PAYLOAD = "load.mass_factor", "load.payload"
BELIEF_WEIGHT = 0.03  # of bodies to weigh as believed, beside what the joints say of those behind them
CLOSEST = 0.02  # standard error of what a joint carries, as a share of it: none is known better; assumed
MAX_DILUTION = 2.0
"""By how much more than any joint says of all behind it a single body may be off, which is a part of that."""
LIGHTEST = 0.05  # factor on the mass of a body
Told = Mapping[tuple[str, str], NamedCause]
"""Causes that are named, by joint and path of what they change."""


def bodies_carried(robot: LoggedRobot, found: Sequence[Change], told: Told) -> list[Change]:
    """Factors on the masses of bodies, and payloads at their ends, that agree best with what joints found.

    Numbers without a cause say what is left beside those with one.

    Args:
        robot: that was logged.
        found: what joints carry: :data:`FACTOR` on all that hangs behind one, or :data:`PAYLOAD` at its end.
        told: where a cause is named. Only such a change may be left out, the most doubtful first, and what is told
            decides that, also where ``found`` are numbers that were drawn about it.
    """
    bodies = Bodies(robot, told)
    named, others = ([one for one in found if bool(one.cause) is cause] for cause in (True, False))
    kept, said = named, [bodies.as_told(one) for one in named if (one.joint, one.path) in told]
    for doubtful in sorted(said, key=lambda one: told[one.joint, one.path].confidence):
        fewer = [one for one in kept if (one.joint, one.path) != (doubtful.joint, doubtful.path)]
        if fewer and bodies.solved(fewer, said).misfit <= 1.0:
            kept = fewer
    first = bodies.solved(kept, named)
    return [*first.changes, *bodies.solved(others, others, first).changes]


@dataclass(frozen=True, eq=False)
class Solved:
    """What bodies weigh.

    Attributes:
        owner: by body the joint whose factor it takes.
        factors: relative changes of the masses, by joint.
        payloads: at the ends of bodies, by body [kg].
        misfit: how far that is from what joints found, at most, in halves of the intervals.
        changes: of the bodies.
    """

    owner: Mapping[int, int] = field(default_factory=dict)
    factors: Mapping[int, float] = field(default_factory=dict)
    payloads: Mapping[int, float] = field(default_factory=dict)
    misfit: float = np.inf
    changes: tuple[Change, ...] = ()


BELIEVED = Solved()


@dataclass(frozen=True, eq=False)
class Bodies:
    """What joints feel of the bodies that they carry.

    A payload is compared with a factor by their inertias at the file's pose; where a joint is slow, it feels weights.

    Attributes:
        robot: that was logged.
        told: where a cause is named.
    """

    robot: LoggedRobot
    told: Told

    @cached_property
    def felt(self) -> list[np.ndarray]:
        """What each joint feels of each body (bodies,)."""
        return [weight_felt(self.robot.model, joint) for joint in range(self.robot.model.njnt)]

    def end(self, change: Change) -> int:
        """The body at whose end the payload of a joint is."""
        return tip_behind(self.robot.model, self.robot.number(change.joint)).body

    def per_payload(self, joint: int, body: int) -> float:
        """What a joint feels of 1 kg at the end of a body, as a share of all that it carries."""
        whole = float(self.felt[joint].sum())
        return point_felt(self.robot.model, joint, body, tip_of(self.robot.model, body)) / whole if whole > 0.0 else 0.0

    def share(self, change: Change, value: float) -> float:
        """What a joint found, as a share of all that it carries."""
        if change.path == FACTOR:
            return value - 1.0
        return value * self.per_payload(self.robot.number(change.joint), self.end(change))

    def as_told(self, change: Change) -> Change:
        """A change with the value that is told."""
        cause = self.told[change.joint, change.path]
        return dataclasses.replace(change, after=cause.parameters[change.path].value)

    def half(self, change: Change) -> float:
        """Half of the 95 % interval of that share."""
        cause, width = self.told.get((change.joint, change.path)), 0.0
        if cause is not None:
            value = cause.parameters[change.path]
            width = abs(self.share(change, value.high) - self.share(change, value.low))
        return max(0.5 * width, Z95 * CLOSEST)

    def solved(self, kept: Sequence[Change], said: Sequence[Change], beside: Solved = BELIEVED) -> Solved:
        """What bodies weigh by least squares.

        Args:
            kept: changes that are made.
            said: by the joints, of which these are some.
            beside: what is changed already.
        """
        factors = {self.robot.number(one.joint): one for one in kept if one.path == FACTOR}
        owner = {body: of for body, of in _owners(self.robot, [*factors]).items() if body not in beside.owner}
        groups = sorted(set(owner.values()))
        ends = sorted({self.end(one) for one in kept if one.path == PAYLOAD} - beside.payloads.keys())
        both = {one.joint for one in said if one.path == FACTOR} & {one.joint for one in said if one.path == PAYLOAD}
        rows, wanted, halves = [], [], []
        for one in said:
            joint = self.robot.number(one.joint)
            felt = self.felt[joint]
            whole = float(felt.sum())
            if whole <= 0.0:
                continue
            # of two that a joint found of one motion, each says its own; else one stands for all that is felt
            heavier, more = one.path == FACTOR or one.joint not in both, one.path == PAYLOAD or one.joint not in both
            rows.append(
                [heavier * sum(felt[b] for b, of in owner.items() if of == group) / whole for group in groups]
                + [more * self.per_payload(joint, body) for body in ends]
            )
            known = heavier * sum(felt[b] * beside.factors[of] for b, of in beside.owner.items()) / whole
            known += more * sum(self.per_payload(joint, body) * size for body, size in beside.payloads.items())
            wanted.append(self.share(one, one.after) - known)
            halves.append(self.half(one))
        if not rows or not (groups or ends):
            return Solved()
        table, goal, half = np.array(rows), np.array(wanted), np.array(halves)
        weight = half.min() / half
        # joints that contradict each other by a little would otherwise take nearly all of a light body's mass away
        most = MAX_DILUTION * max([1e-9, *(abs(one.after - 1.0) for one in said if one.path == FACTOR)])
        bound = np.array([most] * len(groups) + [np.inf] * len(ends))
        x = lsq_linear(
            np.concatenate([weight[:, None] * table, BELIEF_WEIGHT * np.eye(table.shape[1])[: len(groups)]]),
            np.concatenate([weight * goal, np.zeros(len(groups))]),
            bounds=(-bound, bound),
        ).x
        misfit = float(np.abs((table @ x - goal) / half).max())
        sizes, payloads = dict(zip(groups, x, strict=False)), dict(zip(ends, x[len(groups) :], strict=True))
        return Solved(owner, sizes, payloads, misfit, tuple(self._changes(kept, owner, sizes, payloads)))

    def _changes(
        self,
        kept: Sequence[Change],
        owner: Mapping[int, int],
        sizes: Mapping[int, float],
        payloads: Mapping[int, float],
    ) -> Iterator[Change]:
        model = self.robot.model
        of = {self.robot.number(one.joint): one for one in kept if one.path == FACTOR}
        for joint, size in sizes.items():
            for body in (body for body, group in owner.items() if group == joint):
                if model.body_mass[body] > 0.0 and model.body(body).name:
                    yield dataclasses.replace(
                        of[joint],
                        joint=model.body(body).name,
                        path="body.mass_factor",
                        before=1.0,
                        after=max(1.0 + float(size), LIGHTEST),
                    )
        for body, size in payloads.items():
            one = next(one for one in kept if one.path == PAYLOAD and self.end(one) == body)
            yield dataclasses.replace(
                one, joint=model.body(body).name, path="body.payload", before=0.0, after=float(size)
            )


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
