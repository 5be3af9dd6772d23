"""Slides of a log that count the other way round than in the robot's model, from gravity and coupling.

Only the direction is asked: no force tells a slide's zero. Where the load of a slide is its weight alone, a constant
force, or a zero that goal and position do not share, looks like the other direction: it counts as the other direction
where it would have to be twice that weight.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..load.robot import Frame, LoggedRobot
from ..log.types import MeasuredRun
from .frames import CHANGE, SAMPLES, SHOWS, Torques, load_of, plainly_driven, shares_of, torques_along, within
from .joint_model import JointModel

AGAINST = 0.3  # share of the torque, sum of all joints, that a slide turned around must explain more
LIKE = 1.25  # times the model's load, either way, that a slide turned around may have where a constant looks the same
HARDLY = 2.0  # times it from which it is rather the constant


@dataclass(frozen=True)
class Directions:
    """How the forces of drives speak of slides that count the other way round.

    Attributes:
        told: frames of those of which they tell it.
        doubtful: of those of which they may as well tell a constant force.
        alike: slides of ``told`` of which a constant force of twice their weight would look the same.
        instead: further joints each of which may be turned in place of those of ``told`` and fits as well.
        silent: slides whose direction they do not tell.
        left: mean share of the force of ``told`` and ``doubtful`` that the model leaves over as believed.
        least: the same with them turned.
    """

    told: Mapping[str, Frame]
    doubtful: Mapping[str, Frame]
    alike: tuple[str, ...]
    instead: tuple[str, ...]
    silent: tuple[str, ...]
    left: float
    least: float


def compare_slides(
    robot: LoggedRobot,
    runs: Sequence[MeasuredRun],
    models: Sequence[Mapping[str, JointModel]],
    *,
    outside: bool = False,
) -> Directions | None:
    """Which slides count the other way round; None where the runs cannot tell.

    Args:
        robot, runs, models: as for :func:`compare_frames`.
        outside: ask only slides that leave the model's range, and would not if they were turned around.
    """
    names = [name for name in _logged(robot, runs) if _commanded(runs, models, name)]
    if not any(map(robot.slides, names)):
        return None
    plain = {name: frame for name, frame in robot.frames.items() if name not in names}
    drives = [{name: each[name] for name in names} for each in models]
    torques = torques_along(replace(robot, frames=plain), runs, drives, SAMPLES)
    if torques is None:
        return None
    believed = {name: robot.frame(name) for name in names}
    asked = [name for name in names if robot.slides(name) and (not outside or _returns(robot, torques, name, believed))]
    best, least = dict(believed), sum(shares_of(robot, torques, believed))
    for _ in asked:
        tried = [
            {**best, name: frame}
            for name in asked
            if best[name] == believed[name]
            for frame in _turned_around(robot, torques, name, believed[name])
        ]
        left = [sum(shares_of(robot, torques, frames)) for frames in tried]
        if not left or min(left) > least - AGAINST:
            break
        first = next(k for k, other in enumerate(left) if other < min(left) + CHANGE)  # as zeros of a weight alone
        best, least = tried[first], left[first]
    told, doubtful, alike = _classed(robot, torques, believed, best)
    likely = {**believed, **told, **doubtful}
    now = sum(shares_of(robot, torques, likely))

    def worse(frames: Mapping[str, Frame]) -> float:
        return sum(shares_of(robot, torques, {**likely, **frames})) - now

    silent = [
        name for name in asked
        if likely[name] == believed[name] and worse({name: _around(believed[name])}) <= SHOWS
    ]  # fmt: skip
    back = {name: believed[name] for name in told}
    others = [name for name in _logged(robot, runs) if told and name not in {*told, *doubtful}]
    instead = [name for name in others if worse({**back, name: _around(believed.get(name, Frame()))}) <= CHANGE]
    turned = [names.index(name) for name in {**told, **doubtful}]
    left, less = (
        float(np.mean([shares_of(robot, torques, frames)[k] for k in turned])) if turned else 0.0
        for frames in (believed, likely)
    )
    return Directions(told, doubtful, alike, tuple(instead), tuple(silent), left, less)


def _classed(
    robot: LoggedRobot, torques: Torques, believed: Mapping[str, Frame], best: Mapping[str, Frame]
) -> tuple[dict[str, Frame], dict[str, Frame], tuple[str, ...]]:
    """Frames of slides that the torques tell, those that they may tell, and the joints of the first ones of which a
    constant force would look the same.
    """
    told: dict[str, Frame] = {}
    doubtful: dict[str, Frame] = {}
    alike: list[str] = []
    for name in [name for name, frame in best.items() if frame != believed[name]]:
        back = {**best, name: believed[name]}
        kept, turned = (sum(shares_of(robot, torques, frames, level=True)) for frames in (back, best))
        times = load_of(robot, torques, best, name)
        if kept - turned > AGAINST or _returns(robot, torques, name, believed):
            told[name] = best[name]
        elif 1.0 / LIKE < times < LIKE:
            told[name] = best[name]
            alike.append(name)
        elif 1.0 / HARDLY < times < HARDLY:
            doubtful[name] = best[name]
    return told, doubtful, tuple(alike)


def _around(frame: Frame) -> Frame:
    return replace(frame, sign=-frame.sign)


def _logged(robot: LoggedRobot, runs: Sequence[MeasuredRun]) -> list[str]:
    """Joints of the model that every run has a position of, driven or not."""
    return [
        name for name in runs[0].joints
        if plainly_driven(robot, name) and all(name in run.joints for run in runs)
    ]  # fmt: skip


def _turned_around(robot: LoggedRobot, torques: Torques, name: str, now: Frame) -> list[Frame]:
    """A slide turned around at its zero, and at the middle of its range if that is not the same; of these, those in
    which it stays within the range, if it can.
    """
    every, number = [_around(now)], robot.number(name)
    if robot.model.jnt_limited[number]:
        every.append(Frame(now.zero + now.sign * float(robot.model.jnt_range[number].sum()), -now.sign))
    staying = [frame for frame in every if within(robot, torques, name, frame)]
    return staying or ([] if within(robot, torques, name, now) else every[:1])


def _returns(robot: LoggedRobot, torques: Torques, name: str, believed: Mapping[str, Frame]) -> bool:
    """Whether a joint leaves the model's range, and does not if it is turned around."""
    turned = _turned_around(robot, torques, name, believed[name])
    return not within(robot, torques, name, believed[name]) and any(
        within(robot, torques, name, frame) for frame in turned
    )


def _commanded(runs: Sequence[MeasuredRun], models: Sequence[Mapping[str, JointModel]], name: str) -> bool:
    """Whether each run has the command that the joint's chain reads."""
    if not all(name in each for each in models):
        return False
    logs = [(run.joints[name], each[name].command) for run, each in zip(runs, models, strict=True)]
    return all(getattr(log, command) is not None for log, command in logs)
